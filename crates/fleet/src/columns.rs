//! The columns of the fleet table: their types, and how a row becomes values with Parquet's levels.

use std::sync::Arc;

use parquet::basic::{LogicalType, Repetition, TimeUnit, Type as PhysicalType};
use parquet::data_type::ByteArray;
use parquet::errors::ParquetError;
use parquet::schema::types::{Type, TypePtr};
use serde_json::Value;

/// Type of a column's cells.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Kind {
    /// UTF-8.
    Text,
    /// 64 bit float.
    Double,
    /// 64 bit integer.
    Integer,
    /// Microseconds since 1970-01-01 UTC.
    Time,
    /// List of texts.
    Texts,
    /// Map from text to a number or null.
    Numbers,
    /// List of structs.
    Structs(&'static [Column]),
}

/// A column of the table, or a field of its structs.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Column {
    pub(crate) name: &'static str,
    pub(crate) kind: Kind,
    pub(crate) is_nullable: bool,
    /// Content and unit, as documented.
    pub(crate) content: &'static str,
}

const fn required(name: &'static str, kind: Kind, content: &'static str) -> Column {
    Column { name, kind, is_nullable: false, content }
}

const fn nullable(name: &'static str, kind: Kind, content: &'static str) -> Column {
    Column { name, kind, is_nullable: true, content }
}

/// Fields of an entry of `joints`.
const JOINT: [Column; 7] = [
    required("joint", Kind::Text, "joint name of the URDF"),
    nullable("before", Kind::Double, "relative residual, nominal model"),
    nullable("after", Kind::Double, "relative residual with all causes"),
    nullable("noise_floor", Kind::Double, "relative noise floor"),
    nullable("before_nm", Kind::Double, "RMS residual, nominal model, N m"),
    nullable("after_nm", Kind::Double, "RMS residual with all causes, N m"),
    nullable("noise_floor_nm", Kind::Double, "noise floor, N m"),
];

/// Fields of an entry of `causes`.
const CAUSE: [Column; 12] = [
    required("effect", Kind::Text, "effect name"),
    required("joints", Kind::Texts, "joint names; empty: no joint or all"),
    required("magnitude", Kind::Numbers, "size by name with unit"),
    nullable("shrink_predicted", Kind::Double, "1 - after/before, predicted for the held-out log"),
    nullable("shrink_low", Kind::Double, "lower end of its 90 % interval"),
    nullable("shrink_high", Kind::Double, "upper end of its 90 % interval"),
    nullable("shrink_measured", Kind::Double, "1 - after/before, measured on the held-out log"),
    nullable("share", Kind::Double, "share of the squared gap on the training logs"),
    nullable("p_value", Kind::Double, "family-wise p-value"),
    nullable("confidence", Kind::Double, "0 to 1"),
    required("indistinguishable_from", Kind::Texts, "confounded effects and parameters"),
    nullable("separating_motion", Kind::Text, "motion that separates them"),
];

/// Columns of the table, in their order.
pub(crate) const COLUMNS: [Column; 33] = [
    nullable("robot", Kind::Text, "folder of the robot file below `--robots`; null where a log names no robot"),
    required("group_by", Kind::Text, "`log`, `folder` or `robot`"),
    required("log_group", Kind::Text, "path of the log, folder of the logs, or robot"),
    nullable("robot_file", Kind::Text, "path of the robot file"),
    required("logs", Kind::Texts, "paths in their order; of several the last is held out"),
    required("status", Kind::Text, "`diagnosed` or `failed`"),
    nullable("error_kind", Kind::Text, "of a failed row, see below"),
    nullable("error", Kind::Text, "of a failed row: the message"),
    nullable("exit_code", Kind::Integer, "of `rivet diagnose`; null after a signal and where it did not run"),
    nullable("verdict", Kind::Text, "`verdict` of the JSON"),
    nullable("remark", Kind::Text, "why nothing was evaluated"),
    nullable("robot_name", Kind::Text, "`name` in the robot file"),
    nullable("gap_before", Kind::Double, "relative residual of all joints, nominal model"),
    nullable("gap_after", Kind::Double, "relative residual with all causes"),
    nullable("gap_noise_floor", Kind::Double, "relative noise floor"),
    nullable("unexplained_share", Kind::Double, "share of the squared gap above the floor that remains"),
    nullable("runs", Kind::Integer, "logs, the held-out one included"),
    nullable("training_s", Kind::Double, "duration of the training logs, s"),
    nullable("held_out_s", Kind::Double, "duration of the held-out log, s"),
    nullable("joints", Kind::Structs(&JOINT), "base to flange"),
    nullable("causes", Kind::Structs(&CAUSE), "in the order of adoption; empty: no cause"),
    nullable("held_out", Kind::Text, "which log or part of it is held out"),
    nullable("model", Kind::Text, "hash of the nominal model"),
    nullable("notes", Kind::Text, "warnings of the diagnosis, one a line"),
    nullable("duration_s", Kind::Double, "wall-clock time of the diagnosis, s"),
    required("finished_at", Kind::Time, "end of the diagnosis, UTC"),
    required("channel_map", Kind::Texts, "values of `--map`"),
    required("rivet_version", Kind::Text, "version of rivet"),
    required("program_sha256", Kind::Text, "digest of the program"),
    nullable("robot_sha256", Kind::Text, "digest of the robot file"),
    required("log_sha256", Kind::Texts, "digest of each log"),
    required("fingerprint", Kind::Text, "digest of robot file, its URDFs, logs, `--map` and program"),
    nullable("diagnosis", Kind::Text, "JSON of the diagnosis without `passport`, `figures`, `export` and `curves`"),
];

