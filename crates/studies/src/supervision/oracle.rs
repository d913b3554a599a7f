//! Section 3.2.2 as a textbook would write it: everything anew with every row, by nalgebra.
//!
//! It follows the rule of the `eigen` scheme and shares none of its code, nor its steps, caps on their work or copies of
//! the sums:
//!
//! ```text
//! x̃ = Lᵀx, L·Lᵀ the reference workload's information      M, S, y: windowed sums over the rows in these coordinates
//! S = V·Λ·Vᵀ                                               v moves if λ > κσₑ²/max(tol², known²)          (eq. 22, 23)
//! A = VₐᵀMVₐ,  δ = A⁻¹·Vₐᵀ(y − M·x̃),  x̃ ← x̃ + Vₐ·δ          what is held enters as known
//! ```
//!
//! with hysteresis, the guard `r < vᵀMv/vᵀSv < 1/r`, and the variance `κσₑ²·(A⁻¹ΛA⁻ᵀ)ₖₖ` verified. Noise is learnt from what
//! the better of two predictors leaves, the estimate or recursive least squares. Left out: the long-run variance of the
//! stated standard deviations, changes of the arm.

use super::workload::{Rows, Workload};
use nalgebra::{DMatrix, DVector, SymmetricEigen};
use rivet_estimation::{Directions, EigenSettings};

/// Prior: share of the workload's torque that a parameter is taken to make at least; share of it that counts as known.
const LEAST: f64 = 0.05;
const CAUTION: f64 = 0.05;
/// Least pivot of the workload's factor, as a share of the mean; eigenvalues that are rounding, as one of the largest.
const FLOOR: f64 = 1e-6;
const ROUNDING: f64 = 1e-13;
/// Variance that what moves may have over what is allowed, and how often it is looked for.
const SLACK: f64 = 2.0;
const ROUNDS: usize = 4;
/// A parameter is known once what is held leaves it this share of its prior.
const HELD: f64 = 0.25;
/// Standard deviations that are refreshed with a row.
const DEVIATIONS: usize = 4;
/// Noise: rows that the first guess counts for, sigmas at which a residual is cut off, sigmas beyond which a row loses weight.
const GUESS: f64 = 20.0;
const CUT: f64 = 3.0;
const OUTLIER: f64 = 5.0;
/// Largest factor for coloured residuals; largest standard deviation of least squares, over the prior's.
const COLOUR: f64 = 4.0;
const WIND_UP: f64 = 1e4;

/// Noise of one joint's rows.
struct Noise {
    guess: f64,
    variance: f64,
    rows: f64,
    before: f64,
    product: f64,
}

/// The oracle's state, in scaled parameters and working coordinates.
pub struct Oracle {
    settings: EigenSettings,
    lambda: f64,
    memory: f64,
    neighbour: f64,
    factor: f64,
    column: DVector<f64>,
    l: DMatrix<f64>,
    inverse: DMatrix<f64>,
    noise: Vec<Noise>,
    count: [f64; 2],
    m: DMatrix<f64>,
    s: DMatrix<f64>,
    y: DVector<f64>,
    x: DVector<f64>,
    vectors: DMatrix<f64>,
    moves: Vec<bool>,
    prior: DVector<f64>,
    belief: DVector<f64>,
    width: DVector<f64>,
    next: usize,
    /// Recursive least squares in scaled parameters, and a square root of its covariance.
    beside: DVector<f64>,
    root: DMatrix<f64>,
    /// Base parameters.
    pub values: Vec<f64>,
}

impl Oracle {
    /// Starts at the workload's nominal parameters, with a window of `window` seconds and a memory of noise of `memory`.
    #[must_use]
    pub fn new(workload: &Workload, window: f64, memory: f64) -> Oracle {
        let n = workload.nominal.len();
        let column = DVector::from_column_slice(&workload.scales.column);
        let information = DMatrix::from_row_slice(n, n, &workload.scales.workload);
        let l = factor(&information);
        let inverse = l.solve_lower_triangular(&DMatrix::identity(n, n)).expect("pivots above the floor");
        let scaled = DVector::from_column_slice(&workload.nominal).component_mul(&column);
        let prior = scaled.map(|x| x.abs().max(LEAST * workload.scales.torque));
        let noise =
            |guess: &f64| Noise { guess: *guess, variance: guess * guess, rows: GUESS, before: 0.0, product: 0.0 };
        Oracle {
            settings: EigenSettings::default(),
            lambda: (-workload.row / window).exp(),
            memory: memory / workload.row,
            neighbour: workload.correlation.neighbour,
            factor: workload.correlation.factor,
            noise: workload.scales.torque_noise.iter().map(noise).collect(),
            count: [0.0; 2],
            m: DMatrix::zeros(n, n),
            s: DMatrix::zeros(n, n),
            y: DVector::zeros(n),
            x: l.tr_mul(&scaled),
            vectors: DMatrix::identity(n, n),
            moves: vec![false; n],
            belief: CAUTION * &prior,
            width: prior.clone(),
            next: 0,
            root: DMatrix::from_diagonal(&prior),
            beside: scaled,
            values: workload.nominal.clone(),
            prior,
            column,
            l,
            inverse,
        }
    }

