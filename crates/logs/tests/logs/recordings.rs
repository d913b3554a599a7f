//! One measured set in the formats of other programs: what is read back is what was measured.

use std::path::Path;

use parquet::basic::{BrotliLevel, Compression, GzipLevel, ZstdLevel};
use rivet_logs::{ChannelMap, Log, LogError, Naming, ReadOptions, list, read_as};

use crate::formats::{
    Chunks, alphabetical, assert_same, assert_same_rows, joint_state, joints, lists, mcap, measured, table,
    write_parquet,
};

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

fn read_named(path: &Path) -> Result<Log, LogError> {
    read_mapped(path, &ChannelMap::default())
}

fn read_mapped(path: &Path, map: &ChannelMap) -> Result<Log, LogError> {
    read_as(path, &ReadOptions::new(7), &Naming { joints: &joints(), map })
}

fn sound(path: &Path) -> Log {
    read_named(path).unwrap_or_else(|why| panic!("{why}"))
}

#[test]
fn mcap_of_each_compression_gives_the_measured_numbers() {
    let Some(measured) = measured() else { return };
    let folder = folder();
    for chunks in [Chunks::None, Chunks::Zstd, Chunks::Lz4] {
        let path = folder.path().join("run.mcap");
        std::fs::write(&path, mcap(&measured, 0..measured.len(), chunks)).expect("written");
        let log = sound(&path);
        assert_same(&format!("{chunks:?}"), &log, &measured);
        let note = log.notes.join("; ");
        assert!(note.contains("/joint_states/{joint}/position") && note.contains("header/stamp"), "{note}");
        let listing = list(&path).expect("listed");
        let topic = |name: &str| listing.topics.iter().find(|topic| topic.name == name).expect("listed");
        assert!(topic("/joint_states").is_read && !topic("/words").is_read, "{chunks:?}");
        assert_eq!(topic("/joint_states").messages, Some(measured.len() as u64));
        assert!(listing.columns.iter().any(|c| c.name == "/joint_states/gripper/position"));
    }
}

/// A topic, its messages as (time of measurement, bytes).
type Messages<'a> = (&'a str, Vec<(u64, Vec<u8>)>);

