//! The details behind the figures: every stage of the model, every joint, every value, the residual.

use nalgebra::{DMatrix, DVector};
use rivet_dynamics::Parameter;

use crate::effects::Effect;
use crate::fit::prediction::Prediction;
use crate::fit::search::Search;
use crate::fit::stages::Stages;
use crate::policy::POLICY;
use crate::report::curves::Excerpt;
use crate::report::residual_tests::Leftover;
use crate::report::views::Views;
use crate::select::values::Wrong;

/// Deviations on either side that hold 90 %.
const NINETY: f64 = 1.645;

/// All of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Details {
    /// The model as given, then with one thing after another.
    pub stages: Vec<Stage>,
    /// Joint by joint, in the unit of torque.
    pub ledger: Vec<Ledger>,
    /// What is left of each joint's torque.
    pub left: Vec<Leftover>,
    /// The gap divided otherwise than by regime.
    pub views: Views,
    /// Stretches of torque.
    pub excerpts: Vec<Excerpt>,
    /// Values of the model.
    pub parameters: Vec<ParameterLine>,
    /// How wrong the values of the robot file are, in units of what CAD models and data sheets usually are.
    pub nominal_error: f64,
}

/// The gap on the sealed run after something was added to the model.
#[derive(Clone, Debug, PartialEq)]
pub struct Stage {
    /// What was added; nothing in the first stage, and offsets, timing and small changes of values in the last.
    pub effect: Option<Effect>,
    /// The joints' names.
    pub joints: Vec<String>,
    /// Whether it is named as a cause.
    pub upheld: bool,
    /// Gap before the sealed torque was looked at.
    pub predicted: f64,
    /// Ends of its 90 % interval.
    pub low: f64,
    /// Upper end.
    pub high: f64,
    /// On the sealed torque.
    pub measured: f64,
}

/// One joint of the sealed run, in the unit of its torque.
#[derive(Clone, Debug, PartialEq)]
pub struct Ledger {
    /// The joint's name.
    pub joint: String,
    /// Root mean square of the torque.
    pub torque: f64,
    /// Root mean square of what the model as given leaves.
    pub before: f64,
    /// With all causes.
    pub after: f64,
    /// Of the torque signal's noise.
    pub floor: f64,
    /// Mean of what the model as given leaves.
    pub bias_before: f64,
    /// With all causes.
    pub bias_after: f64,
    /// Largest.
    pub peak_before: f64,
    /// With all causes.
    pub peak_after: f64,
}

/// What the runs say about a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ParameterState {
    /// The runs decide it.
    Pinned,
    /// The runs say little; the file's value and its usual error decide.
    NotPinned,
    /// It came out where no arm can be: friction or inertia of zero or less.
    AtBound,
}

impl ParameterState {
    /// The name in reports.
    pub fn name(self) -> &'static str {
        match self {
            ParameterState::Pinned => "pinned",
            ParameterState::NotPinned => "not_pinned",
            ParameterState::AtBound => "at_bound",
        }
    }
}

/// One value of the model.
#[derive(Clone, Debug, PartialEq)]
pub struct ParameterLine {
    /// Its name.
    pub name: String,
    /// Its unit.
    pub unit: &'static str,
    /// The joint or link that it belongs to, from 0; none for those of a coupling.
    pub joint: Option<usize>,
    /// In the robot file.
    pub given: f64,
    /// As found.
    pub found: f64,
    /// Ends of its 90 % interval over resampled blocks of the runs.
    pub low: f64,
    /// Upper end.
    pub high: f64,
    /// What the runs say about it.
    pub state: ParameterState,
    /// Whether the evidence wants it changed.
    pub wrong: bool,
}

