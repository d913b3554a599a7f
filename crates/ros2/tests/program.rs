//! The program by itself: no robot speaks.

use std::path::Path;
use std::process::Command;

use rivet_ipc_schema::PrivateBus;

/// Counts that could not be printed are a failure: who reads them would take their absence for success.
#[test]
fn full_standard_output_is_a_failure() {
    let bus = PrivateBus::new("ros2-full");
    let robot = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../robots/dd2/robot.toml");
    let run = |stdout: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_rivet-ros2"));
        command.arg(&robot).args(["--json", "--seconds", "0.2", "--interface", "127.0.0.1", "--domain", "87"]);
        command.arg("--prefix").arg(&bus.config().prefix).arg("--root").arg(&bus.config().root);
        let stdout = std::fs::OpenOptions::new().write(true).open(stdout).expect("a device");
        let output = command.arg("--die-with-parent").stdout(stdout).output().expect("it runs");
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let (code, stderr) = run("/dev/null");
    assert_eq!(code, Some(0), "{stderr}");
    let (code, stderr) = run("/dev/full");
    assert!(code == Some(74) && stderr.contains("standard output cannot be written"), "{code:?} {stderr}");
}
