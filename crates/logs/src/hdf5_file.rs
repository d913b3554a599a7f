//! HDF5 files (`h5py`, ACT, robomimic, DROID, MATLAB 7.3): data sets of numbers, one a name, and structures of numbers.
//!
//! A data set with one dimension is a column, one with two a column a joint: `group/name[i]`. A field of a structure is a data set
//! `group/name/field`. Rows are the samples; a data set whose second dimension is the samples is turned. Episodes, groups whose
//! names differ in a number alone, are read one after another.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;
use std::sync::Arc;

use hdf5_reader::group::Group;
use hdf5_reader::{
    BlockCacheStorage, ByteOrder, Dataset, Datatype, FileStorage, FilterRegistry, Hdf5File, OpenOptions,
};

use crate::arrays::{Budget, Shape, places, samples};
use crate::columns::{Table, Wanted};
use crate::error::{LogError, LogFault};
use crate::listing::{CONVENTIONS, Column, Conventions, Listing, Topic};
use crate::numbers::{Kind, Numbers};
use crate::{episodes, guess, lzf};

/// First bytes of a file.
const MAGIC: [u8; 8] = *b"\x89HDF\r\n\x1a\n";
/// Places where a file may have them: behind a block of its writer, such as that of MATLAB 7.3 \[bytes\].
const MAGIC_AT: [u64; 4] = [0, 512, 1024, 2048];
/// Most data sets and groups.
const MAX_OBJECTS: usize = 1 << 16;
/// Most levels of groups.
const MAX_DEPTH: usize = 16;
/// Largest decoded chunk of a data set \[bytes\].
const MAX_CHUNK_BYTES: usize = 64 << 20;
/// Bytes of the largest number.
const NUMBER_BYTES: u64 = 8;
/// Names that are listed in a warning.
const MOST_LISTED: usize = 5;
/// What groups of episodes are called, before their number.
const EPISODE_WORDS: [&str; 8] = ["demo", "ep", "episode", "rollout", "run", "traj", "trajectory", "trial"];

/// A data set of numbers, or a field of a structure.
#[derive(Clone, Debug)]
struct Array {
    /// Its name.
    name: String,
    /// Where its data set is.
    place: String,
    kind: Kind,
    lengths: Vec<usize>,
    /// Bytes from one entry of the first dimension to the next, and before the first.
    stride: usize,
    offset: usize,
}

/// Arrays by name, and their samples.
struct Episode {
    arrays: BTreeMap<String, Array>,
    rows: usize,
}

impl Episode {
    fn new(arrays: Vec<Array>) -> Episode {
        let rows = samples(arrays.iter().map(|array| (array.name.as_str(), array.lengths.as_slice())));
        Episode { arrays: arrays.into_iter().map(|array| (array.name.clone(), array)).collect(), rows }
    }

    /// The array of a name with its shape, where it has samples.
    fn array(&self, name: &str) -> Option<(&Array, Shape)> {
        let array = self.arrays.get(name)?;
        Some((array, Shape::of(&array.lengths, self.rows)?))
    }
}

/// What a file holds.
struct Contents {
    file: Hdf5File,
    /// Size of the file.
    bytes: u64,
    /// Episodes; one where the file has none.
    episodes: Vec<Episode>,
    /// Names of the arrays that have samples in every episode.
    names: Vec<String>,
    conventions: Conventions,
    warnings: Vec<String>,
}

