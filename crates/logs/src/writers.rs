//! The table of writers: one line a format. What rivet writes is marked as being in the model's conventions.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use hdf5_writer::{AttributeBuilder, DatasetBuilder, Hdf5Builder, Hdf5WritePlan, Hdf5Writer};
use mcap::records::MessageHeader;
use mcap::{Compression, McapError, WriteOptions};
use rivet_files::CONVENTIONS_OF_THE_MODEL;

use crate::columns::Group;
use crate::error::{LogError, LogFault};
use crate::joint_state::{DEFINITION, TYPES, encode};
use crate::listing::CONVENTIONS;
use crate::log::{Log, Signals};
use crate::npy::Header;
use crate::parquet_file::{write_columns, write_model_columns};

/// A format that can be written.
struct Writer {
    /// How the name of a file ends.
    extension: &'static str,
    /// Signals that it has no place for.
    left_out: &'static [Group],
    write: fn(&Path, &Log, &[String]) -> Result<(), LogError>,
}

const WRITERS: [Writer; 5] = [
    Writer { extension: "parquet", left_out: &[], write: write_parquet },
    Writer { extension: "csv", left_out: &[], write: write_csv },
    Writer { extension: "npz", left_out: &[], write: write_npz },
    Writer { extension: "h5", left_out: &[], write: write_hdf5 },
    Writer {
        extension: "mcap",
        left_out: &[Group::Current, Group::Temperature, Group::LinkPosition, Group::DesiredAcceleration],
        write: write_mcap,
    },
];

/// Topics of a log in MCAP: what was measured, and what was planned.
const MEASURED: &str = "/joint_states";
const PLANNED: &str = "/setpoint/joint_states";
/// Bytes of a chunk before compression.
const CHUNK_BYTES: u64 = 1 << 20;
/// Nanoseconds of a second.
const NS_PER_S: f64 = 1e9;

/// That [`write_log`] knows the format of a name.
///
/// # Errors
/// The ending is that of no format that is written.
pub fn check_ending(path: &Path) -> Result<(), LogError> {
    writer(path).map(|_| ())
}

fn ending(path: &Path) -> String {
    path.extension().map(|ending| ending.to_string_lossy().to_lowercase()).unwrap_or_default()
}

fn writer(path: &Path) -> Result<&'static Writer, LogError> {
    let ending = ending(path);
    WRITERS.iter().find(|writer| writer.extension == ending).ok_or_else(|| {
        let known = WRITERS.iter().map(|writer| format!(".{}", writer.extension)).collect::<Vec<_>>().join(", ");
        LogFault::UnknownEnding { known }.at(path)
    })
}

/// Writes a log; the ending of its name decides the format. The file appears complete, or not at all.
///
/// * `joints`: names, base to flange; they are used where the format has names
///
/// Returns what the format has no place for.
///
/// # Errors
/// The ending is that of no format that is written, or the file cannot be written.
pub fn write_log(path: &Path, log: &Log, joints: &[String]) -> Result<Vec<String>, LogError> {
    let writer = writer(path)?;
    (writer.write)(path, log, joints)?;
    let columns = log.columns();
    let has =
        |group: &&Group| columns.iter().any(|(name, _)| Group::parse(name).is_some_and(|(own, _)| own == **group));
    Ok(writer.left_out.iter().filter(has).map(|group| format!("{}1..{}", group.prefix(), log.joints())).collect())
}

