//! What rivet's processes say to each other: messages of fixed layout, service names, and the shared-memory
//! bus that carries them. The only crate that names `iceoryx2`.
//!
//! ```no_run
//! use rivet_ipc_schema::{Bus, BusConfig, JointState, RobotName};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let robot = RobotName::new("ur10e")?;
//! let bus = Bus::open(&BusConfig::default(), &robot, "example")?;
//! let joint_state = bus.joint_state_subscriber()?;
//! while let Some(sample) = joint_state.receive()? {
//!     println!("{}: {:?}", sample.seq, &sample.q[..sample.count()]);
//! }
//! # Ok(())
//! # }
//! ```
//!
//! # Who may call what in a real-time thread
//!
//! [`Subscriber::receive`], [`BlackboardReader::latest`] and [`BlackboardWriter::write`] neither allocate nor
//! make a system call (as long as no publisher joins or leaves). Everything else does: publishers, events,
//! control and every opening belong on another thread. A [`Bus`] and its ports stay on the thread that
//! opened them; a second thread opens its own. Only a [`BlackboardReader`] may move to another thread.

mod blackboard;
mod bus;
mod bus_config;
mod cleanup;
mod control;
mod error;
mod event;
mod join;
#[cfg(feature = "json")]
mod json;
mod layout;
mod messages;
mod name;
mod old_numbers;
mod one_source;
mod owner;
mod pubsub;
mod sample_clock;
mod service;
mod survey;
mod version;
mod words;

pub use blackboard::{BlackboardReader, BlackboardWriter};
pub use bus::{Bus, LEAST_ROOM};
pub use bus_config::BusConfig;
pub use cleanup::{BusWatch, Leftovers, PrivateBus, cleanup, ensure_room, purge, sweep_private};
pub use control::{Answer, ControlClient, ControlServer};
pub use error::{BusError, PortError, Verdict, VersionMismatch};
pub use event::{Listener, Notifier, SampleWait};
pub use layout::{Enumeration, Layout};
pub use messages::*;
pub use name::RobotName;
pub use old_numbers::OldNumbers;
pub use one_source::OneSource;
pub use owner::{Owned, Ownership, User, ownership};
pub use pubsub::{Publisher, Subscriber};
pub use sample_clock::SampleClock;
pub use service::Service;
pub use survey::{Survey, survey};
pub use words::words;
