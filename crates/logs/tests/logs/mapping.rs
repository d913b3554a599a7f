//! Names, units and stated channels: what is read, and what an error lists where names do not decide.

use std::path::Path;

use rivet_logs::{ChannelMap, Log, LogError, Naming, ReadOptions, read_as};

/// A table of twelve rows: row k of column c is `start + 0.01 * k * (c + 1)`, column 0 is time in steps of 10 ms.
fn written(folder: &Path, names: &[&str]) -> std::path::PathBuf {
    let path = folder.join("run.csv");
    let mut text = names.join(";") + "\n";
    for k in 0..12 {
        let cells = (0..names.len()).map(|c| format!("{}", 0.01 * f64::from(k) * (c + 1) as f64));
        text += &(cells.collect::<Vec<_>>().join(";") + "\n");
    }
    std::fs::write(&path, text).expect("written");
    path
}

fn joints() -> Vec<String> {
    ["base", "elbow"].map(str::to_owned).to_vec()
}

fn read_with(path: &Path, map: &ChannelMap) -> Result<Log, LogError> {
    read_as(path, &ReadOptions::new(2), &Naming { joints: &joints(), map })
}

fn map(entries: &[(&str, &str)]) -> ChannelMap {
    let mut map = ChannelMap::default();
    for (key, pattern) in entries {
        map.entry(key).expect("a key").pattern = Some((*pattern).to_owned());
    }
    map
}

fn refusal(names: &[&str], map: &ChannelMap) -> String {
    let folder = tempfile::tempdir().expect("a folder");
    read_with(&written(folder.path(), names), map).expect_err("must be refused").to_string()
}

const TWO_ARMS: [&str; 9] = [
    "time",
    "left/elbow/position",
    "left/base/position",
    "right/elbow/position",
    "right/base/position",
    "left/elbow/effort",
    "left/base/effort",
    "right/elbow/effort",
    "right/base/effort",
];

#[test]
fn ambiguous_names_list_the_candidates_and_a_map_decides() {
    let why = refusal(&TWO_ARMS, &ChannelMap::default());
    for words in ["positions: left/{joint}/position, right/{joint}/position", "--map q=PATTERN", "[log]"] {
        assert!(why.contains(words), "{words}: {why}");
    }
    let why = refusal(&TWO_ARMS, &map(&[("q", "right/{joint}/position")]));
    assert!(why.contains("torques: left/{joint}/effort, right/{joint}/effort") && why.contains("--map tau="), "{why}");
    let folder = tempfile::tempdir().expect("a folder");
    let path = written(folder.path(), &TWO_ARMS);
    let log =
        read_with(&path, &map(&[("q", "right/{joint}/position"), ("tau", "left/{joint}/effort")])).expect("mapped");
    assert!((log.q[0][10] - 0.5).abs() < 1e-12 && (log.torque().expect("torque")[1][10] - 0.6).abs() < 1e-12);
    let why = refusal(&["time", "stamp", "base/position", "elbow/position"], &ChannelMap::default());
    assert!(why.contains("may be the time: time, stamp") && why.contains("--map time="), "{why}");
}

#[test]
fn patterns_that_fit_nothing_list_what_there_is() {
    let names = ["time", "a[0]", "a[1]", "a[2]", "b[1]", "b[2]"];
    let why = refusal(&names, &map(&[("q", "c[{i}]")]));
    assert!(
        why.contains("q (--map, or [log] of robot.toml): there is no column c[1]; the columns are time, a[0]"),
        "{why}"
    );
    let why = refusal(&names, &map(&[("q", "a[{i}]")]));
    assert!(why.contains("count from 0 to 2 and the robot has 2 joints"), "{why}");
    let why = refusal(&names, &map(&[("q", "b[1]")]));
    assert!(why.contains("names 1 columns, the robot has 2 joints"), "{why}");
    let why = refusal(&names, &map(&[("q", "b[{i}]"), ("time", "tick")]));
    assert!(why.contains("time (--map") && why.contains("there is no column tick"), "{why}");
    let mut unit = map(&[("q", "b[{i}]")]);
    unit.entry("q").expect("a key").unit = Some("furlong".to_owned());
    let why = refusal(&names, &unit);
    assert!(why.contains("unit \"furlong\" is unknown; it must be one of rad"), "{why}");
    let why = refusal(&["time", "joint_x/position", "joint_y/position"], &ChannelMap::default());
    assert!(
        why.contains("positions of all joints (base, elbow)") && why.contains("joint_x/position joint_y/position"),
        "{why}"
    );
}

