//! Bayesian linear regression on blocks of rows: log evidence of a candidate, and its gain on held-out blocks.
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

use std::sync::Arc;

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use crate::numerics::elimination::{Eliminated, Stretch, eliminated};
use crate::numerics::random::Random;

/// Folds of successive blocks for held-out gains. What a candidate is asked it is asked fold by fold, so that its products
/// are as many for a long log as for a short one.
pub(crate) const FOLDS: usize = 8;

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

/// Products of a candidate's columns over one fold and one joint; absent where they are zero.
#[derive(Clone, Debug)]
pub(crate) struct CandidateCell {
    /// Which fold.
    pub(crate) fold: usize,
    /// Which joint.
    pub(crate) joint: usize,
    /// CᵀD
    pub(crate) cd: DMatrix<f64>,
    /// CᵀC
    pub(crate) cc: DMatrix<f64>,
    /// Cᵀy
    pub(crate) cy: DVector<f64>,
    /// Products of the columns of stretches with C, by place of the stretch.
    pub(crate) cross: Vec<(usize, DMatrix<f64>)>,
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
    /// The same by fold: `folds[fold][joint]`.
    pub(crate) folds: Vec<Vec<Cell>>,
    /// Columns that are nothing outside their stretches of time.
    pub(crate) local: Vec<Stretch>,
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
    /// What columns of stretches cost in log evidence.
    cost: f64,
    local: Arc<Vec<Eliminated>>,
}

/// A background solved for given weights and prior scale.
#[derive(Clone)]
pub(crate) struct Solved {
    factor: Cholesky<f64, Dyn>,
    /// L⁻¹b
    forward: DVector<f64>,
    /// Coefficients.
    pub(crate) x: DVector<f64>,
    /// Those of stretches.
    pub(crate) stretches: Vec<DVector<f64>>,
    local: Arc<Vec<Eliminated>>,
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
    /// Those of stretches, of the candidate's own behind the background's.
    pub(crate) stretches: Vec<DVector<f64>>,
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

    /// Fold of a block.
    pub(crate) fn fold(&self, block: usize) -> usize {
        block * FOLDS / self.blocks()
    }

    /// Sums blocks up to folds.
    pub(crate) fn fold_up(&mut self) {
        let k = self.len();
        let joints = self.cells.first().map_or(0, Vec::len);
        let nothing = Cell { dd: DMatrix::zeros(k, k), dy: DVector::zeros(k), yy: 0.0, rows: 0.0 };
        let mut folds = vec![vec![nothing; joints]; FOLDS];
        for (block, cells) in self.cells.iter().enumerate() {
            for (to, cell) in folds[self.fold(block)].iter_mut().zip(cells) {
                to.dd += &cell.dd;
                to.dy += &cell.dy;
                to.yy += cell.yy;
                to.rows += cell.rows;
            }
        }
        self.folds = folds;
    }

