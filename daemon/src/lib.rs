//! `rivetd`: the real-time estimator process.
//!
//! [`Core`] is pure: samples in, parameters out, bit for bit the same from the same samples. [`shell`] puts it between
//! the clock and the bus.

mod bus_thread;
mod consistent;
mod core;
mod error;
mod keeper;
mod loop_thread;
mod progress;
mod reload;
pub mod shell;

pub use crate::consistent::Projector;
pub use crate::core::{Core, Counts, Output, Refused};
pub use error::StartError;
pub use shell::{Options, run};
