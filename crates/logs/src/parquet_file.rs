//! Parquet, column by column and without Arrow: numbers, alone or in lists, in any encoding and compression.

use std::cell::Cell;
use std::fs::File;
use std::os::unix::fs::FileExt as _;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Arc;

use bytes::{Buf as _, Bytes};
use parquet::basic::{
    Compression, ConvertedType, Encoding, LogicalType, Repetition, TimeUnit, Type as PhysicalType, ZstdLevel,
};
use parquet::column::page::{Page, PageMetadata, PageReader};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl, get_column_reader};
use parquet::data_type::{DataType, DoubleType};
use parquet::errors::ParquetError;
use parquet::file::metadata::{ColumnChunkMetaData, KeyValue, ParquetMetaData, ParquetMetaDataReader};
use parquet::file::properties::WriterProperties;
use parquet::file::reader::{ChunkReader, Length};
use parquet::file::serialized_reader::SerializedPageReader;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::{ColumnDescPtr, Type};
use rayon::prelude::*;
use rivet_files::CONVENTIONS_OF_THE_MODEL;

use crate::columns::{EXACT, Table, Wanted};
use crate::error::{LogError, LogFault};
use crate::listing::{Column, Conventions, Listing, Topic};
use crate::parquet_limits;

/// Most entries of a list.
const MAX_LIST_ENTRIES: u16 = 1024;

/// Reads the columns that `wanted` picks by name from a Parquet file.
///
/// The library's decoders panic on some files whose pages are not what their headers say; that is an error like another.
pub(crate) fn read(path: &Path, wanted: Wanted<'_>) -> Result<Table, LogError> {
    guarded(path, || read_columns(path, wanted))
}

/// The columns of a Parquet file. Entry i of a list `name` is the column `name[i]`.
pub(crate) fn list(path: &Path) -> Result<Listing, LogError> {
    guarded(path, || {
        let file = Source::open(path)?;
        let mut columns = Vec::new();
        for k in 0..file.columns() {
            columns.extend(file.names(path, k)?.into_iter().map(|name| file.column(k, name)));
        }
        let rows = u64::try_from(file.metadata.file_metadata().num_rows()).ok();
        let topic = Topic { name: String::new(), kind: "table".to_owned(), messages: rows, is_read: true };
        Ok(Listing { topics: vec![topic], columns, conventions: file.conventions(), ..Listing::default() })
    })
}

/// Nothing outlives a panic but the error: what was half read is dropped.
fn guarded<T>(path: &Path, read: impl FnOnce() -> Result<T, LogError>) -> Result<T, LogError> {
    catch_unwind(AssertUnwindSafe(read))
        .unwrap_or_else(|_| Err(fault(&ParquetError::General("its pages are damaged".to_owned())).at(path)))
}

/// An open file with its footer; columns are read from it one by one.
struct Source {
    file: File,
    bytes: u64,
    metadata: ParquetMetaData,
}

/// Bytes behind the footer: its length and the magic.
const TAIL_BYTES: u64 = 8;

impl Source {
    fn open(path: &Path) -> Result<Source, LogError> {
        let io = |e| LogFault::Io(e).at(path);
        let file = File::open(path).map_err(io)?;
        let bytes = file.metadata().map_err(io)?.len();
        let why = |why| fault(&ParquetError::General(why)).at(path);
        let footer = footer(&file, bytes).map_err(io)?;
        parquet_limits::ensure_footer(&footer).map_err(why)?;
        let window = Window { from: bytes - footer.len() as u64, bytes: Bytes::from(footer), file_bytes: bytes };
        let metadata = ParquetMetaDataReader::new().parse_and_finish(&window).map_err(|e| fault(&e).at(path))?;
        ensure_plausible(&metadata, bytes).map_err(|e| fault(&e).at(path))?;
        Ok(Source { file, bytes, metadata })
    }