    /// Sums of `cells`; columns of stretches, the background's and `more`, are taken out, a block as often as `times` says.
    fn sums<'a>(
        &'a self,
        weights: &[f64],
        cells: impl Iterator<Item = &'a Vec<Cell>>,
        more: &[Stretch],
        times: impl Fn(usize) -> f64,
    ) -> Option<Sums> {
        let k = self.len();
        let (mut dd, mut dy, mut yy) = (DMatrix::zeros(k, k), DVector::zeros(k), 0.0);
        for cells in cells {
            for (cell, w) in cells.iter().zip(weights) {
                dd.zip_apply(&cell.dd, |s, v| *s += w * v);
                dy.axpy(*w, &cell.dy, 1.0);
                yy += w * cell.yy;
            }
        }
        let local = eliminated(self.local.iter().chain(more), weights, k, times)?;
        let mut cost = 0.0;
        for own in &local {
            dd.gemm_tr(-1.0, &own.v, &own.v, 1.0);
            dy.gemv_tr(-1.0, &own.v, &own.u, 1.0);
            yy -= own.u.norm_squared();
            cost += own.cost;
        }
        Some(Sums { dd, dy, yy, cost, local: Arc::new(local) })
    }

    /// Solves for the blocks chosen, each as often as it is.
    pub(crate) fn solve(&self, weights: &[f64], scale: f64, blocks: &[usize]) -> Option<Solved> {
        let mut times = vec![0.0; self.blocks()];
        for block in blocks {
            times[*block] += 1.0;
        }
        let cells = blocks.iter().map(|b| &self.cells[*b]);
        self.solve_sums(self.sums(weights, cells, &[], |b| times[b])?, scale)
    }

    /// Solves for the folds that are kept, with `more` stretches.
    pub(crate) fn solve_folds(
        &self,
        weights: &[f64],
        scale: f64,
        more: &[Stretch],
        keep: impl Fn(usize) -> bool,
    ) -> Option<Solved> {
        let cells = self.folds.iter().enumerate().filter(|(fold, _)| keep(*fold)).map(|(_, cells)| cells);
        let times = |block: usize| if keep(self.fold(block)) { 1.0 } else { 0.0 };
        self.solve_sums(self.sums(weights, cells, more, times)?, scale)
    }

    /// Solves for all blocks at each of the scales that can be solved, with `more` stretches.
    pub(crate) fn solve_scales(&self, weights: &[f64], scales: &[f64], more: &[Stretch]) -> Vec<(f64, Solved)> {
        let Some(sums) = self.sums(weights, self.folds.iter(), more, |_| 1.0) else { return Vec::new() };
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
        let log_evidence = -0.5 * (sums.yy - forward.norm_squared()) - half_log_det - log_prior - sums.cost;
        let stretches = sums.local.iter().map(|own| own.coefficients(&x, None)).collect();
        Some(Solved { factor, forward, x, stretches, local: sums.local, log_evidence })
    }

    /// Weighted sum of squares that a solution leaves on one block.
    pub(crate) fn error(&self, weights: &[f64], block: usize, solved: &Solved) -> f64 {
        let errors = self.residual_squares(&self.cells[block], &solved.x, &solved.stretches, &[], |b| b == block);
        errors.iter().zip(weights).map(|(e, w)| e * w).sum()
    }

    /// Sum of squares that coefficients leave on one fold, each joint.
    pub(crate) fn fold_errors(&self, fold: usize, solved: &Solved) -> Vec<f64> {
        self.residual_squares(&self.folds[fold], &solved.x, &solved.stretches, &[], |b| self.fold(b) == fold)
    }

    /// The same with a candidate: its cells and its stretches.
    pub(crate) fn fold_errors_with(
        &self,
        cells: &[CandidateCell],
        more: &[Stretch],
        fold: usize,
        added: &Added,
    ) -> Vec<f64> {
        let mut errors =
            self.residual_squares(&self.folds[fold], &added.x, &added.stretches, more, |b| self.fold(b) == fold);
        for cell in cells.iter().filter(|cell| cell.fold == fold) {
            let cross = added.c.dot(&(&cell.cd * &added.x));
            let candidate_square = added.c.dot(&(&cell.cc * &added.c));
            let local: f64 = cell.cross.iter().map(|(at, p)| added.stretches[*at].dot(&(p * &added.c))).sum();
            errors[cell.joint] += candidate_square + 2.0 * (cross + local) - 2.0 * added.c.dot(&cell.cy);
        }
        errors
    }

    fn residual_squares(
        &self,
        cells: &[Cell],
        x: &DVector<f64>,
        stretches: &[DVector<f64>],
        more: &[Stretch],
        inside: impl Fn(usize) -> bool,
    ) -> Vec<f64> {
        let mut errors: Vec<f64> = cells.iter().map(|c| c.yy - 2.0 * c.dy.dot(x) + x.dot(&(&c.dd * x))).collect();
        for (stretch, c) in self.local.iter().chain(more).zip(stretches) {
            for cell in stretch.cells.iter().filter(|cell| inside(cell.block)) {
                errors[cell.joint] += c.dot(&(&cell.cc * c)) + 2.0 * c.dot(&(&cell.cd * x)) - 2.0 * c.dot(&cell.cy);
            }
        }
        errors
    }
}

/// A candidate's sums over folds, what columns of stretches explain taken out.
pub(crate) struct CandidateSums {
    pub(crate) cd: DMatrix<f64>,
    cc: DMatrix<f64>,
    cy: DVector<f64>,
    /// L⁻¹ of each stretch times the products of its columns with the candidate's.
    cross: Vec<Option<DMatrix<f64>>>,
}

