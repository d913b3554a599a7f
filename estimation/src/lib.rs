//! Estimation of an arm's base parameters while it works.
pub mod differentiate;
pub mod eigen;
mod estimator;
pub mod filter;
mod identifier;
mod linear;
mod noise;
pub mod offline;
mod report;
mod scales;
mod settings;
mod signals;
mod supervision;
pub mod ud;
pub use estimator::{Estimator, EstimatorSettings};
pub use identifier::Identifier;
pub use report::{Estimate, Instrument, Motion, ParameterState, Refusal, Setpoint, Skip, Step, Verdict};
pub use scales::Scales;
pub use settings::{
    ColumnsSettings, Differentiator, EigenSettings, EstimatorKind, Instruments, MAX_DELAY_ROWS, MAX_FILTER_ORDER,
    MAX_HALF_WIDTH, Prior, Settings, SettingsError, Supervision, Window,
};
