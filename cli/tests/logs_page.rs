//! The examples of `docs/logs.md`, run as they stand there, on one arm's logs written as the programs of the examples write them.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::{Cursor, Write as _};
use std::path::{Path, PathBuf};
use std::process::Command;

use rivet_logs::{Log, ReadOptions, read};

fn project(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}

fn shared(path: &str) -> Option<PathBuf> {
    let found = project("../shared/data").join(path);
    if !found.exists() {
        // Past the test harness, which keeps what a passing test says through the macros to itself.
        let _ = writeln!(std::io::stderr(), "SKIPPED: {} is not there", found.display());
    }
    found.exists().then_some(found)
}

/// Joints of the arm, base to flange.
const JOINTS: [&str; 6] =
    ["shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint"];
/// Torque per current of the robot file \[N m/A\].
const GAIN: f64 = 10.0;

/// A message of ROS 2 with the joints in alphabetical order.
fn message(log: &Log, k: usize, stamp_ns: u64) -> Vec<u8> {
    let mut order: Vec<usize> = (0..JOINTS.len()).collect();
    order.sort_by_key(|j| JOINTS[*j]);
    let mut out = vec![0, 1, 0, 0];
    let align = |out: &mut Vec<u8>, size: usize| out.resize(4 + (out.len() - 4).next_multiple_of(size), 0);
    let word = |out: &mut Vec<u8>, value: u64| {
        align(out, 4);
        out.extend(u32::try_from(value).expect("32 bits").to_le_bytes());
    };
    word(&mut out, stamp_ns / 1_000_000_000);
    word(&mut out, stamp_ns % 1_000_000_000);
    word(&mut out, 1);
    out.push(0);
    word(&mut out, JOINTS.len() as u64);
    for j in &order {
        word(&mut out, JOINTS[*j].len() as u64 + 1);
        out.extend(JOINTS[*j].as_bytes());
        out.push(0);
    }
    let tau = log.torque().expect("torque");
    for signals in [Some(&log.q), None, Some(tau)] {
        let values: Vec<f64> = signals.into_iter().flat_map(|s| order.iter().map(move |j| s[*j][k])).collect();
        word(&mut out, values.len() as u64);
        for value in values {
            align(&mut out, 8);
            out.extend(value.to_le_bytes());
        }
    }
    out
}

fn write_bag(folder: &Path, log: &Log) {
    std::fs::create_dir(folder).expect("a folder");
    let mut writer = mcap::WriteOptions::new().compression(None).create(Cursor::new(Vec::new())).expect("a writer");
    let schema = writer.add_schema("sensor_msgs/msg/JointState", "ros2msg", b"...").expect("a schema");
    let channel_id = writer.add_channel(schema, "/joint_states", "cdr", &BTreeMap::new()).expect("a channel");
    for k in 0..log.len() {
        let stamp = 1_700_000_000_000_000_000 + (log.t[k] * 1e9).round() as u64;
        let header =
            mcap::records::MessageHeader { channel_id, sequence: 0, log_time: stamp + 400_000, publish_time: stamp };
        writer.write_to_known_channel(&header, &message(log, k, stamp)).expect("written");
    }
    writer.finish().expect("finished");
    std::fs::write(folder.join("run_0.mcap"), writer.into_inner().into_inner()).expect("written");
    let metadata =
        "rosbag2_bagfile_information:\n  storage_identifier: mcap\n  relative_file_paths:\n    - run_0.mcap\n";
    std::fs::write(folder.join("metadata.yaml"), metadata).expect("written");
}

/// A text table with a name for each column of positions and torques.
fn write_table(path: &Path, log: &Log, [separator, time, q, tau]: [&str; 4], [time_unit, tau_unit]: [f64; 2]) {
    let names = |pattern: &str| (0..6).map(|j| pattern.replace("{i}", &j.to_string())).collect::<Vec<_>>();
    let mut text = [vec![time.to_owned()], names(q), names(tau)].concat().join(separator) + "\n";
    let torque = log.torque().expect("torque");
    for k in 0..log.len() {
        let cells = std::iter::once(log.t[k] / time_unit)
            .chain(log.q.iter().map(|q| q[k]))
            .chain(torque.iter().map(|tau| tau[k] / tau_unit))
            .map(|value| format!("{value}"));
        writeln!(text, "{}", cells.collect::<Vec<_>>().join(separator)).expect("writing to a string");
    }
    std::fs::write(path, text).expect("written");
}

/// The arm of the examples with its recordings.
fn prepared() -> Option<tempfile::TempDir> {
    let (arm, logs) = (shared("field/02-glitch-rows-diagnose-predict")?, shared("field/12-inertia-g-mm2")?);
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let text = std::fs::read_to_string(arm.join("robot.toml")).expect("read");
    let gain = format!("[drive]\ndrive_gain = {:?}\n", [GAIN; 6]);
    std::fs::write(at("robot.toml"), text.replacen("[drive]\n", &gain, 1)).expect("written");
    std::fs::copy(arm.join("robot.urdf"), at("robot.urdf")).expect("copied");
    for run in ["1", "2"] {
        let log = read(logs.join(format!("log{run}.parquet")), &ReadOptions::new(6)).expect("a log");
        write_bag(&at(&format!("run{run}")), &log);
        let rtde = [" ", "timestamp", "actual_q_{i}", "actual_current_{i}"];
        write_table(&at(&format!("rtde{run}.csv")), &log, rtde, [1.0, GAIN]);
        let franka = [",", "duration", "robot_state.q[{i}]", "robot_state.tau_J[{i}]"];
        write_table(&at(&format!("franka{run}.csv")), &log, franka, [1e-3, 1.0]);
    }
    Some(folder)
}

