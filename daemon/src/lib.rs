//! `rivetd`: the real-time estimator process.
//!
//! [`Core`] is pure: samples in, parameters out, bit for bit the same from the same samples. [`shell`] puts it between
//! the clock and the bus.

mod bus_thread;
mod consistent;
mod context;
mod core;
mod drift;
mod error;
mod fault_record;
mod flight;
mod keeper;
mod ladder;
mod loop_thread;
mod outbound;
mod progress;
mod reload;
mod said;
pub mod shell;
mod snapshot;
mod streams;
mod timing;

pub use crate::consistent::Projector;
pub use crate::core::{Core, Counts, Output, Refused};
pub use error::StartError;
pub use ladder::Ladder;
pub use loop_thread::{Channels, LoopSettings, RealTimeLoop, Wake};
pub use outbound::Outbound;
pub use progress::{Progress, Snapshot};
pub use reload::Incoming;
pub use shell::{Options, run};
pub use snapshot::{Asking, Snapshots, snapshots};
