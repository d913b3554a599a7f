//! `rivet.ControllerHealth.v5`

use iceoryx2::prelude::ZeroCopySend;

use super::{MAX_JOINTS, Stamped, message, wire_enum};

/// Entries of [`ControllerHealth::refusals`].
pub const REFUSALS: usize = 16;

/// Entries of [`ControllerHealth::stop_causes`].
pub const STOP_CAUSES: usize = 24;

/// How the controller is doing and which parameters it trusts, a few times a second and at every change, on service
/// `rivet/<robot>/controller-health`.
///
/// Counters run since the controller's start and never go back.
#[derive(Clone, Copy, Debug, PartialEq, ZeroCopySend)]
#[cfg_attr(feature = "json", derive(serde::Serialize, schemars::JsonSchema))]
#[type_name("rivet.ControllerHealth.v5")]
#[repr(C)]
pub struct ControllerHealth {
    /// `seq` of the last joint state answered.
    pub seq: u64,
    /// When this was written, `CLOCK_MONOTONIC` \[ns\].
    pub stamp_ns: u64,
    /// Joint states answered with a command.
    pub commands: u64,
    /// Joint states skipped over: the controller takes the newest.
    pub passed_over: u64,
    /// Joint states not answered because their sequence number did not go forward.
    pub refused_stale: u64,
    /// Joint states not answered because of fault bits, a wrong joint count, a position that is not finite or a wrong rate.
    pub refused_invalid: u64,
    /// Times the stop reaction began.
    pub stops: u64,
    /// Commands in which the law gave a torque that is not finite.
    pub broken: u64,
    /// Commands in which a joint was at its torque limit.
    pub saturated: u64,
    /// Commands in which a joint's torque was held back by its rate limit.
    pub rate_limited: u64,
    /// Setpoints that were beyond a joint's position or velocity limit and were brought back to it.
    pub setpoints_limited: u64,
    /// Parameter sets that passed the gate.
    pub accepted: u64,
    /// Times the source of the parameters changed.
    pub switches: u64,
    /// Epoch of the set accepted last; 0 before the first.
    pub epoch: u64,
    /// `seq` of the last joint state that went into that set.
    pub parameters_seq: u64,
    /// Joint states of a second publisher, left out while the first one sends.
    pub foreign_joint_states: u64,
    /// Setpoints of a second publisher, left out likewise.
    pub foreign_setpoints: u64,
    /// Parameter sets of a second publisher, left out likewise.
    pub foreign_parameters: u64,
    /// Times a joint came further from its plan than `[controller] tracking_error`.
    pub strayed: u64,
    /// Setpoints that were refused: not finite, absurd, a jump, or beyond the drives' torque.
    pub setpoints_refused: u64,
    /// Times the plan was followed again after a stop.
    pub resumed: u64,
    /// How often the stop reaction began for which [`StopCause`]; the entry is its number.
    pub stop_causes: [u64; STOP_CAUSES],
    /// How many sets were refused for which [`ParameterRefusal`]; the entry is its number.
    pub refusals: [u64; REFUSALS],
    /// A [`ParameterSource`]: whose parameters make the torque.
    pub source: u32,
    /// A [`SourceReason`]: why it is this source.
    pub source_reason: u32,
    /// A [`ParameterRefusal`]: what became of the last set.
    pub last_refusal: u32,
    /// A [`ControllerState`].
    pub state: u32,
    /// A [`StopCause`]: why the stop reaction began last.
    pub stop_cause: u32,
    /// Joints that this concerns, bit 0 the base's; 0 where it concerns none or all.
    pub stop_joints: u32,
    /// A [`StopCause`]: why a setpoint was refused last.
    pub plan_refusal: u32,
    /// Joints that this concerns, likewise.
    pub plan_joints: u32,
    /// How many entries of the joint arrays are in use, 1..=8.
    pub joints: u32,
    /// A [`StateFolder`](super::StateFolder): whether flight records can be written.
    pub state_folder: u32,
    /// RMS of planned minus measured position over about the last second \[rad, or m\].
    pub tracking_rms: [f64; MAX_JOINTS],
    /// RMS error of the acting parameters on the recent torques of each joint \[N m, or N\]; NaN where it did not move.
    pub prediction_rms: [f64; MAX_JOINTS],
    /// The same of the robot file's parameters.
    pub nominal_prediction_rms: [f64; MAX_JOINTS],
    /// Largest step of the command from one period to the next \[N m, or N\].
    pub largest_step: [f64; MAX_JOINTS],
    /// 1 while joint states come without the wake-up event, so that the controller polls; else 0.
    pub polls: u32,
    /// Zero. Padding is spelt out, so the layout can be read off the source.
    pub reserved: u32,
}

