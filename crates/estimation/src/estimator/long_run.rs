//! What the colour of the residuals makes of the variance of an estimate: batch means of the scores.
//!
//! ```text
//! u_b = Σ_block w z e                                     scores of a block of rows, all joints
//! Ω = Σ_b λ^(age) u_b u_bᵀ                                 → κσₑ²·S while the residuals e are white
//! cov(M⁻¹y) = M⁻¹·Ω·M⁻ᵀ·Σλ^2(N−i)/Σλ^(N−i)                  (batch means: Alexopoulos & Seila 1996; HAC: Newey & West 1987)
//! ```
//!
//! Residuals of an arm are coloured, and differently for every direction of the parameter space: what friction has
//! beyond the model comes back with the motion. Blocks are longer than it takes a residual to forget itself, so their
//! sums are as good as independent, in every direction, and no model of the colour is needed. A window holds few blocks:
//! what they say is averaged with what white residuals would give.

use crate::linear::{axpy, dot_short, packed};
use crate::memory::Carry;

/// Single precision holds no more.
const MAX_SCORE_SUM: f64 = 1e36;
/// What is believed before any block counts as this many.
const PRIOR_BLOCKS: f64 = 4.0;

/// Running sums of the scores. Nothing allocates after `new`.
#[derive(Clone, Debug)]
pub(super) struct LongRun {
    n: usize,
    /// Updates a block.
    length: usize,
    /// Weight that the block's start has kept.
    kept: f64,
    /// Scores of the block that is filling, and how much of it is.
    score: Vec<f64>,
    filled: usize,
    /// The block after a start is dropped: its residuals are those of values that nothing is known about.
    starting: bool,
    /// Ω, lower triangle, packed; a few blocks are known worse than single precision by far.
    sum: Vec<f32>,
    /// Σ λ^(age) over the updates in Ω, and over its blocks.
    covered: f64,
    blocks: f64,
}

impl LongRun {
    /// For `n` parameters, blocks of `length` updates.
    pub(super) fn new(n: usize, length: usize) -> LongRun {
        LongRun {
            n,
            length,
            kept: 1.0,
            score: vec![0.0; n],
            filled: 0,
            starting: true,
            sum: vec![0.0; packed(n).start],
            covered: 0.0,
            blocks: 0.0,
        }
    }

    /// Goes on with blocks as long as those of `fresh`; a block of the old length that was filling is dropped.
    pub(super) fn reconfigure(&mut self, fresh: &LongRun) {
        if self.length != fresh.length {
            self.length = fresh.length;
            self.score.fill(0.0);
            self.filled = 0;
            self.kept = 1.0;
        }
    }

    pub(super) fn carry(&mut self, carry: &mut Carry<'_>) {
        carry.numbers(&mut self.score);
        for sum in &mut self.sum {
            let mut value = f64::from(*sum);
            carry.number(&mut value);
            *sum = value as f32;
        }
        carry.place(&mut self.filled, self.length + 1);
        carry.number(&mut self.kept);
        carry.flag(&mut self.starting);
        carry.sizes(std::slice::from_mut(&mut self.covered));
        carry.sizes(std::slice::from_mut(&mut self.blocks));
    }

    pub(super) fn restart(&mut self) {
        self.score.fill(0.0);
        self.sum.fill(0.0);
        self.filled = 0;
        self.kept = 1.0;
        self.starting = true;
        self.covered = 0.0;
        self.blocks = 0.0;
    }

    /// Takes in one row: instruments in working coordinates, and residual, both weighted.
    pub(super) fn add(&mut self, z: &[f64], residual: f64) {
        axpy(residual, z, &mut self.score);
    }

    /// Ends an update, before which the past had been given the weight `forgetting`; a full block goes into Ω.
    pub(super) fn advance(&mut self, forgetting: f64) {
        self.filled += 1;
        self.kept *= forgetting;
        if self.filled < self.length {
            return;
        }
        self.filled = 0;
        if self.starting {
            self.starting = false;
            self.score.fill(0.0);
            return;
        }
        let keep = std::mem::replace(&mut self.kept, 1.0);
        for i in 0..self.n {
            let row = &mut self.sum[packed(i)];
            let score = self.score[i];
            for (sum, other) in row.iter_mut().zip(&self.score) {
                *sum = (keep * f64::from(*sum) + score * other).clamp(-MAX_SCORE_SUM, MAX_SCORE_SUM) as f32;
            }
        }
        self.score.fill(0.0);
        self.covered = keep * self.covered + self.length as f64;
        self.blocks = keep * self.blocks + 1.0;
    }

    /// `pᵀ·Ω·p`, as if Ω covered `count` updates, averaged with `white`, what it were with white residuals.
    pub(super) fn variance(&self, p: &[f64], count: f64, white: f64) -> f64 {
        if self.blocks <= 0.0 {
            return white;
        }
        // Twice the lower triangle, less the diagonal.
        let rows = (0..self.n).map(|i| &self.sum[packed(i)]).enumerate();
        let form: f64 = rows.map(|(i, row)| p[i] * (2.0 * dot_short(row, &p[..=i]) - f64::from(row[i]) * p[i])).sum();
        let found = form.max(0.0) * count / self.covered;
        (self.blocks * found + PRIOR_BLOCKS * white) / (self.blocks + PRIOR_BLOCKS)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linear::tests::Random;

    /// Scores of an AR(1) process of correlation ρ have the long-run variance (1 + ρ)/(1 − ρ) times that of white ones,
    /// in the direction where they are coloured and only there.
    #[test]
    fn colour_is_found_direction_by_direction() {
        let mut random = Random(5);
        let mut sums = LongRun::new(2, 100);
        let (rho, mut state) = (0.8_f64, 0.0);
        let count = 100_000;
        for _ in 0..count {
            state = rho * state + (1.0 - rho * rho).sqrt() * random.normal();
            sums.add(&[1.0, 0.0], state);
            sums.add(&[0.0, 1.0], random.normal());
            sums.advance(1.0);
        }
        let white = f64::from(count);
        let variance_ratio = |p: [f64; 2]| sums.variance(&p, f64::from(count), white) / white;
        // 1000 blocks: 4.5 % sampling error; blocks of 100 rows miss 4 % of the long-run variance of 9.
        assert!((variance_ratio([1.0, 0.0]) / 9.0 - 1.0).abs() < 0.15, "{}", variance_ratio([1.0, 0.0]));
        assert!((variance_ratio([0.0, 1.0]) - 1.0).abs() < 0.15, "{}", variance_ratio([0.0, 1.0]));
        assert!((variance_ratio([1.0, 1.0]) / 10.0 - 1.0).abs() < 0.15, "{}", variance_ratio([1.0, 1.0]));
    }
}
