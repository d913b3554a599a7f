//! The paper's own scheme (3.2.3): single columns, pairs of columns, then trace and condition of what is left.

use super::Known;
use crate::linear::{dot, items_per_step};
use crate::lu::Lu;
use crate::report::Verdict;
use crate::settings::ColumnsSettings;

#[derive(Clone, Copy, Debug)]
enum Stage {
    Norms,
    Angles { row: usize },
    Reduce,
    Factor,
    Inverse { column: usize },
}

/// State of one judgement.
#[derive(Clone, Debug)]
pub(crate) struct Columns {
    settings: ColumnsSettings,
    stage: Stage,
    norm: Vec<f64>,
    included: Vec<bool>,
    index: Vec<usize>,
    lu: Lu,
    unit: Vec<f64>,
    size: f64,
    inverse_size: f64,
}

impl Columns {
    /// Goes on with other thresholds.
    pub(crate) fn reconfigure(&mut self, fresh: &Columns) {
        self.settings = fresh.settings;
    }

    pub(crate) fn new(n: usize, settings: ColumnsSettings) -> Columns {
        Columns {
            settings,
            stage: Stage::Norms,
            norm: vec![0.0; n],
            included: vec![false; n],
            index: Vec::with_capacity(n),
            lu: Lu::new(n),
            unit: vec![0.0; n],
            size: 0.0,
            inverse_size: 0.0,
        }
    }

    pub(crate) fn tolerance(&self) -> f64 {
        self.settings.tolerance
    }

    pub(crate) fn start(&mut self) {
        self.stage = Stage::Norms;
    }

    pub(crate) fn advance(&mut self, s: &[f64], known: Known<'_>, active: &mut [bool], verdict: &mut Verdict) -> bool {
        let n = active.len();
        match self.stage {
            Stage::Norms => {
                for (i, row) in s.chunks_exact(n).enumerate() {
                    self.norm[i] = dot(row, row).sqrt();
                    let tolerance = self.settings.tolerance.max(known.belief[i]);
                    self.included[i] = self.norm[i] > known.variance / (tolerance * tolerance);
                }
                self.stage = Stage::Angles { row: 1 };
                false
            }
            Stage::Angles { row } => {
                let end = (row + items_per_step(n * n / 2)).min(n);
                for i in row..end {
                    self.compare(s, n, i);
                }
                self.stage = if end < n { Stage::Angles { row: end } } else { Stage::Reduce };
                false
            }
            Stage::Reduce => {
                self.index.clear();
                self.index.extend((0..n).filter(|&i| self.included[i]));
                let size = self.index.len();
                let reduced = self.lu.start(size);
                self.size = 0.0;
                for (row, &i) in reduced.chunks_exact_mut(size.max(1)).zip(&self.index) {
                    let mut sum = 0.0;
                    for (out, &j) in row.iter_mut().zip(&self.index) {
                        *out = s[i * n + j];
                        sum += out.abs();
                    }
                    self.size = self.size.max(sum);
                }
                self.stage = Stage::Factor;
                false
            }
            Stage::Factor => {
                if !self.lu.advance() {
                    return false;
                }
                if self.lu.is_singular() || self.index.is_empty() {
                    self.decide(s, f64::INFINITY, active, verdict);
                    return true;
                }
                self.inverse_size = 0.0;
                self.stage = Stage::Inverse { column: 0 };
                false
            }
            Stage::Inverse { column } => {
                let size = self.index.len();
                let end = (column + items_per_step(size * size)).min(size);
                for k in column..end {
                    self.unit[..size].fill(0.0);
                    self.unit[k] = 1.0;
                    self.lu.solve(&mut self.unit[..size]);
                    let sum: f64 = self.unit[..size].iter().map(|x| x.abs()).sum();
                    self.inverse_size = self.inverse_size.max(sum);
                }
                self.stage = Stage::Inverse { column: end };
                if end == size {
                    self.decide(s, self.size * self.inverse_size, active, verdict);
                }
                end == size
            }
        }
    }

    /// Excludes one of every pair (i, j < i) of columns that are almost parallel: the one with the larger off-diagonals.
    fn compare(&mut self, s: &[f64], n: usize, i: usize) {
        let parallel = self.settings.min_angle.cos();
        let row = |k: usize| &s[k * n..(k + 1) * n];
        let off_diagonal = |k: usize| self.norm[k].powi(2) - s[k * n + k].powi(2);
        for j in 0..i {
            if !self.included[i] {
                return;
            }
            if self.included[j] && dot(row(i), row(j)) > parallel * self.norm[i] * self.norm[j] {
                let worse = if off_diagonal(j) > off_diagonal(i) { j } else { i };
                self.included[worse] = false;
            }
        }
    }

    fn decide(&self, s: &[f64], condition: f64, active: &mut [bool], verdict: &mut Verdict) {
        let n = active.len();
        let trace: f64 = self.index.iter().map(|&i| s[i * n + i]).sum();
        let suspended = !(condition <= self.settings.max_condition && trace.is_finite());
        let some = !self.index.is_empty();
        for (active, &included) in active.iter_mut().zip(&self.included) {
            *active = included && !suspended;
        }
        *verdict = Verdict {
            active: if suspended { 0 } else { self.index.len() },
            of: n,
            // With nothing excited there is nothing to suspend.
            suspended: suspended && some,
            trace,
            log_determinant: if some { self.lu.pivots().map(|p| p.abs().ln()).sum() } else { 0.0 },
            condition: if some { condition } else { f64::NAN },
        };
    }
}
