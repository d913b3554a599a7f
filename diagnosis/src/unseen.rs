//! Values that only the sealed motion shows.
//!
//! A run in which joints go slowly, or one at a time, leaves values of the model open that the sealed motion needs. What is missed there is
//! no effect that nobody knows, and nothing that changed between the runs: with all runs together the values of the model fit.

use crate::effect::Effect;
use crate::procedure::Procedure;
use crate::report::{BetweenRuns, Diagnosis, Verdict};
use crate::residue::Residue;
use crate::search::Search;
use crate::values;

impl Procedure<'_> {
    /// Where the runs looked at fit to their noise and the sealed one does not: whether values that can be fit all of them; then nothing was
    /// evaluated. Asked after everything was predicted, measured and judged; none where the equations have no solution.
    pub(crate) fn ask_for_values_unseen(&self, report: &mut Diagnosis) -> Option<bool> {
        if report.between_runs != Some(BetweenRuns::SealedDiffers) || !report.other_arm.is_empty() {
            return Some(false);
        }
        let runs = self.look.iter().chain([self.sealed]).collect();
        let mut together = Search::new(runs, self.nominal)?;
        if !Residue::of(&together).at_floor() {
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
            "all runs together fit to their noise with other values of what the model has ({}), and the motion that was looked at does \
             not show those that the sealed one needs",
            kinds.join(", ")
        ));
        Some(true)
    }
}
