//! Files and logs of another program's arms, with one thing wrong that is no effect: how the arm is mounted, columns of torque in each
//! other's place, torque in coarse steps.

use std::path::{Path, PathBuf};

use rivet_logs::{Log, ReadOptions, read, write_columns};
use rivet_tests::{rivet, shared};
use serde_json::Value;
use tempfile::TempDir;

/// A case in which nothing is wrong.
const SOUND: &str = "data/practice/case-18";

/// A folder with the case's robot file, changed by `file`, and its logs' torques changed by `torque` (time, torques of a row).
fn case(from: &Path, file: impl Fn(String) -> String, torque: impl Fn(f64, &mut [f64])) -> TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let text = std::fs::read_to_string(from.join("robot.toml")).expect("a robot file");
    std::fs::write(folder.path().join("robot.toml"), file(text)).expect("written");
    std::fs::copy(from.join("robot.urdf"), folder.path().join("robot.urdf")).expect("a URDF");
    let joints = rivet_config::load(from.join("robot.toml")).expect("a sound robot file").dof();
    for name in ["log-a.parquet", "log-b.parquet"] {
        let log: Log = read(from.join(name), &ReadOptions::new(joints)).expect("a sound log");
        let mut tau = log.torque().expect("torque").clone();
        for (row, t) in log.t.iter().enumerate() {
            let mut now: Vec<f64> = tau.iter().map(|tau| tau[row]).collect();
            torque(*t - log.t[0], &mut now);
            tau.iter_mut().zip(now).for_each(|(tau, now)| tau[row] = now);
        }
        let mut columns = vec![("t".to_owned(), &log.t[..])];
        for j in 0..joints {
            columns.push((format!("q{}", j + 1), &log.q[j][..]));
            columns.push((format!("tau{}", j + 1), &tau[j][..]));
        }
        write_columns(&folder.path().join(name), &columns).expect("written");
    }
    folder
}

fn diagnose(folder: &Path) -> Value {
    let json: PathBuf = folder.join("diagnosis.json");
    let mut command = rivet();
    command.arg("diagnose").arg(folder.join("robot.toml"));
    command.arg(folder.join("log-a.parquet")).arg(folder.join("log-b.parquet")).arg("--json").arg(&json);
    let output = command.output().expect("the program starts");
    let text = std::fs::read_to_string(&json)
        .unwrap_or_else(|why| panic!("{why}\n{}", String::from_utf8_lossy(&output.stderr)));
    serde_json::from_str(&text).expect("JSON")
}

fn faults(found: &Value, fault: &str) -> Vec<u64> {
    let joints: Vec<&str> =
        found["gap"]["per_joint"].as_array().expect("joints").iter().filter_map(|j| j["joint"].as_str()).collect();
    let list = found["log"]
        .as_array()
        .expect("findings")
        .iter()
        .filter(|f| f["fault"] == fault && f["run"] == "log-a.parquet");
    list.filter_map(|f| joints.iter().position(|j| f["joint"] == *j)).map(|j| j as u64 + 1).collect()
}

/// A file that has the arm on a table or on a wall, of one that stands, is told so and nothing else.
#[test]
fn an_arm_that_is_mounted_otherwise_is_told_before_anything_else() {
    let Some(sound) = shared(SOUND) else { return };
    for given in ["[0.0, 0.0, 9.81]", "[0.0, 9.81, 0.0]"] {
        let folder = case(&sound, |text| text.replace("[0.0, 0.0, -9.81]", given), |_, _| ());
        let found = diagnose(folder.path());
        assert_eq!(found["verdict"], "parameter", "{found:#}");
        let causes = found["causes"].as_array().expect("causes");
        assert_eq!(causes.len(), 1, "{found:#}");
        assert_eq!(causes[0]["effect"], "gravity_direction");
        let along = |axis: &str| causes[0]["magnitude"][format!("gravity_{axis}_m_s2")].as_f64().expect("a number");
        assert_eq!([along("x"), along("y"), along("z")], [0.0, 0.0, -9.81], "{found:#}");
        let (after, floor) = (found["gap"]["after"].as_f64(), found["gap"]["noise_floor"].as_f64());
        assert!(after.expect("a gap") < 0.3 * found["gap"]["before"].as_f64().expect("a gap"), "{after:?} {floor:?}");
        let shrink = |key: &str| causes[0]["shrink"][key].as_f64().expect("a number");
        assert!((shrink("predicted") - shrink("measured")).abs() < 0.05, "{found:#}");
    }
}

/// An arm that hangs is hardly told from one whose second joint is off by half a turn where its file has wrong values: both are said.
#[test]
fn a_zero_that_looks_like_the_mounting_is_in_its_class() {
    let Some(sound) = shared("data/practice-wrong-nominal/case-06") else { return };
    let folder = case(&sound, |text| text.replace("[0.0, 0.0, -9.81]", "[0.0, 0.0, 9.81]"), |_, _| ());
    let found = diagnose(folder.path());
    let cause = &found["causes"][0];
    assert_eq!(cause["effect"], "gravity_direction", "{found:#}");
    assert_eq!(cause["indistinguishable_from"], serde_json::json!(["encoder_offset"]), "{found:#}");
    assert!(cause["confidence"].as_f64().is_some_and(|sure| sure < 0.6), "{found:#}");
}

/// Torque columns of two joints in each other's place are said, on both joints and no other; as logged none is.
#[test]
fn swapped_columns_of_torque_are_said() {
    let Some(sound) = shared(SOUND) else { return };
    let as_logged = diagnose(case(&sound, |text| text, |_, _| ()).path());
    assert_eq!(faults(&as_logged, "torque_swapped"), [0; 0]);
    assert_eq!(as_logged["verdict"], "no_gap", "{as_logged:#}");
    let found = diagnose(case(&sound, |text| text, |_, tau| tau.swap(1, 2)).path());
    assert_eq!(faults(&found, "torque_swapped"), [2, 3], "{found:#}");
    assert_eq!(found["causes"].as_array().map(Vec::len), Some(0), "{found:#}");
}

/// What rounding takes from torque is no gap, and a level on which coarse torque stands no limit.
#[test]
fn torque_in_coarse_steps_is_said_and_is_no_gap() {
    let Some(sound) = shared(SOUND) else { return };
    let coarse = |_: f64, tau: &mut [f64]| tau[3..].iter_mut().for_each(|tau| *tau = 4.0 * (*tau / 4.0).round());
    let found = diagnose(case(&sound, |text| text, coarse).path());
    assert_eq!(faults(&found, "torque_coarse"), [4, 5, 6], "{found:#}");
    assert_eq!(faults(&found, "torque_limit"), [0; 0], "{found:#}");
    assert_eq!(found["verdict"], "no_gap", "{found:#}");
}
