//! The corrected model: values, effects, and what each file format carries of them.

use nalgebra::DMatrix;
use rivet_dynamics::{BaseSet, EffectKind, Joints, KnownEffect, KnownEffects, Model};
use rivet_estimation::consistency::{ConsistencyError, Projection, Reference};

use crate::effects::Effect;
use crate::effects::Form;
use crate::effects::carried::Carried;
use crate::effects::physical_bounds;
use crate::experiment::separating_motion::{self, Class, IdentifiedArm, MotionBounds, SeparatingMotion};
use crate::export::file_values::{Draft, Kept, Written, relative, worse};
use crate::export::formats::{Carrying, FormatReport, Part, PartKind, reports, rms};
use crate::export::torque_parts::Told;
use crate::fit::evidence::Solved;
use crate::fit::search::Search;
use crate::judge::cause_sizes::Sized;
use crate::model::nominal::{Nominal, standard_columns};
use crate::model::rows::Column;
use crate::policy::POLICY;
use crate::screen::prepared::Prepared;
use crate::select::adopted::Adopted;
use crate::select::values::Wrong;

/// The corrected model.
#[derive(Clone, Debug)]
pub struct Patch {
    /// Kinematics, gravity, structure and effects. Its bodies are those of the model as given.
    pub model: Model,
    /// Standard vector of the model as the data gave it.
    pub standard: Vec<f64>,
    /// The nearest arm that can be built.
    pub consistent: Result<Projection, ConsistencyError>,
    /// The standard vector to simulate and to write: of an arm that can be built, and on no joint further from the runs than the model
    /// as given, or by no more than a quarter where it is much nearer on the others ([`Stays::worse`]).
    pub written: Vec<f64>,
    /// What of it is as given, though something else was found.
    pub stays: Stays,
    /// Base parameters of `model` that belong to `standard`.
    pub base: Vec<f64>,
    /// Their standard deviations.
    pub std: Vec<f64>,
    /// For each cause that these runs cannot tell from others, the motion that would.
    pub motions: Vec<SeparatingMotion>,
    /// Causes that no file holds, with the reason.
    pub left_out: Vec<(Effect, String)>,
    /// What each format carries.
    pub formats: Vec<FormatReport>,
    /// By how much torque is before position in the logs \[s\]: a property of the recording that no file holds, within a
    /// sample or so.
    pub timing_s: f64,
    /// Its torque, each joint \[N·m\].
    pub timing_rms: Vec<f64>,
    /// Root mean square of the measured torque of all runs, each joint \[N·m\].
    pub torque_rms: Vec<f64>,
}

impl Patch {
    /// Drives of a standard vector of the corrected model.
    pub fn drives(&self, standard: &[f64]) -> Joints {
        self.model.drives(standard, Joints::zero(self.model.arm.dof()))
    }
}

/// What stays as given, though something else was found.
#[derive(Clone, Debug, Default)]
pub struct Stays {
    /// Everything: with anything that was found the model is further from the runs.
    pub as_given: bool,
    /// Bodies and drives: no arm that can be built is nearer to the runs.
    pub bodies: bool,
    /// Joints whose drive values do: with others the model is further from the runs there.
    pub joints: Vec<usize>,
    /// Joints whose torque is not believed: so do their drive values.
    pub unheard: Vec<usize>,
    /// Names of drive values that the runs do not pin.
    pub unpinned: Vec<String>,
    /// The free values that fit are not handed on: on runs that they were not fitted to they are worse than those given.
    pub free: bool,
    /// Joints on which the file is further from the runs than the model as given, since it is much nearer on the others.
    pub worse: Vec<usize>,
}

