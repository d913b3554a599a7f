//! Evidence of a cause on torque that was not fitted: log predictive Bayes factors in motion, each side of the logs held out in turn.
//!
//! ```text
//! ln B = Σ_j n_j / (2 κ_j) · ln(s'_j / s_j)
//! n_j     rows of joint j in motion, each weighted by how well the direction of its friction is known
//! κ_j     rows per independent row of the residual, on the logs that were fitted
//! s_j     mean square residual of these rows with all causes, at least that of the noise floor [N²m²]
//! s'_j    the same with the cause left out and everything else refitted
//! ```
//!
//! This is the ratio of two Student-t likelihoods: the scale of what a joint's residual keeps has the prior 1/s. What no model explains
//! counts as noise. Rows at rest hardly count: stiction holds any torque there.

use crate::design::Prepared;
use crate::procedure::Step;
use crate::rows::Column;
use crate::sealed::Sealed;
use crate::search::Search;
use crate::select::{Adopted, LEAST_GAIN};
use crate::stages::RunColumns;

/// Log predictive Bayes factors of one cause.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct BayesFactor {
    /// On the held-out log, with coefficients of the training logs.
    pub(crate) held_out: f64,
    /// On the training logs, with coefficients of the held-out log.
    pub(crate) exchanged: f64,
}

impl BayesFactor {
    /// The two figures of a step in words.
    pub(crate) fn of_step(self, step: &Step) -> String {
        let joints: Vec<String> = step.joints.iter().map(|j| (j + 1).to_string()).collect();
        let (name, joints) = (step.effect.name(), joints.join(" "));
        format!("  {name} {joints}: log Bayes factor {:.0} held out, {:.0} exchanged", self.held_out, self.exchanged)
    }

    /// Whether either direction supports the cause by as much as the training logs must for a further effect.
    pub(crate) fn supports(self) -> bool {
        self.held_out.min(self.exchanged) >= LEAST_GAIN[1]
    }
}

/// A design that was fitted to some runs, and the runs that it is tested on.
struct Direction<'a, 'b> {
    fitted: &'a Search<'b>,
    tested: Vec<&'a RunColumns<'a>>,
}

/// Weighted rows and mean square residual of one joint.
struct Residual {
    rows: f64,
    square: f64,
}

/// Bayes factors of `steps`, in their order. `search`: fitted to the runs of `seen`; `hidden`: the held-out log; `means`: prior means that
/// the design has taken out of its coefficients. None where equations have no solution.
pub(crate) fn bayes_factors(
    search: &Search<'_>,
    (adopted, steps): (&[Adopted], &[Step]),
    seen: &[RunColumns<'_>],
    hidden: &RunColumns<'_>,
    means: &[f64],
) -> Option<Vec<BayesFactor>> {
    let exchanged = exchanged(search, adopted, hidden)?;
    let forward = Direction { fitted: search, tested: vec![hidden] }.factors(steps, means)?;
    let backward = Direction { fitted: &exchanged, tested: seen.iter().collect() }.factors(steps, means)?;
    let both = |(held_out, exchanged)| BayesFactor { held_out, exchanged };
    Some(forward.into_iter().zip(backward).map(both).collect())
}

/// The same columns and priors as `search` has, fitted to the held-out log.
fn exchanged<'a>(search: &Search<'a>, adopted: &[Adopted], hidden: &RunColumns<'a>) -> Option<Search<'a>> {
    let run: &'a Prepared = hidden.run;
    let mut other = Search::new(vec![run], search.nominal)?;
    let std = &search.design.background.std;
    for effect in adopted {
        let from = effect.place - search.nominal.x.len();
        let columns: Vec<Column> = hidden.extra[from..from + effect.mean.len()].to_vec();
        let width = std.rows(effect.place, effect.mean.len());
        other.design.adopt(&[columns], &effect.mean, width.as_slice());
    }
    other.weigh()?;
    other.reweigh()?;
    other.design.background.std.clone_from(std);
    other.scale = search.scale;
    Some(other)
}

impl Direction<'_, '_> {
    /// ln B of each step.
    fn factors(&self, steps: &[Step], means: &[f64]) -> Option<Vec<f64>> {
        let with = self.residuals(&[], means)?;
        steps.iter().map(|step| Some(self.log_ratio(&with, &self.residuals(&step.columns, means)?))).collect()
    }

    fn log_ratio(&self, with: &[Residual], without: &[Residual]) -> f64 {
        let joint = |(j, (with, without)): (usize, (&Residual, &Residual))| {
            let independent = with.rows / self.fitted.correlations[j];
            0.5 * independent * (without.square / with.square).ln()
        };
        with.iter().zip(without).enumerate().map(joint).sum()
    }

    /// Residual of each joint on the tested runs where the columns `left_out` are, and all others are fitted.
    fn residuals(&self, left_out: &[usize], means: &[f64]) -> Option<Vec<Residual>> {
        let (search, nominal) = (self.fitted, self.fitted.nominal);
        let out: Vec<(usize, f64)> = left_out.iter().map(|c| (*c, means[*c])).collect();
        let solved = search.design.background.solve_without(&search.weights, search.scale, &out)?;
        let kept: Vec<usize> = (0..means.len()).filter(|c| !left_out.contains(c)).collect();
        let mut sums: Vec<Residual> = search.noise.iter().map(|_| Residual { rows: 0.0, square: 0.0 }).collect();
        let steps = vec![kept];
        for run in &self.tested {
            let stages = run.stages(&nominal.x, &steps, &solved.x, means);
            let sealed = Sealed { run: run.run, stages: &stages, noise: &search.noise };
            for (j, sum) in sums.iter_mut().enumerate().filter(|(j, _)| run.run.silent[*j].is_none()) {
                let rows = sealed.rows_in_motion(j);
                sum.rows += rows;
                sum.square += rows * sealed.residual_in_motion(j);
            }
        }
        for (sum, floor) in sums.iter_mut().zip(&search.floor) {
            sum.square = (sum.square / sum.rows.max(f64::MIN_POSITIVE)).max(floor * floor);
        }
        Some(sums)
    }
}
