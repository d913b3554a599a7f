//! Bayesian linear regression on blocks of rows: the evidence of a candidate, and what it is worth on held-out blocks.
//!
//! All that is known about a set of columns is in the sums of their products over each block and joint, so every
//! question (another weight, a fold left out, a candidate added) costs algebra of the size of the model, not of the log.
//!
//! ```text
//! y = D x + e,   e ~ N(0, 1/w_j) on joint j,   x ~ N(0, diag(p²))            y: torque less the nominal model's
//! A = Σ w DᵀD + diag(1/p²)      log E = −½ (yᵀwy − bᵀA⁻¹b) − ½ log det A − Σ log p
//! ```
//!
//! Weights w_j count the residual's correlation: one over its long-run variance, not its variance.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Products of the background's columns and of `y` over one block and one joint.
#[derive(Clone, Debug)]
pub(crate) struct Cell {
    /// DᵀD
    pub(crate) dd: DMatrix<f64>,
    /// Dᵀy
    pub(crate) dy: DVector<f64>,
    /// yᵀy
    pub(crate) yy: f64,
    /// Rows.
    pub(crate) rows: f64,
}

/// Products of a candidate's columns over one block and one joint; absent where they are zero.
#[derive(Clone, Debug)]
pub(crate) struct CandidateCell {
    /// Which block.
    pub(crate) block: usize,
    /// Which joint.
    pub(crate) joint: usize,
    /// CᵀD
    pub(crate) cd: DMatrix<f64>,
    /// CᵀC
    pub(crate) cc: DMatrix<f64>,
    /// Cᵀy
    pub(crate) cy: DVector<f64>,
}

/// What is believed of a candidate's coefficients before.
#[derive(Clone, Debug)]
pub(crate) struct Belief {
    /// Mean.
    pub(crate) mean: DVector<f64>,
    /// Standard deviation.
    pub(crate) std: DVector<f64>,
}

/// The background over all blocks: `cells[block][joint]`.
#[derive(Clone, Debug)]
pub(crate) struct Background {
    pub(crate) cells: Vec<Vec<Cell>>,
    /// Prior standard deviation of each column.
    pub(crate) std: DVector<f64>,
    /// Whether the common scale of the nominal's error applies to a column's prior.
    pub(crate) scaled: Vec<bool>,
}

/// Sums over chosen blocks with a weight a joint.
#[derive(Clone, Debug)]
struct Sums {
    dd: DMatrix<f64>,
    dy: DVector<f64>,
    yy: f64,
}

/// A background solved for given weights and prior scale.
#[derive(Clone)]
pub(crate) struct Solved {
    factor: Cholesky<f64, Dyn>,
    /// L⁻¹b
    forward: DVector<f64>,
    /// Coefficients.
    pub(crate) x: DVector<f64>,
    /// log E without candidates.
    pub(crate) log_evidence: f64,
}

/// A candidate on top of a solved background.
#[derive(Clone, Debug)]
pub(crate) struct Added {
    /// Coefficients of the candidate.
    pub(crate) c: DVector<f64>,
    /// Coefficients of the background.
    pub(crate) x: DVector<f64>,
    /// log E with the candidate.
    pub(crate) log_evidence: f64,
}

/// How wrong the nominal values may be, as multiples of the usual widths; which one holds is learnt from the run.
pub(crate) const PRIOR_SCALES: [f64; 8] = [0.03, 0.1, 0.3, 0.5, 0.7, 1.0, 1.4, 2.0];

impl Background {
    pub(crate) fn len(&self) -> usize {
        self.std.len()
    }

    pub(crate) fn blocks(&self) -> usize {
        self.cells.len()
    }

