//! Health of daemon, controller and this program as `diagnostic_msgs/DiagnosticArray`.

use std::fmt::{Debug, Display};

use rivet_ipc_schema::{
    ControllerHealth, ControllerState, DaemonMode, Drift, DriftVerdict, Health, InputFault, ParameterState, Parameters,
    StopCause, parameter_flags, words,
};

use crate::intake::Counts;
use crate::messages::{DiagnosticArray, DiagnosticStatus, Header, KeyValue, Level, Time};

/// Age from which on a report is stale \[ns\].
const STALE_NS: u64 = 5_000_000_000;

/// What this program knows of itself.
#[derive(Clone, Debug, Default)]
pub struct BridgeState {
    /// What came.
    pub counts: Counts,
    /// Samples that the bus lost or refused.
    pub bus_lost: u64,
    /// Messages that could not be sent.
    pub not_sent: u64,
    /// Publishers of joint states.
    pub publishers: usize,
    /// Problems that are present: whether samples are not used, and the text.
    pub problems: Vec<(bool, String)>,
}

/// Everything that is reported.
#[derive(Debug)]
pub struct Report<'a> {
    /// The robot.
    pub robot: &'a str,
    /// Names of the parameters.
    pub names: &'a [String],
    /// `CLOCK_MONOTONIC` \[ns\].
    pub now_ns: u64,
    /// The daemon's last health.
    pub health: Option<&'a Health>,
    /// The controller's last health.
    pub controller: Option<&'a ControllerHealth>,
    /// Whether the arm is still the one that was accepted.
    pub drift: Option<&'a Drift>,
    /// The last parameters.
    pub parameters: Option<&'a Parameters>,
    /// This program.
    pub bridge: &'a BridgeState,
}

fn named<T: TryFrom<u32> + Debug>(value: u32) -> String {
    T::try_from(value).map_or_else(|_| value.to_string(), words)
}

fn pair(key: &str, value: impl Display) -> KeyValue {
    KeyValue { key: key.to_owned(), value: value.to_string() }
}

