//! The equations of all runs: columns of the background, the torque that the nominal model leaves, weights and blocks.

use std::ops::Range;

use nalgebra::{DMatrix, DVector};
use rivet_dynamics::Parameter;

use crate::effects::Form;
use crate::fit::evidence::Background;
use crate::model::nominal::Nominal;
use crate::model::rows::Column;
use crate::screen::prepared::Prepared;

/// Length of a block \[s\]: some ten times the correlation of residuals ...
const BLOCK_S: f64 = 2.5;
/// ... and shorter on short runs: held-out blocks need this many.
const MIN_FOLD_BLOCKS: f64 = 8.0;
/// A stretch of rows of one run.
#[derive(Clone, Debug)]
pub(crate) struct Block {
    pub(crate) run: usize,
    pub(crate) rows: Range<usize>,
}

/// Columns of an adopted effect that were taken out of a design.
pub(crate) struct TakenOut {
    place: usize,
    /// Of each joint of each run.
    columns: Vec<DMatrix<f64>>,
    /// The left-hand side as it was.
    y: Vec<Vec<DVector<f64>>>,
}

/// The equations of several runs.
pub(crate) struct Design {
    /// `d[run][joint]`: rows x columns, each row times the root of its weight.
    pub(crate) d: Vec<Vec<DMatrix<f64>>>,
    /// Likewise the torque that the nominal model leaves.
    pub(crate) y: Vec<Vec<DVector<f64>>>,
    /// Root of each row's weight, `[run][joint][row]`.
    pub(crate) root: Vec<Vec<Vec<f64>>>,
    /// Columns that are not nothing, `[run][joint]`: a joint does not feel the links before it, nor others' friction.
    pub(crate) present: Vec<Vec<Vec<usize>>>,
    pub(crate) blocks: Vec<Block>,
    pub(crate) background: Background,
}

impl Design {
    /// `noise`: torque noise of each joint \[N·m\], to weigh doubt by. `extra[run]`: further columns with their prior
    /// standard deviations, such as timing.
    pub(crate) fn new(
        runs: &[&Prepared],
        nominal: &Nominal,
        noise: &[f64],
        extra: &[Vec<Column>],
        extra_std: &[f64],
    ) -> Design {
        let n = noise.len();
        let k = nominal.x.len() + extra_std.len();
        let mut design = Design {
            d: Vec::new(),
            y: Vec::new(),
            root: Vec::new(),
            present: Vec::new(),
            blocks: Vec::new(),
            background: Background {
                cells: Vec::new(),
                folds: Vec::new(),
                local: Vec::new(),
                std: DVector::from_iterator(k, nominal.std.iter().chain(extra_std).copied()),
                scaled: nominal
                    .model
                    .parameters
                    .iter()
                    .zip(&nominal.x)
                    .map(|(p, x)| match p {
                        Parameter::Link { .. } => true,
                        Parameter::Offset(_) => false,
                        // What the file gives as 0 was not measured badly, but not at all.
                        _ => *x != 0.0,
                    })
                    .chain(extra_std.iter().map(|_| false))
                    .collect(),
            },
        };
        let seconds: f64 = runs.iter().map(|r| r.run.seconds()).sum();
        let block_s = BLOCK_S.min(seconds / MIN_FOLD_BLOCKS);
        for (r, run) in runs.iter().enumerate() {
            let rows = run.rows();
            let root: Vec<Vec<f64>> = (0..n).map(|j| run.roots(j, noise[j])).collect();
            let mut d = Vec::with_capacity(n);
            let mut y = Vec::with_capacity(n);
            for j in 0..n {
                let mut matrix = DMatrix::zeros(rows, k);
                let mut torque = DVector::from_column_slice(&run.tau[j]);
                if let Some(known) = run.known_rows.get(j) {
                    torque.iter_mut().zip(known).for_each(|(l, k)| *l -= k);
                }
                for (c, column) in run.standard.iter().chain(&extra[r]).enumerate() {
                    let Some(values) = &column[j] else { continue };
                    for (row, value) in values.iter().enumerate() {
                        matrix[(row, c)] = value * root[j][row];
                    }
                    if let Some(x) = nominal.x.get(c) {
                        torque.iter_mut().zip(values).for_each(|(l, v)| *l -= v * x);
                    }
                }
                torque.iter_mut().zip(&root[j]).for_each(|(l, w)| *l *= w);
                d.push(matrix);
                y.push(torque);
            }
            let length = (block_s / run.chain.row_period_s).round().max(1.0) as usize;
            let count = (rows / length).max(1);
            design.blocks.extend((0..count).map(|b| Block { run: r, rows: b * rows / count..(b + 1) * rows / count }));
            design.d.push(d);
            design.y.push(y);
            design.root.push(root);
        }
        design.multiply();
        design
    }