/// Ledger of the sealed run; no numbers of a joint that does not count on it.
pub(crate) fn ledger(stages: &Stages, floor: &[f64], names: &[String]) -> Vec<Ledger> {
    let full = &stages.models[stages.models.len() - 1];
    names
        .iter()
        .enumerate()
        .map(|(j, name)| {
            let tau = &stages.tau[j];
            let counts = tau.iter().any(|t| *t != 0.0);
            let n = if counts { tau.len() as f64 } else { f64::NAN };
            let error = |model: &[f64]| -> [f64; 3] {
                let (square, sum, peak) = tau.iter().zip(model).fold((0.0, 0.0, 0.0_f64), |(s, m, p), (t, v)| {
                    let e = t - v;
                    (s + e * e, m + e, p.max(e.abs()))
                });
                [(square / n).sqrt(), sum / n, if counts { peak } else { f64::NAN }]
            };
            let (before, after) = (error(&stages.models[0][j]), error(&full[j]));
            Ledger {
                joint: name.clone(),
                torque: (tau.iter().map(|t| t * t).sum::<f64>() / n).sqrt(),
                before: before[0],
                after: after[0],
                floor: floor[j],
                bias_before: before[1],
                bias_after: after[1],
                peak_before: before[2],
                peak_after: after[2],
            }
        })
        .collect()
}

/// What the runs leave unsure of the model's values with everything free, before some of them are believed as given.
pub(crate) struct Unsure {
    /// Share of each value's usual error.
    pub(crate) share: Vec<f64>,
    /// Covariance of the values where errors of the file are as large as they came out, and no smaller than they usually are.
    pub(crate) covariance: DMatrix<f64>,
}

pub(crate) fn unsure(search: &Search<'_>) -> Option<Unsure> {
    let (usual, found) = (search.solved(1.0)?, search.solved(search.scale.max(1.0))?);
    let shares = usual.deviations().into_iter().zip(search.design.background.std.iter());
    let share = shares.map(|(after, before)| after / before).collect();
    Some(Unsure { share, covariance: found.covariance(search.nominal.x.len())? })
}

/// The model's values: nominal, and found with everything free. The `named` ones are found with the coefficients of the `corrected` model.
pub(crate) fn parameters(
    search: &Search<'_>,
    unsure: &Unsure,
    wrong: &Wrong,
    x: &DVector<f64>,
    (named, corrected): (&[usize], &DVector<f64>),
    prediction: &Prediction,
) -> Vec<ParameterLine> {
    let model = &search.nominal.model;
    model
        .parameters
        .iter()
        .enumerate()
        .map(|(i, parameter)| {
            let given = search.nominal.x[i];
            // The other causes change a value when a withdrawn one no longer takes its part.
            let shift = if named.contains(&i) { corrected[i] - x[i] } else { 0.0 };
            let found = given + x[i] + shift;
            // Resampled blocks tell how much a fit varies that believes some values as given; whether those are right they do not.
            let half = NINETY * unsure.covariance[(i, i)].max(0.0).sqrt();
            let (low, high) = prediction.coefficients[i];
            let (low, high) = (low.min(x[i] - half), high.max(x[i] + half));
            let positive = match parameter {
                Parameter::Link { entry, .. } => matches!(entry, 0 | 4 | 6 | 9),
                Parameter::RotorInertia(_) | Parameter::Coulomb(_) | Parameter::Viscous(_) => true,
                _ => false,
            };
            let name = parameter.name(&model.arm);
            let impossible = wrong.impossible.iter().any(|(_, what)| what.name == name);
            let state = match () {
                () if impossible => ParameterState::AtBound,
                () if positive && found <= 0.0 && x[i] != 0.0 => ParameterState::AtBound,
                () if unsure.share[i] < POLICY.plausibility.max_pinned_share => ParameterState::Pinned,
                () => ParameterState::NotPinned,
            };
            ParameterLine {
                name,
                unit: parameter.unit(&model.arm),
                joint: parameter.joint(),
                given,
                found,
                low: (given + shift + low).min(found),
                high: (given + shift + high).max(found),
                state,
                wrong: x[i] != 0.0 && wrong.groups.iter().any(|g| g.columns.contains(&i)),
            }
        })
        .collect()
}
