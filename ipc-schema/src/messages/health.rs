//! `rivet.Health.v7`

use iceoryx2::prelude::ZeroCopySend;

use super::{MAX_JOINTS, Stamped, message, wire_enum};

/// Bins of the histograms in [`Health`]: bin 0 counts 0 and 1 ns, bin b counts 2^b ..= 2^(b+1) - 1 ns,
/// the last bin everything from 2^31 ns (2.1 s) on.
pub const HISTOGRAM_BINS: usize = 32;

/// How the daemon is doing, a few times a second, on service `rivet/<robot>/health`.
///
/// Counters run since the daemon's start and never go back. Version 2 adds what the estimator says about its instruments and
/// its window, version 3 how far least squares can be trusted beside them, version 4 what is wrong with the input and how
/// much of the work is done, version 5 what was left aside, version 6 whether the state folder can be written, version 7 whether samples come without
/// the wake-up event.
#[derive(Clone, Copy, Debug, PartialEq, ZeroCopySend)]
#[cfg_attr(feature = "json", derive(serde::Serialize, schemars::JsonSchema))]
#[type_name("rivet.Health.v7")]
#[repr(C)]
pub struct Health {
    /// `seq` of the last joint state taken in.
    pub seq: u64,
    /// When this was written, `CLOCK_MONOTONIC` \[ns\].
    pub stamp_ns: u64,
    /// Joint states taken into the estimator.
    pub samples: u64,
    /// Joint states missing between sequence numbers.
    pub lost: u64,
    /// Joint states refused because their sequence number or stamp did not go forward.
    pub refused_stale: u64,
    /// Joint states refused because a value was not finite or could not be true, or joint count or period were wrong.
    pub refused_invalid: u64,
    /// Joint states not used because the robot set a fault bit.
    pub rejected_faults: u64,
    /// Interruptions of the stream after which the filters started anew.
    pub gaps: u64,
    /// Joint states without a setpoint of their own sequence number.
    pub setpoints_missing: u64,
    /// Periods that ended with samples still queued: the bound on catching up was reached.
    pub catch_up_limited: u64,
    /// Periods of the real-time thread.
    pub periods: u64,
    /// Periods that were missed because the thread woke or finished too late.
    pub overruns: u64,
    /// Messages the real-time thread could not hand to the publishing thread.
    pub dropped_messages: u64,
    /// Parameters held at present.
    pub held: u32,
    /// Parameters following the data at present.
    pub active: u32,
    /// A [`DaemonMode`].
    pub mode: u32,
    /// An [`InstrumentSource`](super::InstrumentSource).
    pub instruments: u32,
    /// RMS torque residual of each joint with the estimated parameters over the window \[N m, or N\].
    pub residual_rms: [f64; MAX_JOINTS],
    /// The same with the nominal parameters \[N m, or N\].
    pub nominal_residual_rms: [f64; MAX_JOINTS],
    /// RMS filtered torque of each joint over the same rows \[N m, or N\].
    pub torque_rms: [f64; MAX_JOINTS],
    /// Lateness of the wake-ups, see [`HISTOGRAM_BINS`].
    pub wake_histogram: [u32; HISTOGRAM_BINS],
    /// Work of a period from wake-up to done, see [`HISTOGRAM_BINS`].
    pub work_histogram: [u32; HISTOGRAM_BINS],
    /// Latest wake-up \[ns\].
    pub worst_wake_ns: u64,
    /// Longest work of a period \[ns\].
    pub worst_work_ns: u64,
    /// Delay of each joint behind its setpoint in slow motion \[s\], by the identified closed loop; NaN while unknown.
    pub loop_lag_s: [f64; MAX_JOINTS],
    /// Length of the cycle that the motion repeats \[s\]; NaN while none is known.
    pub cycle_s: f64,
    /// Length of the window \[s of motion\]; infinite while nothing is forgotten.
    pub window_s: f64,
    /// Durbin-Wu-Hausman statistic of the window: least squares (`Parameters::reference`) against the instruments; NaN while
    /// unknown.
    pub hausman: f64,
    /// Probability of a statistic as large as that if the regressor has no noise and the model is complete; NaN while
    /// unknown.
    pub hausman_p_value: f64,
    /// What noise in each joint's regressor puts on least squares, over what is left of it with instruments; NaN while
    /// unknown, and with delayed instruments, near 1 where the instruments see the same noise or the arm is far from its
    /// setpoint.
    pub instrument_ratio: [f64; MAX_JOINTS],
    /// Degrees of freedom of the statistic: joints whose regressor and instruments differ.
    pub hausman_degrees: u32,
    /// An [`InputFault`]: what is wrong with the samples now.
    pub input_fault: u32,
    /// The joints that it concerns, bit 0 the base's; zero where it concerns all or none.
    pub input_joints: u32,
    /// An [`InputFault`]: what was wrong last, now or before.
    pub last_input_fault: u32,
    /// A [`LoadLevel`]: what is left out because periods have become too short for the work.
    pub load_level: u32,
    /// Publishers of joint states at present: one, and one more where a network bridge mirrors them.
    pub publishers: u32,
    /// Times that each [`InputFault`] was met, by number: samples, or events where it is none of a sample.
    pub input_faults: [u64; INPUT_FAULTS],
    /// From the last faulty sample to the next row that was learnt from, of the last fault that is over \[s\]; NaN before.
    pub recovery_s: f64,
    /// Times that the load level changed.
    pub load_changes: u64,
    /// `seq` of the first sample under the present load level.
    pub load_seq: u64,
    /// Parameter sets that were late: more than `[realtime] stale_periods` behind the sample they were made from, reckoned
    /// from the least such delay seen. They carry that sample's stamp, as all do.
    pub late_sets: u64,
    /// Sound joint states that were left aside under [`LoadLevel::Hold`]; they are not among `samples`.
    pub samples_held: u64,
    /// Rows that were not learnt from because their torques are in doubt: signs, stuck sensors.
    pub rows_doubted: u64,
    /// A [`StateFolder`]: whether parameters and flight records can be written.
    pub state_folder: u32,
    /// 1 while joint states come without the wake-up event, so that a daemon that waits for it polls; else 0.
    pub polls: u32,
}

