//! An arm whose friction truly sticks, as the simulator's does by default: what stands beside a stop is not believed. Real
//! processes.

use std::path::{Path, PathBuf};
use std::process::Stdio;

use rivet_ipc_schema::PrivateBus;
use rivet_tests::process::Process;
use rivet_tests::stage::turn;
use rivet_tests::{rivet, robot, succeed};
use serde_json::Value;

/// A log of a Manutec r3 that its own controller moves, and the truth; `how`: what is different about the arm.
fn recorded(name: &str, folder: &Path, how: &[&str]) -> (PathBuf, Value) {
    let _turn = turn();
    let private = PrivateBus::new(name);
    let config = private.config();
    let start = |words: &[&str]| {
        let mut command = rivet();
        command.arg(words[0]).arg(robot("manutec-r3")).args(&words[1..]).arg("--die-with-parent");
        command.arg("--prefix").arg(&config.prefix).arg("--root").arg(&config.root);
        Process::start(command.stdin(Stdio::null()).stdout(Stdio::null()))
    };
    let (log, truth) = (folder.join("log.csv"), folder.join("truth.json"));
    let state = folder.join("state").display().to_string();
    let _controller = start(&["controller", "--best-effort", "--nominal", "--lockstep", "--state", &state]);
    let written = [log.display().to_string(), truth.display().to_string()];
    let plant = ["sim", "--lockstep", "2000", "--unpaced", "--log-out", &written[0], "--truth-out", &written[1]];
    let mut plant = start(&[&plant, how].concat());
    assert!(plant.0.wait().expect("it ends by itself").success());
    (log, json(&truth))
}

fn json(file: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(file).expect("written")).expect("JSON")
}

/// Before rows beside a stop were doubted, a delay of 2 to 3 ms was named with a confidence of 0.96.
#[test]
fn nothing_is_named_on_an_arm_that_is_as_its_file_says_but_sticks() {
    let folder = tempfile::tempdir().expect("a folder");
    let (log, _) = recorded("sticks", folder.path(), &["--duration", "26", "--seed", "11"]);
    let found = folder.path().join("found.json");
    let end = rivet().arg("diagnose").arg(robot("manutec-r3")).arg(&log).arg("--json").arg(&found).output();
    let end = end.expect("it starts");
    let said = String::from_utf8_lossy(&end.stdout);
    assert_eq!(end.status.code(), Some(0), "{said}");
    assert_eq!(json(&found)["verdict"], "no_gap", "{said}");
}

/// With rows beside a stop 44 % of the true values lay within two standard deviations.
#[test]
fn off_line_deviations_hold_on_an_arm_that_sticks() {
    let folder = tempfile::tempdir().expect("a folder");
    let how =
        "--duration 40 --bodies 1.1 --friction 1.2 --bodies-spread 0.05 --friction-spread 0.1 --payload 3 --seed 5";
    let (log, truth) = recorded("deviations", folder.path(), &how.split(' ').collect::<Vec<_>>());
    let found = folder.path().join("found.json");
    succeed(rivet().arg("identify").arg(robot("manutec-r3")).arg(&log).arg("--json").arg(&found));
    let truth = truth["base"].as_array().expect("a list");
    let parameters = json(&found)["parameters"].as_array().expect("a list").clone();
    let within = |p: &Value| {
        let of = |v: &Value| v.as_f64().expect("a number");
        let true_one = truth.iter().find(|t| t["name"] == p["name"]).expect("the same names");
        (of(&p["instrumental"]) - of(&true_one["value"])).abs() <= 2.0 * of(&p["std"])
    };
    let held = parameters.iter().filter(|p| within(p)).count();
    println!("{held} of {} within two deviations", parameters.len());
    assert!(100 * held >= 85 * parameters.len(), "{held} of {}", parameters.len());
}
