//! NumPy archives (`numpy.savez`, `numpy.savez_compressed`): arrays of numbers, one a name.
//!
//! An array with one dimension is a column, one with two a column a joint: `name[i]`. Rows are the samples; an array whose columns
//! are the samples is turned.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

use zip::ZipArchive;
use zip::result::ZipError;

use crate::columns::{EXACT, Table, Wanted};
use crate::error::{LogError, LogFault};
use crate::guess;
use crate::listing::{Column, Conventions, Listing, Topic};
use crate::npy::{Header, Kind};

/// First bytes of an archive.
pub(crate) const MAGIC: &[u8] = b"PK\x03\x04";
/// How the name of an array's entry ends.
const ENDING: &str = ".npy";
/// Array of text that states whose conventions the numbers follow.
pub(crate) const CONVENTIONS: &str = "conventions";
/// Most entries of a row.
const MAX_WIDTH: usize = 1024;
/// Most arrays of an archive.
const MAX_ARRAYS: usize = 1024;
/// Values that a byte of the archive may stand for, and that every archive may have.
const CELLS_A_BYTE: u64 = 64;
const CELLS_OF_ANY_FILE: u64 = 4 << 20;
/// Most characters of the array of text.
const MAX_TEXT_BYTES: u64 = 4096;

/// An array of the archive.
struct Array {
    /// Its entry.
    index: usize,
    name: String,
    header: Header,
    /// Rows and values of a row; none where it is no table of numbers.
    shape: Option<Shape>,
}

#[derive(Clone, Copy)]
struct Shape {
    rows: usize,
    width: usize,
    /// Whether samples are the second dimension.
    is_turned: bool,
    /// Whether it has two dimensions.
    is_table: bool,
}

struct Archive {
    zip: ZipArchive<BufReader<File>>,
    arrays: Vec<Array>,
    conventions: Conventions,
    warnings: Vec<String>,
    /// Size of the file.
    bytes: u64,
}

impl Archive {
    fn open(path: &Path) -> Result<Archive, LogError> {
        let io = |why| LogFault::Io(why).at(path);
        let file = File::open(path).map_err(io)?;
        let bytes = file.metadata().map_err(io)?.len();
        let cut_off = |_| {
            LogFault::Format { format: "NPZ", why: "the archive is cut off, or it is no archive".to_owned() }.at(path)
        };
        let mut zip = ZipArchive::new(BufReader::new(file)).map_err(cut_off)?;
        let (mut arrays, mut conventions, mut warnings) = (Vec::new(), Conventions::Recorder, Vec::new());
        for index in 0..zip.len().min(MAX_ARRAYS) {
            let mut entry = zip.by_index(index).map_err(|why| fault(&why).at(path))?;
            let Some(name) = entry.name().ok().and_then(|name| Some(name.strip_suffix(ENDING)?.to_owned())) else {
                continue;
            };
            let header = match Header::read(&mut entry) {
                Ok(header) => header,
                Err(why) => {
                    warnings.push(format!("array {name}: {why}; it is not read"));
                    continue;
                }
            };
            if name == CONVENTIONS {
                let mut text = Vec::new();
                entry.take(MAX_TEXT_BYTES).read_to_end(&mut text).map_err(io)?;
                // Characters of four bytes.
                let text: String = text.iter().filter(|byte| **byte != 0).map(|byte| char::from(*byte)).collect();
                conventions = Conventions::stated(&text);
                continue;
            }
            arrays.push(Array { index, name, header, shape: None });
        }
        if zip.len() > MAX_ARRAYS {
            warnings.push(format!("of its {} arrays the first {MAX_ARRAYS} are read", zip.len()));
        }
        let rows = rows(&arrays);
        for array in &mut arrays {
            array.shape = shape(&array.header, rows);
            if array.shape.is_none() {
                let Header { kind, shape, .. } = &array.header;
                let why = match kind {
                    None => "its type is no number of 32 or 64 bits".to_owned(),
                    Some(_) => format!("its shape {shape:?} does not have {rows} samples"),
                };
                warnings.push(format!("array {}: {why}; it is not read", array.name));
            }
        }
        Ok(Archive { zip, arrays, conventions, warnings, bytes })
    }
}

