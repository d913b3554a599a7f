//! States of daemon and controller in words.

use std::fmt::Debug;

use rivet_ipc_schema::{
    ControllerHealth, ControllerState, DaemonMode, Drift, DriftVerdict, Health, InputFault, InstrumentSource,
    LoadLevel, ParameterRefusal, ParameterSource, SourceReason, StopCause, words,
};
use schemars::JsonSchema;
use serde::Serialize;

/// A process that has not reported yet.
pub(crate) const ABSENT: &str = "not on the bus";
/// A process whose reports have stopped.
pub(crate) const SILENT: &str = "silent";

/// States of daemon and controller in words; empty where nothing is known.
#[derive(Clone, Debug, Default, PartialEq, Serialize, JsonSchema)]
pub struct States {
    /// When this was written, `CLOCK_MONOTONIC` [ns].
    pub stamp_ns: u64,
    /// What rivetd is doing, such as estimating; silent where its reports have stopped.
    pub daemon: String,
    /// What is wrong with the samples; none where nothing is.
    pub input_fault: String,
    /// Names of the joints that it concerns.
    pub input_joints: String,
    /// What is left out for lack of time.
    pub load: String,
    /// Where the instruments come from.
    pub instruments: String,
    /// Base parameters that follow the data.
    pub active_parameters: u32,
    /// Base parameters that are held.
    pub held_parameters: u32,
    /// Whether the arm is still the accepted one: unresolved, within or left.
    pub drift: String,
    /// Names of the joints that have left the accepted model.
    pub left_joints: String,
    /// What rivet-controller is doing, such as following; silent where its reports have stopped.
    pub controller: String,
    /// Why the stop reaction began last; none before the first stop.
    pub stop_cause: String,
    /// Names of the joints that this concerns.
    pub stop_joints: String,
    /// Stops since the controller's start.
    pub stops: u64,
    /// Why a setpoint was refused last.
    pub plan_refusal: String,
    /// Names of the joints that this concerns.
    pub plan_joints: String,
    /// Whose parameters make the torque: nominal, last good or live.
    pub parameter_source: String,
    /// Why it is this source.
    pub source_reason: String,
    /// What became of the last published parameter set.
    pub last_refusal: String,
}

/// A number of an enumeration in words; a number that it does not have is shown as that number.
pub(crate) fn named<T: TryFrom<u32> + Debug>(value: u32) -> String {
    T::try_from(value).map_or_else(|_| format!("number {value}"), words)
}

/// Names of the joints whose bits are set, separated by commas.
pub(crate) fn joints(names: &[String], bits: u32) -> String {
    let set = names.iter().enumerate().filter(|(j, _)| *j < 32 && bits >> j & 1 == 1);
    set.map(|(_, name)| name.as_str()).collect::<Vec<_>>().join(", ")
}

impl States {
    /// Nothing has reported.
    pub(crate) fn new() -> States {
        States { daemon: ABSENT.to_owned(), controller: ABSENT.to_owned(), ..States::default() }
    }

    pub(crate) fn take_health(&mut self, names: &[String], health: &Health) {
        self.daemon = named::<DaemonMode>(health.mode);
        self.input_fault = named::<InputFault>(health.input_fault);
        self.input_joints = joints(names, health.input_joints);
        self.load = named::<LoadLevel>(health.load_level);
        self.instruments = named::<InstrumentSource>(health.instruments);
        (self.active_parameters, self.held_parameters) = (health.active, health.held);
    }

    pub(crate) fn take_drift(&mut self, names: &[String], drift: &Drift) {
        self.drift = named::<DriftVerdict>(drift.verdict);
        let departed = names.iter().zip(&drift.joint_verdict).filter(|(_, v)| **v == u32::from(DriftVerdict::Left));
        self.left_joints = departed.map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(", ");
    }

    pub(crate) fn take_controller(&mut self, names: &[String], health: &ControllerHealth) {
        self.controller = named::<ControllerState>(health.state);
        self.stop_cause = named::<StopCause>(health.stop_cause);
        self.stop_joints = joints(names, health.stop_joints);
        self.stops = health.stops;
        self.plan_refusal = named::<StopCause>(health.plan_refusal);
        self.plan_joints = joints(names, health.plan_joints);
        self.parameter_source = named::<ParameterSource>(health.source);
        self.source_reason = named::<SourceReason>(health.source_reason);
        self.last_refusal = named::<ParameterRefusal>(health.last_refusal);
    }

    /// Whether only the stamps differ.
    pub(crate) fn is_same(&self, other: &States) -> bool {
        let stamp_ns = self.stamp_ns;
        *self == States { stamp_ns, ..other.clone() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_and_bits_become_words_and_names() {
        let names = ["shoulder".to_owned(), "elbow".to_owned()];
        let mut states = States::new();
        assert_eq!((states.daemon.as_str(), states.controller.as_str()), (ABSENT, ABSENT));
        states.take_health(&names, &Health { mode: 5, input_fault: 8, input_joints: 0b10, ..Health::default() });
        states.take_drift(&names, &Drift { verdict: 2, joint_verdict: [2, 1, 0, 0, 0, 0, 0, 0], ..Drift::default() });
        let stopped =
            ControllerHealth { state: 3, stop_cause: 15, stop_joints: 0b11, source: 77, ..ControllerHealth::default() };
        states.take_controller(&names, &stopped);
        let words = [&states.daemon, &states.input_fault, &states.input_joints, &states.drift, &states.left_joints];
        assert_eq!(words, ["wrong period", "time jump", "elbow", "left", "shoulder"]);
        let words = [&states.controller, &states.stop_cause, &states.stop_joints, &states.parameter_source];
        assert_eq!(words, ["stopping", "tracking error", "shoulder, elbow", "number 77"]);
        assert!(states.is_same(&States { stamp_ns: 5, ..states.clone() }));
        assert!(!states.is_same(&States { stops: 5, ..states.clone() }));
    }
}
