//! Whether torque has a constant part that the model has no parameter for: a torque signal whose zero is off, a hose.
//!
//! Bodies take up such a part, as far as poses let them, and their deviations say nothing of it. What a column of ones on each
//! joint would find beside the fit's columns follows from the fit's own equations, without solving larger ones:
//!
//! ```text
//! b = (W − CᵀA⁻¹C)⁻¹ r       A = ΣwDᵀD + P⁻¹,  c_j = w_jΣDᵀ,  W_jj = w_jΣ1,  r_j = w_jΣe  over the rows of joint j
//! x' = x − A⁻¹C b
//! ```
//!
//! What a row counts is learnt with the constant taken out: in the residual that bodies leave, a constant is noise of the slowest colour.

use nalgebra::{DMatrix, DVector};

use super::fit::{Fit, Method, Solution, rows_per_independent_row};
use super::record::OfflineError;
use super::rows::Rows;
use super::sums::{Equations, Normal};

/// Of what ones alone would tell of a constant, what is left beside the model's columns where rounding or the prior is all that is.
const MIN_INFORMATION_SHARE: f64 = 1e-6;

/// A constant torque of one joint that is not in the model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Constant {
    /// \[N m\].
    pub torque: f64,
    /// Standard deviation, colour of the residuals included \[N m\].
    pub std: f64,
}

/// Rounds of weighing rows by what is left beside the constants of the round before.
const REWEIGHTING_ROUNDS: usize = 3;

/// Constant torque per joint beside the columns of the rows, all joints at once; none of a joint that never moves or whose
/// constant is the same to the rows as what the model has.
///
/// * `nominal`, `prior`: as for [`fit`](super::fit())
/// * `fit`: tells what rows beside a stop count
///
/// # Errors
/// When least squares have no solution.
pub fn constant_torque(
    equations: &Equations<'_>,
    nominal: &[f64],
    prior: f64,
    fit: &Fit,
) -> Result<Vec<Option<Constant>>, OfflineError> {
    let k = nominal.len();
    let sums = equations.trusting(&fit.trust);
    let joints: Vec<Normal> = sums.iter().map(|joint| Normal::new(joint, k, Method::LeastSquares)).collect();
    let ones: Vec<Ones> = (0..joints.len()).map(|j| Ones::new(equations, j, k, fit.trust[j])).collect();
    let x0 = DVector::from_column_slice(nominal);
    // The fit's own noise has the constant in it, and its colour.
    let mut weights: Vec<f64> = fit.noise.iter().map(|s| if s.is_nan() { 0.0 } else { 1.0 / (s * s) }).collect();
    let mut found = vec![None; joints.len()];
    for _ in 0..REWEIGHTING_ROUNDS {
        let solution = Solution::new(&joints, &weights, &x0, (prior, equations.most()), Method::LeastSquares)?;
        let Some(Beside { constants, x }) = fit_constants(&ones, &weights, &solution) else {
            return Ok(vec![None; joints.len()]);
        };
        for j in (0..joints.len()).filter(|j| joints[*j].count > 0.0) {
            let constant = constants[j].map_or(0.0, |c| c.torque);
            let without_constant = |(rows, residuals): (&Rows, Vec<f64>)| -> Vec<f64> {
                let rows = &rows.joints[j];
                let less = |(row, e): (usize, f64)| e - constant * rows.weight(row, fit.trust[j]).sqrt();
                residuals.into_iter().enumerate().map(less).collect()
            };
            let residuals: Vec<Vec<f64>> = equations
                .rows
                .iter()
                .zip(equations.weighed_residuals(j, &x, fit.trust[j]))
                .map(without_constant)
                .collect();
            let square: f64 = residuals.iter().flatten().map(|e| e * e).sum();
            let variance = (square / joints[j].count).max(f64::MIN_POSITIVE);
            weights[j] = 1.0 / (variance * rows_per_independent_row(&residuals));
        }
        found = constants;
    }
    Ok(found)
}

/// Sums of a joint's rows with a column of ones, rows weighed by trust.
struct Ones {
    /// ΣDᵀ over all columns.
    d: DVector<f64>,
    /// Σ1
    count: f64,
    /// Στ
    tau: f64,
}

impl Ones {
    fn new(equations: &Equations<'_>, j: usize, k: usize, trust: f64) -> Ones {
        let mut sums = Ones { d: DVector::zeros(k), count: 0.0, tau: 0.0 };
        for rows in equations.rows.iter().map(|record| &record.joints[j]) {
            let width = rows.columns.len().max(1);
            for (row, tau) in rows.tau.iter().enumerate() {
                let weight = rows.weight(row, trust);
                sums.count += weight;
                sums.tau += weight * tau;
                let entries = rows.d[row * width..].iter().zip(&rows.columns);
                entries.for_each(|(d, c)| sums.d[*c] += weight * d);
            }
        }
        sums
    }
}