    fn conventions(&self) -> Conventions {
        let stated = self.metadata.file_metadata().key_value_metadata().into_iter().flatten();
        let text = stated.filter(|entry| entry.key == MARK).find_map(|entry| entry.value.as_deref());
        Conventions::stated(text.unwrap_or_default())
    }

    fn columns(&self) -> usize {
        self.metadata.file_metadata().schema_descr().num_columns()
    }

    fn describe(&self, k: usize) -> ColumnDescPtr {
        self.metadata.file_metadata().schema_descr().column(k)
    }

    /// Name of column `k`, of a list without its inner groups.
    fn name(&self, k: usize) -> String {
        let column = self.describe(k);
        if column.max_rep_level() == 0 {
            return column.path().string();
        }
        let inner = ["list", "element", "item", "array", "bag", "array_element"];
        let parts = column.path().parts();
        let kept = parts.iter().enumerate().filter(|(place, part)| *place == 0 || !inner.contains(&part.as_str()));
        kept.map(|(_, part)| part.as_str()).collect::<Vec<_>>().join(".")
    }

    /// Names of the columns that column `k` of the file makes: its entries where it is a list, as long as its first one is.
    fn names(&self, path: &Path, k: usize) -> Result<Vec<String>, LogError> {
        let column = self.describe(k);
        match column.max_rep_level() {
            0 => Ok(vec![self.name(k)]),
            1 if is_numeric(column.physical_type()) => {
                let entries = self.entries(path, k)?;
                Ok((0..entries).map(|entry| format!("{}[{entry}]", self.name(k))).collect())
            }
            _ => Ok(Vec::new()),
        }
    }

    fn column(&self, k: usize, name: String) -> Column {
        let describe = self.describe(k);
        let unit = match describe.logical_type_ref() {
            Some(LogicalType::Timestamp(timestamp)) => Some(match timestamp.unit {
                TimeUnit::MILLIS => "ms",
                TimeUnit::MICROS => "us",
                TimeUnit::NANOS => "ns",
            }),
            _ => match describe.converted_type() {
                ConvertedType::TIMESTAMP_MILLIS => Some("ms"),
                ConvertedType::TIMESTAMP_MICROS => Some("us"),
                _ => None,
            },
        };
        let unit = unit.or_else(|| crate::units::split_unit(&name).1).map(str::to_owned);
        let text = (!is_numeric(describe.physical_type())).then(String::new);
        Column { name, unit, text, ..Column::default() }
    }

    /// Entries of the list in the first row of column `k`.
    fn entries(&self, path: &Path, k: usize) -> Result<usize, LogError> {
        if self.metadata.num_row_groups() == 0 {
            return Ok(0);
        }
        ensure_codecs(&self.metadata, &[k]).map_err(|why| fault(&ParquetError::General(why)).at(path))?;
        let mut levels = Levels::default();
        let cells = self.cells(path, k, 0)?;
        let entries = match cells {
            ColumnReader::DoubleColumnReader(mut r) => levels.read(&mut r, 1),
            ColumnReader::FloatColumnReader(mut r) => levels.read(&mut r, 1),
            ColumnReader::Int32ColumnReader(mut r) => levels.read(&mut r, 1),
            ColumnReader::Int64ColumnReader(mut r) => levels.read(&mut r, 1),
            _ => Ok(0),
        };
        entries.map_err(|e| fault(&e).at(path))?;
        // An empty list or none has one level, which is below that of an entry.
        let entry = self.describe(k).repeated_ancestor_def_level();
        let entries = levels.defined.iter().filter(|level| **level >= entry).count();
        if entries > usize::from(MAX_LIST_ENTRIES) { Ok(0) } else { Ok(entries) }
    }

