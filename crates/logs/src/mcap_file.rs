//! MCAP, message by message: chunks are decompressed as they are read, and a file is read up to where it breaks off.

use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::{self, BufReader, Read, Seek as _, SeekFrom};
use std::path::{Path, PathBuf};

use mcap::records::{Record, op};

use crate::columns::{Table, Wanted};
use crate::error::{LogError, LogFault};
use crate::listing::Listing;
use crate::messages::{Collector, Scout, Sink};

/// First bytes of a Zstandard frame: `ros2 bag` compresses whole files so.
pub(crate) const ZSTD_MAGIC: &[u8] = &[0x28, 0xb5, 0x2f, 0xfd];
/// Longest message of a topic that is read, schema, channel or summary \[bytes\]. Others are passed over without memory.
const MAX_RECORD_BYTES: u64 = 64 << 20;
/// Longest chunk, before compression \[bytes\]. `ros2 bag` writes some MB.
const MAX_CHUNK_BYTES: u64 = 1 << 30;
/// Bytes that all chunks of a recording may have before compression, beside this many times its files' own: recordings of joints that
/// move compress to a tenth, those of an arm at rest to a hundredth.
const FREE_BYTES: u64 = 256 << 20;
const MAX_EXPANSION: u64 = 100;
/// What a chunk counts at least, for the work of its decoder \[bytes\].
const CHUNK_BYTES: u64 = 32 << 10;
/// Longest name of a compression \[bytes\].
const MAX_COMPRESSION_BYTES: u32 = 32;
/// Channel, sequence number and two times before the data of a message \[bytes\].
const MESSAGE_HEADER_BYTES: u64 = 22;
/// Opcode, length and body of the footer \[bytes\].
const FOOTER_BYTES: u64 = 1 + 8 + 20;

/// What a recording in MCAP holds.
pub(crate) fn list(path: &Path) -> Result<Listing, LogError> {
    list_files(path, &[path.to_path_buf()])
}

/// The wanted channels of a recording in MCAP.
pub(crate) fn read(path: &Path, wanted: Wanted<'_>) -> Result<Table, LogError> {
    read_files(path, &[path.to_path_buf()], wanted)
}

/// What the files of a recording hold together.
pub(crate) fn list_files(path: &Path, files: &[PathBuf]) -> Result<Listing, LogError> {
    let mut counts = Some(BTreeMap::new());
    for file in files {
        counts = counts.zip(summary(file)).map(|(mut all, counts)| {
            for (topic, count) in counts {
                *all.entry(topic).or_insert(0) += count;
            }
            all
        });
    }
    let mut scout = Scout::new(counts);
    let warnings = walk(path, files, &mut scout)?;
    Ok(scout.finish(warnings))
}

/// The wanted channels of the files of a recording, one after the other.
pub(crate) fn read_files(path: &Path, files: &[PathBuf], wanted: Wanted<'_>) -> Result<Table, LogError> {
    let bytes = files.iter().filter_map(|file| std::fs::metadata(file).ok()).map(|meta| meta.len()).sum();
    let mut collector = Collector::new(wanted, bytes);
    let warnings = walk(path, files, &mut collector)?;
    Ok(collector.finish(warnings))
}

/// Passes every message of the files to `sink`; returns what is wrong with the files.
fn walk(path: &Path, files: &[PathBuf], sink: &mut dyn Sink) -> Result<Vec<String>, LogError> {
    let bytes = files.iter().filter_map(|file| std::fs::metadata(file).ok()).map(|meta| meta.len()).sum();
    let (budget, mut expanded) = (budget(bytes), 0);
    let mut warnings = Vec::new();
    for file in files {
        if sink.is_done() {
            break;
        }
        let mut stream = open(file).map_err(|e| LogFault::Io(e).at(file))?;
        let mut walk = Walk {
            channels: HashMap::new(),
            types: HashMap::new(),
            sink,
            warnings: Vec::new(),
            messages: 0,
            expanded: &mut expanded,
            budget,
        };
        let ended = walk.file(&mut *stream);
        let name = if files.len() > 1 {
            format!("{}: ", file.file_name().unwrap_or_default().to_string_lossy())
        } else {
            String::new()
        };
        warnings.extend(walk.warnings.iter().map(|warning| format!("{name}{warning}")));
        match ended {
            Ok(()) => {}
            Err(Stop::Refused(why)) => return Err(LogFault::Format { format: "MCAP", why }.at(path)),
            Err(Stop::Broken(why)) if walk.messages == 0 => {
                return Err(LogFault::Format { format: "MCAP", why: format!("no message is whole: {why}") }.at(path));
            }
            Err(Stop::Broken(why)) => {
                let read = walk.messages;
                warnings.push(format!("{name}it breaks off behind {read} messages ({why}); it is read up to there"));
            }
        }
    }
    Ok(warnings)
}

