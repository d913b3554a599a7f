//! What torque differs by where logs hold the same motion twice, and that it is told as noise.

use std::path::{Path, PathBuf};

use rivet_logs::{ReadOptions, read, write_columns};
use rivet_tests::{rivet, robot, shared};
use serde_json::Value;

fn judged(file: &Path, logs: &[PathBuf]) -> Vec<Value> {
    let folder = tempfile::tempdir().expect("a folder");
    let json = folder.path().join("verdict.json");
    let output = rivet().arg("diagnose").arg(file).args(logs).arg("--json").arg(&json).output();
    let said = output.expect("the program starts").stderr;
    let text = std::fs::read_to_string(json).unwrap_or_else(|_| panic!("{}", String::from_utf8_lossy(&said)));
    let found: Value = serde_json::from_str(&text).expect("JSON");
    found["gap"]["per_joint"].as_array().expect("joints").clone()
}

/// The same log once more, a slow torque of 2 N m beside joint 2's: half of its mean square is each run's.
#[test]
fn what_differs_between_two_runs_of_one_motion_is_the_floor() {
    let Some(case) = shared("data/practice/case-24") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let again = folder.path().join("again.parquet");
    let log = read(case.join("log-a.parquet"), &ReadOptions::new(6)).expect("a log");
    let mut tau = log.torque().expect("torque").clone();
    tau[1].iter_mut().zip(&log.t).for_each(|(tau, t)| *tau += 2.0 * (2.0 * t).sin());
    let names = (1..=6).map(|j| format!("q{j}")).chain((1..=6).map(|j| format!("tau{j}")));
    let signals = names.zip(log.q.iter().chain(&tau).map(Vec::as_slice));
    let columns: Vec<(String, &[f64])> = [("t".to_owned(), log.t.as_slice())].into_iter().chain(signals).collect();
    write_columns(&again, &columns).expect("written");

    let logs = [again, case.join("log-a.parquet"), case.join("log-b.parquet")];
    let gaps = judged(&case.join("robot.toml"), &logs);
    let number = |j: usize, key: &str| gaps[j][key].as_f64().unwrap_or_else(|| panic!("no {key}: {:#}", gaps[j]));
    assert_eq!(gaps[1]["floor_from"], "repeats", "{:#}", gaps[1]);
    // A load that one of two runs may have is taken out, and takes a part of it along.
    let scatter = number(1, "repeats_nm");
    assert!((0.7..1.05).contains(&scatter), "{scatter}");
    assert!((number(1, "noise_floor_nm") / scatter - 1.0).abs() < 1e-9);
    assert!(number(1, "repeats_s") > 5.0);
    for j in [0, 2, 3, 4, 5] {
        assert_eq!(gaps[j]["floor_from"], "signal", "{:#}", gaps[j]);
        assert!(number(j, "repeats_nm") < number(j, "noise_floor_nm"), "the very same torque");
    }
}

/// Two motions that have nothing in common say nothing; one joint that goes to and fro does.
#[test]
fn a_log_that_repeats_itself_tells_and_others_do_not() {
    let (Some(case), Some(real)) = (shared("data/practice/case-24"), shared("data/real/ur10e_innopolis")) else {
        return;
    };
    for gap in judged(&case.join("robot.toml"), &["log-a.parquet", "log-b.parquet"].map(|name| case.join(name))) {
        assert!(gap["floor_from"] == "signal" && gap.get("repeats_nm").is_none(), "{gap:#}");
    }
    // Measured: 0.19 N m where the signal alone has 0.11.
    let gaps = judged(&robot("ur10e"), &[real.join("20_01_22-joint_4.parquet")]);
    let number = |key: &str| gaps[3][key].as_f64().unwrap_or_else(|| panic!("no {key}: {:#}", gaps[3]));
    assert_eq!(gaps[3]["floor_from"], "repeats", "{:#}", gaps[3]);
    assert!((0.15..0.23).contains(&number("repeats_nm")) && number("repeats_s") > 30.0, "{:#}", gaps[3]);
}
