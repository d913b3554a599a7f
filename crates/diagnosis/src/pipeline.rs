//! The story of a diagnosis: fit, selection, prediction of the held-out run, verdict, sizes, corrected model.

use nalgebra::DVector;
use rivet_dynamics::Parameter;

use crate::effects::Kind;
use crate::effects::physics::Physics;
use crate::effects::{counterbalance, payload};
use crate::experiment::separating_motion::MotionBounds;
use crate::export::file_values::Kept;
use crate::export::patch::{self, Patch};
use crate::fit::prediction::{Fitted, Prediction, predict};
use crate::fit::search::Search;
use crate::fit::stages::{RunColumns, Stages, Steps};
use crate::judge::cause_sizes;
use crate::judge::causes::Opened;
use crate::judge::counterbalance_or_link;
use crate::judge::other_arm;
use crate::judge::procedure::{Procedure, Step};
use crate::judge::torque_offset;
use crate::model::gap::Gap;
use crate::model::log_fault::LogFinding;
use crate::model::nominal::Nominal;
use crate::model::rows::Column;
use crate::policy::POLICY;
use crate::report::curves;
use crate::report::details::{self, Details, ParameterLine, Stage, Unsure};
use crate::report::diagnosis::{Cause, Diagnosis};
use crate::report::regimes::{self, Cell, Regime};
use crate::report::residual_tests;
use crate::report::views;
use crate::screen::log_check;
use crate::screen::prepared::{Prepared, turn_columns, unknown};
use crate::select::adopted::Adopted;
use crate::select::confounded_values;
use crate::select::flange_body;
use crate::select::forward::Selected;
use crate::select::residual::Residue;
use crate::select::value_group::Group;
use crate::select::values;

