//! `rivet diagnose --table`: a fleet of simulated arms into one table, with failures, interruptions and changes.

use std::collections::BTreeMap;
use std::io::Write as _;
use std::os::unix::process::ExitStatusExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use parquet::file::reader::FileReader as _;
use parquet::file::serialized_reader::SerializedFileReader;
use parquet::record::Field;
use rivet_simulation::process::{Options, Recording};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::{Value, json};

/// Duration of a log \[s\].
const LOG_S: f64 = 12.0;
/// Longest wait for what a process does \[s\].
const PATIENCE: Duration = Duration::from_secs(120);

fn project(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}

/// A folder with robots and their logs.
struct Fleet {
    folder: tempfile::TempDir,
}

impl Fleet {
    /// Arms named by `logs`, with a log for each entry: `arm-1/a` is `logs/arm-1/a.parquet`. Their friction is half as large again as that of
    /// their robot file.
    fn draw(logs: &[&str]) -> Fleet {
        let fleet = Fleet { folder: tempfile::tempdir().expect("a folder") };
        for (seed, log) in logs.iter().enumerate() {
            let arm = log.split('/').next().expect("an arm");
            let robot = fleet.at(&format!("robots/{arm}/robot.toml"));
            if !robot.exists() {
                std::fs::create_dir_all(robot.parent().expect("a folder")).expect("made");
                for file in ["robot.toml", "robot.urdf"] {
                    std::fs::copy(project("robots/dd2").join(file), robot.with_file_name(file)).expect("copied");
                }
            }
            fleet.draw_log(&robot, &format!("logs/{log}.parquet"), seed as u64);
        }
        fleet
    }

    fn at(&self, path: &str) -> PathBuf {
        self.folder.path().join(path)
    }

    fn draw_log(&self, robot: &Path, log: &str, seed: u64) {
        let loaded = rivet_config::load(robot).expect("a sound robot file");
        let options = Options { duration: Some(LOG_S), seed: Some(seed), friction: 1.5, ..Options::new(robot) };
        let run = Recording::new(&loaded, &options).expect("simulated");
        let [q_des, ..] = &run.planned;
        let mut columns = vec![("t".to_owned(), &run.t[..])];
        for (name, signals) in [("q", &run.q), ("tau", &run.tau), ("q_des", q_des)] {
            columns.extend(signals.iter().enumerate().map(|(j, signal)| (format!("{name}{}", j + 1), &signal[..])));
        }
        let log = self.at(log);
        std::fs::create_dir_all(log.parent().expect("a folder")).expect("made");
        rivet_logs::write_columns(&log, &columns).expect("written");
    }

    fn rivet(&self, words: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_rivet"));
        command.arg("diagnose").args(words).current_dir(self.folder.path());
        command
    }

    /// The command for the whole fleet.
    fn command(&self, options: &[&str]) -> Command {
        let mut command = self.rivet(&["--robots", "robots", "--logs", "logs/**/*", "--table", "t.parquet"]);
        command.args(options);
        command
    }

    /// Runs it; its exit code, output and summary.
    fn run(&self, options: &[&str]) -> (Option<i32>, String, Value) {
        let output = self.command(options).args(["--json", "summary.json"]).output().expect("it starts");
        let summary =
            std::fs::read(self.at("summary.json")).map_or(Value::Null, |t| serde_json::from_slice(&t).expect("JSON"));
        (output.status.code(), output_text(&output), summary)
    }

    /// Rows of the table by log group.
    fn rows(&self) -> BTreeMap<String, Value> {
        rows(&self.at("t.parquet"))
    }

    /// What is in the folder beside robots and logs.
    fn leftovers(&self) -> Vec<String> {
        let names = std::fs::read_dir(self.folder.path()).expect("there").flatten();
        let mut names: Vec<String> = names.map(|e| e.file_name().to_string_lossy().into_owned()).collect();
        names.retain(|name| !["robots", "logs", "summary.json"].contains(&name.as_str()));
        names.sort();
        names
    }

