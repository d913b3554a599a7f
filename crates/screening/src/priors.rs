//! Every prior of the screening, with its reason. Probabilities are of one log before its torque is compared with the model.
//!
//! They state how often logs are read wrongly, not how a data set looks: a factor of three in any of them moves a log
//! probability by one, and a reading is reported from [`REPORTED`] on.

use std::f64::consts::TAU;

// ---- The log ----------------------------------------------------------------------------------------------------------

/// Cut-off of the low-pass on positions and torques \[Hz\]: arms move below it, and friction turns in less than its period.
pub const BAND_HZ: f64 = 5.0;
/// The cut-off as a share of the sampling rate, at most: second differences of slower logs are noise above it.
pub const BAND_OVER_RATE: f64 = 0.15;
/// Rows of one piece of a log that are compared are so many periods of the cut-off apart \[-\]: closer ones repeat each other.
pub const ROWS_PER_BAND_PERIOD: f64 = 2.0;
/// Rows of a log that are compared, at most: more cost time and decide nothing, see [`COARSENING`].
pub const MAX_ROWS: usize = 300;
/// Rows below which a log says nothing of its reading.
pub const MIN_ROWS: usize = 20;
/// A joint moves at a row whose speed is this share of the joint's rms speed: nearer to a reversal the direction of friction
/// is that of the low-pass.
pub const MIN_SPEED_OVER_RMS: f64 = 0.15;
/// A joint whose filtered position varies by less than this, in its own unit, does not move \[rad\].
pub const MIN_TRAVEL: f64 = 2e-3;
/// Torque that varies by less than this share of the torque limit has no shape that a reading could explain \[-\].
pub const MIN_TORQUE_OVER_LIMIT: f64 = 1e-6;

// ---- The residual -----------------------------------------------------------------------------------------------------

/// Independent rows that a joint's likelihood is worth, at most. The model is only approximately that of the arm, so that its
/// residuals are alike over seconds; the likelihood is raised to a power (a coarsened posterior, Miller and Dunson 2019).
pub const COARSENING: f64 = 40.0;
/// What an arm's torque keeps beside the best values of the model, as a share of its rms: ripple, presliding, temperature.
pub const INADEQUACY: f64 = 0.03;
/// The same of a torque that was computed by a model: rounding.
pub const COMPUTED_INADEQUACY: f64 = 1e-3;
/// The same of a torque that was computed by the file's own model, and how far its values are off as a share: both signals pass the
/// low-pass apart, which shows near reversals.
pub const COMMANDED_INADEQUACY: f64 = 1e-2;
/// White noise of a torque that was computed, as a share of its rms, at most: it is that of its digits.
pub const MAX_COMPUTED_NOISE: f64 = 3e-4;
/// How many rows that prior of the residual is worth.
pub const INADEQUACY_ROWS: f64 = 4.0;

// ---- Values of the robot file -----------------------------------------------------------------------------------------

/// Standard deviation of masses, first moments and inertias from CAD, as a share of the body's.
pub const BODY_SPREAD: f64 = 0.1;
/// The same of a body whose file is rough: estimated masses, another version of the arm.
pub const ROUGH_BODY_SPREAD: f64 = 0.4;
/// The same where the arm is another one.
pub const OTHER_BODY_SPREAD: f64 = 2.0;
/// Values of a file that were identified, as shares: bodies, friction, rotors. Friction differs from day to day.
pub const ACCURATE_SPREADS: [f64; 3] = [0.03, 0.2, 0.15];
/// Rotor inertias of data sheets, as a share.
pub const ROTOR_SPREAD: f64 = 0.3;
/// Friction depends on temperature, load and wear: as a share of the file's.
pub const FRICTION_SPREAD: f64 = 0.4;
/// A rough file's friction and rotor inertia, as a share of its values.
pub const ROUGH_DRIVE_SPREAD: f64 = 2.0;
/// The same where the bodies are from CAD: friction and rotors are then of the right size.
pub const ESTIMATED_DRIVE_SPREAD: f64 = 0.8;
/// Friction that the file does not know, as a share of the torque limit: harmonic drives take 3 to 15 % of it.
pub const UNKNOWN_FRICTION_OVER_LIMIT: f64 = 0.1;
/// A torque limit over the largest torque of gravity of the file's bodies, at most [-]: what is above is a placeholder. Drives give two to
/// four times that torque.
pub const LIMIT_OVER_GRAVITY: f64 = 5.0;
/// Zero of a torque signal, as a share of the torque limit.
pub const OFFSET_OVER_LIMIT: f64 = 0.01;
/// An offset worth its name, as a share of the torque limit.
pub const LARGE_OFFSET_OVER_LIMIT: f64 = 0.2;
/// A payload or a missing tool, as a share of the moving mass of the arm.
pub const PAYLOAD_OVER_MASS: f64 = 0.15;
/// Lever of a payload from the flange \[m\].
pub const PAYLOAD_LEVER_M: f64 = 0.15;
/// Torque of a counterbalance or a spring, as a share of the torque limit.
pub const COUNTERBALANCE_OVER_LIMIT: f64 = 0.3;
/// Friction that changes while it is logged, as a share of the file's.
pub const DRIFT_SPREAD: f64 = 0.5;
/// Friction and rotor inertia that a sensor behind the gear still sees (bearings, cables), as a share of the file's.
pub const LINK_SIDE_SPREAD: f64 = 0.05;

