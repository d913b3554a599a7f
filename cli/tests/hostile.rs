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
