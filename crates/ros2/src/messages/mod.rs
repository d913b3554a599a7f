//! Messages of ROS 2 as this program sends and takes them, one file each, in the order of their definitions.
//!
//! On the wire they are CDR, little-endian, as every ROS 2 middleware writes them. A type's name on DDS has `::dds_::` before its
//! last part and `_` behind it; a topic `/x` is `rt/x` there.

mod controller_state;
mod diagnostics;
mod float64_multi_array;
mod header;
mod joint_state;
mod joint_trajectory_point;
mod string;
mod wrench_stamped;

pub use controller_state::JointTrajectoryControllerState;
pub use diagnostics::{DiagnosticArray, DiagnosticStatus, KeyValue, Level};
pub use float64_multi_array::{Float64MultiArray, MultiArrayDimension, MultiArrayLayout};
pub use header::{Duration, Header, Time};
pub use joint_state::JointState;
pub use joint_trajectory_point::JointTrajectoryPoint;
pub use string::Text;
pub use wrench_stamped::{Vector3, Wrench, WrenchStamped};

/// A message of ROS 2.
pub trait RosMessage {
    /// Package and name, such as `("sensor_msgs", "JointState")`.
    const TYPE: (&'static str, &'static str);

    /// Name of the type on DDS, such as `sensor_msgs::msg::dds_::JointState_`.
    fn dds_type() -> String {
        format!("{}::msg::dds_::{}_", Self::TYPE.0, Self::TYPE.1)
    }

    /// Name of the type in ROS 2, such as `sensor_msgs/msg/JointState`.
    fn ros_type() -> String {
        format!("{}/msg/{}", Self::TYPE.0, Self::TYPE.1)
    }
}

/// Declares the type's name.
macro_rules! ros_message {
    ($type:ident, $package:literal, $name:literal) => {
        impl $crate::messages::RosMessage for $type {
            const TYPE: (&'static str, &'static str) = ($package, $name);
        }
    };
}
use ros_message;

/// The name on DDS of the ROS topic `topic`, such as `rt/joint_states` for `/joint_states`.
///
/// # Errors
/// The rule of ROS names that `topic` breaks.
pub fn dds_topic(topic: &str) -> Result<String, String> {
    rivet_service::check_ros_topic(topic)?;
    Ok(format!("rt/{}", topic.strip_prefix('/').unwrap_or(topic)))
}

/// The part of a topic that names a robot: every character that a topic cannot have is `_`.
pub fn topic_part(name: &str) -> String {
    let mut part: String = name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    if part.starts_with(|c: char| c.is_ascii_digit()) {
        part.insert(0, '_');
    }
    part
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_follow_the_rules_of_ros() {
        assert_eq!(dds_topic("/joint_states").as_deref(), Ok("rt/joint_states"));
        assert_eq!(dds_topic("arm/joint_states").as_deref(), Ok("rt/arm/joint_states"));
        for wrong in ["", "/", "/a//b", "/a/", "/1a", "/a-b", "/a b"] {
            assert!(dds_topic(wrong).is_err(), "{wrong:?}");
        }
        assert_eq!(topic_part("ur10e-left.2"), "ur10e_left_2");
        assert_eq!(topic_part("7dof"), "_7dof");
        assert_eq!(JointState::dds_type(), "sensor_msgs::msg::dds_::JointState_");
        assert_eq!(Text::ros_type(), "std_msgs/msg/String");
    }
}
