//! The command line of `rivet-ros2`, which is that of `rivet ros2`.

use std::net::IpAddr;
use std::path::PathBuf;

use crate::bridge_options::{BridgeOptions, within};

/// Topic of what a joint trajectory controller plans, under the usual name of the controller.
const POINT: &str = "trajectory_msgs/msg/JointTrajectoryPoint";

/// Joins a graph of ROS 2: joint states and setpoints to rivetd; parameters, diagnostics, payload and URDF to the graph.
#[derive(Clone, Debug, clap::Parser)]
#[command(name = "rivet-ros2", version, max_term_width = 100)]
pub struct Ros2Options {
    /// The robot file.
    #[arg(value_name = "ROBOT.toml")]
    pub robot: PathBuf,
    /// Domain of the graph; ROS_DOMAIN_ID by default, 0 without it
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(0..=232))]
    pub domain: Option<u16>,
    /// Topic of sensor_msgs/JointState
    #[arg(long, value_name = "TOPIC", default_value = "/joint_states", value_parser = topic)]
    pub joint_states: String,
    /// Topic of setpoints, such as /joint_trajectory_controller/controller_state; none by default
    #[arg(long, value_name = "TOPIC", value_parser = topic)]
    pub setpoint: Option<String>,
    /// What the setpoints are
    #[arg(long, value_enum, default_value = "controller-state", requires = "setpoint")]
    pub setpoint_type: SetpointType,
    /// How long a joint state waits for its setpoint
    #[arg(long, value_name = "MS", default_value_t = 10.0, value_parser = patience)]
    pub patience_ms: f64,
    /// Topic of the URDF that is compared with the robot file
    #[arg(long, value_name = "TOPIC", default_value = "/robot_description", value_parser = topic)]
    pub robot_description: String,
    /// Use only the network interface with this address (again for more)
    #[arg(long, value_name = "IP")]
    pub interface: Vec<IpAddr>,
    /// What it shares with other bridges.
    #[command(flatten)]
    pub bridge: BridgeOptions,
}

/// Messages that hold a setpoint.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum SetpointType {
    /// control_msgs/JointTrajectoryControllerState: its first point (desired or reference), joints by name, paired by stamp
    ControllerState,
    /// trajectory_msgs/JointTrajectoryPoint: joints in the robot file's order, paired with the last joint state
    #[value(help = POINT.to_owned() + ": joints in the robot file's order, paired with the last joint state")]
    Point,
}

/// Whether `topic` is a name by the rules of ROS 2.
///
/// # Errors
/// The rule that it breaks.
pub fn check_ros_topic(topic: &str) -> Result<(), String> {
    let name = topic.strip_prefix('/').unwrap_or(topic);
    let part_is_sound = |part: &str| {
        part.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
            && part.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
    };
    if !name.is_empty() && name.split('/').all(part_is_sound) {
        return Ok(());
    }
    Err(format!(
        "{topic}: a topic of ROS 2 has letters, digits and _ between its slashes, and no part begins with a digit"
    ))
}

fn topic(text: &str) -> Result<String, String> {
    check_ros_topic(text)?;
    Ok(text.to_owned())
}

fn patience(text: &str) -> Result<f64, String> {
    within(text, 0.0, 1000.0)
}

impl Ros2Options {
    /// The domain: of the command line, else of `variable` (ROS_DOMAIN_ID), else 0.
    ///
    /// # Errors
    /// The variable is no domain.
    pub fn domain_or(&self, variable: Option<&str>) -> Result<u16, String> {
        match (self.domain, variable) {
            (Some(domain), _) => Ok(domain),
            (None, None | Some("")) => Ok(0),
            (None, Some(text)) => match text.parse() {
                Ok(domain) if domain <= 232 => Ok(domain),
                _ => Err(format!("ROS_DOMAIN_ID is {text}; it must be a number from 0 to 232")),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::{CommandFactory as _, Parser as _};

    #[test]
    fn the_command_line_is_sound() {
        Ros2Options::command().debug_assert();
        let parse = |line: &str| Ros2Options::try_parse_from(line.split_whitespace());
        let options = parse("rivet-ros2 robot.toml").expect("all have defaults");
        assert_eq!((options.joint_states.as_str(), options.setpoint.as_deref()), ("/joint_states", None));
        for wrong in
            ["--domain 233", "--joint-states /a-b", "--setpoint-type point", "--seconds 0", "--patience-ms nan"]
        {
            assert!(parse(&format!("rivet-ros2 robot.toml {wrong}")).is_err(), "{wrong}");
        }
    }

    #[test]
    fn the_domain_is_the_command_lines_then_the_environments() {
        let options = |line: &str| Ros2Options::try_parse_from(line.split_whitespace()).expect("sound");
        assert_eq!(options("x r.toml --domain 7").domain_or(Some("5")), Ok(7));
        assert_eq!(options("x r.toml").domain_or(Some("5")), Ok(5));
        assert_eq!(options("x r.toml").domain_or(None), Ok(0));
        assert!(options("x r.toml").domain_or(Some("233")).is_err());
    }
}
