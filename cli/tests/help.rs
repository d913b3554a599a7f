//! What `rivet --help` says. That this package has a test of its program also makes a test run of the workspace build it, with the same
//! features as everything else: the tests of the whole use that one.

use std::process::Command;

/// Every command by its name, in lines that fit a terminal of 100 columns.
#[test]
fn help_names_the_commands_and_fits() {
    let output = Command::new(env!("CARGO_BIN_EXE_rivet")).arg("--help").output().expect("the program starts");
    assert!(output.status.success());
    let text = String::from_utf8_lossy(&output.stdout);
    for command in ["demo", "identify", "diagnose", "predict", "doctor", "study", "figures", "blind", "monitor"] {
        assert!(text.lines().any(|line| line.split_whitespace().next() == Some(command)), "{command}: {text}");
    }
    assert!(text.lines().all(|line| line.chars().count() <= 100), "{text}");
}