    /// A reader of column `k` in row group `group`, whose claims were checked. Its bytes are in memory, those of others are not.
    fn cells(&self, path: &Path, k: usize, group: usize) -> Result<ColumnReader, LogError> {
        let general = |why: String| fault(&ParquetError::General(why)).at(path);
        let (column, name) = (self.describe(k), self.name(k));
        let group = self.metadata.row_group(group);
        let chunk = group.column(k);
        let begin = chunk.dictionary_page_offset().unwrap_or_else(|| chunk.data_page_offset());
        if begin < 0 || chunk.compressed_size() < 0 {
            // The library would panic.
            return Err(general(format!("column \"{name}\" lies before the beginning of the file")));
        }
        let (from, size) = (begin as u64, chunk.compressed_size() as u64);
        if from.checked_add(size).is_none_or(|end| end > self.bytes) {
            return Err(general(format!("column \"{name}\": it lies beyond the end of the file")));
        }
        let mut bytes = vec![0; size as usize];
        self.file.read_exact_at(&mut bytes, from).map_err(|e| LogFault::Io(e).at(path))?;
        let entries = if column.max_rep_level() == 0 { 1 } else { i64::from(MAX_LIST_ENTRIES) };
        let claims = (chunk.num_values(), group.num_rows().saturating_mul(entries));
        parquet_limits::ensure_pages(&bytes, chunk.compression(), claims)
            .map_err(|why| general(format!("column \"{name}\": {why}")))?;
        let window = Window { from, bytes: Bytes::from(bytes), file_bytes: self.bytes };
        let rows = usize::try_from(group.num_rows()).unwrap_or(0);
        let pages = SerializedPageReader::new(Arc::new(window), chunk, rows, None).map_err(|e| fault(&e).at(path))?;
        let size = if matches!(column.physical_type(), PhysicalType::FLOAT | PhysicalType::INT32) { 4 } else { 8 };
        Ok(get_column_reader(column, Box::new(Checked { pages: Box::new(pages), size })))
    }
}

fn is_numeric(kind: PhysicalType) -> bool {
    matches!(kind, PhysicalType::DOUBLE | PhysicalType::FLOAT | PhysicalType::INT32 | PhysicalType::INT64)
}

/// The end of a file from its footer on; all of it where it is too short for what it claims.
fn footer(file: &File, bytes: u64) -> std::io::Result<Vec<u8>> {
    let mut tail = [0; TAIL_BYTES as usize];
    let claimed = if bytes >= TAIL_BYTES {
        file.read_exact_at(&mut tail, bytes - TAIL_BYTES)?;
        u64::from(tail.first_chunk().copied().map_or(0, u32::from_le_bytes))
    } else {
        0
    };
    let length = claimed.min(parquet_limits::MAX_FOOTER_BYTES as u64 + 1).saturating_add(TAIL_BYTES).min(bytes);
    let mut footer = vec![0; length as usize];
    file.read_exact_at(&mut footer, bytes - length)?;
    Ok(footer)
}

/// A part of a file in memory, at the offsets of the file.
struct Window {
    from: u64,
    bytes: Bytes,
    file_bytes: u64,
}

impl Length for Window {
    fn len(&self) -> u64 {
        self.file_bytes
    }
}

impl ChunkReader for Window {
    type T = bytes::buf::Reader<Bytes>;

    fn get_read(&self, start: u64) -> Result<Self::T, ParquetError> {
        let from = self.place(start, 0)?;
        Ok(self.bytes.slice(from..).reader())
    }

    fn get_bytes(&self, start: u64, length: usize) -> Result<Bytes, ParquetError> {
        let from = self.place(start, length)?;
        Ok(self.bytes.slice(from..from + length))
    }
}

impl Window {
    fn place(&self, start: u64, length: usize) -> Result<usize, ParquetError> {
        let from = start.checked_sub(self.from).and_then(|from| usize::try_from(from).ok());
        let inside = from.filter(|from| from.checked_add(length).is_some_and(|end| end <= self.bytes.len()));
        inside.ok_or_else(|| ParquetError::General(format!("{length} bytes at {start} lie outside of what is read")))
    }
}

