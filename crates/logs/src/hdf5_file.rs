//! HDF5 files (`h5py`, robomimic, DROID, MATLAB 7.3): data sets of numbers, one a name, and structures of numbers.
//!
//! A data set with one dimension is a column, one with two a column a joint: `group/name[i]`. A field of a structure is a data set
//! `group/name/field`. Rows are the samples; a data set whose second dimension is the samples is turned. Episodes, groups such as
//! `demo_0` and `demo_1`, are read one after another.

use std::collections::BTreeMap;
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
    fn new(mut arrays: Vec<Array>) -> Episode {
        // What is empty has no samples.
        arrays.retain(|array| !array.lengths.contains(&0));
        let rows = samples(arrays.iter().map(|array| (array.name.as_str(), array.lengths.as_slice())));
        Episode { arrays: arrays.into_iter().map(|array| (array.name.clone(), array)).collect(), rows }
    }

    /// The array of a name with its shape, where it has samples.
    fn array(&self, name: &str) -> Option<(&Array, Shape)> {
        let array = self.arrays.get(name)?;
        Some((array, Shape::with_rows(&array.lengths, self.rows)?))
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
        let Walk { arrays, mut warnings, others, damaged, .. } = walk;
        if !damaged.is_empty() {
            warnings.push(format!("not read, as they are damaged or of an unknown kind: {}", listed(&damaged)));
        }
        if !others.is_empty() {
            warnings.push(format!("not read, as they are no tables of numbers: {}", listed(&others)));
        }
        let episodes = split(arrays.into_values().flatten().collect(), &mut warnings);
        let first = &episodes[0];
        let (names, mismatched): (Vec<String>, Vec<String>) = first.arrays.keys().cloned().partition(|name| {
            let found = first.array(name);
            let is_like = |(array, shape): (&Array, Shape)| {
                found.is_some_and(|(first, of_first)| array.kind == first.kind && shape.width == of_first.width)
            };
            episodes.iter().all(|episode| episode.array(name).is_some_and(is_like))
        });
        if !mismatched.is_empty() {
            let what = if episodes.len() > 1 {
                "the same in every episode".to_owned()
            } else {
                format!("of {} samples", first.rows)
            };
            warnings.push(format!("not read, as they are not {what}: {}", listed(&mismatched)));
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
    /// What cannot be read, with the reason.
    damaged: Vec<String>,
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
            self.damaged.push(format!("groups below {path} (more than {MAX_DEPTH} levels deep)"));
            return;
        }
        let (groups, sets) = match group.member_names() {
            Ok(names) => names,
            Err(why) => {
                self.damaged.push(format!("group {path}/ ({why})"));
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
                Err(why) => self.damaged.push(format!("data set {place} ({why})")),
            }
        }
        for name in groups {
            if self.seen.len() >= MAX_OBJECTS {
                return;
            }
            let path = below(&name);
            match group.group(&name) {
                Ok(group) => self.group(&group, &path, depth + 1),
                Err(why) => self.damaged.push(format!("group {path} ({why})")),
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

fn kind_of(datatype: &Datatype) -> Option<Kind> {
    let is_big = |order: &ByteOrder| *order == ByteOrder::BigEndian;
    match datatype {
        Datatype::FloatingPoint { size, byte_order } => Kind::float(usize::from(*size), is_big(byte_order)),
        Datatype::FixedPoint { size, signed, byte_order } => {
            Kind::integer_of(usize::from(*size), *signed, is_big(byte_order))
        }
        _ => None,
    }
}

/// Arrays of groups, by the number of their name and the name.
type Groups = BTreeMap<(u64, String), Vec<Array>>;

/// Splits arrays into episodes; a file without episodes is one. Episodes are groups of one group that are called so, and whose names
/// differ in a number. Of several sets of episodes, and of the arrays outside them, that with the most rows is read; `warnings` lists
/// the rest.
fn split(arrays: Vec<Array>, warnings: &mut Vec<String>) -> Vec<Episode> {
    // By where they are and what stands before the number: number and name, and arrays with their name without the group's.
    let mut found: BTreeMap<(String, String), Groups> = BTreeMap::new();
    let mut ungrouped = Vec::new();
    for array in arrays {
        let parts: Vec<&str> = array.name.split('/').collect();
        let episode = parts[..parts.len() - 1].iter().enumerate().find_map(|(depth, part)| {
            let stem = part.trim_end_matches(|c: char| c.is_ascii_digit());
            let number = part[stem.len()..].parse::<u64>().ok()?;
            let word = stem.trim_end_matches(|c: char| !c.is_alphanumeric()).to_lowercase();
            EPISODE_WORDS.contains(&word.as_str()).then_some((depth, stem, number))
        });
        let Some((depth, stem, number)) = episode else {
            ungrouped.push(array);
            continue;
        };
        let name = [&parts[..depth], &parts[depth + 1..]].concat().join("/");
        let set = (parts[..depth].join("/"), stem.to_owned());
        let group = (number, parts[depth].to_owned());
        found.entry(set).or_default().entry(group).or_default().push(Array { name, ..array });
    }
    let mut sets: Vec<(String, Vec<Episode>)> = Vec::new();
    for ((place, stem), groups) in found {
        let mut episodes: Vec<Episode> = groups.into_values().map(Episode::new).collect();
        let count = episodes.len();
        episodes.retain(|episode| episode.rows > 0);
        if episodes.len() < count {
            warnings
                .push(format!("{} episodes of {place}/{stem} have no rows; they are left out", count - episodes.len()));
        }
        sets.push((format!("{place}/{stem}*"), episodes));
    }
    if !ungrouped.is_empty() || sets.is_empty() {
        let names: Vec<String> = ungrouped.iter().map(|array| array.name.clone()).collect();
        sets.push((listed(&names), vec![Episode::new(ungrouped)]));
    }
    let rows = |(_, episodes): &(String, Vec<Episode>)| episodes.iter().map(|episode| episode.rows).sum::<usize>();
    let most = (0..sets.len()).max_by_key(|k| rows(&sets[*k])).unwrap_or(0);
    let (_, episodes) = sets.swap_remove(most);
    if !sets.is_empty() {
        let others: Vec<String> = sets.into_iter().map(|(name, _)| name).collect();
        warnings.push(format!("not read, as another part of the file has more rows: {}", others.join("; ")));
    }
    if episodes.is_empty() { vec![Episode::new(Vec::new())] } else { episodes }
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

/// An array of which columns are read.
struct Selected {
    name: String,
    /// Place among the read columns of each of its columns.
    places: Vec<Option<usize>>,
    columns: Vec<String>,
    numbers: Vec<Numbers>,
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
    let mut selected: Vec<Selected> = Vec::new();
    for name in names {
        let Some((_, shape)) = episodes[0].array(&name) else { continue };
        let columns = shape.names(&name, conventions);
        let places = places(&columns, wanted);
        let (kept, unused): (Vec<_>, Vec<_>) = columns.into_iter().zip(&places).partition(|(_, place)| place.is_some());
        table.unused.extend(unused.into_iter().map(|(column, _)| column));
        if !kept.is_empty() {
            let columns: Vec<String> = kept.into_iter().map(|(column, _)| column).collect();
            let numbers = columns.iter().map(|_| Numbers::default()).collect();
            selected.push(Selected { name, places, columns, numbers });
        }
    }
    for episode in &episodes {
        // Fields of one structure come one after the other: it is read once.
        let mut last: Option<(&str, Vec<u8>)> = None;
        for Selected { name, places, numbers, .. } in &mut selected {
            let Some((array, shape)) = episode.array(name) else { continue };
            let of_array = |why: String| {
                LogFault::Format { format: "HDF5", why: format!("data set {}: {why}", array.place) }.at(path)
            };
            let size = (array.lengths[0] as u64).saturating_mul(array.stride as u64).div_ceil(NUMBER_BYTES);
            budget.take(size.max(shape.cells())).map_err(of_array)?;
            if last.as_ref().is_none_or(|(place, _)| *place != array.place) {
                // One data set is in memory at a time.
                drop(last.take());
                let bytes = file.dataset(&array.place).and_then(|set| set.read_raw_bytes());
                last = Some((&array.place, bytes.map_err(|why| of_array(why.to_string()))?));
            }
            let bytes = last.as_ref().map_or(&[][..], |(_, bytes)| bytes);
            append(numbers, bytes, array, shape, places).map_err(of_array)?;
        }
    }
    for Selected { name, columns, numbers, .. } in selected {
        let is_time = guess::word(&name) == Some("time");
        for (column, numbers) in columns.into_iter().zip(numbers) {
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