const ELEMENT: [Column; 1] = [required("element", Kind::Text, "")];
const ENTRY: [Column; 2] = [required("key", Kind::Text, ""), nullable("value", Kind::Double, "")];

impl Kind {
    /// What a repeated entry consists of; nothing of a single value.
    fn fields(self) -> &'static [Column] {
        match self {
            Kind::Text | Kind::Double | Kind::Integer | Kind::Time => &[],
            Kind::Texts => &ELEMENT,
            Kind::Numbers => &ENTRY,
            Kind::Structs(fields) => fields,
        }
    }

    /// Name of the type in SQL.
    #[cfg(test)]
    fn sql(self) -> String {
        match self {
            Kind::Text => "VARCHAR".to_owned(),
            Kind::Double => "DOUBLE".to_owned(),
            Kind::Integer => "BIGINT".to_owned(),
            Kind::Time => "TIMESTAMP".to_owned(),
            Kind::Texts => "VARCHAR[]".to_owned(),
            Kind::Numbers => "MAP(VARCHAR, DOUBLE)".to_owned(),
            Kind::Structs(_) => "STRUCT[]".to_owned(),
        }
    }
}

impl Column {
    /// Columns of the file that hold it.
    fn leaves(&self) -> usize {
        self.kind.fields().iter().map(Column::leaves).sum::<usize>().max(1)
    }

    fn parquet_type(&self) -> Result<TypePtr, ParquetError> {
        let repetition = if self.is_nullable { Repetition::OPTIONAL } else { Repetition::REQUIRED };
        let single = |physical, logical| {
            let builder = Type::primitive_type_builder(self.name, physical).with_repetition(repetition);
            builder.with_logical_type(logical).build().map(Arc::new)
        };
        let group = |name: &str, repetition, logical, fields| {
            let builder = Type::group_type_builder(name).with_repetition(repetition);
            builder.with_logical_type(logical).with_fields(fields).build().map(Arc::new)
        };
        let fields = self.kind.fields().iter().map(Column::parquet_type).collect::<Result<Vec<_>, _>>()?;
        let (logical, name, entry) = match self.kind {
            Kind::Text => return single(PhysicalType::BYTE_ARRAY, Some(LogicalType::String)),
            Kind::Double => return single(PhysicalType::DOUBLE, None),
            Kind::Integer => return single(PhysicalType::INT64, None),
            Kind::Time => return single(PhysicalType::INT64, Some(LogicalType::timestamp(true, TimeUnit::MICROS))),
            Kind::Numbers => (LogicalType::Map, "key_value", fields),
            Kind::Texts => (LogicalType::List, "list", fields),
            Kind::Structs(_) => {
                (LogicalType::List, "list", vec![group("element", Repetition::REQUIRED, None, fields)?])
            }
        };
        let entries = group(name, Repetition::REPEATED, None, entry)?;
        group(self.name, repetition, Some(logical), vec![entries])
    }
}

