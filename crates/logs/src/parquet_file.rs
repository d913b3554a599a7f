//! Parquet, column by column and without Arrow: flat numeric columns, any encoding, zstd or snappy or plain.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Arc;

use bytes::Bytes;
use parquet::basic::{Compression, Encoding, Repetition, Type as PhysicalType, ZstdLevel};
use parquet::column::page::{Page, PageMetadata, PageReader};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl, get_column_reader};
use parquet::data_type::{DataType, DoubleType};
use parquet::errors::ParquetError;
use parquet::file::metadata::ParquetMetaData;
use parquet::file::properties::WriterProperties;
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::Type;
use rayon::prelude::*;

use crate::columns::Table;
use crate::error::{LogError, LogFault};
use crate::parquet_limits;

/// Reads the columns that `wanted` picks by name from a Parquet file.
///
/// The library's decoders panic on some files whose pages are not what their headers say; that is an error like another.
pub(crate) fn read(path: &Path, wanted: impl Fn(&str) -> bool) -> Result<Table, LogError> {
    // Nothing outlives a panic but the error: what was half read is dropped.
    catch_unwind(AssertUnwindSafe(|| read_columns(path, wanted)))
        .unwrap_or_else(|_| Err(fault(&ParquetError::General("its pages are damaged".to_owned())).at(path)))
}

/// Longest Parquet file \[bytes\]: it is held in memory. Eight joints with every signal at 1 kHz take some 0.5 GB an hour.
const MAX_FILE_BYTES: u64 = 4 << 30;

fn read_columns(path: &Path, wanted: impl Fn(&str) -> bool) -> Result<Table, LogError> {
    // Whole, since columns are read side by side and a file has one cursor; what is made of it is larger.
    let file = Bytes::from(rivet_files::read_whole(path, MAX_FILE_BYTES).map_err(|e| LogFault::Io(e).at(path))?);
    let bytes = file.len() as u64;
    let why = |why| fault(&ParquetError::General(why)).at(path);
    parquet_limits::ensure_footer(&file).map_err(why)?;
    let reader = SerializedFileReader::new(file.clone()).map_err(|e| fault(&e).at(path))?;
    let schema = reader.metadata().file_metadata().schema_descr_ptr();
    ensure_plausible(reader.metadata(), bytes).map_err(|e| fault(&e).at(path))?;
    let (picked, unused): (Vec<_>, Vec<_>) =
        schema.columns().iter().enumerate().partition(|(_, column)| wanted(&column.path().string()));
    ensure_codecs(reader.metadata(), &picked.iter().map(|(k, _)| *k).collect::<Vec<_>>()).map_err(why)?;
    let mut table = Table { unused: unused.iter().map(|(_, c)| c.path().string()).collect(), ..Table::default() };
    // All of them first: which error is told does not depend on who is done first.
    let read: Vec<_> = picked.par_iter().map(|(k, _)| read_column(path, &file, &reader, *k)).collect();
    for ((_, column), values) in picked.iter().zip(read) {
        let name = column.path().string();
        if table.columns.insert(name.clone(), values?).is_some() {
            return Err(LogFault::TwiceColumn { column: name }.at(path));
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
        if !matches!(codec, Compression::UNCOMPRESSED | Compression::SNAPPY | Compression::ZSTD(_)) {
            let codec = format!("{codec:?}").split('(').next().unwrap_or_default().to_lowercase();
            return Err(format!(
                "its columns are compressed by {codec}; a log's are by zstd, snappy or not at all: write it again with compression = \"zstd\""
            ));
        }
    }
    Ok(())
}

/// Column `k` of all row groups.
fn read_column(path: &Path, file: &[u8], reader: &SerializedFileReader<Bytes>, k: usize) -> Result<Vec<f64>, LogError> {
    let column = reader.metadata().file_metadata().schema_descr().column(k);
    let name = column.path().string();
    let mut values = Vec::new();
    for group in 0..reader.num_row_groups() {
        let group = reader.get_row_group(group).map_err(|e| fault(&e).at(path))?;
        let rows = usize::try_from(group.metadata().num_rows()).unwrap_or(0);
        let chunk = group.metadata().column(k);
        let begin = chunk.dictionary_page_offset().unwrap_or_else(|| chunk.data_page_offset());
        if begin < 0 || chunk.compressed_size() < 0 {
            // The library would panic.
            let why = format!("column \"{name}\" lies before the beginning of the file");
            return Err(fault(&ParquetError::General(why)).at(path));
        }
        let (from, size) = (begin as usize, chunk.compressed_size() as usize);
        parquet_limits::ensure_pages(file, (from, size), (chunk.num_values(), group.metadata().num_rows()))
            .map_err(|why| fault(&ParquetError::General(format!("column \"{name}\": {why}"))).at(path))?;
        let pages = group.get_column_page_reader(k).map_err(|e| fault(&e).at(path))?;
        let size = if matches!(column.physical_type(), PhysicalType::FLOAT | PhysicalType::INT32) { 4 } else { 8 };
        let cells = get_column_reader(column.clone(), Box::new(Checked { pages, size }));
        let levels = column.max_def_level();
        let done = match cells {
            ColumnReader::DoubleColumnReader(r) if levels == 0 => append_doubles(r, rows, &mut values),
            ColumnReader::DoubleColumnReader(r) => append(r, rows, levels, |v| *v, &mut values),
            ColumnReader::FloatColumnReader(r) => append(r, rows, levels, |v| f64::from(*v), &mut values),
            ColumnReader::Int32ColumnReader(r) => append(r, rows, levels, |v| f64::from(*v), &mut values),
            ColumnReader::Int64ColumnReader(r) => append(r, rows, levels, |v| *v as f64, &mut values),
            _ => {
                let kind = column.physical_type().to_string();
                return Err(LogFault::ColumnType { column: name, kind }.at(path));
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
    // Columns that share their bytes would let a second row group go around every limit of the first.
    let chunks = metadata.row_groups().iter().flat_map(parquet::file::metadata::RowGroupMetaData::columns);
    let stored =
        chunks.fold(0_u64, |sum, c| sum.saturating_add(u64::try_from(c.compressed_size()).unwrap_or(u64::MAX)));
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

/// Writes columns of equal length as Parquet (zstd, 64 bit floats).
///
/// Atomic: the file appears under its name complete, or not at all. It is written beside its place and renamed.
pub fn write_columns<S: AsRef<str>>(path: &Path, columns: &[(S, &[f64])]) -> Result<(), LogError> {
    let rows = columns.first().map_or(0, |(_, values)| values.len());
    if let Some((name, values)) = columns.iter().find(|(_, values)| values.len() != rows) {
        let column = name.as_ref().to_owned();
        return Err(LogFault::Length { column, rows: values.len(), expected: rows }.at(path));
    }
    let bytes = encoded(columns).map_err(|why| why.at(path))?;
    // The library would make a full disk a fault of the format.
    rivet_files::write_whole(path, bytes).map_err(|why| LogFault::Io(why).at(path))
}

fn encoded<S: AsRef<str>>(columns: &[(S, &[f64])]) -> Result<Vec<u8>, LogFault> {
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
