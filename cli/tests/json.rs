//! `--json` of commands that report: one document, with the fields that docs/operating.md lists.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

fn rivet(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_rivet")).current_dir(folder).args(arguments).output().expect("the program starts")
}

fn robot(name: &str) -> String {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../robots").join(name).join("robot.toml");
    path.to_string_lossy().into_owned()
}

/// What a command prints, which is one document.
fn printed(folder: &Path, arguments: &[&str]) -> Value {
    let output = rivet(folder, arguments);
    let text = String::from_utf8_lossy(&output.stdout);
    serde_json::from_str(&text)
        .unwrap_or_else(|why| panic!("{arguments:?}: {why}\n{text}\n{}", String::from_utf8_lossy(&output.stderr)))
}

/// What a command writes besides its text.
fn written(folder: &Path, arguments: &[&str]) -> Value {
    let output = rivet(folder, &[arguments, &["--json", "out.json"]].concat());
    assert!(!output.stdout.is_empty(), "{arguments:?}: its text");
    let text = std::fs::read_to_string(folder.join("out.json"))
        .unwrap_or_else(|why| panic!("{arguments:?}: {why}\n{}", String::from_utf8_lossy(&output.stderr)));
    std::fs::remove_file(folder.join("out.json")).expect("it is there");
    serde_json::from_str(&text).expect("JSON")
}

/// A log of the two-link arm in motion, with time in seconds times `factor`.
fn log(folder: &Path, name: &str, factor: f64) {
    use std::fmt::Write as _;
    let mut text = "t,q1,q2,tau1,tau2\n".to_owned();
    for k in 0..3000 {
        let t = f64::from(k) * 0.002;
        let (a, b) = ((2.0 * t).sin(), (3.1 * t).sin());
        let _ = writeln!(text, "{:.6},{a:.6},{b:.6},{:.4},{:.4}", t * factor, 20.0 * a + 3.0 * b, 5.0 * b);
    }
    std::fs::write(folder.join(name), text).expect("written");
}

#[test]
fn commands_that_look_at_something_print_a_document() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    let check = printed(at, &["check", &robot("ur10e"), "--json"]);
    assert_eq!(check["robot"], "ur10e");
    assert_eq!(check["joints"].as_array().map(Vec::len), Some(6));
    let period = check["values"].as_array().and_then(|values| values.iter().find(|v| v["key"] == "sample_period_s"));
    assert!(period.is_some_and(|period| period["value"].is_number() && !period["origin"].is_null()), "{check}");
    assert!(check["base_parameters"].as_array().is_some_and(|all| all.iter().all(|p| p["nominal"].is_number())));

    let urdf = PathBuf::from(robot("ur10e")).with_file_name("robot.urdf");
    let urdf = urdf.to_string_lossy();
    let new = printed(at, &["new", &urdf, "--output", "new.toml", "--json"]);
    assert_eq!(new["file"], "new.toml");
    assert!(new["unknown"].is_array() && new["warnings"].is_array() && at.join("new.toml").is_file(), "{new}");
    let both = rivet(at, &["new", &urdf, "--output", "-", "--json"]);
    assert_eq!((both.status.code(), both.stdout.len()), (Some(64), 0));

    let dd2 = robot("dd2");
    let bench = printed(at, &["bench-loop", &dd2, "--seconds", "1", "--load", "idle", "--json"]);
    let work = &bench["measurements"][0]["work"];
    assert!(work["count"].as_u64() > Some(0) && work["p99_us"].as_f64() > Some(0.0), "{bench}");

    let made = printed(at, &["blind", "make", &robot("ur10e"), "--count", "1", "--out", "cases", "--json"]);
    assert_eq!(
        (&made["cases"], &made["folder"], &made["answers"]),
        (&1.into(), &"cases".into(), &"cases-answers.json".into())
    );
    assert_eq!(made["answers_sha256"].as_str().map(str::len), Some(64));
    // A robot file that cannot be used fails at once.
    std::fs::write(at.join("cases/case-01/robot.toml"), "name = 1\n").expect("written");
    let run = printed(at, &["blind", "run", "cases", "--out", "verdicts.json", "--json"]);
    assert_eq!((&run["cases"], &run["failed"], &run["verdicts"]["failed"]), (&1.into(), &1.into(), &1.into()));
}