/// What goes into the patch.
pub(crate) struct Found<'a> {
    pub(crate) nominal: &'a Nominal,
    /// All runs, the sealed one included: a patch is made of everything known, after predictions were kept.
    pub(crate) runs: Vec<&'a Prepared>,
    /// Torque of the timing column by run, `[run]`.
    pub(crate) timing: Vec<&'a Column>,
    /// Causes that stand.
    pub(crate) sized: &'a Sized,
    /// Classes that values of the model stand in.
    pub(crate) doubted: Vec<Class<'a>>,
    /// What the arm may do, for motions.
    pub(crate) bounds: &'a MotionBounds,
    /// Values that stay as given.
    pub(crate) kept: Kept,
    /// Covariance of the values with everything free.
    pub(crate) freely: &'a DMatrix<f64>,
}

/// Makes the patch: everything is solved as it was for the sizes of causes, with what stays as given held.
pub(crate) fn make(search: &mut Search<'_>, wrong: &Wrong, found: &Found<'_>) -> Option<Patch> {
    let Found { nominal, runs, kept, .. } = found;
    let upheld = &found.sized.effects;
    let (n, width) = (nominal.model.arm.dof(), nominal.x.len());
    let keeps = |at: &usize| wrong.groups[*at].columns.iter().all(|c| kept.columns().any(|k| k == *c));
    let held_groups: Vec<usize> =
        (0..wrong.groups.len()).filter(|at| found.sized.held.contains(at) || keeps(at)).collect();
    let solved = wrong.solve_held(search, &held_groups, found.sized.frozen)?;
    let mut standard = search.values(&solved.x);
    for c in kept.columns() {
        standard[c] = nominal.x[c];
    }
    let mut gravity = nominal.model.arm.gravity;
    let mut effects: Vec<KnownEffect> = nominal.model.effects().list().to_vec();
    let mut left_out = Vec::new();
    let mut classes: Vec<Class<'_>> = found.doubted.clone();
    let temperature: Option<Vec<f64>> =
        runs.first().and_then(|r| r.run.temperature.as_ref()).map(|t| t.iter().map(|t| t[0]).collect());
    for adopted in upheld {
        let c = adopted.coefficients(&solved.x);
        let rivals: Vec<Form> = adopted.rivals.iter().map(|r| r.form.clone()).collect();
        if rivals.iter().chain([&adopted.form]).all(|form| form.coefficients() > 0) && !rivals.is_empty() {
            classes.push(Class { form: &adopted.form, coefficients: c.clone(), rivals });
        }
        let (carried, beside) = adopted.form.carried(&c, &adopted.values, n, temperature.as_deref());
        for (at, change) in beside {
            standard[at] += change;
        }
        match carried {
            Carried::Effect(effect) if effects.iter().any(|e| (e.kind, e.joint) == (effect.kind, effect.joint)) => {
                let why = match effect.kind {
                    EffectKind::BaseFlexibility => "a file holds one axis",
                    _ => "the nominal file already has this effect on this joint",
                };
                left_out.push((adopted.form.effect(), why.into()));
            }
            Carried::Effect(effect) => effects.push(effect),
            Carried::Values(changes) => {
                for (at, change) in changes {
                    standard[at] += change;
                }
            }
            Carried::Gravity(change) => gravity.iter_mut().zip(change).for_each(|(g, c)| *g += c),
            Carried::Nothing(why) => left_out.push((adopted.form.effect(), why.to_owned())),
        }
    }
    // Next to nothing is nothing, as causes say it; where an effect has a part of the value, only their sum means anything.
    let alone = |j: Option<usize>| upheld.iter().all(|a| j.is_none_or(|j| !a.form.joints().contains(&j)));
    for (c, parameter) in nominal.model.parameters.iter().enumerate() {
        if found.sized.named.contains(&c) && physical_bounds::is_drive(*parameter) && alone(parameter.joint()) {
            standard[c] = standard[c].max(0.0);
        }
    }
    let tilted = gravity != nominal.model.arm.gravity;
    let mut arm = nominal.model.arm.clone();
    arm.gravity = gravity;
    let drives = nominal.model.drives(&standard, Joints::zero(n));
    let model = Model::new(arm, nominal.model.structure)
        .with_load(nominal.model.load().to_vec())
        .with_effects(KnownEffects::new(effects.clone(), &drives));
    let base_set = BaseSet::new(&model).ok()?;
    let mut base = base_set.from_standard(&standard);
    let covariance = base_covariance(&base_set, &covariance_of_values(&solved, upheld, n, width)?);
    // Rows of all runs, under the gravity that holds.
    let fresh: Vec<Option<Vec<Column>>> =
        runs.iter().map(|run| tilted.then(|| standard_columns(&model, &run.motion, &run.chain))).collect();
    let columns: Vec<&Vec<Column>> = runs.iter().zip(&fresh).map(|(r, f)| f.as_ref().unwrap_or(&r.standard)).collect();
    let mut reference = Reference::new(n, base_set.len());
    for (run, columns) in runs.iter().zip(&columns) {
        add_rows(&mut reference, &base_set, columns, run, width);
    }
    let free_values = standard.clone();
    let draft = Draft {
        nominal,
        runs,
        model: &model,
        columns: columns.clone(),
        standard: &free_values,
        effects: &effects,
        adopted: upheld,
        kept,
    };
    let Written { values: written, effects, consistent, stayed, bodies_stay, as_given } =
        draft.settle(&base_set, &base, &covariance, &reference);
    let before = draft.gaps_as_given();
    // Free values fit the runs that were looked at; they are kept where they do not spoil the sealed one.
    let [loose, bound] = [&standard, &written].map(|values| draft.gaps(values, &effects));
    let spoils = !worse(&loose, &before).is_empty()
        || relative(&loose, &before) > POLICY.plausibility.max_free_gap_ratio * relative(&bound, &before);
    let free = as_given || bodies_stay || spoils;
    let further = if as_given { Vec::new() } else { worse(&bound, &before) };
    if free {
        standard.clone_from(&written);
        base = base_set.from_standard(&standard);
    }
    let (model, columns) = if as_given {
        (nominal.model.clone(), runs.iter().map(|r| &r.standard).collect())
    } else {
        (model.clone().with_effects(KnownEffects::new(effects.clone(), &drives)), columns)
    };
    let tilted = tilted && !as_given;

    let exported = Told { runs, model: &model, columns: columns.clone(), values: &written };
    let mut parts = exported.groups();
    parts.push(Part {
        what: "values as estimated, compared with physically consistent bodies".to_owned(),
        kind: PartKind::Unconstrained,
        torque: exported.torque(|c| standard[c] - written[c]),
    });
    let nominal_effects = nominal.model.effects().list();
    let given =
        Told { runs, model: &nominal.model, columns: runs.iter().map(|r| &r.standard).collect(), values: &nominal.x };
    if tilted {
        let level = Told { model: &model, columns: given.columns.clone(), ..exported };
        let mut torque = exported.torque(|c| written[c]);
        for (to, level) in torque.iter_mut().zip(level.torque(|c| written[c])) {
            to.iter_mut().zip(level).for_each(|(to, level)| *to -= level);
        }
        parts.push(Part { what: "direction of gravity".to_owned(), kind: PartKind::Gravity, torque });
    }
    parts.extend(exported.effects(&effects));
    let before: Vec<Part> = given.groups().into_iter().chain(given.effects(nominal_effects)).collect();
    let measured: Vec<Vec<f64>> =
        (0..n).map(|j| runs.iter().flat_map(|r| r.tau[j].iter().copied()).collect()).collect();
    let timing = solved.x[width];
    let timing_rms = (0..n)
        .map(|j| {
            let all = found.timing.iter().filter_map(|column| column[j].as_ref()).flatten();
            let (square, rows) = all.fold((0.0, 0usize), |(s, n), v| (s + v * v, n + 1));
            timing.abs() * (square / rows.max(1) as f64).sqrt()
        })
        .collect();
    let torque_rms = rms(&measured);
    let usual: Vec<f64> = nominal.std.iter().map(|s| s * search.scale.max(0.1)).collect();
    let looked_at: Vec<&Prepared> = search.runs.clone();
    // Residuals that hang together say less.
    let noise: Vec<f64> =
        search.noise.iter().zip(&search.correlations).map(|(noise, rows)| noise * rows.sqrt()).collect();
    let arm = IdentifiedArm { model: &model, x: &standard, deviations: &usual, noise: &noise };
    let motions =
        classes.iter().filter_map(|class| separating_motion::best(class, arm, &looked_at, found.bounds)).collect();
    // That other values are believed as given makes none of them better known.
    let freely = base_covariance(&base_set, found.freely);
    let std = (0..base.len()).map(|i| covariance[i * base.len() + i].max(freely[i * base.len() + i]).max(0.0).sqrt());
    let std = std.collect();
    let formats = reports(
        &Carrying { parts: &parts, values: &written },
        &Carrying { parts: &before, values: &nominal.x },
        &measured,
    );
    Some(Patch {
        model,
        standard,
        consistent,
        written,
        stays: Stays {
            as_given,
            bodies: bodies_stay,
            joints: stayed,
            unheard: kept.unheard.clone(),
            unpinned: kept.unpinned.iter().map(|c| nominal.model.parameters[*c].name(&nominal.model.arm)).collect(),
            free,
            worse: further,
        },
        base,
        std,
        motions,
        left_out,
        formats,
        timing_s: timing,
        timing_rms,
        torque_rms,
    })
}