/// Entries of [`Health::input_faults`].
pub const INPUT_FAULTS: usize = 24;

wire_enum!(
    /// What is wrong with the samples.
    InputFault {
        /// Nothing.
        None = 0,
        /// Samples are missing between sequence numbers.
        Lost = 1,
        /// A sample has come twice.
        Duplicate = 2,
        /// A sample is older than the one before it.
        Reordered = 3,
        /// Positions stay as they are, to the bit, though the arm was moving.
        Frozen = 4,
        /// A position or torque is NaN or infinite.
        NotFinite = 5,
        /// A torque is pinned at the drive's limit.
        Saturated = 6,
        /// Torques have the sign opposite to the one that the motion needs.
        SignFlipped = 7,
        /// The stamp jumps, while sequence numbers go on.
        TimeJump = 8,
        /// A position jumps as no drive can move its joint.
        EncoderJump = 9,
        /// A torque stays as it is, to the bit, though the motion needs another.
        TorqueStuck = 10,
        /// No one publishes joint states any more.
        PublisherGone = 11,
        /// The robot controller began its sequence anew.
        PublisherRestarted = 12,
        /// A second publisher of joint states is there; its samples are not used.
        SecondPublisher = 13,
        /// The machine was suspended.
        ClockSuspended = 14,
        /// The robot controller set fault bits.
        RobotFault = 15,
        /// Samples come at another rate than the robot file says.
        WrongPeriod = 16,
        /// The joint count is not the arm's.
        WrongShape = 17,
        /// A value is beyond anything an arm does.
        Implausible = 18,
        /// Another version of a message that is read is spoken on its service: nothing is read until that has ended.
        WrongVersion = 19,
        /// /dev/shm is full: samples are sound, but no one can join.
        SharedMemoryFull = 20,
    }
);

