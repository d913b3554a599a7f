//! Weighted least squares and instrumental variables over the rows of all records.

use nalgebra::{DMatrix, DVector};

use super::covariance::{Whole, long_run};
use super::prior::Prior;
use super::record::OfflineError;
use super::rows::Rows;
use super::sums::{Equations, JointSums, Normal};
use crate::linear::dot;

/// Rounds of weighting by the residual of the fit before.
const ROUNDS: usize = 4;
/// By how much weaker the prior is while the noise is looked for.
const NOISE_PRIOR: f64 = 100.0;
/// Independent rows that the noise of all joints counts for in that of one.
const NOISE_ROWS: f64 = 4.0;
/// Added to the instruments' own products, in parts of the largest: rounding must leave them positive.
const ROUNDING: f64 = 1e-13;
/// Directions of the data below this share of the strongest are rounding, not information.
const RANK_TOLERANCE: f64 = 1e-7;

/// Which equations are solved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Regressor on both sides: biased by noise in the regressor.
    LeastSquares,
    /// Instruments on the left.
    Instrumental,
}

/// What decided a parameter's value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Determined {
    /// The data: its standard deviation is less than half of the prior's.
    ByData,
    /// Mostly the prior around the nominal value.
    ByPrior,
}

/// Identified base parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit {
    /// Values in base order, each in its unit.
    pub values: Vec<f64>,
    /// Standard deviations, by leaving out one stretch of the records after the other: residuals are coloured.
    pub std: Vec<f64>,
    /// Covariance of the values, row-major K×K; the squares of `std` are its diagonal.
    pub covariance: Vec<f64>,
    /// What decided each value.
    pub determined: Vec<Determined>,
    /// Standard deviation of the residual per joint \[N m\].
    pub noise: Vec<f64>,
    /// Rows that make one independent row, per joint: 1 for a white residual.
    pub correlation: Vec<f64>,
    /// Directions of the parameter space that the data sees at all.
    pub rank: usize,
    /// Condition of the weighted regressor with columns scaled to one, over those directions.
    pub condition: f64,
}

/// Fits base parameters to the rows of several records.
///
/// # Errors
/// When shapes differ, a joint stands still, or the equations have no solution.
pub fn fit(equations: &Equations<'_>, prior: &Prior, method: Method) -> Result<Fit, OfflineError> {
    let k = prior.centre.len();
    let Weighed { solution, noise } = weigh(equations, prior, method)?;
    let found = solution.long_run_covariance(&equations.joints, &noise.weights(), method);
    let (std, determined) = solution.certainty(&found);
    let covariance = (0..k * k).map(|at| found[(at / k, at % k)]).collect();
    let (rank, condition) = solution.conditioning();
    let values = solution.x.as_slice().to_vec();
    let Noise { std: noise, correlation } = noise;
    Ok(Fit { values, std, covariance, determined, noise, correlation, rank, condition })
}

/// The values of [`fit`] alone, for a part of the work.
///
/// # Errors
/// As for [`fit`].
pub fn solve(equations: &Equations<'_>, prior: &Prior, method: Method) -> Result<Vec<f64>, OfflineError> {
    Ok(weigh(equations, prior, method)?.solution.x.as_slice().to_vec())
}

pub(super) fn normals(equations: &Equations<'_>, columns: usize, method: Method) -> Vec<Normal> {
    equations.joints.iter().map(|joint| Normal::new(joint, columns, method)).collect()
}

/// How noisy the rows of each joint are, as residuals tell where the data alone decide (almost: under a prior that is
/// [`NOISE_PRIOR`] weaker). With the prior that counts, a fit that it pulls away from the data had large and slow residuals, so
/// that the next one believed the data less, until only the prior was left. Instruments leave larger residuals
/// where they are weak; the rows are as noisy as least squares says.
pub(super) struct Noise {
    std: Vec<f64>,
    correlation: Vec<f64>,
}

