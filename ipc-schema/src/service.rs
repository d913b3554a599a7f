//! The services of one robot.

use std::fmt;

/// The services of one robot; the full name is `rivet/<robot>/<service>`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Service {
    /// Publish-subscribe, and an event of the same name: robot controller -> all.
    JointState,
    /// Publish-subscribe: planner -> all.
    Setpoint,
    /// Publish-subscribe: robot controller -> all, where joints have second encoders.
    LinkState,
    /// Blackboard: controller -> robot.
    Command,
    /// Publish-subscribe with history 1, and a blackboard of the same name: daemon -> all.
    Parameters,
    /// Publish-subscribe with history 1: daemon -> all; the same as an arm that can be built.
    ParametersConsistent,
    /// Publish-subscribe: daemon -> all.
    Health,
    /// Publish-subscribe: daemon -> all.
    Timing,
    /// Publish-subscribe: daemon -> all.
    Drift,
    /// Publish-subscribe: controller -> all.
    ControllerHealth,
    /// Request-response: anyone -> daemon.
    Control,
    /// Request-response: anyone -> controller.
    ControllerControl,
}

impl Service {
    /// The last part of the service's name.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::JointState => "joint-state",
            Self::Setpoint => "setpoint",
            Self::LinkState => "link-state",
            Self::Command => "command",
            Self::Parameters => "parameters",
            Self::ParametersConsistent => "parameters-consistent",
            Self::Health => "health",
            Self::Timing => "timing",
            Self::Drift => "drift",
            Self::ControllerHealth => "controller-health",
            Self::Control => "control",
            Self::ControllerControl => "controller-control",
        }
    }
}

impl fmt::Display for Service {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}