#[test]
fn unit_sign_scale_and_zero_are_applied_joint_by_joint() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = written(folder.path(), &["stamp_ms", "base_q", "elbow_q", "base_i", "elbow_i", "temp_0", "temp_1"]);
    let mut map = map(&[("time", "stamp_ms"), ("q", "{joint}_q"), ("tau", "{joint}_i"), ("temperature", "temp_{i}")]);
    map.entry("time").expect("a key").unit = Some("s".to_owned());
    let q = map.entry("q").expect("a key");
    (q.unit, q.sign, q.zero) = (Some("deg".to_owned()), Some(vec![1.0, -1.0]), Some(vec![0.0, 0.5]));
    let tau = map.entry("tau").expect("a key");
    (tau.unit, tau.scale, tau.zero) = (Some("mN m".to_owned()), Some(vec![2.0, 3.0]), Some(vec![1.0, 0.0]));
    map.entry("temperature").expect("a key").unit = Some("K".to_owned());
    let log = read_with(&path, &map).expect("mapped");
    let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a} and {b}");
    close(log.t[10], 0.1);
    close(log.q[0][10], 0.2_f64.to_radians());
    close(log.q[1][10], 0.5 - 0.3_f64.to_radians());
    let tau = log.torque().expect("torque");
    close(tau[0][10], 1.0 + 2.0 * 0.4e-3);
    close(tau[1][10], 3.0 * 0.5e-3);
    close(log.temperature.expect("temperature")[0][0], -273.15);
}

/// Columns of the contract stay what they are, whatever else is in the file, and are converted where that is stated.
#[test]
fn contract_columns_come_before_names_and_are_converted_where_stated() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = written(folder.path(), &["t", "q1", "q2", "tau1", "tau2", "left/base/position", "left/elbow/position"]);
    let log = read_with(&path, &ChannelMap::default()).expect("a log");
    assert!(log.notes.is_empty() && log.unused.len() == 2, "{:?}", log.notes);
    let mut flipped = ChannelMap::default();
    flipped.entry("tau").expect("a key").sign = Some(vec![-1.0, 1.0]);
    let other = read_with(&path, &flipped).expect("a log");
    assert_eq!(other.torque().expect("torque")[0][5], -log.torque().expect("torque")[0][5]);
    assert_eq!(other.torque().expect("torque")[1], log.torque().expect("torque")[1]);
    // A file of the robot's driver states other names: a recording of rivet has its own.
    let driver = map(&[("q", "/joint_states/{joint}/position"), ("time", "/joint_states/header/stamp")]);
    let same = read_with(&path, &driver).expect("a log");
    assert!(same.q == log.q && same.notes[0].contains("the stated channels of q, time are not"), "{:?}", same.notes);
    let mut wrong = ChannelMap::default();
    wrong.entry("tau").expect("a key").sign = Some(vec![-1.0]);
    let why = read_with(&path, &wrong).expect_err("one sign").to_string();
    assert!(why.contains("sign has 1 values, the robot has 2 joints"), "{why}");
    assert!(wrong.entry("position").expect_err("unknown").contains("the keys are time, q, tau"));
}

/// The files of the field that were refused: joints by the names in text columns, by number, by unit, time in ms and ns.
#[test]
fn first_files_of_the_field_are_read() {
    let Some(case) = crate::formats::shared("field/10-first-file-messages") else { return };
    let names =
        ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"].map(|n| format!("{n}_joint"));
    let empty = ChannelMap::default();
    let naming = Naming { joints: &names, map: &empty };
    let gains = [10.0; 6];
    let options = ReadOptions { drive_gain: Some(&gains), ..ReadOptions::new(6) };
    let reference = read_as(case.join("03b-space.csv"), &options, &naming).unwrap_or_else(|why| panic!("{why}"));
    for file in [
        "01-rostopic.csv",
        "02-plotjuggler.csv",
        "03-rtde-space.csv",
        "04-libfranka.csv",
        "06d-units.csv",
        "06e-upper.csv",
        "06g-percent-comment.csv",
        "gzip.parquet",
        "brotli.parquet",
        "lz4.parquet",
    ] {
        let log = read_as(case.join(file), &options, &naming).unwrap_or_else(|why| panic!("{why}"));
        // The files round differently.
        for joint in 0..6 {
            assert!((log.q[joint][1] - reference.q[joint][1]).abs() < 1e-4, "{file}: q{}", joint + 1);
            let (tau, expected) =
                (log.torque().expect("torque")[joint][1], reference.torque().expect("torque")[joint][1]);
            assert!((tau - expected).abs() < 1e-2, "{file}: tau{}: {tau} and {expected}", joint + 1);
        }
        assert!((log.t[1] - log.t[0] - 0.008).abs() < 1e-6, "{file}: {} s", log.t[1] - log.t[0]);
    }
}
