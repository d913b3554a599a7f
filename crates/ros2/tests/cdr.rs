//! Messages on the wire: bytes of an independent library (rosbags), read and written.

use rivet_ros2::messages::{
    DiagnosticArray, Float64MultiArray, JointState, JointTrajectoryControllerState, JointTrajectoryPoint, Text,
    WrenchStamped,
};
use rustdds::RepresentationIdentifier;
use rustdds::serialization::{deserialize_from_cdr_with_rep_id, to_writer_with_rep_id};
use serde::Serialize;
use serde::de::DeserializeOwned;

/// Bytes of a message behind the four of its encapsulation, which say CDR, little-endian.
fn golden(name: &str) -> Vec<u8> {
    let line = include_str!("cdr/golden.txt").lines().find_map(|line| line.strip_prefix(&format!("{name} ")));
    let hex = line.unwrap_or_else(|| panic!("no {name}"));
    let bytes: Vec<u8> =
        (0..hex.len() / 2).map(|i| u8::from_str_radix(&hex[2 * i..2 * i + 2], 16).expect("hex")).collect();
    assert_eq!(bytes[..4], [0, 1, 0, 0]);
    bytes[4..].to_vec()
}

fn read<M: DeserializeOwned>(name: &str) -> (M, usize) {
    deserialize_from_cdr_with_rep_id(&golden(name), RepresentationIdentifier::CDR_LE)
        .unwrap_or_else(|why| panic!("{name}: {why}"))
}

/// Reads the bytes of `name`; what is written again is the same bytes.
fn survives<M: DeserializeOwned + Serialize>(name: &str) -> M {
    let (message, used) = read::<M>(name);
    let mut written = Vec::new();
    to_writer_with_rep_id(&mut written, &message, RepresentationIdentifier::CDR_LE).expect("written");
    assert_eq!(written, golden(name), "{name}");
    assert_eq!(used, written.len(), "{name}");
    message
}

#[test]
fn joint_states_are_those_of_another_library() {
    let message: JointState = survives("joint_state");
    assert_eq!((message.header.stamp.as_ns(), message.header.frame_id.as_str()), (1_764_000_000_123_456_789, "base"));
    assert_eq!(message.name, ["a", "joint_2", ""]);
    assert_eq!(message.position, [1.5, -0.1, 1e-300]);
    assert_eq!(message.velocity, [0.0; 0]);
    assert!(message.effort[0].is_nan() && message.effort[1] == 3.0 && message.effort[2].is_sign_negative());
    assert_eq!(survives::<JointState>("joint_state_empty"), JointState::default());
}

#[test]
fn setpoints_are_those_of_another_library() {
    let point: JointTrajectoryPoint = survives("joint_trajectory_point");
    assert_eq!((point.positions.as_slice(), point.velocities.as_slice()), (&[1.0, -2.5][..], &[0.25][..]));
    assert_eq!((point.time_from_start.sec, point.time_from_start.nanosec), (-1, 7));
    // What follows the first point differs between the releases of ROS 2, and is not read.
    let (state, used) = read::<JointTrajectoryControllerState>("controller_state");
    assert_eq!((state.joint_names, &state.reference), (vec!["b".to_owned(), "a".to_owned()], &point));
    assert!(used < golden("controller_state").len());
}

#[test]
fn messages_to_the_graph_are_those_of_another_library() {
    assert_eq!(survives::<Text>("string").data, "<robot name=\"ä\"/>");
    let array: Float64MultiArray = survives("float64_multi_array");
    assert_eq!((array.layout.data_offset, array.layout.dim[1].label.as_str()), (1, "c"));
    assert_eq!(array.data, [9.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
    let report: DiagnosticArray = survives("diagnostic_array");
    assert_eq!((report.status[0].level, report.status[0].values[1].value.as_str()), (2, "17"));
    let wrench: WrenchStamped = survives("wrench_stamped");
    assert_eq!((wrench.wrench.force.z, wrench.wrench.torque.y), (3.5, 0.125));
}

/// Bytes of the network are anything: reading them ends in an error or a message, never in a panic or a huge allocation.
#[test]
fn damaged_bytes_are_refused() {
    for name in ["joint_state", "controller_state", "string"] {
        let whole = golden(name);
        for length in 0..whole.len() {
            for at in [0, 8, 16, 20, length / 2] {
                let mut bytes = whole[..length].to_vec();
                bytes.iter_mut().skip(at).take(4).for_each(|byte| *byte = 0xff);
                let read = deserialize_from_cdr_with_rep_id::<JointState>;
                if let Ok((message, _)) = read(&bytes, RepresentationIdentifier::CDR_LE) {
                    assert!(message.position.len() <= bytes.len());
                }
            }
        }
    }
}
