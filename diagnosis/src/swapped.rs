//! Torque columns of two joints that stand in each other's place.

use crate::background::Nominal;
use crate::design::Prepared;
use crate::log_check::is_still;

/// Cosine of a torque and the model's of the other joint at least, ...
const ALIKE: f64 = 0.9;
/// ... and of its own joint at most.
const UNLIKE: f64 = 0.7;
/// The other's size is that of the model within this factor.
const SIZE: f64 = 2.0;

/// Pairs of joints whose torques are each other's by the model as given.
pub(crate) fn pairs(run: &Prepared, nominal: &Nominal) -> Vec<(usize, usize)> {
    let joints = run.tau.len();
    let model: Vec<Vec<f64>> = (0..joints).map(|j| modelled(run, nominal, j)).collect();
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let alike = |measured: usize, as_of: usize| {
        let (tau, model) = (&run.tau[measured], &model[as_of]);
        let (tt, tm, mm) = (dot(tau, tau), dot(tau, model), dot(model, model));
        (tm / (tt * mm).sqrt().max(f64::MIN_POSITIVE), tm / mm.max(f64::MIN_POSITIVE))
    };
    let own = |j: usize| alike(j, j).0 < UNLIKE;
    let other = |a: usize, b: usize| {
        let (cosine, size) = alike(a, b);
        cosine > ALIKE && (1.0 / SIZE..SIZE).contains(&size)
    };
    let moving: Vec<usize> = (0..joints).filter(|j| !is_still(&run.motion, *j) && own(*j)).collect();
    let with = |a: &usize| moving.iter().map(move |b| (*a, *b)).collect::<Vec<_>>();
    moving.iter().flat_map(with).filter(|(a, b)| a < b && other(*a, *b) && other(*b, *a)).collect()
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
