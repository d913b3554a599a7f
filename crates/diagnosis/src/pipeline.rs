//! The story of a diagnosis: fit, selection, prediction of the held-out run, verdict, sizes, corrected model.

use crate::effects::physical_bounds::Impossible;
use crate::effects::{counterbalance, payload};
use crate::experiment::separating_motion::MotionBounds;
use crate::export::file_values::Kept;
use crate::export::patch::{self, Patch};
use crate::fit::search::Search;
use crate::fit::stages::Stages;
use crate::judge::cause_sizes::{self, Sized};
use crate::judge::causes::Opened;
use crate::judge::counterbalance_or_link::{self, Doubts};
use crate::judge::fitted_steps::FittedSteps;
use crate::judge::other_arm;
use crate::judge::procedure::Procedure;
use crate::judge::torque_offset;
use crate::model::listener::Listener;
use crate::model::log_fault::LogFinding;
use crate::policy::POLICY;
use crate::report::details::{self, Unsure};
use crate::report::diagnosis::{Cause, Diagnosis};
use crate::screen::log_check;
use crate::select::adopted::Adopted;
use crate::select::confounded_values;
use crate::select::flange_body;
use crate::select::forward::Selected;
use crate::select::inner_ends::inner_ends;
use crate::select::value_group::Group;
use crate::select::values::{self, Wrong};

/// What explains the training runs.
struct Explanation {
    adopted: Vec<Adopted>,
    wrong: Wrong,
    /// Values of the model that the runs do not determine.
    unsure: Unsure,
    /// What may be in the place of wrong values of links.
    doubts: Doubts,
    /// Why there is no body at the flange, where one was tried.
    no_body: Option<Impossible>,
}

impl Explanation {
    /// Selects effects, then wrong values, then effects in place of wrong values until none is better. None where the equations have no
    /// solution.
    fn find(search: &mut Search<'_>, left_out: &mut Vec<String>, listener: &mut dyn Listener) -> Option<Explanation> {
        let mut selected = Selected::new(search)?;
        let mut no_body = None;
        let body = flange_body::at_flange(search, &selected, &mut no_body, listener);
        let body = or_said(body, "whether one body at the flange is simpler", left_out);
        if let Some((candidate, adoption)) = body.flatten() {
            or_said(selected.adopt(search, &candidate, adoption, listener), "one body at the flange", left_out);
        }
        or_said(selected.select(search, listener), "a further effect", left_out);
        let mut unsure = details::unsure(search)?;
        let may_be = "whether wrong link parameters are a counterbalance or a load";
        let mut doubts = or_said(Doubts::find(search, &selected, listener), may_be, left_out);
        let mut wrong = values::wrong(search, &selected.adopted)?;
        loop {
            let instead = confounded_values::replace(search, &wrong, &selected, listener);
            let instead = or_said(instead, "whether an effect replaces wrong parameters", left_out);
            let Some((candidate, adoption)) = instead.flatten() else { break };
            wrong.undo(search);
            let taken = selected.adopt(search, &candidate, adoption, listener);
            let taken = or_said(taken, "an effect in place of wrong parameters", left_out);
            or_said(selected.select(search, listener), "a further effect", left_out);
            unsure = details::unsure(search)?;
            doubts = or_said(Doubts::find(search, &selected, listener), may_be, left_out);
            wrong = values::wrong(search, &selected.adopted)?;
            if taken.is_none() {
                break;
            }
        }
        let doubts = doubts.unwrap_or_default();
        let Selected { mut adopted, .. } = selected;
        // With everything in the model: what is withdrawn later takes its part with it.
        for at in 0..adopted.len() {
            adopted[at].inner_ends = inner_ends(search, &adopted[at]);
        }
        let doubted = counterbalance_or_link::doubt(search, &mut adopted);
        or_said(doubted, "whether a counterbalance is a body whose centre lies elsewhere", left_out);
        let over: Vec<String> = search.noise.iter().zip(&search.floor).map(|(n, f)| format!("{:.1}", n / f)).collect();
        let first: Vec<String> =
            search.first_noise.iter().zip(&search.floor).map(|(n, f)| format!("{:.1}", n / f)).collect();
        listener.line(&format!(
            "residual over the noise floor, by joint: {}; before effects {}",
            over.join(" "),
            first.join(" ")
        ));
        Some(Explanation { adopted, wrong, unsure, doubts, no_body })
    }