impl Procedure<'_> {
    /// None where the equations have no solution.
    pub(crate) fn run(
        &self,
        patch: Option<&MotionBounds>,
        say: &mut dyn FnMut(&str),
    ) -> Option<(Diagnosis, Option<Patch>)> {
        let mut log = self.mute.clone();
        log.extend(self.look.iter().flat_map(|run| log_check::check(run, self.nominal)));
        let mut search = Search::new(self.look.iter().collect(), self.nominal)?;
        let mut selected = Selected::new(&search)?;
        let mut left_out = Vec::new();
        let mut no_body = None;
        let body = flange_body::at_flange(&mut search, &selected, &mut no_body, say);
        let body = or_said(body, "whether one body at the flange is simpler", &mut left_out);
        if let Some((candidate, adoption)) = body.flatten() {
            or_said(selected.adopt(&mut search, &candidate, adoption, say), "one body at the flange", &mut left_out);
        }
        or_said(selected.select(&mut search, say), "a further effect", &mut left_out);
        let mut unsure = details::unsure(&search)?;
        let may_be = "whether wrong link parameters are a counterbalance or a load";
        let mut doubts =
            or_said(counterbalance_or_link::Doubts::find(&mut search, &selected, say), may_be, &mut left_out);
        let mut wrong = values::wrong(&mut search, &selected.adopted)?;
        loop {
            let instead = confounded_values::replace(&mut search, &wrong, &selected, say);
            let instead = or_said(instead, "whether an effect replaces wrong parameters", &mut left_out);
            let Some((candidate, adoption)) = instead.flatten() else { break };
            wrong.undo(&mut search);
            let taken = selected.adopt(&mut search, &candidate, adoption, say);
            let taken = or_said(taken, "an effect in place of wrong parameters", &mut left_out);
            or_said(selected.select(&mut search, say), "a further effect", &mut left_out);
            unsure = details::unsure(&search)?;
            doubts = or_said(counterbalance_or_link::Doubts::find(&mut search, &selected, say), may_be, &mut left_out);
            wrong = values::wrong(&mut search, &selected.adopted)?;
            if taken.is_none() {
                break;
            }
        }
        let doubts = doubts.unwrap_or_default();
        let Selected { mut adopted, .. } = selected;
        let doubted = counterbalance_or_link::doubt(&mut search, &mut adopted);
        or_said(doubted, "whether a counterbalance is a body whose centre lies elsewhere", &mut left_out);
        let over: Vec<String> = search.noise.iter().zip(&search.floor).map(|(n, f)| format!("{:.1}", n / f)).collect();
        let first: Vec<String> =
            search.first_noise.iter().zip(&search.floor).map(|(n, f)| format!("{:.1}", n / f)).collect();
        say(&format!(
            "residual over the noise floor, by joint: {}; before effects {}",
            over.join(" "),
            first.join(" ")
        ));
        let groups = wrong.groups.clone();
        let solved = search.solved(search.scale)?;
        let contact = search.design.local_torque(&solved.stretches);
        let x = solved.x.clone();
        let residue = Residue::from_search(&search);
        let missing = |g: &Group| g.columns.iter().all(|c| self.nominal.x[*c] == 0.0);
        let imitates = |g: &Group| residue.is_nameless(g.joint) && !(missing(g) && self.takes_most(&search, g.joint));
        let (doubtful, sound): (Vec<Group>, Vec<Group>) = groups.iter().cloned().partition(imitates);
        let steps = Self::steps(&search, &adopted, sound, doubtful);
        let means: Vec<f64> = std::iter::repeat_n(0.0, self.nominal.x.len() + unknown(self.nominal, 1.0).len())
            .chain(adopted.iter().flat_map(|a| a.mean.iter().copied()))
            .collect();
        let seen = self.look.iter().zip(&contact).map(|(run, contact)| self.columns(run, &adopted, Some(contact)));
        let seen: Vec<RunColumns<'_>> = seen.collect();
        let hidden = self.columns(self.sealed, &adopted, None);
        let remainder = remainder(&search, &steps);
        let (steps, order) = in_order(&seen, steps, &remainder, self.nominal, &x, &means);
        say("prediction of the held-out log");
        // The motion does not tell when contact comes: on the sealed run it is part of what is left.
        let silent: Vec<usize> =
            steps.iter().filter(|s| s.effect.about().is_intermittent).flat_map(|s| s.columns.clone()).collect();
        let fitted = Fitted { nominal: &self.nominal.x, steps: &order, x: &x, means: &means };
        let prediction = predict(&search, &seen, &hidden, &fitted, &silent)?;
        say("the sealed torque");
        log.extend(log_check::check(self.sealed, self.nominal));
        let with_turns =
            |run: &RunColumns<'_>| run.stages_turned(&self.nominal.x, &order, &x, &means, turn_columns(self.nominal));
        let measured = with_turns(&hidden);
        let stages: Vec<Stages> = seen.iter().map(with_turns).collect();
        let opened = Opened {
            procedure: self,
            search: &search,
            steps: &steps,
            prediction: &prediction,
            measured: &measured,
            seen: &stages,
            solved: &solved,
            log,
        };
        let (mut report, mut upheld) = opened.diagnosis();
        let links: Vec<usize> = groups.iter().filter(|g| g.effect.about().is_link_body).map(|g| g.joint).collect();
        report.links_are_not_told_from(&doubts.of_links(&links));
        let unheard = self.unheard(&report.log);
        let trusted: Vec<usize> = (0..self.names().len()).filter(|j| !unheard.contains(j)).collect();
        // Values that the sealed run refutes say nothing of the file.
        let as_given: Vec<f64> = report.per_joint.iter().map(|gap| gap.before).collect();
        let fitted: Vec<bool> = report
            .per_joint
            .iter()
            .map(|gap| gap.in_motion.is_none_or(|[_, after]| after <= POLICY.held_out.min_gap_in_motion))
            .collect();
        let of_the_arm = |g: &&Group| g.effect.about().is_inertia;
        let impossible: Vec<usize> =
            wrong.impossible.iter().map(|(group, _)| group).filter(of_the_arm).map(|group| group.joint).collect();
        let stranger = other_arm::joints(self.nominal, &x, &adopted, &impossible, &trusted)
            .filter(|_| !report.refuted)
            .or_else(|| other_arm::far_too_strong(&as_given, &fitted, &trusted));
        if let Some(joints) = stranger {
            report.is_of_another_arm(joints.iter().map(|j| self.names()[*j].clone()).collect());
            upheld.fill(false);
        }
        let parameters = details::parameters(&search, &unsure, &wrong, &x, &prediction);
        let sizes = "sizes of causes without the withdrawn ones (sizes with them are reported)";
        let sized = self.size(&mut report, &mut search, &wrong, &steps, &upheld);
        let mut sized = or_said(sized, sizes, &mut left_out);
        let mut reported_stages =
            sized.as_ref().and_then(|s| self.apply_named_model(&mut report, &hidden, s, &means, &search.noise));
        // With what was withdrawn an effect may have helped that hardly does by itself.
        let standing: Vec<usize> = (0..steps.len()).filter(|k| upheld[*k]).collect();
        if standing.len() == report.causes.len() {
            let out = report.withdraw_what_hardly_helps();
            for at in &out {
                upheld[standing[*at]] = false;
            }
            if !out.is_empty() {
                let again = self.size(&mut report, &mut search, &wrong, &steps, &upheld);
                sized = or_said(again, sizes, &mut left_out);
                let again =
                    sized.as_ref().and_then(|s| self.apply_named_model(&mut report, &hidden, s, &means, &search.noise));
                reported_stages = again.or(reported_stages);
            }
        }
        report.doubt_what_is_left_open();
        let unseen = self.ask_for_values_unseen(&mut report);
        let asked = "whether parameters that the training motion does not identify are all that is missing";
        if or_said(unseen, asked, &mut left_out) == Some(true) {
            report.withdrawn.append(&mut report.causes);
            upheld.fill(false);
            let again = self.size(&mut report, &mut search, &wrong, &steps, &upheld);
            sized = or_said(again, sizes, &mut left_out);
        }
        let named = |hint: &Cause| report.causes.iter().any(|c| c.effect == hint.effect && c.joints == hint.joints);
        let offsets = torque_offset::causes(self.nominal, &parameters, &report.per_joint);
        let offsets: Vec<Cause> = offsets.into_iter().filter(|hint| !named(hint)).collect();
        report.withdrawn.extend(offsets);
        let reported = reported_stages.as_ref().unwrap_or(&measured);
        report.details = Some(self.details(&report, &search, &steps, &prediction, [&measured, reported], parameters));
        report.withdrawn.extend(no_body.map(|what| cause_sizes::hint(payload::EFFECT, Vec::new(), &[what])));
        for what in &left_out {
            say(&format!("no solution: {what}"));
        }
        report.left_out = left_out;
        let (Some(bounds), Some(sized)) = (patch, sized) else { return Some((report, None)) };
        say("the model with what was found");
        let all = || seen.iter().chain([&hidden]);
        let found = patch::Found {
            nominal: self.nominal,
            runs: all().map(|r| r.run).collect(),
            timing: all().filter_map(|r| r.extra.first()).collect(),
            bounds,
            sized: &sized,
            doubted: if report.links_may_be(counterbalance::EFFECT) {
                doubts.classes(&links).collect()
            } else {
                Vec::new()
            },
            kept: self.kept(unheard, &unsure, &sized.named),
            freely: &unsure.covariance,
        };
        let patch = patch::make(&mut search, &wrong, &found);
        Some((report, patch))
    }

    /// Whether values refitted take most of the squared gap of joint `j` on the runs looked at.
    fn takes_most(&self, search: &Search<'_>, j: usize) -> bool {
        let none = Vec::new();
        let gap = |run: &Prepared| {
            let as_given =
                RunColumns { run, extra: Vec::new() }.stages(&self.nominal.x, &none, &DVector::zeros(0), &[]);
            let residual = |k: usize| as_given.tau[j][k] - as_given.models[0][j][k];
            (0..run.rows()).fold((0.0, 0.0), |(square, rows), k| (square + residual(k).powi(2), rows + 1.0))
        };
        let (square, rows) =
            self.look.iter().map(gap).fold((0.0, 0.0), |(s, n), (square, rows)| (s + square, n + rows));
        search.first_noise[j].powi(2) * f64::max(rows, 1.0)
            < (1.0 - POLICY.plausibility.min_unknown_value_share) * square
    }

    /// What stands behind the figures; `measured`: the sealed run step by step, and with what is told.
    fn details(
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
        Details {
            stages: (0..measured.models.len()).map(stage).collect(),
            ledger: details::ledger(told, &self.sealed.floor, &names),
            left: residual_tests::by_joint(self.sealed, told, &names),
            views: views::tabulate(self.sealed, told, &load, &search.first_noise, &names),
            excerpts: curves::excerpts(self.sealed, told, &names),
            parameters,
            nominal_error: search.scale,
        }
    }

    /// Joints whose torque is not believed.
    fn unheard(&self, log: &[LogFinding]) -> Vec<usize> {
        let names = self.names();
        (0..names.len()).filter(|j| log.iter().any(|f| f.joint == names[*j] && f.fault.spoils())).collect()
    }

    /// Values of drives that a file keeps as they are: of joints whose torque is not believed, and those that runs do not pin and
    /// no cause `named`.
    fn kept(&self, unheard: Vec<usize>, unsure: &Unsure, named: &[usize]) -> Kept {
        let parameters = self.nominal.model.parameters.iter().enumerate();
        let drive = parameters.filter(|(_, p)| !matches!(p, Parameter::Link { .. }));
        let (unbelieved, rest): (Vec<_>, Vec<_>) =
            drive.partition(|(_, p)| p.joint().is_some_and(|j| unheard.contains(&j)));
        let open = |(c, p): &(usize, &Parameter)| {
            !matches!(p, Parameter::Offset(_))
                && unsure.share[*c] >= POLICY.plausibility.max_pinned_share
                && !named.contains(c)
        };
        let places = |of: Vec<(usize, &Parameter)>| of.into_iter().map(|(c, _)| c).collect();
        Kept { unpinned: places(rest.into_iter().filter(open).collect()), unbelieved: places(unbelieved), unheard }
    }

    /// What was adopted and which values are wrong, one step an effect; structure on several joints stays apart.
    fn steps(search: &Search<'_>, adopted: &[Adopted], sound: Vec<Group>, doubtful: Vec<Group>) -> Vec<Step> {
        let mut steps: Vec<Step> = Vec::new();
        let ends: Vec<usize> =
            adopted.iter().skip(1).map(|a| a.place).chain([search.design.background.len()]).collect();
        let group_steps = |groups: Vec<Group>, doubt: bool| {
            groups.into_iter().map(move |g| (g.effect, vec![g.joint], g.columns, None, doubt))
        };
        let effects = adopted
            .iter()
            .zip(ends)
            .map(|(a, end)| (a.form.effect(), a.form.joints(), (a.place..end).collect(), Some(a.clone()), false));
        for (effect, joints, columns, one, doubtful) in
            group_steps(sound, false).chain(group_steps(doubtful, true)).chain(effects)
        {
            let same = |s: &&mut Step| s.effect == effect && s.doubtful == doubtful && effect.kind() == Kind::Value;
            match steps.iter_mut().find(same) {
                Some(step) => {
                    step.joints.extend(joints);
                    step.joints.sort_unstable();
                    step.joints.dedup();
                    step.columns.extend(columns);
                    step.adopted.extend(one);
                }
                None => steps.push(Step { effect, joints, columns, adopted: one.into_iter().collect(), doubtful }),
            }
        }
        steps
    }

    /// A run with the columns that were added to the model's own, in the order of the design. `contact`: its torque, where
    /// the run was looked at.
    fn columns<'b>(
        &'b self,
        run: &'b Prepared,
        adopted: &[Adopted],
        contact: Option<&Vec<Vec<f64>>>,
    ) -> RunColumns<'b> {
        let nominal = Physics::new(&run.run, &run.motion, self.nominal, &self.nominal.x).with_known_torque(&run.known);
        let mut extra: Vec<Column> = run.unnamed(self.nominal, &nominal);
        for adopted in adopted {
            if let Some(contact) = contact.filter(|_| adopted.form.has_stretches()) {
                extra.push(contact.iter().cloned().map(Some).collect());
                continue;
            }
            let physics =
                Physics::new(&run.run, &run.motion, self.nominal, &adopted.values).with_known_torque(&run.known);
            let mut columns = run.columns(&adopted.form, &physics);
            // A run without the signal that the form needs is not changed by it.
            columns.resize(adopted.mean.len(), vec![None; run.tau.len()]);
            extra.extend(columns);
        }
        RunColumns { run, extra }
    }

    /// Shares of the squared gap of the nominal model, each joint's torque scaled to rms 1, by joint and regime.
    pub(crate) fn place(&self, measured: &Stages, names: &[String]) -> Vec<Cell> {
        let mut cells = Vec::new();
        let mut total = 0.0;
        for (j, name) in names.iter().enumerate() {
            let regimes = regimes::classify(self.sealed, j);
            let (tau, model) = (&measured.tau[j], &measured.models[0][j]);
            let full = &measured.models[measured.models.len() - 1][j];
            let scale: f64 = tau.iter().map(|t| t * t).sum::<f64>().max(f64::MIN_POSITIVE);
            let counts = self.sealed.silent[j].is_none();
            for regime in Regime::ALL {
                let inside = (0..tau.len()).filter(|k| counts && regimes[*k] == regime);
                let (error, left, rows) = inside.fold((0.0, 0.0, 0usize), |(e, l, n), k| {
                    (e + (tau[k] - model[k]).powi(2), l + (tau[k] - full[k]).powi(2), n + 1)
                });
                total += error / scale;
                let rms = |square: f64| (square / rows.max(1) as f64).sqrt();
                cells.push(Cell {
                    joint: name.clone(),
                    regime,
                    share: error / scale,
                    seconds: rows as f64 * self.sealed.chain.row_period_s,
                    before_nm: rms(error),
                    after_nm: rms(left),
                });
            }
        }
        for cell in &mut cells {
            cell.share /= f64::max(total, f64::MIN_POSITIVE);
        }
        cells.sort_by(|a, b| b.share.total_cmp(&a.share));
        cells
    }
}

