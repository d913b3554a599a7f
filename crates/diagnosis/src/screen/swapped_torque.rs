//! Torque columns of two joints in each other's place.

use crate::model::nominal::Nominal;
use crate::model::standstill::is_still;
use crate::policy::POLICY;
use crate::screen::prepared::Prepared;

/// Pairs of joints whose torques are each other's by the model as given.
pub(crate) fn pairs(run: &Prepared, nominal: &Nominal) -> Vec<(usize, usize)> {
    let moving: Vec<usize> = (0..run.tau.len()).filter(|j| !is_still(&run.motion, *j)).collect();
    let model: Vec<Vec<f64>> = (0..run.tau.len()).map(|j| modelled(run, nominal, j)).collect();
    let missed = |measured: usize, as_of: usize| {
        let (tau, model) = (&run.tau[measured], &model[as_of]);
        let square: f64 = tau.iter().map(|t| t * t).sum();
        let residual_square: f64 = tau.iter().zip(model).map(|(t, m)| (t - m).powi(2)).sum();
        (residual_square / square.max(f64::MIN_POSITIVE)).sqrt()
    };
    // Of the other joint, and that over its own.
    let other = |a: usize, b: usize| (missed(a, b), missed(a, b) / missed(a, a).max(f64::MIN_POSITIVE));
    let swapped = |(a, b): &(usize, usize)| {
        let [(one, one_better), (two, two_better)] = [other(*a, *b), other(*b, *a)];
        one.max(two) < POLICY.screening.max_residual_of_other
            && one_better.max(two_better) < POLICY.screening.max_residual_over_own
            && one_better * two_better < POLICY.screening.max_residual_product
    };
    let pairs_with = |a: &usize| moving.iter().filter(|b| **b > *a).map(|b| (*a, *b)).collect::<Vec<_>>();
    moving.iter().flat_map(pairs_with).filter(swapped).collect()
}

/// Torque of the model as given on joint `j`, its effects included.
fn modelled(run: &Prepared, nominal: &Nominal, j: usize) -> Vec<f64> {
    let mut torque = run.known_rows.get(j).cloned().unwrap_or_else(|| vec![0.0; run.rows()]);
    for (x, column) in nominal.x.iter().zip(&run.standard) {
        if let Some(values) = &column[j] {
            torque.iter_mut().zip(values).for_each(|(t, v)| *t += v * x);
        }
    }
    torque
}
