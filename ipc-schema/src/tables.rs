//! Layout and enumerations as tables: the C header and the Python mirror are held against them.

use crate::layout::{Enumeration, Layout};
use crate::messages::{
    Command, CommandMode, ConsistentParameters, ControlCommand, ControlReply, ControlRequest, ControlStatus,
    ControllerHealth, ControllerState, DaemonMode, Drift, DriftRegime, DriftVerdict, Health, InputFault,
    InstrumentSource, JointState, LinkState, LoadLevel, LoopPhase, ParameterRefusal, ParameterSource, ParameterState,
    Parameters, PeriodCause, Setpoint, SourceReason, StateFolder, StopCause, Timing,
};

/// All messages.
pub const MESSAGES: [Layout; 12] = [
    JointState::LAYOUT,
    Setpoint::LAYOUT,
    LinkState::LAYOUT,
    Command::LAYOUT,
    Parameters::LAYOUT,
    ConsistentParameters::LAYOUT,
    Health::LAYOUT,
    Timing::LAYOUT,
    Drift::LAYOUT,
    ControllerHealth::LAYOUT,
    ControlRequest::LAYOUT,
    ControlReply::LAYOUT,
];

/// All enumerations.
pub const ENUMERATIONS: [Enumeration; 18] = [
    CommandMode::TABLE,
    ParameterState::TABLE,
    InstrumentSource::TABLE,
    DaemonMode::TABLE,
    InputFault::TABLE,
    StateFolder::TABLE,
    LoadLevel::TABLE,
    LoopPhase::TABLE,
    PeriodCause::TABLE,
    DriftRegime::TABLE,
    DriftVerdict::TABLE,
    ParameterSource::TABLE,
    SourceReason::TABLE,
    ParameterRefusal::TABLE,
    ControllerState::TABLE,
    StopCause::TABLE,
    ControlCommand::TABLE,
    ControlStatus::TABLE,
];