/// Products of a whole candidate with the background alone: enough for [`Solved::explained`].
impl From<DMatrix<f64>> for CandidateSums {
    fn from(cd: DMatrix<f64>) -> CandidateSums {
        let c = cd.nrows();
        CandidateSums { cd, cc: DMatrix::zeros(c, c), cy: DVector::zeros(c), cross: Vec::new() }
    }
}

impl Solved {
    /// A candidate's sums over the folds that are kept, those that this was solved with; none for one that is nothing.
    pub(crate) fn sums(
        &self,
        cells: &[CandidateCell],
        weights: &[f64],
        keep: impl Fn(usize) -> bool,
    ) -> Option<CandidateSums> {
        let first = cells.first()?;
        let (c, k) = first.cd.shape();
        let (mut cd, mut cc, mut cy) = (DMatrix::zeros(c, k), DMatrix::zeros(c, c), DVector::zeros(c));
        let mut cross: Vec<Option<DMatrix<f64>>> = vec![None; self.local.len()];
        for cell in cells.iter().filter(|cell| keep(cell.fold)) {
            let w = weights[cell.joint];
            cd.zip_apply(&cell.cd, |s, v| *s += w * v);
            cc.zip_apply(&cell.cc, |s, v| *s += w * v);
            cy.axpy(w, &cell.cy, 1.0);
            for (at, products) in &cell.cross {
                let sum = cross[*at].get_or_insert_with(|| DMatrix::zeros(products.nrows(), c));
                sum.zip_apply(products, |s, v| *s += w * v);
            }
        }
        for (cross, own) in cross.iter_mut().zip(self.local.iter()) {
            let Some(cross) = cross else { continue };
            own.halve(cross);
            cd.gemm_tr(-1.0, cross, &own.v, 1.0);
            cc.gemm_tr(-1.0, cross, cross, 1.0);
            cy.gemv_tr(-1.0, cross, &own.u, 1.0);
        }
        Some(CandidateSums { cd, cc, cy, cross })
    }

    /// `A⁻¹` times each column.
    pub(crate) fn solve(&self, columns: &DMatrix<f64>) -> DMatrix<f64> {
        self.factor.solve(columns)
    }

    /// Information of a candidate's coefficients that the background leaves, what is believed of them with it.
    pub(crate) fn left_of(&self, sums: &CandidateSums, belief: &Belief) -> Option<DMatrix<f64>> {
        let v = self.factor.l_dirty().solve_lower_triangular(&sums.cd.transpose())?;
        let mut s = &sums.cc - v.tr_mul(&v);
        for (i, std) in belief.std.iter().enumerate() {
            s[(i, i)] += 1.0 / (std * std);
        }
        Some(s)
    }

    /// Standard deviation of each coefficient: roots of the diagonal of `A⁻¹ = L⁻ᵀL⁻¹`.
    pub(crate) fn deviations(&self) -> Vec<f64> {
        self.factor.inverse().diagonal().iter().map(|v| v.max(0.0).sqrt()).collect()
    }

    /// Draws of deviations from the coefficients: `L⁻ᵀz`, z standard normal, whose covariance is `A⁻¹`.
    pub(crate) fn deviations_drawn(&self, count: usize) -> Vec<DVector<f64>> {
        let mut random = Random::new();
        let mut one = || {
            let z = DVector::from_fn(self.x.len(), |_, _| random.normal());
            self.factor.l_dirty().tr_solve_lower_triangular(&z)
        };
        (0..count).filter_map(|_| one()).collect()
    }

    /// Covariance of the first `columns` coefficients.
    pub(crate) fn covariance(&self, columns: usize) -> Option<DMatrix<f64>> {
        let all = self.factor.inverse();
        (all.nrows() >= columns).then(|| all.view((0, 0), (columns, columns)).into_owned())
    }

    /// Weighted sum of squares that the background leaves of a candidate's torque with coefficients `c`.
    pub(crate) fn remaining_square(&self, sums: &CandidateSums, c: &DVector<f64>) -> Option<f64> {
        Some(c.dot(&(&sums.cc * c)) - self.through(sums, c)?.norm_squared())
    }