/// Joint states of several topics in the order of their times.
fn topics(topics: &[Messages<'_>]) -> Vec<u8> {
    let mut writer =
        mcap::WriteOptions::new().compression(None).create(std::io::Cursor::new(Vec::new())).expect("a writer");
    let schema = writer.add_schema("sensor_msgs/msg/JointState", "ros2msg", b"...").expect("a schema");
    let mut all: Vec<(u64, u16, &[u8])> = Vec::new();
    for (topic, messages) in topics {
        let id = writer.add_channel(schema, topic, "cdr", &std::collections::BTreeMap::new()).expect("a channel");
        all.extend(messages.iter().map(|(time, bytes)| (*time, id, bytes.as_slice())));
    }
    all.sort_by_key(|(time, ..)| *time);
    for (time, channel_id, bytes) in all {
        let header = mcap::records::MessageHeader { channel_id, sequence: 0, log_time: time, publish_time: time };
        writer.write_to_known_channel(&header, bytes).expect("written");
    }
    writer.finish().expect("finished");
    writer.into_inner().into_inner()
}

const START_NS: u64 = 1_700_000_000_000_000_000;

#[test]
fn torque_of_another_topic_is_interpolated_to_the_times_of_the_positions() {
    let folder = folder();
    let path = folder.path().join("two.mcap");
    let time = |k: u64, shift: u64| START_NS + k * 10_000_000 + shift;
    let names = joints();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    // Positions and torques are straight in time, so that interpolation is exact; both topics see 10 ns a unit.
    let row = |k: u64, shift: u64| [((k * 10_000_000 + shift) as f64) * 1e-9; 7];
    let q = (0..50).map(|k| (time(k, 0), joint_state(time(k, 0), &names, [&row(k, 0), &[], &[]])));
    let tau =
        (0..50).map(|k| (time(k, 3_000_000), joint_state(time(k, 3_000_000), &names, [&[], &[], &row(k, 3_000_000)])));
    std::fs::write(&path, topics(&[("/q", q.collect()), ("/tau", tau.collect())])).expect("written");
    let log = sound(&path);
    // The first row is before the first torque.
    assert_eq!(log.len(), 49);
    for k in 0..log.len() {
        assert!((log.q[2][k] - log.t[k]).abs() < 1e-9 && (log.torque().expect("torque")[4][k] - log.t[k]).abs() < 1e-9);
    }
    assert!(
        log.notes.iter().any(|note| note.contains("/tau is interpolated linearly to the times of /q")),
        "{:?}",
        log.notes
    );
}

#[test]
fn other_publishers_of_a_topic_and_repeated_messages_are_left_out() {
    let folder = folder();
    let path = folder.path().join("many.mcap");
    let names = joints();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let time = |k: u64| START_NS + k * 10_000_000;
    let mut messages: Vec<(u64, Vec<u8>)> = Vec::new();
    for k in 0..40 {
        let values = [k as f64; 7];
        messages.push((time(k), joint_state(time(k), &names, [&values, &[], &values])));
        // A gripper of its own, half an arm, and the same message once more.
        messages.push((time(k) + 1000, joint_state(time(k) + 1000, &["gripper"], [&[0.1], &[], &[0.0]])));
        if k % 10 == 0 {
            messages
                .push((time(k) + 2000, joint_state(time(k) + 2000, &names[..3], [&values[..3], &[], &values[..3]])));
            messages.push((time(k) + 3000, joint_state(time(k), &names, [&values, &[], &values])));
        }
    }
    std::fs::write(&path, topics(&[("/joint_states", messages)])).expect("written");
    let log = sound(&path);
    assert_eq!(log.len(), 40);
    let notes = log.notes.join("; ");
    assert!(
        notes.contains("4 messages lack a joint") && notes.contains("4 messages have the time of another"),
        "{notes}"
    );
}

#[test]
fn mcap_that_breaks_off_is_read_up_to_there() {
    let Some(measured) = measured() else { return };
    let folder = folder();
    let path = folder.path().join("cut.mcap");
    for chunks in [Chunks::None, Chunks::Zstd, Chunks::Lz4] {
        let whole = mcap(&measured, 0..measured.len(), chunks);
        let mut last = usize::MAX;
        for tenth in [9, 6, 3] {
            std::fs::write(&path, &whole[..whole.len() * tenth / 10]).expect("written");
            let log = sound(&path);
            assert!(log.len() > 100 && log.len() < last, "{chunks:?} {tenth}: {} rows", log.len());
            last = log.len();
            assert_same_rows(&format!("{chunks:?} {tenth}"), &log, &measured, log.len());
            assert!(log.notes.iter().any(|note| note.contains("it breaks off behind")), "{:?}", log.notes);
        }
    }
    std::fs::write(&path, &mcap(&measured, 0..10, Chunks::Zstd)[..40]).expect("written");
    let why = read_named(&path).expect_err("nothing is there").to_string();
    assert!(why.contains("cannot be read as MCAP") && why.contains("no message is whole"), "{why}");
}

#[test]
fn damaged_chunk_is_left_out_and_reported() {
    let Some(measured) = measured() else { return };
    let folder = folder();
    let path = folder.path().join("damaged.mcap");
    let mut bytes = mcap(&measured, 0..measured.len(), Chunks::None);
    // A bit of a number in the middle of the file: only the check sum of its chunk shows it.
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(&path, &bytes).expect("written");
    let log = sound(&path);
    assert!(log.len() < measured.len() && log.len() > measured.len() / 2, "{} rows", log.len());
    assert!(log.notes.iter().any(|note| note.contains("a chunk is damaged")), "{:?}", log.notes);
}

#[test]
fn flipped_bytes_of_mcap_are_an_error_and_no_panic() {
    let Some(measured) = measured() else { return };
    let folder = folder();
    let path = folder.path().join("flipped.mcap");
    for chunks in [Chunks::None, Chunks::Zstd, Chunks::Lz4] {
        let whole = mcap(&measured, 0..40, chunks);
        for at in (8..whole.len()).step_by(if chunks == Chunks::None { 23 } else { 7 }) {
            let mut bytes = whole.clone();
            bytes[at] ^= 0x81;
            std::fs::write(&path, &bytes).expect("written");
            if let Err(why) = read_named(&path) {
                assert!(why.to_string().contains("flipped.mcap"), "{at}: {why}");
            }
        }
    }
}

/// Records and chunks that claim more than there is: no memory is set aside for what is claimed.
#[test]
fn mcap_that_claims_too_much_is_refused() {
    let folder = folder();
    let path = folder.path().join("claims.mcap");
    let record = |op: u8, length: u64, body: &[u8]| {
        let mut bytes = mcap::MAGIC.to_vec();
        bytes.push(op);
        bytes.extend(length.to_le_bytes());
        bytes.extend(body);
        bytes
    };
    let chunk = |size: u64, compression: &[u8], stored: u64| {
        let mut body = vec![0; 16];
        body.extend(size.to_le_bytes());
        body.extend([0; 4]);
        body.extend((compression.len() as u32).to_le_bytes());
        body.extend(compression);
        body.extend(stored.to_le_bytes());
        record(6, u64::MAX >> 1, &body)
    };
    for (bytes, words) in [
        (record(4, u64::MAX, &[0; 20]), "a record claims"),
        (record(3, 60 << 20, &[0; 20]), "its end is missing"),
        (record(5, 1 << 40, &[0; 22]), "its end is missing"),
        (chunk(u64::MAX, b"zstd", u64::MAX), "a chunk claims 18446744073709551615 bytes"),
        (chunk(1 << 27, b"zstd", u64::MAX), "its last chunk is not whole"),
        (chunk(1 << 29, b"zstd", u64::MAX), "its chunks claim 536870912 bytes"),
        (chunk(1 << 20, b"bzip2", 10), "compressed by bzip2; zstd, lz4 and none are read"),
        (chunk(1 << 20, &[b'x'; 64], 10), "has a name of 64 bytes"),
    ] {
        std::fs::write(&path, bytes).expect("written");
        let why = read_named(&path).expect_err("must be refused").to_string();
        assert!(why.contains(words), "{words}: {why}");
    }
}

/// Chunks that claim nothing have their decoder all the same.
#[test]
fn mcap_of_very_many_chunks_is_refused() {
    let folder = folder();
    let path = folder.path().join("chunks.mcap");
    let mut chunk = vec![6];
    chunk.extend(40_u64.to_le_bytes());
    chunk.extend([0; 40]);
    for (count, is_refused) in [(1000, false), (20_000, true)] {
        let mut bytes = mcap::MAGIC.to_vec();
        bytes.extend(chunk.repeat(count));
        std::fs::write(&path, bytes).expect("written");
        let why = read_named(&path).expect_err("it has no message").to_string();
        assert_eq!(why.contains("its chunks claim"), is_refused, "{why}");
    }
}

#[test]
fn bag_of_two_files_is_one_recording() {
    let Some(measured) = measured() else { return };
    let folder = folder();
    let cut = 700;
    let rest =
        zstd::stream::encode_all(mcap(&measured, cut..measured.len(), Chunks::None).as_slice(), 1).expect("zstd");
    std::fs::write(folder.path().join("run_0.mcap"), mcap(&measured, 0..cut, Chunks::Zstd)).expect("written");
    std::fs::write(folder.path().join("run_1.mcap.zstd"), rest).expect("written");
    let metadata = |files: &str, storage: &str| {
        let text = format!(
            "rosbag2_bagfile_information:\n  version: 8\n  storage_identifier: {storage}\n  relative_file_paths:\n{files}  duration:\n    nanoseconds: 1\n"
        );
        std::fs::write(folder.path().join("metadata.yaml"), text).expect("written");
    };
    metadata("    - run_0.mcap\n    - run_1.mcap.zstd\n", "mcap");
    assert_same("bag", &sound(folder.path()), &measured);
    metadata("    - ../run_0.mcap\n", "mcap");
    let why = read_named(folder.path()).expect_err("outside").to_string();
    assert!(why.contains("is not inside the folder"), "{why}");
    metadata("    - run_0.mcap\n", "leveldb");
    let why = read_named(folder.path()).expect_err("unknown").to_string();
    assert!(why.contains("storage_identifier is \"leveldb\""), "{why}");
    if !cfg!(feature = "sqlite") {
        metadata("    - run_0.db3\n", "sqlite3");
        let why = read_named(folder.path()).expect_err("off by default").to_string();
        assert!(
            why.contains("sqlite3") && why.contains("ros2 bag convert") && why.contains("--features sqlite"),
            "{why}"
        );
    }
    std::fs::remove_file(folder.path().join("metadata.yaml")).expect("removed");
    let why = read_named(folder.path()).expect_err("no bag").to_string();
    assert!(why.contains("neither metadata.yaml (rosbag2) nor meta/info.json (LeRobot)"), "{why}");
}

#[test]
fn lerobot_folder_gives_joints_by_the_names_of_its_description() {
    let Some(measured) = measured() else { return };
    let folder = folder();
    let (names, order) = (joints(), alphabetical());
    let quoted: Vec<String> = order.iter().map(|j| format!("\"{}.pos\"", names[*j])).collect();
    let effort: Vec<String> = order.iter().map(|j| format!("\"{}.effort\"", names[*j])).collect();
    let info = format!(
        r#"{{"codebase_version": "v3.0", "fps": 1000, "features": {{
            "observation.state": {{"dtype": "float64", "shape": [7], "names": [{}]}},
            "observation.effort": {{"dtype": "float64", "shape": [7], "names": {{"motors": [{}]}}}},
            "timestamp": {{"dtype": "float64", "shape": [1], "names": null}},
            "episode_index": {{"dtype": "int64", "shape": [1], "names": null}}}}}}"#,
        quoted.join(", "),
        effort.join(", ")
    );
    std::fs::create_dir_all(folder.path().join("meta")).expect("a folder");
    std::fs::create_dir_all(folder.path().join("data/chunk-000")).expect("a folder");
    std::fs::write(folder.path().join("meta/info.json"), info).expect("written");
    let message = "message schema {
        optional group observation.state (LIST) { repeated group list { optional double element; } }
        optional group observation.effort (LIST) { repeated group list { optional double element; } }
        required double timestamp; required double episode_index; }";
    let tau = measured.torque().expect("torque");
    let columns = [
        (lists(&measured.q, &order), 7),
        (lists(tau, &order), 7),
        (measured.t.clone(), 0),
        (vec![0.0; measured.len()], 0),
    ];
    let file = folder.path().join("data/chunk-000/file-000.parquet");
    write_parquet(&file, message, &columns, Compression::SNAPPY);
    assert_same("LeRobot", &sound(folder.path()), &measured);
    let mut episodes = vec![0.0; measured.len()];
    episodes[1000..].fill(1.0);
    let mut t = measured.t.clone();
    t[1000..].iter_mut().for_each(|t| *t -= 1.0);
    write_parquet(
        &file,
        message,
        &[columns[0].clone(), columns[1].clone(), (t, 0), (episodes, 0)],
        Compression::SNAPPY,
    );
    let log = sound(folder.path());
    assert!(log.notes.iter().any(|note| note.contains("2 episodes are read as one log")), "{:?}", log.notes);
    assert!((log.t[1000] - log.t[999] - 10.0).abs() < 1e-9);
}

