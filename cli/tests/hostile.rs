//! Files made to exhaust memory or the stack: each is refused in words, within bounded memory.
#![cfg(target_os = "linux")]

use std::fmt::Write as _;
use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn project(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}

/// `rivet` with 4 GB of address space.
fn rivet(arguments: &[&Path]) -> Output {
    Command::new("sh")
        .args(["-c", "ulimit -v 4000000 && exec \"$@\"", "sh", env!("CARGO_BIN_EXE_rivet")])
        .args(arguments)
        .current_dir(project(""))
        .output()
        .expect("sh runs")
}

/// Nothing that a terminal would act on.
fn assert_printable(bytes: &[u8]) -> String {
    let said = String::from_utf8(bytes.to_vec()).expect("UTF-8");
    assert!(!said.contains(|c: char| c.is_control() && c != '\n'), "{said:?}");
    said
}

fn assert_refused(arguments: &[&Path]) {
    let output = rivet(arguments);
    let said = assert_printable(&output.stderr);
    // A crash has no code: it ends by a signal. 64 and above are rivet's own, a panic has 101.
    let code = output.status.code();
    assert!(code.is_some_and(|c| (64..=78).contains(&c)), "{arguments:?}: {code:?}: {said}");
    assert!(!said.is_empty(), "{arguments:?}");
}

#[test]
fn stored_hostile_files_are_refused() {
    let Ok(entries) = fs::read_dir(project("../shared/data/hostile")) else {
        // Past the test harness, which keeps what a passing test says through the macros to itself.
        let _ = writeln!(std::io::stderr(), "SKIPPED: ../shared/data/hostile is not there");
        return;
    };
    for path in entries.map(|entry| entry.expect("entry").path()) {
        if path.ends_with("joint-name-c1-escape") {
            // A usable arm, of which only the name is hostile.
            let output = rivet(&[Path::new("check"), &path.join("robot.toml")]);
            assert!(assert_printable(&output.stdout).contains("\\u{"), "{output:?}");
            assert_printable(&output.stderr);
        } else if path.is_dir() {
            assert_refused(&[Path::new("check"), &path.join("robot.toml")]);
        } else {
            assert_refused(&[Path::new("identify"), &project("robots/ur10e/robot.toml"), &path]);
        }
    }
}

/// A name with what a terminal acts on: ESC [2J, its C1 form, a carriage return, and an override of the writing direction.
const HOSTILE: &str = "\u{1b}[2J\u{9b}2J\r\u{202e}";

/// An arm whose names are hostile, and a log of it with hostile columns, in a folder and in files of hostile names.
fn hostile_arm(into: &Path) -> (PathBuf, PathBuf) {
    let folder = into.join(format!("folder{HOSTILE}"));
    fs::create_dir_all(&folder).expect("folder");
    let read = |name: &str| fs::read_to_string(project("robots/dd2").join(name)).expect("a file of the project");
    let mut urdf = read("robot.urdf");
    for name in ["joint_1", "joint_2", "link_1", "link_2", "base_link"] {
        // XML has no place for U+001B, not even as a reference.
        let escaped = HOSTILE.replace('\u{1b}', "").replace('\r', "&#13;");
        urdf = urdf.replace(&format!("\"{name}\""), &format!("\"{name}{escaped}\""));
    }
    assert!(urdf.contains("&#13;"), "names were replaced");
    fs::write(folder.join("robot.urdf"), urdf).expect("written");
    let robot = folder.join("robot.toml");
    fs::write(&robot, read("robot.toml")).expect("written");
    let mut log = format!("t,q1,q2,tau1,tau2,odd{}\n", HOSTILE.replace('\r', ""));
    for k in 0..6000 {
        let t = f64::from(k) * 1e-3;
        let q = [(3.0 * t).sin() + 0.3 * (7.1 * t).sin(), (4.3 * t).cos() + 0.4 * (8.7 * t).sin()];
        let _ = writeln!(log, "{t},{},{},{},{},1", q[0], q[1], 20.0 * q[0].sin(), 2.0 * q[1].cos());
    }
    let path = folder.join(format!("log{HOSTILE}\n.csv"));
    fs::write(&path, log).expect("written");
    (robot, path)
}

