//! Weighted least squares and instrumental variables over the rows of all records.

use nalgebra::{DMatrix, DVector};

use super::covariance::{Whole, long_run};
use super::record::OfflineError;
use super::rows::{Range, Rows};
use super::sums::{Equations, JointSums, Normal};
use super::trust;
use super::undetermined::Undetermined;
use crate::linear::dot;

/// Rounds of weighting by the residual of the fit before, as if it were white, from the torque as a residual on.
///
/// What the prior keeps from its value leaves a slow residual, which for its colour counts for little, so the prior keeps it: a
/// second solution of the same equations, far from any that the data would choose. So the data choose first.
const WHITE_ROUNDS: usize = 2;
/// Rounds with the colour of that residual.
const COLOURED_ROUNDS: usize = 4;
/// A parameter whose nominal value is small or zero counts as large as the value that alone makes this share of the
/// torque of some joint.
const MIN_PRIOR_JOINT_SHARE: f64 = 0.005;
/// The same of a value of exactly 0 that one joint alone has, its drive's: one that nobody gave, as friction of a file that has none.
/// (A body's zeros are symmetries, and on ten seconds of an arm that has them they are needed.)
const ZERO_TORQUE_SHARE: f64 = 0.05;
/// Directions of the data below this share of the strongest are rounding, not information.
const RANK_TOLERANCE: f64 = 1e-7;

/// A column of less than this share of the largest is rounding of nothing.
const COLUMN_ROUNDING: f64 = 1e-12;

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
    /// It is held at what it can be at most or least ([`Fit::hold`]).
    ByBound,
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
    /// Standard deviation of the residual per joint, rows beside a stop weighed by `trust` \[N m\]; NaN of a joint that never
    /// moves.
    pub noise: Vec<f64>,
    /// Rows that make one independent row, per joint: 1 for a white residual.
    pub correlation: Vec<f64>,
    /// Share of the rows that are beside a stop, per joint: the filter mixes standstill into them.
    pub beside: Vec<f64>,
    /// What such a row counts, per joint, others counting 1: variance of the residual of the others over that of these.
    pub trust: Vec<f64>,
    /// Directions of the parameter space that the data sees at all.
    pub rank: usize,
    /// Condition of the weighted regressor with columns scaled to one, over those directions.
    pub condition: f64,
    /// Directions of the parameter space that the rows do not determine, so that they keep the nominal values: the share that each base
    /// parameter, in units of its prior's deviation, has in the unit vector.
    pub undetermined: Vec<Vec<f64>>,
}

impl Fit {
    /// Adds errors that residuals do not show to the covariance: the mean of the outer products of `moved`, each how far the values
    /// (base order) moved in one try. What decided a value stays as it was.
    pub fn add_errors(&mut self, moved: &[Vec<f64>]) {
        let k = self.values.len();
        for (at, covariance) in self.covariance.iter_mut().enumerate() {
            let product: f64 = moved.iter().map(|by| by[at / k] * by[at % k]).sum();
            *covariance += product / moved.len().max(1) as f64;
        }
        if !moved.is_empty() {
            self.std = (0..k).map(|i| self.covariance[i * k + i].sqrt()).collect();
        }
    }

    /// Of a joint's rows: one over the variance of what one independent row leaves.
    pub(super) fn weights(&self) -> Vec<f64> {
        weights(&self.noise, &self.correlation)
    }
}

/// A joint without rows, whose noise is not known, weighs nothing.
fn weights(noise: &[f64], correlation: &[f64]) -> Vec<f64> {
    noise.iter().zip(correlation).map(|(s, c)| if s.is_nan() { 0.0 } else { 1.0 / (s * s * c) }).collect()
}

/// Fits base parameters to the rows of several records. What only a joint without rows has stays with the prior.
///
/// * `equations`: the rows
/// * `nominal`: base parameters before, x₀
/// * `prior`: standard deviation of x₀ as a multiple of each value (or, for a value near zero, of the value that alone
///   would make 0.5 % of the torque of some joint; for exactly 0 of a drive, 5 %)
pub fn fit(equations: &Equations<'_>, nominal: &[f64], prior: f64, method: Method) -> Result<Fit, OfflineError> {
    let k = nominal.len();
    let Weighed { solution, weights, noise, correlation, trust } = weigh(equations, nominal, prior, method)?;
    let scaled = solution.long_run_covariance(&equations.trusting(&trust), &weights, method);
    let (std, determined) = solution.certainty(&scaled);
    let scale = &solution.scale;
    let covariance = (0..k * k).map(|at| scaled[(at / k, at % k)] * scale[at / k] * scale[at % k]).collect();
    let (rank, condition) = solution.conditioning();
    let values = solution.x.as_slice().to_vec();
    let share_beside_stops = (0..noise.len()).map(|j| equations.share_beside(j)).collect();
    let undetermined = solution.held.as_ref().map_or_else(Vec::new, Undetermined::directions);
    Ok(Fit {
        values,
        std,
        covariance,
        determined,
        noise,
        correlation,
        beside: share_beside_stops,
        trust,
        rank,
        condition,
        undetermined,
    })
}