impl Contents {
    fn open(path: &Path) -> Result<Contents, LogError> {
        let io = |why| LogFault::Io(why).at(path);
        let bytes = std::fs::metadata(path).map_err(io)?.len();
        let mut filters = FilterRegistry::new();
        filters.register(
            lzf::FILTER,
            Box::new(|filter, bytes, _| {
                // Entry 2: bytes of a chunk.
                let most = filter.client_data.get(2).map_or(MAX_CHUNK_BYTES, |most| *most as usize);
                lzf::decode(bytes, most.min(MAX_CHUNK_BYTES))
                    .map_err(|why| hdf5_reader::error::Error::Other(why.to_owned()))
            }),
        );
        let most = Budget::new(bytes).most().saturating_mul(NUMBER_BYTES);
        let options = OpenOptions::default()
            .with_filter_registry(filters)
            .with_max_chunk_bytes(MAX_CHUNK_BYTES)
            .with_max_read_bytes(usize::try_from(most).unwrap_or(usize::MAX));
        // Not mapped into memory: a file that is cut while it is read is an error.
        let storage = FileStorage::open(path).map_err(|why| fault(&why).at(path))?;
        let storage = Arc::new(BlockCacheStorage::with_defaults(Arc::new(storage)));
        let file = Hdf5File::from_storage_with_options(storage, options).map_err(|why| fault(&why).at(path))?;
        let root = file.root_group().map_err(|why| fault(&why).at(path))?;
        let text = root.attribute(CONVENTIONS).and_then(|attribute| attribute.read_string());
        let conventions = text.map_or(Conventions::Recorder, |text| Conventions::stated(&text));
        let mut walk = Walk::default();
        walk.group(&root, "", 0);
        let Walk { arrays, mut warnings, others, .. } = walk;
        if !others.is_empty() {
            warnings.push(format!("not read, as they are no tables of numbers: {}", listed(&others)));
        }
        let episodes = split(arrays.into_values().flatten().collect());
        let first = &episodes[0];
        let (names, without): (Vec<String>, Vec<String>) = first.arrays.keys().cloned().partition(|name| {
            let found = first.array(name);
            let is_like = |(array, shape): (&Array, Shape)| {
                found.is_some_and(|(first, of_first)| array.kind == first.kind && shape.width == of_first.width)
            };
            episodes.iter().all(|episode| episode.array(name).is_some_and(is_like))
        });
        if !without.is_empty() {
            let what = if episodes.len() > 1 {
                "the same in every episode".to_owned()
            } else {
                format!("of {} samples", first.rows)
            };
            warnings.push(format!("not read, as they are not {what}: {}", listed(&without)));
        }
        Ok(Contents { file, bytes, episodes, names, conventions, warnings })
    }
}

/// Whether a file is one of HDF5.
pub(crate) fn is_format(path: &Path) -> bool {
    let begins = |mut file: &File, at: u64| -> std::io::Result<bool> {
        let mut bytes = [0; MAGIC.len()];
        file.seek(SeekFrom::Start(at))?;
        file.read_exact(&mut bytes)?;
        Ok(bytes == MAGIC)
    };
    File::open(path).is_ok_and(|file| MAGIC_AT.iter().any(|at| begins(&file, *at).unwrap_or(false)))
}

/// Collects the data sets of numbers.
#[derive(Default)]
struct Walk {
    /// By the place of their data set.
    arrays: BTreeMap<String, Vec<Array>>,
    /// Data sets that are no tables of numbers.
    others: Vec<String>,
    warnings: Vec<String>,
    /// Addresses of groups and data sets, with the name of the link: several links may lead to one.
    seen: BTreeMap<u64, String>,
}

impl Walk {
    fn group(&mut self, group: &Group, path: &str, depth: usize) {
        if self.seen.insert(group.address(), path.to_owned()).is_some() {
            return;
        }
        if depth > MAX_DEPTH {
            self.warnings.push(format!("groups below {path} are not read: they are more than {MAX_DEPTH} levels deep"));
            return;
        }
        let (groups, sets) = match group.member_names() {
            Ok(names) => names,
            Err(why) => {
                self.warnings.push(format!("group {path}/: {why}; it is not read"));
                return;
            }
        };
        let below = |name: &str| if path.is_empty() { name.to_owned() } else { format!("{path}/{name}") };
        for name in sets {
            if self.seen.len() >= MAX_OBJECTS {
                self.warnings.push(format!("of its data sets and groups the first {MAX_OBJECTS} are read"));
                return;
            }
            let place = below(&name);
            match group.dataset(&name) {
                Ok(set) => self.data_set(&set, place),
                Err(why) => self.warnings.push(format!("data set {place}: {why}; it is not read")),
            }
        }
        for name in groups {
            if self.seen.len() >= MAX_OBJECTS {
                return;
            }
            let path = below(&name);
            match group.group(&name) {
                Ok(group) => self.group(&group, &path, depth + 1),
                Err(why) => self.warnings.push(format!("group {path}: {why}; it is not read")),
            }
        }
    }

