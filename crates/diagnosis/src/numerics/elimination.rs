//! Elimination of columns that are zero outside one stretch of time, such as contact.
//!
//! Their number grows with the log, so they are solved for stretch by stretch before all others.
//!
//! ```text
//! y = D x + Σ_g C_g c_g + e,   c_g ~ N(0, diag(p²)),   no two stretches share a row
//! M_g = Σ w C_gᵀC_g + diag(1/p²) = L Lᵀ,   V = L⁻¹ Σ w C_gᵀD,   u = L⁻¹ Σ w C_gᵀy
//! A = Σ w DᵀD − Σ_g VᵀV,   b = Σ w Dᵀy − Σ_g Vᵀu,   c_g = L⁻ᵀ(u − V x)
//! ```
//!
//! Exact, and linear in the number of stretches; all of them in one matrix would cost the cube.

use std::ops::Range;

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Columns of one stretch of one run.
#[derive(Clone, Debug)]
pub(crate) struct Stretch {
    pub(crate) run: usize,
    /// Rows of the run.
    pub(crate) rows: Range<usize>,
    /// `[column][joint][row of the stretch]`
    pub(crate) columns: Vec<Vec<Vec<f64>>>,
    /// Prior standard deviation of each column.
    pub(crate) std: DVector<f64>,
    pub(crate) cells: Vec<StretchCell>,
}

/// Products of a stretch's columns over one block and one joint.
#[derive(Clone, Debug)]
pub(crate) struct StretchCell {
    pub(crate) block: usize,
    pub(crate) joint: usize,
    /// CᵀD
    pub(crate) cd: DMatrix<f64>,
    /// CᵀC
    pub(crate) cc: DMatrix<f64>,
    /// Cᵀy
    pub(crate) cy: DVector<f64>,
}

/// A stretch that was solved for.
#[derive(Clone, Debug)]
pub(crate) struct Eliminated {
    factor: Cholesky<f64, Dyn>,
    /// V
    pub(crate) v: DMatrix<f64>,
    /// u
    pub(crate) u: DVector<f64>,
    /// ½ log det M + Σ log p
    pub(crate) cost: f64,
}

/// Stretches over blocks that count so many times; none where one cannot be solved. `width`: columns of D.
pub(crate) fn eliminated<'a>(
    stretches: impl Iterator<Item = &'a Stretch>,
    weights: &[f64],
    width: usize,
    times: impl Fn(usize) -> f64,
) -> Option<Vec<Eliminated>> {
    stretches
        .map(|stretch| {
            let c = stretch.std.len();
            let mut m = DMatrix::from_diagonal(&stretch.std.map(|p| 1.0 / (p * p)));
            let (mut v, mut u) = (DMatrix::zeros(c, width), DVector::zeros(c));
            for cell in &stretch.cells {
                let w = weights[cell.joint] * times(cell.block);
                if w > 0.0 {
                    m.zip_apply(&cell.cc, |s, p| *s += w * p);
                    v.zip_apply(&cell.cd, |s, p| *s += w * p);
                    u.axpy(w, &cell.cy, 1.0);
                }
            }
            let factor = Cholesky::new(m)?;
            let half = factor.l_dirty();
            half.solve_lower_triangular_mut(&mut v);
            half.solve_lower_triangular_mut(&mut u);
            let cost = half.diagonal().iter().chain(stretch.std.iter()).map(|l| l.ln()).sum();
            Some(Eliminated { factor, v, u, cost })
        })
        .collect()
}

impl Eliminated {
    /// L⁻¹ of products with the stretch's columns.
    pub(crate) fn halve(&self, products: &mut DMatrix<f64>) {
        self.factor.l_dirty().solve_lower_triangular_mut(products);
    }

    /// Coefficients beside `x`, and beside a candidate whose [halved](Self::halve) products times its coefficients are
    /// `with`.
    pub(crate) fn coefficients(&self, x: &DVector<f64>, with: Option<&DVector<f64>>) -> DVector<f64> {
        let mut c = &self.u - &self.v * x;
        if let Some(with) = with {
            c -= with;
        }
        self.factor.l_dirty().tr_solve_lower_triangular_mut(&mut c);
        c
    }
}