    fn sums(&self, weights: &[f64], blocks: impl Iterator<Item = usize>) -> Sums {
        let k = self.len();
        let mut sums = Sums { dd: DMatrix::zeros(k, k), dy: DVector::zeros(k), yy: 0.0 };
        for block in blocks {
            for (cell, w) in self.cells[block].iter().zip(weights) {
                sums.dd.zip_apply(&cell.dd, |s, v| *s += w * v);
                sums.dy.axpy(*w, &cell.dy, 1.0);
                sums.yy += w * cell.yy;
            }
        }
        sums
    }

    /// Solves for the blocks chosen.
    pub(crate) fn solve(&self, weights: &[f64], scale: f64, blocks: impl Iterator<Item = usize>) -> Option<Solved> {
        self.solve_sums(self.sums(weights, blocks), scale)
    }

    /// Solves for all blocks at each of the scales that can be solved.
    pub(crate) fn solve_scales(&self, weights: &[f64], scales: &[f64]) -> Vec<(f64, Solved)> {
        let sums = self.sums(weights, 0..self.blocks());
        scales.iter().filter_map(|s| Some((*s, self.solve_sums(sums.clone(), *s)?))).collect()
    }

    fn solve_sums(&self, mut sums: Sums, scale: f64) -> Option<Solved> {
        let mut log_prior = 0.0;
        for (i, std) in self.std.iter().enumerate() {
            let p = if self.scaled[i] { std * scale } else { *std };
            sums.dd[(i, i)] += 1.0 / (p * p);
            log_prior += p.ln();
        }
        let factor = Cholesky::new(sums.dd)?;
        let forward = factor.l_dirty().solve_lower_triangular(&sums.dy)?;
        let x = factor.solve(&sums.dy);
        let half_log_det: f64 = factor.l_dirty().diagonal().iter().map(|l| l.ln()).sum();
        let log_evidence = -0.5 * (sums.yy - forward.norm_squared()) - half_log_det - log_prior;
        Some(Solved { factor, forward, x, log_evidence })
    }

    /// Weighted sum of squares that coefficients leave on one block.
    pub(crate) fn error(&self, weights: &[f64], block: usize, x: &DVector<f64>) -> f64 {
        self.joint_errors(block, x).iter().zip(weights).map(|(e, w)| e * w).sum()
    }

    /// Sum of squares that coefficients leave on one block, each joint.
    pub(crate) fn joint_errors(&self, block: usize, x: &DVector<f64>) -> Vec<f64> {
        self.cells[block].iter().map(|c| c.yy - 2.0 * c.dy.dot(x) + x.dot(&(&c.dd * x))).collect()
    }
}

/// A candidate's sums over blocks.
pub(crate) struct CandidateSums {
    cd: DMatrix<f64>,
    cc: DMatrix<f64>,
    cy: DVector<f64>,
}

/// Sums over the blocks that are kept; none for a candidate that is nothing.
pub(crate) fn candidate_sums(
    cells: &[CandidateCell],
    weights: &[f64],
    keep: impl Fn(usize) -> bool,
) -> Option<CandidateSums> {
    let first = cells.first()?;
    let (c, k) = first.cd.shape();
    let mut sums = CandidateSums { cd: DMatrix::zeros(c, k), cc: DMatrix::zeros(c, c), cy: DVector::zeros(c) };
    for cell in cells.iter().filter(|cell| keep(cell.block)) {
        let w = weights[cell.joint];
        sums.cd.zip_apply(&cell.cd, |s, v| *s += w * v);
        sums.cc.zip_apply(&cell.cc, |s, v| *s += w * v);
        sums.cy.axpy(w, &cell.cy, 1.0);
    }
    Some(sums)
}

impl Solved {
    /// Standard deviation of each coefficient: roots of the diagonal of `A⁻¹ = L⁻ᵀL⁻¹`.
    pub(crate) fn deviations(&self) -> Vec<f64> {
        self.factor.inverse().diagonal().iter().map(|v| v.max(0.0).sqrt()).collect()
    }

    /// Covariance of the first `columns` coefficients.
    pub(crate) fn covariance(&self, columns: usize) -> Option<DMatrix<f64>> {
        let all = self.factor.inverse();
        (all.nrows() >= columns).then(|| all.view((0, 0), (columns, columns)).into_owned())
    }

