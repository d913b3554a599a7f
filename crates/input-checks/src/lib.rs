//! Checks of what is measured: encoders that freeze or jump, torques that do not belong to the motion.
//!
//! The daemon checks before it learns from a sample, the controller before it acts on one. Both use these checks. Nothing here
//! knows a clock, a file or a bus, and nothing allocates after construction.

mod drive;
mod motion;
mod readings;
mod torque;
mod window;

pub use drive::DriveCheck;
pub use motion::{MotionCheck, MotionLimits, Planned};
pub use readings::ReadingCheck;
pub use torque::TorqueCheck;
pub use window::MeanMotion;

/// Readings that repeat for longer are no pause of an encoder that is read less often than samples are sent: the joint rests, or its encoder is
/// frozen \[s\].
pub const LONGEST_REPEAT_S: f64 = 0.012;

/// What is wrong with a reading.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// A position repeats although its joint moves.
    Frozen,
    /// A position changes faster than any drive can move its joint.
    EncoderJump,
    /// A measured torque stays at its drive's limit.
    Saturated,
    /// A measured torque is opposite to that of the motion.
    SignFlipped,
    /// A measured torque repeats although the motion needs another one.
    TorqueStuck,
    /// A joint is beyond its speed limit.
    TooFast,
    /// A joint does not move as the commanded torque moves it.
    NoResponse,
    /// A commanded torque has been at the drive's limit for too long.
    CommandSaturated,
}

/// A fault and the joints that it concerns, bit 0 the base's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Found {
    /// What is wrong.
    pub fault: Fault,
    /// On which joints.
    pub joints: u32,
}

/// What the robot file says of one joint.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct JointLimits {
    /// Step of the encoder \[rad, or m\].
    pub resolution: f64,
    /// Most torque of the drive \[N m, or N\].
    pub torque: f64,
    /// Whether the joint turns: a whole turn is the same place.
    pub revolute: bool,
    /// Torque beyond what it was in motion that friction may hold at rest \[N m, or N\]: see [`breakaway`]. With 0 a joint that stays where its
    /// setpoint goes on is frozen, whatever holds it.
    pub breakaway: f64,
}

/// Torque that friction may hold at rest beyond what it was in motion, in parts of the Coulomb friction that is known: a joint that turns
/// round holds the kinetic and the static level, 1 and up to 1.3, of friction that differs by half from what is known.
const BREAKAWAY_TIMES: f64 = 3.0;
/// The same where the robot file has no friction, as a share of the torque limit.
const UNKNOWN_BREAKAWAY_SHARE: f64 = 0.15;
/// What else the model may miss, as a share of the torque limit.
const UNKNOWN_SHARE: f64 = 0.05;

/// [`JointLimits::breakaway`] of a joint with Coulomb friction `coulomb`, 0 where it is not known, and torque limit `torque`.
pub fn breakaway(coulomb: f64, torque: f64) -> f64 {
    let friction = if coulomb > 0.0 { BREAKAWAY_TIMES * coulomb } else { UNKNOWN_BREAKAWAY_SHARE * torque };
    friction + UNKNOWN_SHARE * torque
}

/// The part of a sample that is checked: one entry a joint, all finite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading<'a> {
    /// Sequence number.
    pub seq: u64,
    /// Positions \[rad, or m\].
    pub q: &'a [f64],
    /// Torques \[N m, or N\].
    pub tau: &'a [f64],
}
