//! `control_msgs/JointTrajectoryControllerState`

use serde::{Deserialize, Serialize};

use super::header::Header;
use super::joint_trajectory_point::JointTrajectoryPoint;

/// What a joint trajectory controller plans, as far as it is used here.
///
/// The releases of ROS 2 differ behind the first point and name it `desired` or `reference`. What follows it on the wire is not read.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct JointTrajectoryControllerState {
    /// When the plan is for.
    pub header: Header,
    /// Joints, in any order.
    pub joint_names: Vec<String>,
    /// The plan of this period.
    pub reference: JointTrajectoryPoint,
}

super::ros_message!(JointTrajectoryControllerState, "control_msgs", "JointTrajectoryControllerState");