impl Log {
    /// Its columns under the names of the contract.
    pub fn columns(&self) -> Vec<(Cow<'static, str>, &[f64])> {
        let groups = [
            (Group::Position, Some(&self.q)),
            (Group::Torque, self.tau.as_ref().map(|(_, tau)| tau)),
            (Group::Current, self.current.as_ref()),
            (Group::Velocity, self.qd.as_ref()),
            (Group::DesiredPosition, self.q_des.as_ref()),
            (Group::DesiredVelocity, self.qd_des.as_ref()),
            (Group::DesiredAcceleration, self.qdd_des.as_ref()),
            (Group::Temperature, self.temperature.as_ref()),
        ];
        let mut columns: Vec<(Cow<'static, str>, &[f64])> = vec![(Cow::Borrowed("t"), &self.t)];
        for (group, signals) in groups {
            let signals = signals.into_iter().flatten().enumerate();
            columns.extend(signals.map(|(joint, signal)| (Cow::Owned(group.column(joint)), signal.as_slice())));
        }
        let links = self.q_link.iter().enumerate().filter_map(|(joint, signal)| Some((joint, signal.as_deref()?)));
        columns.extend(links.map(|(joint, signal)| (Cow::Owned(Group::LinkPosition.column(joint)), signal)));
        columns
    }
}

fn write_parquet(path: &Path, log: &Log, _joints: &[String]) -> Result<(), LogError> {
    write_model_columns(path, &log.columns())
}

fn write_csv(path: &Path, log: &Log, _joints: &[String]) -> Result<(), LogError> {
    csv(path, &log.columns(), Some(CONVENTIONS_OF_THE_MODEL))
}

/// Columns as text, after a line that states their conventions.
fn csv<N: AsRef<str>>(path: &Path, columns: &[(N, &[f64])], conventions: Option<&str>) -> Result<(), LogError> {
    let rows = columns.iter().map(|(_, values)| values.len()).max().unwrap_or(0);
    let write = |file: &mut File| -> std::io::Result<()> {
        let mut out = BufWriter::new(file);
        if let Some(conventions) = conventions {
            writeln!(out, "# rivet: {conventions}")?;
        }
        let names: Vec<&str> = columns.iter().map(|(name, _)| name.as_ref()).collect();
        writeln!(out, "{}", names.join(","))?;
        for row in 0..rows {
            for (k, (_, values)) in columns.iter().enumerate() {
                // The shortest text that reads back as the same number.
                write!(out, "{}{}", if k > 0 { "," } else { "" }, values[row])?;
            }
            writeln!(out)?;
        }
        out.flush()
    };
    rivet_files::fill_whole(path, write).map_err(|why| LogFault::Io(why).at(path))
}

/// Formats of a table of numbers, by the ending of the file's name; the first one without an ending.
const TABLES: [&str; 2] = ["parquet", "csv"];

/// That [`write_table`] knows the format of a name.
///
/// # Errors
/// The ending is that of no table.
pub fn check_table_ending(path: &Path) -> Result<(), LogError> {
    // A device or a pipe has no ending.
    let ending = ending(path);
    if ending.is_empty() || TABLES.contains(&ending.as_str()) {
        return Ok(());
    }
    Err(LogFault::UnknownEnding { known: TABLES.map(|known| format!(".{known}")).join(", ") }.at(path))
}

/// Writes columns of equal length as Parquet or text; the ending of the name decides. The file appears complete, or not at all.
///
/// # Errors
/// The ending is that of no table, or the file cannot be written.
pub fn write_table<N: AsRef<str>>(path: &Path, columns: &[(N, &[f64])]) -> Result<(), LogError> {
    check_table_ending(path)?;
    if ending(path) == "csv" { csv(path, columns, None) } else { write_columns(path, columns) }
}

/// Signals of a log by the prefix of their names; a joint without one has NaN.
fn tables<'a>(log: &'a Log, nothing: &'a [f64]) -> Vec<(&'static str, Vec<&'a [f64]>)> {
    let columns = log.columns();
    let table = |group: Group| {
        let column =
            |joint: usize| columns.iter().find(|(name, _)| *name == group.column(joint)).map(|(_, values)| *values);
        let found: Vec<Option<&[f64]>> = (0..log.joints()).map(column).collect();
        let is_there = found.iter().any(Option::is_some);
        is_there.then(|| (group.prefix(), found.into_iter().map(|values| values.unwrap_or(nothing)).collect()))
    };
    Group::ALL.into_iter().filter_map(table).collect()
}

/// Data sets `t`, and `q`, `tau` and others with a row a sample, as of `h5py`.
fn write_hdf5(path: &Path, log: &Log, _joints: &[String]) -> Result<(), LogError> {
    let nothing = vec![f64::NAN; log.len()];
    let plan = || -> Result<Hdf5WritePlan, hdf5_writer::Error> {
        let rows = log.len() as u64;
        let mut file = Hdf5Builder::new()
            .attribute(AttributeBuilder::fixed_string(CONVENTIONS, CONVENTIONS_OF_THE_MODEL))
            .dataset(DatasetBuilder::typed_data("t", vec![rows], &log.t)?);
        for (name, signals) in tables(log, &nothing) {
            let values: Vec<f64> =
                (0..log.len()).flat_map(|row| signals.iter().map(move |signal| signal[row])).collect();
            file = file.dataset(DatasetBuilder::typed_data(name, vec![rows, signals.len() as u64], &values)?);
        }
        file.into_plan()
    };
    let fault = |why: hdf5_writer::Error| LogFault::Format { format: "HDF5", why: why.to_string() }.at(path);
    let plan = plan().map_err(fault)?;
    let write = |file: &mut File| -> Result<(), Hdf5Fault> {
        let writer = Hdf5Writer::new(BufWriter::new(file), hdf5_writer::WriteOptions::default());
        Ok(writer.finish(plan)?.flush()?)
    };
    rivet_files::fill_whole(path, write).map_err(|Hdf5Fault(why)| match why {
        hdf5_writer::Error::Io(why) => LogFault::Io(why).at(path),
        why => fault(why),
    })
}

