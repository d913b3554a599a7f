//! What each file format holds of the model that was found.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A file that the model found can be written to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Format {
    /// Its name.
    pub file: String,
    /// Everything the model has.
    pub items: Vec<FormatItem>,
    /// Torque that a reader of this file lacks: root mean square of each joint \[N·m\].
    pub missed_nm: Vec<f64>,
    /// Measured torque without what a reader of this file has: root mean square of each joint \[N·m\].
    #[serde(default)]
    pub gap_nm: Vec<f64>,
    /// The same with the nominal model, written in this format.
    #[serde(default)]
    pub gap_before_nm: Vec<f64>,
}

/// One thing of the model in one format.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FormatItem {
    /// What.
    pub what: String,
    /// `exact`, `approximated` or `missing`.
    pub fidelity: String,
    /// Where it stands, or why it does not.
    pub place: String,
    /// Its torque, lacking without it: root mean square of each joint \[N·m\].
    pub torque_rms_nm: Vec<f64>,
}
