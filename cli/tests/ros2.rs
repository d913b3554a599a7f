//! `rivet ros2` is the program beside it.

use std::os::unix::fs::PermissionsExt as _;
use std::path::PathBuf;
use std::process::Command;

/// `rivet` in a folder of its own.
fn alone() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    let program = folder.path().join("rivet");
    std::fs::copy(env!("CARGO_BIN_EXE_rivet"), &program).expect("copied");
    (folder, program)
}

/// One test: a program that one thread copies is busy while another thread forks.
#[test]
fn names_the_command_that_builds_it_and_hands_words_and_exit_code_on() {
    names_the_command_that_builds_it();
    hands_words_and_exit_code_on();
}

fn names_the_command_that_builds_it() {
    let (_folder, program) = alone();
    let output = Command::new(program).args(["ros2", "robot.toml", "--domain", "7"]).output().expect("it runs");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(stderr.contains("is not built: cargo build --release -p rivet-ros2"), "{stderr}");
    assert_eq!(output.status.code(), Some(70), "{stderr}");
}

fn hands_words_and_exit_code_on() {
    let (folder, program) = alone();
    let other = folder.path().join("rivet-ros2");
    std::fs::write(&other, "#!/bin/sh\necho \"$@\"\nexit 65\n").expect("written");
    std::fs::set_permissions(&other, std::fs::Permissions::from_mode(0o755)).expect("set");
    let output = Command::new(program).args(["ros2", "robot.toml", "--json", "--help"]).output().expect("it runs");
    assert_eq!(String::from_utf8_lossy(&output.stdout), "robot.toml --json --help\n");
    assert_eq!(output.status.code(), Some(65));
}
