//! Sizes of the upheld causes, with everything that was withdrawn held at its nominal value.
//!
//! A cause whose size is outside of physical bounds is withdrawn, and the others are estimated again.

use nalgebra::DVector;

use crate::effects::SizeReference;
use crate::effects::external_force::Force;
use crate::effects::physical_bounds::{self, Impossible};
use crate::effects::{Effect, Kind};
use crate::fit::evidence::Solved;
use crate::fit::prediction::ends;
use crate::fit::search::Search;
use crate::judge::fitted_steps::FittedSteps;
use crate::judge::procedure::{Procedure, Step};
use crate::policy::POLICY;
use crate::report::diagnosis::{Cause, Diagnosis, Verdict};
use crate::select::adopted::{self, Adopted};
use crate::select::value_group::{self, Group};
use crate::select::values::Wrong;

/// What stands.
pub(crate) struct Sized {
    /// Places of the wrong groups that are held as given.
    pub(crate) held: Vec<usize>,
    /// Whether that is to the last digit: of another arm's file, where values held a little loosely would still be drawn far off.
    pub(crate) frozen: bool,
    /// Places of the model's values that are named.
    pub(crate) named: Vec<usize>,
    /// Effects.
    pub(crate) effects: Vec<Adopted>,
    /// Coefficients of the design's columns; those of effects that do not stand mean nothing.
    pub(crate) x: DVector<f64>,
}

/// A value of a cause that no arm has.
struct Refused {
    /// Place of the cause.
    cause: usize,
    joints: Vec<usize>,
    what: Impossible,
}

