//! What is the same for all forms of one effect: its name, its kind, where it shows, and what the verdict has to know of it.

use crate::effects::variable::Variable;

/// A wrong value, or a missing effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A wrong value of something the model has: verdict `parameter`.
    Value,
    /// Something the model lacks: verdict `effect`.
    Structure,
}

/// The entry of an effect in the list.
pub(crate) struct About {
    /// The name in reports.
    pub(crate) name: &'static str,
    pub(crate) kind: Kind,
    /// The quantity in which it shows, without and with a temperature in the run.
    pub(crate) variable: [Variable; 2],
    /// The motion that separates it from others.
    pub(crate) motion: &'static str,
    /// A value of a drive: friction or rotor.
    pub(crate) is_drive: bool,
    /// The body of one link: its joint and those before it feel it.
    pub(crate) is_link_body: bool,
    /// Inertia of the arm itself, which a data sheet gives.
    pub(crate) is_inertia: bool,
    /// A factor of the whole torque of a joint.
    pub(crate) is_gain: bool,
    /// It cuts the command: what is beyond is in the measured torque only.
    pub(crate) cuts_command: bool,
    /// It acts at times that no motion predicts.
    pub(crate) is_intermittent: bool,
    /// On all joints; a gap in motion is evidence enough, as most of the whole gap may be stiction.
    pub(crate) is_judged_in_motion: bool,
    /// A load pulls in every pose: it takes something from any motion.
    pub(crate) acts_in_every_pose: bool,
    /// A torque signal whose zero is off looks the same in motion.
    pub(crate) is_like_torque_zero: bool,
    /// It grows with the torque that the gear carries.
    pub(crate) grows_with_load: bool,
    /// A torque over the angle that balances gravity.
    pub(crate) balances_gravity: bool,
    /// With its form nothing is left: a joint that keeps a gap has something else.
    pub(crate) is_exact: bool,
    /// Its form differs from the true one: what it leaves says nothing against it.
    pub(crate) is_inexact: bool,
}

impl About {
    /// An effect without any peculiarity: a function of the angle, separated by motion of its own joint.
    pub(crate) const fn new(name: &'static str, kind: Kind) -> About {
        About {
            name,
            kind,
            variable: [Variable::Angle; 2],
            motion: "each joint alone, slow and fast, over its whole range",
            is_drive: false,
            is_link_body: false,
            is_inertia: false,
            is_gain: false,
            cuts_command: false,
            is_intermittent: false,
            is_judged_in_motion: false,
            acts_in_every_pose: false,
            is_like_torque_zero: false,
            grows_with_load: false,
            balances_gravity: false,
            is_exact: false,
            is_inexact: false,
        }
    }

    /// A friction law: a function of the joint's speed.
    pub(crate) const fn friction(name: &'static str, kind: Kind) -> About {
        About { variable: [Variable::Speed; 2], ..About::new(name, kind) }
    }
}

/// Slow moves in both directions.
pub(crate) const BOTH_DIRECTIONS: &str =
    "slow moves in both directions through the same poses, with the torque signal's zero known";
/// Constant speeds.
pub(crate) const CONSTANT_SPEEDS: &str = "constant speeds from very slow to fast, each in both directions";
/// A chirp.
pub(crate) const CHIRP: &str =
    "a chirp through 1 to 20 Hz: delay grows with the first, elasticity with the second power of frequency";
/// One slow speed over the range, then twice that.
pub(crate) const SLOW_SPEEDS: &str = "one slow constant speed over the joint's whole range, then twice that speed";
/// Static poses of one joint.
pub(crate) const JOINT_POSES: &str = "static poses over the joint's whole range, from both sides";
/// Static poses of the arm.
pub(crate) const ARM_POSES: &str = "static poses with the wrist turned, joint 1 at several angles";