/// Arrays `t`, and `q`, `tau` and others with a row a sample; without compression, as `numpy.savez`.
fn write_npz(path: &Path, log: &Log, _joints: &[String]) -> Result<(), LogError> {
    let nothing = vec![f64::NAN; log.len()];
    let arrays = tables(log, &nothing);
    let write = |file: &mut File| -> std::io::Result<()> {
        let mut zip = zip::ZipWriter::new(BufWriter::new(file));
        // Of every time the same file is made.
        let options = zip::write::SimpleFileOptions::default()
            .compression_method(zip::CompressionMethod::Stored)
            .last_modified_time(zip::DateTime::default())
            .large_file(true);
        zip.start_file(format!("{CONVENTIONS}.npy"), options)?;
        Header::write_text(&mut zip, CONVENTIONS_OF_THE_MODEL)?;
        zip.start_file("t.npy", options)?;
        Header::write_floats(&mut zip, &[log.len()])?;
        log.t.iter().try_for_each(|t| zip.write_all(&t.to_le_bytes()))?;
        for (name, signals) in &arrays {
            zip.start_file(format!("{name}.npy"), options)?;
            Header::write_floats(&mut zip, &[log.len(), signals.len()])?;
            for row in 0..log.len() {
                signals.iter().try_for_each(|signal| zip.write_all(&signal[row].to_le_bytes()))?;
            }
        }
        zip.finish()?.flush()
    };
    rivet_files::fill_whole(path, write).map_err(|why| LogFault::Io(why).at(path))
}

fn write_mcap(path: &Path, log: &Log, joints: &[String]) -> Result<(), LogError> {
    let write = |file: &mut File| -> Result<(), McapFault> {
        let mut writer = WriteOptions::new()
            .profile("ros2")
            .library(format!("rivet {}: {CONVENTIONS_OF_THE_MODEL}", env!("CARGO_PKG_VERSION")))
            .compression(Some(Compression::Zstd))
            .compression_threads(0)
            .chunk_size(Some(CHUNK_BYTES))
            .disable_seeking(true)
            .create(BufWriter::new(file))?;
        let schema = writer.add_schema(TYPES[0], "ros2msg", DEFINITION.as_bytes())?;
        let topics = [
            (MEASURED, [Some(&log.q), log.qd.as_ref(), log.tau.as_ref().map(|(_, tau)| tau)]),
            (PLANNED, [log.q_des.as_ref(), log.qd_des.as_ref(), None]),
        ];
        let mut channels = Vec::new();
        for (topic, signals) in topics.into_iter().filter(|(_, signals)| signals.iter().any(Option::is_some)) {
            channels.push((writer.add_channel(schema, topic, "cdr", &BTreeMap::new())?, signals));
        }
        let origin_s = origin_s(log);
        for (row, t) in log.t.iter().enumerate() {
            let stamp_ns = ((t - origin_s) * NS_PER_S).round() as u64;
            for (channel, signals) in &channels {
                let at = |signals: Option<&Signals>| -> Vec<f64> {
                    signals.into_iter().flatten().map(|signal| signal[row]).collect()
                };
                let [q, qd, tau] = signals.map(at);
                let data = encode(stamp_ns, joints, [&q, &qd, &tau]);
                let header = MessageHeader {
                    channel_id: *channel,
                    sequence: row as u32,
                    log_time: stamp_ns,
                    publish_time: stamp_ns,
                };
                writer.write_to_known_channel(&header, &data)?;
            }
        }
        writer.finish()?;
        Ok(())
    };
    rivet_files::fill_whole(path, write).map_err(|McapFault(why)| {
        let fault = match why {
            McapError::Io(why) => LogFault::Io(why),
            why => LogFault::Format { format: "MCAP", why: why.to_string() },
        };
        fault.at(path)
    })
}

/// What is taken from times for the stamps \[s\]: these are whole, above 0 and below 2^31 s.
fn origin_s(log: &Log) -> f64 {
    let (first, last) = log.t.first().zip(log.t.last()).map_or((0.0, 0.0), |(first, last)| (*first, *last));
    // A stamp of 0 is one that was not set.
    if first >= 1.0 && last < f64::from(i32::MAX) { 0.0 } else { first - 1.0 }
}

/// What ends the writing of an HDF5 file.
struct Hdf5Fault(hdf5_writer::Error);

impl From<hdf5_writer::Error> for Hdf5Fault {
    fn from(why: hdf5_writer::Error) -> Hdf5Fault {
        Hdf5Fault(why)
    }
}

impl From<std::io::Error> for Hdf5Fault {
    fn from(why: std::io::Error) -> Hdf5Fault {
        Hdf5Fault(hdf5_writer::Error::Io(why))
    }
}

/// What ends the writing of an MCAP file.
struct McapFault(McapError);

impl From<McapError> for McapFault {
    fn from(why: McapError) -> McapFault {
        McapFault(why)
    }
}

impl From<std::io::Error> for McapFault {
    fn from(why: std::io::Error) -> McapFault {
        McapFault(McapError::Io(why))
    }
}
