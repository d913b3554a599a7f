//! Where a simulator differs from the arm, which effect causes it, how far the gap shrinks.
//!
//! Pure: no file, clock or bus; everything is a function of the runs.
//!
//! ```text
//! runs -> all but the last are looked at, the last is sealed
//!      -> signals: spikes and wraps are mended, frozen stretches cut
//!      -> the log itself: torque that runs against motion, another unit, limits, joints that stand
//!      -> torque that comes after the motion is moved in time
//!      -> rows: every column and the torque through one zero-phase filter; rows where the log cannot resolve the
//!         direction of friction weigh less
//!      -> background: all values of the model, wrong by as much as CAD and data sheets usually are
//!      -> one body at the flange, where links would take it up among them
//!      -> candidates: every effect on every joint, inner values on a grid, then refined
//!      -> log evidence of background + candidate; held-out blocks; what is physically possible
//!      -> the best is adopted, again until none is worth it; those that explain the same are one class
//!      -> which values must differ from the nominal ones for the evidence's sake
//!      -> prediction for the sealed motion, then its torque: causes that do not transfer are withdrawn
//! ```
//!
//! The forms of effects are written here from the motion of the log; the plant of `rivet-simulation` does not share them.

mod adopted;
mod another_law;
mod autocorrelation;
mod background;
mod base_evidence;
mod base_modes;
mod body;
mod bursts;
mod class;
mod computed;
mod contact;
mod design;
mod details;
mod dragged;
mod effect;
mod entry;
mod evidence;
mod exhibit;
mod first_fit;
mod flips;
mod form;
mod formats;
mod freed;
mod gap;
mod held_load;
mod input;
mod instead;
mod known;
mod ladder;
mod left_open;
mod leftover;
mod library;
mod lmg;
mod local;
mod log_check;
mod log_fault;
mod magnitude;
mod motions;
mod named_model;
mod offsets;
mod one_clock;
mod opened;
mod orders;
mod parallel;
mod parts;
mod past;
mod patch;
mod physics;
mod pipeline;
mod policy;
mod possible;
mod power;
mod predict;
mod prepared;
mod procedure;
mod products;
mod random;
mod refine;
mod regimes;
mod repeats;
mod report;
mod residue;
mod rigid;
mod rows;
mod run;
mod sealed;
mod search;
mod select;
mod separate;
mod settle;
mod shrink;
mod signals;
mod signs;
mod silence;
mod sizes;
mod stages;
mod stillness;
mod stranger;
mod swapped;
mod timing;
mod tool_drag;
mod two_mass;
mod units;
mod unseen;
mod upright;
mod value_group;
mod values;
mod views;
mod warming;
mod warming_candidates;
mod whole;
mod written;
mod zero;

pub use details::{Details, Ledger, ParameterLine, ParameterState, Stage};
pub use effect::{Effect, Kind};
pub use entry::{diagnose, diagnose_and_patch};
pub use exhibit::{Curve, Excerpt, Point, Variable};
pub use formats::{Fidelity, Format, FormatItem, FormatReport, mjcf_coupling_fits};
pub use gap::Gap;
pub use input::DiagnosisError;
pub use known::{memory_torque, unseen};
pub use ladder::{Ladder, Rung, friction_ladder};
pub use leftover::{Leftover, Order};
pub use log_fault::{LogFault, LogFinding};
pub use motions::{MotionBounds, SeparatingMotion};
pub use one_clock::of_one_clock;
pub use past::Past;
pub use patch::{Patch, Stays};
pub use power::{Named, Probe, probe};
pub use regimes::{Cell, Regime};
pub use report::{BetweenRuns, Cause, DataUse, Diagnosis, JointGap, Scatter, Shrink, Verdict};
pub use run::{Run, TRAINING_SHARE};
pub use views::{Axis, Contrast, View, Views};
