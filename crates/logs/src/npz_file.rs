//! NumPy archives (`numpy.savez`, `numpy.savez_compressed`): arrays of numbers, one a name.
//!
//! An array with one dimension is a column, one with two a column a joint: `name[i]`. Rows are the samples; an array whose columns
//! are the samples is turned.

use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

use zip::ZipArchive;
use zip::result::ZipError;

use crate::arrays::{Budget, Shape, places, samples};
use crate::columns::{Table, Wanted};
use crate::error::{LogError, LogFault};
use crate::listing::{CONVENTIONS, Column, Conventions, Listing, Topic};
use crate::npy::Header;
use crate::numbers::{Kind, Numbers};

/// First bytes of an archive.
pub(crate) const MAGIC: &[u8] = b"PK\x03\x04";
/// How the name of an array's entry ends.
const ENDING: &str = ".npy";
/// Most arrays of an archive.
const MAX_ARRAYS: usize = 1024;
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
        let numbers = arrays.iter().filter(|array| array.header.kind.is_some());
        let rows = samples(numbers.map(|array| (array.name.as_str(), array.header.shape.as_slice())));
        for array in &mut arrays {
            array.shape = array.header.kind.and_then(|_| Shape::with_rows(&array.header.shape, rows));
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

/// The columns of an archive.
pub(crate) fn list(path: &Path) -> Result<Listing, LogError> {
    let archive = Archive::open(path)?;
    let tables = archive.arrays.iter().filter_map(|array| Some((array, array.shape?)));
    let columns = tables.flat_map(|(array, shape)| {
        let is_integer = array.header.kind.is_some_and(Kind::is_integer);
        let unit = array.header.kind.and_then(Kind::unit).map(str::to_owned);
        let column = move |name| Column { name, is_integer, unit: unit.clone(), ..Column::default() };
        shape.names(&array.name, archive.conventions).into_iter().map(column)
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
    let mut budget = Budget::new(bytes);
    let mut table = Table { warnings, ..Table::default() };
    for Array { index, name, header, shape } in arrays {
        let Some(shape) = shape else { continue };
        let names = shape.names(&name, conventions);
        let places = places(&names, wanted);
        table
            .unused
            .extend(names.iter().zip(&places).filter(|(_, place)| place.is_none()).map(|(name, _)| name.clone()));
        if places.iter().all(Option::is_none) {
            continue;
        }
        let Some(kind) = header.kind else { continue };
        let of_array = |why: String| LogFault::Format { format: "NPZ", why: format!("array {name}: {why}") }.at(path);
        budget.take(shape.cells()).map_err(of_array)?;
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
    let mut entry = BufReader::new(entry);
    let kept = places.iter().flatten().count();
    let mut columns: Vec<Numbers> = (0..kept).map(|_| Numbers::default()).collect();
    let mut bytes = [0_u8; 8];
    let bytes = &mut bytes[..kind.bytes()];
    for k in 0..shape.rows * shape.width {
        entry.read_exact(bytes).map_err(short)?;
        if let Some(place) = places[shape.column(k, is_fortran)] {
            columns[place].push(kind, bytes);
        }
    }
    // The check sum is compared at the end of the entry.
    match entry.read(&mut [0]) {
        Ok(0) => Ok(columns.into_iter().map(Numbers::into_values).collect()),
        Ok(_) => Err("it has more numbers than its header states".to_owned()),
        Err(why) => Err(why.to_string()),
    }
}

fn fault(why: &ZipError) -> LogFault {
    LogFault::Format { format: "NPZ", why: why.to_string() }
}
