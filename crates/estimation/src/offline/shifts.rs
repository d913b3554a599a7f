//! How well every delay of a wide range explains the torque: where the search for a delay starts, and whether there is
//! one answer.
//!
//! With weights w and the torque of joint j taken back by T_j, the least squares over all joints leave
//!
//! ```text
//! J(T) = Σ w τ(T)ᵀτ(T) − b(T)ᵀ A⁻¹ b(T)      A = Σ w DᵀD + P⁻¹,  b = Σ w Dᵀτ(T) + P⁻¹ x₀
//! ```
//!
//! A does not depend on the delays: one inverse serves all of them. All delays are judged by the
//! same rows: those too near an end of the record to have a torque for each are left out.

use nalgebra::DVector;
use rayon::prelude::*;

use super::delay::DelayDoubt;
use super::fit::{Fit, Method, Solution};
use super::record::OfflineError;
use super::sums::{Equations, JointSums, Normal};
use crate::linear::{axpy, dot};

/// Delays up to this are looked at, either way \[s\].
pub const REACH_S: f64 = 0.12;
/// In steps of this \[s\]: the second order of the refinement is exact well beyond half of it.
pub(super) const STEP_S: f64 = 0.008;
/// So many delays either way of zero.
const STEPS: usize = (REACH_S / STEP_S) as usize;
const COUNT: usize = 2 * STEPS + 1;
/// So many rows of a joint, evenly spread, say enough: the search costs as much for any length of a log.
const MAX_SEARCH_ROWS: usize = 2000;
/// Joints are taken in turn at most so often; every turn lowers J.
const TURNS: usize = 12;
/// There is a delay where J rises by this beside it (5 standard deviations: the best of many is looked for) ...
const LEAST_RISE: f64 = 25.0;
/// ... it is told from another by this (3 standard deviations) ...
const LEAST_DIFFERENCE: f64 = 9.0;
/// ... and both by this share of what the best one leaves: the model is no better than that.
const MIN_DIFFERENCE_SHARE: f64 = 0.03;
/// The bottom between grid points is known to this share of what J rises to.
const GRID_SHARE: f64 = 0.02;

/// The best delays on the grid.
pub(super) struct Coarse {
    /// \[s\], per joint, between grid points by a parabola.
    pub(super) late_s: Vec<f64>,
    /// Why a joint's is none.
    pub(super) doubt: Vec<Option<DelayDoubt>>,
    /// Base parameters that belong to them.
    pub(super) values: Vec<f64>,
    /// Weights of the joints' rows that belong to them.
    pub(super) weights: Vec<f64>,
}

fn late_s(step: usize) -> f64 {
    (step as f64 - STEPS as f64) * STEP_S
}

/// Sums of one joint over the rows that have a torque for every delay.
struct Shifts {
    /// Dᵀτ and τᵀτ for every delay.
    dt: Vec<Vec<f64>>,
    tt: Vec<f64>,
    /// DᵀD, row-major over the joint's columns.
    dd: Vec<f64>,
    count: f64,
}

impl Shifts {
    /// Rows beside a stop count `trust`.
    fn new(equations: &Equations<'_>, j: usize, trust: f64) -> Shifts {
        let width = equations.joints[j].columns.len();
        let rows = equations.joints[j].count();
        let stride = (rows as usize).div_ceil(MAX_SEARCH_ROWS).max(1);
        let mut sums = Shifts {
            dt: vec![vec![0.0; width]; COUNT],
            tt: vec![0.0; COUNT],
            dd: vec![0.0; width * width],
            count: 0.0,
        };
        // Rows that are left out of the sums are none here either.
        for record in equations.rows.iter().filter(|_| rows > 0.0) {
            let joint = &record.joints[j];
            for (row, place) in joint.place.iter().enumerate().step_by(stride) {
                let d = &joint.d[row * width..(row + 1) * width];
                let ends = [0, COUNT - 1].map(|step| record.torque_after(j, *place, late_s(step)));
                if ends.iter().any(Option::is_none) {
                    continue;
                }
                // A row stands for those that are left out.
                let stands = stride as f64 * joint.weight(row, trust);
                sums.dd.chunks_exact_mut(width.max(1)).zip(d).for_each(|(dd, x)| axpy(stands * x, d, dd));
                sums.count += stride as f64;
                for (step, (dt, tt)) in sums.dt.iter_mut().zip(&mut sums.tt).enumerate() {
                    let Some([tau, ..]) = record.torque_after(j, *place, late_s(step)) else { continue };
                    axpy(stands * tau, d, dt);
                    *tt += stands * tau * tau;
                }
            }
        }
        sums
    }
}

/// The equations for given weights, and J of every delay.
struct Evidence<'a> {
    shifts: &'a [Shifts],
    joints: &'a [JointSums],
    weights: &'a [f64],
    solution: &'a Solution,
    offset: DVector<f64>,
}

