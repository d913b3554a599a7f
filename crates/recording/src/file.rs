//! The file of a recording.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use mcap::records::{MessageHeader, Metadata};
use mcap::{Compression, McapError, WriteOptions, Writer};
use rivet_config::Robot;
use rivet_ipc_schema::ENUMERATIONS;
use serde_json::json;

use crate::error::RecordingError;
use crate::message::{ENCODING, Received, SCHEMA_ENCODING, TOPICS};

/// Bytes of a chunk before compression. At 1 kHz a chunk ends by time before it has as many.
const CHUNK_BYTES: u64 = 1 << 20;
/// Name of the records that describe the robot and the numbers of enumerations.
const ROBOT: &str = "rivet robot";
const NUMBERS: &str = "rivet enumerations";

/// What a recording is of.
#[derive(Clone, Debug, Default)]
pub struct About {
    /// Name of the robot.
    pub robot: String,
    /// Names of its joints, base to flange.
    pub joints: Vec<String>,
    /// Names of the base parameters, in the order of the messages.
    pub parameters: Vec<String>,
    /// Hash of the model whose parameters they are.
    pub model_hash: u64,
    /// Sample period of the robot file \[s\].
    pub sample_period_s: f64,
    /// Added to stamps and times of receipt \[ns\], to give nanoseconds since 1970-01-01 UTC.
    pub to_utc_ns: i64,
}

/// An MCAP file that grows.
pub struct RecordingFile {
    path: PathBuf,
    writer: Writer<BufWriter<File>>,
    channels: Vec<u16>,
    joints: usize,
    to_utc_ns: i64,
}

impl About {
    /// What a recording of `robot` is of; `now_ns`: `CLOCK_MONOTONIC` \[ns\].
    pub fn new(robot: &Robot, now_ns: u64) -> About {
        let since_epoch = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let utc_ns = i64::try_from(since_epoch.as_nanos()).unwrap_or(i64::MAX);
        About {
            robot: robot.config.name.clone(),
            joints: robot.model.arm.joints.iter().map(|joint| joint.name.clone()).collect(),
            parameters: (0..robot.base.len()).map(|i| robot.base.name(&robot.model, i)).collect(),
            model_hash: robot.hash,
            sample_period_s: robot.config.sample_period_s,
            to_utc_ns: utc_ns.saturating_sub_unsigned(now_ns),
        }
    }
}

impl RecordingFile {
    /// Makes a file; one of that name must not be there.
    ///
    /// # Errors
    /// It is there already, or it cannot be made.
    pub fn create(path: &Path, about: &About) -> Result<RecordingFile, RecordingError> {
        let file = rivet_files::create_new(path).map_err(|why| match why.kind() {
            io::ErrorKind::AlreadyExists => RecordingError::Exists { path: path.to_owned() },
            _ => RecordingError::File { path: path.to_owned(), why },
        })?;
        let writer = WriteOptions::new()
            .library(format!("rivet {}", env!("CARGO_PKG_VERSION")))
            .compression(Some(Compression::Zstd))
            .compression_threads(0)
            .chunk_size(Some(CHUNK_BYTES))
            // A chunk goes to the file as a whole: who ends the process leaves whole chunks behind.
            .disable_seeking(true)
            .create(BufWriter::new(file));
        let mut file = RecordingFile {
            path: path.to_owned(),
            writer: writer.map_err(|why| fault(path, why))?,
            channels: Vec::new(),
            joints: about.joints.len(),
            to_utc_ns: about.to_utc_ns,
        };
        file.describe(about).map_err(|why| fault(path, why))?;
        Ok(file)
    }

    fn describe(&mut self, about: &About) -> Result<(), McapError> {
        for topic in TOPICS {
            let text = topic.schema().to_string();
            let schema = self.writer.add_schema(topic.kind, SCHEMA_ENCODING, text.as_bytes())?;
            let name = topic.full_name(&about.robot);
            self.channels.push(self.writer.add_channel(schema, &name, ENCODING, &BTreeMap::new())?);
        }
        let robot = [
            ("robot", about.robot.clone()),
            ("joints", json!(about.joints).to_string()),
            ("parameters", json!(about.parameters).to_string()),
            ("model_hash", about.model_hash.to_string()),
            ("sample_period_s", about.sample_period_s.to_string()),
            ("to_utc_ns", about.to_utc_ns.to_string()),
        ];
        let robot = robot.map(|(key, value)| (key.to_owned(), value));
        self.writer.write_metadata(&Metadata { name: ROBOT.to_owned(), metadata: robot.into() })?;
        let numbers = ENUMERATIONS.iter().map(|enumeration| {
            let names: BTreeMap<String, &str> =
                enumeration.values.iter().map(|(name, number)| (number.to_string(), *name)).collect();
            (enumeration.name.to_owned(), json!(names).to_string())
        });
        self.writer.write_metadata(&Metadata { name: NUMBERS.to_owned(), metadata: numbers.collect() })?;
        self.writer.flush()
    }

    /// Appends a message.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn write(&mut self, received: &Received) -> Result<(), RecordingError> {
        let Received { at_ns, content, .. } = received;
        let data = content.to_json(self.joints).map_err(|why| self.fault(why.to_string()))?;
        let utc = |ns: u64| ns.saturating_add_signed(self.to_utc_ns);
        let header = MessageHeader {
            channel_id: self.channels[content.place()],
            sequence: content.number().unwrap_or(0) as u32,
            log_time: utc(*at_ns),
            publish_time: utc(content.stamp_ns()),
        };
        self.writer.write_to_known_channel(&header, &data).map_err(|why| fault(&self.path, why))
    }

    /// Ends the chunk: what was written so far is whole, whatever becomes of the process.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn end_chunk(&mut self) -> Result<(), RecordingError> {
        self.writer.flush().map_err(|why| fault(&self.path, why))
    }

    /// Writes the index and brings everything to the disk.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn finish(mut self) -> Result<(), RecordingError> {
        self.writer.finish().map_err(|why| fault(&self.path, why))?;
        let io = |why| RecordingError::File { path: self.path.clone(), why };
        let file = self.writer.into_inner().into_inner().map_err(|why| io(why.into_error()))?;
        file.sync_all().map_err(io)
    }

    fn fault(&self, why: String) -> RecordingError {
        RecordingError::Format { path: self.path.clone(), why }
    }
}

fn fault(path: &Path, why: McapError) -> RecordingError {
    let path = path.to_owned();
    match why {
        McapError::Io(why) => RecordingError::File { path, why },
        why => RecordingError::Format { path, why: why.to_string() },
    }
}