    /// Finished rows that wait beside the table.
    fn waiting(&self) -> Vec<Value> {
        let Ok(entries) = std::fs::read_dir(self.at("t.parquet.parts")) else { return Vec::new() };
        let paths =
            entries.flatten().map(|entry| entry.path()).filter(|path| path.extension().is_some_and(|e| e == "json"));
        paths.filter_map(|path| serde_json::from_slice(&std::fs::read(path).ok()?).ok()).collect()
    }
}

fn output_text(output: &Output) -> String {
    [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes).into_owned()).concat()
}

fn rows(table: &Path) -> BTreeMap<String, Value> {
    let file = SerializedFileReader::new(std::fs::File::open(table).expect("a table")).expect("Parquet");
    let records = file.get_row_iter(None).expect("rows");
    let row = |record: parquet::record::Row| value(Field::Group(record));
    let rows = records.map(|record| row(record.expect("a row")));
    rows.map(|row| (row["log_group"].as_str().expect("a group").to_owned(), row)).collect()
}

fn value(field: Field) -> Value {
    match field {
        Field::Null => Value::Null,
        Field::Str(text) => text.into(),
        Field::Double(number) => number.into(),
        Field::Long(number) | Field::TimestampMicros(number) => number.into(),
        Field::Group(record) => record.into_columns().into_iter().map(|(name, field)| (name, value(field))).collect(),
        Field::ListInternal(list) => list.elements().iter().cloned().map(value).collect(),
        Field::MapInternal(map) => map
            .entries()
            .iter()
            .map(|(key, number)| (value(key.clone()).as_str().expect("text").to_owned(), value(number.clone())))
            .collect(),
        other => panic!("{other:?}"),
    }
}

