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

/// A file that knows of no friction, as from a URDF alone: with no friction to doubt, a delay was named beside it.
#[test]
fn an_arm_that_sticks_lacks_friction_and_nothing_else_where_its_file_has_none() {
    let folder = tempfile::tempdir().expect("a folder");
    let log = recorded("unknown-friction", folder.path(), &["--duration", "26", "--seed", "11"]);
    let given = robot("manutec-r3");
    for file in std::fs::read_dir(given.parent().expect("its folder")).expect("readable") {
        let file = file.expect("an entry").path();
        std::fs::copy(&file, folder.path().join(file.file_name().expect("a name"))).expect("copied");
    }
    let none = |line: &str| {
        let key = line.split('=').next().unwrap_or("").trim();
        if ["coulomb", "viscous"].contains(&key) { format!("{key} = [0, 0, 0, 0, 0, 0]") } else { line.to_owned() }
    };
    let text = std::fs::read_to_string(&given).expect("a robot file");
    let file = folder.path().join("robot.toml");
    std::fs::write(&file, text.lines().map(none).collect::<Vec<_>>().join("\n")).expect("written");
    let found = folder.path().join("found.json");
    let end = rivet().arg("diagnose").arg(&file).arg(&log).arg("--json").arg(&found).output().expect("it starts");
    let said = String::from_utf8_lossy(&end.stdout);
    let found = json(&found);
    assert_eq!(found["verdict"], "parameter", "{said}");
    for cause in found["causes"].as_array().expect("causes") {
        assert!(
            ["coulomb_friction", "viscous_friction"].contains(&cause["effect"].as_str().expect("a name")),
            "{cause}"
        );
    }
}