    fn data_set(&mut self, set: &Dataset, place: String) {
        if let Some(name) = self.seen.get(&set.address()) {
            // The name that says what it is.
            if guess::word(name).is_some() || guess::word(&place).is_none() {
                return;
            }
            self.arrays.remove(name);
        }
        self.seen.insert(set.address(), place.clone());
        let lengths: Option<Vec<usize>> = set.shape().iter().map(|length| usize::try_from(*length).ok()).collect();
        let Some(lengths) = lengths.filter(|lengths| (1..=2).contains(&lengths.len())) else {
            self.others.push(place);
            return;
        };
        if let Datatype::Compound { size, fields } = set.dtype() {
            let stride = *size as usize;
            for field in fields {
                let name = format!("{place}/{}", field.name);
                let offset = field.byte_offset as usize;
                let (base, inner) = match &field.datatype {
                    Datatype::Array { base, dims } => (&**base, dims.as_slice()),
                    other => (other, [].as_slice()),
                };
                let inner: Option<Vec<usize>> = inner.iter().map(|length| usize::try_from(*length).ok()).collect();
                match (kind_of(base), inner) {
                    (Some(kind), Some(inner)) if lengths.len() == 1 && inner.len() <= 1 => {
                        let lengths = [&lengths[..], &inner[..]].concat();
                        let array = Array { name, place: place.clone(), kind, lengths, stride, offset };
                        self.arrays.entry(place.clone()).or_default().push(array);
                    }
                    _ => self.others.push(name),
                }
            }
            return;
        }
        match kind_of(set.dtype()) {
            Some(kind) => {
                let stride = kind.bytes().saturating_mul(lengths.get(1).copied().unwrap_or(1));
                let array = Array { name: place.clone(), place: place.clone(), kind, lengths, stride, offset: 0 };
                self.arrays.insert(place, vec![array]);
            }
            None => self.others.push(place),
        }
    }
}

fn kind_of(of: &Datatype) -> Option<Kind> {
    let is_big = |order: &ByteOrder| *order == ByteOrder::BigEndian;
    match of {
        Datatype::FloatingPoint { size, byte_order } => Kind::float(usize::from(*size), is_big(byte_order)),
        Datatype::FixedPoint { size, signed, byte_order } => {
            Kind::integer_of(usize::from(*size), *signed, is_big(byte_order))
        }
        _ => None,
    }
}

/// Splits arrays into episodes; one where there are none. Episodes are groups beside each other whose names differ in a number, if
/// they are called so, or if their numbers of samples differ.
fn split(arrays: Vec<Array>) -> Vec<Episode> {
    // By what stands before the number: number, and arrays with their name without it.
    let mut found: BTreeMap<(usize, String), BTreeMap<u64, Vec<Array>>> = BTreeMap::new();
    for array in &arrays {
        let parts: Vec<&str> = array.name.split('/').collect();
        for (depth, part) in parts[..parts.len() - 1].iter().enumerate() {
            let stem = part.trim_end_matches(|c: char| c.is_ascii_digit());
            let Ok(number) = part[stem.len()..].parse::<u64>() else { continue };
            let name = [&parts[..depth], &parts[depth + 1..]].concat().join("/");
            let before = [&parts[..depth], &[stem]].concat().join("/");
            let episode = found.entry((depth, before)).or_default().entry(number).or_default();
            episode.push(Array { name, ..array.clone() });
        }
    }
    for ((_, before), groups) in found {
        let stem = before.rsplit('/').next().unwrap_or(&before);
        let stem = stem.trim_end_matches(|c: char| !c.is_alphanumeric()).to_lowercase();
        let is_called_so = EPISODE_WORDS.contains(&stem.as_str());
        let episodes: Vec<Episode> = groups.into_values().map(Episode::new).collect();
        let lengths: BTreeSet<usize> = episodes.iter().map(|episode| episode.rows).collect();
        if episodes.len() > 1 && (is_called_so || lengths.len() > 1) {
            return episodes;
        }
    }
    vec![Episode::new(arrays)]
}

fn listed(names: &[String]) -> String {
    let shown = names.iter().take(MOST_LISTED).cloned().collect::<Vec<_>>().join(", ");
    if names.len() > MOST_LISTED { format!("{shown} and {} more", names.len() - MOST_LISTED) } else { shown }
}

