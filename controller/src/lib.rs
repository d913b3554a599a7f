//! `rivet-controller`: computed torque from the parameters that `rivetd` publishes.
//!
//! [`Core`] is pure: samples, setpoints and parameter sets in, commands out. [`shell`] puts it between the clock and the
//! bus.

mod core;
mod error;
pub mod gate;
pub mod law;
pub mod output;
pub mod shell;
mod velocity;

pub use crate::core::{Core, Counts, Skipped};
pub use error::StartError;
pub use shell::{Options, run};