/// The schema of a file with some of the columns.
pub(crate) fn schema(columns: &[Column]) -> Result<TypePtr, ParquetError> {
    let fields = columns.iter().map(Column::parquet_type).collect::<Result<Vec<_>, _>>()?;
    Type::group_type_builder("rivet").with_fields(fields).build().map(Arc::new)
}

/// Values of a column of the file, with their definition and repetition levels.
#[derive(Debug, Default)]
pub(crate) struct Leaf {
    pub(crate) texts: Vec<ByteArray>,
    pub(crate) doubles: Vec<f64>,
    pub(crate) integers: Vec<i64>,
    pub(crate) defined: Vec<i16>,
    pub(crate) repeated: Vec<i16>,
}

/// Levels at a place of a row.
#[derive(Clone, Copy)]
struct Level {
    repeated: i16,
    defined: i16,
    /// Lists around it.
    depth: i16,
}

/// Empty columns of the file.
pub(crate) fn leaves() -> Vec<Leaf> {
    (0..COLUMNS.iter().map(Column::leaves).sum()).map(|_| Leaf::default()).collect()
}

/// Appends a row to the columns of the file.
///
/// # Errors
/// A value is not of its column's type, or missing where it must not be.
pub(crate) fn append_row(row: &Value, leaves: &mut [Leaf]) -> Result<(), ParquetError> {
    append_fields(&COLUMNS, row, Level { repeated: 0, defined: 0, depth: 0 }, leaves)
}

fn append_fields(
    columns: &[Column],
    object: &Value,
    level: Level,
    mut leaves: &mut [Leaf],
) -> Result<(), ParquetError> {
    for column in columns {
        let (these, others) = leaves.split_at_mut(column.leaves());
        append(column, &object[column.name], level, these)?;
        leaves = others;
    }
    Ok(())
}

fn append(column: &Column, value: &Value, level: Level, leaves: &mut [Leaf]) -> Result<(), ParquetError> {
    let wrong = || ParquetError::General(format!("column {}: {value}", column.name));
    if value.is_null() && !column.is_nullable {
        return Err(wrong());
    }
    let defined = level.defined + i16::from(column.is_nullable && !value.is_null());
    let fields = column.kind.fields();
    let entries: Vec<Value> = match (column.kind, value) {
        (Kind::Texts, Value::Array(texts)) => texts.iter().map(|text| serde_json::json!({ "element": text })).collect(),
        (Kind::Structs(_), Value::Array(entries)) => entries.clone(),
        (Kind::Numbers, Value::Object(map)) => {
            map.iter().map(|(key, value)| serde_json::json!({ "key": key, "value": value })).collect()
        }
        (_, Value::Null) => Vec::new(),
        _ if fields.is_empty() => Vec::new(),
        _ => return Err(wrong()),
    };
    if entries.is_empty() {
        for leaf in leaves.iter_mut() {
            leaf.repeated.push(level.repeated);
            leaf.defined.push(defined);
        }
        let leaf = leaves.first_mut().ok_or_else(wrong)?;
        match column.kind {
            _ if value.is_null() => {}
            Kind::Text => leaf.texts.push(value.as_str().ok_or_else(wrong)?.into()),
            Kind::Double => leaf.doubles.push(value.as_f64().ok_or_else(wrong)?),
            Kind::Integer | Kind::Time => leaf.integers.push(value.as_i64().ok_or_else(wrong)?),
            Kind::Texts | Kind::Numbers | Kind::Structs(_) => {}
        }
        return Ok(());
    }
    for (place, entry) in entries.iter().enumerate() {
        let depth = level.depth + 1;
        let repeated = if place == 0 { level.repeated } else { depth };
        append_fields(fields, entry, Level { repeated, defined: defined + 1, depth }, leaves)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn documented(columns: &[Column]) -> String {
        let null = |column: &Column| if column.is_nullable { "yes" } else { "no" };
        let line = |c: &Column| format!("| `{}` | `{}` | {} | {} |\n", c.name, c.kind.sql(), null(c), c.content);
        "| column | type | null | content |\n|---|---|---|---|\n".to_owned()
            + &columns.iter().map(line).collect::<String>()
    }

    #[test]
    fn the_documented_schema_is_that_of_the_table() {
        let page = include_str!("../../../docs/fleet.md");
        for columns in [&COLUMNS[..], &JOINT, &CAUSE] {
            assert!(page.contains(&documented(columns)), "docs/fleet.md must contain\n{}", documented(columns));
        }
    }
}
