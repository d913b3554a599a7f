//! What values found from some of the rows leave of the others, and whether all rows are of one arm. From the sums alone, with what a row
//! counts as in the fit of all.

use nalgebra::DVector;
use rayon::prelude::*;

use super::fit::{Fit, Method, Solution};
use super::sums::{Equations, JointSums, Normal, Stretch};
use crate::linear::dot;

/// Parts of equal time, one after the other over all records.
const RECORD_PARTS: usize = 4;

/// The rows in parts.
#[derive(Clone, Debug, PartialEq)]
pub struct Parts {
    /// Per joint: `100 ‖τ - D x‖ / ‖τ‖` of every part by values that were found from the others \[%\]; NaN of a joint that never moves, and
    /// of all where the others leave no solution.
    pub left_out: Vec<f64>,
    /// Where the rows are cut so that two fits, one a side, leave least beside one fit of all; none where a side leaves no solution.
    pub cut: Option<Cut>,
}

/// Two fits instead of one.
#[derive(Clone, Debug, PartialEq)]
pub struct Cut {
    /// Share of the time before the cut.
    pub at: f64,
    /// Per joint: squares that the two leave over those of the one; NaN of a joint that does not move on either side.
    pub left: Vec<f64>,
    /// Per joint: squares that are left of each side by values of the other over those of the one fit of all.
    pub across: Vec<f64>,
}

/// Divides the rows of `equations` into parts. `nominal`, `prior`: as for [`fit`](super::fit()); `fit`: by `method`, of all rows.
pub fn parts(equations: &Equations<'_>, nominal: &[f64], prior: f64, fit: &Fit, method: Method) -> Parts {
    let sums = equations.trusting(&fit.trust);
    let (weights, x0) = (fit.weights(), DVector::from_column_slice(nominal));
    let count = sums.first().map_or(0, |joint| joint.stretches.len());
    let edge = |part: usize| part * count / RECORD_PARTS;
    let solve = |uses: &dyn Fn(usize) -> bool| {
        let joints: Vec<Normal> = sums.iter().map(|joint| Normal::new(&some(joint, uses), x0.len(), method)).collect();
        let solution = Solution::new(&joints, &weights, &x0, (prior, equations.most()), method).ok()?;
        Some(solution.x.as_slice().to_vec())
    };
    let within = |part: usize| move |b: usize| (edge(part)..edge(part + 1)).contains(&b);
    // Of all parts but one, then of those before each cut and of those after it.
    let others = (0..RECORD_PARTS).into_par_iter().map(|part| solve(&|b| !within(part)(b)));
    let sides = (0..2 * (RECORD_PARTS - 1)).into_par_iter().map(|k| solve(&|b| (b < edge(k / 2 + 1)) == (k % 2 == 0)));
    let (others, sides): (Vec<_>, Vec<_>) = rayon::join(|| others.collect(), || sides.collect());
    let residual_square = |j: usize, uses: &dyn Fn(usize) -> bool, x: &[f64]| squares(&sums[j], uses, x);
    let n = sums.len();
    let mut left_out = vec![0.0; n];
    for (part, x) in others.iter().enumerate() {
        match x {
            Some(x) => (0..n).for_each(|j| left_out[j] += residual_square(j, &within(part), x)),
            None => left_out.fill(f64::NAN),
        }
    }
    let torque = |j: usize| sums[j].torque_square();
    let percent = |j: usize| if torque(j) > 0.0 { 100.0 * (left_out[j] / torque(j)).sqrt() } else { f64::NAN };
    let whole: Vec<f64> = (0..n).map(|j| residual_square(j, &|_| true, &fit.values)).collect();
    let mut best = None::<(f64, Cut)>;
    for (part, sides) in (1..RECORD_PARTS).zip(sides.chunks_exact(2)) {
        let (before, after) = (|b: usize| b < edge(part), |b: usize| b >= edge(part));
        let rows = |j: usize, uses: &dyn Fn(usize) -> bool| some(&sums[j], uses).count();
        let [Some(first), Some(second)] = sides else { continue };
        let share = |j: usize, [before_by, after_by]: [&[f64]; 2]| {
            let moves = rows(j, &before) > 0.0 && rows(j, &after) > 0.0 && whole[j] > 0.0;
            if moves {
                (residual_square(j, &before, before_by) + residual_square(j, &after, after_by)) / whole[j]
            } else {
                f64::NAN
            }
        };
        let cut = Cut {
            at: edge(part) as f64 / count as f64,
            left: (0..n).map(|j| share(j, [first, second])).collect(),
            across: (0..n).map(|j| share(j, [second, first])).collect(),
        };
        let least = cut.left.iter().copied().fold(f64::INFINITY, f64::min);
        if best.as_ref().is_none_or(|(before, _)| least < *before) {
            best = Some((least, cut));
        }
    }
    Parts { left_out: (0..n).map(percent).collect(), cut: best.map(|(_, cut)| cut) }
}

/// The sums over some stretches.
fn some(joint: &JointSums, uses: &dyn Fn(usize) -> bool) -> JointSums {
    let stretches = joint.stretches.iter().enumerate().filter(|(b, _)| uses(*b)).map(|(_, s)| s.clone()).collect();
    JointSums { columns: joint.columns.clone(), stretches }
}

/// ‖τ - D x‖² over some stretches.
fn squares(joint: &JointSums, uses: &dyn Fn(usize) -> bool, x: &[f64]) -> f64 {
    let values: Vec<f64> = joint.columns.iter().map(|c| x[*c]).collect();
    let stretch_square = |s: &Stretch| {
        let bent: f64 = s.dd.chunks_exact(values.len().max(1)).zip(&values).map(|(row, x)| x * dot(row, &values)).sum();
        (s.tt - 2.0 * dot(&s.dt, &values) + bent).max(0.0)
    };
    joint.stretches.iter().enumerate().filter(|(b, _)| uses(*b)).map(|(_, s)| stretch_square(s)).sum()
}
