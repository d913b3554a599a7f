//! Made by `cargo xtask mirrors` from the modules beside this one. Do not edit.

pub use super::command::*;
pub use super::consistent_parameters::*;
pub use super::control::*;
pub use super::controller_health::*;
pub use super::drift::*;
pub use super::health::*;
pub use super::joint_state::*;
pub use super::link_state::*;
pub use super::parameters::*;
pub use super::setpoint::*;
pub use super::timing::*;

use crate::layout::{Enumeration, Layout};

/// All messages.
pub const MESSAGES: [Layout; 12] = [
    Command::LAYOUT,
    ConsistentParameters::LAYOUT,
    ControlRequest::LAYOUT,
    ControlReply::LAYOUT,
    ControllerHealth::LAYOUT,
    Drift::LAYOUT,
    Health::LAYOUT,
    JointState::LAYOUT,
    LinkState::LAYOUT,
    Parameters::LAYOUT,
    Setpoint::LAYOUT,
    Timing::LAYOUT,
];

/// All enumerations.
pub const ENUMERATIONS: [Enumeration; 18] = [
    CommandMode::TABLE,
    ControlCommand::TABLE,
    ControlStatus::TABLE,
    ParameterSource::TABLE,
    SourceReason::TABLE,
    ParameterRefusal::TABLE,
    ControllerState::TABLE,
    StopCause::TABLE,
    DriftRegime::TABLE,
    DriftVerdict::TABLE,
    InputFault::TABLE,
    StateFolder::TABLE,
    LoadLevel::TABLE,
    DaemonMode::TABLE,
    ParameterState::TABLE,
    InstrumentSource::TABLE,
    LoopPhase::TABLE,
    PeriodCause::TABLE,
];
