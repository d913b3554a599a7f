//! Connects an arm that speaks ROS 2 to rivet, by DDS and without ROS: the program `rivet-ros2`, which `rivet ros2` starts.
//!
//! [`Intake`](intake::Intake) turns joint states and setpoints into samples of the bus. It knows no clock, network or bus.
//! [`report`], [`parameters`] and [`model`] make the messages that go out. [`run`] joins both with the graph and the bus.

mod error;
mod graph;
pub mod intake;
pub mod joints;
mod losses;
pub mod messages;
pub mod model;
mod outputs;
mod pairing;
pub mod parameters;
pub mod problems;
pub mod report;
mod run;
pub mod source;
mod stamps;

pub use error::Failure;
pub use graph::GraphError;
pub use run::run;