    /// `L⁻¹DᵀCc`, of stretches as well: its square is what the background explains of a candidate's torque.
    pub(crate) fn explained(&self, sums: &CandidateSums, c: &DVector<f64>) -> Option<DVector<f64>> {
        let mut all = self.through(sums, c)?.as_slice().to_vec();
        for (at, own) in self.local.iter().enumerate() {
            match sums.cross.get(at).and_then(Option::as_ref) {
                Some(cross) => all.extend((cross * c).iter()),
                None => all.resize(all.len() + own.u.len(), 0.0),
            }
        }
        Some(DVector::from_vec(all))
    }

    fn through(&self, sums: &CandidateSums, c: &DVector<f64>) -> Option<DVector<f64>> {
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
        self.add_sums(&self.sums(cells, weights, keep)?, belief)
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
        let stretches = self.stretches_beside(&x, Some((sums, &c)));
        Some(Added { c, x, stretches, log_evidence })
    }

    /// Coefficients of stretches beside others than those that were solved for, and beside a candidate of these sums.
    pub(crate) fn stretches_beside(
        &self,
        x: &DVector<f64>,
        candidate: Option<(&CandidateSums, &DVector<f64>)>,
    ) -> Vec<DVector<f64>> {
        let candidate_torque = |at: usize| candidate.and_then(|(sums, c)| Some(sums.cross.get(at)?.as_ref()? * c));
        self.local.iter().enumerate().map(|(at, own)| own.coefficients(x, candidate_torque(at).as_ref())).collect()
    }

    /// As a candidate whose stretches this was solved with, behind the `before` of the background.
    pub(crate) fn with_stretches(&self, before: usize) -> Added {
        let coefficients = self.stretches[before..].iter().flat_map(|c| c.iter().copied());
        Added {
            c: DVector::from_iterator(self.stretches[before..].iter().map(DVector::len).sum(), coefficients),
            x: self.x.clone(),
            stretches: self.stretches.clone(),
            log_evidence: self.log_evidence,
        }
    }
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
            let (cd, cc, cy) = (&c * &d, &c * c.transpose(), &c * &y);
            own.push(CandidateCell { fold: block * FOLDS / 3, joint: 0, cd, cc, cy, cross: Vec::new() });
        }
        let (std, scaled) = (DVector::from_element(2, 10.0), vec![true, false]);
        let mut background = Background { cells, folds: Vec::new(), local: Vec::new(), std, scaled };
        background.fold_up();
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
            .solve(&weights, scale, &[0, 1, 2])
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
        whole.fold_up();
        let at_once = whole.solve(&weights, scale, &[0, 1, 2]).expect("well conditioned");
        assert!((at_once.log_evidence - added.log_evidence).abs() < 1e-8);
        assert!((at_once.x[2] - added.c[0]).abs() < 1e-10);
        assert!((at_once.x.rows(0, 2) - &added.x).norm() < 1e-10);
        let errors: f64 = (0..FOLDS).map(|f| background.fold_errors_with(&own, &[], f, &added)[0]).sum();
        let direct: f64 = (0..FOLDS).map(|f| whole.fold_errors(f, &at_once)[0]).sum();
        assert!((errors - direct).abs() < 1e-9, "{errors} {direct}");
    }

    #[test]
    fn evidence_prefers_what_is_there_and_only_that() {
        for (coefficient, better) in [(0.5, true), (0.0, false)] {
            let (background, own) = example([1.0, -2.0, coefficient]);
            let solved = background.solve(&[4.0], 1.0, &[0, 1, 2]).expect("well conditioned");
            let added = solved.add(&own, &belief(), &[4.0], |_| true).expect("well conditioned");
            assert_eq!(added.log_evidence > solved.log_evidence, better, "coefficient {coefficient}");
        }
    }

    /// A coefficient that is known to be 1 costs nothing to use when it is.
    #[test]
    fn a_known_gain_beats_a_free_one() {
        let (background, own) = example([1.0, -2.0, 1.0]);
        let solved = background.solve(&[4.0], 1.0, &[0, 1, 2]).expect("well conditioned");
        let known = Belief { mean: DVector::from_element(1, 1.0), std: DVector::from_element(1, 0.1) };
        let free = solved.add(&own, &belief(), &[4.0], |_| true).expect("well conditioned");
        let fixed = solved.add(&own, &known, &[4.0], |_| true).expect("well conditioned");
        assert!(fixed.log_evidence > free.log_evidence);
        assert!((fixed.c[0] - 1.0).abs() < 1e-3 && (free.c[0] - 1.0).abs() < 1e-3);
    }
}