fn read_columns(path: &Path, wanted: Wanted<'_>) -> Result<Table, LogError> {
    let file = Source::open(path)?;
    let why = |why| fault(&ParquetError::General(why)).at(path);
    let mut table = Table::default();
    // Column of the file, and the names of its entries that are wanted.
    let mut picked: Vec<(usize, Vec<(usize, String)>)> = Vec::new();
    for k in 0..file.columns() {
        let names = file.names(path, k)?;
        if names.is_empty() {
            table.unused.push(file.name(k));
            continue;
        }
        let (taken, unused): (Vec<_>, Vec<_>) = names.into_iter().enumerate().partition(|(_, name)| wanted(name));
        table.unused.extend(unused.into_iter().map(|(_, name)| name));
        if !taken.is_empty() {
            picked.push((k, taken));
        }
    }
    ensure_codecs(&file.metadata, &picked.iter().map(|(k, _)| *k).collect::<Vec<_>>()).map_err(why)?;
    // All of them first: which error is told does not depend on who is done first.
    let read: Vec<_> = picked
        .par_iter()
        .map(|(k, taken)| match file.describe(*k).max_rep_level() {
            0 => read_column(path, &file, *k).map(|values| vec![values]),
            _ => read_lists(path, &file, *k, taken),
        })
        .collect();
    for ((_, taken), values) in picked.into_iter().zip(read) {
        for ((_, name), values) in taken.into_iter().zip(values?) {
            if table.columns.insert(name.clone(), values).is_some() {
                return Err(LogFault::TwiceColumn { column: name }.at(path));
            }
        }
    }
    Ok(table)
}

/// Columns that are wanted are compressed as this reader can undo.
fn ensure_codecs(metadata: &ParquetMetaData, wanted: &[usize]) -> Result<(), String> {
    let chunks = metadata.row_groups().iter().flat_map(|group| {
        let columns = group.columns();
        wanted.iter().filter_map(move |k| columns.get(*k))
    });
    for chunk in chunks {
        let codec = chunk.compression();
        if matches!(codec, Compression::LZO) {
            return Err(
                "its columns are compressed by lzo, which no reader of Parquet undoes any more: write it again with \
                        compression = \"zstd\""
                    .to_owned(),
            );
        }
    }
    Ok(())
}

/// Levels of the entries of lists, and where they begin.
#[derive(Default)]
struct Levels {
    defined: Vec<i16>,
    repeated: Vec<i16>,
}

impl Levels {
    fn read<T: DataType>(&mut self, reader: &mut ColumnReaderImpl<T>, rows: usize) -> Result<usize, ParquetError> {
        let mut values = Vec::new();
        let (records, ..) =
            reader.read_records(rows, Some(&mut self.defined), Some(&mut self.repeated), &mut values)?;
        Ok(records)
    }
}

/// The wanted entries of a column of lists that all are of one length.
fn read_lists(path: &Path, file: &Source, k: usize, taken: &[(usize, String)]) -> Result<Vec<Vec<f64>>, LogError> {
    let entries = file.entries(path, k)?;
    let mut lists = Lists {
        entries,
        entry: file.describe(k).repeated_ancestor_def_level(),
        value: file.describe(k).max_def_level(),
        taken: taken.iter().map(|(entry, _)| *entry).collect(),
        columns: vec![Vec::new(); taken.len()],
        rows: 0,
    };
    for group in 0..file.metadata.num_row_groups() {
        let rows = usize::try_from(file.metadata.row_group(group).num_rows()).unwrap_or(0);
        let done = match file.cells(path, k, group)? {
            ColumnReader::DoubleColumnReader(r) => lists.append(r, rows, |v| *v),
            ColumnReader::FloatColumnReader(r) => lists.append(r, rows, |v| f64::from(*v)),
            ColumnReader::Int32ColumnReader(r) => lists.append(r, rows, |v| f64::from(*v)),
            ColumnReader::Int64ColumnReader(r) => lists.append(r, rows, |v| *v as f64),
            _ => Ok(None),
        };
        if let Some(found) = done.map_err(|e| fault(&e).at(path))? {
            let value = format!("a list of {found} entries, the first has {entries}");
            return Err(LogFault::Value { column: file.name(k), row: lists.rows + 1, value }.at(path));
        }
    }
    Ok(lists.columns)
}

