//! Writers of one measured set in the formats of other programs.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::{Cursor, Write as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use parquet::basic::Compression;
use parquet::data_type::DoubleType;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::parser::parse_message_type;
use rivet_logs::{Log, ReadOptions, read};

/// Largest difference between what was written and what is read back, relative to one.
const SAME: f64 = 1e-12;

pub(crate) fn shared(path: &str) -> Option<PathBuf> {
    let found = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data").join(path);
    if !found.exists() {
        let _ = writeln!(std::io::stderr(), "SKIPPED: {} is not there", found.display());
    }
    found.exists().then_some(found)
}

/// A measured run of a Kinova Gen3: seven joints at 1 kHz, its stamps whole nanoseconds.
pub(crate) fn measured() -> Option<Log> {
    shared("real/kinova_gen3/RunTrajectory1.parquet").map(|path| read(path, &ReadOptions::new(7)).expect("a log"))
}

/// Names of its joints in a URDF.
pub(crate) fn joints() -> Vec<String> {
    ["base", "shoulder", "half_arm", "elbow", "wrist_1", "wrist_2", "tool"].map(str::to_owned).to_vec()
}

/// Joints in alphabetical order, as drivers publish them.
pub(crate) fn alphabetical() -> Vec<usize> {
    let names = joints();
    let mut order: Vec<usize> = (0..names.len()).collect();
    order.sort_by(|a, b| names[*a].cmp(&names[*b]));
    order
}

/// Positions, torques and time are those of the measured set; time from its first row.
pub(crate) fn assert_same(what: &str, found: &Log, measured: &Log) {
    assert_same_rows(what, found, measured, measured.len());
}

pub(crate) fn assert_same_rows(what: &str, found: &Log, measured: &Log, rows: usize) {
    assert_eq!(found.len(), rows, "{what}: rows");
    let close = |name: &str, a: &[f64], b: &[f64], from: [f64; 2]| {
        for (k, (a, b)) in a.iter().zip(b).enumerate() {
            let off = ((a - from[0]) - (b - from[1])).abs();
            assert!(off <= SAME * b.abs().max(1.0), "{what}: {name} row {k}: {a} and {b}");
        }
    };
    close("t", &found.t, &measured.t, [found.t[0], measured.t[0]]);
    for joint in 0..measured.joints() {
        close("q", &found.q[joint], &measured.q[joint], [0.0; 2]);
        close("tau", &found.torque().expect("torque")[joint], &measured.torque().expect("torque")[joint], [0.0; 2]);
    }
}

/// `sensor_msgs/JointState` in little-endian CDR.
pub(crate) fn joint_state(stamp_ns: u64, names: &[&str], arrays: [&[f64]; 3]) -> Vec<u8> {
    let mut out = vec![0, 1, 0, 0];
    let pad = |out: &mut Vec<u8>, size: usize| out.resize(4 + (out.len() - 4).next_multiple_of(size), 0);
    let word = |out: &mut Vec<u8>, value: u64| {
        pad(out, 4);
        out.extend(u32::try_from(value).expect("32 bits").to_le_bytes());
    };
    let text = |out: &mut Vec<u8>, text: &str| {
        word(out, text.len() as u64 + 1);
        out.extend(text.as_bytes());
        out.push(0);
    };
    word(&mut out, stamp_ns / 1_000_000_000);
    word(&mut out, stamp_ns % 1_000_000_000);
    text(&mut out, "base_link");
    word(&mut out, names.len() as u64);
    for name in names {
        text(&mut out, name);
    }
    for array in arrays {
        word(&mut out, array.len() as u64);
        for value in array {
            pad(&mut out, 8);
            out.extend(value.to_le_bytes());
        }
    }
    out
}

/// The message of a row, joints in alphabetical order, with a gripper that is not of the arm.
pub(crate) fn row(log: &Log, k: usize) -> (u64, Vec<u8>) {
    const START_NS: u64 = 1_700_000_000_000_000_000;
    let (order, names) = (alphabetical(), joints());
    let stamp = START_NS + (log.t[k] * 1e9).round() as u64;
    let mut of: Vec<&str> = order.iter().map(|j| names[*j].as_str()).collect();
    of.push("gripper");
    let tau = log.torque().expect("torque");
    let take = |signals: &[Vec<f64>]| order.iter().map(|j| signals[*j][k]).chain([0.04]).collect::<Vec<f64>>();
    (stamp, joint_state(stamp, &of, [&take(&log.q), &[], &take(tau)]))
}

/// How an MCAP file is compressed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Chunks {
    None,
    Zstd,
    Lz4,
}

