//! What a robot's processes publish on the bus, as an MCAP file: joint states, setpoints, second encoders, parameters, health.
//!
//! Messages are JSON. Their schemas stand in the file, with the unit of each field. A chunk is closed every second: what
//! ends the process in the middle costs no more than the last one.
//!
//! | part | work |
//! |---|---|
//! | [`Ports`] | takes messages from the bus |
//! | [`Recorder`] | passes them to a thread of its own, which writes; counts what is missing |
//! | [`RecordingFile`] | the file |

mod counts;
mod error;
mod file;
mod message;
mod ports;
mod recorder;

pub use counts::{Counts, ServiceCounts};
pub use error::RecordingError;
pub use file::{About, RecordingFile};
pub use message::{Content, Received};
pub use ports::Ports;
pub use recorder::Recorder;
