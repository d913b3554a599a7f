//! The simulated robot: a pure plant core, motions to command it with, and the process that plays a robot controller.
//!
//! The plant core ([`Plant`], [`Truth`], [`closed_loop`]), the motions ([`motion`]) and the stand-in's decisions
//! ([`StandIn`]) know no clock, file or bus; [`process`] does.

mod closed_loop;
mod friction;
mod inject;
mod integrator;
mod mechanics;
pub mod motion;
mod plant;
pub mod process;
mod random;
mod sensors;
mod stand_in;
mod truth;
pub mod two_mass;

pub use closed_loop::{Record, SetpointRef, closed_loop};
pub use friction::FrictionLaw;
pub use inject::{Injected, Injector, Recorded};
pub use mechanics::Vector;
pub use plant::{Plant, PlantSettings};
pub use random::Random;
pub use sensors::{Measurement, Sensors};
pub use stand_in::{BLOCK_S, BUILD_UP_S, Counts, Sample, StandIn, TrackingBlock};
pub use truth::{Disturbances, Payload, Truth};