wire_enum!(
    /// Whose parameters make the torque ([`ControllerHealth::source`]).
    ParameterSource {
        /// Those of the robot file.
        Nominal = 0,
        /// The last ones that were found good: of the daemon's store, or in use when it fell silent.
        LastGood = 1,
        /// Those that the daemon publishes.
        Live = 2,
    }
);

wire_enum!(
    /// Why the source is what it is ([`ControllerHealth::source_reason`]).
    SourceReason {
        /// Nothing else was there at the start.
        Start = 0,
        /// Found in the daemon's store at the start.
        Stored = 1,
        /// Enough published sets in a row passed the gate.
        Adopted = 2,
        /// No set came for too long.
        Silent = 3,
        /// Sets came, but none passed the gate for too long.
        Refused = 4,
        /// What was in use predicted recent torques worse than the robot file's parameters, for some time.
        WorseThanNominal = 5,
        /// The last good ones have predicted recent torques better than the robot file's, for some time.
        BetterThanNominal = 6,
        /// The inertia matrix of what was in use fell below a tenth of the robot file's in some direction, at the pose of the time.
        InertiaNotPositive = 7,
    }
);

wire_enum!(
    /// Why a published set may not act ([`ControllerHealth::last_refusal`]).
    ParameterRefusal {
        /// It passed.
        None = 0,
        /// Made for another model: kinematics, gravity, structure or base columns differ.
        OtherModel = 1,
        /// Its number of parameters is not the model's.
        WrongCount = 2,
        /// Made from samples not newer than those of the set before: a repeated or replayed message.
        Old = 3,
        /// Made from samples that have not come yet.
        Future = 4,
        /// Made from samples too long ago.
        Stale = 5,
        /// Its epoch is not newer than that of the set before, while the daemon is alive: a second publisher, or a
        /// replayed message.
        EpochBack = 6,
        /// The daemon itself says that it has too little data.
        Provisional = 7,
        /// A value is not finite.
        NotFinite = 8,
        /// Friction would drive a joint.
        DrivingFriction = 9,
        /// The inertia matrix is not positive definite, at the present pose or at a stored one.
        InertiaNotPositive = 10,
        /// It would change the torque of the present setpoint by more than permitted.
        TorqueChange = 11,
        /// It predicts recent torques worse than what is in use, or than the robot file.
        PredictsWorse = 12,
        /// It differs from what is in use, and the arm has not moved enough to tell which is better.
        NotJudged = 13,
        /// Made by a daemon that reckons with another sample period, or while samples come at another rate than the robot
        /// file's.
        OtherPeriod = 14,
        /// The arm would need several times its drives' torque to carry itself, or against friction.
        Implausible = 15,
    }
);

wire_enum!(
    /// What the controller is doing ([`ControllerHealth::state`]).
    ControllerState {
        /// No joint state has come yet.
        Waiting = 0,
        /// The arm is held where it is: nobody plans, or the plan is far from the arm.
        Holding = 1,
        /// The plan is followed.
        Following = 2,
        /// The stop reaction acts; [`ControllerHealth::stop_cause`] says why.
        Stopping = 3,
        /// The arm came too far from its plan: the stop reaction acts.
        Strayed = 4,
        /// Stamps say that samples come at another rate than the robot file's `sample_period_s`: none is answered.
        WrongPeriod = 5,
    }
);

