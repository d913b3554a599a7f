//! The verdict, from the causes that are upheld and what they leave.

use crate::effects::Kind;
use crate::judge::procedure::Step;
use crate::policy::POLICY;
use crate::report::diagnosis::{Cause, JointGap, Verdict};

use super::Judge;

/// The verdict where what was fitted holds; `causes`: those upheld, those withdrawn.
pub(super) fn verdict(
    judge: &Judge<'_>,
    causes: [&[Cause]; 2],
    steps: &[Step],
    upheld: &[bool],
    per_joint: &[JointGap],
    unexplained_share: f64,
) -> Verdict {
    let [structure, withdrawn_structure] =
        causes.map(|of| of.iter().filter(|c| c.effect.kind() == Kind::Structure).count());
    let left_over = judge.residue.any_noisy();
    let nameless = steps.iter().flat_map(|s| &s.adopted).any(|a| a.form.is_nameless());
    let withdrawn_structure = withdrawn_structure > 0;
    // Where the floor is reached with what was withdrawn after all, that is no answer.
    let refused = steps.iter().zip(upheld).filter(|(s, upheld)| !**upheld && s.effect.kind() == Kind::Structure);
    let lacking = refused.flat_map(|(s, _)| &s.joints).any(|j| judge.residue.was_noisy(*j));
    match (structure, causes[0].is_empty()) {
        // Wrong values are the answer unless most of the gap, or a thing without a name, is left beside them.
        (0, true) if left_over => Verdict::Unexplained,
        // Taken up, but by nothing that has a name.
        (0, _) if nameless => Verdict::Unexplained,
        (0, _) if left_over && (withdrawn_structure || unexplained_share > POLICY.held_out.max_share_left) => {
            Verdict::Unexplained
        }
        // One joint that keeps a gap while the others come down to their noise has something that nobody named.
        (0, _) if per_joint.iter().enumerate().any(|(j, gap)| gap.is_left() && judge.residue.is_nameless(j)) => {
            Verdict::Unexplained
        }
        (0, _) if keeps_more(per_joint, &judge.sealed.run.floor) => Verdict::Unexplained,
        (0, _) if lacking || withdrawn_structure && !judge.residue.at_floor() => Verdict::Unexplained,
        // Values that fit, or motion of its own kind that was looked at by nobody, are no answer either.
        (0, true) if per_joint.iter().any(JointGap::is_open) => Verdict::Unexplained,
        // Of an arm with a joint that cannot be judged nobody says that nothing is wrong.
        (0, true) if judge.names.iter().any(|name| judge.is_unbelieved(name)) => Verdict::NotEvaluated,
        (0, true) => Verdict::NoGap,
        // Nor are values that fit what was looked at and leave most of the gap where it counts.
        (0, false)
            if judge.residue.at_floor()
                && unexplained_share > POLICY.held_out.max_share_left
                && per_joint.iter().any(JointGap::is_left) =>
        {
            Verdict::Unexplained
        }
        (0, false) => Verdict::Parameter,
        (1, _) => Verdict::Effect,
        _ => Verdict::Several,
    }
}

/// Whether a joint keeps more than a sound one does in motion, while half of them or more come down to that. (Of 186 such verdicts on arms of four programs
/// those of sound arms keep 1.4 times the noise at most; the twelve that kept twice as much all lacked something, and three of them were told
/// that nothing is wrong.) Where most joints keep more, as on measured arms, the signal's noise is no measure; nor is it where torque differs by more
/// when a motion is repeated: coloured noise, of which sound arms kept 2.1 to 2.3 times what the `signal` [N·m] shows.
fn keeps_more(per_joint: &[JointGap], signal: &[f64]) -> bool {
    let repeatability = |gap: &JointGap, signal: f64| {
        gap.repeats.map_or(1.0, |scatter| (scatter.torque / signal.max(f64::MIN_POSITIVE)).max(1.0))
    };
    let residuals = per_joint
        .iter()
        .zip(signal)
        .filter_map(|(gap, s)| gap.in_motion.map(|[_, after]| (after, repeatability(gap, *s))));
    let residuals: Vec<(f64, f64)> = residuals.collect();
    // It excuses joints, and accuses none.
    let more = residuals.iter().filter(|(times, _)| *times > POLICY.held_out.max_sound_gap).count();
    2 * more <= residuals.len()
        && residuals.iter().any(|(times, repeatability)| *times > POLICY.held_out.max_sound_gap * repeatability)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::diagnosis::Scatter;

    fn gap(in_motion: Option<[f64; 2]>) -> JointGap {
        JointGap { joint: "a".to_owned(), before: 0.1, after: 0.1, noise_floor: 0.1, repeats: None, in_motion }
    }

    #[test]
    fn a_joint_that_keeps_more_than_noise_beside_sound_ones_keeps_a_gap() {
        let of = |gaps: &[JointGap]| keeps_more(gaps, &vec![0.1; gaps.len()]);
        let keeps = |after: &[f64]| of(&after.iter().map(|a| gap(Some([9.0, *a]))).collect::<Vec<_>>());
        assert!(keeps(&[1.0, 1.1, 2.9]) && keeps(&[1.0, 2.1]));
        assert!(!keeps(&[1.0, 1.1, 1.4]), "as sound arms do");
        assert!(!keeps(&[3.0, 1.0, 2.5]), "as measured arms do");
        assert!(!of(&[gap(None), gap(Some([1.0, 1.0]))]), "what stands says nothing");
        let again = |torque| Some(Scatter { torque, seconds: 9.0, decides: false });
        let repeated = |torque, after| JointGap { repeats: again(torque), ..gap(Some([9.0, after])) };
        assert!(!of(&[repeated(0.13, 2.1), repeated(0.1, 1.2)]), "torque differs by as much where motion does not");
        let measured = [repeated(0.16, 3.0), repeated(0.16, 3.0), gap(Some([9.0, 2.5])), gap(Some([9.0, 1.0]))];
        assert!(!of(&measured), "most keep more than the signal's noise");
        assert!(of(&[repeated(0.13, 2.9), repeated(0.1, 1.2)]) && of(&[repeated(0.05, 2.1), repeated(0.1, 1.2)]));
    }
}