impl Noise {
    pub(super) fn new(equations: &Equations<'_>, prior: &Prior) -> Result<Noise, OfflineError> {
        let (k, rows) = (prior.centre.len(), equations.rows);
        let n = rows.first().map_or(0, |r| r.joints.len());
        if let Some(wrong) = rows.iter().find(|r| r.columns != k) {
            return Err(OfflineError::Shape { what: "columns", found: wrong.columns, expected: k });
        }
        if let Some(joint) = (0..n).find(|j| rows.iter().all(|r| r.count(*j) == 0)) {
            return Err(OfflineError::JointStill { joint });
        }
        let method = Method::LeastSquares;
        let joints = normals(equations, prior.centre.len(), method);
        let weaker = prior.times(NOISE_PRIOR);
        let square: Vec<f64> = joints.iter().map(|j| (j.torque_square / j.count).max(f64::MIN_POSITIVE)).collect();
        let mut noise = Noise { std: square.iter().map(|s| s.sqrt()).collect(), correlation: vec![1.0; n] };
        for _ in 0..ROUNDS {
            let weights = noise.weights();
            let solution = Solution::new(&joints, &weights, &weaker, method)?;
            let covariance = &solution.root * &solution.inverse * solution.root.transpose();
            let (mut left, mut free) = (vec![0.0; n], vec![0.0; n]);
            for j in 0..n {
                let residuals = equations.residuals(j, solution.x.as_slice());
                left[j] = residuals.iter().flatten().map(|e| e * e).sum();
                // Parameters that these rows decide: so many independent rows say nothing of the noise.
                let taken = noise.correlation[j] * weights[j] * joints[j].dd.component_mul(&covariance).sum();
                free[j] = (joints[j].count - taken).max(0.0);
                noise.correlation[j] = rows_per_independent_row(&residuals);
            }
            let usual = (0..n).map(|j| left[j] / square[j]).sum::<f64>() / free.iter().sum::<f64>().max(1.0);
            for j in 0..n {
                // Few rows of a joint can be fitted exactly, which does not make them exact.
                let known = NOISE_ROWS * noise.correlation[j];
                let variance = (left[j] + known * usual * square[j]) / (free[j] + known);
                // A perfect fit (noise-free data) must not make a weight infinite.
                noise.std[j] = variance.sqrt().max(1e-12 * square[j].sqrt()).max(f64::MIN_POSITIVE);
            }
        }
        Ok(noise)
    }

    pub(super) fn weights(&self) -> Vec<f64> {
        self.std.iter().zip(&self.correlation).map(|(s, c)| 1.0 / (s * s * c)).collect()
    }
}

/// A solution, and how noisy the rows are.
struct Weighed {
    solution: Solution,
    noise: Noise,
}

fn weigh(equations: &Equations<'_>, prior: &Prior, method: Method) -> Result<Weighed, OfflineError> {
    let noise = Noise::new(equations, prior)?;
    let solution = Solution::new(&normals(equations, prior.centre.len(), method), &noise.weights(), prior, method)?;
    Ok(Weighed { solution, noise })
}

/// Residual of parameters `x` over all rows, per joint: `100 ‖τ - D x‖ / ‖τ‖` \[%\].
pub fn residual_percent(rows: &[Rows], x: &[f64]) -> Vec<f64> {
    let percent = |[error, torque]: [f64; 2]| 100.0 * (error / torque.max(f64::MIN_POSITIVE)).sqrt();
    residual_squares(rows, x).into_iter().map(percent).collect()
}

/// `[‖τ - D x‖², ‖τ‖²]` over all rows, per joint.
pub fn residual_squares(rows: &[Rows], x: &[f64]) -> Vec<[f64; 2]> {
    let n = rows.first().map_or(0, |r| r.joints.len());
    let of = |j: usize| {
        let error: f64 = rows.iter().flat_map(|r| r.joints[j].residual(x)).map(|e| e * e).sum();
        [error, rows.iter().flat_map(|r| &r.joints[j].tau).map(|t| t * t).sum()]
    };
    (0..n).map(of).collect()
}

/// What an error of each parameter of the size `size` does to torque: its rms over these rows, as a share of the rms
/// torque, at the joint where that is largest \[%\].
pub fn torque_percent(rows: &[Rows], size: &[f64]) -> Vec<f64> {
    let mut percent = vec![0.0_f64; size.len()];
    for j in 0..rows.first().map_or(0, |r| r.joints.len()) {
        let (mut squares, mut torque) = (vec![0.0; size.len()], 0.0);
        for rows in rows.iter().map(|r| &r.joints[j]) {
            torque += dot(&rows.tau, &rows.tau);
            for row in rows.d.chunks_exact(rows.columns.len().max(1)) {
                rows.columns.iter().zip(row).for_each(|(c, d)| squares[*c] += d * d);
            }
        }
        for ((percent, size), square) in percent.iter_mut().zip(size).zip(squares) {
            *percent = percent.max(100.0 * size.abs() * (square / torque.max(f64::MIN_POSITIVE)).sqrt());
        }
    }
    percent
}

