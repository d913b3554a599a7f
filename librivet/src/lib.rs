//! Connects a robot controller to rivet: samples go out, torque, parameters and health come in.
//!
//! The C interface is in `include/librivet.h`, with a wrapper for C++ in `include/librivet.hpp`. Rust uses [`Robot`]:
//!
//! ```no_run
//! use rivet::{BusConfig, Robot, Sample};
//! use std::time::Duration;
//!
//! # fn main() -> Result<(), rivet::OpenError> {
//! let mut robot = Robot::open(&BusConfig::default(), "ur10e", 6)?;
//! let mut sample = Sample::default();
//! sample.q[..6].copy_from_slice(&[0.0; 6]); // measured, [rad]
//! robot.publish(&sample);
//! if let Some(command) = robot.wait_for_command(Duration::from_micros(500)) {
//!     println!("{:?}", &command.tau[..6]); // [N m]
//! }
//! # Ok(())
//! # }
//! ```
//!
//! # Threads
//!
//! [`Robot::open`] starts one thread. It owns the ports that allocate or work on files. The functions of the cycle reach it
//! through a wait-free queue: they neither allocate nor block. The thread has the scheduling of the thread that calls `open`.

pub mod abi;
mod clock;
mod latest;
mod ports;
mod robot;
mod sample;
mod status;

pub use abi::RIVET_ABI;
pub use clock::now_ns;
pub use rivet_ipc_schema::{BusConfig, Command, ControllerHealth, Health, Parameters, faults};
pub use robot::{Counters, OpenError, QUEUE, Robot};
pub use sample::{Sample, sample_flags};
pub use status::Status;
