//! The gap of the model with the named causes alone, without effects that were withdrawn.

use crate::effects::Kind;
use crate::fit::motion_gap::Sealed;
use crate::fit::stages::{RunColumns, Stages};
use crate::judge::cause_sizes::Sized;
use crate::judge::causes::{creeping_share, share_left};
use crate::judge::procedure::Procedure;
use crate::model::gap::Gap;
use crate::policy::POLICY;
use crate::report::diagnosis::{Diagnosis, Verdict};
use crate::report::regimes;
use crate::screen::prepared::turn_columns;

impl Procedure<'_> {
    /// The sealed run under the model as given and with what is named; `noise`: as [`Sealed::noise`]. `means`: those that the design
    /// takes out of coefficients.
    pub(crate) fn apply_named_model(
        &self,
        report: &mut Diagnosis,
        hidden: &RunColumns<'_>,
        sized: &Sized,
        means: &[f64],
        noise: &[f64],
    ) -> Option<Stages> {
        if !report.withdrawn.iter().any(|cause| cause.effect.kind() == Kind::Structure) {
            return None;
        }
        // How softly friction turns over is in no model that is handed on.
        let turns = turn_columns(self.nominal);
        let stands = |c: &usize| {
            let within = |place: usize, len: usize| (place..place + len).contains(c);
            *c < turns.start || *c >= turns.end && sized.effects.iter().any(|a| within(a.place, a.mean.len()))
        };
        let columns: Vec<usize> = (0..means.len()).filter(stands).collect();
        let stages = hidden.stages_turned(&self.nominal.x, &vec![columns], &sized.x, means, turns);
        let sealed = Sealed { run: self.sealed, stages: &stages, noise };
        let [before, after] = [0, 1].map(|stage| Gap::new(&stages.tau, &stages.models[stage]));
        report.after = after.all;
        for (j, gap) in report.per_joint.iter_mut().enumerate() {
            gap.after = after.per_joint[j];
            gap.in_motion = sealed.in_motion(j);
        }
        report.place = regimes::cells(self.sealed, &stages, &self.names());
        report.creeping_share = creeping_share(&stages);
        report.unexplained_share = share_left(&before, &after, report.noise_floor);
        let values = !report.causes.is_empty() && report.causes.iter().all(|c| c.effect.kind() == Kind::Value);
        let most = if sealed.is_mostly_open() {
            POLICY.held_out.max_gap_share_beside_values_open
        } else {
            POLICY.held_out.max_gap_share_beside_values
        };
        if report.verdict == Verdict::Unexplained
            && values
            && report.unexplained_share <= most
            && !report.keeps_open_joints()
        {
            report.verdict = Verdict::Parameter;
            report.between_runs = None;
        }
        Some(stages)
    }
}
