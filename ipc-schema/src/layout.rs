//! Layout and enumerations as tables: the C header and the Python mirror are held against them.

use crate::messages::{
    Command, CommandMode, ConsistentParameters, ControlCommand, ControlReply, ControlRequest, ControlStatus,
    ControllerHealth, ControllerState, DaemonMode, Drift, DriftRegime, DriftVerdict, Health, InputFault,
    InstrumentSource, JointState, LinkState, LoadLevel, LoopPhase, ParameterRefusal, ParameterSource, ParameterState,
    Parameters, PeriodCause, Setpoint, SourceReason, StateFolder, StopCause, Timing,
};

/// Where each field of a message lies; asserted at compile time beside the message.
#[derive(Clone, Copy, Debug)]
pub struct Layout {
    /// The struct's name: `JointState`.
    pub name: &'static str,
    /// Name and version on the bus: `rivet.JointState.v1`.
    pub type_name: &'static str,
    /// Size \[bytes\].
    pub size: usize,
    /// Alignment \[bytes\].
    pub align: usize,
    /// Fields and their offsets \[bytes\], in order.
    pub fields: &'static [(&'static str, usize)],
}

/// The numbers of an enumeration on the wire.
#[derive(Clone, Copy, Debug)]
pub struct Enumeration {
    /// The enumeration's name: `DaemonMode`.
    pub name: &'static str,
    /// Variants and their numbers.
    pub values: &'static [(&'static str, u32)],
}

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
