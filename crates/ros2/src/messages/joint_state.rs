//! `sensor_msgs/JointState`

use serde::{Deserialize, Serialize};

use super::header::Header;

/// What the joints of a robot measure; an array that is not known is empty.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct JointState {
    /// When it was measured.
    pub header: Header,
    /// Joints, in any order.
    pub name: Vec<String>,
    /// \[rad, or m\]
    pub position: Vec<f64>,
    /// \[rad/s, or m/s\]
    pub velocity: Vec<f64>,
    /// \[N m, or N\]
    pub effort: Vec<f64>,
}

super::ros_message!(JointState, "sensor_msgs", "JointState");
