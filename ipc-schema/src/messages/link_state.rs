//! `rivet.LinkState.v1`

use iceoryx2::prelude::ZeroCopySend;

use super::{MAX_JOINTS, Stamped, message};

/// What second encoders see, on service `rivet/<robot>/link-state`; only for robots that have them.
///
/// It carries the `seq` of the joint state of the same period and is published *before* it, as the setpoint is: whoever
/// takes in a joint state already holds what belongs to it. A service of its own leaves joint states as they are.
#[derive(Clone, Copy, Debug, PartialEq, ZeroCopySend)]
#[cfg_attr(feature = "json", derive(serde::Serialize, schemars::JsonSchema))]
#[type_name("rivet.LinkState.v1")]
#[repr(C)]
pub struct LinkState {
    /// `seq` of the joint state this belongs to.
    pub seq: u64,
    /// When the encoders were latched, `CLOCK_MONOTONIC` \[ns\].
    pub stamp_ns: u64,
    /// Joint positions by the second encoder of each joint, in the zero and sign of the first \[rad, or m for a prismatic
    /// joint\]; NaN where a joint has none.
    pub q: [f64; MAX_JOINTS],
    /// How many entries of the array are in use, 1..=8.
    pub joints: u32,
    /// Zero. No bit has a meaning yet; a reader ignores those it does not know.
    pub flags: u32,
}

message!(LinkState v 1, size 88 align 8, empty LinkState {
    seq: 0, stamp_ns: 0, q: [f64::NAN; MAX_JOINTS], joints: 0, flags: 0,
}, { seq @ 0, stamp_ns @ 8, q @ 16, joints @ 80, flags @ 84 });

impl LinkState {
    /// [`joints`](Self::joints) as a length that no message, however broken, takes out of the arrays.
    pub fn count(&self) -> usize {
        (self.joints as usize).min(MAX_JOINTS)
    }
}

impl Stamped for LinkState {
    fn stamp_ns(&self) -> u64 {
        self.stamp_ns
    }
}
