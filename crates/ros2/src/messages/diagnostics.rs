//! `diagnostic_msgs/DiagnosticArray`

use serde::{Deserialize, Serialize};

use super::header::Header;

/// How several parts of a system are.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct DiagnosticArray {
    /// When this was found.
    pub header: Header,
    /// One part each.
    pub status: Vec<DiagnosticStatus>,
}

/// `diagnostic_msgs/DiagnosticStatus`
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct DiagnosticStatus {
    /// A [`Level`].
    pub level: u8,
    /// Program and part.
    pub name: String,
    /// How the part is.
    pub message: String,
    /// The robot.
    pub hardware_id: String,
    /// Details.
    pub values: Vec<KeyValue>,
}

/// `diagnostic_msgs/KeyValue`
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct KeyValue {
    /// What the value is, with its unit.
    pub key: String,
    /// The value.
    pub value: String,
}

/// Values of [`DiagnosticStatus::level`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum Level {
    /// All is well.
    Ok = 0,
    /// Someone should look.
    Warn = 1,
    /// It does not work.
    Error = 2,
    /// Nothing is received.
    Stale = 3,
}

super::ros_message!(DiagnosticArray, "diagnostic_msgs", "DiagnosticArray");