/// Values that all wanted arrays of an archive may have together: those that its bytes may stand for.
struct Budget {
    bytes: u64,
    cells: u64,
}

impl Budget {
    /// Takes the values of an array.
    fn take(&mut self, shape: Shape) -> Result<(), String> {
        let cells = (shape.rows as u64).saturating_mul(shape.width as u64);
        self.cells = self.cells.saturating_add(cells);
        let most = self.bytes.saturating_mul(CELLS_A_BYTE).saturating_add(CELLS_OF_ANY_FILE);
        if self.cells > most {
            return Err(format!(
                "with it the arrays claim more than the {most} values that {} bytes may stand for",
                self.bytes
            ));
        }
        Ok(())
    }
}

/// Samples of the archive: the length of the array that is named as time; else the length that most arrays have as their longest
/// dimension, the largest of those.
fn rows(arrays: &[Array]) -> usize {
    let numbers = || arrays.iter().filter(|array| array.header.kind.is_some());
    let lines = |array: &&Array| array.header.shape.iter().filter(|length| **length > 1).count() == 1;
    let longest = |array: &Array| array.header.shape.iter().copied().max().unwrap_or(0);
    let times: Vec<usize> =
        numbers().filter(lines).filter(|array| guess::word(&array.name) == Some("time")).map(longest).collect();
    if let [first, others @ ..] = times.as_slice()
        && others.iter().all(|length| length == first)
    {
        return *first;
    }
    let mut counts: BTreeMap<usize, usize> = BTreeMap::new();
    for array in numbers() {
        *counts.entry(longest(array)).or_default() += 1;
    }
    counts.into_iter().max_by_key(|(length, count)| (*count, *length)).map_or(0, |(length, _)| length)
}

fn shape(header: &Header, rows: usize) -> Option<Shape> {
    header.kind?;
    let shape = match header.shape[..] {
        [length] if length == rows => Shape { rows, width: 1, is_turned: false, is_table: false },
        [length, width] if length == rows => Shape { rows, width, is_turned: false, is_table: true },
        [width, length] if length == rows => Shape { rows, width, is_turned: true, is_table: true },
        _ => return None,
    };
    (1..=MAX_WIDTH).contains(&shape.width).then_some(shape)
}

/// Names of the columns of an array: those of the contract, `q1`, where rivet wrote it, else `q[0]`.
fn names(name: &str, shape: Shape, conventions: Conventions) -> Vec<String> {
    match (shape.is_table, conventions) {
        (false, _) => vec![name.to_owned()],
        (true, Conventions::Recorder) => (0..shape.width).map(|k| format!("{name}[{k}]")).collect(),
        (true, Conventions::Model) => (1..=shape.width).map(|k| format!("{name}{k}")).collect(),
    }
}

/// The columns of an archive.
pub(crate) fn list(path: &Path) -> Result<Listing, LogError> {
    let archive = Archive::open(path)?;
    let tables = archive.arrays.iter().filter_map(|array| Some((array, array.shape?)));
    let columns = tables.flat_map(|(array, shape)| {
        let is_integer = array.header.kind.is_some_and(Kind::is_integer);
        let unit = array.header.kind.and_then(Kind::unit).map(str::to_owned);
        let column = move |name| Column { name, is_integer, unit: unit.clone(), ..Column::default() };
        names(&array.name, shape, archive.conventions).into_iter().map(column)
    });
    let columns: Vec<Column> = columns.collect();
    let rows = archive.arrays.iter().find_map(|array| array.shape).map(|shape| shape.rows as u64);
    let topic = Topic { name: String::new(), kind: "arrays".to_owned(), messages: rows, is_read: true };
    let Archive { warnings, conventions, .. } = archive;
    Ok(Listing { topics: vec![topic], columns, warnings, conventions, ..Listing::default() })
}

