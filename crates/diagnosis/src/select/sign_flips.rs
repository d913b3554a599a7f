//! Permutation test: how often chance shows an effect as strong as the strongest, by sign flips of whole blocks.
//!
//! Without any effect the residual of a block may as well have had the other sign, however coloured it is inside the block.
//! So the scores of every candidate are taken block by block, the background's part of them out, and summed with drawn
//! signs; each draw keeps the largest over all candidates (Westfall and Young's single-step max-T), which makes the
//! figure hold for the whole family of candidates of a round, not for one of them.
//!
//! ```text
//! u_b = Σ_j w_j C_bᵀ r_b − C D A⁻¹ Σ_j w_j D_bᵀ r_b,   S = CᵀwC − CᵀwD A⁻¹ DᵀwC + diag(1/p²) = L Lᵀ,   z_b = L⁻¹ u_b
//! T = |Σ_b z_b|²,   T* = |Σ_b s_b z_b|²,  s_b = ±1 drawn,   p = (1 + #{max T* >= T}) / (1 + draws)
//! ```
//!
//! T is not divided by its mean over the draws, as is sometimes done: with an effect that is as large in every block that
//! quotient is the number of blocks, which runs of half a minute do not have enough of. The weights w count the residual's
//! correlation, so T is of one size over joints as it is.
//!
//! Forms whose numbers were looked for in this very residual, orders of ripple say, come as they were found: their figure
//! is a little too small. One that the values of the background imitate leaves little score: its figure may be large while
//! what is believed of the values decides.

use nalgebra::{Cholesky, DMatrix, DVector};

use crate::fit::design::Block;
use crate::fit::evidence::Solved;
use crate::fit::search::{Candidate, Scores, Search, Standing};
use crate::model::rows::Column;
use crate::numerics::parallel;
use crate::numerics::random::Random;
use crate::screen::prepared::Prepared;

/// Draws of signs.
const DRAWS: usize = 199;

/// The runs are cut into so many blocks ...
const BLOCKS: f64 = 32.0;
/// ... of so long \[s\].
const LENGTHS_S: (f64, f64) = (0.5, 2.5);

/// The residual of a search as it stands.
pub(crate) struct Flips {
    solved: Solved,
    blocks: Vec<Block>,
    /// Residual times the weights of its rows and joint, `[run][joint][row]`.
    weighted: Vec<Vec<DVector<f64>>>,
    /// `A⁻¹ Σ_j w_j D_bᵀ r_b`: columns of the background x blocks.
    background: DMatrix<f64>,
    /// `[draw][block]`
    signs: Vec<DVector<f64>>,
}

impl Flips {
    /// None where the equations have no solution.
    pub(crate) fn new(search: &Search<'_>) -> Option<Flips> {
        let solved = search.solved(search.scale)?;
        let design = &search.design;
        let mut weighted = design.residuals(&solved.x, &solved.stretches);
        let seconds: f64 = search.runs.iter().map(|r| r.run.seconds()).sum();
        let length_s = (seconds / BLOCKS).clamp(LENGTHS_S.0, LENGTHS_S.1);
        let cut = |(run, prepared): (usize, &&Prepared)| {
            let rows = prepared.rows();
            let count = (prepared.run.seconds() / length_s).round().max(1.0) as usize;
            (0..count).map(move |b| Block { run, rows: b * rows / count..(b + 1) * rows / count })
        };
        let blocks: Vec<Block> = search.runs.iter().enumerate().flat_map(cut).collect();
        let mut scores = DMatrix::zeros(design.background.len(), blocks.len());
        for (run, own) in weighted.iter_mut().enumerate() {
            for (j, residual) in own.iter_mut().enumerate() {
                *residual *= search.weights[j];
                for (b, block) in blocks.iter().enumerate().filter(|(_, block)| block.run == run) {
                    let (from, len) = (block.rows.start, block.rows.len());
                    let rows = design.d[run][j].rows(from, len);
                    let mut sum = scores.column_mut(b);
                    sum += rows.tr_mul(&residual.rows(from, len));
                }
                residual.iter_mut().zip(design.root(run, j)).for_each(|(r, root)| *r *= root);
            }
        }
        let background = solved.solve(&scores);
        let mut random = Random::new();
        let mut draw = || DVector::from_fn(blocks.len(), |_, _| if random.below(2) == 0 { 1.0 } else { -1.0 });
        let signs = (0..DRAWS).map(|_| draw()).collect();
        Some(Flips { solved, blocks, weighted, background, signs })
    }

    /// Scores of a candidate of these columns; none of contact, whose stretches lie in few blocks, and none of a command beyond its limit:
    /// that column is the measured torque with its noise, which is the residual's, so whatever signs are drawn it shows a lot.
    pub(crate) fn scores(&self, search: &Search<'_>, candidate: &Candidate, columns: &[Vec<Column>]) -> Option<Scores> {
        if !candidate.local.is_empty() || candidate.form.effect().about().cuts_command {
            return None;
        }
        let sums = self.solved.sums(&candidate.cells, &search.weights, |_| true)?;
        let mut scores = -(&sums.cd * &self.background);
        for (b, block) in self.blocks.iter().enumerate() {
            for (c, column) in columns[block.run].iter().enumerate() {
                for (values, residual) in column.iter().zip(&self.weighted[block.run]) {
                    let Some(values) = values else { continue };
                    let rows = values[block.rows.clone()].iter().zip(&residual.as_slice()[block.rows.clone()]);
                    scores[(c, b)] += rows.map(|(v, r)| v * r).sum::<f64>();
                }
            }
        }
        let residual_gram = self.solved.left_of(&sums, &candidate.belief)?;
        Cholesky::new(residual_gram)?.l_dirty().solve_lower_triangular(&scores)
    }

    /// Family-wise chance of each of `listed` among these and all of `candidates`, that have their scores: 1 at most, one over
    /// the draws and one at least; none of contact.
    pub(crate) fn p_values(
        &self,
        search: &Search<'_>,
        listed: &[(Candidate, Standing)],
        candidates: &[Candidate],
    ) -> Vec<Option<f64>> {
        let asked: Vec<Option<Scores>> = listed.iter().map(|(c, _)| self.scores(search, c, &c.columns)).collect();
        let family: Vec<&Scores> =
            asked.iter().flatten().chain(candidates.iter().filter_map(|c| c.scores.as_ref())).collect();
        let most = self.most(&family);
        asked.iter().map(|scores| scores.as_ref().map(|own| chance(own.column_sum().norm_squared(), &most))).collect()
    }

    /// The largest statistic of the family in each draw.
    fn most(&self, family: &[&Scores]) -> Vec<f64> {
        let statistics =
            |scores: &&Scores| -> Vec<f64> { self.signs.iter().map(|s| (*scores * s).norm_squared()).collect() };
        let mut most = vec![0.0_f64; self.signs.len()];
        for drawn in parallel::map(family, statistics) {
            most.iter_mut().zip(&drawn).for_each(|(most, t)| *most = most.max(*t));
        }
        most
    }
}

/// Share of the draws that reach `t`, what is seen counted as one of them.
fn chance(t: f64, most: &[f64]) -> f64 {
    let reached = most.iter().filter(|most| **most >= t).count();
    (1 + reached) as f64 / (1 + most.len()) as f64
}
