//! Where a simulator differs from the arm, which effect causes it, how far the gap shrinks.
//!
//! Pure: no file, clock or bus; everything is a function of the runs.
//!
//! ```text
//! runs -> training runs and a held-out run
//!      -> signals: spikes and wraps are repaired, frozen stretches cut                                     screen
//!      -> channels: torque sign, unit, limits, joints at rest, torque that is late                         screen
//!      -> rows: every column and the torque through one zero-phase filter; rows in which the direction
//!         of friction is in doubt weigh less                                                               screen
//!      -> mounting of the base and joint zeros, before anything is fitted                                  judge
//!      -> background: all values of the model, with priors of how wrong CAD and data sheets usually are    fit
//!      -> one body at the flange, where links would explain it among them                                  select
//!      -> candidates: every effect on every joint, inner values on a grid, then refined                    effects
//!      -> log evidence of background + candidate; held-out blocks; physical bounds                         fit
//!      -> the best is adopted, again until none is worth it; confounded effects are one class              select
//!      -> values that must differ from the nominal ones                                                    select
//!      -> prediction for the held-out motion, then its torque: causes that do not transfer are withdrawn   judge
//!      -> the corrected model, and what each file format carries of it                                     export
//! ```
//!
//! The forms of effects are written here from the motion of the log; the plant of `rivet-simulation` does not share them.
//!
//! A module imports from its own folder and from folders to the left (`tools/xtask/tests/modules.rs` checks this line):
//!
//! order: policy, numerics, model, effects, screen, fit, select, experiment, report, judge, export, pipeline, entry

mod effects;
mod entry;
mod experiment;
mod export;
mod fit;
mod judge;
mod model;
mod numerics;
mod pipeline;
mod policy;
mod report;
mod screen;
mod select;

pub use effects::known::{memory_torque, unseen};
pub use effects::variable::Variable;
pub use effects::{Effect, Kind};
pub use entry::{diagnose, diagnose_and_patch};
pub use experiment::separating_motion::{MotionBounds, SeparatingMotion};
pub use export::formats::{Fidelity, Format, FormatItem, FormatReport, mjcf_coupling_fits};
pub use export::patch::{Patch, Stays};
pub use fit::friction_ladder::{Ladder, Rung, friction_ladder};
pub use model::clock::of_one_clock;
pub use model::gap::Gap;
pub use model::history::Past;
pub use model::listener::{Listener, Silent};
pub use model::log_fault::{LogFault, LogFinding};
pub use model::run::{Run, TRAINING_SHARE};
pub use report::curves::{Curve, Excerpt, Point};
pub use report::details::{Details, Ledger, ParameterLine, ParameterState, Stage};
pub use report::diagnosis::{BetweenRuns, Cause, DataUse, Diagnosis, JointGap, Scatter, Shrink, Verdict};
pub use report::regimes::{Cell, Regime};
pub use report::residual_tests::{Leftover, Order};
pub use report::views::{Axis, Contrast, View, Views};
pub use screen::input::DiagnosisError;
pub use select::detection_power::{Named, Probe, probe};
