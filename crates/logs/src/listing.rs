//! What a recording holds, before its columns are read.

use rivet_files::CONVENTIONS_OF_THE_MODEL;

/// A topic of a recording, or the one table of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Topic {
    /// Its name; empty for the one table of a file.
    pub name: String,
    /// Type of its messages, such as `sensor_msgs/msg/JointState`.
    pub kind: String,
    /// Number of messages or rows, where the recording states it.
    pub messages: Option<u64>,
    /// Whether its channels are read.
    pub is_read: bool,
}

/// A column of a recording.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Column {
    /// Its name: as in the file, `{topic}/{joint}/{field}` of a topic, `name[i]` of a list.
    pub name: String,
    /// Topic that it belongs to; columns of one topic have rows in common.
    pub topic: String,
    /// Unit that the file states.
    pub unit: Option<String>,
    /// First entry of a column of text.
    pub text: Option<String>,
    /// Whether the file has its numbers as integers.
    pub is_integer: bool,
}

/// Name of the array of text or attribute that states whose conventions the numbers follow.
pub(crate) const CONVENTIONS: &str = "conventions";

/// Whose conventions the numbers of a recording follow.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Conventions {
    /// Those of whatever recorded it: `[log]` of the robot file states signs, scales, zeros and units.
    #[default]
    Recorder,
    /// Those of the model: rivet wrote it. Nothing of `[log]` is applied.
    Model,
}

impl Conventions {
    /// What a text of a file states: those of the model, where it has the words of rivet.
    pub(crate) fn stated(text: &str) -> Conventions {
        if text.contains(CONVENTIONS_OF_THE_MODEL) { Conventions::Model } else { Conventions::Recorder }
    }
}

/// What a recording holds.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Listing {
    /// Format of the recording.
    pub format: &'static str,
    /// Topics.
    pub topics: Vec<Topic>,
    /// Columns, in the order of the recording.
    pub columns: Vec<Column>,
    /// What is wrong with it, although it can be read.
    pub warnings: Vec<String>,
    /// Whose conventions its numbers follow.
    pub conventions: Conventions,
}

impl Listing {
    /// Names of all columns.
    pub(crate) fn names(&self) -> Vec<String> {
        self.columns.iter().map(|column| column.name.clone()).collect()
    }
}