#[test]
fn parquet_of_lists_and_groups_and_every_codec_is_read() {
    let Some(measured) = measured() else { return };
    let folder = folder();
    let tau = measured.torque().expect("torque");
    let path = folder.path().join("run.parquet");
    let in_order: Vec<usize> = (0..7).collect();
    let message = "message schema { required double t;
        optional group q (LIST) { repeated group list { optional double element; } }
        optional group tau (LIST) { repeated group list { optional double element; } } }";
    let columns = [(measured.t.clone(), 0), (lists(&measured.q, &in_order), 7), (lists(tau, &in_order), 7)];
    for codec in [
        Compression::UNCOMPRESSED,
        Compression::SNAPPY,
        Compression::GZIP(GzipLevel::default()),
        Compression::BROTLI(BrotliLevel::default()),
        Compression::LZ4_RAW,
        Compression::ZSTD(ZstdLevel::default()),
    ] {
        write_parquet(&path, message, &columns, codec);
        assert_same(&format!("{codec:?}"), &sound(&path), &measured);
    }
    let fields = joints().iter().map(|j| format!("required double {j}; ")).collect::<Vec<_>>().concat();
    let message = format!(
        "message schema {{ required double timestamp; required group position {{ {fields} }} required group effort {{ {fields} }} }}"
    );
    let mut columns = vec![(measured.t.clone(), 0)];
    columns.extend(measured.q.iter().chain(tau).map(|signal| (signal.clone(), 0)));
    write_parquet(&path, &message, &columns, Compression::SNAPPY);
    // The groups are `position.{joint}` and `effort.{joint}`: what they are stands before the joint.
    let mut map = ChannelMap::default();
    map.entry("q").expect("a key").pattern = Some("position.{joint}".to_owned());
    map.entry("tau").expect("a key").pattern = Some("effort.{joint}".to_owned());
    assert_same("groups", &read_mapped(&path, &map).unwrap_or_else(|why| panic!("{why}")), &measured);
    assert_same("groups by name", &sound(&path), &measured);
}

