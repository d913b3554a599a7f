//! Joints whose residual stays above the noise although causes were named, and which names are withdrawn for it.
//!
//! Something is missing there that nobody knows, and a name may be what the list has of it. In 191 runs with disturbances that are
//! mostly not in the list, structure was named above 0.6 on such joints 22 times and was the effect itself 4 times; where all
//! joints were closed it mostly was.

use crate::effects::Kind;
use crate::policy::POLICY;
use crate::report::diagnosis::{Cause, Diagnosis, JointGap, Verdict};

impl Diagnosis {
    /// Joints that are left open, and how many times smaller their gap became.
    fn left_open(&self) -> impl Iterator<Item = (&String, f64)> {
        self.per_joint.iter().filter_map(|gap| {
            let [before, after] = gap.in_motion?;
            (after > POLICY.held_out.min_gap_in_motion && before < POLICY.held_out.min_closing_ratio * after)
                .then(|| (&gap.joint, before / after))
        })
    }

    /// Withdraws effects that hardly close the gap of a joint of their own, or spoil it; says which, by their places.
    pub(crate) fn withdraw_what_hardly_helps(&mut self) -> Vec<usize> {
        let spoils = |cause: &Cause| {
            let worse = |gap: &JointGap| {
                cause.joints.contains(&gap.joint) && gap.after > POLICY.held_out.min_spoiling_factor * gap.before
            };
            cause.shrink.predicted < POLICY.held_out.min_promised_share && self.per_joint.iter().any(worse)
        };
        let crowded: Vec<&String> = self.crowded().collect();
        let closes = |cause: &Cause| {
            self.left_open().all(|(j, times)| times >= POLICY.held_out.min_helping_ratio || !cause.joints.contains(j))
                && !cause.joints.iter().any(|j| crowded.contains(&j))
        };
        let helps = |cause: &Cause| {
            let structure = cause.effect.kind() == Kind::Structure;
            !structure || !spoils(cause) && (cause.effect.about().is_inexact || closes(cause))
        };
        let out: Vec<usize> = (0..self.causes.len()).filter(|k| !helps(&self.causes[*k])).collect();
        for k in out.iter().rev() {
            let cause = self.causes.remove(*k);
            self.withdrawn.push(cause);
        }
        if !out.is_empty() {
            let structure = self.causes.iter().filter(|c| c.effect.kind() == Kind::Structure).count();
            self.verdict = match structure {
                0 => Verdict::Unexplained,
                1 => Verdict::Effect,
                _ => Verdict::Several,
            };
        }
        out
    }

    /// Joints that are left open by several exact laws of their own, while most come down to their noise.
    fn crowded(&self) -> impl Iterator<Item = &String> {
        let exact_causes = |joint: &String| {
            let exact = |c: &&Cause| c.effect.kind() == Kind::Structure && !c.effect.about().is_inexact;
            self.causes.iter().filter(exact).filter(|c| c.joints.contains(joint)).count()
        };
        let apart = self.come_down();
        self.left_open()
            .map(|(joint, _)| joint)
            .filter(move |joint| apart && exact_causes(joint) >= POLICY.held_out.min_crowd)
    }

    /// Whether at least half of the joints come down to their noise in motion.
    fn come_down(&self) -> bool {
        let times = || self.per_joint.iter().filter_map(|gap| Some(gap.in_motion?[1]));
        2 * times().filter(|times| *times <= POLICY.held_out.max_sound_gap).count() >= times().count()
    }

    /// Whether a joint keeps a gap in motion while most come down to their noise, or one keeps far more than right values leave on a measured
    /// arm: then wrong values are no answer, however little of the gap as given that is. (On a measured arm none comes down all the way.)
    pub(crate) fn keeps_open_joints(&self) -> bool {
        let times: Vec<f64> = self.per_joint.iter().filter_map(|gap| Some(gap.in_motion?[1])).collect();
        let most = times.iter().copied().fold(0.0, f64::max);
        // Where one joint moves there are no others to say that none comes down.
        most > POLICY.held_out.min_gap_in_motion && (self.come_down() || times.len() == 1)
            || most > POLICY.held_out.max_gap_with_right_values
    }

