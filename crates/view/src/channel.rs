//! A channel that is offered.

/// A channel that is offered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Channel {
    /// Its topic.
    pub topic: String,
    /// Name of its schema.
    pub schema_name: String,
    /// JSON Schema of its messages.
    pub schema: String,
    /// Whether a client that subscribes gets the last message at once.
    pub is_kept: bool,
}