#[test]
fn text_tables_of_every_dialect_give_the_measured_numbers() {
    let Some(measured) = measured() else { return };
    let folder = folder();
    let path = folder.path().join("run.csv");
    let plain = |_: usize, x: f64| format!("{x}");
    let comma = |_: usize, x: f64| format!("{x}").replace('.', ",");
    let contract: Vec<String> = std::iter::once("t".to_owned())
        .chain((1..=7).map(|j| format!("q{j}")))
        .chain((1..=7).map(|j| format!("tau{j}")))
        .collect();
    let units: Vec<String> = std::iter::once("\"Time [ms]\"".to_owned())
        .chain((1..=7).map(|j| format!("\"Q{j} [deg]\"")))
        .chain((1..=7).map(|j| format!("\"TAU{j} (mN m)\"")))
        .collect();
    let in_units = |column: usize, x: f64| match column {
        0 | 8.. => format!("{}", 1000.0 * x),
        _ => format!("{}", x.to_degrees()),
    };
    let named: Vec<String> = std::iter::once("__time".to_owned())
        .chain(joints().iter().map(|j| format!("/joint_states/{j}/position")))
        .chain(joints().iter().map(|j| format!("/joint_states/{j}/effort")))
        .collect();
    let hash = format!("# written by numpy\n# {}", table(&measured, &contract, " ", plain));
    let libfranka: Vec<String> = std::iter::once("duration".to_owned())
        .chain((0..7).map(|j| format!("robot_state.q[{j}]")))
        .chain((0..7).map(|j| format!("robot_state.tau_J[{j}]")))
        .collect();
    let in_ms = |column: usize, x: f64| if column == 0 { format!("{}", 1000.0 * x) } else { format!("{x}") };
    for (what, text) in [
        ("commas", table(&measured, &contract, ",", plain)),
        ("semicolons and decimal commas", table(&measured, &contract, ";", comma)),
        ("tabs", table(&measured, &contract, "\t", plain)),
        ("blanks", table(&measured, &contract, "  ", plain)),
        ("blanks and decimal commas", table(&measured, &contract, " ", comma)),
        (
            "units",
            format!("// a logger\n\u{feff}{}", table(&measured, &units, ",", in_units)).replace("// a logger\n", ""),
        ),
        ("PlotJuggler", table(&measured, &named, ",", plain)),
        ("a header in a comment", hash),
        ("libfranka", table(&measured, &libfranka, ",", in_ms)),
    ] {
        std::fs::write(&path, text).expect("written");
        assert_same(what, &sound(&path), &measured);
    }
}

#[test]
fn table_without_a_header_is_read_by_a_map() {
    let Some(measured) = measured() else { return };
    let folder = folder();
    let path = folder.path().join("run.txt");
    std::fs::write(&path, table(&measured, &[], "\t", |_, x| format!("{x}"))).expect("written");
    let mut map = ChannelMap::default();
    let columns = |from: usize| (from..from + 7).map(|k| format!("column{k}")).collect::<Vec<_>>().join(", ");
    map.entry("time").expect("a key").pattern = Some("column1".to_owned());
    map.entry("q").expect("a key").pattern = Some(columns(2));
    map.entry("tau").expect("a key").pattern = Some(columns(9));
    let log = read_mapped(&path, &map).unwrap_or_else(|why| panic!("{why}"));
    assert_same("no header", &log, &measured);
}