impl Evidence<'_> {
    /// w Dᵀτ of one joint, scaled, over all columns.
    fn right(&self, j: usize, step: usize, into: &mut DVector<f64>, sign: f64) {
        for (c, x) in self.joints[j].columns.iter().zip(&self.shifts[j].dt[step]) {
            into[*c] += sign * self.weights[j] * self.solution.scale[*c] * x;
        }
    }

    fn total(&self, steps: &[usize]) -> DVector<f64> {
        let mut b = self.offset.clone();
        steps.iter().enumerate().for_each(|(j, step)| self.right(j, *step, &mut b, 1.0));
        b
    }

    /// J less what no delay changes.
    fn objective(&self, steps: &[usize], b: &DVector<f64>) -> f64 {
        let torque_square: f64 =
            steps.iter().enumerate().map(|(j, step)| self.weights[j] * self.shifts[j].tt[*step]).sum();
        torque_square - b.dot(&(&self.solution.inverse * b))
    }

    /// J along the delays of one joint, those of the others fixed.
    fn along(&self, j: usize, steps: &[usize]) -> Vec<f64> {
        let mut others = self.total(steps);
        self.right(j, steps[j], &mut others, -1.0);
        let objective_at = |step: usize| {
            let mut steps = steps.to_vec();
            steps[j] = step;
            let mut b = others.clone();
            self.right(j, step, &mut b, 1.0);
            self.objective(&steps, &b)
        };
        // Few at a time would take longer to be shared out than to be done.
        (0..COUNT).into_par_iter().with_min_len(COUNT / 4).map(objective_at).collect()
    }

    fn values(&self, steps: &[usize]) -> DVector<f64> {
        (&self.solution.inverse * self.total(steps)).component_mul(&self.solution.scale)
    }

    /// `‖τ(T) − D x‖²` of one joint over its rows.
    fn square(&self, j: usize, step: usize, x: &DVector<f64>) -> f64 {
        let joint = &self.joints[j];
        let values: Vec<f64> = joint.columns.iter().map(|c| x[*c]).collect();
        let bent: f64 = self.shifts[j]
            .dd
            .chunks_exact(values.len().max(1))
            .zip(&values)
            .map(|(row, x)| x * dot(row, &values))
            .sum();
        (self.shifts[j].tt[step] - 2.0 * dot(&self.shifts[j].dt[step], &values) + bent).max(0.0)
    }
}

/// Looks at every delay of the range.
///
/// * `found`: the fit without delays
/// * `start`: base parameters before, x₀, and `prior` as for [`fit`](super::fit())
pub(super) fn search(
    equations: &Equations<'_>,
    found: &Fit,
    start: &DVector<f64>,
    prior: f64,
) -> Result<Coarse, OfflineError> {
    let n = equations.joints.len();
    let shifts: Vec<Shifts> = (0..n).into_par_iter().map(|j| Shifts::new(equations, j, found.trust[j])).collect();
    let normal = |(joint, shifts): (&JointSums, &Shifts)| {
        let mut normal = Normal::new(joint, start.len(), Method::LeastSquares);
        normal.dd.fill(0.0);
        joint.spread(&shifts.dd, 1.0, &mut normal.dd);
        (normal.zd, normal.zz, normal.count) = (normal.dd.clone(), normal.dd.clone(), shifts.count);
        normal
    };
    let normals: Vec<Normal> = equations.joints.iter().zip(&shifts).map(normal).collect();
    if shifts.iter().all(|s| s.count < 1.0) {
        let (late_s, doubt) = (vec![0.0; n], vec![Some(DelayDoubt::NotTold); n]);
        return Ok(Coarse { late_s, doubt, values: found.values.clone(), weights: found.weights() });
    }
    let weight = |noise: f64, j: usize| 1.0 / (noise * noise * found.correlation[j]);
    let mut weights = found.weights();
    let mut steps = vec![STEPS; n];
    let mut profiles = Vec::new();
    let mut values = start.clone();
    for turn in 0..TURNS {
        let solution = Solution::new(&normals, &weights, start, (prior, equations.most()), Method::LeastSquares)?;
        let offset = solution.prior.component_mul(&start.component_div(&solution.scale));
        let evidence =
            Evidence { shifts: &shifts, joints: &equations.joints, weights: &weights, solution: &solution, offset };
        let before = steps.clone();
        if turn == 0 {
            // A delay that all joints share is found first: one joint alone would have to leave the others.
            let together = |step: usize| evidence.objective(&vec![step; n], &evidence.total(&vec![step; n]));
            steps.fill(least(&(0..COUNT).map(together).collect::<Vec<_>>()));
        }
        for j in 0..n {
            steps[j] = least(&evidence.along(j, &steps));
        }
        values = evidence.values(&steps);
        profiles = (0..n).map(|j| evidence.along(j, &steps)).collect::<Vec<_>>();
        if turn > 0 && steps == before {
            break;
        }
        // What is left is less than without the delays: every joint counts by what it leaves now.
        let now = |j: usize| {
            if shifts[j].count < 1.0 {
                return weights[j];
            }
            let square = evidence.square(j, steps[j], &values) / shifts[j].count;
            weight(square.sqrt().max(1e-6 * found.noise[j]), j)
        };
        weights = (0..n).map(now).collect();
    }
    let free: Vec<f64> = (0..n).map(|j| shifts[j].count / found.correlation[j]).collect();
    let doubt = (0..n).map(|j| doubt(&profiles[j], steps[j], free[j])).collect();
    let late_s = (0..n).map(|j| bottom(&profiles[j], steps[j]).0).collect();
    Ok(Coarse { late_s, doubt, values: values.as_slice().to_vec(), weights })
}

