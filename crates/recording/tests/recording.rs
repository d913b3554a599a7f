//! A recording is read back as a log, by rivet's reader and by the library's own, also where it breaks off.

use std::f64::consts::PI;
use std::path::Path;

use rivet_ipc_schema::{Health, JointState, Message as _, Parameters, Setpoint};
use rivet_logs::{Log, ReadOptions, read};
use rivet_recording::{About, Content, Received, Recorder, RecordingError, RecordingFile};

/// Period of the samples \[ns\].
const PERIOD_NS: u64 = 1_000_000;
const FIRST_NS: u64 = 77_000_000_000;

fn about() -> About {
    About {
        robot: "two".to_owned(),
        joints: vec!["shoulder".to_owned(), "elbow".to_owned()],
        parameters: vec!["inertia 1".to_owned()],
        to_utc_ns: 1_790_000_000_000_000_000,
        ..About::default()
    }
}

/// Position that no decimal number of few digits has.
fn position(seq: u64, joint: usize) -> f64 {
    (seq as f64 / PI).sin() * (1.0 + joint as f64)
}

/// The messages of one period, as they come from the bus.
fn period(seq: u64) -> Vec<Received> {
    let stamp_ns = FIRST_NS + seq * PERIOD_NS;
    let mut state = JointState { seq, stamp_ns, joints: 2, ..JointState::EMPTY };
    let mut plan = Setpoint { seq, stamp_ns, joints: 2, ..Setpoint::EMPTY };
    for joint in 0..2 {
        state.q[joint] = position(seq, joint);
        state.tau[joint] = 10.0 * position(seq + 1, joint);
        plan.q[joint] = position(seq + 2, joint);
        plan.qd[joint] = position(seq + 3, joint);
        plan.qdd[joint] = position(seq + 4, joint);
    }
    let mut messages = vec![Content::Setpoint(Box::new(plan)), Content::JointState(Box::new(state))];
    if seq.is_multiple_of(100) {
        let set = Parameters { epoch: seq / 100, stamp_ns, count: 1, joints: 2, ..Parameters::EMPTY };
        messages.push(Content::Parameters(Box::new(set)));
        messages.push(Content::Health(Box::new(Health { stamp_ns, ..Health::EMPTY })));
    }
    messages.into_iter().map(|content| Received { at_ns: stamp_ns + 250_000, publisher: Some(1), content }).collect()
}

/// Every value of a row of the log, to the bit.
fn assert_row(log: &Log, row: usize, seq: u64) {
    let signals = [(&log.q, 0, 1.0), (&log.tau.as_ref().expect("torque").1, 1, 10.0)];
    let plans = [(&log.q_des, 2), (&log.qd_des, 3), (&log.qdd_des, 4)];
    let plans = plans.map(|(signal, ahead)| (signal.as_ref().expect("a plan"), ahead, 1.0));
    for (signal, ahead, factor) in signals.into_iter().chain(plans) {
        for joint in 0..2 {
            assert_eq!(signal[joint][row], factor * position(seq + ahead, joint), "row {row} joint {joint}");
        }
    }
}

#[test]
fn a_recording_is_read_back_to_the_bit() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.mcap");
    let mut recorder = Recorder::start(RecordingFile::create(&path, &about()).expect("made"));
    // Number 40 never comes.
    for seq in (1..=500).filter(|seq| *seq != 40) {
        for received in period(seq) {
            recorder.take(received);
        }
    }
    let counts = recorder.counts(FIRST_NS, 3);
    let states = counts.of_service("joint-state").expect("counted");
    assert_eq!((states.messages, states.missing, states.dropped), (499, 1, 0));
    recorder.finish(counts).expect("written");

    let log = read(&path, &ReadOptions::new(2)).expect("a log");
    assert_eq!(log.len(), 499);
    for (row, seq) in (1..=500).filter(|seq| *seq != 40).enumerate() {
        assert_row(&log, row, seq);
        assert!((log.t[row] - (seq - 1) as f64 * 1e-3).abs() < 1e-12);
    }
    // What the file was recorded with is the model's: nothing is added to its positions.
    let options = ReadOptions { joint_zero: Some(&[0.5, 0.25]), torque_from_current: true, ..ReadOptions::new(2) };
    assert_eq!(read(&path, &options).expect("a log").q, log.q);

    let summary = summary_of(&path);
    let mut topics: Vec<(String, u64)> = summary;
    topics.sort();
    let named = |name: &str, count| (format!("rivet/two/{name}"), count);
    let expected = [("health", 5), ("joint-state", 499), ("parameters", 5), ("recorder", 1), ("setpoint", 499)]
        .map(|(n, c)| named(n, c));
    assert_eq!(topics, expected);
}