/// Constants beside a solution, and what its values become with them.
struct Beside {
    constants: Vec<Option<Constant>>,
    x: Vec<f64>,
}

/// None where rounding leaves no solution.
fn fit_constants(ones: &[Ones], weights: &[f64], solution: &Solution) -> Option<Beside> {
    let (n, k) = (ones.len(), solution.x.len());
    let cross = DMatrix::from_fn(k, n, |i, j| weights[j] * solution.scale[i] * ones[j].d[i]);
    let solo_information = DVector::from_fn(n, |j, _| weights[j] * ones[j].count);
    let mut score = DVector::from_fn(n, |j, _| weights[j] * (ones[j].tau - ones[j].d.dot(&solution.x)));
    let taken = &solution.inverse * &cross;
    let mut information = DMatrix::from_diagonal(&solo_information) - cross.transpose() * &taken;
    let is_identifiable: Vec<bool> =
        (0..n).map(|j| information[(j, j)] > MIN_INFORMATION_SHARE * solo_information[j]).collect();
    for j in (0..n).filter(|j| !is_identifiable[*j]) {
        information.row_mut(j).fill(0.0);
        information.column_mut(j).fill(0.0);
        information[(j, j)] = 1.0;
        score[j] = 0.0;
    }
    let covariance = information.cholesky()?.inverse();
    let torque = &covariance * score;
    let constant =
        |j: usize| is_identifiable[j].then(|| Constant { torque: torque[j], std: covariance[(j, j)].sqrt() });
    let x = &solution.x - (taken * &torque).component_mul(&solution.scale);
    Some(Beside { constants: (0..n).map(constant).collect(), x: x.as_slice().to_vec() })
}

#[cfg(test)]
mod tests {
    use super::super::fit;
    use super::super::rows::JointRows;
    use super::*;
    use crate::linear::tests::Random;
    use crate::offline::bias::tests::rows as two_joints;

    /// The second joint's torque is off by 0.7 N m; a column of the first joint's is nearly constant.
    fn found(seed: u64, off: f64) -> Vec<Option<Constant>> {
        let (mut rows, x) = two_joints(0.0, &mut Random(seed));
        let JointRows { d, z, .. } = &mut rows[0].joints[0];
        d.iter_mut().zip(z).skip(2).step_by(5).for_each(|(d, z)| (*d, *z) = (1.0 + 0.1 * *d, 1.0 + 0.1 * *d));
        let rows: Vec<Rows> = rows
            .into_iter()
            .map(|mut record| {
                for (j, off) in [0.0, off].into_iter().enumerate() {
                    let exact: Vec<f64> = record.joints[j]
                        .d
                        .chunks_exact(5)
                        .map(|d| d.iter().zip(&x).map(|(d, x)| d * x).sum())
                        .collect();
                    let mut random = Random(seed + 77 + j as u64);
                    record.joints[j].tau = exact.iter().map(|tau| tau + off + 0.3 * random.normal()).collect();
                }
                record
            })
            .collect();
        let equations = Equations::new(&rows);
        let fit = fit(&equations, &x, 10.0, Method::LeastSquares).expect("solved");
        constant_torque(&equations, &x, 10.0, &fit).expect("told")
    }

    #[test]
    fn a_constant_is_told_with_its_deviation_and_without_one_there_is_none() {
        let count = 200;
        let (mut within, mut none) = (0, 0);
        for seed in 0..count {
            let [first, second] = found(seed, 0.7)[..] else { panic!("two joints") };
            let (first, second) = (first.expect("told"), second.expect("told"));
            within += usize::from((second.torque - 0.7).abs() < 2.0 * second.std);
            none += usize::from(first.torque.abs() < 2.0 * first.std);
            assert!(second.torque > 5.0 * second.std && first.std > second.std, "{first:?} {second:?}");
        }
        println!("{within} and {none} of {count} within two deviations");
        let least = (0.9 * count as f64) as usize;
        assert!(within >= least && none >= least, "{within} {none}");
    }

    /// A column of ones is the constant itself.
    #[test]
    fn what_the_model_has_is_not_told_again() {
        let (mut rows, x) = two_joints(0.0, &mut Random(3));
        rows[0].joints[1].d.iter_mut().skip(4).step_by(5).for_each(|d| *d = 1.0);
        rows[0].joints[0].d.iter_mut().skip(4).step_by(5).for_each(|d| *d = 0.0);
        let equations = Equations::new(&rows);
        let fit = fit(&equations, &x, 1e6, Method::LeastSquares).expect("solved");
        let constants = constant_torque(&equations, &x, 1e6, &fit).expect("told");
        assert!(constants[0].is_some() && constants[1].is_none(), "{constants:?}");
    }
}
