//! Reading: what is written comes back, CSV and Parquet agree, and every broken rule is named.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use parquet::basic::{Compression, ZstdLevel};
use parquet::data_type::DoubleType;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::parser::parse_message_type;
use rivet_logs::{ReadOptions, TorqueSource, read, read_columns, write_columns};

const ROWS: usize = 20;

/// A log of one joint in 50 rows as most programs write Parquet: with a dictionary a column, which rivet leaves out.
fn write_with_dictionaries(path: &Path) {
    let message = "message log { required double t; required double q1; required double tau1; }";
    let schema = Arc::new(parse_message_type(message).expect("a schema"));
    let properties = WriterProperties::builder().set_compression(Compression::ZSTD(ZstdLevel::default())).build();
    let file = std::fs::File::create(path).expect("created");
    let mut writer = SerializedFileWriter::new(file, schema, Arc::new(properties)).expect("a writer");
    let mut group = writer.next_row_group().expect("a group");
    let values: Vec<f64> = (0..50).map(f64::from).collect();
    while let Some(mut column) = group.next_column().expect("a column") {
        column.typed::<DoubleType>().write_batch(&values, None, None).expect("written");
        column.close().expect("closed");
    }
    group.close().expect("closed");
    writer.close().expect("closed");
}

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

/// Named columns of text cells.
type Cells = Vec<(String, Vec<String>)>;

/// Columns of a small sound log of two joints.
fn sound() -> Cells {
    let column = |name: &str, f: &dyn Fn(f64) -> f64| {
        let cells = (0..ROWS).map(|k| format!("{}", f(k as f64 * 0.01)));
        (name.to_owned(), cells.collect())
    };
    vec![
        column("t", &|t| t),
        column("q1", &|t| (3.0 * t).sin()),
        column("q2", &|t| (4.0 * t).cos()),
        column("tau1", &|t| 5.0 * t),
        column("tau2", &|t| -7.0 * t),
    ]
}

fn csv(columns: &[(String, Vec<String>)]) -> String {
    let mut text = columns.iter().map(|(n, _)| n.as_str()).collect::<Vec<_>>().join(",");
    text.push('\n');
    let rows = columns.iter().map(|(_, c)| c.len()).max().unwrap_or(0);
    for k in 0..rows {
        let cells: Vec<&str> = columns.iter().map(|(_, c)| c.get(k).map_or("", String::as_str)).collect();
        writeln!(text, "{}", cells.join(",")).expect("writing to a string");
    }
    text
}

/// The error a log gives, from the first file name on.
fn refusal(columns: &[(String, Vec<String>)], options: &ReadOptions<'_>) -> String {
    let folder = folder();
    let path = folder.path().join("run.csv");
    std::fs::write(&path, csv(columns)).expect("written");
    let text = read(&path, options).expect_err("must be refused").to_string();
    text.replace(&folder.path().display().to_string(), "").trim_start_matches('/').to_owned()
}

#[test]
fn csv_and_parquet_of_one_log_are_equal_to_the_bit() {
    let folder = folder();
    let (text, binary) = (folder.path().join("run.csv"), folder.path().join("run.parquet"));
    std::fs::write(&text, format!("# a comment\n{}", csv(&sound()))).expect("written");
    let numbers: Vec<(String, Vec<f64>)> =
        sound().into_iter().map(|(n, c)| (n, c.iter().map(|cell| cell.parse().expect("a number")).collect())).collect();
    let columns: Vec<(&str, &[f64])> = numbers.iter().map(|(n, c)| (n.as_str(), c.as_slice())).collect();
    write_columns(&binary, &columns).expect("written");
    let options = ReadOptions::new(2);
    let mut a = read(&text, &options).expect("sound");
    let b = read(&binary, &options).expect("sound");
    assert_eq!(b.q[1], numbers[2].1, "what is written comes back");
    assert_eq!(b.torque().expect("torque")[0], numbers[3].1);
    a.path = b.path.clone();
    assert_eq!(a, b);
    let left: Vec<PathBuf> =
        std::fs::read_dir(folder.path()).expect("listed").map(|e| e.expect("entry").path()).collect();
    assert_eq!(left.len(), 2, "no half-written file stays behind: {left:?}");
}

