//! `rivet.ConsistentParameters.v1`

use iceoryx2::prelude::ZeroCopySend;

use super::{MAX_JOINTS, MAX_PARAMETERS, Parameters, Stamped, message};

/// Numbers of [`ConsistentParameters::bodies`]: ten a joint.
pub const BODY_VALUES: usize = 10 * MAX_JOINTS;

/// Physically consistent parameters near estimated ones, a few times a second, on service
/// `rivet/<robot>/parameters-consistent`: of an arm that can be built, with a mass matrix that is positive definite in
/// every pose. The estimated set itself, without that constraint, is on `rivet/<robot>/parameters`.
///
/// Which of the estimated sets is taken depends on when the projection has time; what becomes of one does not.
#[derive(Clone, Copy, Debug, PartialEq, ZeroCopySend)]
#[type_name("rivet.ConsistentParameters.v1")]
#[repr(C)]
pub struct ConsistentParameters {
    /// [`Parameters::epoch`] of the estimated set this was made from.
    pub epoch: u64,
    /// `seq` of that set.
    pub seq: u64,
    /// `stamp_ns` of that set, `CLOCK_MONOTONIC` \[ns\].
    pub stamp_ns: u64,
    /// `model_hash` of that set.
    pub model_hash: u64,
    /// How many entries of [`values`](Self::values) are in use.
    pub count: u32,
    /// How many joints there are, 1..=8.
    pub joints: u32,
    /// `flags` of that set.
    pub flags: u32,
    /// Zero. Padding is spelt out, so the layout can be read off the source.
    pub reserved: u32,
    /// Base parameters, in the order and units of the estimated ones.
    pub values: [f64; MAX_PARAMETERS],
    /// The link that each joint moves, ten numbers each: mass \[kg\], first moment x y z \[kg m\], inertia about the
    /// joint frame's origin xx xy yy xz yz zz \[kg m^2\], in the joint frame. What torque cannot tell is as in the URDF.
    pub bodies: [f64; BODY_VALUES],
    /// Torque between this set and the estimated one on the reference workload, RMS of each joint \[N m, or N\].
    pub torque_rms: [f64; MAX_JOINTS],
    /// The same over all joints, each in parts of its own torque \[%\].
    pub torque_percent: f64,
    /// Smallest eigenvalue of any link's pseudo-inertia \[kg, kg m, kg m^2\]: above zero.
    pub smallest_eigenvalue: f64,
}

message!(ConsistentParameters v 1, size 1792 align 8, empty ConsistentParameters {
    epoch: 0, seq: 0, stamp_ns: 0, model_hash: 0, count: 0, joints: 0, flags: 0, reserved: 0,
    values: [0.0; MAX_PARAMETERS], bodies: [0.0; BODY_VALUES], torque_rms: [0.0; MAX_JOINTS],
    torque_percent: 0.0, smallest_eigenvalue: 0.0,
}, {
    epoch @ 0, seq @ 8, stamp_ns @ 16, model_hash @ 24, count @ 32, joints @ 36, flags @ 40, reserved @ 44,
    values @ 48, bodies @ 1072, torque_rms @ 1712, torque_percent @ 1776, smallest_eigenvalue @ 1784,
});

impl ConsistentParameters {
    /// The message for a set, without the projection.
    pub fn of(set: &Parameters) -> ConsistentParameters {
        ConsistentParameters {
            epoch: set.epoch,
            seq: set.seq,
            stamp_ns: set.stamp_ns,
            model_hash: set.model_hash,
            count: set.count,
            joints: set.joints,
            flags: set.flags,
            ..ConsistentParameters::default()
        }
    }
}

impl Stamped for ConsistentParameters {
    fn stamp_ns(&self) -> u64 {
        self.stamp_ns
    }
}
