//! `trajectory_msgs/JointTrajectoryPoint`

use serde::{Deserialize, Serialize};

use super::header::Duration;

/// A point of a planned motion; an array that is not planned is empty.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct JointTrajectoryPoint {
    /// \[rad, or m\]
    pub positions: Vec<f64>,
    /// \[rad/s, or m/s\]
    pub velocities: Vec<f64>,
    /// \[rad/s^2, or m/s^2\]
    pub accelerations: Vec<f64>,
    /// \[N m, or N\]
    pub effort: Vec<f64>,
    /// Since the start of the motion.
    pub time_from_start: Duration,
}

super::ros_message!(JointTrajectoryPoint, "trajectory_msgs", "JointTrajectoryPoint");