#[test]
fn current_times_gain_is_torque_and_zero_shifts_positions() {
    let mut columns = sound();
    columns[3].0 = "current1".into();
    columns[4].0 = "current2".into();
    columns.push(("q_des1".into(), columns[1].1.clone()));
    columns.push(("q_des2".into(), columns[2].1.clone()));
    columns.push(("q_link2".into(), columns[2].1.clone()));
    columns.push(("note".into(), vec!["x".into(); ROWS]));
    let folder = folder();
    let path = folder.path().join("run.csv");
    std::fs::write(&path, csv(&columns)).expect("written");
    let plain = read(&path, &ReadOptions::new(2)).expect("sound");
    let why = plain.torque().expect_err("no gain given").to_string();
    assert!(why.contains("drive_gain"), "{why}");
    let options =
        ReadOptions { drive_gain: Some(&[10.0, 20.0]), joint_zero: Some(&[0.5, -1.0]), ..ReadOptions::new(2) };
    let log = read(&path, &options).expect("sound");
    assert_eq!(log.tau.as_ref().map(|(source, _)| *source), Some(TorqueSource::Current));
    assert_eq!(log.torque().expect("torque")[1][3], 20.0 * (-7.0 * 0.03));
    assert_eq!(log.q[0][0], 0.5);
    assert_eq!(log.q_des.expect("commanded")[1][0], 0.0);
    assert_eq!((&log.q_link[0], log.q_link[1].as_ref().map(|q| q[0])), (&None, Some(0.0)));
    assert_eq!(log.unused, ["note"]);
}

#[test]
fn torque_is_taken_from_current_where_that_is_asked_for() {
    let mut columns = sound();
    columns.push(("current1".into(), vec!["0.5".into(); ROWS]));
    columns.push(("current2".into(), vec!["-2".into(); ROWS]));
    let folder = folder();
    let path = folder.path().join("both.csv");
    std::fs::write(&path, csv(&columns)).expect("written");
    let gains = ReadOptions { drive_gain: Some(&[10.0, 20.0]), ..ReadOptions::new(2) };
    let logged = read(&path, &gains).expect("sound");
    assert_eq!(logged.tau.as_ref().map(|(source, _)| *source), Some(TorqueSource::Logged));
    let current = read(&path, &ReadOptions { torque_from_current: true, ..gains }).expect("sound");
    assert_eq!(current.tau.as_ref().map(|(source, _)| *source), Some(TorqueSource::Current));
    assert_eq!(current.torque().expect("torque")[1][3], -40.0);
    columns.truncate(columns.len() - 2);
    std::fs::write(&path, csv(&columns)).expect("written");
    let why = read(&path, &ReadOptions { torque_from_current: true, ..gains }).expect_err("no currents").to_string();
    assert!(why.contains("current1..2") && why.contains("torque_from") && why.contains("both.csv"), "{why}");
}

/// Loggers write columns for sensors that are not there. One filled cell is a sensor.
#[test]
fn optional_columns_without_any_value_are_no_signal() {
    let mut columns = sound();
    for name in ["temperature1", "temperature2", "q_link2"] {
        columns.push((name.into(), vec!["NaN".into(); ROWS]));
    }
    let folder = folder();
    let path = folder.path().join("empty.csv");
    std::fs::write(&path, csv(&columns)).expect("written");
    let log = read(&path, &ReadOptions::new(2)).expect("sound");
    assert!(log.temperature.is_none() && log.q_link.iter().all(Option::is_none));
    let mut unused = log.unused.clone();
    unused.sort();
    assert_eq!(unused, ["q_link2", "temperature1", "temperature2"]);
    columns[5].1[3] = "20".into();
    assert!(refusal(&columns, &ReadOptions::new(2)).contains("column temperature1, row 1"));
    // What a log must have is refused.
    let mut columns = sound();
    columns[3].1.fill("NaN".into());
    columns[4].1.fill("NaN".into());
    assert!(refusal(&columns, &ReadOptions::new(2)).contains("column tau1, row 1"));
}