/// What an optional step found; one whose equations have no solution is put down, and everything else stands without it.
fn or_said<T>(found: Option<T>, what: &str, left_out: &mut Vec<String>) -> Option<T> {
    if found.is_none() {
        left_out.push(what.to_owned());
    }
    found
}

/// Columns that belong to no cause: offsets, timing, values that may stay as they are. How softly friction turns over is in
/// no model that is handed on, so it is not in what causes are said to leave.
fn remainder(search: &Search<'_>, steps: &[Step]) -> Vec<usize> {
    let turns = turn_columns(search.nominal);
    let free = (0..search.design.background.len()).filter(|c| !turns.contains(c));
    free.filter(|c| !steps.iter().any(|s| s.columns.contains(c))).collect()
}

/// Steps in the order in which each takes most of what is left, on the runs looked at.
fn in_order(
    seen: &[RunColumns<'_>],
    mut steps: Vec<Step>,
    remainder: &[usize],
    nominal: &Nominal,
    x: &DVector<f64>,
    means: &[f64],
) -> (Vec<Step>, Steps) {
    let mut ordered: Vec<Step> = Vec::new();
    let mut order: Steps = Vec::new();
    while !steps.is_empty() {
        let gap = |step: &Step| -> f64 {
            let mut tried = order.clone();
            tried.push(step.columns.clone());
            let run_gap = |run: &RunColumns<'_>| {
                let stages = run.stages(&nominal.x, &tried, x, means);
                Gap::new(&stages.tau, &stages.models[tried.len()]).all
            };
            seen.iter().map(run_gap).sum()
        };
        let gaps: Vec<f64> = steps.iter().map(gap).collect();
        let best = (0..steps.len()).min_by(|a, b| gaps[*a].total_cmp(&gaps[*b])).unwrap_or(0);
        order.push(steps[best].columns.clone());
        ordered.push(steps.swap_remove(best));
    }
    order.push(remainder.to_vec());
    (ordered, order)
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