    /// Weighted sum of squares that the background leaves of a candidate's torque with coefficients `c`.
    pub(crate) fn own(&self, sums: &CandidateSums, c: &DVector<f64>) -> Option<f64> {
        Some(c.dot(&(&sums.cc * c)) - self.explained(sums, c)?.norm_squared())
    }

    /// `L⁻¹DᵀCc`: its square is what the background explains of a candidate's torque.
    pub(crate) fn explained(&self, sums: &CandidateSums, c: &DVector<f64>) -> Option<DVector<f64>> {
        self.factor.l_dirty().solve_lower_triangular(&sums.cd.tr_mul(c))
    }

    /// Adds a candidate's columns.
    pub(crate) fn add(
        &self,
        cells: &[CandidateCell],
        belief: &Belief,
        weights: &[f64],
        keep: impl Fn(usize) -> bool,
    ) -> Option<Added> {
        self.add_sums(&candidate_sums(cells, weights, keep)?, belief)
    }

    /// As [`add`](Self::add), of sums made before.
    pub(crate) fn add_sums(&self, sums: &CandidateSums, belief: &Belief) -> Option<Added> {
        let v = self.factor.l_dirty().solve_lower_triangular(&sums.cd.transpose())?;
        let m = &belief.mean;
        // With the mean m taken out of y: b − Dᵀc·m, cᵀ(y − c·m).
        let forward = &self.forward - &v * m;
        let cy = &sums.cy - &sums.cc * m;
        let mut s = &sums.cc - v.tr_mul(&v);
        for (i, std) in belief.std.iter().enumerate() {
            s[(i, i)] += 1.0 / (std * std);
        }
        let r = &cy - v.tr_mul(&forward);
        let factor = Cholesky::new(s)?;
        let deviation = factor.solve(&r);
        let half_log_det: f64 = factor.l_dirty().diagonal().iter().map(|l| l.ln()).sum();
        let log_prior: f64 = belief.std.iter().map(|p| p.ln()).sum();
        let mean_cost = m.dot(&(&sums.cc * m)) - 2.0 * m.dot(&sums.cy);
        let log_evidence = self.log_evidence - 0.5 * mean_cost
            + 0.5 * (forward.norm_squared() - self.forward.norm_squared())
            + 0.5 * r.dot(&deviation)
            - half_log_det
            - log_prior;
        let c = deviation + m;
        // x = A⁻¹(b − Dᵀc) = L⁻ᵀ(L⁻¹b − v c)
        let x = self.factor.l_dirty().tr_solve_lower_triangular(&(&self.forward - &v * &c))?;
        Some(Added { c, x, log_evidence })
    }
}