#[test]
fn commands_that_compute_write_a_document() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    log(at, "run.csv", 1.0);
    let dd2 = robot("dd2");
    let predict = ["predict", &dd2, "run.csv", "--out", "pred.csv"];
    let errors = written(at, &predict);
    assert_eq!((&errors["robot"], &errors["rows"]), (&"dd2".into(), &3000.into()));
    assert!(errors["joints"][1]["error_percent"].is_number(), "{errors}");
    let figures = written(at, &["figures", "3"]);
    assert_eq!(figures[0]["figure"], 3);
    assert!(figures[0]["checks"][0]["pass"].is_boolean(), "{figures}");

    // Asked before the work, and never over what is read.
    for (file, code) in [("no-such-folder/out.json", 74), ("run.csv", 64), ("pred.csv", 64)] {
        let output = rivet(at, &[&predict[..], &["--json", file]].concat());
        assert_eq!((output.status.code(), output.stdout.len()), (Some(code), 0), "{file}");
    }
    for command in [["figures", "3"], ["demo", "--seed=1"], ["study", "tracking"]] {
        let output = rivet(at, &[&command[..], &["--json", "no-such-folder/out.json"]].concat());
        assert_eq!((output.status.code(), output.stdout.len()), (Some(74), 0), "{command:?}");
    }
}

#[test]
fn monitor_of_nobody_prints_no_document() {
    let folder = tempfile::tempdir().expect("a folder");
    let prefix = format!("json{}_", std::process::id());
    let root = folder.path().to_string_lossy();
    let dd2 = robot("dd2");
    let output =
        rivet(folder.path(), &["monitor", &dd2, "--json", "--patience", "0.1", "--prefix", &prefix, "--root", &root]);
    assert_eq!((output.status.code(), output.stdout.len()), (Some(70), 0));
}

#[test]
fn mistakes_with_logs_say_what_they_are() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    let dd2 = robot("dd2");
    let commands: [&[&str]; 4] = [&["identify"], &["diagnose"], &["replay"], &["predict", "--out", "pred.csv"]];
    let refused = |first: &str, second: &str, code: i32, words: &str| {
        for command in commands {
            let output = rivet(at, &[command, &[first, second]].concat());
            let text = String::from_utf8_lossy(&output.stderr);
            assert!(output.status.code() == Some(code) && text.contains(words), "{command:?} {first} {second}: {text}");
        }
    };
    log(at, "run.csv", 1.0);
    std::fs::copy(Path::new(&dd2).with_file_name("robot.urdf"), at.join("arm.urdf")).expect("copied");
    refused("arm.urdf", "run.csv", 78, "arm.urdf: is a URDF, not a robot file; `rivet new arm.urdf LOG");
    refused(&dd2, &dd2, 65, "robot.toml: is a TOML file, not a recording");
    refused(&dd2, "arm.urdf", 65, "arm.urdf: is a URDF, not a recording");
    refused("run.csv", &dd2, 64, "run.csv: is a log (CSV), where the arm is expected; the order is ROBOT.toml LOG");
    for (unit, factor) in [("ms", 1e3), ("us", 1e6), ("ns", 1e9)] {
        log(at, "scaled.csv", factor);
        refused(&dd2, "scaled.csv", 65, &format!("--map time_unit={unit}, or time_unit = \"{unit}\" in [log]"));
        let output = rivet(at, &["inspect", "scaled.csv"]);
        let text = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.code() == Some(2) && text.contains(&format!("time_unit={unit}")), "{text}");
    }
    for name in ["empty.csv", "empty.parquet", "empty.mcap", "empty.npz", "empty.h5", "empty"] {
        std::fs::write(at.join(name), "").expect("written");
        refused(&dd2, name, 65, &format!("{name}: is empty: 0 bytes"));
        let output = rivet(at, &["inspect", name]);
        assert!(String::from_utf8_lossy(&output.stderr).contains("is empty: 0 bytes"), "{name}");
    }
    std::fs::write(at.join("blank.csv"), "\n# nothing\n\n").expect("written");
    refused(&dd2, "blank.csv", 65, "blank.csv: is empty: it has no columns");
    std::fs::write(at.join("head.csv"), "t,q1,q2,tau1,tau2\n").expect("written");
    refused(&dd2, "head.csv", 65, "head.csv: is empty: it has columns and no rows");
    let output = rivet(at, &["inspect", &dd2, "run.csv"]);
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(text.contains("RECORDING ROBOT.toml"), "{text}");
}