/// Most bytes that a recording of `bytes` may have before compression.
fn budget(bytes: u64) -> u64 {
    bytes.saturating_mul(MAX_EXPANSION).saturating_add(FREE_BYTES)
}

/// A file, decompressed where `ros2 bag` compressed it as a whole.
fn open(path: &Path) -> io::Result<Box<dyn Read>> {
    let mut file = File::open(path)?;
    let mut magic = [0; ZSTD_MAGIC.len()];
    let length = file.read(&mut magic)?;
    file.seek(SeekFrom::Start(0))?;
    if magic[..length] == *ZSTD_MAGIC {
        let budget = budget(file.metadata()?.len());
        return Ok(Box::new(BufReader::new(zstd::stream::read::Decoder::new(file)?).take(budget)));
    }
    Ok(Box::new(BufReader::with_capacity(1 << 16, file)))
}

/// Messages of each topic by the summary at the end of a file; none where it has no such summary.
fn summary(path: &Path) -> Option<BTreeMap<String, u64>> {
    let mut file = File::open(path).ok()?;
    let end = file.metadata().ok()?.len().checked_sub(FOOTER_BYTES + mcap::MAGIC.len() as u64)?;
    file.seek(SeekFrom::Start(end)).ok()?;
    let mut footer = Vec::new();
    file.read_to_end(&mut footer).ok()?;
    let body = footer.strip_suffix(mcap::MAGIC)?;
    let Record::Footer(footer) = mcap::parse_record(*body.first()?, body.get(9..)?).ok()? else { return None };
    let length = end.checked_sub(footer.summary_start).filter(|length| *length <= MAX_RECORD_BYTES)?;
    if footer.summary_start == 0 {
        return None;
    }
    file.seek(SeekFrom::Start(footer.summary_start)).ok()?;
    let mut bytes = Vec::new();
    file.take(length).read_to_end(&mut bytes).ok()?;
    let (mut topics, mut counts) = (BTreeMap::new(), None);
    let mut rest = bytes.as_slice();
    while let Some((head, behind)) = rest.split_first_chunk::<9>() {
        let length = usize::try_from(u64::from_le_bytes(*head.last_chunk()?)).ok()?;
        let body = behind.get(..length)?;
        rest = &behind[length..];
        if !matches!(head[0], op::CHANNEL | op::STATISTICS) {
            continue;
        }
        match mcap::parse_record(head[0], body).ok()? {
            Record::Channel(channel) => drop(topics.insert(channel.id, channel.topic)),
            Record::Statistics(statistics) => counts = Some(statistics.channel_message_counts),
            _ => {}
        }
    }
    let mut by_topic = BTreeMap::new();
    for (id, count) in counts? {
        *by_topic.entry(topics.get(&id)?.clone()).or_insert(0) += count;
    }
    Some(by_topic)
}

/// Why a walk ends before the end of its file.
enum Stop {
    /// The bytes end, or are not what they should be.
    Broken(String),
    /// The recording claims what is not read.
    Refused(String),
}

impl From<io::Error> for Stop {
    fn from(why: io::Error) -> Stop {
        Stop::Broken(if why.kind() == io::ErrorKind::UnexpectedEof {
            "its end is missing".to_owned()
        } else {
            why.to_string()
        })
    }
}

/// A walk through the records of one file.
struct Walk<'a> {
    /// The sink's numbers of the channels that are wanted.
    channels: HashMap<u16, usize>,
    /// Names of the schemas.
    types: HashMap<u16, String>,
    sink: &'a mut dyn Sink,
    warnings: Vec<String>,
    messages: u64,
    /// Bytes that the chunks of all files so far claim before compression, and the most that they may.
    expanded: &'a mut u64,
    budget: u64,
}