impl Stretch {
    /// Torque of one joint with coefficients `c` \[N·m\], rows of the stretch.
    pub(crate) fn torque(&self, joint: usize, c: &DVector<f64>) -> Vec<f64> {
        let mut sum = vec![0.0; self.rows.len()];
        for (column, c) in self.columns.iter().zip(c.iter()) {
            sum.iter_mut().zip(&column[joint]).for_each(|(s, v)| *s += c * v);
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::evidence::{Background, Belief, CandidateCell, Cell, FOLDS, Solved};

    const BLOCK: usize = 40;

    /// Rows of two joints, `[joint]`: two columns of the background, two of each of two stretches of which the first crosses
    /// blocks, one of a candidate, torque.
    fn record() -> Vec<[DMatrix<f64>; 4]> {
        let made = |joint: usize| {
            let t = |k: usize| 0.1 * k as f64 + joint as f64;
            let d = DMatrix::from_fn(120, 2, |k, c| if c == 0 { t(k).sin() } else { (1.7 * t(k)).cos() });
            let local = DMatrix::from_fn(120, 4, |k, c| {
                let inside = if c < 2 { (30..55).contains(&k) } else { (80..100).contains(&k) };
                if inside { (0.3 * t(k) + 1.3 * c as f64).cos() } else { 0.0 }
            });
            let candidate = DMatrix::from_fn(120, 1, |k, _| (0.6 * t(k)).sin());
            let noise = DMatrix::from_fn(120, 1, |k, _| 0.05 * (37.0 * t(k) * t(k)).sin());
            let y = &d * DMatrix::from_column_slice(2, 1, &[1.0, -2.0])
                + &local * DMatrix::from_column_slice(4, 1, &[3.0, -1.0, 2.0, 4.0])
                + 0.5 * &candidate
                + noise;
            [d, local, candidate, y]
        };
        vec![made(0), made(1)]
    }

    fn background(columns: &[DMatrix<f64>], y: &[DMatrix<f64>], std: &[f64]) -> Background {
        let cell = |d: &DMatrix<f64>, y: &DMatrix<f64>, b: usize| {
            let (d, y) = (d.rows(b * BLOCK, BLOCK), y.rows(b * BLOCK, BLOCK));
            let dy = (d.transpose() * y).column(0).into_owned();
            Cell { dd: d.transpose() * d, dy, yy: y.norm_squared(), rows: BLOCK as f64 }
        };
        let cells = (0..3).map(|b| columns.iter().zip(y).map(|(d, y)| cell(d, y, b)).collect()).collect();
        let (std, scaled) = (DVector::from_column_slice(std), vec![false; std.len()]);
        let mut background = Background { cells, folds: Vec::new(), local: Vec::new(), std, scaled };
        background.fold_up();
        background
    }

    /// Solved for beforehand they must be what they are in one matrix with all others, fold for fold.
    #[test]
    fn stretches_are_solved_for_exactly() {
        let record = record();
        let [d, local, candidate, y] = [0, 1, 2, 3].map(|i| record.iter().map(|r| r[i].clone()).collect::<Vec<_>>());
        let weights = [4.0, 9.0];
        let stretch = |columns: Range<usize>, rows: Range<usize>| {
            let mut cells = Vec::new();
            for b in 0..3 {
                for joint in 0..2 {
                    let part = |m: &DMatrix<f64>| m.rows(b * BLOCK, BLOCK).into_owned();
                    let c = part(&local[joint]).columns(columns.start, columns.len()).transpose();
                    let cy = (&c * part(&y[joint])).column(0).into_owned();
                    let (cd, cc) = (&c * part(&d[joint]), &c * c.transpose());
                    if c.norm() > 0.0 {
                        cells.push(StretchCell { block: b, joint, cd, cc, cy });
                    }
                }
            }
            let std = DVector::from_element(columns.len(), 5.0);
            Stretch { run: 0, rows, columns: Vec::new(), std, cells }
        };
        let stretches = [stretch(0..2, 30..55), stretch(2..4, 80..100)];
        let mut cells = Vec::new();
        for b in 0..3 {
            for joint in 0..2 {
                let part = |m: &DMatrix<f64>| m.rows(b * BLOCK, BLOCK).into_owned();
                let c = part(&candidate[joint]).transpose();
                let cross = [0, 2].map(|at| part(&local[joint]).columns(at, 2).transpose() * c.transpose());
                let cy = (&c * part(&y[joint])).column(0).into_owned();
                let (cd, cc) = (&c * part(&d[joint]), &c * c.transpose());
                let cross = cross.into_iter().enumerate().filter(|(_, p)| p.norm() > 0.0).collect();
                cells.push(CandidateCell { fold: b * FOLDS / 3, joint, cd, cc, cy, cross });
            }
        }
        let wide: Vec<DMatrix<f64>> = record
            .iter()
            .map(|[d, local, ..]| DMatrix::from_fn(120, 6, |k, c| if c < 2 { d[(k, c)] } else { local[(k, c - 2)] }))
            .collect();
        let all = background(&wide, &y, &[10.0, 10.0, 5.0, 5.0, 5.0, 5.0]);
        let mut apart = background(&d, &y, &[10.0, 10.0]);
        apart.local = stretches.to_vec();
        let belief = Belief { mean: DVector::from_element(1, 0.2), std: DVector::from_element(1, 3.0) };
        let wide_cells: Vec<CandidateCell> = cells
            .iter()
            .map(|cell| {
                let b = (0..3).find(|b| b * FOLDS / 3 == cell.fold).expect("a fold of a block");
                let whole = wide[cell.joint].rows(b * BLOCK, BLOCK);
                let cd = candidate[cell.joint].rows(b * BLOCK, BLOCK).transpose() * whole;
                CandidateCell { cd, cross: Vec::new(), ..cell.clone() }
            })
            .collect();
        let same = |a: f64, b: f64, what: &str| assert!((a - b).abs() < 1e-8 * (1.0 + b.abs()), "{what}: {a} {b}");
        // All folds, and without the one that the first stretch begins in.
        for left_out in [FOLDS, 0] {
            let keep = |fold: usize| fold != left_out;
            let solve = |b: &Background| b.solve_folds(&weights, 1.0, &[], keep).expect("well conditioned");
            let (one, other) = (solve(&apart), solve(&all));
            same(one.log_evidence, other.log_evidence, "log evidence");
            same((&one.x - other.x.rows(0, 2)).norm(), 0.0, "coefficients");
            let local = |s: &[DVector<f64>]| DVector::from_iterator(4, s.iter().flatten().copied());
            same((local(&one.stretches) - other.x.rows(2, 4)).norm(), 0.0, "coefficients of stretches");
            let add =
                |s: &Solved, cells: &[CandidateCell]| s.add(cells, &belief, &weights, keep).expect("well conditioned");
            let (with, whole) = (add(&one, &cells), add(&other, &wide_cells));
            same(with.log_evidence, whole.log_evidence, "log evidence with the candidate");
            same(with.c[0], whole.c[0], "the candidate");
            same((local(&with.stretches) - whole.x.rows(2, 4)).norm(), 0.0, "coefficients of stretches beside it");
            for fold in 0..FOLDS {
                let (a, b) = (apart.fold_errors(fold, &one), all.fold_errors(fold, &other));
                let (c, d) = (
                    apart.fold_errors_with(&cells, &[], fold, &with),
                    all.fold_errors_with(&wide_cells, &[], fold, &whole),
                );
                (0..2).for_each(|j| same(a[j], b[j], "what is left"));
                (0..2).for_each(|j| same(c[j], d[j], "what is left beside the candidate"));
            }
            let size = |s: &Solved, cells: &[CandidateCell]| {
                let sums = s.sums(cells, &weights, keep).expect("a candidate");
                let c = DVector::from_element(1, 1.5);
                (s.remaining_square(&sums, &c).expect("solvable"), s.explained(&sums, &c).expect("solvable").norm())
            };
            let (a, b) = (size(&one, &cells), size(&other, &wide_cells));
            same(a.0, b.0, "what is the candidate's own");
            same(a.1, b.1, "what is explained of it");
        }
    }
}