/// Sum of squares that background and candidate leave together on one block, each joint.
pub(crate) fn joint_errors_with(
    background: &Background,
    cells: &[CandidateCell],
    block: usize,
    added: &Added,
) -> Vec<f64> {
    let mut errors = background.joint_errors(block, &added.x);
    for cell in cells.iter().filter(|cell| cell.block == block) {
        let cross = added.c.dot(&(&cell.cd * &added.x));
        let own = added.c.dot(&(&cell.cc * &added.c));
        errors[cell.joint] += own + 2.0 * cross - 2.0 * added.c.dot(&cell.cy);
    }
    errors
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two columns and a candidate over three blocks of one joint; torque from `truth`.
    fn example(truth: [f64; 3]) -> (Background, Vec<CandidateCell>) {
        let mut cells = Vec::new();
        let mut own = Vec::new();
        for block in 0..3 {
            let rows = 40;
            let at = |k: usize| (block * rows + k) as f64 * 0.1;
            let d = DMatrix::from_fn(rows, 2, |k, c| if c == 0 { at(k).sin() } else { (1.7 * at(k)).cos() });
            let c = DMatrix::from_fn(1, rows, |_, k| (0.6 * at(k)).sin());
            let y = &d * DVector::from_column_slice(&truth[..2]) + c.transpose() * DVector::from_element(1, truth[2]);
            cells.push(vec![Cell { dd: d.transpose() * &d, dy: d.transpose() * &y, yy: y.norm_squared(), rows: 40.0 }]);
            own.push(CandidateCell { block, joint: 0, cd: &c * &d, cc: &c * c.transpose(), cy: &c * &y });
        }
        let background = Background { cells, std: DVector::from_element(2, 10.0), scaled: vec![true, false] };
        (background, own)
    }

    fn belief() -> Belief {
        Belief { mean: DVector::zeros(1), std: DVector::from_element(1, 10.0) }
    }

    /// The bordered solution must be that of all columns at once.
    #[test]
    fn a_candidate_on_top_equals_a_fit_of_everything() {
        let (background, own) = example([1.0, -2.0, 0.5]);
        let (weights, scale) = ([4.0], 0.5);
        let added = background
            .solve(&weights, scale, 0..3)
            .and_then(|s| s.add(&own, &belief(), &weights, |_| true))
            .expect("well conditioned");
        let mut whole = background.clone();
        whole.std = DVector::from_column_slice(&[10.0, 10.0, 10.0]);
        whole.scaled = vec![true, false, false];
        for (cell, c) in whole.cells.iter_mut().zip(&own) {
            let old = &cell[0];
            let dd = DMatrix::from_fn(3, 3, |i, j| match (i, j) {
                (2, 2) => c.cc[(0, 0)],
                (2, j) => c.cd[(0, j)],
                (i, 2) => c.cd[(0, i)],
                (i, j) => old.dd[(i, j)],
            });
            let dy = DVector::from_fn(3, |i, _| if i == 2 { c.cy[0] } else { old.dy[i] });
            cell[0] = Cell { dd, dy, yy: old.yy, rows: old.rows };
        }
        let at_once = whole.solve(&weights, scale, 0..3).expect("well conditioned");
        assert!((at_once.log_evidence - added.log_evidence).abs() < 1e-8);
        assert!((at_once.x[2] - added.c[0]).abs() < 1e-10);
        assert!((at_once.x.rows(0, 2) - &added.x).norm() < 1e-10);
        let errors: f64 = (0..3).map(|b| joint_errors_with(&background, &own, b, &added)[0]).sum();
        let direct: f64 = (0..3).map(|b| whole.joint_errors(b, &at_once.x)[0]).sum();
        assert!((errors - direct).abs() < 1e-9, "{errors} {direct}");
    }

    #[test]
    fn evidence_prefers_what_is_there_and_only_that() {
        for (coefficient, better) in [(0.5, true), (0.0, false)] {
            let (background, own) = example([1.0, -2.0, coefficient]);
            let solved = background.solve(&[4.0], 1.0, 0..3).expect("well conditioned");
            let added = solved.add(&own, &belief(), &[4.0], |_| true).expect("well conditioned");
            assert_eq!(added.log_evidence > solved.log_evidence, better, "coefficient {coefficient}");
        }
    }

    /// A coefficient that is known to be 1 costs nothing to use when it is.
    #[test]
    fn a_known_gain_beats_a_free_one() {
        let (background, own) = example([1.0, -2.0, 1.0]);
        let solved = background.solve(&[4.0], 1.0, 0..3).expect("well conditioned");
        let known = Belief { mean: DVector::from_element(1, 1.0), std: DVector::from_element(1, 0.1) };
        let free = solved.add(&own, &belief(), &[4.0], |_| true).expect("well conditioned");
        let fixed = solved.add(&own, &known, &[4.0], |_| true).expect("well conditioned");
        assert!(fixed.log_evidence > free.log_evidence);
        assert!((fixed.c[0] - 1.0).abs() < 1e-3 && (free.c[0] - 1.0).abs() < 1e-3);
    }
}