    /// Weighs rows in doubt anew, against other torque noise of each joint \[N·m\].
    pub(crate) fn weigh_doubt(&mut self, runs: &[&Prepared], noise: &[f64]) {
        for (r, run) in runs.iter().enumerate() {
            for j in (0..noise.len()).filter(|j| run.silent[*j].is_none()) {
                let root = run.roots(j, noise[j]);
                let (d, y) = (&mut self.d[r][j], &mut self.y[r][j]);
                for (row, (new, old)) in root.iter().zip(&self.root[r][j]).enumerate() {
                    let factor = new / old;
                    d.row_mut(row).scale_mut(factor);
                    y[row] *= factor;
                }
                self.root[r][j] = root;
            }
        }
        self.multiply();
    }

    /// Roots of the weights of one joint's rows.
    pub(crate) fn root(&self, run: usize, joint: usize) -> &[f64] {
        &self.root[run][joint]
    }

    /// The left-hand side, to be put back after [`Design::add`].
    pub(crate) fn target(&self) -> Vec<Vec<DVector<f64>>> {
        self.y.clone()
    }

    /// Puts a left-hand side back.
    pub(crate) fn set_target(&mut self, y: Vec<Vec<DVector<f64>>>) {
        self.y = y;
        self.remultiply();
    }

    /// Adds torque \[N·m\], `rows[run][joint][row]`, to the measured one.
    pub(crate) fn add(&mut self, rows: &[Vec<Vec<f64>>]) {
        for ((y, root), rows) in self.y.iter_mut().zip(&self.root).zip(rows) {
            for ((y, root), rows) in y.iter_mut().zip(root).zip(rows) {
                for ((y, w), t) in y.iter_mut().zip(root).zip(rows) {
                    *y += w * t;
                }
            }
        }
        self.remultiply();
    }

    pub(crate) fn joints(&self) -> usize {
        self.root.first().map_or(0, Vec::len)
    }

    /// Torque of the background's stretches \[N·m\] with their coefficients, `[run][joint][row]`.
    pub(crate) fn local_torque(&self, coefficients: &[DVector<f64>]) -> Vec<Vec<Vec<f64>>> {
        let mut torque: Vec<Vec<Vec<f64>>> =
            self.root.iter().map(|run| run.iter().map(|root| vec![0.0; root.len()]).collect()).collect();
        for (stretch, c) in self.background.local.iter().zip(coefficients) {
            for (j, to) in torque[stretch.run].iter_mut().enumerate() {
                to[stretch.rows.clone()].copy_from_slice(&stretch.torque(j, c));
            }
        }
        torque
    }

    /// Makes a candidate part of the background: a mean other than zero moves to the left-hand side.
    pub(crate) fn adopt(&mut self, columns: &[Vec<Column>], mean: &[f64], std: &[f64]) {
        for (r, own) in columns.iter().enumerate() {
            for j in 0..self.joints() {
                let root = &self.root[r][j];
                let rows = root.len();
                let mut matrix = std::mem::replace(&mut self.d[r][j], DMatrix::zeros(0, 0));
                let k = matrix.ncols();
                matrix = matrix.resize_horizontally(k + own.len(), 0.0);
                for (c, column) in own.iter().enumerate() {
                    let Some(values) = &column[j] else { continue };
                    for row in 0..rows {
                        let weighted = values[row] * root[row];
                        matrix[(row, k + c)] = weighted;
                        self.y[r][j][row] -= mean[c] * weighted;
                    }
                }
                self.d[r][j] = matrix;
            }
        }
        let k = self.background.std.len();
        self.background.std = DVector::from_iterator(k + std.len(), self.background.std.iter().chain(std).copied());
        self.background.scaled.extend(std.iter().map(|_| false));
        self.multiply();
    }

