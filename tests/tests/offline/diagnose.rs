//! `rivet diagnose` on logs of arms that another program simulated, with effects the tool was not told.

use std::ops::Range;
use std::path::{Path, PathBuf};

use rivet_logs::{ReadOptions, read, write_columns};
use rivet_tests::{rivet, shared};
use serde_json::Value;

/// Exit code and JSON of `rivet diagnose` on a case's robot file and its two logs.
fn diagnose(case: &Path) -> (i32, Value) {
    diagnose_logs(case, ["log-a.parquet", "log-b.parquet"].map(|log| case.join(log)))
}

/// The same on two other logs.
fn diagnose_logs(case: &Path, logs: [PathBuf; 2]) -> (i32, Value) {
    let folder = tempfile::tempdir().expect("a folder");
    let json = folder.path().join("diagnosis.json");
    let mut command = rivet();
    command.arg("diagnose").arg(case.join("robot.toml")).args(logs).arg("--json").arg(&json);
    let output = command.output().expect("the program starts");
    let text = std::fs::read_to_string(&json)
        .unwrap_or_else(|why| panic!("{why}\n{}", String::from_utf8_lossy(&output.stderr)));
    (output.status.code().expect("it ends by itself"), serde_json::from_str(&text).expect("JSON"))
}

fn named<'a>(found: &'a Value, effect: &str) -> Option<&'a Value> {
    found["causes"].as_array().expect("causes").iter().find(|c| c["effect"] == effect)
}

/// Another program's physics and an exact nominal model: the effect, its joint, its size, its worth.
#[test]
fn a_missing_effect_is_named_sized_and_its_worth_predicted() {
    let Some(practice) = shared("data/practice") else { return };
    let (code, found) = diagnose(&practice.join("case-16"));
    assert_eq!((code, &found["verdict"]), (1, &Value::from("effect")), "{found:#}");
    let spring = named(&found, "joint_spring").expect("the spring is named");
    assert_eq!(spring["joints"].as_array().map(Vec::len), Some(1));
    assert_eq!(spring["joints"][0], found["gap"]["per_joint"][2]["joint"]);
    let stiffness = spring["magnitude"]["stiffness_Nm_rad"].as_f64().expect("a stiffness");
    // 7.87 N m/rad in the other program.
    assert!((stiffness / 7.87 - 1.0).abs() < 0.05, "{stiffness}");
    let shrink = |key: &str| spring["shrink"][key].as_f64().expect("a number");
    assert!((shrink("predicted") - shrink("measured")).abs() < 0.05, "{spring}");
    assert!(shrink("low") <= shrink("measured") && shrink("measured") <= shrink("high"), "{spring}");
    assert!(found["gap"]["after"].as_f64() < found["gap"]["before"].as_f64());
}

/// Fourier series are looked at and moves from point to point sealed: what is promised is less sure than between parts of both, which is said, and
/// comes true within that.
#[test]
fn a_promise_for_motion_of_another_kind_is_less_sure() {
    let Some(case) = shared("data/practice-wrong-nominal/case-12") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let part = |name: &str, of: fn(usize) -> Range<usize>| {
        let log = read(case.join(name), &ReadOptions::new(6)).expect("a log");
        let log = log.slice(of(log.len()));
        let mut columns = vec![("t".to_owned(), &log.t[..])];
        for (kind, signals) in [("q", &log.q), ("tau", log.torque().expect("torque"))] {
            columns.extend(signals.iter().enumerate().map(|(j, s)| (format!("{kind}{}", j + 1), &s[..])));
        }
        let path = folder.path().join(name);
        write_columns(&path, &columns).expect("written");
        path
    };
    let width = |found: &Value| {
        let shrink = &named(found, "gravity_direction").expect("the tilt is named")["shrink"];
        let [low, high, measured] = ["low", "high", "measured"].map(|key| shrink[key].as_f64().expect("a number"));
        assert!(low <= measured && measured <= high, "{shrink}");
        high - low
    };
    let (_, whole) = diagnose(&case);
    let (_, halves) = diagnose_logs(&case, [part("log-a.parquet", |n| 0..n / 2), part("log-b.parquet", |n| n / 2..n)]);
    assert!(whole["data"]["of_another_kind"].is_null(), "{}", whole["data"]);
    assert!(halves["data"]["of_another_kind"].as_f64().is_some_and(|share| share > 0.5), "{}", halves["data"]);
    assert!(width(&halves) > 2.0 * width(&whole), "{} {}", width(&halves), width(&whole));
}