    /// Takes in the rows of one instant, decides and solves.
    pub fn update(&mut self, rows: &Rows) {
        let (n, p) = (self.x.len(), rows.tau.len());
        let units: Vec<f64> = (0..p).map(|j| self.unit(j)).collect();
        let weights: Vec<f64> = (0..p).map(|j| self.weigh(j, rows) / units[j]).collect();
        // Rows in units of the noise and of the columns, as columns of a matrix.
        let scaled = |rows: &[f64]| DMatrix::from_fn(n, p, |i, j| rows[j * n + i] * weights[j] / self.column[i]);
        let (d, z) = (scaled(&rows.d), scaled(&rows.z));
        let tau = DVector::from_fn(p, |j, _| rows.tau[j] * weights[j]);
        self.least_squares(&d, &tau);
        let (d, z) = (&self.inverse * d, &self.inverse * z);
        self.m.gemm(1.0, &z, &d.transpose(), self.lambda);
        self.s.gemm(1.0, &z, &z.transpose(), self.lambda);
        self.y.gemv(1.0, &z, &tau, self.lambda);
        self.count = [self.lambda * self.count[0] + 1.0, self.lambda.powi(2) * self.count[1] + 1.0];
        self.decide();
    }

    /// Share of joint j's row that counts, by the noise so far, which then learns from the row.
    fn weigh(&mut self, j: usize, rows: &Rows) -> f64 {
        let d = &rows.d[j * self.x.len()..(j + 1) * self.x.len()];
        let torque = |x: &mut dyn Iterator<Item = f64>| d.iter().zip(x).map(|(d, x)| d * x).sum::<f64>();
        let own = rows.tau[j] - torque(&mut self.values.iter().copied());
        let beside = rows.tau[j] - torque(&mut self.beside.iter().zip(&self.column).map(|(x, c)| x / c));
        let residual = if beside.abs() < own.abs() { beside } else { own };
        let noise = &mut self.noise[j];
        let sigma = noise.variance.sqrt();
        let weight = (OUTLIER * sigma / residual.abs()).min(1.0);
        let now = (residual / sigma).clamp(-CUT, CUT);
        noise.product += (now * noise.before - noise.product) / self.memory;
        noise.before = now;
        noise.rows = (noise.rows + 1.0).min(self.memory);
        noise.variance += (residual.powi(2).min(CUT * CUT * noise.variance) - noise.variance) / noise.rows;
        weight
    }

    /// σⱼ over the level that all joints share.
    fn unit(&self, j: usize) -> f64 {
        (self.noise[j].variance / self.level()).sqrt()
    }

    /// σₑ² of weighted rows: geometric mean of the variances over their guesses.
    fn level(&self) -> f64 {
        let logs = self.noise.iter().map(|noise| (noise.variance / noise.guess.powi(2)).ln());
        (logs.sum::<f64>() / self.noise.len() as f64).exp()
    }

    /// κσₑ² of the window: residuals that are correlated beyond the filter's share count for fewer, as an AR(1) process.
    fn variance(&self) -> f64 {
        let measured = self.noise.iter().map(|noise| noise.product).sum::<f64>() / self.noise.len() as f64;
        let rows = |rho: f64| (1.0 + rho) / (1.0 - rho);
        let colour = rows(measured.clamp(-0.99, 0.99)) / rows(self.neighbour.clamp(-0.99, 0.99));
        self.count[1] / self.count[0] * self.factor * colour.clamp(1.0, COLOUR) * self.level()
    }

    /// Recursive least squares by Potter's square root: `P = R·Rᵀ`.
    fn least_squares(&mut self, d: &DMatrix<f64>, tau: &DVector<f64>) {
        self.root /= self.lambda.sqrt();
        for (mut row, prior) in self.root.row_iter_mut().zip(&self.prior) {
            let grown = row.norm() / (WIND_UP * prior);
            if grown > 1.0 {
                row /= grown;
            }
        }
        for (j, tau) in tau.iter().enumerate() {
            let f = self.root.tr_mul(&d.column(j));
            let alpha = 1.0 / (1.0 + f.norm_squared());
            let gain = &self.root * &f;
            let error = tau - d.column(j).dot(&self.beside);
            self.beside.axpy(alpha * error, &gain, 1.0);
            self.root.ger(-alpha / (1.0 + alpha.sqrt()), &gain, &f, 1.0);
        }
    }

