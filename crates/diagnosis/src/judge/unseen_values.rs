//! Values of the model that only the held-out motion excites.
//!
//! A run in which joints go slowly, or one at a time, leaves values of the model open that the sealed motion needs. What is missed there is
//! no effect that nobody knows, and nothing that is seen to have changed between the runs: with all runs together the values of the model
//! fit, and hardly worse than with values of their own.

use nalgebra::DVector;

use crate::effects::Effect;
use crate::fit::search::Search;
use crate::judge::procedure::Procedure;
use crate::policy::POLICY;
use crate::report::diagnosis::{BetweenRuns, Diagnosis, Verdict};
use crate::select::residual::Residue;
use crate::select::values;

impl Procedure<'_> {
    /// Where the runs looked at fit to their noise and the sealed one does not: whether values that can be fit all of them; then nothing was
    /// evaluated. Asked after everything was predicted, measured and judged; none where the equations have no solution.
    pub(crate) fn ask_for_values_unseen(&self, report: &mut Diagnosis) -> Option<bool> {
        if report.between_runs != Some(BetweenRuns::SealedDiffers) || !report.other_arm.is_empty() {
            return Some(false);
        }
        let runs = self.look.iter().chain([self.sealed]).collect();
        let mut together = Search::new(runs, self.nominal)?;
        if !Residue::from_search(&together).at_floor() {
            return Some(false);
        }
        if self.loss(&together)? > POLICY.adoption.max_shared_value_cost * self.nominal.x.len() as f64 {
            return Some(false);
        }
        let wrong = values::wrong(&mut together, &[])?;
        if !wrong.impossible.is_empty() {
            return Some(false);
        }
        report.verdict = Verdict::NotEvaluated;
        report.between_runs = Some(BetweenRuns::ValuesUnseen);
        let mut kinds: Vec<Effect> = Vec::new();
        for group in &wrong.groups {
            if !kinds.contains(&group.effect) {
                kinds.push(group.effect);
            }
        }
        let kinds: Vec<String> = kinds.iter().map(|effect| effect.name().replace('_', " ")).collect();
        report.remark = Some(format!(
            "all logs together fit to their noise with other parameters ({}); the motion of the training logs does \
             not identify them, nor whether something smaller changed between the logs",
            kinds.join(", ")
        ));
        Some(true)
    }

    /// By how much more the runs looked at, and the sealed one, are missed with values that they share than with their own, in units of
    /// noise squared.
    fn loss(&self, together: &Search<'_>) -> Option<f64> {
        let (design, sealed) = (&together.design, self.look.len());
        // What runs are missed by with values that are fitted to them.
        let missed = |of: &dyn Fn(usize) -> bool| -> Option<f64> {
            let blocks: Vec<usize> = (0..design.blocks.len()).filter(|b| of(design.blocks[*b].run)).collect();
            let solved = design.background.solve(&together.weights, together.scale, &blocks)?;
            let residuals = design.residuals(&solved.x, &solved.stretches);
            let square = |joints: &Vec<DVector<f64>>| -> f64 {
                joints.iter().zip(&together.weights).map(|(r, weight)| weight * r.norm_squared()).sum()
            };
            Some(residuals.iter().enumerate().filter(|(run, _)| of(*run)).map(|(_, joints)| square(joints)).sum())
        };
        Some(missed(&|_| true)? - missed(&|run| run < sealed)? - missed(&|run| run == sealed)?)
    }
}