/// Lists of one length as columns.
struct Lists {
    entries: usize,
    /// Definition levels of an entry, and of one that is not null.
    entry: i16,
    value: i16,
    taken: Vec<usize>,
    columns: Vec<Vec<f64>>,
    rows: usize,
}

impl Lists {
    /// Appends the lists of a row group; a null is NaN. Returns the number of entries of a list of another length.
    fn append<T: DataType>(
        &mut self,
        mut reader: ColumnReaderImpl<T>,
        rows: usize,
        convert: impl Fn(&T::T) -> f64,
    ) -> Result<Option<usize>, ParquetError> {
        let (mut values, mut levels) = (Vec::new(), Levels::default());
        let mut left = rows;
        while left > 0 {
            values.clear();
            levels.defined.clear();
            levels.repeated.clear();
            let now = left.min((ROWS_AT_A_TIME / self.entries.max(1)).max(1));
            let (records, ..) =
                reader.read_records(now, Some(&mut levels.defined), Some(&mut levels.repeated), &mut values)?;
            if records == 0 {
                break;
            }
            left = left.saturating_sub(records);
            let mut present = values.iter();
            let starts = |k: usize| levels.repeated.get(k).is_none_or(|level| *level == 0);
            let mut row: Vec<f64> = Vec::with_capacity(self.entries);
            for (k, level) in levels.defined.iter().enumerate() {
                if *level >= self.entry {
                    row.push(if *level == self.value { present.next().map_or(f64::NAN, &convert) } else { f64::NAN });
                }
                if !starts(k + 1) {
                    continue;
                }
                // A row without a list is a row without values.
                if !row.is_empty() && row.len() != self.entries {
                    return Ok(Some(row.len()));
                }
                for (column, entry) in self.columns.iter_mut().zip(&self.taken) {
                    column.push(row.get(*entry).copied().unwrap_or(f64::NAN));
                }
                self.rows += 1;
                row.clear();
            }
        }
        Ok(None)
    }
}

/// Column `k` of all row groups.
fn read_column(path: &Path, file: &Source, k: usize) -> Result<Vec<f64>, LogError> {
    let column = file.describe(k);
    let mut values = Vec::new();
    let origin = Cell::new(None);
    let counted = |value: &i64| {
        let from = origin.get().unwrap_or(if value.unsigned_abs() > EXACT { *value } else { 0 });
        origin.set(Some(from));
        value.checked_sub(from).unwrap_or(*value) as f64
    };
    for group in 0..file.metadata.num_row_groups() {
        let rows = usize::try_from(file.metadata.row_group(group).num_rows()).unwrap_or(0);
        let levels = column.max_def_level();
        let done = match file.cells(path, k, group)? {
            ColumnReader::DoubleColumnReader(r) if levels == 0 => append_doubles(r, rows, &mut values),
            ColumnReader::DoubleColumnReader(r) => append(r, rows, levels, |v| *v, &mut values),
            ColumnReader::FloatColumnReader(r) => append(r, rows, levels, |v| f64::from(*v), &mut values),
            ColumnReader::Int32ColumnReader(r) => append(r, rows, levels, |v| f64::from(*v), &mut values),
            ColumnReader::Int64ColumnReader(r) => append(r, rows, levels, counted, &mut values),
            _ => {
                let kind = column.physical_type().to_string();
                return Err(LogFault::ColumnType { column: file.name(k), kind }.at(path));
            }
        };
        done.map_err(|e| fault(&e).at(path))?;
    }
    Ok(values)
}

/// Cells that a byte of the file may stand for. Positions and time change from row to row, so that of 20 columns some bytes a row are left.
const CELLS_A_BYTE: u64 = 64;
/// Cells that every file may have: 32 MiB of values.
const CELLS_OF_ANY_FILE: u64 = 4 << 20;

