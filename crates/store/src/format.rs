//! The bytes of a file, little-endian:
//!
//! ```text
//! "RIVETSTO"  version u32  length u64 (of the whole file)
//! sections:   tag [u8; 4]  length u64  bytes
//!   HEAD      generation u64, model hash u64, robot's name (the rest, UTF-8)
//!   PARA      epoch u64, seq u64, count u64, values f64 x count, standard deviations f64 x count
//!   SUPV      states u8 x count, excitation f64 x count; absent in files of earlier programs
//!   MEMO      fingerprint u64, numbers f64 x the rest; absent where the estimator's own memory was not at hand
//! checksum    CRC-32 of everything before, u32
//! ```
//!
//! A reader skips sections it does not know.

use crate::error::Problem;

/// Version that this program writes; it reads this and every earlier one.
pub const FORMAT_VERSION: u32 = 1;

const MAGIC: &[u8; 8] = b"RIVETSTO";
const HEADER: usize = 8 + 4 + 8;
const CHECKSUM: usize = 4;

/// What is stored.
#[derive(Clone, Debug, PartialEq)]
pub struct Knowledge {
    /// Says what the numbers mean ([`Parameters`] of another model are not used).
    pub model_hash: u64,
    /// Base parameters.
    pub parameters: Parameters,
    /// What the supervision had decided about each; `None` in files of programs that did not store it.
    pub supervision: Option<Supervision>,
    /// All that the estimator had learnt, for one that is made alike.
    pub memory: Option<Memory>,
}

/// The estimator's own numbers: sums of its window, covariance, noise, decisions. Only it knows what they mean.
#[derive(Clone, Debug, PartialEq)]
pub struct Memory {
    /// Says which estimator can read them.
    pub fingerprint: u64,
    /// The numbers.
    pub numbers: Vec<f64>,
}

/// What the supervision had decided, one entry a parameter.
#[derive(Clone, Debug, PartialEq)]
pub struct Supervision {
    /// A `ParameterState` as it travels on the bus: 0 never identified, 1 moving, 2 held.
    pub state: Vec<u8>,
    /// How much the window said about it, 0 to 1.
    pub excitation: Vec<f64>,
}

/// Base parameters as they were published.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameters {
    /// Epoch of the publication.
    pub epoch: u64,
    /// Number of the last sample that went in.
    pub seq: u64,
    /// Values, in each parameter's unit.
    pub values: Vec<f64>,
    /// Standard deviations, in each parameter's unit; as many.
    pub std: Vec<f64>,
}

/// One file's content.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Entry {
    pub(crate) generation: u64,
    pub(crate) robot: String,
    pub(crate) knowledge: Knowledge,
}

pub(crate) fn encode(entry: &Entry) -> Vec<u8> {
    let mut head = Vec::new();
    head.extend(entry.generation.to_le_bytes());
    head.extend(entry.knowledge.model_hash.to_le_bytes());
    head.extend(entry.robot.as_bytes());
    let p = &entry.knowledge.parameters;
    let mut para = Vec::with_capacity(24 + 16 * p.values.len());
    for number in [p.epoch, p.seq, p.values.len() as u64] {
        para.extend(number.to_le_bytes());
    }
    for value in p.values.iter().chain(&p.std) {
        para.extend(value.to_le_bytes());
    }
    let mut sections = vec![(b"HEAD", head), (b"PARA", para)];
    if let Some(supervision) = &entry.knowledge.supervision {
        let excitation = supervision.excitation.iter().flat_map(|x| x.to_le_bytes());
        sections.push((b"SUPV", supervision.state.iter().copied().chain(excitation).collect()));
    }
    if let Some(memory) = &entry.knowledge.memory {
        let numbers = memory.numbers.iter().flat_map(|x| x.to_le_bytes());
        sections.push((b"MEMO", memory.fingerprint.to_le_bytes().into_iter().chain(numbers).collect()));
    }
    let length = HEADER + CHECKSUM + sections.iter().map(|(_, bytes)| 12 + bytes.len()).sum::<usize>();
    let mut file = Vec::with_capacity(length);
    file.extend(MAGIC);
    file.extend(FORMAT_VERSION.to_le_bytes());
    file.extend((length as u64).to_le_bytes());
    for (tag, bytes) in &sections {
        file.extend(*tag);
        file.extend((bytes.len() as u64).to_le_bytes());
        file.extend(bytes.iter());
    }
    file.extend(crc32fast::hash(&file).to_le_bytes());
    file
}

/// Takes numbers from the front of a section.
struct Cursor<'a>(&'a [u8]);