/// A few damaged rows are a gap; a log that is damaged in more than a tenth of its rows is refused with the first cell.
#[test]
fn rows_that_are_not_finite_are_left_out() {
    let folder = folder();
    let path = folder.path().join("damaged.csv");
    let row = |k: usize, every: usize| match k % every {
        7 => format!("{},nan,1\n", 0.01 * k as f64),
        9 => ",,\n".to_owned(),
        _ => format!("{},{},1\n", 0.01 * k as f64, k),
    };
    let written = |every: usize| {
        let rows: String = (0..200).map(|k| row(k, every)).collect();
        std::fs::write(&path, format!("t,q1,tau1\n{rows}")).expect("written");
        read(&path, &ReadOptions::new(1))
    };
    let log = written(100).expect("four damaged rows");
    assert_eq!(log.len(), 196);
    assert!(!log.q[0].contains(&7.0) && log.q[0].contains(&8.0) && log.q[0].iter().all(|q| q.is_finite()));
    assert_eq!(log.damaged_t, [0.07, 1.07]);
    assert!(
        log.notes.iter().any(|note| note.contains("4 of 200 rows") && note.contains("column q1, row 8")),
        "{:?}",
        log.notes
    );
    let why = written(10).expect_err("a fifth of the rows").to_string();
    assert!(why.contains("column t, row 10"), "{why}");
}

#[test]
fn every_broken_rule_names_column_row_value_and_rule() {
    let two = ReadOptions::new(2);
    let change = |f: &dyn Fn(&mut Cells)| {
        let mut columns = sound();
        f(&mut columns);
        columns
    };
    let cases: Vec<(Cells, ReadOptions<'_>, &str)> = vec![
        (
            change(&|c| drop(c.remove(0))),
            two,
            "run.csv: column t is missing; a log has t [s] and q1..N [rad]. Of its 4 columns tau1 tau2 look like torques; q1 q2 look \
             like positions",
        ),
        (
            change(&|c| drop(c.remove(2))),
            two,
            "run.csv: column q2 is missing; q1 is there, and a group of columns has all 2 joints",
        ),
        (
            change(&|c| {
                c.remove(1);
                c.remove(1);
            }),
            two,
            "run.csv: column q1 is missing; a log of this robot has q1..2 [rad]. Of its 3 columns t looks like time; tau1 tau2 look \
             like torques",
        ),
        (
            sound(),
            ReadOptions::new(1),
            "run.csv: column q2 belongs to a joint the robot does not have: it has 1 joints",
        ),
        (
            sound(),
            ReadOptions::new(3),
            "run.csv: column q3 is missing; q1 is there, and a group of columns has all 3 joints",
        ),
        (
            change(&|c| c[2].1[4..].fill("-1e13".to_owned())),
            two,
            "run.csv: column q2, row 5: -1e13; no value may be beyond 1e12 (s, rad, N m, A)",
        ),
        (
            change(&|c| c[4].1[6] = "0,5".replace(',', ";")),
            two,
            "run.csv: column tau2, row 7: '0;5' is not a number; every value must be a finite number",
        ),
        (
            change(&|c| c[1].1[2..].fill(String::new())),
            two,
            "run.csv: column q1, row 3: the cell is empty or not a number (null, NaN); \
             every value must be a finite number",
        ),
        (
            change(&|c| c[1].1[2..].fill("inf".into())),
            two,
            "run.csv: column q1, row 3: inf; every value must be a finite number",
        ),
        (
            change(&|c| c[0].1[5] = "0.04".into()),
            two,
            "run.csv: column t, row 6: 0.04 s after 0.04 s; time must increase from row to row, by a nanosecond at least",
        ),
        (
            change(&|c| c[0].1[5] = "0.01".into()),
            two,
            "run.csv: column t, row 6: 0.01 s after 0.04 s; time must increase from row to row, by a nanosecond at least",
        ),
        (
            change(&|c| c.iter_mut().for_each(|c| c.1.truncate(4))),
            two,
            "run.csv: 4 rows; at least 10 are needed in a log",
        ),
        (change(&|c| c[3].0 = "q1".into()), two, "run.csv: column q1 appears twice; a column has one name"),
        (
            sound(),
            ReadOptions { joint_zero: Some(&[0.0]), ..two },
            "run.csv: joint_zero has 1 values, the robot has 2 joints",
        ),
    ];
    for (columns, options, expected) in cases {
        assert_eq!(refusal(&columns, &options), expected);
    }
    let without_torque = change(&|c| c.truncate(3));
    let folder = folder();
    let path = folder.path().join("run.csv");
    std::fs::write(&path, csv(&without_torque)).expect("written");
    let log = read(&path, &two).expect("a log to predict needs no torque");
    let why = log.torque().expect_err("no torque").to_string();
    assert!(why.ends_with("has neither tau1..2 nor current1..2; without torque nothing can be identified"), "{why}");
}