/// Rows are claimed by a few bytes, and may be of values that repeat: without a limit a small file fills all memory.
fn ensure_plausible(metadata: &ParquetMetaData, bytes: u64) -> Result<(), ParquetError> {
    let claimed = metadata.row_groups().iter().fold(0_u64, |sum, group| {
        let cells = u64::try_from(group.num_rows()).unwrap_or(0).saturating_mul(group.num_columns() as u64);
        sum.saturating_add(cells)
    });
    if claimed > bytes.saturating_mul(CELLS_A_BYTE).saturating_add(CELLS_OF_ANY_FILE) {
        return Err(ParquetError::General(format!("it claims {claimed} cells and has {bytes} bytes")));
    }
    // Entries of lists are counted by themselves.
    let chunks = || metadata.row_groups().iter().flat_map(parquet::file::metadata::RowGroupMetaData::columns);
    let values = chunks().fold(0_u64, |sum, c| sum.saturating_add(u64::try_from(c.num_values()).unwrap_or(u64::MAX)));
    if values > bytes.saturating_mul(CELLS_A_BYTE).saturating_add(CELLS_OF_ANY_FILE) {
        return Err(ParquetError::General(format!("it claims {values} values and has {bytes} bytes")));
    }
    // Columns that share their bytes would let a second row group go around every limit of the first.
    let stored = chunks().fold(0_u64, |sum: u64, c: &ColumnChunkMetaData| {
        sum.saturating_add(u64::try_from(c.compressed_size()).unwrap_or(u64::MAX))
    });
    if stored > bytes {
        return Err(ParquetError::General(format!("its columns claim {stored} of its {bytes} bytes")));
    }
    Ok(())
}

/// Pages whose dictionaries have as many values as they say: the library sets memory aside for what they say, and where that is
/// not to be had the process ends.
struct Checked {
    pages: Box<dyn PageReader>,
    /// Bytes of a value.
    size: usize,
}

impl PageReader for Checked {
    fn get_next_page(&mut self) -> Result<Option<Page>, ParquetError> {
        let page = self.pages.get_next_page()?;
        if let Some(Page::DictionaryPage { buf, num_values, .. }) = &page
            && buf.len() / self.size < *num_values as usize
        {
            let why = format!("a dictionary of {num_values} values has {} bytes", buf.len());
            return Err(ParquetError::General(why));
        }
        Ok(page)
    }

    fn peek_next_page(&mut self) -> Result<Option<PageMetadata>, ParquetError> {
        self.pages.peek_next_page()
    }

    fn skip_next_page(&mut self) -> Result<(), ParquetError> {
        self.pages.skip_next_page()
    }
}

impl Iterator for Checked {
    type Item = Result<Page, ParquetError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.get_next_page().transpose()
    }
}

/// Rows that are read at a time: what the library sets aside does not grow with what the file claims.
const ROWS_AT_A_TIME: usize = 1 << 16;

/// Appends one row group's cells of a column that has no nulls and needs no conversion.
fn append_doubles(
    mut reader: ColumnReaderImpl<DoubleType>,
    rows: usize,
    to: &mut Vec<f64>,
) -> Result<(), ParquetError> {
    let mut left = rows;
    while left > 0 {
        let now = left.min(ROWS_AT_A_TIME);
        to.reserve_exact(now);
        let (records, _, _) = reader.read_records(now, None, None, to)?;
        if records == 0 {
            break;
        }
        left = left.saturating_sub(records);
    }
    Ok(())
}

