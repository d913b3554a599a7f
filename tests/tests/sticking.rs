//! An arm whose friction truly sticks, as the simulator's does by default: what stands beside a stop is not believed. Real
//! processes.

use std::path::{Path, PathBuf};
use std::process::Stdio;

use rivet_ipc_schema::PrivateBus;
use rivet_tests::process::Process;
use rivet_tests::stage::turn;
use rivet_tests::{rivet, robot};
use serde_json::Value;

/// A log of a Manutec r3 that its own controller moves; `how`: what is different about the arm.
fn recorded(name: &str, folder: &Path, how: &[&str]) -> PathBuf {
    let _turn = turn();
    let private = PrivateBus::new(name);
    let config = private.config();
    let start = |words: &[&str]| {
        let mut command = rivet();
        command.arg(words[0]).arg(robot("manutec-r3")).args(&words[1..]).arg("--die-with-parent");
        command.arg("--prefix").arg(&config.prefix).arg("--root").arg(&config.root);
        Process::start(command.stdin(Stdio::null()).stdout(Stdio::null()))
    };
    let log = folder.join("log.csv");
    let state = folder.join("state").display().to_string();
    let _controller = start(&["controller", "--best-effort", "--nominal", "--lockstep", "--state", &state]);
    let written = log.display().to_string();
    let plant = ["sim", "--lockstep", "2000", "--unpaced", "--log-out", &written];
    let mut plant = start(&[&plant, how].concat());
    assert!(plant.0.wait().expect("it ends by itself").success());
    log
}

fn json(file: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(file).expect("written")).expect("JSON")
}

/// Before rows beside a stop were doubted, a delay of 2 to 3 ms was named with a confidence of 0.96.
#[test]
fn nothing_is_named_on_an_arm_that_is_as_its_file_says_but_sticks() {
    let folder = tempfile::tempdir().expect("a folder");
    let log = recorded("sticks", folder.path(), &["--duration", "26", "--seed", "11"]);
    let found = folder.path().join("found.json");
    let end = rivet().arg("diagnose").arg(robot("manutec-r3")).arg(&log).arg("--json").arg(&found).output();
    let end = end.expect("it starts");
    let said = String::from_utf8_lossy(&end.stdout);
    assert_eq!(end.status.code(), Some(0), "{said}");
    assert_eq!(json(&found)["verdict"], "no_gap", "{said}");
}