// ---- What the arm is like (probabilities; they add up to one with what is left for the file as it is) -------------------

/// The file's values were identified.
pub const ACCURATE: f64 = 0.2;
/// The file is rough in friction and rotor inertia alone.
pub const ROUGH_DRIVES: f64 = 0.15;
/// The file is rough.
pub const ROUGH: f64 = 0.15;
/// A payload or tool that the file does not know, or one that it has and the arm has not.
pub const PAYLOAD: f64 = 0.08;
/// Torque signals with a large zero.
pub const OFFSETS: f64 = 0.05;
/// A spring or counterbalance of one joint.
pub const COUNTERBALANCE: f64 = 0.02;
/// Friction that changes while it is logged: a start from cold.
pub const DRIFT: f64 = 0.03;
/// A torque sensor behind the gear, with a file of the motor's friction.
pub const LINK_SIDE: f64 = 0.01;
/// A torque that was computed by a model of the links.
pub const COMPUTED: f64 = 0.003;
/// A torque that a controller computed by the file's own model: commanded or fed forward.
pub const COMMANDED: f64 = 0.003;
/// The file of another arm, of the same kinematics.
pub const OTHER_ARM: f64 = 0.001;
/// A unit in the URDF (g, mm, g mm²), each.
pub const FILE_UNIT: f64 = 0.0005;

// ---- How the log has to be read (probabilities before the torque is seen) ------------------------------------------------

