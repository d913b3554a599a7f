//! The steps of the selection as they were fitted: one for each effect, their columns along every run, and the stages that they make.

use nalgebra::DVector;

use crate::effects::Kind;
use crate::effects::physics::Physics;
use crate::fit::evidence::Solved;
use crate::fit::prediction::{Fitted, Prediction, predict};
use crate::fit::search::Search;
use crate::fit::stages::{RunColumns, Stages, Steps};
use crate::judge::procedure::{Procedure, Step};
use crate::model::gap::Gap;
use crate::model::nominal::Nominal;
use crate::model::rows::Column;
use crate::policy::POLICY;
use crate::screen::prepared::{Prepared, turn_columns, unknown};
use crate::select::adopted::Adopted;
use crate::select::residual::Residue;
use crate::select::value_group::Group;

/// All steps, in the order in which each takes most.
pub(crate) struct FittedSteps<'a> {
    nominal: &'a Nominal,
    pub(crate) solved: Solved,
    pub(crate) steps: Vec<Step>,
    /// Columns by step; those of no step last.
    order: Steps,
    /// Means that the design takes out of coefficients.
    pub(crate) means: Vec<f64>,
    /// The training runs with the columns that were added.
    pub(crate) seen: Vec<RunColumns<'a>>,
    /// The held-out run with them.
    pub(crate) hidden: RunColumns<'a>,
    /// Deviations of the coefficients from their estimate: over resampled blocks of the runs, and over the posterior. Empty before the
    /// prediction.
    pub(crate) deviations: Vec<Vec<DVector<f64>>>,
}

impl<'a> FittedSteps<'a> {
    /// What was adopted, and the `groups` of values that are wrong; none where the equations have no solution.
    pub(crate) fn new(
        procedure: &Procedure<'a>,
        search: &Search<'_>,
        adopted: &[Adopted],
        groups: &[Group],
    ) -> Option<FittedSteps<'a>> {
        let nominal = procedure.nominal;
        let solved = search.solved(search.scale)?;
        let contact = search.design.local_torque(&solved.stretches);
        let residue = Residue::from_search(search);
        let missing = |g: &Group| g.columns.iter().all(|c| nominal.x[*c] == 0.0);
        let imitates =
            |g: &Group| residue.is_nameless(g.joint) && !(missing(g) && takes_most(procedure, search, g.joint));
        let (doubtful, sound): (Vec<Group>, Vec<Group>) = groups.iter().cloned().partition(imitates);
        let steps = steps(search, adopted, sound, doubtful);
        let means: Vec<f64> = std::iter::repeat_n(0.0, nominal.x.len() + unknown(nominal, 1.0).len())
            .chain(adopted.iter().flat_map(|a| a.mean.iter().copied()))
            .collect();
        let looked = procedure.look.iter().zip(&contact);
        let seen: Vec<RunColumns<'_>> =
            looked.map(|(run, contact)| columns(nominal, run, adopted, Some(contact))).collect();
        let hidden = columns(nominal, procedure.sealed, adopted, None);
        let remainder = remainder(search, &steps);
        let (steps, order) = in_order(&seen, steps, &remainder, nominal, &solved.x, &means);
        Some(FittedSteps { nominal, solved, steps, order, means, seen, hidden, deviations: Vec::new() })
    }

    /// Predicts the gap of the held-out run after each step.
    pub(crate) fn predict(&mut self, search: &Search<'_>) -> Option<Prediction> {
        // The motion does not tell when contact comes: on the held-out run it is part of what is left.
        let silent: Vec<usize> =
            self.steps.iter().filter(|s| s.effect.about().is_intermittent).flat_map(|s| s.columns.clone()).collect();
        let fitted = Fitted { nominal: &self.nominal.x, steps: &self.order, x: &self.solved.x, means: &self.means };
        let prediction = predict(search, &self.seen, &self.hidden, &fitted, &silent)?;
        // Errors of the file are as large as they came out, and no smaller than they usually are.
        let posterior = search.solved(search.scale.max(1.0))?.deviations_drawn(prediction.deviations.len());
        self.deviations = vec![prediction.deviations.clone(), posterior];
        Some(prediction)
    }

    /// Models from the nominal one to that with all steps along a run.
    pub(crate) fn stages(&self, run: &RunColumns<'_>) -> Stages {
        run.stages_turned(&self.nominal.x, &self.order, &self.solved.x, &self.means, turn_columns(self.nominal))
    }
}

/// Whether values refitted take most of the squared gap of joint `j` on the runs looked at.
fn takes_most(procedure: &Procedure<'_>, search: &Search<'_>, j: usize) -> bool {
    let none = Vec::new();
    let gap = |run: &Prepared| {
        let as_given =
            RunColumns { run, extra: Vec::new() }.stages(&procedure.nominal.x, &none, &DVector::zeros(0), &[]);
        let residual = |k: usize| as_given.tau[j][k] - as_given.models[0][j][k];
        (0..run.rows()).fold((0.0, 0.0), |(square, rows), k| (square + residual(k).powi(2), rows + 1.0))
    };
    let (square, rows) =
        procedure.look.iter().map(gap).fold((0.0, 0.0), |(s, n), (square, rows)| (s + square, n + rows));
    search.first_noise[j].powi(2) * f64::max(rows, 1.0) < (1.0 - POLICY.plausibility.min_unknown_value_share) * square
}

/// What was adopted and which values are wrong, one step an effect; structure on several joints stays apart.
fn steps(search: &Search<'_>, adopted: &[Adopted], sound: Vec<Group>, doubtful: Vec<Group>) -> Vec<Step> {
    let mut steps: Vec<Step> = Vec::new();
    let ends: Vec<usize> = adopted.iter().skip(1).map(|a| a.place).chain([search.design.background.len()]).collect();
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
fn columns<'a>(
    nominal: &'a Nominal,
    run: &'a Prepared,
    adopted: &[Adopted],
    contact: Option<&Vec<Vec<f64>>>,
) -> RunColumns<'a> {
    let as_given = Physics::new(&run.run, &run.motion, nominal, &nominal.x).with_known_torque(&run.known);
    let mut extra: Vec<Column> = run.unnamed(nominal, &as_given);
    for adopted in adopted {
        if let Some(contact) = contact.filter(|_| adopted.form.has_stretches()) {
            extra.push(contact.iter().cloned().map(Some).collect());
            continue;
        }
        let physics = Physics::new(&run.run, &run.motion, nominal, &adopted.values).with_known_torque(&run.known);
        let mut columns = run.columns(&adopted.form, &physics);
        // A run without the signal that the form needs is not changed by it.
        columns.resize(adopted.mean.len(), vec![None; run.tau.len()]);
        extra.extend(columns);
    }
    RunColumns { run, extra }
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
