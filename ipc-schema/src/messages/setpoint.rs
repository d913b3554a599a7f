//! `rivet.Setpoint.v1`

use iceoryx2::prelude::ZeroCopySend;

use super::{MAX_JOINTS, Stamped, message};

/// The planned motion of one period, on service `rivet/<robot>/setpoint`.
///
/// It carries the `seq` of the joint state of the same period and is published *before* it, so that
/// whoever takes in a joint state already holds its setpoint.
#[derive(Clone, Copy, Debug, PartialEq, ZeroCopySend)]
#[cfg_attr(feature = "json", derive(serde::Serialize, schemars::JsonSchema))]
#[type_name("rivet.Setpoint.v1")]
#[repr(C)]
pub struct Setpoint {
    /// `seq` of the joint state this plan belongs to.
    pub seq: u64,
    /// The instant the plan is for, `CLOCK_MONOTONIC` \[ns\].
    pub stamp_ns: u64,
    /// Planned joint positions \[rad, or m for a prismatic joint\].
    pub q: [f64; MAX_JOINTS],
    /// Planned joint velocities \[rad/s, m/s\].
    pub qd: [f64; MAX_JOINTS],
    /// Planned joint accelerations \[rad/s^2, m/s^2\].
    pub qdd: [f64; MAX_JOINTS],
    /// How many entries of the arrays are in use, 1..=8.
    pub joints: u32,
    /// Zero. No bit has a meaning yet; a reader ignores those it does not know.
    pub flags: u32,
}

message!(Setpoint v 1, size 216 align 8, empty Setpoint {
    seq: 0, stamp_ns: 0, q: [0.0; MAX_JOINTS], qd: [0.0; MAX_JOINTS], qdd: [0.0; MAX_JOINTS], joints: 0, flags: 0,
}, { seq @ 0, stamp_ns @ 8, q @ 16, qd @ 80, qdd @ 144, joints @ 208, flags @ 212 });

impl Setpoint {
    /// [`joints`](Self::joints) as a length that no message, however broken, takes out of the arrays.
    pub fn count(&self) -> usize {
        (self.joints as usize).min(MAX_JOINTS)
    }
}

impl Stamped for Setpoint {
    fn stamp_ns(&self) -> u64 {
        self.stamp_ns
    }
}