    /// Lowers the confidence in what is named on joints that are left open, and beside them. Contact comes again as it likes, and what a
    /// simulated gear, bristle or delay misses is of its own form: that says nothing against the cause itself, or of other joints.
    pub(crate) fn doubt_what_is_left_open(&mut self) {
        let acts_on = |cause: &Cause, joint: &String| cause.joints.is_empty() || cause.joints.contains(joint);
        let open: Vec<String> = self.left_open().map(|(joint, _)| joint.clone()).collect();
        let roughly: Vec<Cause> = self.causes.iter().filter(|c| c.effect.about().is_inexact).cloned().collect();
        let strange = open.iter().any(|joint| !roughly.iter().any(|c| acts_on(c, joint)));
        let rings = self
            .per_joint
            .iter()
            .any(|gap| gap.in_motion.is_some_and(|[_, after]| after > POLICY.held_out.max_sound_gap));
        for cause in &mut self.causes {
            let kept = |gap: &JointGap| {
                cause.joints.contains(&gap.joint)
                    && gap.in_motion.is_some_and(|[_, after]| {
                        (POLICY.held_out.max_sound_gap..=POLICY.held_out.min_gap_in_motion).contains(&after)
                    })
            };
            // Friction of either direction is exact, and so is a gain: with it nothing else is left.
            let exact = cause.effect.about().is_exact;
            if exact && self.per_joint.iter().any(kept) {
                cause.confidence *= POLICY.confidence.left_open;
            }
            if rings
                && cause.effect.about().is_intermittent
                && cause.share.is_some_and(|share| share < POLICY.held_out.min_contact_share)
            {
                cause.confidence *= POLICY.confidence.left_open;
            }
            let structure = cause.effect.kind() == Kind::Structure;
            if structure && !cause.effect.about().is_inexact && open.iter().any(|joint| acts_on(cause, joint)) {
                cause.confidence *= POLICY.confidence.left_open;
            } else if strange {
                cause.confidence *= POLICY.confidence.open_beside;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Effect;
    use crate::effects::{
        coulomb_friction, counterbalance, external_force, friction_asymmetry, joint_elasticity, stribeck_friction,
        torque_saturation,
    };
    use crate::report::diagnosis::DataUse;

    /// Joints a, b and c with these gaps in motion; one cause on each of the first joints.
    fn diagnosis(in_motion: [[f64; 2]; 3], effects: &[Effect]) -> Diagnosis {
        let data = DataUse { runs: 2, cut: false, fit_seconds: 10.0, sealed_seconds: 5.0, of_another_kind: None };
        let names = ["a", "b", "c"].map(str::to_owned);
        let gap = |(joint, in_motion): (&String, [f64; 2])| JointGap {
            joint: joint.clone(),
            before: 0.1,
            after: 0.05,
            noise_floor: 0.01,
            repeats: None,
            in_motion: Some(in_motion),
        };
        let cause = |(effect, joint): (&Effect, &String)| Cause {
            confidence: 1.0,
            ..crate::judge::cause_sizes::hint(*effect, vec![joint.clone()], &[])
        };
        Diagnosis {
            verdict: Verdict::Several,
            per_joint: names.iter().zip(in_motion).map(gap).collect(),
            causes: effects.iter().zip(&names).map(cause).collect(),
            ..Diagnosis::not_evaluated(data, "")
        }
    }

    fn confidences(in_motion: [[f64; 2]; 3], effects: &[Effect]) -> Vec<f64> {
        let mut found = diagnosis(in_motion, effects);
        found.doubt_what_is_left_open();
        found.causes.iter().map(|cause| cause.confidence).collect()
    }

    #[test]
    fn wrong_values_are_no_answer_beside_a_joint_that_is_left() {
        let open = |after: [f64; 3]| {
            diagnosis(after.map(|after| [90.0, after]), &[coulomb_friction::EFFECT]).keeps_open_joints()
        };
        assert!(!open([1.0, 1.1, 3.9]) && open([1.0, 1.1, 4.1]));
        // As on measured arms: a UR10e without its friction was `unexplained` where these values take 96 % of the squared gap.
        assert!(!open([7.5, 12.9, 9.3]) && !open([11.0, 3.8, 3.4]) && open([8.9, 40.7, 9.0]));
    }

    #[test]
    fn what_is_named_where_a_gap_is_left_is_doubted_most() {
        let effects = [counterbalance::EFFECT, stribeck_friction::EFFECT, coulomb_friction::EFFECT];
        assert_eq!(confidences([[20.0, 1.1], [8.0, 1.0], [3.0, 1.5]], &effects), [1.0; 3]);
        let open = confidences([[20.0, 9.0], [8.0, 1.0], [3.0, 1.5]], &effects);
        assert_eq!(open, [POLICY.confidence.left_open, POLICY.confidence.open_beside, POLICY.confidence.open_beside]);
        assert_eq!(confidences([[90.0, 9.0], [8.0, 1.0], [3.0, 1.5]], &effects), [1.0; 3], "ten times smaller");
    }

    #[test]
    fn what_is_never_exact_says_nothing_against_itself() {
        let effects = [joint_elasticity::EFFECT, stribeck_friction::EFFECT];
        assert_eq!(confidences([[20.0, 9.0], [8.0, 1.0], [1.0, 1.0]], &effects), [1.0; 2]);
        assert_eq!(confidences([[20.0, 9.0], [8.0, 1.0], [9.0, 9.0]], &effects), [POLICY.confidence.open_beside; 2]);
        let contact = [external_force::EFFECT, torque_saturation::EFFECT];
        assert_eq!(confidences([[20.0, 9.0], [30.0, 9.0], [9.0, 9.0]], &contact)[1], POLICY.confidence.left_open);
    }

    #[test]
    fn exact_friction_leaves_nothing_and_a_slight_contact_may_be_a_gear_that_rings() {
        let asymmetry = [friction_asymmetry::EFFECT];
        assert_eq!(confidences([[20.0, 1.5], [1.0, 1.0], [1.0, 1.0]], &asymmetry), [1.0]);
        assert_eq!(confidences([[20.0, 3.0], [1.0, 1.0], [1.0, 1.0]], &asymmetry), [POLICY.confidence.left_open]);
        assert_eq!(confidences([[20.0, 1.5], [8.0, 3.0], [1.0, 1.0]], &asymmetry), [1.0], "another joint's");
        let contact = |share: f64, after: f64| {
            let mut found = diagnosis([[20.0, after], [1.0, 1.0], [1.0, 1.0]], &[external_force::EFFECT]);
            found.causes[0].share = Some(share);
            found.doubt_what_is_left_open();
            found.causes[0].confidence
        };
        assert_eq!(
            [contact(0.01, 3.0), contact(0.01, 1.5), contact(0.2, 3.0)],
            [POLICY.confidence.left_open, 1.0, 1.0]
        );
    }

    #[test]
    fn an_effect_that_hardly_helps_is_withdrawn() {
        let effects = [counterbalance::EFFECT, stribeck_friction::EFFECT];
        let mut found = diagnosis([[10.7, 9.1], [8.0, 1.0], [1.0, 1.0]], &effects);
        assert_eq!(found.withdraw_what_hardly_helps(), [0]);
        assert_eq!((found.verdict, found.withdrawn.len()), (Verdict::Effect, 1));
        let mut found = diagnosis([[10.7, 9.1], [8.0, 7.0], [1.0, 1.0]], &effects);
        assert_eq!(found.withdraw_what_hardly_helps(), [0, 1]);
        assert_eq!((found.verdict, found.causes.len()), (Verdict::Unexplained, 0));
    }

    #[test]
    fn several_laws_that_leave_their_joint_open_beside_sound_ones_are_none() {
        let laws = [friction_asymmetry::EFFECT, torque_saturation::EFFECT];
        let left = |in_motion| {
            let mut found = diagnosis(in_motion, &laws);
            found.causes[1].joints = vec!["a".to_owned()];
            let out = found.withdraw_what_hardly_helps();
            (out, found.verdict)
        };
        let (out, verdict) = left([[80.0, 16.0], [8.0, 1.0], [3.0, 1.0]]);
        assert_eq!((out, verdict), (vec![0, 1], Verdict::Unexplained));
        assert!(left([[80.0, 3.0], [8.0, 1.0], [3.0, 1.0]]).0.is_empty(), "closed");
        assert!(left([[80.0, 16.0], [18.0, 6.0], [13.0, 5.0]]).0.is_empty(), "as measured arms are");
        let mut one_each = diagnosis([[80.0, 16.0], [8.0, 1.0], [3.0, 1.0]], &laws);
        assert!(one_each.withdraw_what_hardly_helps().is_empty());
    }

    #[test]
    fn an_effect_that_promises_nothing_and_spoils_its_joint_is_withdrawn() {
        let of = |predicted: f64, after: f64| {
            let mut found = diagnosis([[2.5, 1.1], [19.0, 9.0], [1.0, 1.0]], &[stribeck_friction::EFFECT]);
            found.causes[0].shrink.predicted = predicted;
            found.per_joint[0].after = after;
            found.withdraw_what_hardly_helps().len()
        };
        assert_eq!([of(0.0, 0.16), of(0.03, 0.16), of(0.0, 0.12)], [1, 0, 0]);
    }
}