#[test]
fn names_of_files_reach_no_output_unescaped() {
    let dir = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).expect("folder");
    let (robot, log) = hostile_arm(dir.path());
    let bad_cell = dir.path().join(format!("cell{HOSTILE}.csv"));
    fs::write(&bad_cell, format!("t,q1,q2,tau1,tau2\n0,\"{HOSTILE}\",0,0,0\n")).expect("written");
    let bad_key = dir.path().join(format!("key{HOSTILE}.toml"));
    let known = fs::read_to_string(&robot).expect("read");
    let toml = known + "[\"x\\u001b[2J\u{9b}\"]\n\"\u{202e}\" = \"\u{9b}2J\"\n";
    fs::write(&bad_key, toml).expect("written");
    let missing = dir.path().join(HOSTILE);
    let json = dir.path().join("out.json");
    let [r, l, o] = [&*robot, &*log, &*json];
    let word = Path::new;
    let runs: [&[&Path]; 13] = [
        &[word("check"), r],
        &[word("check"), &bad_key],
        &[word("check"), &missing],
        &[word("check"), r, &missing],
        &[word("identify"), r, l, word("--json"), o],
        &[word("identify"), r, l, word("--json"), word("/dev/stdout")],
        &[word("identify"), r, &bad_cell],
        &[word("identify"), word("--online"), r, l],
        &[word("predict"), r, l, word("--out"), &dir.path().join("p.csv")],
        &[word("compare"), l, l],
        &[word("daemon"), &bad_key],
        &[word("controller"), &missing],
        &[word("sim"), r, word("--setpoints"), l],
    ];
    for arguments in runs {
        let output = rivet(arguments);
        let (shown, said) = (assert_printable(&output.stdout), assert_printable(&output.stderr));
        assert!(output.status.code().is_some_and(|code| code != 101), "{arguments:?}: {output:?}");
        // Each shows the name, escaped.
        assert!((shown + &said).contains("\\u"), "{arguments:?}: {output:?}");
    }
    assert_printable(&fs::read(&json).expect("JSON"));
}

#[test]
fn standard_error_that_is_full_ends_nothing() {
    let full = || fs::OpenOptions::new().write(true).open("/dev/full").expect("/dev/full");
    let dir = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).expect("folder");
    let (robot, log) = hostile_arm(dir.path());
    let run = |arguments: &[&Path]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_rivet"));
        command.args(arguments).stderr(full()).output().expect("it runs").status.code()
    };
    assert_eq!(run(&[Path::new("check"), Path::new("/none")]), Some(78));
    assert_eq!(run(&[Path::new("identify"), &robot, Path::new("/none.csv")]), Some(74));
    let out = dir.path().join("p.parquet");
    assert_eq!(run(&[Path::new("predict"), &robot, &log, Path::new("--out"), &out]), Some(0));
}

/// A result that could not be printed is a failure, whatever the command.
#[test]
fn standard_output_that_is_full_is_a_failure() {
    let full = || fs::OpenOptions::new().write(true).open("/dev/full").expect("/dev/full");
    let dir = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).expect("folder");
    let (robot, log) = hostile_arm(dir.path());
    let (json, copy) = (Path::new("--json"), dir.path().join("copy.npz"));
    let runs: [&[&Path]; 5] = [
        &[Path::new("check"), &robot],
        &[Path::new("inspect"), &log, &robot, json],
        &[Path::new("convert"), &log, &copy, &robot, json],
        &[Path::new("doctor"), json],
        &[Path::new("identify"), &robot, &log],
    ];
    for arguments in runs {
        let mut command = Command::new(env!("CARGO_BIN_EXE_rivet"));
        let output = command.args(arguments).stdout(full()).output().expect("it runs");
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(said.contains("standard output cannot be written"), "{arguments:?}: {said}");
        assert_eq!(output.status.code(), Some(74), "{arguments:?}: {said}");
    }
}