/// Commands of the page's `sh` blocks.
fn commands() -> Vec<Vec<String>> {
    let page = std::fs::read_to_string(project("docs/logs.md")).expect("read");
    let blocks = page.split("```").skip(1).step_by(2).filter_map(|block| block.strip_prefix("sh\n"));
    let words = |line: &str| line.split_whitespace().map(|word| word.trim_matches('"').to_owned()).collect();
    blocks.flat_map(str::lines).map(words).collect()
}

#[test]
fn examples_of_the_page_run_and_agree() {
    let Some(folder) = prepared() else { return };
    let mut verdicts = Vec::new();
    let all = commands();
    assert_eq!(all.len(), 9, "three examples of three commands");
    for words in all {
        assert_eq!(words[0], "rivet");
        let output = Command::new(env!("CARGO_BIN_EXE_rivet"))
            .args(&words[1..])
            .current_dir(folder.path())
            .output()
            .expect("rivet starts");
        let said = [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned());
        let code = output.status.code();
        assert!(code.is_some_and(|code| code < 3), "{words:?}: {code:?}: {said:?}");
        println!("{words:?}: {code:?}\n{}{}", said[0], said[1]);
        match words[1].as_str() {
            "inspect" => {
                assert!(said[0].lines().count() <= 12, "more than half a screen: {}", said[0]);
                assert!(said[0].lines().all(|line| line.chars().count() <= 80), "{}", said[0]);
                assert!(said[0].contains("[log]\ntime = ") && said[0].contains("q = \""), "{}", said[0]);
            }
            "diagnose" => verdicts.push((code, said[0].lines().next().unwrap_or_default().to_owned())),
            _ => assert_eq!(code, Some(0), "{words:?}: {said:?}"),
        }
    }
    // The same motion and torque, whoever wrote it.
    assert!(verdicts.windows(2).all(|pair| pair[0] == pair[1]), "{verdicts:?}");
}

fn inspect(words: &[&str], folder: &Path) -> (Option<i32>, serde_json::Value) {
    let mut run = Command::new(env!("CARGO_BIN_EXE_rivet"));
    let output = run.arg("inspect").args(words).arg("--json").current_dir(folder).output().expect("rivet starts");
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let json = serde_json::from_str(&text).unwrap_or_else(|why| panic!("{words:?}: {why}: {output:?}"));
    (output.status.code(), json)
}

#[test]
fn inspect_reports_rate_readings_and_severity() {
    let Some(folder) = prepared() else { return };
    let (code, sound) = inspect(&["run1", "robot.toml"], folder.path());
    assert_eq!(code, Some(0), "{sound}");
    assert_eq!((&sound["format"], &sound["topics"][0]["name"]), (&"rosbag2".into(), &"/joint_states".into()));
    assert_eq!(sound["joints"][2]["name"], "elbow_joint");
    for reading in sound["readings"].as_array().expect("a list") {
        assert_eq!(reading["reading"], "as recorded", "{sound}");
        assert!(reading["probability"].as_f64().is_some_and(|p| p >= 0.95), "{sound}");
    }
    let clock = &sound["clocks"][0];
    assert_eq!(clock["column"], "/joint_states/log_time", "{sound}");
    // Without a robot the joints are those of the recording.
    let (code, alone) = inspect(&["run1"], folder.path());
    assert_eq!((code, &alone["joints"][0]["name"]), (Some(0), &"elbow_joint".into()), "{alone}");
    // Torque with the other sign is a doubt that is named.
    let (code, flipped) = inspect(&["run1", "robot.toml", "--map", "tau_sign=-1"], folder.path());
    assert_eq!(code, Some(1), "{flipped}");
    assert!(flipped["readings"][1]["reading"].as_str().is_some_and(|text| text.contains("other sign")), "{flipped}");
    // Two groups of positions: not usable as it is.
    let text = std::fs::read_to_string(folder.path().join("franka1.csv")).expect("read");
    let (head, rows) = text.split_once('\n').expect("a header");
    let twice = format!(
        "{head},{}\n",
        head.split(',').skip(1).map(|name| format!("other.{name}")).collect::<Vec<_>>().join(",")
    );
    let doubled = |row: &str| format!("{row},{}\n", row.split_once(',').expect("cells").1);
    let rows = rows.lines().map(doubled).collect::<Vec<_>>().concat();
    std::fs::write(folder.path().join("twice.csv"), twice + &rows).expect("written");
    let (code, two) = inspect(&["twice.csv", "robot.toml"], folder.path());
    assert_eq!(code, Some(2), "{two}");
    assert!(two["not_usable"].as_str().is_some_and(|why| why.contains("--map q=PATTERN")), "{two}");
}
