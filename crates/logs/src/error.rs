//! Why a log was refused: file, column, row, value and the rule that was broken.

use std::path::{Path, PathBuf};

use rivet_files::Content;

/// A log that was refused, or a file that could not be written.
#[derive(Debug, thiserror::Error)]
#[error("{}: {fault}", path.display())]
pub struct LogError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it.
    pub fault: LogFault,
}

/// What to give in place of a file that is no recording.
fn instead_of_recording(content: Content) -> &'static str {
    match content {
        Content::Toml | Content::Urdf | Content::Xacro | Content::Mjcf | Content::Sdf => {
            "the order is ROBOT.toml LOG..., of `rivet inspect` and `rivet convert` RECORDING ROBOT.toml"
        }
        Content::Device => "record to a file first",
        _ => "give a recording; docs/logs.md has the formats",
    }
}

/// What is wrong with a log. Rows count from 1, the header of a CSV file is not a row.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LogFault {
    /// The operating system refused.
    #[error("{0}")]
    Io(#[from] std::io::Error),
    /// Neither Parquet nor CSV, or a damaged file.
    #[error("cannot be read as {format}: {why}")]
    Format {
        /// The format tried, e.g. `Parquet`.
        format: &'static str,
        /// What the decoder said.
        why: String,
    },
    /// A file of another kind.
    #[error("is {content}, not a recording; {}", instead_of_recording(*content))]
    OtherFile {
        /// What it holds.
        content: Content,
    },
    /// Nothing is in it.
    #[error("is empty: {what}; record it again, or give another file")]
    Empty {
        /// What there is not, or is instead, e.g. `0 bytes`.
        what: &'static str,
    },
    /// Times that are those of a log in another unit.
    #[error(
        "column t looks like {}: rows are {step} apart. State the unit: --map time_unit={unit}, or time_unit = \"{unit}\" in [log] \
         of robot.toml",
        spelled(unit)
    )]
    TimeUnit {
        /// The unit: `ms`, `us` or `ns`.
        unit: &'static str,
        /// Usual step between two rows, in that unit.
        step: f64,
    },
    /// A name with the ending of no format that is written.
    #[error("its ending is that of no format that is written; end it with one of {known}")]
    UnknownEnding {
        /// The endings that are known.
        known: String,
    },
    /// A column the contract asks for is not there.
    #[error("column {column} is missing; {rule}")]
    MissingColumn {
        /// Name of the column.
        column: String,
        /// The rule that asks for it.
        rule: String,
    },
    /// A column appears twice.
    #[error("column {column} appears twice; a column has one name")]
    TwiceColumn {
        /// Name of the column.
        column: String,
    },
    /// A column of a joint the robot does not have.
    #[error("column {column} belongs to a joint the robot does not have: it has {joints} joints")]
    JointCount {
        /// Name of the column.
        column: String,
        /// Number of joints of the robot.
        joints: usize,
    },
    /// A column that does not hold numbers.
    #[error("column {column} has type {kind}; a column holds numbers (float or integer)")]
    ColumnType {
        /// Name of the column.
        column: String,
        /// Its type in the file.
        kind: String,
    },
    /// A cell that is empty, not a number, or not finite.
    #[error("column {column}, row {row}: {value}; every value must be a finite number")]
    Value {
        /// Name of the column.
        column: String,
        /// Row, from 1.
        row: usize,
        /// The value as found.
        value: String,
    },
    /// Columns of unequal length.
    #[error("column {column} has {rows} rows, column t has {expected}; all columns have one length")]
    Length {
        /// Name of the column.
        column: String,
        /// Its number of rows.
        rows: usize,
        /// Number of rows of `t`.
        expected: usize,
    },
    /// Time stands still, or as good as, or runs backwards.
    #[error(
        "column t, row {row}: {value} s after {previous} s; time must increase from row to row, by a nanosecond at least"
    )]
    Time {
        /// Row, from 1.
        row: usize,
        /// Time of that row \[s\].
        value: f64,
        /// Time of the row before it \[s\].
        previous: f64,
    },
    /// Too short to work with.
    #[error("{rows} rows; at least {least} are needed {purpose}")]
    TooFewRows {
        /// Rows found.
        rows: usize,
        /// Rows needed.
        least: usize,
        /// For what.
        purpose: &'static str,
    },
    /// Neither torque nor current with a gain.
    #[error("has neither tau1..{joints} nor current1..{joints}; without torque nothing can be identified")]
    NoTorque {
        /// Number of joints of the robot.
        joints: usize,
    },
    /// Current, but nothing that turns it into torque.
    #[error(
        "has current1..{joints} but no tau1..{joints}; give the drive gain in N m/A \
         (`drive_gain` in robot.toml)"
    )]
    NoDriveGain {
        /// Number of joints of the robot.
        joints: usize,
    },
    /// Torque columns at most, where the robot file takes torque from current.
    #[error("has no current1..{joints}, from which torque is to be taken (`torque_from` in robot.toml)")]
    NoCurrent {
        /// Number of joints of the robot.
        joints: usize,
    },
    /// A list of the robot file of the wrong length.
    #[error("{name} has {found} values, the robot has {joints} joints")]
    SettingLength {
        /// Name of the list.
        name: &'static str,
        /// Its length.
        found: usize,
        /// Number of joints of the robot.
        joints: usize,
    },
    /// A number that no signal of an arm has: sums with it would soon be infinite.
    #[error("column {column}, row {row}: {value:e}; no value may be beyond {limit:e} (s, rad, N m, A)")]
    Beyond {
        /// Name of the column.
        column: String,
        /// Row, from 1.
        row: usize,
        /// The value as found.
        value: f64,
        /// Largest that is taken.
        limit: f64,
    },
    /// A log that says next to nothing of each of the rows that would be made of it.
    #[error(
        "{rows} rows over {duration_s} s make {wanted:.3e} at {period_s} s; at most a thousand for each and {most:e} in all are \
         made up between them: is column t in seconds?"
    )]
    TooManyRows {
        /// Rows of the log.
        rows: usize,
        /// What they span \[s\].
        duration_s: f64,
        /// Rows that would be made.
        wanted: f64,
        /// How far they would be apart \[s\].
        period_s: f64,
        /// Most that are made.
        most: f64,
    },
    /// More than one group of columns may be a quantity.
    #[error(
        "more than one group of columns may be the {what}: {candidates}. Choose one: --map {key}=PATTERN, or {key} in [log] of robot.toml"
    )]
    Ambiguous {
        /// The quantity.
        what: &'static str,
        /// Its key.
        key: &'static str,
        /// Patterns of the groups.
        candidates: String,
    },
    /// No group of columns has all joints.
    #[error(
        "no group of columns has positions of all joints ({joints}). Columns like positions: {columns}. Name them in the order of the \
         joints: --map q=COLUMN,COLUMN,..., or q in [log] of robot.toml"
    )]
    Unmatched {
        /// Names or number of the joints.
        joints: String,
        /// Columns that look like positions.
        columns: String,
    },
    /// What is stated of a channel does not fit the recording.
    #[error("{key} (--map, or [log] of robot.toml): {why}")]
    Map {
        /// The key.
        key: String,
        /// What does not fit, and what to do.
        why: String,
    },
    /// A sampling period that makes no sense.
    #[error("sampling period {0} s; it must be a positive number")]
    Period(f64),
}

fn spelled(unit: &str) -> &str {
    match unit {
        "ms" => "milliseconds",
        "us" => "microseconds",
        "ns" => "nanoseconds",
        other => other,
    }
}

impl LogFault {
    /// Names the file the fault was found in.
    pub(crate) fn at(self, path: &Path) -> LogError {
        LogError { path: path.to_path_buf(), fault: self }
    }
}
