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

/// States of daemon and controller in words. What a process reported is null before its first report and once it is silent.
#[derive(Clone, Debug, Default, PartialEq, Serialize, JsonSchema)]
pub struct States {
    /// When this was written, `CLOCK_MONOTONIC` [ns].
    pub stamp_ns: u64,
    /// What rivetd is doing, such as estimating; silent where its reports have stopped.
    pub daemon: String,
    /// What is wrong with the samples; none where nothing is.
    #[schemars(with = "String")]
    pub input_fault: Option<String>,
    /// Names of the joints that it concerns.
    #[schemars(with = "String")]
    pub input_joints: Option<String>,
    /// What is left out for lack of time.
    #[schemars(with = "String")]
    pub load: Option<String>,
    /// Where the instruments come from.
    #[schemars(with = "String")]
    pub instruments: Option<String>,
    /// Base parameters that follow the data.
    #[schemars(with = "u32")]
    pub active_parameters: Option<u32>,
    /// Base parameters that are held.
    #[schemars(with = "u32")]
    pub held_parameters: Option<u32>,
    /// Whether the arm is still the accepted one: unresolved, within or left.
    #[schemars(with = "String")]
    pub drift: Option<String>,
    /// Names of the joints that have left the accepted model.
    #[schemars(with = "String")]
    pub left_joints: Option<String>,
    /// What rivet-controller is doing, such as following; silent where its reports have stopped.
    pub controller: String,
    /// Why the stop reaction began last; none before the first stop.
    #[schemars(with = "String")]
    pub stop_cause: Option<String>,
    /// Names of the joints that this concerns.
    #[schemars(with = "String")]
    pub stop_joints: Option<String>,
    /// Stops since the controller's start.
    #[schemars(with = "u64")]
    pub stops: Option<u64>,
    /// Why a setpoint was refused last.
    #[schemars(with = "String")]
    pub plan_refusal: Option<String>,
    /// Names of the joints that this concerns.
    #[schemars(with = "String")]
    pub plan_joints: Option<String>,
    /// Whose parameters make the torque: nominal, last good or live.
    #[schemars(with = "String")]
    pub parameter_source: Option<String>,
    /// Why it is this source.
    #[schemars(with = "String")]
    pub source_reason: Option<String>,
    /// What became of the last published parameter set.
    #[schemars(with = "String")]
    pub last_refusal: Option<String>,
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
        self.input_fault = Some(named::<InputFault>(health.input_fault));
        self.input_joints = Some(joints(names, health.input_joints));
        self.load = Some(named::<LoadLevel>(health.load_level));
        self.instruments = Some(named::<InstrumentSource>(health.instruments));
        (self.active_parameters, self.held_parameters) = (Some(health.active), Some(health.held));
    }

    pub(crate) fn take_drift(&mut self, names: &[String], drift: &Drift) {
        self.drift = Some(named::<DriftVerdict>(drift.verdict));
        let departed = names.iter().zip(&drift.joint_verdict).filter(|(_, v)| **v == u32::from(DriftVerdict::Left));
        self.left_joints = Some(departed.map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(", "));
    }

    pub(crate) fn take_controller(&mut self, names: &[String], health: &ControllerHealth) {
        self.controller = named::<ControllerState>(health.state);
        self.stop_cause = Some(named::<StopCause>(health.stop_cause));
        self.stop_joints = Some(joints(names, health.stop_joints));
        self.stops = Some(health.stops);
        self.plan_refusal = Some(named::<StopCause>(health.plan_refusal));
        self.plan_joints = Some(joints(names, health.plan_joints));
        self.parameter_source = Some(named::<ParameterSource>(health.source));
        self.source_reason = Some(named::<SourceReason>(health.source_reason));
        self.last_refusal = Some(named::<ParameterRefusal>(health.last_refusal));
    }

    /// Reports of rivetd have stopped: what it reported is no longer known.
    pub(crate) fn silence_daemon(&mut self) {
        SILENT.clone_into(&mut self.daemon);
        for word in [
            &mut self.input_fault,
            &mut self.input_joints,
            &mut self.load,
            &mut self.instruments,
            &mut self.drift,
            &mut self.left_joints,
        ] {
            *word = None;
        }
        (self.active_parameters, self.held_parameters) = (None, None);
    }

    /// The same of rivet-controller.
    pub(crate) fn silence_controller(&mut self) {
        SILENT.clone_into(&mut self.controller);
        for word in [
            &mut self.stop_cause,
            &mut self.stop_joints,
            &mut self.plan_refusal,
            &mut self.plan_joints,
            &mut self.parameter_source,
            &mut self.source_reason,
            &mut self.last_refusal,
        ] {
            *word = None;
        }
        self.stops = None;
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
        assert_eq!((states.daemon.as_str(), states.controller.as_str()), ("wrong period", "stopping"));
        let words = [&states.input_fault, &states.input_joints, &states.drift, &states.left_joints];
        assert_eq!(words.map(|word| word.as_deref()), ["time jump", "elbow", "left", "shoulder"].map(Some));
        let words = [&states.stop_cause, &states.stop_joints, &states.parameter_source];
        assert_eq!(words.map(|word| word.as_deref()), ["tracking error", "shoulder, elbow", "number 77"].map(Some));
        assert!(states.is_same(&States { stamp_ns: 5, ..states.clone() }));
        assert!(!states.is_same(&States { stops: Some(5), ..states.clone() }));
    }

    /// Fields that have a value.
    fn known(states: &States) -> Vec<String> {
        let fields = serde_json::to_value(states).expect("JSON");
        let fields = fields.as_object().expect("an object");
        fields.iter().filter(|(_, value)| !value.is_null()).map(|(name, _)| name.clone()).collect()
    }

    #[test]
    fn nothing_of_a_silent_process_is_known() {
        let names = ["elbow".to_owned()];
        let mut states = States::new();
        assert_eq!(known(&states), ["controller", "daemon", "stamp_ns"]);
        states.take_health(&names, &Health::default());
        states.take_drift(&names, &Drift::default());
        states.take_controller(&names, &ControllerHealth::default());
        let all = known(&states);
        states.silence_daemon();
        let of_controller = known(&states);
        assert_eq!(of_controller.len(), 11, "{of_controller:?}");
        states.silence_controller();
        assert_eq!(known(&states), ["controller", "daemon", "stamp_ns"]);
        assert_eq!((states.daemon.as_str(), states.controller.as_str()), (SILENT, SILENT));
        states.take_health(&names, &Health::default());
        states.take_drift(&names, &Drift::default());
        states.take_controller(&names, &ControllerHealth::default());
        assert_eq!(known(&states), all);
        assert_eq!(all.len(), 19);
    }
}
