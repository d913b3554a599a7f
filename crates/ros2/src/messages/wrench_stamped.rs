//! `geometry_msgs/WrenchStamped`

use serde::{Deserialize, Serialize};

use super::header::Header;

/// A force and a torque in a frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct WrenchStamped {
    /// When, and in which frame.
    pub header: Header,
    /// What acts.
    pub wrench: Wrench,
}

/// `geometry_msgs/Wrench`
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Wrench {
    /// \[N\]
    pub force: Vector3,
    /// About the frame's origin \[N m\].
    pub torque: Vector3,
}

/// `geometry_msgs/Vector3`
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Vector3 {
    /// Along x.
    pub x: f64,
    /// Along y.
    pub y: f64,
    /// Along z.
    pub z: f64,
}

impl From<[f64; 3]> for Vector3 {
    fn from([x, y, z]: [f64; 3]) -> Vector3 {
        Vector3 { x, y, z }
    }
}

super::ros_message!(WrenchStamped, "geometry_msgs", "WrenchStamped");