/// Appends one row group's cells of a column; a null becomes NaN.
fn append<T: DataType>(
    mut reader: ColumnReaderImpl<T>,
    rows: usize,
    levels: i16,
    convert: impl Fn(&T::T) -> f64,
    to: &mut Vec<f64>,
) -> Result<(), ParquetError> {
    let (mut values, mut defined) = (Vec::new(), Vec::new());
    let mut left = rows;
    while left > 0 {
        values.clear();
        defined.clear();
        let (records, _, _) = reader.read_records(left.min(ROWS_AT_A_TIME), Some(&mut defined), None, &mut values)?;
        if records == 0 {
            break;
        }
        left = left.saturating_sub(records);
        if levels == 0 {
            to.extend(values.iter().map(&convert));
        } else {
            let mut present = values.iter();
            to.extend(
                defined.iter().map(
                    |level| {
                        if *level == levels { present.next().map_or(f64::NAN, &convert) } else { f64::NAN }
                    },
                ),
            );
        }
    }
    Ok(())
}

/// Key of the file's metadata that states whose conventions its numbers follow.
const MARK: &str = "rivet.conventions";

/// Writes columns of equal length as Parquet (zstd, 64 bit floats).
///
/// Atomic: the file appears under its name complete, or not at all. It is written beside its place and renamed.
pub fn write_columns<S: AsRef<str>>(path: &Path, columns: &[(S, &[f64])]) -> Result<(), LogError> {
    write(path, columns, None)
}

/// The same for columns of the contract in the model's conventions, which the file states: what a robot file says in `[log]` of signs,
/// scales and zeros is not applied when they are read.
pub fn write_model_columns<S: AsRef<str>>(path: &Path, columns: &[(S, &[f64])]) -> Result<(), LogError> {
    write(path, columns, Some(CONVENTIONS_OF_THE_MODEL))
}

fn write<S: AsRef<str>>(path: &Path, columns: &[(S, &[f64])], conventions: Option<&str>) -> Result<(), LogError> {
    let rows = columns.first().map_or(0, |(_, values)| values.len());
    if let Some((name, values)) = columns.iter().find(|(_, values)| values.len() != rows) {
        let column = name.as_ref().to_owned();
        return Err(LogFault::Length { column, rows: values.len(), expected: rows }.at(path));
    }
    let bytes = encoded(columns, conventions).map_err(|why| why.at(path))?;
    // The library would make a full disk a fault of the format.
    rivet_files::write_whole(path, bytes).map_err(|why| LogFault::Io(why).at(path))
}

fn encoded<S: AsRef<str>>(columns: &[(S, &[f64])], conventions: Option<&str>) -> Result<Vec<u8>, LogFault> {
    let fields = columns.iter().map(|(name, _)| {
        Type::primitive_type_builder(name.as_ref(), PhysicalType::DOUBLE)
            .with_repetition(Repetition::REQUIRED)
            .build()
            .map(Arc::new)
    });
    let fields = fields.collect::<Result<Vec<_>, _>>().map_err(|e| fault(&e))?;
    let schema = Type::group_type_builder("schema").with_fields(fields).build().map_err(|e| fault(&e))?;
    // Hardly a value of a signal comes twice: a dictionary makes files a third to two thirds larger. Bytes of like weight side by side make them
    // smaller by a tenth to a fifth once more.
    let properties = WriterProperties::builder()
        .set_compression(Compression::ZSTD(ZstdLevel::default()))
        .set_dictionary_enabled(false)
        .set_encoding(Encoding::BYTE_STREAM_SPLIT)
        .set_key_value_metadata(conventions.map(|text| vec![KeyValue::new(MARK.to_owned(), text.to_owned())]))
        .build();
    let mut bytes = Vec::new();
    let write = |bytes: &mut Vec<u8>| -> Result<(), ParquetError> {
        let mut writer = SerializedFileWriter::new(bytes, Arc::new(schema), Arc::new(properties))?;
        let mut group = writer.next_row_group()?;
        for (_, values) in columns {
            let Some(mut column) = group.next_column()? else { break };
            column.typed::<DoubleType>().write_batch(values, None, None)?;
            column.close()?;
        }
        group.close()?;
        writer.close()?;
        Ok(())
    };
    write(&mut bytes).map_err(|e| fault(&e))?;
    Ok(bytes)
}

fn fault(error: &ParquetError) -> LogFault {
    LogFault::Format { format: "Parquet", why: error.to_string() }
}