/// Every value of the nominal model is wrong, as in life: the structure is still found.
#[test]
fn wrong_values_do_not_hide_a_missing_effect() {
    let Some(practice) = shared("data/practice-wrong-nominal") else { return };
    let (_, found) = diagnose(&practice.join("case-13"));
    let friction = named(&found, "viscous_nonlinearity").expect("the curve of friction is named");
    assert_eq!(friction["joints"][0], found["gap"]["per_joint"][4]["joint"]);
    let structure: Vec<&str> = found["causes"]
        .as_array()
        .expect("causes")
        .iter()
        .filter_map(|c| c["effect"].as_str())
        .filter(|e| !["link_inertia", "rotor_inertia", "coulomb_friction", "viscous_friction"].contains(e))
        .collect();
    assert_eq!(structure, ["viscous_nonlinearity"]);
}

/// Friction that bends before it slides is missed just after reversals: said in a sentence, with the cells that it is made of.
#[test]
fn where_a_joint_is_missed_is_told_otherwise_than_by_regime() {
    let Some(practice) = shared("data/practice") else { return };
    let (_, found) = diagnose(&practice.join("case-11"));
    let friction = named(&found, "presliding_friction").expect("the friction is named");
    let joint = &friction["joints"][0];
    let views = &found["figures"]["views"];
    let contrast = &views["contrast"];
    assert_eq!((&contrast["joint"], &contrast["axis"]), (joint, &Value::from("travel")), "{contrast}");
    assert_eq!((&contrast["more"], &contrast["less"]), (&Value::from("presliding"), &Value::from("beyond")));
    let ratio = contrast["ratio"].as_f64().expect("a ratio");
    let cells = views["cells"].as_array().expect("cells");
    let of = |axis: &str, part: &str| {
        let cell = cells.iter().find(|c| &c["joint"] == joint && c["axis"] == axis && c["part"] == part);
        cell.unwrap_or_else(|| panic!("no {part} of {axis}"))
    };
    let number = |cell: &Value, key: &str| cell[key].as_f64().unwrap_or_else(|| panic!("no {key} in {cell}"));
    let (near, beyond) = (of("travel", "presliding"), of("travel", "beyond"));
    let noise = number(near, "before_nm") / number(near, "before_over_noise");
    assert!((ratio - number(near, "before_nm") / number(beyond, "before_nm").max(noise)).abs() < 1e-3 * ratio);
    assert!(ratio > 3.0 && number(near, "after_nm") < 0.5 * number(near, "before_nm"), "{near}");
    // Bands share out what the ledger tells.
    let square = |part: &str| number(of("frequency", part), "before_nm").powi(2);
    let bands: f64 = ["below_1_hz", "1_to_5_hz", "above_5_hz"].map(square).iter().sum();
    let ledger = found["gap"]["per_joint"].as_array().expect("joints").iter().find(|j| &j["joint"] == joint);
    let whole = ledger.and_then(|j| j["before_nm"].as_f64()).expect("its gap");
    assert!((bands.sqrt() / whole - 1.0).abs() < 1e-6, "{bands} {whole}");
    for axis in ["travel", "load", "power", "torque", "time", "pose", "frequency"] {
        assert!(cells.iter().any(|c| c["axis"] == axis), "no {axis}");
    }
    assert!(cells.iter().all(|c| c["known"] == false || c["stretches"].as_u64() >= Some(6)));
}

