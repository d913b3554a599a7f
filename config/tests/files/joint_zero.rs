//! `log.joint_zero` of the robots whose public logs count joints from another zero than the URDF, against the URDF that
//! comes with each log: the same sample must put the arm into the same pose.

use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use rivet_config::Robot;
use rivet_dynamics::{Arm, Workspace, flange_pose, inverse_dynamics};

const GRAVITY: [f64; 3] = [0.0, 0.0, -9.81];

fn project(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}

fn robot(name: &str) -> Robot {
    rivet_config::load(project("robots").join(name).join("robot.toml")).unwrap_or_else(|e| panic!("{e}"))
}

/// The URDF beside a log, or nothing (said aloud) where the data is not here.
fn data_urdf(path: &str) -> Option<Arm> {
    let path = project("../shared/data/real").join(path);
    let Ok(text) = fs::read_to_string(&path) else {
        // Past the test harness, which keeps what a passing test says through the macros to itself.
        let _ = writeln!(std::io::stderr(), "SKIPPED: {} is not here", path.display());
        return None;
    };
    // The TX40's last link is rounded to no inertia at all; only its frame matters here.
    let text = text.replace("ixx=\"0.000\"", "ixx=\"0.001\"").replace("iyy=\"0.000\"", "iyy=\"0.001\"");
    let text = text.replace("izz=\"0.000\"", "izz=\"0.001\"");
    Some(Arm::from_urdf(&text, GRAVITY).unwrap_or_else(|e| panic!("{}: {e}", path.display())))
}

/// Poses in log angles, spread by an irrational step; the first is zero.
fn poses() -> impl Iterator<Item = [f64; 6]> {
    (0..50).map(|k| std::array::from_fn(|j| 3.0 * (f64::from(k) * (1.1 + 0.37 * j as f64)).sin()))
}

fn shifted(robot: &Robot, q: &[f64; 6]) -> Vec<f64> {
    q.iter().zip(&robot.config.log.joint_zero).map(|(q, zero)| q + zero).collect()
}

/// Largest difference of flange orientation \[-\] and position \[m\] over the poses.
fn flange_difference(robot: &Robot, data: &Arm) -> (f64, f64) {
    let (mut turn, mut shift) = (0.0_f64, 0.0_f64);
    for q in poses() {
        let (r, p) = flange_pose(&robot.model.arm, &shifted(robot, &q));
        let (r_data, p_data) = flange_pose(data, &q);
        for i in 0..3 {
            shift = shift.max((p[i] - p_data[i]).abs());
            for k in 0..3 {
                turn = turn.max((r[i][k] - r_data[i][k]).abs());
            }
        }
    }
    (turn, shift)
}

fn gravity_torque(arm: &Arm, q: &[f64]) -> Vec<f64> {
    let (zero, mut tau) = (vec![0.0; arm.dof()], vec![0.0; arm.dof()]);
    inverse_dynamics(arm, &arm.links, &mut Workspace::new(arm), q, &zero, &zero, &mut tau);
    tau
}

#[test]
fn tx40_log_angles_are_shifted_to_the_controllers_zero() {
    let Some(data) = data_urdf("staubli_tx40/tx40.urdf") else { return };
    let (turn, shift) = flange_difference(&robot("staubli-tx40"), &data);
    // The data's URDF prints right angles to 12 digits.
    assert!(turn < 1e-10 && shift < 1e-10, "{turn} {shift}");
}

#[test]
fn kuka_log_angles_are_shifted_to_the_controllers_zero() {
    let robot = robot("kuka-kr300-r2500");
    // Published with the logs, for q = 0 of the logs and without payload and counterbalance.
    let published = [0.0, -862.4, -865.7, -25.0, -35.9, 0.0];
    let tau = gravity_torque(&robot.model.arm, &shifted(&robot, &[0.0; 6]));
    for j in 0..6 {
        assert!((tau[j] - published[j]).abs() < 0.06, "joint {}: {} instead of {}", j + 1, tau[j], published[j]);
    }
    let Some(data) = data_urdf("kuka_kr300/kr300_nominal.urdf") else { return };
    let (turn, shift) = flange_difference(&robot, &data);
    // The data's URDF prints right angles to 10 digits.
    assert!(turn < 1e-8 && shift < 1e-8, "{turn} {shift}");
}

/// No joint of the UR10e is shifted, but the base of its data is turned by 180 degrees about the vertical, and the last
/// frame of its URDF stands otherwise: so the axis of the last joint is compared, after that turn.
#[test]
fn ur10e_log_angles_need_no_shift() {
    let Some(data) = data_urdf("ur10e_innopolis/ur10e.urdf") else { return };
    let robot = robot("ur10e");
    assert_eq!(robot.config.log.joint_zero, [0.0; 6]);
    for q in poses() {
        let axis = |arm: &Arm, q: &[f64]| {
            let (r, _) = flange_pose(arm, q);
            let a = arm.joints[5].axis;
            [0, 1, 2].map(|i| (0..3).map(|k| r[i][k] * a[k]).sum::<f64>())
        };
        let (a, b) = (axis(&robot.model.arm, &q), axis(&data, &q));
        let difference = (a[0] + b[0]).abs().max((a[1] + b[1]).abs()).max((a[2] - b[2]).abs());
        assert!(difference < 1e-10, "{difference} at {q:?}");
    }
}
