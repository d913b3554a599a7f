//! Estimation of an arm's base parameters, while it works ([`Identifier`]) or from whole records ([`offline`]).
//!
//! Pure: no file, clock or bus; everything is a function of the samples. [`Identifier::push`] allocates nothing.
//!
//! ```text
//! q, tau, setpoint -> differentiate        one delay for all signals
//!                  -> regressor D, instruments Z
//!                  -> model filter         the same low-pass over every column of D and Z and over tau
//!                     (or energies and work of a span instead of torques: the energy model)
//!                  -> decimate, weigh      rows in units of their noise, columns in units of torque
//!                  -> M, S, y              windowed sums; UD least squares beside them
//!                  -> judge, solve         one step of bounded work a sample
//! ```
//!
//! The method is that of Schmidt & Pruefer, "Parameter identification in robot control"; numbers of sections and
//! equations refer to it.
pub mod bank;
mod change;
mod chi_square;
mod closed_loop;
pub mod consistency;
mod dead_zone;
pub mod differentiate;
mod dropout;
pub mod eigen;
mod energy;
mod estimator;
pub mod filter;
mod identifier;
mod kernels;
mod linear;
mod lu;
mod memory;
mod noise;
mod observer;
pub mod offline;
mod operations;
mod plan;
mod reference;
mod repetition;
mod report;
mod residuals;
mod scales;
mod second_encoder;
mod settings;
mod signals;
mod state_filter;
mod supervision;
mod torque_rows;
pub mod ud;
pub use estimator::{Correlation, Directions, Estimator, EstimatorSettings, Hausman};
pub use identifier::{Identifier, LARGEST_EFFORT, LARGEST_MOTION, Reconfigured};
pub use observer::{Observer, Phase, Row};
pub use report::{Estimate, Instrument, Motion, ParameterState, Refusal, Sample, Setpoint, Skip, Step, Verdict};
pub use scales::Scales;
pub use settings::{
    ColumnsSettings, Differentiator, EigenSettings, EstimatorKind, Filtering, InputSignals, Instruments,
    LONGEST_CYCLE_S, MAX_DELAY_ROWS, MAX_FILTER_ORDER, MAX_HALF_WIDTH, Prior, ReferenceWorkload, Settings,
    SettingsError, Supervision, TrackedSettings, Window,
};
pub use torque_rows::TorqueRows;
