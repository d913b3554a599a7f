//! What these very runs would have shown of effects that they do not have.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Number;

/// Effects of graded strength added to the runs, and what was found of them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SelfCheck {
    /// How much of the runs was used \[s\].
    pub seconds: f64,
    /// Times that nothing was added and the residual changed sign block by block instead.
    pub resamplings: usize,
    /// How many of these were given a name.
    pub false_alarms: usize,
    /// Effect by effect.
    pub powers: Vec<Power>,
}

/// The weakest effect that was found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Power {
    /// Its name.
    pub effect: String,
    /// The joint's name; null for the whole arm.
    pub joint: Option<String>,
    /// Unit of sizes.
    pub unit: String,
    /// Size of the weakest that was found; null when none was.
    pub smallest: Number,
    /// Torque that it adds where it adds most, root mean square \[N·m\].
    pub torque_nm: Number,
    /// The same over what the model leaves there.
    pub over_noise: Number,
    /// Size of the strongest that was tried.
    pub strongest: f64,
    /// What was named instead at the strongest, where that was something else.
    pub instead: Option<String>,
    /// Whether the probe finds it in these runs without its being added, so that nothing could be asked.
    pub named_already: bool,
}