/// `1 + 2 Σ ρ_k` of the residuals, summed while the autocorrelation ρ_k is positive; records are not joined.
fn rows_per_independent_row(records: &[Vec<f64>]) -> f64 {
    let product = |lag: usize| -> f64 {
        records.iter().map(|e| e.iter().zip(e.iter().skip(lag)).map(|(a, b)| a * b).sum::<f64>()).sum()
    };
    let power = product(0);
    if power <= 0.0 {
        return 1.0;
    }
    let longest = records.iter().map(Vec::len).max().unwrap_or(0) / 4;
    let correlated = (1..longest).map(|lag| product(lag) / power).take_while(|rho| *rho > 0.05);
    1.0 + 2.0 * correlated.sum::<f64>()
}

/// The solved equations, in coordinates in which the prior is standard normal: x = x₀ + L·s with P = L·Lᵀ.
///
/// ```text
/// A = HᵀΣw ZᵀD·L + 1,   s = A⁻¹·HᵀΣw Zᵀ(τ − D·x₀)
/// LS:  H = L     IV:  H = L·(LᵀΣw ZᵀZ·L)⁻¹·LᵀΣw ZᵀD·L       two-stage least squares
/// ```
///
/// Without a prior H changes nothing: as many instruments as parameters. With one, A without H need not be positive
/// where instruments are weak (delayed by more than a motion's phase they turn against the regressor), and A with a
/// negative eigenvalue near −1 has no inverse. The part of the regressor that the instruments explain is information.
///
/// What the data say in a direction is so measured against what was known before: rounding in what they hardly say
/// (eigenvalues far below 1) drowns in the 1, however badly conditioned the motion is.
pub(super) struct Solution {
    pub(super) x: DVector<f64>,
    /// L.
    pub(super) root: DMatrix<f64>,
    /// H: what the equations are multiplied by, from the left, after Z. L with least squares.
    hand: DMatrix<f64>,
    pub(super) s: DVector<f64>,
    /// Σ w DᵀD.
    information: DMatrix<f64>,
    /// A and its inverse.
    left: DMatrix<f64>,
    inverse: DMatrix<f64>,
    /// Σ w HᵀZᵀZ·H.
    spread: DMatrix<f64>,
}

impl Solution {
    pub(super) fn new(
        joints: &[Normal],
        weights: &[f64],
        prior: &Prior,
        method: Method,
    ) -> Result<Solution, OfflineError> {
        let k = prior.centre.len();
        let x0 = DVector::from_column_slice(&prior.centre);
        let mut dd = DMatrix::zeros(k, k);
        let (mut zd, mut zz, mut zt) = (dd.clone(), dd.clone(), DVector::zeros(k));
        let mut count = 0.0;
        for (joint, w) in joints.iter().zip(weights) {
            dd += &joint.dd * *w;
            zd += &joint.zd * *w;
            zz += &joint.zz * *w;
            zt += &joint.zt * *w;
            count += joint.count;
        }
        let name = if method == Method::LeastSquares { "least-squares" } else { "instrumental-variable" };
        let singular = OfflineError::Singular { method: name };
        let root = prior.root(joints).ok_or_else(|| singular.clone())?;
        let hand = match method {
            Method::LeastSquares => root.clone(),
            Method::Instrumental => projected(&root, &zz, &zd).ok_or_else(|| singular.clone())?,
        };
        let mut left = hand.tr_mul(&(&zd * &root));
        left = (&left + left.transpose()) * 0.5;
        for i in 0..k {
            left[(i, i)] += 1.0;
        }
        let right = hand.tr_mul(&(zt - &zd * &x0));
        let inverse = inverse(&mut left).ok_or_else(|| singular.clone())?;
        // One step of refinement: the inverse of a badly conditioned matrix is exact in its large directions only.
        let mut s = &inverse * &right;
        s += &inverse * (&right - &left * &s);
        let x = x0 + &root * &s;
        if count == 0.0 || x.iter().any(|x| !x.is_finite()) {
            return Err(singular);
        }
        let spread = hand.tr_mul(&(zz * &hand));
        Ok(Solution { x, root, hand, s, information: dd, left, inverse, spread })
    }