#[test]
fn unequal_lines_and_foreign_files_are_refused() {
    let folder = folder();
    let short = folder.path().join("short.csv");
    std::fs::write(&short, "t,q1\n0,1\n1\n").expect("written");
    let why = read(&short, &ReadOptions::new(1)).expect_err("unequal").to_string();
    assert!(why.contains("cannot be read as CSV") && why.contains("line: 3"), "{why}");
    let odd = folder.path().join("odd.parquet");
    std::fs::write(&odd, b"PAR1 but nothing behind it").expect("written");
    let why = read(&odd, &ReadOptions::new(1)).expect_err("damaged").to_string();
    assert!(why.contains("cannot be read as Parquet"), "{why}");
    std::fs::write(&odd, b"").expect("written");
    let why = read(&odd, &ReadOptions::new(1)).expect_err("empty").to_string();
    assert!(why.ends_with("odd.parquet: is empty: 0 bytes; record it again, or give another file"), "{why}");
    std::fs::write(&odd, b"XAR1 and so on").expect("written");
    let why = read(&odd, &ReadOptions::new(1)).expect_err("damaged").to_string();
    assert!(why.contains("cannot be read as Parquet: it does not begin with PAR1"), "{why}");
    let rows = (0..12).map(|k| format!("{k},1,2\n")).collect::<Vec<_>>().concat();
    std::fs::write(&short, format!("__time,arm/a/position,arm/a/effort\n{rows}")).expect("written");
    let why = read(&short, &ReadOptions::new(1)).expect_err("other names").to_string();
    assert!(
        why.contains("arm/a/position looks like positions (name it q1..N)")
            && why.contains("arm/a/effort looks like torques"),
        "{why}"
    );
    std::fs::write(&odd, [0_u8, 1, 2, 3]).expect("written");
    let why = read(&odd, &ReadOptions::new(1)).expect_err("binary").to_string();
    assert!(why.contains("binary data of no known format, not a recording"), "{why}");
    let none = folder.path().join("none.csv");
    assert!(read(&none, &ReadOptions::new(1)).expect_err("absent").to_string().contains("none.csv"));
    let short = write_columns(&none, &[("t", &[0.0, 1.0][..]), ("q1", &[0.0][..])]);
    assert!(short.expect_err("unequal").to_string().contains("column q1 has 1 rows"));
    assert!(!none.exists());
    let full = std::path::Path::new("/dev/full");
    if full.exists() {
        let why = write_columns(full, &[("t", &[0.0, 1.0][..])]).expect_err("full");
        assert!(matches!(why.fault, rivet_logs::LogFault::Io(_)), "{why}");
    }
}

#[test]
fn columns_of_any_name_are_read_back() {
    let folder = folder();
    let path = folder.path().join("prediction.parquet");
    write_columns(&path, &[("t", &[0.0, 0.1][..]), ("tau_pred1", &[1.0, -2.0][..])]).expect("written");
    let columns = read_columns(&path, &["tau_pred1", "t"]).expect("there");
    assert_eq!(columns, [[1.0, -2.0], [0.0, 0.1]]);
    let why = read_columns(&path, &["t", "tau_pred2"]).expect_err("absent").to_string();
    assert!(why.ends_with("column tau_pred2 is missing; t, tau_pred2 are asked for"), "{why}");
}

/// The measured logs other people made; read in place, never copied.
#[test]
fn every_measured_log_reads() {
    let real = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/real");
    if !real.is_dir() {
        // Past the test harness, which keeps what a passing test says through the macros to itself.
        let _ = writeln!(std::io::stderr(), "SKIPPED: {} is not there", real.display());
        return;
    }
    let joints = [
        ("airbot_play", 6),
        ("bam_xl330", 1),
        ("kinova_gen3", 7),
        ("kuka_kr300", 6),
        ("shanghai_electric_6dof", 6),
        ("so101_sage", 6),
        ("staubli_tx40", 6),
        ("ur10_salerno", 6),
        ("ur10e_innopolis", 6),
    ];
    let mut runs = 0;
    for (robot, joints) in joints {
        for entry in std::fs::read_dir(real.join(robot)).expect("listed") {
            let path = entry.expect("entry").path();
            if path.extension().is_some_and(|e| e == "parquet") {
                let log = read(&path, &ReadOptions::new(joints));
                let log = log.unwrap_or_else(|why| panic!("{why}"));
                let (uniform, report) = log.resample(0.01).unwrap_or_else(|why| panic!("{why}"));
                println!("{robot} {}: {report}", path.file_name().expect("name").display());
                assert!(uniform.q.iter().flatten().all(|q| q.is_finite()));
                runs += 1;
            }
        }
    }
    assert!(runs > 70, "{runs} runs");
}