wire_enum!(
    /// Whether a process can write its state folder ([`Health::state_folder`],
    /// [`ControllerHealth::state_folder`](super::ControllerHealth::state_folder)).
    StateFolder {
        /// It has none: nothing is stored or recorded.
        None = 0,
        /// It can be written.
        Writable = 1,
        /// It is missing or cannot be written.
        Unwritable = 2,
        /// It has no room.
        Full = 3,
    }
);

wire_enum!(
    /// What is left out because periods have become too short for the work, each level beside those before it.
    LoadLevel {
        /// Nothing.
        Normal = 0,
        /// Parameters are published at an eighth of the rate.
        PublishLess = 1,
        /// A quarter of the rows reaches the estimator.
        Decimate = 2,
        /// Nothing is learnt: parameters are held.
        Hold = 3,
    }
);

wire_enum!(
    /// What the daemon is doing ([`Health::mode`]).
    DaemonMode {
        /// Waiting for the first joint state, or filling the filters.
        Starting = 0,
        /// Estimating.
        Estimating = 1,
        /// Standing still by itself: no usable samples, a fault bit, or too little motion.
        Suspended = 2,
        /// Stopped by a control request.
        Frozen = 3,
        /// Samples were flowing and have stopped: no joint state for `[realtime] stale_periods`.
        Stale = 4,
        /// Stamps say that samples come at another rate than the robot file's `sample_period_s`: none is used, nothing is
        /// published.
        WrongPeriod = 5,
        /// Something is wrong with the samples ([`Health::input_fault`] says what): none is learnt from.
        BadInput = 6,
    }
);

message!(Health v 7, size 1016 align 8, empty Health {
    seq: 0, stamp_ns: 0, samples: 0, lost: 0, refused_stale: 0, refused_invalid: 0, rejected_faults: 0, gaps: 0,
    setpoints_missing: 0, catch_up_limited: 0, periods: 0, overruns: 0, dropped_messages: 0,
    held: 0, active: 0, mode: 0, instruments: 0,
    residual_rms: [0.0; MAX_JOINTS], nominal_residual_rms: [0.0; MAX_JOINTS], torque_rms: [0.0; MAX_JOINTS],
    wake_histogram: [0; HISTOGRAM_BINS], work_histogram: [0; HISTOGRAM_BINS], worst_wake_ns: 0, worst_work_ns: 0,
    loop_lag_s: [f64::NAN; MAX_JOINTS], cycle_s: f64::NAN, window_s: f64::NAN,
    hausman: f64::NAN, hausman_p_value: f64::NAN, instrument_ratio: [f64::NAN; MAX_JOINTS], hausman_degrees: 0,
    input_fault: 0, input_joints: 0, last_input_fault: 0, load_level: 0, publishers: 0,
    input_faults: [0; INPUT_FAULTS], recovery_s: f64::NAN, load_changes: 0, load_seq: 0, late_sets: 0,
    samples_held: 0, rows_doubted: 0, state_folder: 0, polls: 0,
}, {
    seq @ 0, stamp_ns @ 8, samples @ 16, lost @ 24, refused_stale @ 32, refused_invalid @ 40, rejected_faults @ 48,
    gaps @ 56, setpoints_missing @ 64, catch_up_limited @ 72, periods @ 80, overruns @ 88, dropped_messages @ 96,
    held @ 104, active @ 108, mode @ 112, instruments @ 116, residual_rms @ 120, nominal_residual_rms @ 184,
    torque_rms @ 248, wake_histogram @ 312, work_histogram @ 440, worst_wake_ns @ 568, worst_work_ns @ 576,
    loop_lag_s @ 584, cycle_s @ 648, window_s @ 656, hausman @ 664, hausman_p_value @ 672, instrument_ratio @ 680,
    hausman_degrees @ 744, input_fault @ 748, input_joints @ 752, last_input_fault @ 756, load_level @ 760,
    publishers @ 764, input_faults @ 768, recovery_s @ 960, load_changes @ 968, load_seq @ 976, late_sets @ 984,
    samples_held @ 992, rows_doubted @ 1000, state_folder @ 1008, polls @ 1012,
});

impl Stamped for Health {
    fn stamp_ns(&self) -> u64 {
        self.stamp_ns
    }
}
