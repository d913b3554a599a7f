//! What a robot's processes publish on the bus, as JSON and as an MCAP file: joint states, setpoints, second encoders, parameters,
//! health; and what follows from it: residual torque, friction curves, bands of parameters, states in words.
//!
//! Messages are JSON. Their schemas stand in the file, with the unit of each field. A chunk is closed every second: what
//! ends the process in the middle costs no more than the last one.
//!
//! | part | work |
//! |---|---|
//! | [`Ports`] | takes messages from the bus |
//! | [`Derived`] | computes what follows from them |
//! | [`Recorder`] | passes them to a thread of its own, which writes; counts what is missing |
//! | [`RecordingFile`] | the file |

mod bands;
mod counts;
mod derived;
mod error;
mod events;
mod file;
mod friction;
mod held;
mod message;
mod ports;
mod recorder;
mod residuals;
mod states;

pub use bands::{ParameterBand, ParameterBands, names};
pub use counts::{Counter, Counts, Origin, ServiceCounts};
pub use derived::Derived;
pub use error::RecordingError;
pub use events::{LogLine, Time};
pub use file::{About, RecordingFile};
pub use friction::{FrictionCurve, FrictionCurves};
pub use message::{Content, ENCODING, Received, SCHEMA_ENCODING, TOPICS, Topic, other_topic, services};
pub use ports::Ports;
pub use recorder::Recorder;
pub use residuals::Residual;
pub use states::States;