impl Procedure<'_> {
    /// Puts sizes to the causes of a report and takes impossible ones from it.
    pub(crate) fn size(
        &self,
        report: &mut Diagnosis,
        search: &mut Search<'_>,
        wrong: &Wrong,
        fit: &FittedSteps<'_>,
        upheld: &[bool],
    ) -> Option<Sized> {
        let FittedSteps { steps, deviations, .. } = fit;
        let steps_that =
            |stands: bool| steps.iter().zip(upheld).filter(move |(_, u)| **u == stands).map(|(step, _)| step);
        for adopted in steps_that(false).flat_map(|step| &step.adopted) {
            search.design.forget(&adopted.form, adopted.place, &adopted.mean);
        }
        let mut held_groups: Vec<usize> =
            (0..wrong.groups.len()).filter(|at| steps_that(false).any(|step| has(step, &wrong.groups[*at]))).collect();
        let mut standing: Vec<Step> = steps_that(true).cloned().collect();
        let mut refused: Vec<Refused> = Vec::new();
        let frozen = !report.other_arm.is_empty();
        let solved = loop {
            let solved = wrong.solve_held(search, &held_groups, frozen)?;
            let before = refused.len();
            refused.extend(self.refuse_effects(search, &mut standing, &solved));
            refused.extend(self.refuse_values(wrong, &mut held_groups, &mut standing, &solved));
            if refused.len() == before {
                break solved;
            }
        };
        let names = self.names();
        for (cause, step) in report.causes.iter_mut().zip(&standing) {
            let confirmed = step.on_drives(&self.nominal.model.parameters, |j| cause.joints.contains(&names[j]));
            cause.magnitude = self.magnitude(search, &confirmed, &solved.x, &solved.stretches);
            let mut moved: Vec<Step> = Vec::new();
            for (k, adopted) in confirmed.adopted.iter().enumerate() {
                for form in &adopted.inner_ends {
                    let mut step = confirmed.clone();
                    step.adopted[k].form = form.clone();
                    moved.push(step);
                }
            }
            cause.intervals = self.intervals(search, &confirmed, &moved, &solved, deviations);
        }
        let named = !report.causes.is_empty();
        self.withdraw(report, wrong, &standing, &refused);
        let missing = |cause: &Cause| cause.effect.kind() == Kind::Structure;
        if named && matches!(report.verdict, Verdict::Effect | Verdict::Several) && !report.causes.iter().any(missing) {
            report.verdict = Verdict::Unexplained;
        }
        // Nothing else was the answer, and this is none.
        if named && report.causes.is_empty() && report.verdict == Verdict::Parameter {
            report.verdict = Verdict::Unexplained;
        }
        let named = standing.iter().flat_map(|step| step.columns.iter().copied()).collect();
        let effects = standing.into_iter().flat_map(|step| step.adopted).collect();
        Some(Sized { held: held_groups, frozen, named, effects, x: solved.x })
    }

    /// Takes effects from `standing` whose size no arm has, and their columns from the design.
    fn refuse_effects(&self, search: &mut Search<'_>, standing: &mut [Step], solved: &Solved) -> Vec<Refused> {
        let standard = self.standard(standing, solved);
        let mut refused = Vec::new();
        for (cause, step) in standing.iter_mut().enumerate() {
            step.adopted.retain(|a| {
                let c = a.coefficients(&solved.x);
                let Some(what) = a.form.impossible(&c, self.nominal, &standard) else { return true };
                search.design.forget(&a.form, a.place, &a.mean);
                step.columns.retain(|c| !(a.place..a.place + a.mean.len()).contains(c));
                refused.push(Refused { cause, joints: a.form.joints(), what });
                false
            });
        }
        refused
    }

    /// Takes values from `standing` that no arm has; they are `held` from now on.
    fn refuse_values(
        &self,
        wrong: &Wrong,
        held: &mut Vec<usize>,
        standing: &mut [Step],
        solved: &Solved,
    ) -> Vec<Refused> {
        let standard = self.standard(standing, solved);
        let adopted: Vec<Adopted> = standing.iter().flat_map(|step| step.adopted.iter().cloned()).collect();
        let mut refused = Vec::new();
        for (at, group) in wrong.groups.iter().enumerate() {
            let what = value_group::of_group(group, self.nominal, &standard, &adopted);
            let (Some(what), false) = (what, held.contains(&at)) else { continue };
            held.push(at);
            for (cause, step) in standing.iter_mut().enumerate().filter(|(_, step)| has(step, group)) {
                step.columns.retain(|c| !group.columns.contains(c));
                refused.push(Refused { cause, joints: vec![group.joint], what: what.clone() });
            }
        }
        refused
    }

    fn standard(&self, standing: &[Step], solved: &Solved) -> Vec<f64> {
        adopted::standard(self.nominal, &solved.x, standing.iter().flat_map(|step| &step.adopted))
    }

    /// Takes what was refused from the causes; with the `wrong` values that came out impossible before, it becomes hints.
    fn withdraw(&self, report: &mut Diagnosis, wrong: &Wrong, standing: &[Step], refused: &[Refused]) {
        let mut hints: Vec<(Effect, Vec<usize>, Vec<Impossible>)> = Vec::new();
        let before = wrong.impossible.iter().map(|(group, what)| (group.effect, vec![group.joint], what));
        let now = refused.iter().map(|r| (report.causes[r.cause].effect, r.joints.clone(), &r.what));
        for (effect, joints, what) in before.chain(now) {
            match hints.iter_mut().find(|(other, ..)| *other == effect) {
                Some((_, all, whats)) => {
                    all.extend(joints);
                    whats.push(what.clone());
                }
                None => hints.push((effect, joints, vec![what.clone()])),
            }
        }
        let names = |mut joints: Vec<usize>| -> Vec<String> {
            joints.sort_unstable();
            joints.dedup();
            joints.iter().map(|j| self.nominal.model.arm.joints[*j].name.clone()).collect()
        };
        let hints = hints.into_iter().map(|(effect, joints, what)| hint(effect, names(joints), &what));
        report.withdrawn.extend(hints);
        for (k, (cause, step)) in report.causes.iter_mut().zip(standing).enumerate() {
            if refused.iter().any(|r| r.cause == k) {
                let groups = wrong.groups.iter().filter(|group| has(step, group)).map(|group| group.joint);
                cause.joints = names(groups.chain(step.adopted.iter().flat_map(|a| a.form.joints())).collect());
            }
        }
        // Contact has no columns of its own.
        let is_kept = |k: usize| {
            let nothing = standing[k].columns.is_empty() && standing[k].adopted.is_empty();
            !nothing || refused.iter().all(|r| r.cause != k)
        };
        let mut kept_causes = (0..standing.len()).map(is_kept);
        report.causes.retain(|_| kept_causes.next() == Some(true));
    }

    /// Sizes of all that a step adds, with the coefficients `x` of the design and `stretches`.
    pub(crate) fn magnitude(
        &self,
        search: &Search<'_>,
        step: &Step,
        x: &DVector<f64>,
        stretches: &[DVector<f64>],
    ) -> Vec<(String, f64)> {
        let model = &self.nominal.model;
        let standard = adopted::standard(self.nominal, x, &step.adopted);
        // Of a body's ten values some are in no joint's torque and stay as given.
        let changed_columns =
            step.columns.iter().filter(|c| self.nominal.x.get(**c).is_some_and(|given| *given != standard[**c]));
        // Next to nothing is nothing.
        let least = |c: usize| if physical_bounds::is_drive(model.parameters[c]) { 0.0 } else { f64::NEG_INFINITY };
        let value = |c: &usize| standard[*c].max(least(*c));
        let mut sizes: Vec<(String, f64)> =
            changed_columns.map(|c| (model.parameters[*c].name(&model.arm), value(c))).collect();
        let several = sizes.len() + step.adopted.len() > 1;
        for adopted in &step.adopted {
            let mut c: Vec<f64> = if adopted.form.has_stretches() {
                stretches.iter().flatten().copied().collect()
            } else {
                adopted.coefficients(x)
            };
            // One value by two columns, the model's and its own.
            if let Some(at) = adopted.form.place(model.arm.dof()) {
                c[0] += x[at];
            }
            let values = match adopted.form.size_reference() {
                SizeReference::Fitted => search.values(x),
                SizeReference::Column => adopted.values.clone(),
                SizeReference::Nominal => self.nominal.x.clone(),
            };
            for (name, size) in adopted.form.magnitude(&c, search.floor.len(), &values) {
                let joint =
                    adopted.form.joints().first().filter(|_| several).map(|j| model.arm.joints[*j].name.clone());
                sizes.push((joint.map_or(name.clone(), |joint| format!("{joint}.{name}")), size));
            }
            if let Some(force @ Force { moment, .. }) = adopted.form.get() {
                if force.has_size(search.floor.len()) {
                    let steady = search.steady_force(stretches, *moment).map(|of_burst| of_burst.norm());
                    sizes.push(("steady_N".to_owned(), steady.fold(0.0, f64::max)));
                }
                let torque = search.design.local_torque(stretches);
                let largest = torque.iter().flatten().flatten().fold(0.0, |most: f64, t| most.max(t.abs()));
                sizes.push(("largest_joint_Nm".to_owned(), largest));
            }
        }
        sizes
    }

    /// 90 % interval of each size, with its name: over each set of `deviations` of the coefficients from their estimate, over the step
    /// with an inner value `moved` to an end of its interval, and around all. Sizes that neither decides have none.
    fn intervals(
        &self,
        search: &Search<'_>,
        step: &Step,
        moved: &[Step],
        solved: &Solved,
        deviations: &[Vec<DVector<f64>>],
    ) -> Vec<(String, [f64; 2])> {
        let mut intervals: Vec<(String, [f64; 2])> = self
            .magnitude(search, step, &solved.x, &solved.stretches)
            .into_iter()
            .map(|(name, size)| (name, [size, size]))
            .collect();
        for set in deviations {
            let sizes = |d: &DVector<f64>| self.magnitude(search, step, &(&solved.x + d), &solved.stretches);
            let drawn: Vec<Vec<(String, f64)>> = set.iter().map(sizes).collect();
            for (name, [low, high]) in &mut intervals {
                let draws = drawn.iter().flatten().filter(|(of, _)| of == name).map(|(_, size)| *size).collect();
                if let Some((from, to)) = ends(draws) {
                    (*low, *high) = (low.min(from), high.max(to));
                }
            }
        }
        for (name, size) in moved.iter().flat_map(|step| self.magnitude(search, step, &solved.x, &solved.stretches)) {
            for (_, [low, high]) in intervals.iter_mut().filter(|(of, _)| *of == name) {
                (*low, *high) = (low.min(size), high.max(size));
            }
        }
        // Values of the model enter linearly: where its laws hold, resamplings and posterior hold them as often as they say.
        let widening = if step.effect.kind() == Kind::Value { 1.0 } else { POLICY.prediction.size_widening };
        let model = &self.nominal.model;
        let drives =
            step.columns.iter().filter_map(|c| model.parameters.get(*c)).filter(|p| physical_bounds::is_drive(**p));
        let drives: Vec<String> = drives.map(|p| p.name(&model.arm)).collect();
        let law = |name: &String, size: f64| {
            if drives.contains(name) { POLICY.prediction.drive_law_error * size } else { 0.0 }
        };
        let sizes = self.magnitude(search, step, &solved.x, &solved.stretches);
        for ((name, [low, high]), (_, size)) in
            intervals.iter_mut().zip(sizes).filter(|((_, [low, high]), _)| low < high)
        {
            let wider = |end: f64| (widening * (end - size)).hypot(law(name, size));
            (*low, *high) = (size - wider(*low), size + wider(*high));
        }
        intervals.retain(|(_, [low, high])| low < high && low.is_finite() && high.is_finite());
        intervals
    }
}

fn has(step: &Step, group: &Group) -> bool {
    group.columns.iter().all(|c| step.columns.contains(c))
}

/// What would have been a cause, had it been possible.
pub(crate) fn hint(effect: Effect, joints: Vec<String>, what: &[Impossible]) -> Cause {
    Cause {
        magnitude: what.iter().map(|what| (what.name.clone(), what.value)).collect(),
        impossible: Some(physical_bounds::text(what)),
        ..Cause::unmeasured(effect, joints)
    }
}