impl Cursor<'_> {
    fn bytes<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (first, rest) = self.0.split_first_chunk::<N>()?;
        self.0 = rest;
        Some(*first)
    }

    fn u64(&mut self) -> Option<u64> {
        self.bytes().map(u64::from_le_bytes)
    }

    fn numbers(&mut self, count: usize) -> Option<Vec<f64>> {
        (0..count).map(|_| self.bytes().map(f64::from_le_bytes)).collect()
    }
}

pub(crate) fn decode(file: &[u8]) -> Result<Entry, Problem> {
    let mut cursor = Cursor(file);
    if cursor.bytes::<8>() != Some(*MAGIC) {
        return Err(Problem::Foreign);
    }
    let (Some(version), Some(expected)) = (cursor.bytes::<4>().map(u32::from_le_bytes), cursor.u64()) else {
        return Err(Problem::Length { found: file.len() as u64, expected: HEADER as u64 });
    };
    if expected != file.len() as u64 || file.len() < HEADER + CHECKSUM {
        return Err(Problem::Length { found: file.len() as u64, expected });
    }
    let (content, checksum) = file.split_at(file.len() - CHECKSUM);
    if checksum != crc32fast::hash(content).to_le_bytes() {
        return Err(Problem::Checksum);
    }
    if version > FORMAT_VERSION {
        return Err(Problem::Version { found: version, known: FORMAT_VERSION });
    }
    let (mut head, mut parameters, mut supervision, mut memory) = (None, None, None, None);
    let mut sections = Cursor(&content[HEADER..]);
    while !sections.0.is_empty() {
        let section = sections.bytes::<4>().zip(sections.u64());
        let cut =
            section.and_then(|(tag, length)| Some((tag, sections.0.split_at_checked(usize::try_from(length).ok()?)?)));
        let (tag, (bytes, rest)) = cut.ok_or(Problem::Content("a section is longer than the file"))?;
        sections.0 = rest;
        match &tag {
            b"HEAD" => head = Some(decode_head(bytes).ok_or(Problem::Content("its head is not as it should be"))?),
            b"PARA" => parameters = Some(decode_parameters(bytes)?),
            b"SUPV" => supervision = Some(bytes),
            b"MEMO" => memory = Some(decode_memory(bytes).ok_or(Problem::Content("its memory is cut short"))?),
            _ => {}
        }
    }
    let (generation, model_hash, robot) = head.ok_or(Problem::Content("it has no head"))?;
    let parameters = parameters.ok_or(Problem::Content("it has no parameters"))?;
    let supervision = supervision.map(|bytes| decode_supervision(bytes, parameters.values.len())).transpose()?;
    Ok(Entry { generation, robot, knowledge: Knowledge { model_hash, parameters, supervision, memory } })
}

fn decode_head(bytes: &[u8]) -> Option<(u64, u64, String)> {
    let mut cursor = Cursor(bytes);
    let (generation, hash) = (cursor.u64()?, cursor.u64()?);
    Some((generation, hash, String::from_utf8(cursor.0.to_vec()).ok()?))
}

fn decode_memory(bytes: &[u8]) -> Option<Memory> {
    let mut cursor = Cursor(bytes);
    let fingerprint = cursor.u64()?;
    let count = cursor.0.len() / 8;
    let numbers = cursor.numbers(count)?;
    cursor.0.is_empty().then_some(Memory { fingerprint, numbers })
}

fn decode_supervision(bytes: &[u8], count: usize) -> Result<Supervision, Problem> {
    let whole = Problem::Content("the state of its supervision is not of as many parameters");
    let Some((state, rest)) = bytes.split_at_checked(count).filter(|(_, rest)| rest.len() == 8 * count) else {
        return Err(whole);
    };
    let excitation = Cursor(rest).numbers(count).ok_or(whole)?;
    if state.iter().any(|s| *s > 2) || !excitation.iter().all(|x| x.is_finite()) {
        return Err(Problem::Content("the state of its supervision is invalid"));
    }
    Ok(Supervision { state: state.to_vec(), excitation })
}

fn decode_parameters(bytes: &[u8]) -> Result<Parameters, Problem> {
    let mut cursor = Cursor(bytes);
    let numbers = (|| Some((cursor.u64()?, cursor.u64()?, cursor.u64()?)))();
    let (epoch, seq, count) = numbers.ok_or(Problem::Content("its parameters are cut short"))?;
    // The count decides nothing before the length has confirmed it.
    if Some(cursor.0.len() as u64) != count.checked_mul(16) {
        return Err(Problem::Content("the number of its parameters differs from its header"));
    }
    let values = cursor.numbers(count as usize).unwrap_or_default();
    let std = cursor.numbers(count as usize).unwrap_or_default();
    if !values.iter().chain(&std).all(|x| x.is_finite()) || std.iter().any(|s| *s < 0.0) {
        return Err(Problem::Content("a parameter is not finite, or its standard deviation is negative"));
    }
    Ok(Parameters { epoch, seq, values, std })
}
