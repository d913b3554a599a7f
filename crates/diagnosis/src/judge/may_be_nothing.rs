//! Doubt in names that may take nothing from motion they have not seen; withdrawal of those whose size may be nothing.

use crate::effects::Kind;
use crate::policy::POLICY;
use crate::report::diagnosis::{Cause, Diagnosis, Verdict};

/// Whether a doubted effect may be nothing: the intervals of all its sizes hold 0. Of 7 such names on drawn cases 2 were right, of those
/// with a confidence of [`doubted`](crate::policy) and more 5 of 5.
fn may_be_nothing(cause: &Cause) -> bool {
    let holds_nothing = |(_, [low, high]): &(String, [f64; 2])| *low <= 0.0 && *high >= 0.0;
    cause.effect.kind() == Kind::Structure
        && cause.confidence < POLICY.confidence.doubted
        && !cause.intervals.is_empty()
        && cause.intervals.iter().all(holds_nothing)
}

impl Diagnosis {
    /// Withdraws doubted effects whose sizes may be nothing; says which, by their places.
    pub(crate) fn withdraw_what_may_be_nothing(&mut self) -> Vec<usize> {
        let out: Vec<usize> = (0..self.causes.len()).filter(|k| may_be_nothing(&self.causes[*k])).collect();
        for k in out.iter().rev() {
            let cause = self.causes.remove(*k);
            self.withdrawn.push(cause);
        }
        if !out.is_empty() && self.verdict != Verdict::Unexplained {
            let structure = self.causes.iter().filter(|c| c.effect.kind() == Kind::Structure).count();
            self.verdict = match structure {
                0 if self.causes.is_empty() => Verdict::Unexplained,
                0 => Verdict::Parameter,
                1 => Verdict::Effect,
                _ => Verdict::Several,
            };
        }
        out
    }

    /// Lowers the confidence in a name that is doubted already and whose shrink, predicted before the held-out torque was read, may be
    /// none. Contact and limits of torque promise nothing; values of drives and links have confidences of their own.
    pub(crate) fn doubt_what_may_take_nothing(&mut self) {
        for cause in &mut self.causes {
            let about = cause.effect.about();
            let promises = !about.is_intermittent && !about.cuts_command;
            let is_value = about.is_drive || about.is_inertia;
            if promises && !is_value && cause.shrink.low <= 0.0 && cause.confidence < POLICY.confidence.doubted {
                cause.confidence *= POLICY.confidence.may_take_nothing;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{
        Effect, external_force, friction_asymmetry, joint_elasticity, rotor_inertia, torque_saturation,
    };
    use crate::judge::cause_sizes::hint;
    use crate::report::diagnosis::{DataUse, Shrink};

    fn confidence(effect: Effect, low: f64, before: f64) -> f64 {
        let shrink = Shrink { predicted: 0.02, low, high: 0.05, measured: 0.02 };
        let cause = Cause { confidence: before, shrink, ..hint(effect, vec!["a".to_owned()], &[]) };
        let data = DataUse { runs: 2, cut: false, fit_seconds: 10.0, sealed_seconds: 5.0, of_another_kind: None };
        let mut found =
            Diagnosis { verdict: Verdict::Effect, causes: vec![cause], ..Diagnosis::not_evaluated(data, "") };
        found.doubt_what_may_take_nothing();
        found.causes[0].confidence
    }

    #[test]
    fn a_doubted_effect_whose_sizes_may_all_be_nothing_is_withdrawn() {
        let found = |confidence: f64, intervals: &[[f64; 2]], beside: bool| {
            let named = intervals.iter().map(|ends| ("backwards_Nm".to_owned(), *ends));
            let asymmetry = Cause {
                confidence,
                intervals: named.collect(),
                ..hint(friction_asymmetry::EFFECT, vec!["a".to_owned()], &[])
            };
            let values = beside.then(|| hint(rotor_inertia::EFFECT, vec!["a".to_owned()], &[]));
            let data = DataUse { runs: 2, cut: false, fit_seconds: 10.0, sealed_seconds: 5.0, of_another_kind: None };
            let causes = [asymmetry].into_iter().chain(values).collect();
            let mut found = Diagnosis { verdict: Verdict::Effect, causes, ..Diagnosis::not_evaluated(data, "") };
            (found.withdraw_what_may_be_nothing(), found.verdict)
        };
        let (nothing, something) = ([-11.8, 12.3], [0.5, 1.2]);
        assert_eq!(found(0.7, &[nothing], true), (vec![0], Verdict::Parameter));
        assert_eq!(found(0.7, &[nothing], false), (vec![0], Verdict::Unexplained));
        assert_eq!(
            found(0.7, &[nothing, something], true),
            (vec![], Verdict::Effect),
            "one of its sizes is not nothing"
        );
        assert_eq!(found(0.7, &[], true), (vec![], Verdict::Effect), "no size is known");
        assert_eq!(
            found(0.97, &[nothing, nothing], true),
            (vec![], Verdict::Effect),
            "several sizes may stand for one another"
        );
    }

    #[test]
    fn what_is_doubted_and_may_take_nothing_is_doubted_more() {
        let halved = 0.58 * POLICY.confidence.may_take_nothing;
        for effect in [joint_elasticity::EFFECT, friction_asymmetry::EFFECT] {
            assert_eq!(confidence(effect, -0.01, 0.58), halved);
            assert_eq!(confidence(effect, 0.0, 0.58), halved);
            assert_eq!(confidence(effect, 0.01, 0.58), 0.58, "it takes something");
            assert_eq!(confidence(effect, -0.01, 0.97), 0.97, "nothing else speaks against it");
        }
        for effect in [external_force::EFFECT, torque_saturation::EFFECT, rotor_inertia::EFFECT] {
            assert_eq!(confidence(effect, -0.01, 0.58), 0.58, "{effect:?}");
        }
    }
}
