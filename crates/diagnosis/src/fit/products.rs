//! Products of columns: of the background by block, of stretches by block, of candidates by fold.

use std::ops::Range;

use nalgebra::{DMatrix, DVector};

use crate::fit::design::{Block, Design};
use crate::fit::evidence::{CandidateCell, Cell};
use crate::fit::search::Candidate;
use crate::model::rows::Column;
use crate::numerics::elimination::{Stretch, StretchCell};

impl Design {
    pub(crate) fn multiply(&mut self) {
        let cell = |block: &Block, j: usize| {
            let (from, len) = (block.rows.start, block.rows.len());
            let d = self.d[block.run][j].rows(from, len);
            let y = self.y[block.run][j].rows(from, len);
            let transposed = d.transpose();
            Cell { dd: &transposed * d, dy: &transposed * y, yy: y.norm_squared(), rows: len as f64 }
        };
        let present = |d: &DMatrix<f64>| (0..d.ncols()).filter(|c| d.column(*c).iter().any(|v| *v != 0.0)).collect();
        self.present = self.d.iter().map(|run| run.iter().map(present).collect()).collect();
        let cells = self.blocks.iter().map(|b| (0..self.joints()).map(|j| cell(b, j)).collect()).collect();
        self.background.cells = cells;
        self.background.fold_up();
        let mut local = std::mem::take(&mut self.background.local);
        for stretch in &mut local {
            stretch.cells = self.stretch(stretch);
        }
        self.background.local = local;
    }

    /// Products of a stretch's columns, by block and joint.
    pub(crate) fn stretch(&self, stretch: &Stretch) -> Vec<StretchCell> {
        let mut cells = Vec::new();
        for (b, block) in self.blocks.iter().enumerate().filter(|(_, block)| block.run == stretch.run) {
            let (rows, own) = overlap(&stretch.rows, &block.rows);
            if rows.is_empty() {
                continue;
            }
            for joint in 0..self.joints() {
                let root = &self.root[block.run][joint][rows.clone()];
                let columns = stretch.columns.iter().map(|column| Some(weighted(&column[joint][own.clone()], root)));
                let columns: Vec<Option<Vec<f64>>> = columns.collect();
                let count = columns.len();
                let (mut cd, mut cc) = (DMatrix::zeros(count, self.background.std.len()), DMatrix::zeros(count, count));
                let mut cy = DVector::zeros(count);
                self.products(&columns, block.run, joint, &rows, (&mut cd, &mut cc, &mut cy));
                cells.push(StretchCell { block: b, joint, cd, cc, cy });
            }
        }
        cells
    }

    /// Adds products of weighted columns over `rows` to sums.
    fn products(
        &self,
        columns: &[Option<Vec<f64>>],
        run: usize,
        joint: usize,
        rows: &Range<usize>,
        (cd, cc, cy): (&mut DMatrix<f64>, &mut DMatrix<f64>, &mut DVector<f64>),
    ) {
        // Columns lie one behind the other.
        let (d, height) = (self.d[run][joint].as_slice(), self.root[run][joint].len());
        let y = &self.y[run][joint].as_slice()[rows.clone()];
        for (c, column) in columns.iter().enumerate() {
            let Some(column) = column else { continue };
            for k in &self.present[run][joint] {
                cd[(c, *k)] += dot(column, &d[k * height..][rows.clone()]);
            }
            for (other, values) in columns.iter().enumerate().take(c + 1) {
                let product = values.as_ref().map_or(0.0, |values| dot(column, values));
                cc[(c, other)] += product;
                if other < c {
                    cc[(other, c)] += product;
                }
            }
            cy[c] += dot(column, y);
        }
    }

