//! `std_msgs/String`

use serde::{Deserialize, Serialize};

/// A text.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Text {
    /// The text.
    pub data: String,
}

super::ros_message!(Text, "std_msgs", "String");