    /// Covariance of s.
    ///
    /// Least squares: A⁻¹. Instruments: A⁻¹ (HᵀΣw ZᵀZ·H + 1) A⁻ᵀ.
    pub(super) fn covariance(&self, method: Method) -> DMatrix<f64> {
        // As B·Bᵀ: rounding in what the data hardly see then leaves every variance positive.
        let squared = |b: DMatrix<f64>| &b * b.transpose();
        if method == Method::LeastSquares {
            let eigen = self.left.clone().symmetric_eigen();
            let least = f64::EPSILON * eigen.eigenvalues.len() as f64 * eigen.eigenvalues.max();
            let std = eigen.eigenvalues.map(|value| 1.0 / value.max(least).sqrt());
            return squared(eigen.eigenvectors * DMatrix::from_diagonal(&std));
        }
        let mut middle = self.spread.clone();
        for i in 0..self.x.len() {
            middle[(i, i)] += 1.0;
        }
        let eigen = middle.symmetric_eigen();
        let root = eigen.eigenvalues.map(|value| value.max(0.0).sqrt());
        squared(&self.inverse * eigen.eigenvectors * DMatrix::from_diagonal(&root))
    }

    /// Covariance of x, with what the colour of the residuals makes of it.
    pub(super) fn long_run_covariance(&self, joints: &[JointSums], weights: &[f64], method: Method) -> DMatrix<f64> {
        let Solution { x, root, hand, left, inverse, .. } = self;
        long_run(joints, weights, &Whole { left, inverse, root, hand, x }, self.covariance(method), method)
    }

    /// Standard deviations and what decided each value, from the covariance of x.
    pub(super) fn certainty(&self, covariance: &DMatrix<f64>) -> (Vec<f64>, Vec<Determined>) {
        let k = self.x.len();
        let std = |i: usize| covariance[(i, i)].max(0.0).sqrt();
        let determined =
            |i: usize| if std(i) < 0.5 * self.root.row(i).norm() { Determined::ByData } else { Determined::ByPrior };
        ((0..k).map(std).collect(), (0..k).map(determined).collect())
    }

    /// Directions the data sees, and the condition over them, columns scaled to one.
    fn conditioning(&self) -> (usize, f64) {
        let k = self.x.len();
        let size = DVector::from_fn(k, |i, _| self.information[(i, i)].sqrt());
        // A column the data never touches keeps a scale of its own: the prior alone acts on it.
        let strongest = size.max().max(f64::MIN_POSITIVE);
        let scale = size.map(|s| 1.0 / if s > 1e-12 * strongest { s } else { strongest });
        let eigen =
            DMatrix::from_fn(k, k, |i, j| self.information[(i, j)] * scale[i] * scale[j]).symmetric_eigenvalues();
        let largest = eigen.max().max(f64::MIN_POSITIVE);
        let seen = eigen.iter().filter(|value| **value > largest * RANK_TOLERANCE * RANK_TOLERANCE);
        let (rank, smallest) = seen.fold((0, largest), |(count, least), value| (count + 1, least.min(*value)));
        (rank, (largest / smallest).sqrt())
    }
}

/// H of instruments.
fn projected(root: &DMatrix<f64>, zz: &DMatrix<f64>, zd: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let mut spread = root.tr_mul(&(zz * root));
    let least = ROUNDING * spread.diagonal().max() + f64::MIN_POSITIVE;
    for i in 0..spread.nrows() {
        spread[(i, i)] += least;
    }
    let right = root.tr_mul(&(zd * root));
    if let Some(factors) = spread.clone().cholesky() {
        return Some(root * factors.solve(&right));
    }
    if spread.iter().any(|x| !x.is_finite()) {
        return None;
    }
    // Rounding left a direction negative: it counts as what was added.
    let eigen = ((&spread + spread.transpose()) * 0.5).symmetric_eigen();
    let inverse = eigen.eigenvalues.map(|v| 1.0 / v.max(least));
    let solved = &eigen.eigenvectors * DMatrix::from_diagonal(&inverse) * eigen.eigenvectors.tr_mul(&right);
    Some(root * solved)
}

/// Inverse of a symmetric matrix that is at least 1 in every direction; where rounding has made it less, it is set right. The
/// inverse is R·Rᵀ, so no variance can come out negative.
fn inverse(left: &mut DMatrix<f64>) -> Option<DMatrix<f64>> {
    if let Some(factors) = left.clone().cholesky() {
        let root = factors.l().try_inverse()?;
        return Some(root.tr_mul(&root));
    }
    if left.iter().any(|x| !x.is_finite()) {
        return None;
    }
    let eigen = ((&*left + left.transpose()) * 0.5).symmetric_eigen();
    let values = eigen.eigenvalues.map(|v| v.max(1.0));
    let with =
        |values: DVector<f64>| &eigen.eigenvectors * DMatrix::from_diagonal(&values) * eigen.eigenvectors.transpose();
    *left = with(values.clone());
    Some(with(values.map(|v| 1.0 / v)))
}
