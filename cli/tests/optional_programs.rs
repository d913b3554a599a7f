//! `rivet ros2` and `rivet view` are the programs beside it.

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
    for command in ["ros2", "view"] {
        let output = Command::new(&program).args([command, "robot.toml", "--seconds", "7"]).output().expect("it runs");
        let stderr = String::from_utf8_lossy(&output.stderr);
        let expected =
            format!("is not built: cargo build --release -p rivet-{command}, or cargo install --path crates/{command}");
        assert!(stderr.contains(&expected), "{stderr}");
        assert_eq!(output.status.code(), Some(70), "{stderr}");
    }
}

fn hands_words_and_exit_code_on() {
    let (folder, program) = alone();
    for command in ["ros2", "view"] {
        let other = folder.path().join(format!("rivet-{command}"));
        std::fs::write(&other, "#!/bin/sh\necho \"$0 $@\"\nexit 65\n").expect("written");
        std::fs::set_permissions(&other, std::fs::Permissions::from_mode(0o755)).expect("set");
        let output =
            Command::new(&program).args([command, "robot.toml", "--json", "--seconds=7"]).output().expect("it runs");
        let expected = format!("{} robot.toml --json --seconds=7\n", other.display());
        assert_eq!(String::from_utf8_lossy(&output.stdout), expected);
        assert_eq!(output.status.code(), Some(65));
        // What the program does not know is refused before it starts.
        let output = Command::new(&program).args([command, "robot.toml", "--bad"]).output().expect("it runs");
        assert_eq!((output.stdout.len(), output.status.code()), (0, Some(64)));
    }
}
