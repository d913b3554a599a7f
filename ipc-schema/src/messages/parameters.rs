//! `rivet.Parameters.v2`

use iceoryx2::prelude::ZeroCopySend;

use super::{MAX_JOINTS, MAX_PARAMETERS, Stamped, message, wire_enum};

/// The base parameters as estimated, on service `rivet/<robot>/parameters` and, latest value, on the
/// blackboard of the same name.
///
/// What parameter `i` means follows from the robot file; two processes whose
/// [`model_hash`](Self::model_hash) is equal mean the same by it. Units are those of the parameter
/// (kg, kg m, kg m^2, N m, N m s/rad, ...). Version 2 adds the sample period.
#[derive(Clone, Copy, Debug, PartialEq, ZeroCopySend)]
#[cfg_attr(feature = "json", derive(serde::Serialize, schemars::JsonSchema))]
#[type_name("rivet.Parameters.v2")]
#[repr(C)]
pub struct Parameters {
    /// +1 each publication of one daemon, from 1.
    pub epoch: u64,
    /// `seq` of the last joint state that went in.
    pub seq: u64,
    /// When the estimate was made, `CLOCK_MONOTONIC` \[ns\].
    pub stamp_ns: u64,
    /// Says what the numbers mean: kinematics, gravity, structure and base columns of the model.
    pub model_hash: u64,
    /// How many entries of the parameter arrays are in use.
    pub count: u32,
    /// How many entries of the joint arrays are in use, 1..=8.
    pub joints: u32,
    /// Bits of [`parameter_flags`].
    pub flags: u32,
    /// An [`InstrumentSource`].
    pub instruments: u32,
    /// Estimated values; a parameter not identified keeps its nominal value.
    #[cfg_attr(feature = "json", serde(serialize_with = "crate::json::array"), schemars(with = "Vec<f64>"))]
    pub values: [f64; MAX_PARAMETERS],
    /// Standard deviation (1 sigma) of each value.
    #[cfg_attr(feature = "json", serde(serialize_with = "crate::json::array"), schemars(with = "Vec<f64>"))]
    pub std: [f64; MAX_PARAMETERS],
    /// Information of the window on each parameter, over that from which it moves if it stands alone: below 1 nothing is learnt
    /// about it.
    #[cfg_attr(feature = "json", serde(serialize_with = "crate::json::array"), schemars(with = "Vec<f64>"))]
    pub excitation: [f64; MAX_PARAMETERS],
    /// The same parameters by plain recursive least squares, for comparison.
    #[cfg_attr(feature = "json", serde(serialize_with = "crate::json::array"), schemars(with = "Vec<f64>"))]
    pub reference: [f64; MAX_PARAMETERS],
    /// A [`ParameterState`] each.
    #[cfg_attr(feature = "json", serde(serialize_with = "crate::json::array"), schemars(with = "Vec<u8>"))]
    pub state: [u8; MAX_PARAMETERS],
    /// Torque noise of each joint (1 sigma, after the model filter) that weighted its rows \[N m, or N\].
    pub torque_noise: [f64; MAX_JOINTS],
    /// RMS of the torque residual of each joint over the window \[N m, or N\].
    pub residual_rms: [f64; MAX_JOINTS],
    /// Sample period with which the daemon reckons \[s\]: derivatives are wrong where it is not the true one.
    pub sample_period_s: f64,
}

/// Bits of [`Parameters::flags`].
pub mod parameter_flags {
    /// The estimator stands still for want of usable samples or excitation.
    pub const SUSPENDED: u32 = 1 << 0;
    /// The estimator was stopped by a control request.
    pub const FROZEN: u32 = 1 << 1;
    /// Too little data so far for the values to be used in a controller.
    pub const PROVISIONAL: u32 = 1 << 2;
    /// Something is wrong with the samples (`Health::input_fault`): the values are those from before.
    pub const BAD_INPUT: u32 = 1 << 3;
    /// Late: further behind its sample than `[realtime] stale_periods`.
    pub const LATE: u32 = 1 << 4;
    /// Where the `LoadLevel` stands in the flags: two bits from this one on.
    pub const LOAD_SHIFT: u32 = 8;
}

wire_enum!(
    /// What became of one parameter ([`Parameters::state`]). On the wire one byte.
    ParameterState as u8 {
        /// Held at its nominal value: the data never said anything about it.
        Unidentified = 0,
        /// Follows the data.
        Active = 1,
        /// Was identified; held since because the present motion does not excite it.
        Held = 2,
    }
);

wire_enum!(
    /// Where the instruments of the instrumental-variable estimator come from.
    InstrumentSource {
        /// None: plain least squares.
        None = 0,
        /// Regressor of the planned motion (service `setpoint`).
        Setpoint = 1,
        /// Regressor of the measured motion, delayed.
        Delayed = 2,
        /// Regressor of the planned motion through the identified closed loop.
        SetpointThroughLoop = 3,
        /// Regressor of the motion that second encoders see (service `link-state`).
        SecondEncoder = 4,
        /// Regressor of the same phase of the previous cycle.
        PreviousCycle = 5,
    }
);

message!(Parameters v 2, size 4408 align 8, empty Parameters {
    epoch: 0, seq: 0, stamp_ns: 0, model_hash: 0, count: 0, joints: 0, flags: 0, instruments: 0,
    values: [0.0; MAX_PARAMETERS], std: [0.0; MAX_PARAMETERS], excitation: [0.0; MAX_PARAMETERS],
    reference: [0.0; MAX_PARAMETERS], state: [0; MAX_PARAMETERS],
    torque_noise: [0.0; MAX_JOINTS], residual_rms: [0.0; MAX_JOINTS],
    sample_period_s: 0.0,
}, {
    epoch @ 0, seq @ 8, stamp_ns @ 16, model_hash @ 24, count @ 32, joints @ 36, flags @ 40, instruments @ 44,
    values @ 48, std @ 1072, excitation @ 2096, reference @ 3120, state @ 4144, torque_noise @ 4272,
    residual_rms @ 4336, sample_period_s @ 4400,
});

impl Parameters {
    /// [`count`](Self::count) as a length that no message, however broken, takes out of the arrays.
    pub fn len(&self) -> usize {
        (self.count as usize).min(MAX_PARAMETERS)
    }

    /// Whether the message carries no parameter at all (the blackboard before the first publication).
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }
}

impl Stamped for Parameters {
    fn stamp_ns(&self) -> u64 {
        self.stamp_ns
    }
}
