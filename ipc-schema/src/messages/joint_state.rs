//! `rivet.JointState.v1`

use iceoryx2::prelude::ZeroCopySend;

use super::{MAX_JOINTS, Stamped, message};

/// The arm's measured state, one per control period, on service `rivet/<robot>/joint-state`.
///
/// Joints run from base to flange. All joint quantities are on the output side of the gear.
#[derive(Clone, Copy, Debug, PartialEq, ZeroCopySend)]
#[cfg_attr(feature = "json", derive(serde::Serialize, schemars::JsonSchema))]
#[type_name("rivet.JointState.v1")]
#[repr(C)]
pub struct JointState {
    /// +1 each period; a jump is a lost sample.
    pub seq: u64,
    /// When the encoders were latched, `CLOCK_MONOTONIC` \[ns\].
    pub stamp_ns: u64,
    /// Joint positions \[rad, or m for a prismatic joint\].
    pub q: [f64; MAX_JOINTS],
    /// Torque of each drive on its joint \[N m, or N\], positive about (along) the joint's axis; what the drive
    /// applies, not what it feels.
    pub tau: [f64; MAX_JOINTS],
    /// Temperature of each drive \[degC\]; NaN where none is measured.
    pub temperature: [f64; MAX_JOINTS],
    /// How many entries of the arrays are in use, 1..=8.
    pub joints: u32,
    /// Fault bits ([`faults`]); zero means every field may be used.
    pub faults: u32,
}

/// Bits of [`JointState::faults`].
pub mod faults {
    /// An encoder reading is not to be trusted.
    pub const ENCODER: u32 = 1 << 0;
    /// A torque (current) reading is not to be trusted.
    pub const TORQUE: u32 = 1 << 1;
    /// The drives are off or the brakes are closed: the torques do not belong to the motion.
    pub const STOPPED: u32 = 1 << 2;
    /// Any other reason of the robot's not to learn from this sample.
    pub const OTHER: u32 = 1 << 31;
}

message!(JointState v 1, size 216 align 8, empty JointState {
    seq: 0, stamp_ns: 0, q: [0.0; MAX_JOINTS], tau: [0.0; MAX_JOINTS],
    temperature: [f64::NAN; MAX_JOINTS], joints: 0, faults: 0,
}, { seq @ 0, stamp_ns @ 8, q @ 16, tau @ 80, temperature @ 144, joints @ 208, faults @ 212 });

impl JointState {
    /// [`joints`](Self::joints) as a length that no message, however broken, takes out of the arrays.
    pub fn count(&self) -> usize {
        (self.joints as usize).min(MAX_JOINTS)
    }
}

impl Stamped for JointState {
    fn stamp_ns(&self) -> u64 {
        self.stamp_ns
    }
}