fn least(left: &[f64]) -> usize {
    (0..left.len()).min_by(|a, b| left[*a].total_cmp(&left[*b])).unwrap_or(0)
}

/// The bottom of the parabola through a delay and its neighbours: where \[s\], and J there.
fn bottom(left: &[f64], at: usize) -> (f64, f64) {
    let (Some(before), Some(after)) = (at.checked_sub(1).map(|k| left[k]), left.get(at + 1)) else {
        return (late_s(at), left[at]);
    };
    let (slope, bend) = (0.5 * (after - before), before - 2.0 * left[at] + after);
    if bend <= 0.0 || slope.abs() > bend {
        return (late_s(at), left[at]);
    }
    (late_s(at) - STEP_S * slope / bend, left[at] - 0.5 * slope * slope / bend)
}

/// Why the best of these delays is none: J along them, and the joint's independent rows.
fn doubt(left: &[f64], best: usize, free: f64) -> Option<DelayDoubt> {
    let least = MIN_DIFFERENCE_SHARE * free;
    let highest = left.iter().fold(0.0_f64, |m, l| m.max(l - left[best]));
    if highest < LEAST_RISE.max(least) {
        return Some(DelayDoubt::NotTold);
    }
    if best == 0 || best + 1 == COUNT {
        return Some(DelayDoubt::OutOfReach);
    }
    // The other's bottom is known as well as parabolas are; it counts where there is a worse delay in between.
    let significant_rise = LEAST_DIFFERENCE.max(least).max(GRID_SHARE * highest);
    let rise = |at: usize| bottom(left, at).1 - bottom(left, best).1;
    let apart = |at: usize| (best.min(at)..best.max(at)).any(|between| left[between] - left[best] >= significant_rise);
    let lowest = |at: &usize| (at.saturating_sub(1)..=(at + 1).min(COUNT - 1)).all(|k| left[k] >= left[*at]);
    let other = (0..COUNT).filter(lowest).filter(|at| rise(*at) < significant_rise && apart(*at));
    let other = other.min_by(|a, b| rise(*a).total_cmp(&rise(*b)))?;
    Some(DelayDoubt::Two { either_s: bottom(left, best).0, or_s: bottom(left, other).0 })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// J of a valley every `period_s`, the one at `late_s` deeper than the others by `deeper`.
    fn valleys(late_s: f64, period_s: f64, height: f64, deeper: f64) -> Vec<f64> {
        let at = |step: usize| {
            let off = (super::late_s(step) - late_s) / period_s;
            let here = if off.abs() < 0.5 { 0.0 } else { deeper };
            here + height * (1.0 - (std::f64::consts::TAU * off).cos())
        };
        (0..COUNT).map(at).collect()
    }

    #[test]
    fn one_clear_valley_is_an_answer_and_anything_else_is_not() {
        let doubt_of = |left: &[f64]| doubt(left, least(left), 100.0);
        let late = |left: &[f64]| bottom(left, least(left)).0;
        let one = valleys(0.021, 1.0, 500.0, 0.0);
        assert_eq!(doubt_of(&one), None);
        assert!((late(&one) - 0.021).abs() < 1e-4, "{}", late(&one));
        // A motion that repeats: 21 ms is 101 ms and -59 ms as well, off the grid or on it.
        for (late_s, deeper) in [(0.021, 0.0), (0.024, 0.0), (0.021, 5.0)] {
            assert!(
                matches!(doubt_of(&valleys(late_s, 0.08, 500.0, deeper)), Some(DelayDoubt::Two { .. })),
                "{late_s} {deeper}"
            );
        }
        assert_eq!(doubt_of(&valleys(0.021, 0.08, 500.0, 100.0)), None, "the others are clearly worse");
        assert_eq!(doubt_of(&valleys(0.021, 1.0, 3.0, 0.0)), Some(DelayDoubt::NotTold));
        assert_eq!(doubt_of(&valleys(0.15, 1.0, 500.0, 0.0)), Some(DelayDoubt::OutOfReach));
    }
}