impl Walk<'_> {
    fn file(&mut self, stream: &mut dyn Read) -> Result<(), Stop> {
        let mut magic = [0; mcap::MAGIC.len()];
        stream.read_exact(&mut magic)?;
        if magic != *mcap::MAGIC {
            return Err(Stop::Broken("it does not begin as MCAP".to_owned()));
        }
        loop {
            let Some((op, length)) = head(stream)? else {
                return Err(Stop::Broken("its end is missing".to_owned()));
            };
            match op {
                op::FOOTER => return Ok(()),
                0 => return Err(Stop::Broken("a record has no type".to_owned())),
                op::CHUNK => self.chunk(&mut Read::take(&mut *stream, length))?,
                _ => self.record(op, length, stream)?,
            }
            if self.sink.is_done() {
                return Ok(());
            }
        }
    }

    /// A record that is no chunk.
    fn record(&mut self, op: u8, length: u64, stream: &mut dyn Read) -> Result<(), Stop> {
        match op {
            op::HEADER if length <= MAX_RECORD_BYTES => {
                if let Record::Header(header) = parsed(op, &body(stream, length)?)? {
                    self.sink.written_by(&header.library);
                }
            }
            op::SCHEMA => {
                if let Record::Schema { header, .. } = parsed(op, &body(stream, length)?)? {
                    self.types.insert(header.id, header.name);
                }
            }
            op::CHANNEL => {
                if let Record::Channel(channel) = parsed(op, &body(stream, length)?)? {
                    let kind = self.types.get(&channel.schema_id).map_or("", String::as_str);
                    let number = self.sink.topic(&channel.topic, kind, &channel.message_encoding);
                    if let Some(number) = number {
                        self.channels.insert(channel.id, number);
                    }
                }
            }
            op::MESSAGE => self.message(length, stream)?,
            _ => skip(stream, length)?,
        }
        Ok(())
    }

    fn message(&mut self, length: u64, stream: &mut dyn Read) -> Result<(), Stop> {
        let Some(data) = length.checked_sub(MESSAGE_HEADER_BYTES) else {
            return Err(Stop::Broken("a message is too short".to_owned()));
        };
        let header = body(stream, MESSAGE_HEADER_BYTES)?;
        let Record::Message { header, .. } = parsed(op::MESSAGE, &header)? else { return Ok(()) };
        match self.channels.get(&header.channel_id) {
            Some(topic) if data <= MAX_RECORD_BYTES => {
                let data = body(stream, data)?;
                self.sink.message(*topic, header.log_time, &data).map_err(Stop::Refused)?;
            }
            _ => skip(stream, data)?,
        }
        self.messages += 1;
        Ok(())
    }

    /// The records of a chunk. One that is damaged is left out; the file goes on behind it.
    fn chunk<R: Read>(&mut self, stream: &mut io::Take<R>) -> Result<(), Stop> {
        let fixed = body(stream, 8 + 8 + 8 + 4 + 4)?;
        let field = |from: usize| fixed[from..].first_chunk().copied().map(u64::from_le_bytes).unwrap_or_default();
        let word = |from: usize| fixed[from..].first_chunk().copied().map(u32::from_le_bytes).unwrap_or_default();
        let (claimed, crc, named) = (field(16), word(24), word(28));
        if claimed > MAX_CHUNK_BYTES {
            let why = format!("a chunk claims {claimed} bytes; at most {MAX_CHUNK_BYTES} are read");
            return Err(Stop::Refused(why));
        }
        *self.expanded = self.expanded.saturating_add(claimed.max(CHUNK_BYTES));
        if *self.expanded > self.budget {
            let why = format!(
                "its chunks claim {} bytes and more; at most {} are read: {MAX_EXPANSION} times the recording's plus {FREE_BYTES}",
                self.expanded, self.budget
            );
            return Err(Stop::Refused(why));
        }
        if named > MAX_COMPRESSION_BYTES {
            return Err(Stop::Broken(format!("a chunk's compression has a name of {named} bytes")));
        }
        let compression = String::from_utf8_lossy(&body(stream, u64::from(named))?).into_owned();
        let _stored = body(stream, 8)?;
        self.sink.mark();
        let before = self.messages;
        let (inside, sum, short) = self.inside(decompressed(stream, &compression)?, claimed);
        let missing = stream.limit();
        let drained = io::copy(stream, &mut io::sink())?;
        let whole = drained == missing;
        if let Err(Stop::Refused(why)) = inside {
            return Err(Stop::Refused(why));
        }
        if !whole {
            // What came before the break was checked by nothing but its decoder.
            return Err(Stop::Broken("its last chunk is not whole".to_owned()));
        }
        let damage = match inside {
            Err(Stop::Broken(why)) => Some(why),
            _ if self.sink.is_done() => None,
            _ if short > 0 => Some(format!("{short} bytes are missing")),
            _ if crc != 0 && crc != sum => Some("its check sum is another".to_owned()),
            _ => None,
        };
        if let Some(why) = damage {
            self.sink.drop_since_mark();
            self.messages = before;
            self.warnings.push(format!("a chunk is damaged ({why}); its messages are left out"));
        }
        Ok(())
    }

    /// The records of a chunk of `claimed` bytes; also its check sum, and how many bytes it lacks.
    fn inside(&mut self, inner: Box<dyn Read + '_>, claimed: u64) -> (Result<(), Stop>, u32, u64) {
        let mut checked = Checked { inner, crc: crc32fast::Hasher::new(), rest: claimed };
        let ended = self.records(&mut checked);
        (ended, checked.crc.finalize(), checked.rest)
    }

    fn records(&mut self, records: &mut dyn Read) -> Result<(), Stop> {
        while let Some((op, length)) = head(records)? {
            self.record(op, length, records)?;
            if self.sink.is_done() {
                break;
            }
        }
        Ok(())
    }
}

