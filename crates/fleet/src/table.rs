//! The fleet table as a Parquet file: read row by row, and written anew with what was added.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result};
use parquet::basic::{Compression, ZstdLevel};
use parquet::data_type::{ByteArrayType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::reader::FileReader as _;
use parquet::file::serialized_reader::SerializedFileReader;
use parquet::file::writer::SerializedFileWriter;
use parquet::record::reader::RowIter;
use parquet::record::{Field, Row as Record};
use rivet_analysis::fault::Fault;
use serde::Deserialize;
use serde_json::Value;

use crate::columns::{COLUMNS, Column, Leaf, append_row, leaves, schema};
use crate::row::{ErrorKind, Key, Row, Status};

/// Key of the file's metadata that names the schema.
const SCHEMA_KEY: &str = "rivet.schema";
/// Key of the file's metadata that has the content of each column, as JSON.
const COLUMNS_KEY: &str = "rivet.columns";
/// Name and version of the schema. Columns may be added within a version; a changed meaning is a new one.
pub(crate) const SCHEMA: &str = "rivet.fleet.v1";
/// Rows of a row group.
const GROUP_ROWS: usize = 1000;
/// Bytes of JSON after which a row group ends early.
const GROUP_BYTES: usize = 16 << 20;
/// Characters of an error that a summary has.
const MAX_ERROR_CHARS: usize = 500;
/// Columns that decide what has to be done again, and that a summary counts.
const INDEX: [&str; 8] = ["robot", "group_by", "log_group", "status", "error_kind", "error", "verdict", "fingerprint"];

/// What a run needs of a row that is there.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
pub(crate) struct Known {
    pub(crate) status: Status,
    pub(crate) error_kind: Option<ErrorKind>,
    pub(crate) error: Option<String>,
    pub(crate) verdict: Option<String>,
    pub(crate) fingerprint: String,
}

impl From<&Row> for Known {
    fn from(row: &Row) -> Known {
        Known {
            status: row.status,
            error_kind: row.error_kind,
            error: row.error.as_deref().map(shortened),
            verdict: row.verdict.clone(),
            fingerprint: row.fingerprint.clone(),
        }
    }
}

/// The beginning of an error: one of many that a run keeps in memory.
fn shortened(error: &str) -> String {
    error.chars().take(MAX_ERROR_CHARS).collect()
}

#[derive(Deserialize)]
struct Indexed {
    robot: Option<String>,
    group_by: String,
    log_group: String,
    #[serde(flatten)]
    known: Known,
}

/// Rows that a table holds, by their keys; none where there is no table.
///
/// # Errors
/// The file is damaged, or no table of this version.
pub(crate) fn index(path: &Path) -> Result<BTreeMap<Key, Known>> {
    let Some(file) = open(path)? else { return Ok(BTreeMap::new()) };
    let columns: Vec<Column> = COLUMNS.into_iter().filter(|c| INDEX.contains(&c.name)).collect();
    guarded(path, || {
        let projection = schema(&columns)?.as_ref().clone();
        let records = RowIter::from_file_into(Box::new(file)).project(Some(projection))?;
        let parse = |record| -> Result<(Key, Known)> {
            let row: Indexed = serde_json::from_value(json(record)?)?;
            let known = Known { error: row.known.error.as_deref().map(shortened), ..row.known };
            Ok(((row.robot, row.group_by, row.log_group), known))
        };
        records.map(|record| parse(record?)).collect()
    })
}

/// Writes the table with `added` in their places; rows of other keys stay, but for those of `obsolete`. Rows stand in the order of their
/// keys. The file is replaced once it is complete. Returns the number of rows.
///
/// # Errors
/// The table that is there is damaged, or the new one cannot be written.
pub(crate) fn merge(
    path: &Path,
    added: impl Iterator<Item = Result<Row>>,
    obsolete: &BTreeSet<Key>,
    is_added: impl Fn(&Key) -> bool,
) -> Result<usize> {
    let kept =
        |row: &Result<Row>| row.as_ref().map_or(true, |row| !is_added(&row.key()) && !obsolete.contains(&row.key()));
    guarded(path, || {
        let old = open(path)?.map(|file| RowIter::from_file_into(Box::new(file)));
        let old = old.into_iter().flatten().map(|record| Ok(serde_json::from_value(json(record?)?)?));
        let (mut old, mut added) = (old.filter(kept).peekable(), added.peekable());
        let merged = std::iter::from_fn(|| {
            let is_old_next = match (old.peek(), added.peek()) {
                (Some(Ok(old)), Some(Ok(added))) => old.key() <= added.key(),
                (_, Some(_)) => false,
                (_, None) => true,
            };
            if is_old_next { old.next() } else { added.next() }
        });
        let mut count = 0;
        rivet_files::fill_whole(path, |file| -> Result<()> {
            count = write(file, merged)?;
            Ok(())
        })?;
        Ok(count)
    })
}

/// Writes rows as a table, row group by row group; returns their number.
fn write(file: &mut File, rows: impl Iterator<Item = Result<Row>>) -> Result<usize> {
    let contents: serde_json::Map<String, Value> =
        COLUMNS.iter().map(|column| (column.name.to_owned(), Value::from(column.content))).collect();
    let metadata = vec![
        KeyValue::new(SCHEMA_KEY.to_owned(), SCHEMA.to_owned()),
        KeyValue::new(COLUMNS_KEY.to_owned(), Value::Object(contents).to_string()),
    ];
    let properties = WriterProperties::builder()
        .set_compression(Compression::ZSTD(ZstdLevel::default()))
        .set_created_by(format!("rivet {}", env!("CARGO_PKG_VERSION")))
        .set_key_value_metadata(Some(metadata))
        .build();
    let mut writer =
        SerializedFileWriter::new(&mut *file, schema(&COLUMNS)?, Arc::new(properties)).map_err(unwritten)?;
    let (mut group, mut in_group, mut bytes, mut count) = (leaves(), 0, 0, 0);
    for row in rows {
        let row = row?;
        bytes += row.diagnosis.as_ref().map_or(0, String::len);
        append_row(&serde_json::to_value(&row)?, &mut group)?;
        in_group += 1;
        count += 1;
        if in_group == GROUP_ROWS || bytes > GROUP_BYTES {
            write_group(&mut writer, &std::mem::replace(&mut group, leaves())).map_err(unwritten)?;
            (in_group, bytes) = (0, 0);
        }
    }
    if in_group > 0 {
        write_group(&mut writer, &group).map_err(unwritten)?;
    }
    writer.close().map_err(unwritten)?;
    file.sync_all()?;
    Ok(count)
}

fn write_group(writer: &mut SerializedFileWriter<&mut File>, leaves: &[Leaf]) -> Result<(), ParquetError> {
    let mut group = writer.next_row_group()?;
    for leaf in leaves {
        let Some(mut column) = group.next_column()? else { break };
        let (defined, repeated) = (Some(&leaf.defined[..]), Some(&leaf.repeated[..]));
        match column.untyped() {
            parquet::column::writer::ColumnWriter::ByteArrayColumnWriter(_) => {
                column.typed::<ByteArrayType>().write_batch(&leaf.texts, defined, repeated)?;
            }
            parquet::column::writer::ColumnWriter::DoubleColumnWriter(_) => {
                column.typed::<DoubleType>().write_batch(&leaf.doubles, defined, repeated)?;
            }
            _ => {
                column.typed::<Int64Type>().write_batch(&leaf.integers, defined, repeated)?;
            }
        }
        column.close()?;
    }
    group.close()?;
    Ok(())
}

/// What cannot be written is a fault of the disk.
fn unwritten(why: ParquetError) -> io::Error {
    io::Error::other(why)
}

fn open(path: &Path) -> Result<Option<SerializedFileReader<File>>> {
    let at = || path.display().to_string();
    let file = match rivet_files::ensure_regular(path).and_then(|_| File::open(path)) {
        Err(why) if why.kind() == io::ErrorKind::NotFound => return Ok(None),
        opened => opened.with_context(at)?,
    };
    let unfit = |what: &str| Fault::Usage(format!("--table {} {what}; name another place or remove it", at()));
    let reader = SerializedFileReader::new(file).map_err(|_| unfit("is there and is no Parquet file"))?;
    let metadata = reader.metadata().file_metadata().key_value_metadata();
    let found = metadata.into_iter().flatten().find(|entry| entry.key == SCHEMA_KEY).and_then(|e| e.value.as_deref());
    match found {
        Some(SCHEMA) => Ok(Some(reader)),
        Some(other) => Err(unfit(&format!("has schema {other:?}, this version writes {SCHEMA:?}")).into()),
        None => Err(unfit("is there and is no table of diagnoses").into()),
    }
}

/// The library's decoders panic on some damaged files: an error like another.
fn guarded<T>(path: &Path, read: impl FnOnce() -> Result<T>) -> Result<T> {
    let damaged = || Fault::Data(format!("{}: the table is damaged; remove it", path.display()));
    match catch_unwind(AssertUnwindSafe(read)) {
        Ok(Err(why)) if why.is::<ParquetError>() || why.is::<serde_json::Error>() => Err(why.context(damaged())),
        Ok(done) => done,
        Err(_) => Err(damaged().into()),
    }
}

fn json(record: Record) -> Result<Value> {
    let fields = record.into_columns().into_iter().map(|(name, field)| Ok((name, value(field)?)));
    Ok(Value::Object(fields.collect::<Result<_>>()?))
}

fn value(field: Field) -> Result<Value> {
    Ok(match field {
        Field::Null => Value::Null,
        Field::Str(text) => Value::String(text),
        Field::Double(number) => Value::from(number),
        Field::Long(number) | Field::TimestampMicros(number) => Value::from(number),
        Field::Group(record) => json(record)?,
        Field::ListInternal(list) => {
            Value::Array(list.elements().iter().map(|field| value(field.clone())).collect::<Result<_>>()?)
        }
        Field::MapInternal(map) => {
            let entry = |(key, number): &(Field, Field)| match key {
                Field::Str(key) => Ok((key.clone(), value(number.clone())?)),
                other => Err(ParquetError::General(format!("a key that is no text: {other}")).into()),
            };
            Value::Object(map.entries().iter().map(entry).collect::<Result<_>>()?)
        }
        other => return Err(ParquetError::General(format!("a value of a type that the table lacks: {other}")).into()),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rivet_report::Document;

    fn failed(robot: Option<&str>, log: &str) -> Row {
        let row = Row {
            robot: robot.map(str::to_owned),
            group_by: "log".to_owned(),
            log_group: log.to_owned(),
            logs: vec![log.to_owned()],
            fingerprint: "f".to_owned(),
            ..Row::default()
        };
        row.with_error(ErrorKind::Data, format!("{log}: no torque"))
    }

    /// A diagnosis with every kind of column filled: lists in lists, an empty list, a map with a null.
    fn diagnosed(log: &str, figure: f64) -> Row {
        let cause = |joints: &[&str]| {
            serde_json::json!({"effect": "joint_spring", "joints": joints,
                "magnitude": {"stiffness_Nm_rad": figure, "unknown_Nm": null},
                "shrink": {"predicted": 0.7, "low": figure, "high": 0.8, "measured": null}, "confidence": 0.9,
                "indistinguishable_from": ["payload"], "separating_motion": null})
        };
        let document = serde_json::json!({"schema": "rivet.diagnosis.v1", "robot": "r", "verdict": "effect",
            "gap": {"before": figure, "after": 0.1, "noise_floor": 0.05, "per_joint":
                [{"joint": "a", "before": 0.3, "after": figure, "noise_floor": 0.05},
                 {"joint": "b", "before": null, "after": null, "noise_floor": null}]},
            "where": [], "causes": [cause(&["a", "b"]), cause(&[]), cause(&["b"])], "log": [], "hints": [],
            "unexplained_share": 0.1, "data": {"runs": 2, "fit_seconds": 10.0, "sealed_seconds": 5.0}, "remark": null});
        let document: Document = serde_json::from_value(document).expect("a document");
        failed(Some("arm"), log).with_diagnosis(document).expect("JSON")
    }

    fn read(path: &Path) -> Vec<Row> {
        let file = open(path).expect("a table").expect("there");
        let rows = RowIter::from_file_into(Box::new(file));
        rows.map(|record| serde_json::from_value(json(record.expect("a record")).expect("JSON")).expect("a row"))
            .collect()
    }

    fn added(path: &Path, rows: Vec<Row>, obsolete: &BTreeSet<Key>) -> usize {
        let keys: BTreeSet<Key> = rows.iter().map(Row::key).collect();
        merge(path, rows.into_iter().map(Ok), obsolete, |key| keys.contains(key)).expect("merged")
    }

    #[test]
    fn rows_return_bit_by_bit_in_the_order_of_their_keys() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("t.parquet");
        // One more bit than JSON of 16 digits keeps.
        let figure = f64::from_bits(0.1_f64.to_bits() + 1);
        let second = vec![failed(None, "z"), diagnosed("b", figure)];
        assert_eq!(added(&path, second.clone(), &BTreeSet::new()), 2);
        let first = vec![failed(Some("arm"), "a"), failed(Some("arm"), "c")];
        assert_eq!(added(&path, first.clone(), &BTreeSet::new()), 4);
        let rows = read(&path);
        assert_eq!(rows, [&second[0], &first[0], &second[1], &first[1]].map(Clone::clone));
        let low = rows[2].causes.as_ref().map(|causes| serde_json::to_value(&causes[2]).expect("JSON"));
        assert_eq!(low.and_then(|cause| cause["shrink_low"].as_f64()).map(f64::to_bits), Some(figure.to_bits()));
        let known = index(&path).expect("an index");
        assert_eq!(known.len(), 4);
        assert_eq!(known[&rows[2].key()].status, Status::Diagnosed);
        assert_eq!(known[&rows[1].key()].error_kind, Some(ErrorKind::Data));
    }

    #[test]
    fn replaces_rows_of_the_same_key_and_drops_obsolete_ones() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("t.parquet");
        added(&path, vec![failed(None, "a"), failed(Some("arm"), "a"), failed(Some("arm"), "b")], &BTreeSet::new());
        let obsolete = BTreeSet::from([failed(None, "a").key()]);
        assert_eq!(added(&path, vec![diagnosed("a", 0.5)], &obsolete), 2);
        assert_eq!(read(&path), [diagnosed("a", 0.5), failed(Some("arm"), "b")]);
    }

    #[test]
    fn row_groups_keep_the_order() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("t.parquet");
        let rows: Vec<Row> = (0..=2 * GROUP_ROWS).map(|k| failed(Some("arm"), &format!("{k:06}"))).collect();
        assert_eq!(added(&path, rows.clone(), &BTreeSet::new()), rows.len());
        assert_eq!(read(&path), rows);
        assert_eq!(open(&path).expect("a table").expect("there").num_row_groups(), 3);
    }

    #[test]
    fn refuses_what_is_no_table_and_leaves_it_alone() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("t.parquet");
        std::fs::write(&path, "q1,tau1\n").expect("written");
        assert!(index(&path).expect_err("no Parquet").to_string().contains("is no Parquet file"));
        rivet_logs::write_columns(&path, &[("t", &[0.0, 1.0][..])]).expect("written");
        assert!(index(&path).expect_err("a log").to_string().contains("is no table of diagnoses"));
        let before = std::fs::read(&path).expect("there");
        let keys = BTreeSet::new();
        assert!(merge(&path, std::iter::once(Ok(failed(None, "a"))), &keys, |_| true).is_err());
        assert_eq!(std::fs::read(&path).expect("there"), before);
    }

    #[test]
    fn a_damaged_table_is_an_error_and_no_panic() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("t.parquet");
        added(&path, (0..50).map(|k| diagnosed(&format!("{k:02}"), f64::from(k))).collect(), &BTreeSet::new());
        let bytes = std::fs::read(&path).expect("there");
        let mut refused = 0;
        for at in (4..bytes.len() - 8).step_by(bytes.len() / 64) {
            let mut damaged = bytes.clone();
            damaged[at..at + 8].fill(0xff);
            std::fs::write(&path, damaged).expect("written");
            refused += usize::from(index(&path).is_err());
        }
        assert!(refused > 5, "{refused}");
    }
}