/// Draws one case of a UR10e into `folder/cases` and says what is wrong with it.
fn drawn(seed: &str, folder: &Path) -> Vec<String> {
    let cases = folder.join("cases");
    let mut make = rivet();
    make.args(["blind", "make", "--seed", seed, "--count", "1", "--out"]).arg(&cases);
    make.arg(rivet_tests::root().join("robots/ur10e/robot.toml"));
    let output = make.output().expect("the program starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let answers = std::fs::read_to_string(folder.join("cases-answers.json")).expect("answers");
    let answers: Value = serde_json::from_str(&answers).expect("JSON");
    let effects = answers["case-01"]["effects"].as_array().expect("effects");
    effects.iter().filter_map(|e| e["effect"].as_str().map(str::to_owned)).collect()
}

/// An elbow whose zero is 0.03 rad off moves its links' weight as other first moments would, and a counterbalance is beside
/// it: the effect is named, and that these runs alone cannot tell it from values of the links is said, with the angle. So is the
/// counterbalance: with its centre elsewhere along the link the upper arm would pull by the same law.
#[test]
fn an_effect_that_values_imitate_is_a_class_with_them() {
    let folder = tempfile::tempdir().expect("a folder");
    assert_eq!(drawn("3279507663133315816", folder.path()), ["counterbalance", "encoder_offset"]);
    let (_, found) = diagnose(&folder.path().join("cases/case-01"));
    let cause = named(&found, "encoder_offset").unwrap_or_else(|| panic!("{:#}", found["causes"]));
    assert_eq!(cause["joints"], serde_json::json!([found["gap"]["per_joint"][2]["joint"]]));
    assert_eq!(cause["indistinguishable_from"], serde_json::json!(["link_inertia"]));
    let angle = cause["angles_deg"][0].as_f64().expect("an angle");
    // Cosine above 0.95.
    assert!(angle < 18.2, "{angle}");
    assert!(cause["separating_motion"].is_string(), "{cause}");
    let counterbalance = named(&found, "counterbalance").unwrap_or_else(|| panic!("{:#}", found["causes"]));
    assert_eq!(counterbalance["indistinguishable_from"], serde_json::json!(["link_inertia"]));
}

/// A push of 38.5 N: the largest instant and what was steady are on either side of it.
#[test]
fn a_push_is_sized() {
    let Some(practice) = shared("data/practice") else { return };
    let (_, found) = diagnose(&practice.join("case-01"));
    let push = named(&found, "external_force").unwrap_or_else(|| panic!("{:#}", found["causes"]));
    let [steady, largest] = ["steady_N", "largest_N"].map(|key| push["magnitude"][key].as_f64().expect("a size"));
    assert!((0.75 * 38.5..38.5).contains(&steady) && (38.5..1.3 * 38.5).contains(&largest), "{steady} {largest}");
}

/// Nothing is wrong, and something is wrong that the library does not hold: neither gets a name.
#[test]
fn what_is_not_there_or_not_known_is_not_named() {
    let Some(practice) = shared("data/practice") else { return };
    let (code, found) = diagnose(&practice.join("case-24"));
    assert_eq!((code, &found["verdict"]), (0, &Value::from("no_gap")), "{found:#}");
    let (code, found) = diagnose(&practice.join("case-02"));
    assert_eq!((code, &found["verdict"]), (2, &Value::from("unexplained")), "{found:#}");
    assert_eq!(found["causes"], Value::Array(Vec::new()));
}

/// A cable that pulls a wrist from one angle on bends like a counterbalance over the part of a turn that a log sees.
#[test]
fn what_pulls_from_one_angle_on_is_no_counterbalance() {
    let folder = tempfile::tempdir().expect("a folder");
    assert_eq!(drawn("3279507663133315817", folder.path()), ["outside"]);
    let (code, found) = diagnose(&folder.path().join("cases/case-01"));
    assert_eq!((code, &found["verdict"]), (2, &Value::from("unexplained")), "{found:#}");
    assert_eq!(found["causes"], Value::Array(Vec::new()));
}

/// `verdicts/` holds what was said of the sealed cases, for whoever has the answers: of every case, and still so.
#[test]
fn the_kept_verdicts_on_sealed_cases_are_those_of_this_build() {
    for set in ["sealed", "sealed-wrong-nominal"] {
        let file = rivet_tests::root().join("tests/verdicts").join(set).with_extension("json");
        let kept: Value = serde_json::from_str(&std::fs::read_to_string(file).expect("kept verdicts")).expect("JSON");
        let Some(cases) = shared(&format!("data/{set}")) else { return };
        let folders = std::fs::read_dir(&cases).expect("a folder").filter_map(Result::ok).map(|e| e.path());
        let names: Vec<String> = folders
            .filter(|folder| folder.join("robot.toml").exists())
            .filter_map(|folder| Some(folder.file_name()?.to_str()?.to_owned()))
            .collect();
        assert_eq!(kept.as_object().expect("an object").len(), names.len());
        for name in &names {
            assert!(kept[name]["verdict"].is_string(), "{set} {name}");
        }
        let first = names.iter().min().expect("a case");
        let (_, found) = diagnose(&cases.join(first));
        assert_eq!(found["verdict"], kept[first]["verdict"], "{set} {first}");
        let effects = |of: &Value| -> Vec<Value> {
            of["causes"].as_array().expect("causes").iter().map(|c| c["effect"].clone()).collect()
        };
        assert_eq!(effects(&found), effects(&kept[first]), "{set} {first}");
    }
}

/// A result that cannot be written ends with a code of its own: 1 would mean that a cause was named.
#[test]
fn a_result_that_cannot_be_written_is_an_error() {
    let Some(practice) = shared("data/practice") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let case = practice.join("case-24");
    let mut command = rivet();
    command.arg("diagnose").arg(case.join("robot.toml")).arg(case.join("log-a.parquet"));
    let output = command.arg("--json").arg(folder.path().join("missing/x.json")).output().expect("the program starts");
    assert_eq!(output.status.code(), Some(74), "{output:?}");
    assert!(String::from_utf8_lossy(&output.stderr).contains("missing/x.json"));
}
