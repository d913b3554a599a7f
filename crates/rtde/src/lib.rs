//! Reads a Universal Robots controller by RTDE, protocol version 2 (Universal Robots, "Real-Time Data Exchange (RTDE) Guide").
//!
//! [`package`] has the frames, [`recipe`] the typed fields, [`client`] the conversation over any `Read + Write`. [`robot`]
//! knows what the fields of such an arm mean, [`timeline`] counts samples that are missing. There is no socket and no clock
//! here: time comes in as numbers.
//!
//! Whatever bytes arrive, nothing panics, and at most [`package::MAX_SIZE`] bytes wait to be decoded.

pub mod client;
pub mod package;
pub mod recipe;
pub mod robot;
pub mod timeline;

pub use client::{Client, Event, Listener};
pub use package::{ControllerVersion, Level, RtdeError, TextMessage};
pub use recipe::{FieldType, Recipe, Values};
pub use robot::{Fields, Reading, RobotMode, SafetyMode, Torque};
pub use timeline::{Arrival, Timeline};
