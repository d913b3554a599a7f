//! `rivet.Drift.v1`

use iceoryx2::prelude::ZeroCopySend;

use super::{MAX_JOINTS, Stamped, message, wire_enum};

/// Entries of [`DriftRegime`].
pub const DRIFT_REGIMES: usize = 4;

/// What the accepted model leaves of each joint's torque, by how the joint moves, and whether the arm has left it; with every
/// health message, on service `rivet/<robot>/drift`.
///
/// The accepted model is the robot file's, as the daemon read it last. Arrays by regime have [`MAX_JOINTS`] numbers of the first
/// regime, then of the next; NaN where nothing is known yet.
#[derive(Clone, Copy, Debug, PartialEq, ZeroCopySend)]
#[cfg_attr(feature = "json", derive(serde::Serialize, schemars::JsonSchema))]
#[type_name("rivet.Drift.v1")]
#[repr(C)]
pub struct Drift {
    /// `seq` of the last joint state taken in.
    pub seq: u64,
    /// When this was written, `CLOCK_MONOTONIC` \[ns\].
    pub stamp_ns: u64,
    /// Hash of the model with its robot file, as in `Parameters`.
    pub model_hash: u64,
    /// How many entries of the arrays are in use, 1..=8.
    pub joints: u32,
    /// A [`DriftVerdict`]: left if any joint has, unresolved if none has left and any is unresolved.
    pub verdict: u32,
    /// A [`DriftVerdict`] each.
    pub joint_verdict: [u32; MAX_JOINTS],
    /// `seq` of the joint state with which each joint's verdict became what it is.
    pub since_seq: [u64; MAX_JOINTS],
    /// RMS residual of now over that after acceptance, over the same regimes; NaN while unresolved.
    pub ratio: [f64; MAX_JOINTS],
    /// RMS torque residual with the accepted model over the last seconds of motion in a regime \[N m, or N\].
    pub residual_rms: [f64; DRIFT_REGIMES * MAX_JOINTS],
    /// The same over the first seconds in it after the model was accepted.
    pub reference_rms: [f64; DRIFT_REGIMES * MAX_JOINTS],
}

wire_enum!(
    /// How a joint moves.
    DriftRegime {
        /// Near a reversal: at less than a tenth of its speed limit, and changing quickly.
        Reversal = 0,
        /// At less than a tenth of its speed limit.
        Slow = 1,
        /// Faster, at about constant speed.
        Cruise = 2,
        /// Faster, and changing its speed by itself in a quarter of a second.
        Accelerating = 3,
    }
);

wire_enum!(
    /// Whether the arm is still the one that was accepted ([`Drift::verdict`]).
    DriftVerdict {
        /// Too little motion since the model was accepted, or since then in other regimes only.
        Unresolved = 0,
        /// The accepted model leaves about what it left at first.
        Within = 1,
        /// It leaves clearly more.
        Left = 2,
    }
);

message!(Drift v 1, size 704 align 8, empty Drift {
    seq: 0, stamp_ns: 0, model_hash: 0, joints: 0, verdict: 0, joint_verdict: [0; MAX_JOINTS],
    since_seq: [0; MAX_JOINTS], ratio: [f64::NAN; MAX_JOINTS],
    residual_rms: [f64::NAN; DRIFT_REGIMES * MAX_JOINTS], reference_rms: [f64::NAN; DRIFT_REGIMES * MAX_JOINTS],
}, {
    seq @ 0, stamp_ns @ 8, model_hash @ 16, joints @ 24, verdict @ 28, joint_verdict @ 32, since_seq @ 64, ratio @ 128,
    residual_rms @ 192, reference_rms @ 448,
});

impl Stamped for Drift {
    fn stamp_ns(&self) -> u64 {
        self.stamp_ns
    }
}
