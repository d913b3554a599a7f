//! Standard deviation of each row's torque residual, estimated while running, and what a row therefore weighs.
//!
//! The ratios between joints weigh rows against each other. The common level does not: rows of a noisy second and of a
//! quiet one count alike in the window, and the level multiplies the threshold and the variances instead. Else a quiet
//! standstill would outweigh the motion after it, and a payload would have to wait until the window has forgotten how
//! well the old one fitted.

use crate::memory::Carry;

/// A residual counts at most as this many sigmas: a collision must not teach the estimator that the arm is noisy. A
/// level that has really risen is followed at about 7 % a row.
const MAX_RESIDUAL_SIGMAS: f64 = 3.0;
/// The first guess counts as this many rows.
const GUESS_ROWS: f64 = 20.0;
/// Estimated sigmas stay above this share of the first guess: noise-free data must not make weights infinite.
const MIN_SIGMA_SHARE: f64 = 1e-3;
/// Neither does the level fall below this in thresholds: they would take rounding for information.
const LEAST_LEVEL: f64 = 1e-4;

/// Variance of a stream of residuals, forgetting exponentially, capped against outliers.
#[derive(Clone, Copy, Debug)]
struct Variance {
    value: f64,
    rows: f64,
}

impl Variance {
    fn new(value: f64) -> Variance {
        Variance { value, rows: GUESS_ROWS }
    }

    fn add(&mut self, square: f64, memory: f64) {
        self.rows = (self.rows + 1.0).min(memory);
        self.value += (square.min(MAX_RESIDUAL_SIGMAS * MAX_RESIDUAL_SIGMAS * self.value) - self.value) / self.rows;
    }
}

/// Noise of all rows.
#[derive(Clone, Debug)]
pub(crate) struct Noise {
    guess: Vec<f64>,
    fixed: bool,
    memory: f64,
    outlier: f64,
    rows: Vec<Variance>,
    /// Standard deviation of each row \[N·m\].
    pub(crate) sigma: Vec<f64>,
    /// Variance of rows divided by their `unit`.
    level: Variance,
    /// Residuals of the instant before over their sigma, and the running mean of products of neighbours.
    before: Vec<f64>,
    product: Vec<f64>,
    /// What each row is divided by \[N·m\]: in the ratio of the sigmas, in size like the first guess.
    unit: Vec<f64>,
}

impl Noise {
    /// `sigma`: a first guess, or (`fixed`) the truth; `memory` in rows; residuals beyond `outlier` sigmas lose weight.
    pub(crate) fn new(sigma: &[f64], fixed: bool, memory: f64, outlier: f64) -> Noise {
        Noise {
            guess: sigma.to_vec(),
            fixed,
            memory: memory.max(GUESS_ROWS),
            outlier,
            rows: sigma.iter().map(|s| Variance::new(s * s)).collect(),
            sigma: sigma.to_vec(),
            level: Variance::new(1.0),
            before: vec![0.0; sigma.len()],
            product: vec![0.0; sigma.len()],
            unit: sigma.to_vec(),
        }
    }

    /// Whether both started from the same guess.
    pub(crate) fn same_guess(&self, other: &Noise) -> bool {
        self.guess == other.guess
    }

    /// Goes on with the memory and the outlier of `fresh`.
    pub(crate) fn reconfigure(&mut self, fresh: &Noise) {
        (self.memory, self.outlier) = (fresh.memory, fresh.outlier);
    }

    pub(crate) fn carry(&mut self, carry: &mut Carry<'_>) {
        for variance in self.rows.iter_mut().chain([&mut self.level]) {
            carry.sizes(std::slice::from_mut(&mut variance.value));
            carry.sizes(std::slice::from_mut(&mut variance.rows));
        }
        for values in [&mut self.sigma, &mut self.unit] {
            carry.sizes(values);
        }
        for values in [&mut self.before, &mut self.product] {
            carry.numbers(values);
        }
    }

    pub(crate) fn reset(&mut self) {
        for (variance, guess) in self.rows.iter_mut().zip(&self.guess) {
            *variance = Variance::new(guess * guess);
        }
        self.sigma.copy_from_slice(&self.guess);
        self.unit.copy_from_slice(&self.guess);
        self.level = Variance::new(1.0);
        self.before.fill(0.0);
        self.product.fill(0.0);
    }

    /// Takes in the residual of row `j` \[N·m\].
    pub(crate) fn add(&mut self, j: usize, residual: f64) {
        let now = (residual / self.sigma[j]).clamp(-MAX_RESIDUAL_SIGMAS, MAX_RESIDUAL_SIGMAS);
        self.product[j] += (now * self.before[j] - self.product[j]) / self.memory;
        self.before[j] = now;
        if self.fixed {
            // Rows are known to be this noisy; the level says by how much the model errs beyond that.
            self.level.add((residual / self.sigma[j]).powi(2), self.memory);
            return;
        }
        let least = (MIN_SIGMA_SHARE * self.guess[j]).powi(2);
        self.rows[j].add(residual * residual, self.memory);
        self.rows[j].value = self.rows[j].value.max(least);
        self.sigma[j] = self.rows[j].value.sqrt();
    }

    /// Sets the units of this instant from the sigmas, after all its residuals.
    pub(crate) fn balance(&mut self) {
        if self.fixed {
            return;
        }
        let ratio = |(sigma, guess): (&f64, &f64)| (sigma / guess).ln();
        let mean = self.sigma.iter().zip(&self.guess).map(ratio).sum::<f64>() / self.sigma.len() as f64;
        let level = mean.exp();
        self.level.value = level * level;
        for (unit, sigma) in self.unit.iter_mut().zip(&self.sigma) {
            *unit = sigma / level;
        }
    }

    /// What row `j` is multiplied by, given its residual \[1/(N·m)\]. A row that is `k > outlier` sigmas off counts as if
    /// its sigma were k/outlier times as large.
    pub(crate) fn weight(&self, j: usize, residual: f64) -> f64 {
        let sigma = if self.fixed { self.sigma[j] * self.level.value.max(1.0).sqrt() } else { self.sigma[j] };
        let allowed = self.outlier * sigma;
        let size = residual.abs();
        (if size > allowed { allowed / size } else { 1.0 }) / self.unit[j]
    }

    /// Correlation of residuals with those of the row before, mean over joints.
    pub(crate) fn correlation(&self) -> f64 {
        let level = if self.fixed { self.level.value } else { 1.0 };
        self.product.iter().sum::<f64>() / (self.product.len() as f64 * level)
    }

    /// Variance of a row times its weight: the σₑ² of the paper's eq. 22.
    pub(crate) fn equation_variance(&self) -> f64 {
        self.level.value.max(LEAST_LEVEL)
    }
}