/// Topics and their messages, by the library's own reader; every message must be JSON.
fn summary_of(path: &Path) -> Vec<(String, u64)> {
    let bytes = std::fs::read(path).expect("read");
    let mut counts = std::collections::BTreeMap::new();
    for message in mcap::MessageStream::new(&bytes).expect("MCAP") {
        let Ok(message) = message else { break };
        let schema = message.channel.schema.as_ref().expect("a schema");
        assert_eq!((schema.encoding.as_str(), message.channel.message_encoding.as_str()), ("jsonschema", "json"));
        serde_json::from_slice::<serde_json::Value>(&schema.data).expect("a schema in JSON");
        serde_json::from_slice::<serde_json::Value>(&message.data).expect("JSON");
        *counts.entry(message.channel.topic.clone()).or_insert(0) += 1;
    }
    counts.into_iter().collect()
}

/// A robot begins with its brakes closed: its first samples have a fault bit.
#[test]
fn a_recording_that_begins_before_the_robot_is_released_is_read() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.mcap");
    let mut file = RecordingFile::create(&path, &about()).expect("made");
    for mut received in (1..=400).flat_map(period) {
        if let Content::JointState(state) = &mut received.content
            && state.seq <= 200
        {
            state.faults = 4;
        }
        file.write(&received).expect("written");
    }
    file.finish().expect("written");
    let log = read(&path, &ReadOptions::new(2)).expect("a log");
    assert_eq!(log.len(), 200);
    (0..200).for_each(|row| assert_row(&log, row, row as u64 + 201));
    assert!(log.notes.iter().any(|note| note.starts_with("200 joint states have a fault bit")), "{:?}", log.notes);
}

#[test]
fn what_was_ended_is_read_wherever_the_file_breaks_off() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.mcap");
    let mut file = RecordingFile::create(&path, &about()).expect("made");
    let write = |file: &mut RecordingFile, from: u64| {
        for received in (from..from + 100).flat_map(period) {
            file.write(&received).expect("written");
        }
        file.end_chunk().expect("written");
        std::fs::metadata(&path).expect("there").len()
    };
    let first = write(&mut file, 1);
    let second = write(&mut file, 101);
    // The process ends here: nothing is finished.
    std::mem::forget(file);
    let bytes = std::fs::read(&path).expect("read");
    assert_eq!(bytes.len() as u64, second);
    // Behind a chunk stands its index, which nobody needs.
    for (length, rows) in [(first, 100), (first + 1, 100), (first + 500, 100), (second - 1, 200), (second, 200)] {
        let cut = folder.path().join("cut.mcap");
        std::fs::write(&cut, &bytes[..length as usize]).expect("written");
        let log = read(&cut, &ReadOptions::new(2)).expect("a log");
        assert_eq!(log.len(), rows, "{length} bytes");
        assert!(log.notes.iter().any(|note| note.contains("breaks off")), "{:?}", log.notes);
        assert_row(&log, rows - 1, rows as u64);
        let states = summary_of(&cut).into_iter().find(|(name, _)| name.ends_with("joint-state"));
        assert!(states.is_some_and(|(_, count)| count >= rows as u64), "{length} bytes");
    }
}

#[test]
fn a_file_that_is_there_is_not_replaced() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.mcap");
    std::fs::write(&path, "mine").expect("written");
    let why = RecordingFile::create(&path, &about()).err().expect("refused");
    assert!(matches!(why, RecordingError::Exists { .. }) && why.to_string().contains("give another name"), "{why}");
    assert_eq!(std::fs::read(&path).expect("read"), b"mine");
}

#[test]
fn messages_that_find_no_room_are_counted_and_all_others_are_in_the_file() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.mcap");
    let mut recorder = Recorder::start(RecordingFile::create(&path, &about()).expect("made"));
    let mut taken = 0;
    for received in (1..=20_000).flat_map(period) {
        recorder.take(received);
        taken += 1;
    }
    let counts = recorder.counts(FIRST_NS, 0);
    let all: u64 = counts.services.iter().map(|counts| counts.messages + counts.dropped).sum();
    assert_eq!(all, taken);
    recorder.finish(counts.clone()).expect("written");
    for (topic, messages) in summary_of(&path).into_iter().filter(|(topic, _)| !topic.ends_with("recorder")) {
        let name = topic.trim_start_matches("rivet/two/");
        assert_eq!(counts.of_service(name).map(|counts| counts.messages), Some(messages), "{topic}");
    }
}
