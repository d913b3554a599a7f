//! What stands behind a verdict: the gap step by step, what is left, curves, values.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Number;

/// What stands behind a verdict.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Figures {
    /// The nominal model, then with one thing after another.
    pub stages: Vec<Stage>,
    /// What is left of each joint's torque.
    pub left: Vec<Left>,
    /// Stretches of torque.
    pub excerpts: Vec<Excerpt>,
    /// The gap divided otherwise than by regime.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub views: Option<crate::Views>,
    /// Values of the model.
    pub parameters: Vec<Parameter>,
    /// How wrong the robot file's values are, in units of what CAD models and data sheets usually are.
    pub nominal_error: Number,
}

/// The gap on the held-out log after something was added.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Stage {
    /// What was added; null in the first stage, and for offsets, timing and small changes of values in the last.
    pub effect: Option<String>,
    /// The joints' names.
    pub joints: Vec<String>,
    /// Whether it is named as a cause.
    pub upheld: bool,
    /// Gap, before the held-out torque was read.
    pub predicted: Number,
    /// Lower end of its 90 % interval.
    pub low: Number,
    /// Upper end.
    pub high: Number,
    /// On the held-out torque.
    pub measured: Number,
}

/// What is left of one joint's torque.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Left {
    /// The joint's name.
    pub joint: String,
    /// Share of its square that is above the noise of the torque signal.
    pub above_noise: Number,
    /// Time between lags \[s\].
    pub lag_s: f64,
    /// Autocorrelation from lag 0 on.
    pub autocorrelation: Vec<f64>,
    /// Size below which 95 % of the values of white noise lie.
    pub white: f64,
    /// \[Hz\]
    pub frequencies_hz: Vec<f64>,
    /// Amplitude density with all causes \[N·m/√Hz\].
    pub density_after: Vec<f64>,
    /// With the nominal model.
    pub density_before: Vec<f64>,
    /// By cycles per turn of the joint.
    pub orders: Vec<Order>,
    /// Correlation with what is left on every joint.
    pub correlation: Vec<f64>,
}

/// Amplitude \[N·m\] at an order of the joint's angle.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Order {
    /// Cycles per turn of the joint.
    pub order: f64,
    /// With all causes.
    pub after: f64,
    /// With the nominal model.
    pub before: f64,
}

/// A stretch of one joint's torque \[N·m\].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Excerpt {
    /// The joint's name.
    pub joint: String,
    /// Time of the first point \[s\].
    pub from_s: f64,
    /// Time between points \[s\].
    pub step_s: f64,
    /// Measured.
    pub measured: Vec<f64>,
    /// Of the nominal model.
    pub given: Vec<f64>,
    /// Of the model with all causes.
    pub with_causes: Vec<f64>,
    /// Standstill and reversals, where stiction holds what no model predicts: from and to \[s\].
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub standstill_s: Vec<[f64; 2]>,
}

/// One value of the model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Parameter {
    /// Its name.
    pub name: String,
    /// Its unit.
    pub unit: String,
    /// The joint or link that it belongs to, from 1.
    pub joint: Option<usize>,
    /// In the robot file.
    pub given: Number,
    /// As found.
    pub found: Number,
    /// Lower end of its 90 % interval over resampled blocks.
    pub low: Number,
    /// Upper end.
    pub high: Number,
    /// `pinned`, `not_pinned` or `at_bound`.
    pub state: String,
    /// Whether the evidence requires another value than the nominal one.
    pub wrong: bool,
}

impl Parameter {
    /// How many times as large its change is as its interval.
    pub(crate) fn clearness(&self) -> f64 {
        let change = || Some((self.found? - self.given?).abs() / (self.high? - self.low?));
        change().filter(|times| times.is_finite()).unwrap_or(0.0)
    }
}

/// One joint of the held-out log with and without a cause, against the quantity in which it shows.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Curve {
    /// The joint's name.
    pub joint: String,
    /// The quantity.
    pub variable: String,
    /// Its unit.
    pub unit: String,
    /// Whether residuals count along the motion: positive where they brake.
    pub along_motion: bool,
    /// Root mean square of the cause's torque on this joint \[N·m\].
    pub rms_nm: Number,
    /// Rows whose quantity is about the same.
    pub points: Vec<Point>,
}

/// Means over rows \[N·m\].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Point {
    /// Of the quantity.
    pub at: f64,
    /// Of the residual with all causes but this one.
    pub without: f64,
    /// Quartiles of the same.
    pub spread: [f64; 2],
    /// Of the residual with all causes.
    pub with: f64,
    /// Of the cause's own torque.
    pub cause: f64,
    /// How many rows.
    pub rows: usize,
}