/// The sign of the torque of one joint, or of its position: conventions of vendors differ by joint. Shared by the joints.
pub const ONE_SIGN: f64 = 0.004;
/// All torques, or all positions, with the other sign.
pub const ALL_SIGNS: f64 = 0.002;
/// All positions in another unit, each of the usual ones.
pub const POSITION_UNIT: f64 = 0.002;
/// One position in another unit or scale. Shared by joints and units.
pub const ONE_POSITION_UNIT: f64 = 0.001;
/// All torques in another unit, each of the usual ones.
pub const TORQUE_UNIT: f64 = 0.001;
/// The torque of one joint times a factor (gain, ratio, unit). Shared by the joints.
pub const ONE_TORQUE_SCALE: f64 = 0.002;
/// Motor currents, or shares of the rated torque: each joint has its own factor.
pub const EACH_TORQUE_SCALE: f64 = 0.002;
/// Full scale of a joint's signal in a unit of its own, over its torque limit: standard deviation of the natural logarithm about the
/// other joints'. Drives are made for the loads of their joints.
pub const FULL_SCALE_SPREAD: f64 = 0.5;
/// A free factor is uniform over this many natural logarithms (0.001 to 1000) ...
pub const FACTOR_SPAN: f64 = 13.8;
/// ... and is found to this: the ratio is what freedom costs.
pub const FACTOR_WIDTH: f64 = 0.1;
/// Torque or position columns of two joints, or both, exchanged. Shared by the pairs.
pub const EXCHANGED: f64 = 0.003;
/// Joints counted from the flange.
pub const BACK_TO_FRONT: f64 = 0.001;
/// Torque without the torque of gravity.
pub const WITHOUT_GRAVITY: f64 = 0.003;
/// Torque of forces from outside: drivers publish it next to the measured one, under names that are alike.
pub const EXTERNAL: f64 = 0.002;
/// Of a torque without that of the file's model: share of the whole torque that its noise is at least compared with [-]. What no model
/// has of an arm stays in it.
pub const SIGNAL_OVER_TORQUE: f64 = 0.3;
/// Another mounting than the file's, shared by five directions.
pub const MOUNTING: f64 = 0.003;
/// The zero of one joint elsewhere by a quarter or half a turn. Shared by joints and angles.
pub const JOINT_ZERO: f64 = 0.003;
/// Torque logged late by one clock. Shared by the delays.
pub const LATE: f64 = 0.005;
/// Torque of one joint logged late. Shared by joints and delays.
pub const ONE_LATE: f64 = 0.002;
/// Rms of what a torque of one sign has of the other sign over its rms, at most: a curve between uneven samples swings over [-].
pub const MAX_BELOW_OVER_RMS: f64 = 0.02;
/// A torque without sign that comes down to this share of its rms touches zero [-].
pub const TOUCH_OVER_RMS: f64 = 0.05;
/// It is away from zero again above this share [-].
pub const AWAY_OVER_RMS: f64 = 0.3;
/// A signed torque that touches zero goes on to the other sign in half of the cases. Log likelihood of one touch without.
pub const TOUCH: f64 = -std::f64::consts::LN_2;
/// Touches that count, at most: what is left of a signal's shape repeats itself.
pub const MAX_TOUCHES: usize = 20;
/// Torque without its sign, of all joints.
pub const UNSIGNED: f64 = 0.002;
/// Of one joint, shared by the joints: an absolute value is taken of all or of none.
pub const ONE_UNSIGNED: f64 = 0.000_2;
/// A torque as commanded where it exceeds its limit (integrators wind up), in place of what the drive gives. Shared by the joints.
pub const BEYOND_LIMIT: f64 = 0.01;
/// What a drive gives at most, as a share of the file's limit, each less by a seventh: supplies and settings take it down to a quarter.
pub const LIMITS_OVER_FILE: [f64; 10] = [1.0, 0.86, 0.74, 0.64, 0.55, 0.47, 0.41, 0.35, 0.3, 0.26];

/// Faults of one log, at most.
pub const MAX_FAULTS: usize = 4;

/// A fault whose log posterior with rough values is this far behind the best reading is not asked with other states of the arm:
/// a tool or offsets bring less.
pub const FAR_BEHIND: f64 = 40.0;

/// Units of positions: factor that makes radians of them, and name.
pub const POSITION_UNITS: [(f64, &str); 5] = [
    (TAU, "in turns"),
    (TAU / 360.0, "in degrees"),
    (1e-3, "in milliradians"),
    (2.0, "at half scale"),
    (0.5, "at twice their scale"),
];
/// Units of torques: factor that makes N m of them, and name.
pub const TORQUE_UNITS: [(f64, &str); 7] = [
    (1e-3, "in mN m"),
    (1e3, "in kN m"),
    (1e-2, "in N cm"),
    (9.80665, "in kgf m"),
    (0.098_066_5, "in kgf cm"),
    (2.0, "at half scale"),
    (0.5, "at twice their scale"),
];
/// Delays that are tried \[s\], from less than a sample of a slow log to a buffer of a fifth of a second.
pub const DELAYS_S: [f64; 16] =
    [0.008, 0.012, 0.018, 0.027, 0.035, 0.045, 0.055, 0.065, 0.08, 0.095, 0.11, 0.125, 0.14, 0.155, 0.17, 0.19];
/// A delay up to this is that of a drive, or of two samples of a log at 100 Hz, no other clock \[s\].
pub const SLIGHT_DELAY_S: f64 = 0.02;
/// Every so many of them is tried for single joints: what is near one of them is found beside it.
pub const ONE_DELAY_OF: usize = 3;
/// What is left at both ends of a piece for delays \[s\].
pub const DELAY_MARGIN_S: f64 = 0.2;

// ---- The report -------------------------------------------------------------------------------------------------------

/// A reading is reported as the log's from this probability on.
pub const REPORTED: f64 = 0.95;
/// It also leaves at most this share of the rms residual that the log as it is leaves, mean over joints: a reading that
/// explains no more than other values would is no news. Of a fault of single joints, the mean over these.
pub const MAX_RESIDUAL_RATIO: f64 = 0.7;
/// Alternatives below this probability are not listed.
pub const LISTED: f64 = 0.01;
/// Alternatives that are listed, at most.
pub const MAX_LISTED: usize = 4;
