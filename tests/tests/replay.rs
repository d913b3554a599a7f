//! The same log, through processes and shared memory or not, gives the same parameters, bit for bit.

use rivet_tests::{rivet, robot, succeed};
use serde_json::Value;
use std::fmt::Write as _;
use std::path::Path;

/// A short log of the two-link arm: smooth motion, torque from its own model, and the desired motion beside it.
fn write_log(path: &Path, setpoints: bool) {
    use rivet_dynamics::Workspace;
    let robot = rivet_config::load(robot("dd2")).expect("a sound robot file");
    let model = &robot.model;
    let (n, dof) = (model.len(), model.arm.dof());
    let mut workspace = Workspace::new(&model.arm);
    let mut rows = vec![0.0; n * dof];
    let mut text = String::from("t,q1,q2,tau1,tau2");
    if setpoints {
        text.push_str(",q_des1,q_des2,qd_des1,qd_des2,qdd_des1,qdd_des2");
    }
    text.push('\n');
    for k in 0..6000 {
        let t = 0.001 * f64::from(k);
        let wave = |a: f64, f: f64, p: f64| {
            let w = std::f64::consts::TAU * f;
            let (s, c) = (w * t + p).sin_cos();
            [a * s, a * w * c, -a * w * w * s]
        };
        let (one, two) = (wave(0.5, 0.8, 0.1), wave(0.8, 1.1, 0.7));
        let motion = |d: usize| [one[d], two[d]];
        model.regressor(&mut workspace, &motion(0), &motion(1), &motion(2), &mut rows);
        let tau = |j: usize| -> f64 { rows[j * n..(j + 1) * n].iter().zip(&robot.nominal).map(|(y, x)| y * x).sum() };
        // A little deterministic noise, so that instruments and regressor differ.
        let noise = |k: i32, s: f64| s * f64::from(k * 7919 % 101 - 50) / 50.0;
        write!(text, "{t},{},{},{},{}", one[0] + noise(k, 1e-6), two[0] - noise(k + 3, 1e-6), tau(0), tau(1)).unwrap();
        if setpoints {
            for d in 0..3 {
                write!(text, ",{},{}", one[d], two[d]).unwrap();
            }
        }
        text.push('\n');
    }
    std::fs::write(path, text).expect("a log");
}

fn stream(folder: &Path, name: &str, words: &[&str], log: &Path) -> Vec<u8> {
    let file = folder.join(name);
    let mut command = rivet();
    command.args(words).arg(robot("dd2")).arg(log).arg("--stream").arg(&file);
    succeed(&mut command);
    std::fs::read(&file).expect("a parameter stream")
}

#[test]
fn two_replays_and_the_run_without_processes_are_bit_identical() {
    for setpoints in [true, false] {
        let folder = tempfile::tempdir().expect("a folder");
        let log = folder.path().join("log.csv");
        write_log(&log, setpoints);
        let first = stream(folder.path(), "first.csv", &["replay"], &log);
        let second = stream(folder.path(), "second.csv", &["replay"], &log);
        let offline = stream(folder.path(), "offline.csv", &["identify", "--online"], &log);
        assert_eq!(first.split(|&byte| byte == b'\n').count(), 62, "a header and a set every 100 samples");
        assert!(first == second, "two replays differ (setpoints: {setpoints})");
        assert!(first == offline, "replay and identify --online differ (setpoints: {setpoints})");
    }
}

/// Nobody knows what the arm did while the log was silent: the numbers of those periods are missing, nothing is made up.
#[test]
fn a_hole_in_the_log_is_a_hole_in_the_numbers() {
    let folder = tempfile::tempdir().expect("a folder");
    let (whole, log) = (folder.path().join("whole.csv"), folder.path().join("hole.csv"));
    write_log(&whole, true);
    let text = std::fs::read_to_string(&whole).expect("a log");
    let later = |(k, line): (usize, &str)| {
        let Some((t, rest)) = line.split_once(',').filter(|_| k > 2500) else { return format!("{line}\n") };
        format!("{},{rest}\n", t.parse::<f64>().expect("a time") + 40.0)
    };
    std::fs::write(&log, text.lines().enumerate().map(later).collect::<String>()).expect("a log");
    let json = folder.path().join("summary.json");
    let mut replay = rivet();
    let file = folder.path().join("replay.csv");
    replay.arg("replay").arg(robot("dd2")).arg(&log).arg("--json").arg(&json).arg("--stream").arg(&file);
    succeed(&mut replay);
    let summary: Value = serde_json::from_slice(&std::fs::read(&json).expect("a summary")).expect("JSON");
    assert_eq!((&summary["samples"], &summary["lost"]), (&Value::from(6000), &Value::from(40000)), "{summary:#}");
    let offline = stream(folder.path(), "offline.csv", &["identify", "--online"], &log);
    assert!(std::fs::read(&file).expect("a parameter stream") == offline, "replay and identify --online differ");
}

#[test]
fn a_replay_tells_its_instruments_and_loses_nothing() {
    for (setpoints, source) in [(true, "setpoint"), (false, "delayed")] {
        let folder = tempfile::tempdir().expect("a folder");
        let (log, json) = (folder.path().join("log.csv"), folder.path().join("result.json"));
        write_log(&log, setpoints);
        succeed(rivet().arg("replay").arg(robot("dd2")).arg(&log).arg("--json").arg(&json));
        let result: Value = serde_json::from_slice(&std::fs::read(&json).expect("a result")).expect("JSON");
        assert_eq!(result["lost"], 0);
        assert_eq!(result["used"], 6000);
        let instruments = result["instruments"].as_str().expect("instruments are named");
        assert!(instruments.starts_with(source), "{instruments}");
    }
}

#[test]
fn a_log_of_another_arm_is_refused_by_name() {
    let folder = tempfile::tempdir().expect("a folder");
    let log = folder.path().join("log.csv");
    write_log(&log, false);
    let output = rivet().arg("replay").arg(robot("ur10e")).arg(&log).output().expect("the program starts");
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success());
    assert!(text.contains("log.csv") && text.contains('6'), "{text}");
}
