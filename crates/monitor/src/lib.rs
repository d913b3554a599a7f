//! What a robot's daemon and controller say of themselves: taken from the bus, as a screen and as text.
//!
//! Messages are shown whatever is in them: a number that is no mode is shown as that number.

mod json;
mod lines;
mod screen;
mod snapshot;
mod text;

pub use json::as_json;
pub use screen::{View, draw};
pub use snapshot::{Ports, Report, Snapshot, faults_met};
pub use text::as_text;
