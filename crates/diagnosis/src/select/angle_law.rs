//! Whether torque over a joint's angle follows another law than the adopted one.
//!
//! Springs, levers and weights are exact: with the one that is there nothing is left that follows the angle. One that merely bends alike
//! (a lever whose two terms all but cancel, say) takes nearly all of another law, and what it leaves is small beside the gap but not
//! beside noise. On measured arms, where other joints keep more than noise as well, that says nothing.

use crate::effects::counterbalance::Counterbalance;
use crate::fit::search::{Candidate, Search};
use crate::policy::POLICY;
use crate::select::adopted::Adopted;
use crate::select::residual::Residue;

/// Marks a counterbalance of a joint that carries no weight, and laws of the angle beside which another one of the same joint has as much evidence as a further effect needs.
pub(crate) fn mark(search: &Search<'_>, candidates: &[Candidate], adopted: &mut [Adopted]) -> Option<()> {
    for law in adopted.iter_mut().filter(|a| a.form.effect().about().balances_gravity) {
        law.another_law |= law.form.joints() == [0] && turns_about_gravity(search);
    }
    if Residue::from_search(search).any_noisy() || !adopted.iter().any(|a| a.form.of_angle_alone()) {
        return Some(());
    }
    let over: Vec<&Candidate> =
        candidates.iter().filter(|c| c.form.bends_slowly(&|joint| range(search, joint))).collect();
    let solved = search.scales();
    for law in adopted.iter_mut().filter(|a| a.form.of_angle_alone()) {
        let (effect, joints) = (law.form.effect(), law.form.joints());
        let others = over.iter().filter(|c| c.form.joints() == joints && c.form.effect() != effect);
        let gains = others.filter_map(|c| Some(search.standing(0, c, &solved)?.gain));
        law.another_law |= gains.fold(f64::NEG_INFINITY, f64::max) >= POLICY.adoption.min_gain[1];
    }
    (!solved.is_empty()).then_some(())
}

/// Whether the two terms of a lever law all but cancel: torque of a spring that is hardly stretched, or one that merely bends as another law does.
pub(crate) fn cancels(candidate: &Candidate, c: &[f64]) -> bool {
    let Some(&Counterbalance { joint, .. }) = candidate.form.get() else { return false };
    let (mut one, mut other, mut sum) = (0.0, 0.0, 0.0);
    for columns in &candidate.columns {
        let [Some(a), Some(b)] = [0, 1].map(|k| columns.get(k).and_then(|column| column[joint].as_ref())) else {
            continue;
        };
        for (a, b) in a.iter().zip(b) {
            let (a, b) = (c[0] * a, c[1] * b);
            one += a * a;
            other += b * b;
            sum += (a + b) * (a + b);
        }
    }
    f64::max(one, other) > POLICY.plausibility.max_cancelling_ratio.powi(2) * sum
}

/// Whether the first joint turns about gravity: there is nothing to balance then.
fn turns_about_gravity(search: &Search<'_>) -> bool {
    let arm = &search.nominal.model.arm;
    let Some(first) = arm.joints.first() else { return false };
    let axis: Vec<f64> =
        first.rotation.iter().map(|row| row.iter().zip(&first.axis).map(|(r, a)| r * a).sum()).collect();
    let along: f64 = axis.iter().zip(&arm.gravity).map(|(a, g)| a * g).sum();
    along.abs() > POLICY.plausibility.min_gravity_cosine * arm.gravity.iter().map(|g| g * g).sum::<f64>().sqrt()
}

/// Largest angle that a joint goes over in a run \[rad\].
pub(crate) fn range(search: &Search<'_>, joint: usize) -> f64 {
    let angle_range = |q: &[f64]| {
        let (low, high) = q.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), q| (l.min(*q), h.max(*q)));
        (high - low).max(0.0)
    };
    search.runs.iter().map(|run| angle_range(&run.motion.q[joint])).fold(0.0, f64::max)
}
