//! How a log has to be read: as it is, with another sign, unit, order or clock, or of another arm than the file's.
//!
//! Pure: no file, clock or bus; a function of positions, torques and the robot's model.
//!
//! Each reading is a hypothesis: faults of the channels ([`Fault`]) together with what the arm is like ([`ArmState`]: a payload,
//! offsets, a counterbalance, friction that drifts, a sensor behind the gear). All are compared on the same rows by prior and
//! marginal likelihood, so that a reading with more freedom pays for it. [`priors`] states every prior with its reason;
//! `regression` the likelihood.
//!
//! ```text
//! stretches -> low-pass, rows at which joints move
//!      -> log evidence of the log as it is, for every state of the arm
//!      -> of every fault beside the likely states; of a second and third fault beside the best
//!      -> posterior probabilities, the most probable reading, alternatives, what would decide
//! ```

mod arm_state;
mod candidates;
mod compare;
mod fault;
pub mod priors;
mod publishers;
mod regression;
mod samples;

pub use arm_state::{ArmState, FileUnit, RobotFile};
pub use compare::{Reading, Screening, screen};
pub use fault::{Columns, Fault, Of};
pub use publishers::second_publisher;
pub use samples::Stretch;
