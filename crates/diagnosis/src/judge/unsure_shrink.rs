//! Doubt in names that may take nothing from motion they have not seen.

use crate::policy::POLICY;
use crate::report::diagnosis::Diagnosis;

impl Diagnosis {
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
    use crate::report::diagnosis::{Cause, DataUse, Shrink, Verdict};

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