/// Beginnings of commands, files that end each, words of the refusal.
type Tried<'a> = (&'a [&'a [&'a str]], &'a [&'a str], &'a str);

/// Any file in the place of any other is called what it is, with what to give instead.
#[test]
fn a_file_in_the_place_of_another_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    log(at, "run.csv", 1.0);
    let dd2 = robot("dd2");
    std::fs::copy(&dd2, at.join("arm.toml")).expect("copied");
    for copy in ["arm.urdf", "robot.urdf"] {
        std::fs::copy(Path::new(&dd2).with_file_name("robot.urdf"), at.join(copy)).expect("copied");
    }
    let texts: [(&str, &[u8]); 8] = [
        ("empty", b""),
        ("arm.xml", b"<mujoco/>"),
        ("old.json", b"{}"),
        ("blank", b" \n"),
        ("arm.xacro", b"<robot><xacro:include/></robot>"),
        ("other.toml", b"[package]\nname = 'x'\n"),
        ("noise", b"\x81\x02\0\x07"),
        ("answers.json", b"{\"case-1\": {\"effects\": []}}"),
    ];
    for (name, text) in texts {
        std::fs::write(at.join(name), text).expect("written");
    }
    let robot_files: [&[&str]; 3] = [&["check"], &["monitor"], &["doctor"]];
    let urdfs: [&[&str]; 2] = [&["new", "--output", "out.toml"], &["inspect", "run.csv"]];
    let recordings: [&[&str]; 2] = [&["inspect"], &["diagnose", "arm.toml"]];
    let documents: [&[&str]; 4] = [
        &["compare", "empty"],
        &["compare", "arm.toml"],
        &["blind", "score", "empty"],
        &["blind", "score", "arm.urdf"],
    ];
    let tried: [Tried<'_>; 5] = [
        (
            &robot_files,
            &["empty", "blank", "arm.urdf", "arm.xml", "arm.xacro", "old.json", "noise", "run.csv", "."],
            "not a robot file",
        ),
        (&robot_files, &["other.toml"], "without a key of a robot file"),
        (&urdfs, &["empty", "blank", "arm.xml", "arm.xacro", "old.json", "noise"], "not a URDF"),
        (&recordings, &["arm.toml", "arm.urdf", "arm.xml", "arm.xacro", "old.json", "noise"], "not a recording"),
        (&documents, &["old.json"], "not a"),
    ];
    for (commands, files, words) in tried {
        for (command, file) in commands.iter().flat_map(|command| files.iter().map(move |file| (command, file))) {
            let output = rivet(at, &[command, &[*file][..]].concat());
            let text = String::from_utf8_lossy(&output.stderr);
            assert!(!output.status.success() && text.contains(words), "{command:?} {file}: {text}");
            assert!(text.lines().count() == 1 && !text.contains("UTF-8"), "{command:?} {file}: {text}");
            let is_empty = ["empty", "blank"].contains(file) || command.contains(&"empty");
            assert!(!is_empty || text.contains("is an empty file"), "{command:?} {file}: {text}");
        }
    }
    let exchanged: [(&[&str], &str); 6] = [
        (&["control", "save", "arm.toml"], "the robot file comes first"),
        (&["record", "out.mcap", "arm.toml"], "the robot file comes first"),
        (&["convert", "arm.toml", "run.csv"], "the order is RECORDING OUT"),
        (&["convert", "out.csv", "run.csv"], "the order is RECORDING OUT"),
        (&["blind", "score", "answers.json", "old.json"], "the order is VERDICTS.json ANSWERS.json"),
        (&["generate", "arm.toml"], "is a file; give a folder"),
    ];
    for (command, words) in exchanged {
        let output = rivet(at, command);
        let text = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success() && text.contains(words), "{command:?}: {text}");
    }
}

#[test]
fn nanoseconds_are_converted_when_they_are_stated() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path();
    log(at, "run.csv", 1e9);
    std::fs::copy(Path::new(&robot("dd2")).with_file_name("robot.urdf"), at.join("robot.urdf")).expect("copied");
    let output = rivet(at, &["convert", "run.csv", "out.csv"]);
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && text.contains("looks like nanoseconds"), "{text}");
    assert!(!at.join("out.csv").exists());
    let output = rivet(at, &["convert", "run.csv", "out.csv", "robot.urdf", "--map", "time_unit=ns"]);
    assert!(output.status.success(), "{output:?}");
}
