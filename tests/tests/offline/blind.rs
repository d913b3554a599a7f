//! `rivet blind make`: what is drawn hangs on the seed alone, answers stay apart, and cases are what `rivet blind run` takes.

use rivet_tests::{rivet, robot, succeed};
use serde_json::Value;
use std::path::Path;

/// Sum that seals the answers.
fn make(seed: &str, count: &str, out: &Path) -> String {
    let output = succeed(
        rivet().args(["blind", "make", "--seed", seed, "--count", count, "--out"]).arg(out).arg(robot("manutec-r3")),
    );
    let text = String::from_utf8(output.stdout).expect("text");
    let first = text.lines().next().expect("a line").to_owned();
    first.strip_prefix("answers  sha256 ").expect("the sum comes first").to_owned()
}

fn answers(out: &Path) -> Value {
    let file = format!("{}-answers.json", out.display());
    serde_json::from_str(&std::fs::read_to_string(file).expect("answers beside the cases")).expect("JSON")
}

#[test]
fn a_seed_decides_the_cases_and_more_of_them_leave_the_first_as_they_are() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let one = make("3", "1", &at("one"));
    assert_ne!(one, make("4", "1", &at("other")));
    make("3", "2", &at("two"));
    let log = |set: &str| std::fs::read(at(set).join("case-01/log-b.parquet")).expect("a log");
    assert_eq!(log("one"), log("two"));
    assert_eq!(answers(&at("one"))["case-01"], answers(&at("two"))["case-01"]);
    // Nothing in the folder of the cases says what was drawn.
    let mut names: Vec<String> = std::fs::read_dir(at("two").join("case-01"))
        .expect("a case")
        .map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    assert_eq!(names, ["log-a.parquet", "log-b.parquet", "robot.toml", "robot.urdf"]);
    // A second draw into the same folder would mix two sets.
    let refused =
        rivet().args(["blind", "make", "--out"]).arg(at("two")).arg(robot("manutec-r3")).output().expect("runs");
    assert!(!refused.status.success());
    assert!(String::from_utf8_lossy(&refused.stderr).contains("is not empty"));
}

#[test]
fn drawn_cases_are_diagnosed_and_scored() {
    let folder = tempfile::tempdir().expect("a folder");
    let (cases, verdicts) = (folder.path().join("cases"), folder.path().join("verdicts.json"));
    make("7", "1", &cases);
    succeed(rivet().args(["blind", "run"]).arg(&cases).arg("--out").arg(&verdicts));
    let found: Value = serde_json::from_slice(&std::fs::read(&verdicts).expect("verdicts")).expect("JSON");
    assert!(found["case-01"]["verdict"].is_string(), "{found}");
    let score =
        succeed(rivet().args(["blind", "score"]).arg(&verdicts).arg(format!("{}-answers.json", cases.display())));
    let text = String::from_utf8(score.stdout).expect("text");
    assert!(text.contains("case-01"), "{text}");
}