/// The columns of a file.
pub(crate) fn list(path: &Path) -> Result<Listing, LogError> {
    let Contents { episodes, names, conventions, warnings, .. } = Contents::open(path)?;
    let arrays = names.iter().filter_map(|name| episodes[0].array(name));
    let columns = arrays.flat_map(|(array, shape)| {
        let column = |name| Column { name, is_integer: array.kind.is_integer(), ..Column::default() };
        shape.names(&array.name, conventions).into_iter().map(column)
    });
    let columns: Vec<Column> = columns.collect();
    let rows: u64 = episodes.iter().map(|episode| episode.rows as u64).sum();
    let messages = (!columns.is_empty()).then_some(rows);
    let topic = Topic { name: String::new(), kind: "data sets".to_owned(), messages, is_read: true };
    Ok(Listing { topics: vec![topic], columns, warnings, conventions, ..Listing::default() })
}

/// Reads the columns that `wanted` picks by name, data set by data set.
pub(crate) fn read(path: &Path, wanted: Wanted<'_>) -> Result<Table, LogError> {
    let Contents { file, bytes, episodes, names, conventions, warnings } = Contents::open(path)?;
    let mut budget = Budget::new(bytes);
    let mut table = Table { warnings, ..Table::default() };
    let starts: Vec<usize> = episodes
        .iter()
        .scan(0, |next, episode| {
            let start = *next;
            *next += episode.rows;
            Some(start)
        })
        .collect();
    for name in names {
        let Some((_, shape)) = episodes[0].array(&name) else { continue };
        let columns = shape.names(&name, conventions);
        let places = places(&columns, wanted);
        let (kept, unused): (Vec<_>, Vec<_>) = columns.into_iter().zip(&places).partition(|(_, place)| place.is_some());
        table.unused.extend(unused.into_iter().map(|(column, _)| column));
        if kept.is_empty() {
            continue;
        }
        let mut numbers: Vec<Numbers> = kept.iter().map(|_| Numbers::default()).collect();
        for (array, shape) in episodes.iter().filter_map(|episode| episode.array(&name)) {
            let of_array = |why: String| {
                LogFault::Format { format: "HDF5", why: format!("data set {}: {why}", array.place) }.at(path)
            };
            let size = (array.lengths[0] as u64).saturating_mul(array.stride as u64);
            budget.take(size.div_ceil(NUMBER_BYTES)).map_err(of_array)?;
            let bytes = file.dataset(&array.place).and_then(|set| set.read_raw_bytes());
            let bytes = bytes.map_err(|why| of_array(why.to_string()))?;
            append(&mut numbers, &bytes, array, shape, &places).map_err(of_array)?;
        }
        let is_time = guess::word(&name) == Some("time");
        for ((column, _), numbers) in kept.into_iter().zip(numbers) {
            let mut values = numbers.into_values();
            if is_time && starts.len() > 1 {
                let between = episodes::STEPS_BETWEEN * episodes::median_step(&values, &starts);
                episodes::one_after_the_other(&mut values, &starts, between);
            }
            table.columns.insert(column, values);
        }
    }
    if starts.len() > 1 {
        table.warnings.push(episodes::note(starts.len(), &format!("{} steps", episodes::STEPS_BETWEEN)));
    }
    Ok(table)
}

/// Appends the numbers of an array to the columns that have a place.
fn append(
    columns: &mut [Numbers],
    bytes: &[u8],
    array: &Array,
    shape: Shape,
    places: &[Option<usize>],
) -> Result<(), String> {
    let width = array.lengths.get(1).copied().unwrap_or(1);
    for k in 0..shape.rows * shape.width {
        let Some(place) = places[shape.column(k, false)] else { continue };
        let at = (k / width) * array.stride + array.offset + (k % width) * array.kind.bytes();
        let number = bytes.get(at..at + array.kind.bytes());
        let number = number.ok_or_else(|| format!("it has {} bytes, fewer than its shape states", bytes.len()))?;
        columns[place].push(array.kind, number);
    }
    Ok(())
}

fn fault(why: &hdf5_reader::error::Error) -> LogFault {
    LogFault::Format { format: "HDF5", why: why.to_string() }
}
