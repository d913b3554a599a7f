//! `rivet-controller`: torque from the parameters that `rivetd` publishes, as far as they can be trusted.
//!
//! [`Core`] is pure: samples, setpoints and parameter sets in, commands out. [`shell`] puts it between the clock and the
//! bus.

mod allocation;
mod core;
mod desired;
mod error;
pub mod gate;
mod governor;
mod history;
mod inertia;
pub mod law;
mod limits;
mod matrix;
pub mod output;
mod plan;
mod recent;
mod service_thread;
pub mod shell;
mod source;
mod stop;
mod stop_text;
mod velocity;
mod watch;

pub use crate::core::{Core, Counts, Skipped};
pub use error::StartError;
pub use shell::{Options, run};
pub use stop_text::stop_text;
