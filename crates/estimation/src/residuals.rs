//! Windowed squares of what the parameters leave, each joint.

use crate::memory::{Carry, MANY};

/// Rows that count for a smaller share say nothing of residuals and noise: what sticks is in them.
pub(crate) const CLEAR: f64 = 0.5;

#[derive(Clone, Debug)]
pub(crate) struct Residuals {
    /// Rows that count.
    memory: f64,
    square: [Vec<f64>; 3],
    /// Rms of residual, nominal residual and torque \[N·m\].
    pub(crate) rms: [Vec<f64>; 3],
    pub(crate) used: Vec<u64>,
    pub(crate) left_out: Vec<u64>,
}

impl Residuals {
    pub(crate) fn new(rows: usize, memory: f64) -> Residuals {
        let zeros = || vec![0.0; rows];
        Residuals {
            memory,
            square: [zeros(), zeros(), zeros()],
            rms: [zeros(), zeros(), zeros()],
            used: vec![0; rows],
            left_out: vec![0; rows],
        }
    }

    /// Goes on with the memory of `fresh`.
    pub(crate) fn reconfigure(&mut self, fresh: &Residuals) {
        self.memory = fresh.memory;
    }

    pub(crate) fn carry(&mut self, carry: &mut Carry<'_>) {
        for values in self.square.iter_mut().chain(&mut self.rms) {
            carry.sizes(values);
        }
        for count in self.used.iter_mut().chain(&mut self.left_out) {
            carry.whole(count, MANY);
        }
    }

    pub(crate) fn reset(&mut self) {
        for values in self.square.iter_mut().chain(&mut self.rms) {
            values.fill(0.0);
        }
        self.used.fill(0);
        self.left_out.fill(0);
    }

    pub(crate) fn count(&mut self, share: &[f64]) {
        for ((yes, no), share) in self.used.iter_mut().zip(&mut self.left_out).zip(share) {
            if *share >= CLEAR {
                *yes += 1;
            } else {
                *no += 1;
            }
        }
    }

    /// Takes in residual, nominal residual and torque of row `j`, which [`count`](Self::count) has counted.
    pub(crate) fn add(&mut self, j: usize, values: [f64; 3]) {
        let rows = (self.used[j] as f64).clamp(1.0, self.memory);
        for (k, value) in values.iter().enumerate() {
            let square = &mut self.square[k][j];
            *square += (value * value - *square) / rows;
            self.rms[k][j] = square.sqrt();
        }
    }
}
