//! Predicted and measured shrink of the gap, and whether the held-out run refutes the fit.

use crate::effects::Effect;
use crate::fit::prediction::Prediction;
use crate::fit::stages::Stages;
use crate::model::gap::Gap;
use crate::policy::POLICY;
use crate::report::diagnosis::Shrink;

/// Shrink by step `k`, which adds `effect`. `seen`: the runs looked at; `gaps`: the sealed one's.
pub(crate) fn estimate(effect: Effect, k: usize, prediction: &Prediction, seen: &[Stages], gaps: &[Gap]) -> Shrink {
    let (predicted, low, high) = if effect.about().cuts_command {
        // As before, if the command is cut as often again.
        let before = on_runs(seen, k);
        (before, 0.0_f64.min(before), before.max(0.95))
    } else {
        prediction.shrink[k]
    };
    Shrink { predicted, low, high, measured: 1.0 - gaps[k + 1].all / gaps[k].all }
}

/// Whether the sealed run says that the other runs did not tell the values apart: nothing that was fitted to them is believed then.
pub(crate) fn is_refuted(gaps: &[Gap], shrinks: &[Shrink]) -> bool {
    let Some((before, after)) = gaps.first().zip(gaps.last()) else { return false };
    let promised = 1.0 - shrinks.iter().map(|s| 1.0 - s.low.max(0.0)).product::<f64>();
    let came = 1.0 - after.all / before.all;
    promised > POLICY.held_out.min_promise && came < POLICY.held_out.min_kept_promise_share * promised
        || after.all > POLICY.held_out.max_refuted_gap_ratio * before.all
}

/// Whether a gap is so far above the noise that it is one.
pub(crate) fn is_plain(gap: f64, floor: f64) -> bool {
    gap > POLICY.held_out.max_refuted_gap_ratio * floor
}

fn on_runs(seen: &[Stages], k: usize) -> f64 {
    let gap = |stage: usize| seen.iter().map(|s| Gap::new(&s.tau, &s.models[stage]).all).sum::<f64>();
    1.0 - gap(k + 1) / gap(k)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gaps(all: &[f64]) -> Vec<Gap> {
        all.iter().map(|all| Gap { all: *all, per_joint: vec![*all] }).collect()
    }

    #[test]
    fn promises_that_are_broken_refute_and_small_ones_do_not() {
        let shrink = |low: f64| Shrink { predicted: 0.5, low, high: 0.9, measured: 0.0 };
        assert!(!is_refuted(&gaps(&[0.5, 0.4, 0.4]), &[shrink(0.5)]), "far less than promised, but not nothing");
        assert!(is_refuted(&gaps(&[0.5, 0.4, 0.49]), &[shrink(0.5)]));
        assert!(is_refuted(&gaps(&[0.5, 0.4, 0.48]), &[shrink(0.3), shrink(0.3)]), "together they promised half");
        assert!(!is_refuted(&gaps(&[0.5, 0.5]), &[shrink(0.05)]), "too little was promised");
        assert!(!is_refuted(&gaps(&[0.5, 0.6]), &[]), "somewhat worse");
        assert!(is_refuted(&gaps(&[0.5, 0.4, 1.1]), &[]), "twice as bad");
    }
}
