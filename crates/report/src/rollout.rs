//! What the corrected simulator does in closed loop, beside the one as given.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::words::figure;

/// Both simulators driven by the log's torque and a weak position loop.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Rollout {
    /// Whether the corrected one is closer to the log at the longest horizon, in position and in torque; else what was found
    /// holds for torque only.
    pub closer: bool,
    /// Instants that it was started from.
    pub starts: usize,
    /// Effects that the simulator does not have, and where a simulated arm ran away.
    pub not_simulated: Vec<String>,
    /// By horizon.
    pub points: Vec<RolloutPoint>,
}

/// Errors at one horizon: root mean squares over starts and joints.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[allow(missing_docs, reason = "before and after of two measures are the names themselves")]
pub struct RolloutPoint {
    /// Time since the start \[s\].
    pub horizon_s: f64,
    /// Of position \[rad\].
    pub position_before_rad: f64,
    pub position_after_rad: f64,
    /// Of the torque that the loop adds until then, over each joint's torque.
    pub torque_before: f64,
    pub torque_after: f64,
}

/// An angle \[rad\] in mrad.
fn mrad(angle: f64) -> String {
    figure(1e3 * angle, 3)
}

impl Rollout {
    /// In a line.
    pub fn text(&self) -> String {
        let Some(end) = self.points.last() else {
            return match self.not_simulated.as_slice() {
                [] => "too short a run for a rollout".to_owned(),
                why => format!("torque only: {}", why.join("; ")),
            };
        };
        let verdict = if self.closer {
            "closer to the log in closed loop"
        } else {
            "torque only: in closed loop not closer by 5 % in position and torque"
        };
        let mut text = format!(
            "{verdict}; after {} s from {} starts position is off by {} instead of {} mrad, torque by {:.1} instead of \
             {:.1} %",
            end.horizon_s,
            self.starts,
            mrad(end.position_after_rad),
            mrad(end.position_before_rad),
            100.0 * end.torque_after,
            100.0 * end.torque_before
        );
        for effect in &self.not_simulated {
            text += "; ";
            text += effect;
        }
        text
    }
}
