//! `rivet.Command.v1`

use iceoryx2::prelude::ZeroCopySend;

use super::{MAX_JOINTS, Stamped, message, wire_enum};

/// The torque the controller asks for, latest value on blackboard `rivet/<robot>/command`.
///
/// A robot ignores a command whose [`stamp_ns`](Self::stamp_ns) is older than a few periods: a blackboard
/// keeps the last value of a writer that has died.
#[derive(Clone, Copy, Debug, PartialEq, ZeroCopySend)]
#[type_name("rivet.Command.v1")]
#[repr(C)]
pub struct Command {
    /// `seq` of the joint state this answers.
    pub seq: u64,
    /// When the torque was computed, `CLOCK_MONOTONIC` \[ns\].
    pub stamp_ns: u64,
    /// Torque each drive shall apply to its joint \[N m, or N\], positive about (along) the joint's axis.
    pub tau: [f64; MAX_JOINTS],
    /// How many entries of the array are in use, 1..=8.
    pub joints: u32,
    /// A [`CommandMode`].
    pub mode: u32,
}

wire_enum!(
    /// Which model the torque of a [`Command`] was computed with.
    CommandMode {
        /// No torque is asked for: the robot uses its own control (`tau` is zero).
        None = 0,
        /// The nominal parameters of the robot file.
        Nominal = 1,
        /// The parameters published by the daemon.
        Identified = 2,
    }
);

message!(Command v 1, size 88 align 8, empty Command {
    seq: 0, stamp_ns: 0, tau: [0.0; MAX_JOINTS], joints: 0, mode: 0,
}, { seq @ 0, stamp_ns @ 8, tau @ 16, joints @ 80, mode @ 84 });

impl Stamped for Command {
    fn stamp_ns(&self) -> u64 {
        self.stamp_ns
    }
}