/// Rows of a log as MCAP, with messages of another topic between them.
pub(crate) fn mcap(log: &Log, rows: std::ops::Range<usize>, chunks: Chunks) -> Vec<u8> {
    let mut writer = mcap::WriteOptions::new()
        .compression((chunks == Chunks::Zstd).then_some(mcap::Compression::Zstd))
        .chunk_size(Some(64 << 10))
        .profile("ros2")
        .create(Cursor::new(Vec::new()))
        .expect("a writer");
    let schema = writer.add_schema("sensor_msgs/msg/JointState", "ros2msg", b"...").expect("a schema");
    let states = writer.add_channel(schema, "/joint_states", "cdr", &BTreeMap::new()).expect("a channel");
    let schema = writer.add_schema("std_msgs/msg/String", "ros2msg", b"string data").expect("a schema");
    let words = writer.add_channel(schema, "/words", "cdr", &BTreeMap::new()).expect("a channel");
    let mut write = |channel_id: u16, time: u64, data: &[u8]| {
        let header = mcap::records::MessageHeader { channel_id, sequence: 0, log_time: time, publish_time: time };
        writer.write_to_known_channel(&header, data).expect("written");
    };
    for k in rows {
        let (stamp, message) = row(log, k);
        if k % 50 == 0 {
            write(words, stamp, b"\0\x01\0\0\x02\0\0\0a\0");
        }
        // It arrives later than it was measured.
        write(states, stamp + 300_000 + (k as u64 % 7) * 20_000, &message);
    }
    writer.finish().expect("finished");
    let bytes = writer.into_inner().into_inner();
    if chunks == Chunks::Lz4 { with_lz4(&bytes) } else { bytes }
}

/// A file whose chunks are compressed by lz4. What comes behind the chunks is left out, as where a recorder was killed, but for the end.
fn with_lz4(bytes: &[u8]) -> Vec<u8> {
    let mut out = mcap::MAGIC.to_vec();
    let mut rest = &bytes[mcap::MAGIC.len()..];
    loop {
        let op = rest[0];
        let length = u64::from_le_bytes(rest[1..9].try_into().expect("8")) as usize;
        let body = &rest[9..9 + length];
        rest = &rest[9 + length..];
        let body: Cow<'_, [u8]> = match op {
            mcap::records::op::CHUNK => {
                let mut frame = lz4_flex::frame::FrameEncoder::new(Vec::new());
                // Times, size, check sum and an empty name come before the length of the records.
                frame.write_all(&body[28 + 4 + 8..]).expect("compressed");
                let records = frame.finish().expect("compressed");
                let mut chunk = body[..28].to_vec();
                chunk.extend(3_u32.to_le_bytes());
                chunk.extend(b"lz4");
                chunk.extend((records.len() as u64).to_le_bytes());
                chunk.extend(records);
                chunk.into()
            }
            mcap::records::op::DATA_END => {
                out.push(mcap::records::op::FOOTER);
                out.extend(20_u64.to_le_bytes());
                out.extend([0; 20]);
                out.extend(mcap::MAGIC);
                return out;
            }
            mcap::records::op::MESSAGE_INDEX => continue,
            _ => body.into(),
        };
        out.push(op);
        out.extend((body.len() as u64).to_le_bytes());
        out.extend(body.iter());
    }
}

/// A text table: names and how each number is written, separated by `separator`.
pub(crate) fn table(log: &Log, names: &[String], separator: &str, number: impl Fn(usize, f64) -> String) -> String {
    let tau = log.torque().expect("torque");
    let mut text = if names.is_empty() { String::new() } else { names.join(separator) + "\n" };
    for k in 0..log.len() {
        let row = std::iter::once(log.t[k]).chain(log.q.iter().chain(tau).map(|signal| signal[k]));
        let cells: Vec<String> = row.enumerate().map(|(column, value)| number(column, value)).collect();
        writeln!(text, "{}", cells.join(separator)).expect("writing to a string");
    }
    text
}

/// Columns of doubles in a schema, each with its levels where it is a list of `entries`.
pub(crate) fn write_parquet(path: &Path, message: &str, columns: &[(Vec<f64>, usize)], compression: Compression) {
    let schema = Arc::new(parse_message_type(message).expect("a schema"));
    let properties = WriterProperties::builder().set_compression(compression).build();
    let file = std::fs::File::create(path).expect("created");
    let mut writer = SerializedFileWriter::new(file, schema, Arc::new(properties)).expect("a writer");
    // Two groups of rows, of unequal length.
    for part in 0..2 {
        let mut group = writer.next_row_group().expect("a group");
        for (values, entries) in columns {
            let rows = values.len() / entries.max(&1);
            let range = if part == 0 { 0..rows / 3 } else { rows / 3..rows };
            let values = &values[range.start * entries.max(&1)..range.end * entries.max(&1)];
            let mut column = group.next_column().expect("a column").expect("one more");
            if *entries == 0 {
                column.typed::<DoubleType>().write_batch(values, None, None).expect("written");
            } else {
                let defined = vec![3_i16; values.len()];
                let repeated: Vec<i16> = (0..values.len()).map(|k| i16::from(k % entries != 0)).collect();
                let typed = column.typed::<DoubleType>();
                typed.write_batch(values, Some(&defined), Some(&repeated)).expect("written");
            }
            column.close().expect("closed");
        }
        group.close().expect("closed");
    }
    writer.close().expect("closed");
}

/// Signals as one list a row, in the order of the joints that is given.
pub(crate) fn lists(signals: &[Vec<f64>], order: &[usize]) -> Vec<f64> {
    (0..signals[0].len()).flat_map(|k| order.iter().map(move |j| signals[*j][k])).collect()
}
