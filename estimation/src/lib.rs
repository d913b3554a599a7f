//! Estimation of an arm's base parameters while it works.
pub mod offline;
mod report;
mod settings;
pub use report::{Estimate, Instrument, Motion, ParameterState, Refusal, Setpoint, Skip, Step, Verdict};
pub use settings::{
    ColumnsSettings, Differentiator, EigenSettings, EstimatorKind, Instruments, MAX_DELAY_ROWS, MAX_FILTER_ORDER,
    MAX_HALF_WIDTH, Prior, Settings, SettingsError, Supervision, Window,
};