/// Reads the columns that `wanted` picks by name, array by array.
pub(crate) fn read(path: &Path, wanted: Wanted<'_>) -> Result<Table, LogError> {
    let Archive { mut zip, arrays, warnings, conventions, bytes } = Archive::open(path)?;
    let mut budget = Budget { bytes, cells: 0 };
    let mut table = Table { warnings, ..Table::default() };
    for Array { index, name, header, shape } in arrays {
        let Some(shape) = shape else { continue };
        let names = names(&name, shape, conventions);
        let places: Vec<Option<usize>> = {
            let mut count = 0;
            let place = |name: &String| {
                wanted(name).then(|| {
                    count += 1;
                    count - 1
                })
            };
            names.iter().map(place).collect()
        };
        table
            .unused
            .extend(names.iter().zip(&places).filter(|(_, place)| place.is_none()).map(|(name, _)| name.clone()));
        if places.iter().all(Option::is_none) {
            continue;
        }
        let Some(kind) = header.kind else { continue };
        let of_array = |why: String| LogFault::Format { format: "NPZ", why: format!("array {name}: {why}") }.at(path);
        budget.take(shape).map_err(of_array)?;
        let entry = zip.by_index(index).map_err(|why| fault(&why).at(path))?;
        let values = values(entry, kind, shape, header.is_fortran, &places).map_err(of_array)?;
        let kept = names.into_iter().zip(&places).filter(|(_, place)| place.is_some()).map(|(name, _)| name);
        table.columns.extend(kept.zip(values));
    }
    Ok(table)
}

/// The columns of an array that have a place, in the order of their places.
fn values(
    mut entry: impl Read,
    kind: Kind,
    shape: Shape,
    is_fortran: bool,
    places: &[Option<usize>],
) -> Result<Vec<Vec<f64>>, String> {
    let short = |why: std::io::Error| why.to_string();
    Header::read(&mut entry)?;
    let Shape { rows, width, is_turned, .. } = shape;
    let mut entry = BufReader::new(entry);
    let kept = places.iter().flatten().count();
    let mut columns: Vec<Column64> = (0..kept).map(|_| Column64::default()).collect();
    let mut bytes = [0_u8; 8];
    let bytes = &mut bytes[..kind.bytes()];
    // C order runs through the last dimension first; a turned or a Fortran array has its samples there.
    let by_column = is_fortran != is_turned;
    for k in 0..rows * width {
        entry.read_exact(bytes).map_err(short)?;
        let column = if by_column { k / rows } else { k % width };
        if let Some(place) = places[column] {
            columns[place].push(kind, bytes);
        }
    }
    // The check sum is compared at the end of the entry.
    match entry.read(&mut [0]) {
        Ok(0) => Ok(columns.into_iter().map(|column| column.values).collect()),
        Ok(_) => Err("it has more numbers than its header states".to_owned()),
        Err(why) => Err(why.to_string()),
    }
}

/// The numbers of a column. Integers that have no `f64` of their own count from the first.
#[derive(Default)]
struct Column64 {
    values: Vec<f64>,
    origin: Option<i64>,
}

impl Column64 {
    fn push(&mut self, kind: Kind, bytes: &[u8]) {
        let integer = kind.integer(bytes);
        if self.values.is_empty() {
            self.origin = integer.filter(|first| first.unsigned_abs() > EXACT);
        }
        let counted = self.origin.zip(integer).and_then(|(origin, integer)| integer.checked_sub(origin));
        self.values.push(counted.map_or_else(|| kind.value(bytes), |counted| counted as f64));
    }
}

fn fault(why: &ZipError) -> LogFault {
    LogFault::Format { format: "NPZ", why: why.to_string() }
}
