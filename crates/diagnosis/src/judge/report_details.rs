//! The details of a report: stages with the steps that are upheld, ledger, residual diagnostics, views and excerpts.

use crate::effects::Kind;
use crate::fit::prediction::Prediction;
use crate::fit::search::Search;
use crate::fit::stages::Stages;
use crate::judge::procedure::{Procedure, Step};
use crate::model::gap::Gap;
use crate::report::curves;
use crate::report::details::{self, Details, ParameterLine, Stage};
use crate::report::diagnosis::Diagnosis;
use crate::report::residual_tests;
use crate::report::views;

impl Procedure<'_> {
    /// What stands behind the figures; `measured`: the sealed run step by step, and with what is told.
    pub(crate) fn details(
        &self,
        report: &Diagnosis,
        search: &Search<'_>,
        steps: &[Step],
        prediction: &Prediction,
        [measured, told]: [&Stages; 2],
        parameters: Vec<ParameterLine>,
    ) -> Details {
        let names = self.names();
        let stage = |k: usize| {
            let step = k.checked_sub(1).and_then(|k| steps.get(k));
            let joints: Vec<String> =
                step.map_or_else(Vec::new, |s| s.joints.iter().map(|j| names[*j].clone()).collect());
            let (predicted, low, high) = prediction.gaps[k];
            Stage {
                effect: step.map(|s| s.effect),
                upheld: step.is_some_and(|s| report.causes.iter().any(|c| c.effect == s.effect && c.joints == joints)),
                joints,
                predicted,
                low,
                high,
                measured: Gap::new(&measured.tau, &measured.models[k]).all,
            }
        };
        let load = curves::load(self.sealed, self.nominal, &self.nominal.x);
        let missing = report.causes.iter().find(|cause| cause.effect.kind() == Kind::Structure);
        let named = missing.map_or(&[][..], |cause| cause.joints.as_slice());
        Details {
            stages: (0..measured.models.len()).map(stage).collect(),
            ledger: details::ledger(told, &self.sealed.floor, &names),
            left: residual_tests::by_joint(self.sealed, told, &names),
            views: views::tabulate(self.sealed, told, &load, &search.first_noise, &names),
            excerpts: curves::excerpts(self.sealed, told, &names, named, &search.noise),
            parameters,
            nominal_error: search.scale,
        }
    }
}
