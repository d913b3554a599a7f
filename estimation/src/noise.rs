//! Standard deviation of each row's torque residual, estimated while running.

/// A residual counts at most as this many sigmas: a collision must not teach the estimator that the arm is noisy.
const LARGEST: f64 = 10.0;
/// The first guess counts as this many rows.
const GUESS_ROWS: f64 = 20.0;
/// Estimated sigmas stay above this share of the first guess: no sensor is that good, and noise-free data must not make
/// weights infinite.
const LEAST_SHARE: f64 = 1e-3;

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
        self.value += (square.min(LARGEST * LARGEST * self.value) - self.value) / self.rows;
    }
}

/// Noise of all rows.
#[derive(Clone, Debug)]
pub(crate) struct Noise {
    guess: Vec<f64>,
    fixed: bool,
    memory: f64,
    rows: Vec<Variance>,
    /// Standard deviation of each row \[N·m\], what rows are weighted by.
    pub(crate) sigma: Vec<f64>,
    equation: Variance,
}

impl Noise {
    /// `sigma`: a first guess, or (`fixed`) the truth; `memory` in rows.
    pub(crate) fn new(sigma: &[f64], fixed: bool, memory: f64) -> Noise {
        Noise {
            guess: sigma.to_vec(),
            fixed,
            memory: memory.max(GUESS_ROWS),
            rows: sigma.iter().map(|s| Variance::new(s * s)).collect(),
            sigma: sigma.to_vec(),
            equation: Variance::new(1.0),
        }
    }

    pub(crate) fn reset(&mut self) {
        for (variance, guess) in self.rows.iter_mut().zip(&self.guess) {
            *variance = Variance::new(guess * guess);
        }
        self.sigma.copy_from_slice(&self.guess);
        self.equation = Variance::new(1.0);
    }

    /// Takes in the residual of row `j` \[N·m\].
    pub(crate) fn add(&mut self, j: usize, residual: f64) {
        let relative = residual / self.sigma[j];
        self.equation.add(relative * relative, self.memory);
        if !self.fixed {
            let least = (LEAST_SHARE * self.guess[j]).powi(2);
            self.rows[j].add(residual * residual, self.memory);
            self.rows[j].value = self.rows[j].value.max(least);
            self.sigma[j] = self.rows[j].value.sqrt();
        }
    }

    /// Variance of the weighted equations (1 if the sigmas are right), the σₑ² of the paper's eq. 22.
    pub(crate) fn equation_variance(&self) -> f64 {
        // Never far below 1: a threshold of zero would take rounding for information.
        self.equation.value.max(1e-2)
    }
}
