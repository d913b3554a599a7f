//! Which files a diagnosis was made of, by which build, and what their clocks are like.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Files and build.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Passport {
    /// The program.
    pub tool: Tool,
    /// Robot file, URDF and logs, in the order of the command.
    pub inputs: Vec<Input>,
    /// Hash of the model that the robot file describes.
    pub model: String,
    /// What is held out, in words.
    pub sealed: String,
    /// Where torque comes from.
    pub torque: String,
    /// Turns of the motor per turn of the joint, where the robot file has them.
    pub gear_ratio: Vec<f64>,
}

/// The program that made a document.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Tool {
    /// Its version.
    pub version: String,
    /// SHA-256 of its executable.
    pub sha256: String,
}

/// A file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Input {
    /// `robot`, `urdf` or `log`.
    pub role: String,
    /// Its name without folders.
    pub name: String,
    /// SHA-256 of its content.
    pub sha256: String,
    /// Of a log: rows, clock, holes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub clock: Option<Clock>,
}

/// A clock that is off.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ClockOff {
    /// Whether the log's own speeds show it; else its rows nearly have the period of the robot file.
    pub sure: bool,
    /// Its size, and its effect on the results.
    pub text: String,
}

/// Time stamps of a log.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Clock {
    /// Rows in the file.
    pub rows: usize,
    /// Its length \[s\].
    pub seconds: f64,
    /// Usual step \[s\].
    pub step_s: f64,
    /// Root mean square of steps about it \[s\].
    pub jitter_s: f64,
    /// Root mean square of what the stamps are off the even clock that was taken for them \[s\]; absent where the stamps were taken.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stamps_jitter_s: Option<f64>,
    /// Error of the clock's rate, and its effect on the results; absent where none was detected.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub off: Option<ClockOff>,
    /// Steps that lack samples, and time without any \[s\].
    pub gaps: usize,
    /// Longest of them \[s\].
    pub longest_gap_s: f64,
    /// Stretches that were diagnosed as runs of their own.
    pub pieces: usize,
    /// Largest share of rows, over the joints, that repeat the position before.
    pub repeated: f64,
}
