//! What a recording holds, before its columns are read.

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
}

impl Listing {
    /// Names of all columns.
    pub(crate) fn names(&self) -> Vec<String> {
        self.columns.iter().map(|column| column.name.clone()).collect()
    }
}
