//! The paper's scheme of 3.2.2: every direction of the parameter space judged by its eigenvalue.

use super::{Covectors, Known};
use crate::eigen::SymmetricEigen;
use crate::linear::{Budget, dot_short};
use crate::memory::Carry;
use crate::report::Verdict;
use crate::settings::EigenSettings;

/// Eigenvalues below this share of the largest are rounding of the sums.
const EIGENVALUE_ROUNDING: f64 = 1e-13;
/// Entries of remembered directions are whole numbers of this part of 1.
const FIXED_POINT_ONE: f64 = 32767.0;

#[derive(Clone, Copy, Debug)]
enum Stage {
    Decompose,
    Weigh { row: usize },
    Recognise { row: usize },
}

/// State of one judgement.
#[derive(Clone, Debug)]
pub(crate) struct Directions {
    settings: EigenSettings,
    stage: Stage,
    eigen: SymmetricEigen,
    /// Variance of what is known along each eigenvector \[torque-noise sigma²\].
    belief: Vec<f64>,
    covectors: Covectors,
    /// Directions that moved before, one a row, or all others if those are fewer: hysteresis recognises them although the basis
    /// turns. Sixteen bits will do to recognise them.
    history: Vec<i16>,
    history_count: usize,
    /// Whether these are the others.
    history_stood: bool,
    /// How much of each eigenvector's square lies in them, where that matters.
    moved_share: Vec<f64>,
}

impl Directions {
    pub(crate) fn new(n: usize, settings: EigenSettings) -> Directions {
        Directions {
            settings,
            stage: Stage::Decompose,
            eigen: SymmetricEigen::new(n),
            belief: vec![0.0; n],
            covectors: Covectors::new(n),
            history: vec![0; n / 2 * n],
            history_count: 0,
            history_stood: false,
            moved_share: vec![0.0; n],
        }
    }

    /// Goes on with other thresholds.
    pub(crate) fn reconfigure(&mut self, fresh: &Directions) {
        self.settings = fresh.settings;
    }

    pub(crate) fn carry(&mut self, carry: &mut Carry<'_>) {
        let n = self.belief.len();
        carry.place(&mut self.history_count, n / 2 + 1);
        carry.flag(&mut self.history_stood);
        for entry in &mut self.history {
            let mut value = f64::from(*entry);
            carry.number(&mut value);
            *entry = value as i16;
        }
    }

    pub(crate) fn settings(&self) -> EigenSettings {
        self.settings
    }

    pub(crate) fn forget_history(&mut self) {
        (self.history_count, self.history_stood) = (0, false);
    }

    pub(crate) fn start(&mut self, s: &[f64]) {
        self.eigen.start_packed(s);
        self.stage = Stage::Decompose;
    }

    /// Eigenvectors as rows, from the end of a judgement to the next start.
    pub(crate) fn vectors(&self) -> &[f64] {
        self.eigen.vectors()
    }

    pub(crate) fn values(&self) -> &[f64] {
        self.eigen.values()
    }

    /// Variance of what is known along direction k, at least the tolerance's.
    pub(crate) fn belief(&self, k: usize) -> f64 {
        self.belief[k]
    }

    /// Goes on while `budget` lasts; true when `active` and the verdict are complete.
    pub(crate) fn advance(
        &mut self,
        known: Known<'_>,
        active: &mut [bool],
        verdict: &mut Verdict,
        budget: &mut Budget,
    ) -> bool {
        let n = active.len();
        match self.stage {
            Stage::Decompose => {
                if !self.eigen.advance_within(budget) {
                    return false;
                }
                if !self.eigen.converged() {
                    active.fill(false);
                    *verdict = Verdict { of: n, suspended: true, ..Verdict::NONE };
                    return true;
                }
                self.stage = Stage::Weigh { row: 0 };
                false
            }
            Stage::Weigh { row } => {
                let cost = n * n / 2 + 2 * n;
                let k = n.min(row + budget.begun(cost));
                for from in (row..k).step_by(4) {
                    let group = from..k.min(from + 4);
                    let vectors = self.eigen.vectors().chunks_exact(n);
                    let mut directions: [&[f64]; 4] = [&[]; 4];
                    directions.iter_mut().zip(vectors.skip(from).take(group.len())).for_each(|(to, v)| *to = v);
                    let directions = &directions[..group.len()];
                    let [variances] = self.covectors.variances(directions, known.whitening, [known.belief]);
                    for (belief, variance) in self.belief[group].iter_mut().zip(variances) {
                        *belief = variance.max(self.settings.tolerance.powi(2));
                    }
                }
                budget.charge(cost * (k - row));
                self.stage = if k < n { Stage::Weigh { row: k } } else { Stage::Recognise { row: 0 } };
                false
            }
            Stage::Recognise { row } => {
                let mut k = row;
                while k < n && !budget.is_spent() {
                    // Only within the hysteresis does it matter whether a direction moved before.
                    let threshold = known.variance / self.belief[k];
                    let value = self.eigen.values()[k];
                    let mut moved_share = 0.0;
                    if value > self.settings.hysteresis * threshold && value <= threshold {
                        let v = &self.eigen.vectors()[k * n..(k + 1) * n];
                        let history = self.history.chunks_exact(n).take(self.history_count);
                        let share: f64 = history.map(|old| (dot_short(old, v) / FIXED_POINT_ONE).powi(2)).sum();
                        // All of them together are a basis.
                        moved_share = if self.history_stood { 1.0 - share } else { share };
                        budget.charge(self.history_count * n);
                    }
                    self.moved_share[k] = moved_share;
                    k += 1;
                }
                self.stage = Stage::Recognise { row: k };
                if k == n {
                    self.decide(known.variance, active, verdict);
                    budget.charge(n);
                }
                k == n
            }
        }
    }

    fn decide(&self, variance: f64, active: &mut [bool], verdict: &mut Verdict) {
        let values = self.eigen.values();
        let largest = values.iter().fold(0.0_f64, |m, v| m.max(*v));
        let mut smallest = f64::INFINITY;
        let mut count = 0;
        for (k, active) in active.iter_mut().enumerate() {
            let threshold = variance / self.belief[k];
            let threshold = if self.moved_share[k] > 0.5 { self.settings.hysteresis * threshold } else { threshold };
            *active = values[k] > threshold && values[k] > EIGENVALUE_ROUNDING * largest;
            if *active {
                smallest = smallest.min(values[k]);
                count += 1;
            }
        }
        *verdict = Verdict {
            active: count,
            of: active.len(),
            suspended: false,
            trace: values.iter().sum(),
            log_determinant: values.iter().map(|v| v.max(f64::MIN_POSITIVE).ln()).sum(),
            condition: if count > 0 { largest / smallest } else { f64::NAN },
        };
    }

    /// Remembers which directions moved, after the relevance guard has had its say.
    pub(crate) fn remember(&mut self, active: &[bool]) {
        let n = active.len();
        let count = active.iter().filter(|active| **active).count();
        self.history_stood = count > n / 2;
        self.history_count = if self.history_stood { n - count } else { count };
        let chosen =
            self.eigen.vectors().chunks_exact(n).zip(active).filter(|(_, active)| **active != self.history_stood);
        for (out, (v, _)) in self.history.chunks_exact_mut(n).zip(chosen) {
            out.iter_mut().zip(v).for_each(|(out, v)| *out = (*v * FIXED_POINT_ONE).round() as i16);
        }
    }
}
