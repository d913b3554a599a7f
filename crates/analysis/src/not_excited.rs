//! What the logs did not excite: joints at rest, and directions of the parameter space that keep their nominal values.

use rivet_config::Robot;
use rivet_estimation::offline::Fit;
use serde_json::{Value, json};

use crate::runs;

/// A parameter belongs to a direction from this share of the direction's largest component on.
const MIN_SHARE: f64 = 0.5;
/// Parameters that are listed of one direction, and directions that are listed.
const MAX_PARAMETERS: usize = 3;
const MAX_DIRECTIONS: usize = 12;

/// Joints and directions by name.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct NotExcited {
    joints: Vec<String>,
    /// The main base parameters of each direction, largest component first.
    directions: Vec<Vec<String>>,
}

impl NotExcited {
    /// * `still`: joints (from 0) without rows in motion
    pub(super) fn new(robot: &Robot, fit: &Fit, still: &[usize]) -> NotExcited {
        let names = runs::joint_names(robot);
        let parameters = |direction: &Vec<f64>| {
            let mut order: Vec<usize> = (0..direction.len()).collect();
            order.sort_by(|a, b| direction[*b].abs().total_cmp(&direction[*a].abs()));
            let least = MIN_SHARE * order.first().map_or(0.0, |first| direction[*first].abs());
            let main = order.into_iter().filter(|i| direction[*i].abs() >= least).take(MAX_PARAMETERS);
            main.map(|i| robot.base.name(&robot.model, i)).collect()
        };
        NotExcited {
            joints: still.iter().map(|j| names[*j].clone()).collect(),
            directions: fit.undetermined.iter().map(parameters).collect(),
        }
    }

    /// In one line; empty where everything was excited.
    pub(super) fn text(&self) -> String {
        let mut parts = Vec::new();
        if !self.joints.is_empty() {
            parts.push(format!("joints at rest: {}", self.joints.join(", ")));
        }
        if !self.directions.is_empty() {
            let listed: Vec<String> =
                self.directions.iter().take(MAX_DIRECTIONS).map(|names| names.join(" with ")).collect();
            let more = self.directions.len().saturating_sub(MAX_DIRECTIONS);
            let more = if more > 0 { format!(" and {more} more") } else { String::new() };
            parts.push(format!(
                "{} directions that the logs do not determine keep the nominal values: {}{more}",
                self.directions.len(),
                listed.join(", ")
            ));
        }
        parts.join("; ")
    }

    pub(super) fn json(&self) -> Value {
        json!({"joints_at_rest": self.joints, "directions": self.directions})
    }
}