/// The values of [`fit`] alone, for a part of the work.
///
/// # Errors
/// As for [`fit`].
pub fn solve(equations: &Equations<'_>, nominal: &[f64], prior: f64, method: Method) -> Result<Vec<f64>, OfflineError> {
    Ok(weigh(equations, nominal, prior, method)?.solution.x.as_slice().to_vec())
}

/// A solution, and what its own residuals say of the rows.
struct Weighed {
    solution: Solution,
    /// What a row of each joint counts in the solution: by the residuals of the round before it.
    weights: Vec<f64>,
    noise: Vec<f64>,
    correlation: Vec<f64>,
    trust: Vec<f64>,
}

fn weigh(equations: &Equations<'_>, nominal: &[f64], prior: f64, method: Method) -> Result<Weighed, OfflineError> {
    let (k, rows) = (nominal.len(), equations.rows);
    let n = rows.first().map_or(0, |r| r.joints.len());
    if let Some(wrong) = rows.iter().find(|r| r.columns != k) {
        return Err(OfflineError::Shape { what: "columns", found: wrong.columns, expected: k });
    }
    let moves: Vec<bool> = equations.joints.iter().map(|joint| joint.count() > 0.0).collect();
    if !moves.contains(&true) {
        return Err(OfflineError::AllStill);
    }
    if let Some(joint) = (0..n).find(|j| moves[*j] && equations.joints[*j].torque_square() == 0.0) {
        return Err(OfflineError::NoTorque { joint });
    }
    let x0 = DVector::from_column_slice(nominal);
    let level = |j: usize| (equations.joints[j].torque_square() / equations.joints[j].count()).sqrt();
    let mut noise: Vec<f64> =
        (0..n).map(|j| if moves[j] { level(j).max(f64::MIN_POSITIVE) } else { f64::NAN }).collect();
    let mut correlation = vec![1.0; n];
    let mut turn = |trust: Vec<f64>, white: usize| -> Result<Weighed, OfflineError> {
        let sums = equations.trusting(&trust);
        let joints: Vec<Normal> = sums.iter().map(|joint| Normal::new(joint, k, method)).collect();
        let mut round = |coloured: bool| {
            let weights = weights(&noise, &correlation);
            let solution = Solution::new(&joints, &weights, &x0, (prior, equations.most()), method)?;
            for j in (0..n).filter(|j| moves[*j]) {
                let residuals = equations.weighed_residuals(j, solution.x.as_slice(), trust[j]);
                let square: f64 = residuals.iter().flatten().map(|e| e * e).sum();
                // A perfect fit (noise-free data) must not make a weight infinite.
                noise[j] = (square / joints[j].count).sqrt().max(1e-12 * level(j)).max(f64::MIN_POSITIVE);
                correlation[j] = if coloured { rows_per_independent_row(&residuals) } else { 1.0 };
            }
            Ok((solution, weights))
        };
        for _ in 0..white {
            round(false)?;
        }
        let mut solved = round(true)?;
        for _ in 1..COLOURED_ROUNDS {
            solved = round(true)?;
        }
        let (solution, weights) = solved;
        Ok(Weighed { solution, weights, noise: noise.clone(), correlation: correlation.clone(), trust })
    };
    // All rows alike first: what that leaves of those beside a stop says what they count in the fit that stays.
    let alike = turn(vec![1.0; n], WHITE_ROUNDS)?;
    let stop_trust = |j: usize| {
        if !moves[j] {
            return 1.0;
        }
        let residuals = equations.weighed_residuals(j, alike.solution.x.as_slice(), 1.0);
        trust::trust(rows.iter().map(|r| &r.joints[j]), &residuals, alike.correlation[j])
    };
    let trust: Vec<f64> = (0..n).map(stop_trust).collect();
    let found = if trust.iter().all(|trust| *trust == 1.0) { alike } else { turn(trust, 0)? };
    Ok(Weighed { solution: found.solution.hold(&x0), ..found })
}