wire_enum!(
    /// Why the stop reaction began ([`ControllerHealth::stop_cause`]).
    StopCause {
        /// Nothing: the stop reaction has not acted yet.
        None = 0,
        /// No joint state came for `[controller] stale_periods`.
        Silence = 1,
        /// Joint states came whose sequence numbers did not go forward.
        OldSamples = 2,
        /// The robot controller set fault bits.
        RobotFault = 3,
        /// Joint states have another number of joints.
        WrongShape = 4,
        /// A position or a torque is not finite.
        NotFinite = 5,
        /// A position or a torque is beyond all that an arm can have.
        Implausible = 6,
        /// Joint states come at another rate than the robot file's `sample_period_s`.
        WrongPeriod = 7,
        /// A position repeats although its joint moves, or its plan has left it.
        Frozen = 8,
        /// A position changed faster than any drive moves its joint.
        EncoderJump = 9,
        /// A joint is beyond its speed limit.
        TooFast = 10,
        /// A joint does not move as the commanded torque moves it.
        NoResponse = 11,
        /// A measured torque is opposite to the commanded one.
        SignFlipped = 12,
        /// A measured torque repeats although the commanded one changes.
        TorqueStuck = 13,
        /// A commanded torque was at its limit for longer than `[controller] saturation_ms`.
        Saturated = 14,
        /// A joint is further from its plan than `[controller] tracking_error`.
        TrackingError = 15,
        /// The plan has a number that is not finite, or another number of joints.
        PlanNotFinite = 16,
        /// The plan has a number beyond all that an arm can do.
        PlanImplausible = 17,
        /// The plan jumps further than the joint can follow.
        PlanJump = 18,
        /// The plan needs more torque than the drives have.
        PlanAcceleration = 19,
    }
);

message!(ControllerHealth v 5, size 792 align 8, empty ControllerHealth {
    seq: 0, stamp_ns: 0, commands: 0, passed_over: 0, refused_stale: 0, refused_invalid: 0, stops: 0, broken: 0,
    saturated: 0, rate_limited: 0, setpoints_limited: 0, accepted: 0, switches: 0, epoch: 0, parameters_seq: 0,
    foreign_joint_states: 0, foreign_setpoints: 0, foreign_parameters: 0, strayed: 0, setpoints_refused: 0, resumed: 0,
    stop_causes: [0; STOP_CAUSES], refusals: [0; REFUSALS], source: 0, source_reason: 0, last_refusal: 0, state: 0,
    stop_cause: 0, stop_joints: 0, plan_refusal: 0, plan_joints: 0, joints: 0, state_folder: 0,
    tracking_rms: [0.0; MAX_JOINTS], prediction_rms: [f64::NAN; MAX_JOINTS],
    nominal_prediction_rms: [f64::NAN; MAX_JOINTS], largest_step: [0.0; MAX_JOINTS],
    polls: 0, reserved: 0,
}, {
    seq @ 0, stamp_ns @ 8, commands @ 16, passed_over @ 24, refused_stale @ 32, refused_invalid @ 40, stops @ 48,
    broken @ 56, saturated @ 64, rate_limited @ 72, setpoints_limited @ 80, accepted @ 88, switches @ 96, epoch @ 104,
    parameters_seq @ 112, foreign_joint_states @ 120, foreign_setpoints @ 128, foreign_parameters @ 136,
    strayed @ 144, setpoints_refused @ 152, resumed @ 160, stop_causes @ 168, refusals @ 360, source @ 488,
    source_reason @ 492, last_refusal @ 496, state @ 500, stop_cause @ 504, stop_joints @ 508, plan_refusal @ 512, plan_joints @ 516, joints @ 520,
    state_folder @ 524, tracking_rms @ 528, prediction_rms @ 592, nominal_prediction_rms @ 656, largest_step @ 720,
    polls @ 784, reserved @ 788,
});

impl Stamped for ControllerHealth {
    fn stamp_ns(&self) -> u64 {
        self.stamp_ns
    }
}
