//! Changes of state as lines of a log.

use rivet_ipc_schema::{ControllerHealth, DaemonMode, InputFault, STOP_CAUSES, StopCause, words};
use schemars::JsonSchema;
use serde::Serialize;

use crate::states::{ABSENT, SILENT, States, joints, named};

/// Levels as foxglove.Log numbers them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Level {
    Info = 2,
    Warning = 3,
    Error = 4,
}

/// A line of a log, in the schema foxglove.Log.
#[derive(Clone, Debug, Default, PartialEq, Serialize, JsonSchema)]
pub struct LogLine {
    /// When it was written, UTC.
    pub timestamp: Time,
    /// 2 information, 3 warning, 4 error.
    pub level: u8,
    /// What has changed.
    pub message: String,
    /// The process that reported it: rivetd or rivet-controller.
    pub name: String,
    /// Empty.
    pub file: String,
    /// Zero.
    pub line: u32,
}

/// A time since 1970-01-01 UTC.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, JsonSchema)]
pub struct Time {
    /// Whole seconds [s].
    pub sec: u64,
    /// The rest [ns].
    pub nsec: u32,
}

const DAEMON: &str = "rivetd";
const CONTROLLER: &str = "rivet-controller";

/// What the controller had counted.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Counted {
    stops: u64,
    causes: [u64; STOP_CAUSES],
    refused: u64,
    resumed: u64,
}

/// Compares states and counters with those before.
#[derive(Clone, Debug)]
pub(crate) struct Events {
    before: States,
    counted: Option<Counted>,
    lines: Vec<(Level, &'static str, String)>,
}

fn of_joints(joints: &str) -> String {
    if joints.is_empty() { String::new() } else { format!(" of {joints}") }
}

impl Events {
    pub(crate) fn new() -> Events {
        Events { before: States::new(), counted: None, lines: Vec::new() }
    }

    /// Counters of the controller: each stop is reported, also where its state was over before the next report.
    pub(crate) fn take_controller(&mut self, names: &[String], health: &ControllerHealth) {
        let now = Counted {
            stops: health.stops,
            causes: health.stop_causes,
            refused: health.setpoints_refused,
            resumed: health.resumed,
        };
        // A controller that started anew counts from the beginning.
        let is_later = |before: &Counted| before.stops <= now.stops && before.refused <= now.refused;
        let Some(before) = self.counted.replace(now) else {
            let plural = if now.stops == 1 { "" } else { "s" };
            if now.stops > 0 {
                self.lines.push((
                    Level::Info,
                    CONTROLLER,
                    format!("{} stop{plural} before this log begins", now.stops),
                ));
            }
            return;
        };
        let before = Some(before).filter(is_later);
        let [stops, refused, resumed] = before.map_or([0; 3], |before| [before.stops, before.refused, before.resumed]);
        if now.stops > stops {
            for (i, count) in now.causes.iter().enumerate() {
                let more = count.saturating_sub(before.map_or(0, |before| before.causes[i]));
                let Some(cause) = u32::try_from(i).ok().filter(|_| more > 0) else { continue };
                let concerned =
                    if cause == health.stop_cause { joints(names, health.stop_joints) } else { String::new() };
                let times = if more > 1 { format!(", {more} times") } else { String::new() };
                let text = format!("stop: {}{}{times}", named::<StopCause>(cause), of_joints(&concerned));
                self.lines.push((Level::Error, CONTROLLER, text));
            }
        }
        if now.refused > refused {
            let cause = named::<StopCause>(health.plan_refusal);
            let concerned = of_joints(&joints(names, health.plan_joints));
            let text = format!("{} setpoints refused, the last: {cause}{concerned}", now.refused - refused);
            self.lines.push((Level::Warning, CONTROLLER, text));
        }
        if now.resumed > resumed && before.is_some() {
            self.lines.push((Level::Info, CONTROLLER, "the plan is followed again".to_owned()));
        }
    }