/// Residual of parameters `x` over all rows, per joint: `100 ‖τ - D x‖ / ‖τ‖` \[%\].
pub fn residual_percent(rows: &[Rows], x: &[f64]) -> Vec<f64> {
    let percent = |[error, torque]: [f64; 2]| 100.0 * (error / torque.max(f64::MIN_POSITIVE)).sqrt();
    residual_squares(rows, x).into_iter().map(percent).collect()
}

/// `[‖τ - D x‖², ‖τ‖²]` over all rows, per joint.
pub fn residual_squares(rows: &[Rows], x: &[f64]) -> Vec<[f64; 2]> {
    let n = rows.first().map_or(0, |r| r.joints.len());
    let squares_of_joint = |j: usize| {
        let error: f64 = rows.iter().flat_map(|r| r.joints[j].residual(x)).map(|e| e * e).sum();
        [error, rows.iter().flat_map(|r| &r.joints[j].tau).map(|t| t * t).sum()]
    };
    (0..n).map(squares_of_joint).collect()
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
pub(super) fn rows_per_independent_row(records: &[Vec<f64>]) -> f64 {
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

/// The solved equations, columns scaled to one: `scale` times a scaled value is the value.
///
/// Instruments are led to the regressor by what the rows say they have to do with it, G = ΣwDᵀZ·(ΣwZᵀZ)⁻¹ (two-stage least
/// squares). G·ΣwZᵀD is the information that the instruments leave: it is never negative and vanishes where they tell nothing,
/// so there the prior decides, as it does in least squares. Beside ΣwZᵀD, which has any sign, the prior may as well cancel.
/// Without a prior both have one solution.
pub(super) struct Solution {
    pub(super) x: DVector<f64>,
    pub(super) scale: DVector<f64>,
    /// Σ w DᵀD, scaled, without the prior.
    information: DMatrix<f64>,
    /// G·ΣwZᵀD + P⁻¹, scaled, and its inverse; with least squares ΣwDᵀD + P⁻¹.
    left: DMatrix<f64>,
    pub(super) inverse: DMatrix<f64>,
    /// G, scaled; none with least squares.
    lead: Option<DMatrix<f64>>,
    /// Diagonal of P⁻¹, scaled.
    pub(super) prior: DVector<f64>,
    /// Directions that keep the prior mean ([`Solution::hold`]).
    held: Option<Undetermined>,
}

impl Solution {
    pub(super) fn new(
        joints: &[Normal],
        weights: &[f64],
        x0: &DVector<f64>,
        (prior, most): (f64, &[Range]),
        method: Method,
    ) -> Result<Solution, OfflineError> {
        let k = x0.len();
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
        let size = DVector::from_fn(k, |i, _| dd[(i, i)].sqrt());
        let strongest = size.max().max(f64::MIN_POSITIVE);
        let touched = |i: usize| size[i] > COLUMN_ROUNDING * strongest;
        let of_one = |i: usize| joints.iter().filter(|joint| joint.dd[(i, i)] > 0.0).count() == 1;
        let width = DVector::from_fn(k, |i, _| {
            let alone = |joint: &Normal| (joint.torque_square / joint.dd[(i, i)]).sqrt();
            let least = joints.iter().map(alone).filter(|v| v.is_finite()).fold(f64::INFINITY, f64::min);
            let share = match touched(i) {
                true if least.is_finite() && x0[i] == 0.0 && of_one(i) => ZERO_TORQUE_SHARE * least,
                true if least.is_finite() => MIN_PRIOR_JOINT_SHARE * least,
                // A value of 0 that no row has anything to do with: one unit is as good as another.
                false if x0[i] == 0.0 => 1.0,
                _ => 0.0,
            };
            let known = most.get(i).copied().unwrap_or(Range { most: f64::INFINITY, unknown: 0.0 });
            let width = prior * x0[i].abs().max(share).max(known.unknown).max(f64::MIN_POSITIVE);
            // A column that is all but nothing would have a value as large as it takes.
            width.min(known.most.max(x0[i].abs()))
        });
        // A column the data never touches has the prior's scale: that alone acts on it, and beside the data's it would be rounding.
        let scale = DVector::from_fn(k, |i, _| if touched(i) { 1.0 / size[i] } else { width[i] });
        let scaled = |m: &DMatrix<f64>| DMatrix::from_fn(k, k, |i, j| m[(i, j)] * scale[i] * scale[j]);
        let prior_information = width.zip_map(&scale, |width, scale| (scale / width).powi(2));
        let offset = prior_information.component_mul(&x0.component_div(&scale));
        let (mut left, mut right) = (scaled(&zd), zt.component_mul(&scale));
        let named = if method == Method::LeastSquares { "least-squares" } else { "instrumental-variable" };
        let singular = || OfflineError::Singular { method: named };
        let lead = match method {
            Method::LeastSquares => None,
            Method::Instrumental => Some(lead(&scaled(&zz), &left).ok_or_else(singular)?),
        };
        if let Some(lead) = &lead {
            left = lead * left;
            right = lead * right;
        }
        for i in 0..k {
            left[(i, i)] += prior_information[i];
        }
        right += offset;
        let inverse = left.clone().lu().try_inverse().ok_or_else(singular)?;
        // One step of refinement: the inverse of a badly conditioned matrix is exact in its large directions only.
        let mut s = &inverse * &right;
        s += &inverse * (&right - &left * &s);
        let x = s.component_mul(&scale);
        if count == 0.0 || x.iter().any(|x| !x.is_finite()) {
            return Err(singular());
        }
        let information = scaled(&dd);
        Ok(Solution { x, scale, information, left, inverse, lead, prior: prior_information, held: None })
    }

    /// Leaves the directions at the prior mean `x0` that the rows do not determine.
    pub(super) fn hold(mut self, x0: &DVector<f64>) -> Solution {
        let undetermined = Undetermined::new(&self.inverse, &self.prior);
        undetermined.hold(&mut self.left, &mut self.inverse);
        let mut scaled = self.x.component_div(&self.scale);
        undetermined.keep_mean(&mut scaled, &x0.component_div(&self.scale));
        self.x = scaled.component_mul(&self.scale);
        self.held = Some(undetermined);
        self
    }

    /// Covariance, scaled: the inverse of the information, (G·ΣwZᵀD + P⁻¹)⁻¹, where residuals are white.
    pub(super) fn covariance(&self) -> DMatrix<f64> {
        // As B·Bᵀ: rounding in what the data hardly see then leaves every variance positive.
        let eigen = ((&self.left + self.left.transpose()) * 0.5).symmetric_eigen();
        let least = f64::EPSILON * eigen.eigenvalues.len() as f64 * eigen.eigenvalues.max();
        let std = eigen.eigenvalues.map(|value| 1.0 / value.max(least).sqrt());
        let root = eigen.eigenvectors * DMatrix::from_diagonal(&std);
        &root * root.transpose()
    }

    /// Covariance, scaled, with what the colour of the residuals makes of it. `weights` are those it was solved with.
    pub(super) fn long_run_covariance(&self, joints: &[JointSums], weights: &[f64], method: Method) -> DMatrix<f64> {
        let Solution { x, scale, left, inverse, lead, prior, held, .. } = self;
        let whole = Whole { left, inverse, lead: lead.as_ref(), prior, scale, x, held: held.as_ref() };
        long_run(joints, weights, &whole, self.covariance(), method)
    }

    /// Standard deviations and what decided each value, from the scaled covariance.
    pub(super) fn certainty(&self, covariance: &DMatrix<f64>) -> (Vec<f64>, Vec<Determined>) {
        let k = self.x.len();
        let std = |i: usize| covariance[(i, i)].max(0.0).sqrt();
        let determined = |i: usize| {
            if std(i) * self.prior[i].sqrt() < 0.5 { Determined::ByData } else { Determined::ByPrior }
        };
        ((0..k).map(|i| std(i) * self.scale[i]).collect(), (0..k).map(determined).collect())
    }

    /// Directions the data sees, and the condition over them.
    fn conditioning(&self) -> (usize, f64) {
        let eigen = self.information.clone().symmetric_eigenvalues();
        let largest = eigen.max().max(f64::MIN_POSITIVE);
        let seen = eigen.iter().filter(|value| **value > largest * RANK_TOLERANCE * RANK_TOLERANCE);
        let (rank, smallest) = seen.fold((0, largest), |(count, least), value| (count + 1, least.min(*value)));
        (rank, (largest / smallest).sqrt())
    }
}

/// G = (ZᵀD)ᵀ·(ZᵀZ)⁻¹, instruments scaled to one. Directions in which they are rounding lead nowhere.
fn lead(zz: &DMatrix<f64>, zd: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let k = zz.nrows();
    let scale = zz.diagonal().map(|square| if square > 0.0 { 1.0 / square.sqrt() } else { 1.0 });
    let rounding = 4.0 * k as f64 * f64::EPSILON;
    let instrument_gram =
        DMatrix::from_fn(k, k, |i, j| zz[(i, j)] * scale[i] * scale[j] + if i == j { rounding } else { 0.0 });
    let mut lead = instrument_gram.cholesky()?.solve(&DMatrix::from_fn(k, k, |i, j| scale[i] * zd[(i, j)]));
    lead.row_iter_mut().zip(scale.iter()).for_each(|(mut row, scale)| row *= *scale);
    Some(lead.transpose())
}