/// The bytes of a chunk as they were before compression.
fn decompressed<'a>(stream: &'a mut dyn Read, compression: &str) -> Result<Box<dyn Read + 'a>, Stop> {
    Ok(match compression {
        "" => Box::new(stream),
        "zstd" => Box::new(BufReader::new(zstd::stream::read::Decoder::new(stream)?)),
        "lz4" => Box::new(lz4_flex::frame::FrameDecoder::new(stream)),
        other => {
            let why = format!("its chunks are compressed by {other}; zstd, lz4 and none are read");
            return Err(Stop::Refused(why));
        }
    })
}

/// A stream of at most `rest` bytes with their check sum.
struct Checked<'a> {
    inner: Box<dyn Read + 'a>,
    crc: crc32fast::Hasher,
    rest: u64,
}

impl Read for Checked<'_> {
    fn read(&mut self, to: &mut [u8]) -> io::Result<usize> {
        let most = usize::try_from(self.rest).unwrap_or(usize::MAX).min(to.len());
        let count = self.inner.read(&mut to[..most])?;
        self.crc.update(&to[..count]);
        self.rest -= count as u64;
        Ok(count)
    }
}

/// Type and length of the next record; none at the end.
fn head(stream: &mut dyn Read) -> Result<Option<(u8, u64)>, Stop> {
    let mut head = [0; 9];
    if stream.read(&mut head[..1])? == 0 {
        return Ok(None);
    }
    stream.read_exact(&mut head[1..])?;
    let length = head[1..].first_chunk().copied().map(u64::from_le_bytes).unwrap_or_default();
    Ok(Some((head[0], length)))
}

/// `length` bytes. Memory grows with what comes, not with what is claimed.
fn body(stream: &mut dyn Read, length: u64) -> Result<Vec<u8>, Stop> {
    if length > MAX_RECORD_BYTES {
        return Err(Stop::Broken(format!("a record claims {length} bytes; at most {MAX_RECORD_BYTES} are read")));
    }
    let mut bytes = Vec::with_capacity(length.min(1 << 16) as usize);
    stream.take(length).read_to_end(&mut bytes)?;
    if (bytes.len() as u64) < length {
        return Err(io::Error::from(io::ErrorKind::UnexpectedEof).into());
    }
    Ok(bytes)
}

fn skip(stream: &mut dyn Read, length: u64) -> Result<(), Stop> {
    let passed = io::copy(&mut stream.take(length), &mut io::sink())?;
    if passed < length { Err(io::Error::from(io::ErrorKind::UnexpectedEof).into()) } else { Ok(()) }
}

fn parsed(op: u8, body: &[u8]) -> Result<Record<'_>, Stop> {
    mcap::parse_record(op, body).map_err(|why| Stop::Broken(why.to_string()))
}
