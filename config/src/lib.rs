//! Robot files: `robots/<arm>/robot.toml` to checked values, or every mistake with file, line and column.
//!
//! [`load`] gives a [`Robot`]: the configuration ([`RobotConfig`]), the model of the arm and its base parameters.
//! Every key is declared once, in [`keys::KEYS`]; `docs/robot-toml.md` is made from that table.

mod describe;
mod effects;
mod error;
mod friction_law;
pub mod keys;
mod load;
mod log_settings;
mod number_text;
mod reader;
mod sections;
mod soundness;
mod supervision;
mod toml_limits;
mod write;

pub use error::{ConfigError, ConfigErrors};
pub use rivet_estimation::{Differentiator, EstimatorKind, Filtering, InputSignals, Instruments, Supervision};

pub use friction_law::FrictionLaw;
pub use load::{Description, Identified, MAX_FILE_BYTES, NoUrdf, Robot, address, load, parse, urdf_text};
pub use reader::{Origin, Resolved, Value};
pub use sections::{
    Bus, Controller, Coupling, Drive, Estimator, Friction, Law, Log, LogChannel, Overrun, Publish, Realtime,
    RobotConfig, Scheduler, Signal, Simulation, StopReaction, TorqueMeaning, Trigger,
};
pub use write::{Changes, write_changed, write_consistent, write_identified};
