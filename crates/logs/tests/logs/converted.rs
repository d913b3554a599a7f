//! What rivet writes: every format is read back to the same numbers, and its conventions are not applied a second time.

use std::path::Path;

use rivet_logs::{ChannelMap, Log, Naming, ReadOptions, TorqueSource, check_ending, read, read_as, write_log};

use crate::formats::{joints, shared};

/// A short log with every signal that there is.
fn full() -> Log {
    let signal = |k: u32, joint: u32| (f64::from(k) / 7.0).sin() * f64::from(joint + 1) + 1.0 / 3.0;
    let signals = || Some((0..2).map(|joint| (0..50).map(|k| signal(k, joint)).collect()).collect::<Vec<Vec<f64>>>());
    let t: Vec<f64> = (0..50).map(|k| 5.0 + 0.004 * f64::from(k)).collect();
    let q = signals().expect("some");
    let file = tempfile::tempdir().expect("a folder");
    let path = file.path().join("log.parquet");
    rivet_logs::write_columns(&path, &[("t", &t), ("q1", &q[0]), ("q2", &q[1])]).expect("written");
    Log {
        tau: signals().map(|tau| (TorqueSource::Logged, tau)),
        qd: signals(),
        q_des: signals(),
        qd_des: signals(),
        qdd_des: signals(),
        temperature: signals(),
        current: signals(),
        q_link: vec![None, Some(q[0].clone())],
        ..read(&path, &ReadOptions::new(2)).expect("a log")
    }
}

fn names() -> Vec<String> {
    ["shoulder", "elbow"].map(str::to_owned).to_vec()
}

fn assert_equal(found: &Log, written: &Log, what: &str) {
    for (k, (a, b)) in found.t.iter().zip(&written.t).enumerate() {
        assert!(((a - found.t[0]) - (b - written.t[0])).abs() <= 1e-12, "{what}: t row {k}");
    }
    let same = Log {
        path: written.path.clone(),
        notes: Vec::new(),
        unused: Vec::new(),
        t: written.t.clone(),
        ..found.clone()
    };
    assert_eq!(same, Log { notes: Vec::new(), unused: Vec::new(), ..written.clone() }, "{what}");
}

#[test]
fn tables_keep_every_signal_to_the_bit_and_mcap_names_what_it_cannot_hold() {
    let (log, folder) = (full(), tempfile::tempdir().expect("a folder"));
    for ending in ["parquet", "csv", "npz", "h5"] {
        let path = folder.path().join("log").with_extension(ending);
        assert!(write_log(&path, &log, &names()).expect("written").is_empty());
        let found = read(&path, &ReadOptions::new(2)).expect("read");
        assert_equal(&found, &log, ending);
        assert_eq!(found.t, log.t, "{ending}");
    }
    let path = folder.path().join("log.MCAP");
    let left_out = write_log(&path, &log, &names()).expect("written");
    assert_eq!(left_out, ["current1..2", "temperature1..2", "q_link1..2", "qdd_des1..2"]);
    let nothing = ChannelMap::default();
    let found = read_as(&path, &ReadOptions::new(2), &Naming { joints: &names(), map: &nothing }).expect("read");
    let held = Log { current: None, temperature: None, qdd_des: None, q_link: vec![None, None], ..log };
    assert_equal(&found, &held, "MCAP");
}

#[test]
fn what_was_written_in_the_models_conventions_is_not_turned_a_second_time() {
    let (log, folder) = (full(), tempfile::tempdir().expect("a folder"));
    let mut map = ChannelMap::default();
    map.entry("q").expect("a key").sign = Some(vec![-1.0, 1.0]);
    map.entry("tau").expect("a key").scale = Some(vec![2.0, 2.0]);
    map.entry("tau").expect("a key").pattern = Some("effort/{joint}".to_owned());
    let options = ReadOptions {
        joint_zero: Some(&[0.5, 0.5]),
        torque_from_current: true,
        drive_gain: Some(&[9.0, 9.0]),
        joints: 2,
    };
    for ending in ["parquet", "csv", "npz", "h5", "mcap"] {
        let path = folder.path().join("log").with_extension(ending);
        write_log(&path, &log, &names()).expect("written");
        let found = read_as(&path, &options, &Naming { joints: &names(), map: &map }).expect("read");
        assert_eq!((&found.q, &found.tau, &found.q_des), (&log.q, &log.tau, &log.q_des), "{ending}");
        assert!(found.notes.iter().any(|note| note.contains("is not applied")), "{ending}: {:?}", found.notes);
    }
    // Another program's file of the same columns is read as the robot file states.
    let columns = log.columns();
    let path = folder.path().join("other.parquet");
    rivet_logs::write_columns(&path, &columns).expect("written");
    let found = read_as(&path, &options, &Naming { joints: &names(), map: &map }).expect("read");
    assert_eq!(found.q[0][3], 0.5 - log.q[0][3]);
}