#[test]
fn nested_text_is_refused() {
    let dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join("hostile");
    fs::create_dir_all(&dir).expect("directory");
    let robot = dir.join("robot.toml");
    for text in [
        format!("a = {}", "[".repeat(100_000)),
        format!("a = {}", "{ b = ".repeat(30_000)),
        format!("{}a = 1", "a.".repeat(50_000)),
        "= \n".repeat(20_000),
    ] {
        fs::write(&robot, text).expect("written");
        assert_refused(&[Path::new("check"), &robot]);
    }
    let known = fs::read_to_string(project("robots/ur10e/robot.toml")).expect("robot.toml");
    fs::write(&robot, known).expect("written");
    let mut flat = "<robot name=\"a\"><link name=\"l0\"/>".to_owned();
    for k in 0..150_000 {
        let _ = write!(flat, "<joint name=\"j{k}\" type=\"fixed\"><parent link=\"l0\"/><child link=\"m{k}\"/></joint>");
    }
    let urdf = dir.join(urdf_name());
    for text in [format!("<robot name=\"a\">{}", "<a>".repeat(100_000)), flat] {
        fs::write(&urdf, text).expect("written");
        assert_refused(&[Path::new("check"), &robot]);
    }
}

/// The URDF that the robot file names.
fn urdf_name() -> String {
    let known = fs::read_to_string(project("robots/ur10e/robot.toml")).expect("robot.toml");
    let line = known.lines().find(|line| line.trim_start().starts_with("urdf")).expect("urdf key");
    line.split('"').nth(1).expect("quoted").to_owned()
}

/// A pipe that nobody writes: a reader would wait for ever.
#[test]
fn pipes_in_the_place_of_files_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let robot = project("robots/ur10e/robot.toml");
    for name in ["log.csv", "log.parquet", "log.mcap", "robot.toml", "data/chunk-000/episode.parquet"] {
        let pipe = folder.path().join(name);
        fs::create_dir_all(pipe.parent().expect("a folder")).expect("made");
        assert!(Command::new("mkfifo").arg(&pipe).status().expect("mkfifo runs").success());
        let commands: [&[&Path]; 3] =
            [&[Path::new("inspect"), &pipe], &[Path::new("identify"), &robot, &pipe], &[Path::new("check"), &pipe]];
        for command in commands {
            assert_refused(command);
        }
    }
    let bag = folder.path().join("bag");
    fs::create_dir(&bag).expect("made");
    fs::write(
        bag.join("metadata.yaml"),
        "rosbag2_bagfile_information:\n  storage_identifier: mcap\n  relative_file_paths:\n    - bag.mcap\n",
    )
    .expect("written");
    assert!(Command::new("mkfifo").arg(bag.join("bag.mcap")).status().expect("mkfifo runs").success());
    assert_refused(&[Path::new("inspect"), &bag]);
}

/// A root that the bus refuses is refused before a file is written.
#[test]
fn a_simulator_that_cannot_join_its_bus_leaves_nothing_behind() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let output = Command::new(env!("CARGO_BIN_EXE_rivet"))
        .arg("sim")
        .arg(project("robots/dd2/robot.toml").canonicalize().expect("there"))
        .args(["--root", "below", "--truth-out"])
        .arg(at("truth.json"))
        .arg("--log-out")
        .arg(at("log.csv"))
        .current_dir(folder.path())
        .output()
        .expect("rivet runs");
    let said = assert_printable(&output.stderr);
    assert!(!output.status.success() && said.contains("absolute"), "{said}");
    assert_eq!(fs::read_dir(folder.path()).expect("there").count(), 0, "{said}");
}
