//! How sure the sizes of effects are: 90 % intervals.
//!
//! A size is a function of coefficients, `s = g(x)`. Two distributions of `x` are propagated through `g`:
//!
//! ```text
//! posterior   x ~ N(x̂, A⁻¹)                    what noise and the errors of the file leave: A with every value of the model free
//! bootstrap   x̂ of blocks drawn with return     what the model does not hold for: residuals that are not noise
//! ```
//!
//! The interval is the hull of both 90 % intervals. Inner values (a velocity, a length, an order) are held as they were refined, so that an
//! interval is conditional on them; a size that is an inner value has none.

use std::f64::consts::TAU;

use nalgebra::DVector;

use crate::evidence::Solved;
use crate::form::Form;
use crate::magnitude::PHASE;
use crate::procedure::{Procedure, Step};
use crate::random::Random;
use crate::search::Search;
use crate::values::Wrong;

/// Draws of either kind: the ends of a 90 % interval are then the third from either side.
const DRAWS: usize = 60;
/// Probability beyond either end.
const TAIL: f64 = 0.05;
/// A size that varies by less than this share of itself is an inner value.
const CONSTANT: f64 = 1e-9;

/// Coefficients as they might be.
pub(crate) struct Draws {
    posterior: Vec<DVector<f64>>,
    bootstrap: Vec<DVector<f64>>,
}

impl Draws {
    /// Draws about a solution with the groups at `held` kept as given.
    pub(crate) fn of(search: &mut Search<'_>, wrong: &Wrong, held: &[usize], frozen: bool, solved: &Solved) -> Draws {
        let mut random = Random::new();
        let free = wrong.all_free(search);
        let deviation = |random: &mut Random, free: &Solved| {
            free.deviation(&DVector::from_fn(solved.x.len(), |_, _| random.normal()))
        };
        let posterior = (0..DRAWS).filter_map(|_| Some(&solved.x + deviation(&mut random, free.as_ref()?)?)).collect();
        let blocks = search.design.background.blocks();
        let choices: Vec<Vec<usize>> =
            (0..DRAWS).map(|_| (0..blocks).map(|_| random.below(blocks)).collect()).collect();
        let bootstrap = wrong.held_on(search, held, frozen, &choices).into_iter().map(|solved| solved.x).collect();
        Draws { posterior, bootstrap }
    }
}

impl Procedure<'_> {
    /// 90 % intervals of those sizes in `magnitude` that follow from coefficients of effects: name, lower and upper end. Contact has none: its
    /// coefficients are of moments, of which the sizes are the largest.
    pub(crate) fn intervals(
        &self,
        search: &Search<'_>,
        step: &Step,
        draws: &Draws,
        magnitude: &[(String, f64)],
    ) -> Vec<(String, f64, f64)> {
        if step.adopted.is_empty() || step.adopted.iter().any(|a| matches!(a.form, Form::Force { .. })) {
            return Vec::new();
        }
        let sizes = |of: &[DVector<f64>]| -> Vec<Vec<(String, f64)>> {
            of.iter().map(|x| self.magnitude(search, step, x, &[])).collect()
        };
        let all = [sizes(&draws.posterior), sizes(&draws.bootstrap)];
        let mut found = Vec::new();
        let model = &self.nominal.model;
        // Values of the model have their intervals in the table of parameters.
        let is_value = |name: &str| model.parameters.iter().any(|p| p.name(&model.arm) == name);
        for (name, size) in magnitude.iter().filter(|(name, _)| !is_value(name)) {
            let ends = all.iter().filter_map(|draws| {
                let of = draws.iter().filter_map(|sizes| sizes.iter().find(|(n, _)| n == name));
                interval(
                    of.map(|(_, drawn)| if name.ends_with(PHASE) { nearest(*drawn, *size) } else { *drawn }).collect(),
                )
            });
            let hull = ends.fold((*size, *size), |(low, high), (from, to)| (low.min(from), high.max(to)));
            if hull.0.is_finite() && hull.1.is_finite() && hull.1 - hull.0 > CONSTANT * size.abs() {
                found.push((name.clone(), hull.0, hull.1));
            }
        }
        found
    }
}

/// The angle that differs from `angle` by whole turns and is nearest to `to` \[rad\].
fn nearest(angle: f64, to: f64) -> f64 {
    angle - TAU * ((angle - to) / TAU).round()
}

/// Ends of the 90 % interval of what was drawn; none of nothing.
fn interval(mut of: Vec<f64>) -> Option<(f64, f64)> {
    of.sort_by(f64::total_cmp);
    let end = |share: f64| of.get((of.len().saturating_sub(1) as f64 * share).round() as usize).copied();
    Some((end(TAIL)?, end(1.0 - TAIL)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_phase_is_taken_by_the_turn_that_is_nearest() {
        assert!((nearest(-3.1, 3.1) - (TAU - 3.1)).abs() < 1e-12);
        assert!((nearest(0.3, 0.1) - 0.3).abs() < 1e-12);
    }

    #[test]
    fn an_interval_leaves_a_twentieth_on_either_side() {
        assert_eq!(interval((0..=100).rev().map(f64::from).collect()), Some((5.0, 95.0)));
        assert_eq!(interval(vec![2.0]), Some((2.0, 2.0)));
        assert_eq!(interval(Vec::new()), None);
    }
}