/// Covariance of the standard vector: values that were adopted as forms of their own, a body at the flange say, are known no better
/// than their coefficients.
fn covariance_of_values(solved: &Solved, adopted: &[Adopted], joints: usize, width: usize) -> Option<DMatrix<f64>> {
    let all = solved.x.len();
    let mut to: DMatrix<f64> = DMatrix::identity(width, all);
    for a in adopted {
        for k in 0..a.mean.len() {
            let mut unit = vec![0.0; a.mean.len()];
            unit[k] = 1.0;
            let (carried, beside) = a.form.carried(&unit, &a.values, joints, None);
            let changes = if let Carried::Values(changes) = carried { changes } else { Vec::new() };
            for (at, change) in changes.into_iter().chain(beside) {
                to[(at, a.place + k)] += change;
            }
        }
    }
    Some(&to * solved.covariance(all)? * to.transpose())
}

/// `G·C·Gᵀ` row-major, G from standard to base parameters.
fn base_covariance(base: &BaseSet, covariance: &DMatrix<f64>) -> Vec<f64> {
    let width = covariance.nrows();
    let mut g = DMatrix::zeros(base.len(), width);
    for c in 0..width {
        let mut unit = vec![0.0; width];
        unit[c] = 1.0;
        g.column_mut(c).copy_from_slice(&base.from_standard(&unit));
    }
    let found = &g * covariance * g.transpose();
    found.transpose().as_slice().to_vec()
}

/// Adds a run's rows, joint by joint, as base columns.
fn add_rows(reference: &mut Reference, base: &BaseSet, columns: &[Column], run: &Prepared, width: usize) {
    let (n, k) = (run.tau.len(), base.len());
    let (mut full, mut selected) = (vec![0.0; n * width], vec![0.0; n * k]);
    for j in 0..n {
        let mut rows = Vec::with_capacity(run.rows() * k);
        for row in 0..run.rows() {
            full.fill(0.0);
            for (c, column) in columns.iter().enumerate() {
                full[j * width + c] = column[j].as_ref().map_or(0.0, |rows| rows[row]);
            }
            base.select(&full, width, &mut selected);
            rows.extend_from_slice(&selected[j * k..(j + 1) * k]);
        }
        reference.add(j, &rows, &run.tau[j]);
    }
}