impl Report<'_> {
    /// The message, stamped `stamp`.
    pub fn message(&self, stamp: Time) -> DiagnosticArray {
        let mut status = vec![self.bridge(), self.daemon(), self.parameters()];
        // An arm without rivet-controller is nothing to report.
        status.extend(self.controller.map(|health| self.controller(health)));
        DiagnosticArray { header: Header { stamp, frame_id: String::new() }, status }
    }

    fn status(&self, part: &str, level: Level, message: String, values: Vec<KeyValue>) -> DiagnosticStatus {
        let name = format!("rivet {}: {part}", self.robot);
        DiagnosticStatus { level: level as u8, name, message, hardware_id: self.robot.to_owned(), values }
    }

    fn is_stale(&self, stamp_ns: u64) -> bool {
        self.now_ns.saturating_sub(stamp_ns) > STALE_NS
    }

    fn bridge(&self) -> DiagnosticStatus {
        let (bridge, counts) = (self.bridge, &self.bridge.counts);
        let (level, message) = match bridge.problems.iter().max_by_key(|(serious, _)| *serious) {
            Some((serious, text)) => (if *serious { Level::Error } else { Level::Warn }, text.clone()),
            None if counts.joint_states == 0 => (Level::Stale, "no joint state has come".to_owned()),
            None => (Level::Ok, "joint states reach the bus".to_owned()),
        };
        let mut values = vec![
            pair("publishers of joint states", bridge.publishers),
            pair("joint states", counts.joint_states),
            pair("joint states on the bus", counts.published),
            pair("joint states lost", counts.lost),
            pair("joint states refused", counts.refused),
            pair("joint states with a missing value", counts.faulty),
            pair("joint states of other publishers", counts.foreign),
            pair("setpoints", counts.setpoints),
            pair("setpoints on the bus", counts.setpoints_published),
            pair("samples that the bus lost", bridge.bus_lost),
            pair("messages not sent", bridge.not_sent),
        ];
        values.extend(bridge.problems.iter().map(|(_, text)| pair("problem", text)));
        self.status("ROS 2", level, message, values)
    }

    fn daemon(&self) -> DiagnosticStatus {
        let Some(health) = self.health else {
            return self.status("rivetd", Level::Stale, "no health has come; start rivetd".to_owned(), Vec::new());
        };
        let mode = DaemonMode::try_from(health.mode);
        let level = match mode {
            _ if self.is_stale(health.stamp_ns) => Level::Stale,
            Ok(DaemonMode::Estimating | DaemonMode::Suspended | DaemonMode::Starting) => Level::Ok,
            Ok(DaemonMode::Frozen | DaemonMode::Stale) => Level::Warn,
            _ => Level::Error,
        };
        let message =
            if level == Level::Stale { "no health comes".to_owned() } else { named::<DaemonMode>(health.mode) };
        let mut values = vec![
            pair("samples", health.samples),
            pair("samples lost", health.lost),
            pair("samples refused", health.refused_stale + health.refused_invalid),
            pair("samples with faults of the robot", health.rejected_faults),
            pair("setpoints missing", health.setpoints_missing),
            pair("periods", health.periods),
            pair("overruns", health.overruns),
            pair("input fault", named::<InputFault>(health.input_fault)),
            pair("longest work of a period [us]", health.worst_work_ns as f64 * 1e-3),
        ];
        let joints = self.drift.map_or(0, |drift| (drift.joints as usize).min(drift.ratio.len()));
        for j in 0..joints {
            values.push(pair(&format!("residual RMS of joint {} [N m]", j + 1), health.residual_rms[j]));
        }
        values.extend(self.drift.map(|drift| pair("drift", named::<DriftVerdict>(drift.verdict))));
        self.status("rivetd", level, message, values)
    }

    fn parameters(&self) -> DiagnosticStatus {
        let Some(set) = self.parameters else {
            return self.status("parameters", Level::Stale, "none has come".to_owned(), Vec::new());
        };
        let provisional = set.flags & parameter_flags::PROVISIONAL != 0;
        let bad = set.flags & parameter_flags::BAD_INPUT != 0;
        let (level, message) = match (bad, provisional) {
            _ if self.is_stale(set.stamp_ns) => (Level::Stale, "not renewed"),
            (true, _) => (Level::Warn, "those from before: something is wrong with the samples"),
            (_, true) => (Level::Ok, "provisional: too little data so far"),
            _ => (Level::Ok, "identified"),
        };
        let state = |i: usize| ParameterState::try_from(set.state[i]).map_or_else(|_| set.state[i].to_string(), words);
        let values = (0..set.len()).map(|i| {
            let name = self.names.get(i).map_or("?", String::as_str);
            pair(name, format!("{} +- {} ({})", set.values[i], set.std[i], state(i)))
        });
        self.status("parameters", level, message.to_owned(), values.collect())
    }

    fn controller(&self, health: &ControllerHealth) -> DiagnosticStatus {
        let level = match ControllerState::try_from(health.state) {
            _ if self.is_stale(health.stamp_ns) => Level::Stale,
            Ok(ControllerState::Following | ControllerState::Holding | ControllerState::Waiting) => Level::Ok,
            Ok(ControllerState::Stopping | ControllerState::Strayed) => Level::Warn,
            _ => Level::Error,
        };
        let values = vec![
            pair("commands", health.commands),
            pair("stops", health.stops),
            pair("last cause of a stop", named::<StopCause>(health.stop_cause)),
            pair("parameter sets accepted", health.accepted),
        ];
        self.status("rivet-controller", level, named::<ControllerState>(health.state), values)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report<'a>(
        bridge: &'a BridgeState,
        health: Option<&'a Health>,
        parameters: Option<&'a Parameters>,
    ) -> Report<'a> {
        Report {
            robot: "arm",
            names: &[],
            now_ns: 10_000_000_000,
            health,
            controller: None,
            drift: None,
            parameters,
            bridge,
        }
    }

    #[test]
    fn levels_follow_what_is_wrong() {
        let mut bridge = BridgeState::default();
        let levels =
            |report: &Report<'_>| report.message(Time::default()).status.iter().map(|s| s.level).collect::<Vec<_>>();
        assert_eq!(levels(&report(&bridge, None, None)), [3, 3, 3], "nothing has come");
        let health = |mode: DaemonMode, stamp_ns| Health { mode: mode.into(), stamp_ns, ..Health::default() };
        let set = Parameters { stamp_ns: 9_000_000_000, flags: parameter_flags::BAD_INPUT, ..Parameters::default() };
        bridge.counts.joint_states = 1;
        let well = health(DaemonMode::Estimating, 9_000_000_000);
        assert_eq!(levels(&report(&bridge, Some(&well), Some(&set))), [0, 0, 1]);
        bridge.problems = vec![(false, "lost".to_owned()), (true, "no effort".to_owned())];
        let wrong = health(DaemonMode::WrongPeriod, 9_000_000_000);
        let found = report(&bridge, Some(&wrong), None).message(Time::default());
        assert_eq!(
            (found.status[0].level, found.status[0].message.as_str()),
            (2, "no effort"),
            "the serious one first"
        );
        assert_eq!((found.status[1].level, found.status[1].message.as_str()), (2, "wrong period"));
        let old = health(DaemonMode::Estimating, 1_000_000_000);
        assert_eq!(levels(&report(&bridge, Some(&old), None))[1], 3);
    }

    #[test]
    fn every_counter_and_parameter_is_shown() {
        let bridge = BridgeState { counts: Counts { lost: 17, ..Counts::default() }, ..BridgeState::default() };
        let mut set = Parameters { count: 1, stamp_ns: 9_000_000_000, ..Parameters::default() };
        (set.values[0], set.std[0], set.state[0]) = (1.5, 0.25, 1);
        let names = ["l1.Izz".to_owned()];
        let found = Report { names: &names, ..report(&bridge, None, Some(&set)) }.message(Time::default());
        assert!(found.status[0].values.contains(&pair("joint states lost", 17)));
        assert_eq!(found.status[2].values, [pair("l1.Izz", "1.5 +- 0.25 (active)")]);
    }
}