    /// Undoes the last [`adopt`](Self::adopt), of as many columns as means.
    pub(crate) fn give_up(&mut self, mean: &[f64]) {
        let k = self.background.std.len() - mean.len();
        for (d, y) in self.d.iter_mut().flatten().zip(self.y.iter_mut().flatten()) {
            for (c, mean) in mean.iter().enumerate() {
                y.axpy(*mean, &d.column(k + c), 1.0);
            }
            *d = std::mem::replace(d, DMatrix::zeros(0, 0)).resize_horizontally(k, 0.0);
        }
        self.background.std = self.background.std.rows(0, k).into_owned();
        self.background.scaled.truncate(k);
        self.multiply();
    }

    /// Undoes an [`adopt`](Self::adopt) before others: the columns from `place` on, as many as means, are nothing from now on.
    pub(crate) fn forget(&mut self, form: &Form, place: usize, mean: &[f64]) {
        if form.has_stretches() {
            self.background.local.clear();
        }
        for (d, y) in self.d.iter_mut().flatten().zip(self.y.iter_mut().flatten()) {
            for (c, mean) in mean.iter().enumerate() {
                let column = d.column(place + c).into_owned();
                y.axpy(*mean, &column, 1.0);
                d.column_mut(place + c).fill(0.0);
            }
        }
        self.multiply();
    }

    /// Takes the columns of an adopted effect without stretches out, as [`forget`](Self::forget) does.
    pub(crate) fn take_out(&mut self, place: usize, mean: &[f64]) -> TakenOut {
        let own = |d: &DMatrix<f64>| d.columns(place, mean.len()).into_owned();
        let taken = TakenOut { place, columns: self.d.iter().flatten().map(own).collect(), y: self.y.clone() };
        for (y, columns) in self.y.iter_mut().flatten().zip(&taken.columns) {
            mean.iter().zip(columns.column_iter()).for_each(|(mean, column)| y.axpy(*mean, &column, 1.0));
        }
        self.d.iter_mut().flatten().for_each(|d| d.columns_mut(place, mean.len()).fill(0.0));
        self.multiply();
        taken
    }

    /// Undoes [`take_out`](Self::take_out), to the bit.
    pub(crate) fn put_back(&mut self, taken: TakenOut) {
        self.y = taken.y;
        for (d, columns) in self.d.iter_mut().flatten().zip(&taken.columns) {
            d.columns_mut(taken.place, columns.ncols()).copy_from(columns);
        }
        self.multiply();
    }

    /// Weighted residual of coefficients and of those of stretches, `[run][joint]`.
    pub(crate) fn residuals(&self, x: &DVector<f64>, stretches: &[DVector<f64>]) -> Vec<Vec<DVector<f64>>> {
        let run_residuals =
            |d: &Vec<DMatrix<f64>>, y: &Vec<DVector<f64>>| d.iter().zip(y).map(|(d, y)| y - d * x).collect();
        let mut all: Vec<Vec<DVector<f64>>> = self.d.iter().zip(&self.y).map(|(d, y)| run_residuals(d, y)).collect();
        for (stretch, c) in self.background.local.iter().zip(stretches) {
            for (j, left) in all[stretch.run].iter_mut().enumerate() {
                let root = &self.root[stretch.run][j];
                for (k, torque) in stretch.rows.clone().zip(stretch.torque(j, c)) {
                    left[k] -= root[k] * torque;
                }
            }
        }
        all
    }
}

/// Roots of rows' weights: one over the standard deviation of noise and doubt together, in units of the noise.
fn doubt_weights(doubt: &[f64], noise: f64) -> Vec<f64> {
    doubt.iter().map(|u| 1.0 / (1.0 + (u / noise).powi(2)).sqrt()).collect()
}

impl Prepared {
    /// Roots of the weights of joint `j`'s rows at a torque noise \[N·m\]; nothing where its torque says nothing.
    fn roots(&self, j: usize, noise: f64) -> Vec<f64> {
        if self.silent[j].is_some() { vec![0.0; self.rows()] } else { doubt_weights(&self.doubt[j], noise) }
    }
}