    fn decide(&mut self) {
        let n = self.x.len();
        let EigenSettings { tolerance, hysteresis, relevance } = self.settings;
        let variance = self.variance();
        let Some(eigen) = SymmetricEigen::try_new(self.s.clone(), f64::EPSILON, 50 * n) else {
            self.moves.fill(false);
            return;
        };
        let (v, values) = (eigen.eigenvectors, eigen.eigenvalues);
        let old: Vec<usize> = (0..n).filter(|&k| self.moves[k]).collect();
        let recognised = self.vectors.select_columns(&old).tr_mul(&v);
        let parameters = &self.l * &v;
        let allowed = DVector::from_fn(n, |k, _| {
            parameters.column(k).component_mul(&self.belief).norm_squared().max(tolerance.powi(2))
        });
        let mapped = v.tr_mul(&(&self.m * &v));
        let largest = values.max();
        for k in 0..n {
            let moved = recognised.column(k).norm_squared() > 0.5;
            let threshold = if moved { hysteresis } else { 1.0 } * variance / allowed[k];
            let ratio = mapped[(k, k)] / values[k];
            let relevant = ratio > relevance && ratio < 1.0 / relevance;
            self.moves[k] = values[k] > threshold && values[k] > ROUNDING * largest && relevant;
        }
        let mut solved = None;
        for round in 0..=ROUNDS {
            let index: Vec<usize> = (0..n).filter(|&k| self.moves[k]).collect();
            let inverse = mapped.select_rows(&index).select_columns(&index).try_inverse();
            let Some(inverse) = inverse.filter(|_| round < ROUNDS && !index.is_empty()) else {
                self.moves.fill(false);
                break;
            };
            let spread =
                |a: usize| index.iter().enumerate().map(|(b, &l)| inverse[(a, b)].powi(2) * values[l]).sum::<f64>();
            let excess: Vec<usize> =
                (0..index.len()).filter(|&a| variance * spread(a) > SLACK * allowed[index[a]]).collect();
            if excess.is_empty() {
                solved = Some((v.select_columns(&index), index, inverse));
                break;
            }
            for a in excess {
                self.moves[index[a]] = false;
            }
        }
        self.vectors = v;
        if let Some((active, index, inverse)) = solved {
            let rest = &self.y - &self.m * &self.x;
            let step = &inverse * active.tr_mul(&rest);
            self.x += &active * step;
            let scaled = self.inverse.tr_mul(&self.x);
            self.values = scaled.component_div(&self.column).as_slice().to_vec();
            self.deviations(variance, &active, &inverse, &DVector::from_fn(index.len(), |a, _| values[index[a]]));
        }
    }

    /// What is known now of the next few parameters: variance of what moves, and of what is held, with what was known.
    fn deviations(&mut self, variance: f64, active: &DMatrix<f64>, inverse: &DMatrix<f64>, values: &DVector<f64>) {
        for _ in 0..DEVIATIONS {
            let i = self.next;
            self.next = (i + 1) % self.x.len();
            let parameter = self.inverse.column(i).into_owned();
            let share = active.tr_mul(&parameter);
            let unseen = &self.l * (parameter - active * &share);
            let held = unseen.component_mul(&self.width).norm_squared();
            let spread = inverse.tr_mul(&share);
            let moving = variance * spread.component_mul(&spread).dot(values);
            let small = self.settings.tolerance.powi(2).max((HELD * self.prior[i]).powi(2));
            if held <= moving.max(small) {
                self.width[i] = (moving + held).sqrt();
                self.belief[i] = self.belief[i].min(self.width[i]);
            }
        }
    }

    /// The directions of the last decision, and the estimate in their coordinates.
    #[must_use]
    pub fn directions(&self) -> Directions<'_> {
        let n = self.x.len();
        let directions = self.vectors.as_slice().chunks_exact(n).zip(self.moves.iter().copied()).collect();
        Directions { coordinates: self.x.as_slice(), directions }
    }
}

/// Cholesky's lower factor with a floor for the pivots.
fn factor(a: &DMatrix<f64>) -> DMatrix<f64> {
    let n = a.nrows();
    let floor = FLOOR * a.trace() / n as f64;
    let mut l = DMatrix::zeros(n, n);
    for j in 0..n {
        for i in j..n {
            let rest = a[(i, j)] - l.row(i).columns(0, j).dot(&l.row(j).columns(0, j));
            l[(i, j)] = if i == j { f64::max(rest, floor).sqrt() } else { rest / l[(j, j)] };
        }
    }
    l
}