/// Waits for what a process does.
fn wait_for<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let deadline = Instant::now() + PATIENCE;
    while Instant::now() < deadline {
        if let Some(found) = look() {
            return found;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    panic!("no {what} within {PATIENCE:?}");
}

fn send(pid: u32, signal: Signal) {
    let pid = Pid::from_raw(i32::try_from(pid).expect("a number")).expect("a process");
    kill_process(pid, signal).expect("sent");
}

/// State and parent of a process.
fn process(pid: u32) -> Option<(char, u32)> {
    let text = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    let mut words = text.rsplit_once(')')?.1.split_whitespace();
    Some((words.next()?.chars().next()?, words.next()?.parse().ok()?))
}

fn lives(pid: u32) -> bool {
    process(pid).is_some_and(|(state, _)| state != 'Z')
}

fn children(parent: u32) -> Vec<u32> {
    let entries = std::fs::read_dir("/proc").expect("there").flatten();
    let pids = entries.filter_map(|entry| entry.file_name().to_str()?.parse().ok());
    pids.filter(|pid| process(*pid).is_some_and(|(_, own_parent)| own_parent == parent)).collect()
}

fn started(command: &mut Command) -> Child {
    command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("it starts")
}

/// The figures of a table's row in the JSON of the same diagnosis.
fn assert_row_is(row: &Value, document: &Value) {
    let same = |column: &Value, expected: &Value, name: &str| match (column.as_f64(), expected.as_f64()) {
        (Some(column), Some(expected)) => assert_eq!(column.to_bits(), expected.to_bits(), "{name}"),
        _ => assert_eq!(column, expected, "{name}"),
    };
    let fields = [
        ("verdict", &document["verdict"]),
        ("remark", &document["remark"]),
        ("robot_name", &document["robot"]),
        ("gap_before", &document["gap"]["before"]),
        ("gap_after", &document["gap"]["after"]),
        ("gap_noise_floor", &document["gap"]["noise_floor"]),
        ("unexplained_share", &document["unexplained_share"]),
        ("runs", &document["data"]["runs"]),
        ("training_s", &document["data"]["fit_seconds"]),
        ("held_out_s", &document["data"]["sealed_seconds"]),
        ("held_out", &document["passport"]["sealed"]),
        ("model", &document["passport"]["model"]),
        ("program_sha256", &document["passport"]["tool"]["sha256"]),
    ];
    for (name, expected) in fields {
        same(&row[name], expected, name);
    }
    let list = |value: &Value| value.as_array().expect("a list").clone();
    let digest = |role: &str| {
        list(&document["passport"]["inputs"])
            .into_iter()
            .filter(|i| i["role"] == role)
            .map(|i| i["sha256"].clone())
            .collect::<Vec<_>>()
    };
    assert_eq!(row["log_sha256"], Value::Array(digest("log")));
    assert_eq!(row["robot_sha256"], digest("robot")[0]);
    let (joints, expected) = (list(&row["joints"]), list(&document["gap"]["per_joint"]));
    assert_eq!(joints.len(), expected.len());
    for (joint, expected) in joints.iter().zip(&expected) {
        for name in ["joint", "before", "after", "noise_floor", "before_nm", "after_nm", "noise_floor_nm"] {
            same(&joint[name], &expected[name], name);
        }
    }
    let (causes, expected) = (list(&row["causes"]), list(&document["causes"]));
    assert_eq!(causes.len(), expected.len());
    for (cause, expected) in causes.iter().zip(&expected) {
        for name in
            ["effect", "joints", "share", "p_value", "confidence", "indistinguishable_from", "separating_motion"]
        {
            same(&cause[name], &expected[name], name);
        }
        for name in ["predicted", "low", "high", "measured"] {
            same(&cause[format!("shrink_{name}")], &expected["shrink"][name], name);
        }
        let (sizes, expected) =
            (cause["magnitude"].as_object().expect("sizes"), expected["magnitude"].as_object().expect("sizes"));
        assert!(!sizes.is_empty() && sizes.keys().eq(expected.keys()), "{sizes:?}");
        sizes.iter().for_each(|(name, size)| same(size, &expected[name], name));
    }
    let diagnosis: Value = serde_json::from_str(row["diagnosis"].as_str().expect("JSON")).expect("JSON");
    for name in ["schema", "robot", "verdict", "gap", "where", "log", "data", "unexplained_share"] {
        assert_eq!(diagnosis[name], document[name], "{name}");
    }
}

#[test]
fn rows_are_the_diagnoses_of_their_pairs_and_failures_are_rows() {
    let fleet = Fleet::draw(&["arm-1/a", "arm-1/b", "arm-2/a"]);
    std::fs::write(fleet.at("logs/arm-2/bad.csv"), "t,q1\n0,none\n").expect("written");
    std::fs::create_dir(fleet.at("logs/other")).expect("made");
    std::fs::copy(fleet.at("logs/arm-1/a.parquet"), fleet.at("logs/other/x.parquet")).expect("copied");
    let (code, text, summary) = fleet.run(&[]);
    assert_eq!(code, Some(1), "{text}");
    assert!(text.contains("5 pairs: 3 diagnosed, 2 failed; 0 were up to date") && text.contains("bad.csv"), "{text}");
    assert!(!text.contains(['\u{1b}', '\r']), "no terminal: {text:?}");
    assert_eq!((&summary["diagnosed"], &summary["failed"]), (&json!(3), &json!(2)), "{summary}");
    assert_eq!(fleet.leftovers(), ["t.parquet"]);
    let rows = fleet.rows();
    assert_eq!(rows.len(), 5);
    for (log, kind, robot) in [("arm-2/bad.csv", "data", json!("arm-2")), ("other/x.parquet", "no_robot", Value::Null)]
    {
        let row = &rows[&format!("logs/{log}")];
        assert_eq!(
            (&row["status"], &row["error_kind"], &row["robot"]),
            (&json!("failed"), &json!(kind), &robot),
            "{row}"
        );
        assert!(row["error"].as_str().is_some_and(|error| !error.is_empty()) && row["causes"].is_null(), "{row}");
    }
    for (arm, log) in [("arm-1", "a"), ("arm-1", "b"), ("arm-2", "a")] {
        let (robot, log) = (format!("robots/{arm}/robot.toml"), format!("logs/{arm}/{log}.parquet"));
        let alone = fleet.rivet(&[&robot, &log, "--json", "alone.json"]).output().expect("it starts");
        let document: Value =
            serde_json::from_slice(&std::fs::read(fleet.at("alone.json")).expect("written")).expect("JSON");
        let row = &rows[&log];
        assert_eq!((&row["robot"], &row["logs"]), (&json!(arm), &json!([log])));
        assert_eq!(row["exit_code"], json!(alone.status.code()));
        assert!(document["causes"].as_array().is_some_and(|causes| !causes.is_empty()), "{document}");
        assert_row_is(row, &document);
    }
}

#[test]
fn groups_hold_out_the_last_log_as_one_diagnosis_does() {
    let fleet = Fleet::draw(&["arm-1/a", "arm-1/b"]);
    let (code, text, _) = fleet.run(&["--group", "folder"]);
    assert_eq!(code, Some(0), "{text}");
    let row = &fleet.rows()["logs/arm-1"];
    let words = ["robots/arm-1/robot.toml", "logs/arm-1/a.parquet", "logs/arm-1/b.parquet"];
    fleet.rivet(&words).args(["--json", "alone.json"]).output().expect("it starts");
    let document: Value =
        serde_json::from_slice(&std::fs::read(fleet.at("alone.json")).expect("written")).expect("JSON");
    assert_eq!((&row["held_out"], &row["runs"]), (&json!("b.parquet"), &json!(2)));
    assert_row_is(row, &document);
    // The files by name are the same pair: there is nothing left to do.
    let again = fleet.rivet(&words).args(["--table", "t.parquet"]).output().expect("it starts");
    assert!(
        output_text(&again).contains("1 pairs: 1 diagnosed, 0 failed; 1 were up to date"),
        "{}",
        output_text(&again)
    );
}

#[test]
fn does_again_what_has_changed_and_nothing_else() {
    let fleet = Fleet::draw(&["arm-1/a", "arm-1/b", "arm-2/a"]);
    std::fs::write(fleet.at("logs/arm-2/bad.csv"), "t,q1\n0,none\n").expect("written");
    fleet.run(&[]);
    let first = fleet.rows();
    let file = || {
        let path = fleet.at("t.parquet");
        (std::fs::read(&path).expect("there"), path.metadata().and_then(|there| there.modified()).expect("a time"))
    };
    let written = file();
    let (code, _, summary) = fleet.run(&[]);
    assert_eq!((code, &summary["up_to_date"], file() == written), (Some(1), &json!(4), true), "{summary}");
    let made_again = || -> Vec<String> {
        let rows = fleet.rows();
        rows.iter().filter(|(log, row)| first.get(*log) != Some(row)).map(|(log, _)| log.clone()).collect()
    };
    // Another log under the same name.
    fleet.draw_log(&fleet.at("robots/arm-1/robot.toml"), "logs/arm-1/b.parquet", 77);
    let listed = fleet.command(&["--dry-run"]).output().expect("it starts");
    assert!(
        output_text(&listed).lines().any(|line| line.contains("arm-1/b.parquet") && line.contains("changed")),
        "{}",
        output_text(&listed)
    );
    assert_eq!(file(), written, "a list of pairs changes nothing");
    let (_, _, summary) = fleet.run(&[]);
    assert_eq!((&summary["up_to_date"], made_again()), (&json!(3), vec!["logs/arm-1/b.parquet".to_owned()]));
    // The robot's description: its logs, and not those of the other robot.
    let urdf = fleet.at("robots/arm-2/robot.urdf");
    let text = std::fs::read_to_string(&urdf).expect("read");
    std::fs::write(&urdf, text + "<!-- measured again -->\n").expect("written");
    let (_, _, summary) = fleet.run(&[]);
    assert_eq!(summary["up_to_date"], json!(2));
    assert_eq!(made_again().len(), 3, "{:?}", made_again());
    // A failed row stays until it is asked for; a mended log is diagnosed by itself.
    assert_eq!(fleet.run(&["--retry-failed"]).2["up_to_date"], json!(3));
    std::fs::copy(fleet.at("logs/arm-2/a.parquet"), fleet.at("logs/arm-2/bad.csv")).expect("copied");
    let (code, text, summary) = fleet.run(&[]);
    assert_eq!((code, &summary["failed"], &summary["up_to_date"]), (Some(0), &json!(0), &json!(3)), "{text}");
    // Rows of logs that the command does not name stay.
    let fewer = fleet.rivet(&["--robots", "robots", "--logs", "logs/arm-1/*", "--table", "t.parquet"]).output();
    assert!(output_text(&fewer.expect("it starts")).contains("2 pairs: 2 diagnosed, 0 failed; 2 were up to date"));
    assert_eq!(fleet.rows().len(), 4);
}

#[test]
fn a_log_gets_its_robot_later() {
    let fleet = Fleet::draw(&["arm-1/a", "arm-2/a"]);
    std::fs::rename(fleet.at("robots/arm-2"), fleet.at("away")).expect("moved");
    // With one robot all logs would be its logs.
    std::fs::create_dir(fleet.at("robots/arm-3")).expect("made");
    std::fs::write(fleet.at("robots/arm-3/robot.toml"), "name = 3\n").expect("written");
    assert_eq!(fleet.run(&[]).0, Some(1));
    assert_eq!(fleet.rows()["logs/arm-2/a.parquet"]["error_kind"], "no_robot");
    std::fs::rename(fleet.at("away"), fleet.at("robots/arm-2")).expect("moved");
    let (code, text, _) = fleet.run(&[]);
    assert_eq!(code, Some(0), "{text}");
    assert_eq!(fleet.rows()["logs/arm-2/a.parquet"]["robot"], "arm-2");
    let table = std::fs::File::open(fleet.at("t.parquet")).expect("there");
    assert_eq!(SerializedFileReader::new(table).expect("Parquet").metadata().file_metadata().num_rows(), 2);
}

#[test]
fn finished_rows_survive_sigkill_and_nothing_runs_on() {
    let fleet = Fleet::draw(&["arm-1/a", "arm-1/b", "arm-1/c", "arm-2/a", "arm-2/b"]);
    let mut running = started(&mut fleet.command(&["--jobs", "1"]));
    let diagnosis = wait_for("second diagnosis", || {
        let one = children(running.id());
        (!fleet.waiting().is_empty() && one.len() == 1).then(|| one[0])
    });
    send(running.id(), Signal::KILL);
    assert_eq!(running.wait().expect("it ends").signal(), Some(9));
    wait_for("end of the diagnosis", || (!lives(diagnosis)).then_some(()));
    let kept = fleet.waiting();
    assert!((1..5).contains(&kept.len()), "{}", kept.len());
    // What a killed writer leaves: a draft in the folder, and a row without an end.
    std::fs::write(fleet.at("t.parquet.parts/0123.json"), "{\"robot\":\"arm").expect("written");
    let (code, text, summary) = fleet.run(&[]);
    assert_eq!((code, &summary["up_to_date"]), (Some(0), &json!(kept.len())), "{text}");
    let rows = fleet.rows();
    assert_eq!((rows.len(), fleet.leftovers()), (5, vec!["t.parquet".to_owned()]));
    for row in kept {
        assert_eq!(rows[row["log_group"].as_str().expect("a log")], row);
    }
}

#[test]
fn ctrl_c_keeps_finished_rows_in_the_table() {
    let fleet = Fleet::draw(&["arm-1/a", "arm-1/b", "arm-1/c", "arm-2/a"]);
    let running = started(&mut fleet.command(&["--jobs", "1"]));
    let diagnosis = wait_for("second diagnosis", || {
        let one = children(running.id());
        (!fleet.waiting().is_empty() && one.len() == 1).then(|| one[0])
    });
    send(running.id(), Signal::INT);
    let output = running.wait_with_output().expect("it ends");
    assert_eq!(output.status.code(), Some(130), "{}", output_text(&output));
    assert!(output_text(&output).contains("the same command continues"), "{}", output_text(&output));
    assert!(!lives(diagnosis));
    let kept = fleet.rows();
    assert!((1..4).contains(&kept.len()) && kept.values().all(|row| row["status"] == "diagnosed"), "{kept:?}");
    assert_eq!(fleet.leftovers(), ["t.parquet"]);
    let (code, text, summary) = fleet.run(&[]);
    assert_eq!((code, &summary["up_to_date"]), (Some(0), &json!(kept.len())), "{text}");
    let rows = fleet.rows();
    assert!(rows.len() == 4 && kept.iter().all(|(log, row)| rows[log] == *row));
}

#[test]
fn a_crash_is_a_row_and_is_tried_again() {
    let fleet = Fleet::draw(&["arm-1/a", "arm-1/b"]);
    let running = started(&mut fleet.command(&["--jobs", "1"]));
    let diagnosis = wait_for("diagnosis", || children(running.id()).first().copied());
    send(diagnosis, Signal::ABORT);
    let output = running.wait_with_output().expect("it ends");
    assert_eq!(output.status.code(), Some(1), "{}", output_text(&output));
    let rows = fleet.rows();
    let crashed: Vec<&Value> = rows.values().filter(|row| row["status"] == "failed").collect();
    assert_eq!((rows.len(), crashed.len()), (2, 1));
    assert_eq!((&crashed[0]["error_kind"], &crashed[0]["exit_code"]), (&json!("crash"), &Value::Null));
    assert!(crashed[0]["error"].as_str().is_some_and(|error| error.contains("signal 6 (SIGABRT)")), "{}", crashed[0]);
    let (code, text, summary) = fleet.run(&[]);
    assert_eq!((code, &summary["up_to_date"]), (Some(0), &json!(1)), "{text}");
}

#[test]
fn refuses_what_is_ambiguous_and_what_it_would_overwrite() {
    let fleet = Fleet::draw(&["arm-1/a", "arm-2/a"]);
    let refused = |words: &[&str]| {
        let output = fleet.rivet(words).output().expect("it starts");
        assert_eq!(output.status.code(), Some(64), "{words:?}: {}", output_text(&output));
        output_text(&output)
    };
    let log = fleet.at("logs/arm-1/a.parquet");
    let before = std::fs::read(&log).expect("there");
    let text = refused(&["--robots", "robots", "--logs", "logs/arm-2/*", "--table", "logs/arm-1/a.parquet"]);
    assert!(text.contains("is there and is no table of diagnoses"), "{text}");
    let text = refused(&["robots/arm-1/robot.toml", "logs/arm-1/a.parquet", "--table", "logs/arm-1/a.parquet"]);
    assert!(text.contains("would replace"), "{text}");
    assert_eq!(std::fs::read(&log).expect("there"), before);
    refused(&["--robots", "robots", "--table", "t.parquet"]);
    refused(&["--robots", "robots", "--logs", "logs/*/*.mcap", "--table", "t.parquet"]);
    std::fs::copy(&log, fleet.at("logs/arm-1/arm-2_x.parquet")).expect("copied");
    let text = refused(&["--robots", "robots", "--logs", "logs/*/*", "--table", "t.parquet"]);
    assert!(text.contains("logs/arm-1/arm-2_x.parquet names the robots arm-1 and arm-2"), "{text}");
    assert!(fleet.leftovers().is_empty(), "{:?}", fleet.leftovers());
    // Paths as a shell gives them for a pattern without quotes.
    let words =
        ["--robots", "robots", "--logs", "logs/arm-1/a.parquet", "logs/arm-2/a.parquet", "--table", "t.parquet"];
    let listed = fleet.rivet(&words).arg("--dry-run").output().expect("it starts");
    assert_eq!(output_text(&listed).matches("missing").count(), 2, "{}", output_text(&listed));
}

#[test]
fn a_second_command_on_the_same_table_is_refused() {
    let fleet = Fleet::draw(&["arm-1/a", "arm-1/b"]);
    let running = started(&mut fleet.command(&["--jobs", "1"]));
    wait_for("diagnosis", || children(running.id()).first().copied());
    let (code, text, _) = fleet.run(&[]);
    assert_eq!(code, Some(64), "{text}");
    assert!(text.contains("is written by another process"), "{text}");
    assert!(running.wait_with_output().expect("it ends").status.success());
    assert_eq!(fleet.rows().len(), 2);
}

/// Python blocks of the page.
fn python_blocks() -> Vec<String> {
    let page = std::fs::read_to_string(project("docs/fleet.md")).expect("read");
    page.split("```").skip(1).step_by(2).filter_map(|block| block.strip_prefix("python\n")).map(str::to_owned).collect()
}

/// Runs a Python block of the page; none, with a message, where Python lacks a module.
fn python(fleet: &Fleet, block: &str, modules: &[&str]) -> Option<String> {
    let python = || Command::new(std::env::var_os("RIVET_PYTHON").unwrap_or_else(|| "python3".into()));
    let import = format!("import {}", modules.join(", "));
    if !python().args(["-c", &import]).output().is_ok_and(|output| output.status.success()) {
        // Past the test harness, which keeps what a passing test says through the macros to itself.
        let _ = writeln!(std::io::stderr(), "SKIPPED: Python lacks one of {}", modules.join(", "));
        return None;
    }
    std::fs::write(fleet.at("block.py"), block).expect("written");
    let programs = Path::new(env!("CARGO_BIN_EXE_rivet")).parent().expect("a folder");
    let path = format!("{}:{}", programs.display(), std::env::var("PATH").unwrap_or_default());
    let mut command = python();
    command.arg("block.py").env("PATH", path).env("PYTHONDONTWRITEBYTECODE", "1").current_dir(fleet.folder.path());
    let output = command.output().expect("it starts");
    assert!(output.status.success(), "{}", output_text(&output));
    Some(String::from_utf8_lossy(&output.stdout).into_owned())
}

#[test]
fn queries_of_the_page_answer() {
    let fleet = Fleet::draw(&["arm-1/a", "arm-2/a"]);
    std::fs::write(fleet.at("logs/arm-2/bad.csv"), "t,q1\n0,none\n").expect("written");
    let words = ["--robots", "robots", "--logs", "logs/**/*", "--table", "fleet.parquet"];
    assert_eq!(fleet.rivet(&words).output().expect("it starts").status.code(), Some(1));
    let Some(text) = python(&fleet, &python_blocks()[0], &["duckdb"]) else { return };
    let rows = rows(&fleet.at("fleet.parquet"));
    let verdict = rows["logs/arm-1/a.parquet"]["verdict"].as_str().expect("a verdict");
    assert!(text.contains(&format!("{verdict}  2\n")) && text.contains("failed: data  1\n"), "{text}");
    for cause in rows["logs/arm-1/a.parquet"]["causes"].as_array().expect("causes") {
        assert!(text.contains(&format!("{}  2  ", cause["effect"].as_str().expect("an effect"))), "{text}");
    }
    assert!(text.contains("logs/arm-2/bad.csv  data  logs/arm-2/bad.csv: "), "{text}");
}

#[test]
fn tasks_of_the_page_make_the_same_rows() {
    let fleet = Fleet::draw(&["arm-1/a", "arm-2/a", "arm-2/b"]);
    let Some(text) = python(&fleet, &python_blocks()[1], &["duckdb", "dask", "distributed"]) else { return };
    assert!(text.contains("('diagnosed', 3)"), "{text}");
    let parts = std::fs::read_dir(fleet.at("parts")).expect("parts").flatten();
    let made: BTreeMap<String, Value> = parts.flat_map(|part| rows(&part.path())).collect();
    assert_eq!(fleet.run(&[]).0, Some(0));
    let timeless = |rows: BTreeMap<String, Value>| -> Vec<Value> {
        let strip = |mut row: Value| {
            row.as_object_mut()
                .expect("a row")
                .retain(|name, _| !["duration_s", "finished_at"].contains(&name.as_str()));
            row
        };
        rows.into_values().map(strip).collect()
    };
    assert_eq!(timeless(made), timeless(fleet.rows()));
}