    /// Compares with the states before.
    pub(crate) fn take_states(&mut self, now: &States) {
        let before = std::mem::replace(&mut self.before, now.clone());
        if now.daemon != before.daemon {
            let good = [DaemonMode::Starting, DaemonMode::Estimating, DaemonMode::Suspended].map(words);
            let level = match now.daemon.as_str() {
                SILENT => Level::Error,
                other if good.iter().any(|word| word == other) => Level::Info,
                _ => Level::Warning,
            };
            self.lines.push((level, DAEMON, now.daemon.clone()));
        }
        let has_fault = now.input_fault != words(InputFault::None) && !now.input_fault.is_empty();
        if has_fault && (&now.input_fault, &now.input_joints) != (&before.input_fault, &before.input_joints) {
            let text = format!("input fault: {}{}", now.input_fault, of_joints(&now.input_joints));
            self.lines.push((Level::Warning, DAEMON, text));
        }
        if !has_fault && before.input_fault != now.input_fault && !before.input_fault.is_empty() {
            self.lines.push((Level::Info, DAEMON, format!("input fault over: {}", before.input_fault)));
        }
        if now.drift != before.drift || now.left_joints != before.left_joints {
            let level = if now.left_joints.is_empty() { Level::Info } else { Level::Warning };
            let text = format!("accepted model: {}{}", now.drift, of_joints(&now.left_joints));
            self.lines.push((level, DAEMON, text));
        }
        if now.controller != before.controller {
            let level = if [SILENT, ABSENT].contains(&now.controller.as_str()) { Level::Error } else { Level::Info };
            self.lines.push((level, CONTROLLER, now.controller.clone()));
        }
        let source = |states: &States| (states.parameter_source.clone(), states.source_reason.clone());
        if source(now) != source(&before) {
            let text = format!("parameters in use: {}, {}", now.parameter_source, now.source_reason);
            self.lines.push((Level::Info, CONTROLLER, text));
        }
    }

    /// Something that this program found.
    pub(crate) fn warn(&mut self, text: String) {
        self.lines.push((Level::Warning, DAEMON, text));
    }

    /// The lines so far, written at `utc_ns` \[ns since 1970\].
    pub(crate) fn drain(&mut self, utc_ns: u64) -> impl Iterator<Item = LogLine> {
        let timestamp = Time { sec: utc_ns / 1_000_000_000, nsec: (utc_ns % 1_000_000_000) as u32 };
        let line = move |(level, name, message): (Level, &str, String)| LogLine {
            timestamp,
            level: level as u8,
            message,
            name: name.to_owned(),
            ..LogLine::default()
        };
        std::mem::take(&mut self.lines).into_iter().map(line)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drained(events: &mut Events) -> Vec<String> {
        events.drain(1_500_000_002).map(|line| format!("{} {}: {}", line.level, line.name, line.message)).collect()
    }

    #[test]
    fn every_stop_is_reported_once_and_a_new_controller_counts_anew() {
        let names = ["shoulder".to_owned(), "elbow".to_owned()];
        let mut events = Events::new();
        let mut health = ControllerHealth { stops: 1, stop_cause: 10, ..ControllerHealth::default() };
        health.stop_causes[10] = 1;
        events.take_controller(&names, &health);
        assert_eq!(drained(&mut events), ["2 rivet-controller: 1 stop before this log begins"]);
        (health.stops, health.stop_causes[15], health.stop_cause, health.stop_joints) = (2, 1, 15, 2);
        events.take_controller(&names, &health);
        assert_eq!(drained(&mut events), ["4 rivet-controller: stop: tracking error of elbow"]);
        events.take_controller(&names, &health);
        assert_eq!(drained(&mut events), [""; 0]);
        // Two more stops between two reports, of another cause.
        (health.stops, health.stop_causes[10], health.stop_cause, health.stop_joints) = (4, 3, 10, 0);
        events.take_controller(&names, &health);
        assert_eq!(drained(&mut events), ["4 rivet-controller: stop: too fast, 2 times"]);
        let mut fresh = ControllerHealth { stops: 1, stop_cause: 1, ..ControllerHealth::default() };
        fresh.stop_causes[1] = 1;
        events.take_controller(&names, &fresh);
        assert_eq!(drained(&mut events), ["4 rivet-controller: stop: silence"]);
    }

    #[test]
    fn changes_of_state_are_lines_and_stamps_are_utc() {
        let mut events = Events::new();
        let mut states = States { daemon: "estimating".to_owned(), input_fault: "none".to_owned(), ..States::new() };
        events.take_states(&states);
        assert_eq!(drained(&mut events), ["2 rivetd: estimating"]);
        (states.input_fault, states.input_joints) = ("frozen".to_owned(), "elbow".to_owned());
        events.take_states(&states);
        assert_eq!(drained(&mut events), ["3 rivetd: input fault: frozen of elbow"]);
        states.input_fault = "none".to_owned();
        states.daemon = SILENT.to_owned();
        events.take_states(&states);
        assert_eq!(drained(&mut events), ["4 rivetd: silent", "2 rivetd: input fault over: frozen"]);
        events.warn("x".to_owned());
        let line = events.drain(1_500_000_002).next().expect("a line");
        assert_eq!((line.timestamp.sec, line.timestamp.nsec), (1, 500_000_002));
    }
}