    /// Links with wrong values.
    fn links(&self) -> Vec<usize> {
        self.wrong.groups.iter().filter(|g| g.effect.about().is_link_body).map(|g| g.joint).collect()
    }
}

impl Procedure<'_> {
    /// The report, and the corrected model where `patch` has the bounds of motions. None where the equations have no solution.
    pub(crate) fn run(
        &self,
        patch: Option<&MotionBounds>,
        listener: &mut dyn Listener,
    ) -> Option<(Diagnosis, Option<Patch>)> {
        let mut log = self.mute.clone();
        log.extend(self.look.iter().flat_map(|run| log_check::check(run, self.nominal)));
        let mut left_out = Vec::new();
        let mut search = Search::new(self.look.iter().collect(), self.nominal)?;
        let explanation = Explanation::find(&mut search, &mut left_out, listener)?;
        let mut fit = FittedSteps::new(self, &search, &explanation.adopted, &explanation.wrong.groups)?;
        listener.line("prediction of the held-out log");
        let prediction = fit.predict(&search)?;
        listener.line("the sealed torque");
        log.extend(log_check::check(self.sealed, self.nominal));
        let measured = fit.stages(&fit.hidden);
        let seen: Vec<Stages> = fit.seen.iter().map(|run| fit.stages(run)).collect();
        let opened = Opened {
            procedure: self,
            search: &search,
            steps: &fit.steps,
            prediction: &prediction,
            measured: &measured,
            seen: &seen,
            solved: &fit.solved,
            log,
        };
        let (mut report, mut upheld) = opened.diagnosis();
        let links = explanation.links();
        report.links_are_not_told_from(&explanation.doubts.of_links(&links));
        let unheard = self.unheard(&report.log);
        if let Some(joints) = self.joints_of_another_arm(&report, &explanation, &fit, &unheard) {
            report.is_of_another_arm(joints.iter().map(|j| self.names()[*j].clone()).collect());
            upheld.fill(false);
        }
        let Explanation { wrong, unsure, doubts, no_body, .. } = explanation;
        let (sized, reported) = self.size_causes(&mut report, (&mut search, &wrong), &fit, &mut upheld, &mut left_out);
        let x = &fit.solved.x;
        let corrected = sized.as_ref().map_or((&[][..], x), |sized| (&sized.named[..], &sized.x));
        let parameters = details::parameters(&search, &unsure, &wrong, x, corrected, &prediction);
        let named = |hint: &Cause| report.causes.iter().any(|c| c.effect == hint.effect && c.joints == hint.joints);
        let offsets = torque_offset::causes(self.nominal, &parameters, &report.per_joint);
        let offsets: Vec<Cause> = offsets.into_iter().filter(|hint| !named(hint)).collect();
        report.withdrawn.extend(offsets);
        let reported = reported.as_ref().unwrap_or(&measured);
        let stages = [&measured, reported];
        report.details = Some(self.details(&report, &search, &fit.steps, &prediction, stages, parameters));
        report.withdrawn.extend(no_body.map(|what| cause_sizes::hint(payload::EFFECT, Vec::new(), &[what])));
        for what in &left_out {
            listener.line(&format!("no solution: {what}"));
        }
        report.left_out = left_out;
        let (Some(bounds), Some(sized)) = (patch, sized) else { return Some((report, None)) };
        listener.line("the model with what was found");
        let all = || fit.seen.iter().chain([&fit.hidden]);
        let doubted = report.links_may_be(counterbalance::EFFECT).then(|| doubts.classes(&links).collect());
        let found = patch::Found {
            nominal: self.nominal,
            runs: all().map(|r| r.run).collect(),
            timing: all().filter_map(|r| r.extra.first()).collect(),
            bounds,
            sized: &sized,
            doubted: doubted.unwrap_or_default(),
            kept: Kept::new(self.nominal, unheard, &unsure, &sized.named),
            freely: &unsure.covariance,
        };
        let patch = patch::make(&mut search, &wrong, &found);
        Some((report, patch))
    }

    /// Joints whose torque is not believed.
    fn unheard(&self, log: &[LogFinding]) -> Vec<usize> {
        let names = self.names();
        (0..names.len()).filter(|j| log.iter().any(|f| f.joint == names[*j] && f.fault.spoils())).collect()
    }

    /// Joints whose values or torque are those of another arm, where that is most of them; `unheard`: joints that are not judged.
    fn joints_of_another_arm(
        &self,
        report: &Diagnosis,
        explanation: &Explanation,
        fit: &FittedSteps<'_>,
        unheard: &[usize],
    ) -> Option<Vec<usize>> {
        let trusted: Vec<usize> = (0..self.names().len()).filter(|j| !unheard.contains(j)).collect();
        // Values that the sealed run refutes say nothing of the file.
        let as_given: Vec<f64> = report.per_joint.iter().map(|gap| gap.before).collect();
        let fitted: Vec<bool> = report
            .per_joint
            .iter()
            .map(|gap| gap.in_motion.is_none_or(|[_, after]| after <= POLICY.held_out.min_gap_in_motion))
            .collect();
        let of_the_arm = |g: &&Group| g.effect.about().is_inertia;
        let impossible: Vec<usize> = explanation
            .wrong
            .impossible
            .iter()
            .map(|(group, _)| group)
            .filter(of_the_arm)
            .map(|group| group.joint)
            .collect();
        other_arm::joints(self.nominal, &fit.solved.x, &explanation.adopted, &impossible, &trusted)
            .filter(|_| !report.refuted)
            .or_else(|| other_arm::far_too_strong(&as_given, &fitted, &trusted))
    }

    /// Puts sizes to the causes that stand, again after each withdrawal; with them the held-out run under what is named alone.
    fn size_causes(
        &self,
        report: &mut Diagnosis,
        (search, wrong): (&mut Search<'_>, &Wrong),
        fit: &FittedSteps<'_>,
        upheld: &mut [bool],
        left_out: &mut Vec<String>,
    ) -> (Option<Sized>, Option<Stages>) {
        let FittedSteps { steps, hidden, means, .. } = fit;
        let sizes = "sizes of causes without the withdrawn ones (sizes with them are reported)";
        let sized = self.size(report, search, wrong, fit, upheld);
        let mut sized = or_said(sized, sizes, left_out);
        let mut reported = sized.as_ref().and_then(|s| self.apply_named_model(report, hidden, s, means, &search.noise));
        // With what was withdrawn an effect may have helped that hardly does by itself.
        let mut standing: Vec<usize> = (0..steps.len()).filter(|k| upheld[*k]).collect();
        if standing.len() == report.causes.len() {
            let mut withdrawn = false;
            for out in [report.withdraw_what_hardly_helps(), report.withdraw_what_may_be_nothing()] {
                for at in out.iter().rev() {
                    upheld[standing.remove(*at)] = false;
                    withdrawn = true;
                }
            }
            if withdrawn {
                sized = or_said(self.size(report, search, wrong, fit, upheld), sizes, left_out);
                let again =
                    sized.as_ref().and_then(|s| self.apply_named_model(report, hidden, s, means, &search.noise));
                reported = again.or(reported);
            }
        }
        report.doubt_what_is_left_open();
        report.doubt_what_may_take_nothing();
        let unseen = self.ask_for_values_unseen(report);
        let asked = "whether parameters that the training motion does not identify are all that is missing";
        if or_said(unseen, asked, left_out) == Some(true) {
            report.withdrawn.append(&mut report.causes);
            upheld.fill(false);
            sized = or_said(self.size(report, search, wrong, fit, upheld), sizes, left_out);
        }
        (sized, reported)
    }
}

/// What an optional step found; one whose equations have no solution is put down, and everything else stands without it.
fn or_said<T>(found: Option<T>, what: &str, left_out: &mut Vec<String>) -> Option<T> {
    if found.is_none() {
        left_out.push(what.to_owned());
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Only a step without a solution is put down.
    #[test]
    fn a_step_without_a_solution_is_said_and_leaves_the_rest() {
        let mut left_out = Vec::new();
        assert_eq!(or_said(Some(1), "found", &mut left_out), Some(1));
        assert!(left_out.is_empty());
        assert_eq!(or_said::<i32>(None, "no solution", &mut left_out), None);
        assert_eq!(left_out, ["no solution"]);
    }
}