#[test]
fn an_unknown_ending_is_refused_with_those_that_are_known() {
    for name in ["log", "log.txt", "log.bag"] {
        let why = write_log(Path::new(name), &full(), &names()).expect_err("refused").to_string();
        assert!(why.contains(name) && why.contains(".parquet, .csv, .npz, .h5, .mcap"), "{why}");
        assert!(check_ending(Path::new(name)).is_err());
    }
}

#[test]
fn every_measured_run_survives_each_format() {
    let Some(real) = shared("real") else { return };
    let mut found = 0;
    let sets = std::fs::read_dir(real).expect("listed").flatten().filter(|set| set.path().is_dir());
    for set in sets {
        let files = std::fs::read_dir(set.path()).expect("listed").flatten().map(|file| file.path());
        // One run a set: the others differ in their motion alone.
        let mut runs: Vec<_> = files.filter(|file| file.extension().is_some_and(|ext| ext == "parquet")).collect();
        runs.sort();
        let Some((path, log)) = runs.iter().find_map(|path| {
            let joints = (1..=8).find(|joints| read(path, &ReadOptions::new(*joints)).is_ok())?;
            Some((path, read(path, &ReadOptions::new(joints)).expect("read")))
        }) else {
            continue;
        };
        found += 1;
        let names = joints().into_iter().chain(["eighth".to_owned()]).take(log.joints()).collect::<Vec<_>>();
        let folder = tempfile::tempdir().expect("a folder");
        for ending in ["parquet", "csv", "npz", "h5", "mcap"] {
            let to = folder.path().join("run").with_extension(ending);
            write_log(&to, &log, &names).expect("written");
            let naming = Naming { joints: &names, map: &ChannelMap::default() };
            let again = read_as(&to, &ReadOptions::new(log.joints()), &naming).unwrap_or_else(|why| panic!("{why}"));
            let what = format!("{} as {ending}", path.display());
            assert_eq!(again.len(), log.len(), "{what}");
            assert_eq!((&again.q, &again.tau, &again.qd), (&log.q, &log.tau, &log.qd), "{what}");
            // Stamps of MCAP are whole nanoseconds.
            let off = |k: usize| ((again.t[k] - again.t[0]) - (log.t[k] - log.t[0])).abs();
            assert!((0..log.len()).all(|k| off(k) <= if ending == "mcap" { 1.1e-9 } else { 0.0 }), "{what}");
        }
    }
    assert!(found >= 5, "{found} measured sets");
}

/// The ending of a table's name decides its format; one of another format is refused before anything is written.
#[test]
fn tables_are_written_in_the_format_of_their_name() {
    let folder = tempfile::tempdir().expect("a folder");
    let (t, x) = ([0.0, 0.5, 1.0], [0.1, f64::MIN_POSITIVE, -1.0 / 3.0]);
    for name in ["table.csv", "table.CSV", "table.parquet", "table"] {
        let path = folder.path().join(name);
        rivet_logs::write_table(&path, &[("t", &t[..]), ("tau_pred1", &x[..])]).expect("written");
        let read = rivet_logs::read_columns(&path, &["t", "tau_pred1"]).expect("read");
        assert_eq!(read, [t.to_vec(), x.to_vec()], "{name}");
        let is_text = std::fs::read(&path).expect("bytes").starts_with(b"t,tau_pred1\n");
        assert_eq!(is_text, name.to_lowercase().ends_with("csv"), "{name}");
    }
    let path = folder.path().join("table.mat");
    let why = rivet_logs::write_table(&path, &[("t", &t[..])]).expect_err("no table").to_string();
    assert!(why.contains(".parquet, .csv"), "{why}");
    assert!(!path.exists());
}