    /// Products of a candidate, `columns[run][column]`.
    pub(crate) fn candidate(&self, columns: &[Vec<Column>]) -> Vec<CandidateCell> {
        let mut cells: Vec<CandidateCell> = Vec::new();
        let count = columns.first().map_or(0, Vec::len);
        for (b, block) in self.blocks.iter().enumerate() {
            let fold = self.background.fold(b);
            for joint in 0..self.joints() {
                let run_columns = &columns[block.run];
                if run_columns.iter().all(|column| column[joint].is_none()) {
                    continue;
                }
                let root = &self.root[block.run][joint][block.rows.clone()];
                let weighted_rows =
                    |column: &Column| Some(weighted(&column[joint].as_ref()?[block.rows.clone()], root));
                let columns: Vec<Option<Vec<f64>>> = run_columns.iter().map(weighted_rows).collect();
                let at = cells.iter().rposition(|cell| (cell.fold, cell.joint) == (fold, joint)).unwrap_or_else(|| {
                    let (cd, cc) = (DMatrix::zeros(count, self.background.std.len()), DMatrix::zeros(count, count));
                    cells.push(CandidateCell { fold, joint, cd, cc, cy: DVector::zeros(count), cross: Vec::new() });
                    cells.len() - 1
                });
                let CandidateCell { cd, cc, cy, cross, .. } = &mut cells[at];
                self.products(&columns, block.run, joint, &block.rows, (cd, cc, cy));
                // Stretches stand in the order of time, and no two share a row.
                let all = &self.background.local;
                let first = all.partition_point(|s| (s.run, s.rows.end) <= (block.run, block.rows.start));
                for (at, stretch) in all.iter().enumerate().skip(first) {
                    let (rows, local) = overlap(&stretch.rows, &block.rows);
                    if stretch.run != block.run || rows.is_empty() {
                        break;
                    }
                    if cross.last().is_none_or(|(last, _)| *last != at) {
                        cross.push((at, DMatrix::zeros(stretch.columns.len(), count)));
                    }
                    let Some((_, sum)) = cross.last_mut() else { continue };
                    let root = &self.root[block.run][joint][rows.clone()];
                    let inside = rows.start - block.rows.start..rows.end - block.rows.start;
                    for (i, run_columns) in stretch.columns.iter().enumerate() {
                        let stretch_values = weighted(&run_columns[joint][local.clone()], root);
                        for (c, column) in columns.iter().enumerate() {
                            let Some(column) = column else { continue };
                            sum[(i, c)] += dot(&stretch_values, &column[inside.clone()]);
                        }
                    }
                }
            }
        }
        cells
    }

    /// Products with the left-hand side anew; those of the columns stay.
    pub(crate) fn remultiply(&mut self) {
        for (block, cells) in self.blocks.iter().zip(&mut self.background.cells) {
            for (j, cell) in cells.iter_mut().enumerate() {
                let (from, len) = (block.rows.start, block.rows.len());
                let y = self.y[block.run][j].rows(from, len);
                cell.dy = self.d[block.run][j].rows(from, len).tr_mul(&y);
                cell.yy = y.norm_squared();
            }
        }
        self.background.fold_up();
        let mut local = std::mem::take(&mut self.background.local);
        self.aim(&mut local);
        self.background.local = local;
    }

    /// A candidate's products with the left-hand side anew.
    pub(crate) fn retarget(&self, candidate: &mut Candidate) {
        for cell in &mut candidate.cells {
            for (c, cy) in cell.cy.iter_mut().enumerate() {
                let blocks = self.blocks.iter().enumerate().filter(|(b, _)| self.background.fold(*b) == cell.fold);
                *cy = blocks
                    .map(|(_, block)| {
                        let Some(values) = &candidate.columns[block.run][c][cell.joint] else { return 0.0 };
                        let (y, root) = (&self.y[block.run][cell.joint], &self.root[block.run][cell.joint]);
                        block.rows.clone().map(|k| values[k] * root[k] * y[k]).sum::<f64>()
                    })
                    .sum();
            }
        }
        self.aim(&mut candidate.local);
    }

    /// Products of stretches with the left-hand side anew.
    fn aim(&self, stretches: &mut [Stretch]) {
        for stretch in stretches {
            for cell in &mut stretch.cells {
                let (rows, own) = overlap(&stretch.rows, &self.blocks[cell.block].rows);
                let y = &self.y[stretch.run][cell.joint].as_slice()[rows.clone()];
                let root = &self.root[stretch.run][cell.joint][rows];
                for (cy, column) in cell.cy.iter_mut().zip(&stretch.columns) {
                    *cy = dot(&weighted(&column[cell.joint][own.clone()], root), y);
                }
            }
        }
    }
}

/// Rows that a stretch and a block share: of the run, and of the stretch.
fn overlap(stretch: &Range<usize>, block: &Range<usize>) -> (Range<usize>, Range<usize>) {
    let rows = stretch.start.max(block.start)..stretch.end.min(block.end);
    let stretch_rows = rows.start.saturating_sub(stretch.start)..rows.end.saturating_sub(stretch.start);
    (rows, stretch_rows)
}

fn weighted(values: &[f64], root: &[f64]) -> Vec<f64> {
    values.iter().zip(root).map(|(v, w)| v * w).collect()
}

/// Sum of products, in lanes that processors add side by side.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    const LANES: usize = 8;
    let mut sums = [0.0; LANES];
    let (left, right) = (a.chunks_exact(LANES), b.chunks_exact(LANES));
    let rest: f64 = left.remainder().iter().zip(right.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in left.zip(right) {
        for lane in 0..LANES {
            sums[lane] += a[lane] * b[lane];
        }
    }
    sums.iter().sum::<f64>() + rest
}