/// Logs of the practice arms; read in place, never copied.
#[test]
fn every_practice_log_reads() {
    let practice = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/practice");
    let Ok(cases) = std::fs::read_dir(&practice) else {
        let _ = writeln!(std::io::stderr(), "SKIPPED: {} is not there", practice.display());
        return;
    };
    let mut logs = 0;
    for case in cases.map(|case| case.expect("entry").path()).filter(|case| case.is_dir()) {
        for path in std::fs::read_dir(case).expect("listed").map(|entry| entry.expect("entry").path()) {
            let name = path.file_name().expect("name").to_string_lossy();
            if name.starts_with("log-") && name.ends_with(".parquet") {
                // How many joints the arm has is not told by the log.
                let log = (1..8).find_map(|joints| read(&path, &ReadOptions::new(joints)).ok());
                let log = log.map_or_else(|| read(&path, &ReadOptions::new(8)), Ok);
                log.unwrap_or_else(|why| panic!("{why}"));
                logs += 1;
            }
        }
    }
    assert!(logs > 0);
}

/// Found by the search over hostile files: offsets before the beginning of the file, pages that are not what they say.
#[test]
fn damaged_parquet_is_an_error_and_no_panic() {
    let folder = folder();
    let path = folder.path().join("log.parquet");
    let column: Vec<f64> = (0..50).map(f64::from).collect();
    let own = |path: &Path| {
        write_columns(path, &[("t", &column), ("q1", &column), ("tau1", &column)]).expect("written");
    };
    for write in [&own as &dyn Fn(&Path), &write_with_dictionaries] {
        write(&path);
        let whole = std::fs::read(&path).expect("read");
        for at in 4..whole.len() {
            for change in [0x01, 0x80] {
                let mut bytes = whole.clone();
                bytes[at] ^= change;
                std::fs::write(&path, &bytes).expect("written");
                // Either the damage does not matter to the columns that are read, or it is an error.
                if let Err(why) = read(&path, &ReadOptions::new(1)) {
                    assert!(why.to_string().contains("log.parquet"), "{at}: {why}");
                }
            }
        }
    }
}

/// Found by the same: a few bytes that claim more values than any memory holds.
#[test]
fn parquet_that_claims_more_than_it_has_is_refused_before_memory_is_set_aside() {
    let folder = folder();
    let path = folder.path().join("log.parquet");
    write_with_dictionaries(&path);
    let whole = std::fs::read(&path).expect("read");
    // The header of the first dictionary, in Thrift's compact form: 50 values (field 1), their encoding (field 2).
    let header = [0x15, 0x64, 0x15];
    let at = whole.windows(3).position(|bytes| bytes == header).expect("a dictionary");
    let mut bytes = whole.clone();
    bytes.splice(at + 1..at + 2, [0xfe, 0xff, 0xff, 0xff, 0x07]);
    std::fs::write(&path, &bytes).expect("written");
    let why = read(&path, &ReadOptions::new(1)).expect_err("1073741823 values").to_string();
    assert!(why.contains("a page claims 1073741823 values; the column has 50"), "{why}");
    // The number of rows of the only group stands in the footer, and at its end that of the file: 50 in eight bytes' type.
    let at = whole.windows(2).enumerate().filter(|(_, bytes)| *bytes == [0x16, 0x64]).map(|(at, _)| at);
    let refused = at.filter(|at| {
        let mut bytes = whole.clone();
        let footer = bytes.len() - 8;
        let length = u32::from_le_bytes([bytes[footer], bytes[footer + 1], bytes[footer + 2], bytes[footer + 3]]) + 5;
        bytes[footer..footer + 4].copy_from_slice(&length.to_le_bytes());
        bytes.splice(at + 1..at + 2, [0x80, 0x80, 0x80, 0x80, 0x80, 0x01]);
        std::fs::write(&path, &bytes).expect("written");
        let why = read(&path, &ReadOptions::new(1)).err().map(|why| why.to_string());
        why.is_some_and(|why| why.contains("it claims 51539607552 cells and has"))
    });
    assert!(refused.count() > 0, "no field is the rows of the group");
}
