//! Changes of state as lines of a log.

use rivet_ipc_schema::{ControllerHealth, DaemonMode, InputFault, STOP_CAUSES, StopCause, words};
use schemars::JsonSchema;
use serde::Serialize;

use crate::held::{Held, Tally};
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

/// A word, and the names of the joints that it concerns or the reason for it; none while it is not known.
type Known = Option<(String, String)>;

/// Compares states and counters with those before. A state that returns within [`HOLD_NS`](crate::held::HOLD_NS) gets no line.
#[derive(Clone, Debug)]
pub(crate) struct Events {
    daemon: Held<String>,
    /// None also where nothing is wrong.
    fault: Held<Known>,
    drift: Held<Known>,
    controller: Held<String>,
    source: Held<Known>,
    counted: Option<Counted>,
    stops: [Tally; STOP_CAUSES],
    refused: Tally,
    resumed: Tally,
    lines: Vec<(Level, &'static str, String)>,
}

fn of_joints(joints: &str) -> String {
    if joints.is_empty() { String::new() } else { format!(" of {joints}") }
}

fn times(count: u64) -> String {
    if count > 1 { format!(", {count} times") } else { String::new() }
}

impl Events {
    pub(crate) fn new() -> Events {
        Events {
            daemon: Held::new(ABSENT.to_owned()),
            fault: Held::new(None),
            drift: Held::new(None),
            controller: Held::new(ABSENT.to_owned()),
            source: Held::new(None),
            counted: None,
            stops: std::array::from_fn(|_| Tally::default()),
            refused: Tally::default(),
            resumed: Tally::default(),
            lines: Vec::new(),
        }
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
                let text = format!("{} stop{plural} before this log begins", now.stops);
                self.lines.push((Level::Info, CONTROLLER, text));
            }
            return;
        };
        let before = Some(before).filter(is_later);
        let [stops, refused, resumed] = before.map_or([0; 3], |before| [before.stops, before.refused, before.resumed]);
        for (i, tally) in self.stops.iter_mut().enumerate().filter(|_| now.stops > stops) {
            let more = now.causes[i].saturating_sub(before.map_or(0, |before| before.causes[i]));
            let is_last = u32::try_from(i).is_ok_and(|cause| cause == health.stop_cause);
            if more > 0 {
                tally.add(more, if is_last { of_joints(&joints(names, health.stop_joints)) } else { String::new() });
            }
        }
        if now.refused > refused {
            let concerned = of_joints(&joints(names, health.plan_joints));
            let cause = named::<StopCause>(health.plan_refusal);
            self.refused.add(now.refused - refused, format!("{cause}{concerned}"));
        }
        if now.resumed > resumed && before.is_some() {
            self.resumed.add(now.resumed - resumed, String::new());
        }
    }

    /// Lines of what was counted.
    fn take_counts(&mut self, now_ns: u64) {
        for (i, tally) in self.stops.iter_mut().enumerate() {
            if let (Some((count, concerned)), Ok(cause)) = (tally.take_due(now_ns), u32::try_from(i)) {
                let text = format!("stop: {}{concerned}{}", named::<StopCause>(cause), times(count));
                self.lines.push((Level::Error, CONTROLLER, text));
            }
        }
        if let Some((count, last)) = self.refused.take_due(now_ns) {
            self.lines.push((Level::Warning, CONTROLLER, format!("{count} setpoints refused, the last: {last}")));
        }
        if let Some((count, _)) = self.resumed.take_due(now_ns) {
            self.lines.push((Level::Info, CONTROLLER, format!("the plan is followed again{}", times(count))));
        }
    }

    /// Compares with the states before; `now_ns`: `CLOCK_MONOTONIC` \[ns\].
    pub(crate) fn take_states(&mut self, now: &States, now_ns: u64) {
        self.take_counts(now_ns);
        if let Some(change) = self.daemon.take(&now.daemon, now_ns) {
            let good = [DaemonMode::Starting, DaemonMode::Estimating, DaemonMode::Suspended].map(words);
            let level = match change.value.as_str() {
                SILENT => Level::Error,
                other if good.iter().any(|word| word == other) => Level::Info,
                _ => Level::Warning,
            };
            self.lines.push((level, DAEMON, change.value + &change.alternation));
        }
        if now.daemon == SILENT {
            // What a new one reports is news.
            self.daemon.forget(SILENT.to_owned());
            self.fault.forget(None);
            self.drift.forget(None);
        }
        let known = |word: &Option<String>, concerned: &Option<String>| -> Known {
            word.clone().map(|word| (word, concerned.clone().unwrap_or_default()))
        };
        let no_fault = words(InputFault::None);
        let fault = known(&now.input_fault, &now.input_joints).filter(|(fault, _)| *fault != no_fault);
        if let Some(change) = self.fault.take(&fault, now_ns) {
            let line = match (change.value, change.before) {
                (Some((fault, joints)), _) => {
                    Some((Level::Warning, format!("input fault: {fault}{}", of_joints(&joints))))
                }
                (None, Some((fault, _))) => Some((Level::Info, format!("input fault over: {fault}"))),
                (None, None) => None,
            };
            self.lines.extend(line.map(|(level, text)| (level, DAEMON, text + &change.alternation)));
        }
        if let Some(change) = self.drift.take(&known(&now.drift, &now.left_joints), now_ns)
            && let Some((drift, joints)) = change.value
        {
            let level = if joints.is_empty() { Level::Info } else { Level::Warning };
            let text = format!("accepted model: {drift}{}{}", of_joints(&joints), change.alternation);
            self.lines.push((level, DAEMON, text));
        }
        if let Some(change) = self.controller.take(&now.controller, now_ns) {
            let is_lost = [SILENT, ABSENT].contains(&change.value.as_str());
            let level = if is_lost { Level::Error } else { Level::Info };
            self.lines.push((level, CONTROLLER, change.value + &change.alternation));
        }
        if now.controller == SILENT {
            self.controller.forget(SILENT.to_owned());
            self.source.forget(None);
        }
        if let Some(change) = self.source.take(&known(&now.parameter_source, &now.source_reason), now_ns)
            && let Some((source, reason)) = change.value
        {
            let text = format!("parameters in use: {source}, {reason}{}", change.alternation);
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
    use crate::held::HOLD_NS;

    fn drained(events: &mut Events) -> Vec<String> {
        events.drain(1_500_000_002).map(|line| format!("{} {}: {}", line.level, line.name, line.message)).collect()
    }

    #[test]
    fn every_stop_is_reported_once_and_a_new_controller_counts_anew() {
        let names = ["shoulder".to_owned(), "elbow".to_owned()];
        let mut events = Events::new();
        let mut health = ControllerHealth { stops: 1, stop_cause: 10, ..ControllerHealth::default() };
        health.stop_causes[10] = 1;
        let mut reports = 0;
        let mut lines = |events: &mut Events, health: &ControllerHealth| {
            events.take_controller(&names, health);
            reports += 1;
            events.take_counts(reports * HOLD_NS);
            drained(events)
        };
        assert_eq!(lines(&mut events, &health), ["2 rivet-controller: 1 stop before this log begins"]);
        (health.stops, health.stop_causes[15], health.stop_cause, health.stop_joints) = (2, 1, 15, 2);
        assert_eq!(lines(&mut events, &health), ["4 rivet-controller: stop: tracking error of elbow"]);
        assert_eq!(lines(&mut events, &health), [""; 0]);
        // Two more stops between two reports, of another cause.
        (health.stops, health.stop_causes[10], health.stop_cause, health.stop_joints) = (4, 3, 10, 0);
        assert_eq!(lines(&mut events, &health), ["4 rivet-controller: stop: too fast, 2 times"]);
        let mut fresh = ControllerHealth { stops: 1, stop_cause: 1, ..ControllerHealth::default() };
        fresh.stop_causes[1] = 1;
        assert_eq!(lines(&mut events, &fresh), ["4 rivet-controller: stop: silence"]);
    }

    fn states(daemon: &str, input_fault: Option<&str>, joints: &str) -> States {
        let [input_fault, joints] = [input_fault, input_fault.map(|_| joints)].map(|word| word.map(str::to_owned));
        States { daemon: daemon.to_owned(), input_fault, input_joints: joints, ..States::new() }
    }

    #[test]
    fn changes_of_state_are_lines_and_stamps_are_utc() {
        let mut events = Events::new();
        events.take_states(&states("estimating", Some("none"), ""), 0);
        assert_eq!(drained(&mut events), ["2 rivetd: estimating"]);
        events.take_states(&states("estimating", Some("frozen"), "elbow"), HOLD_NS);
        assert_eq!(drained(&mut events), ["3 rivetd: input fault: frozen of elbow"]);
        events.take_states(&states("estimating", Some("none"), ""), 3 * HOLD_NS / 2);
        assert_eq!(drained(&mut events), [""; 0], "a fault that returns at once goes on");
        events.take_states(&states("estimating", Some("none"), ""), 3 * HOLD_NS);
        assert_eq!(drained(&mut events), ["2 rivetd: input fault over: frozen"]);
        events.take_states(&states(SILENT, None, ""), 4 * HOLD_NS);
        assert_eq!(drained(&mut events), ["4 rivetd: silent"], "what nobody reports is not over");
        events.take_states(&states("estimating", Some("none"), ""), 4 * HOLD_NS + 1);
        assert_eq!(drained(&mut events), ["2 rivetd: estimating"], "a new daemon is shown at once");
        events.warn("x".to_owned());
        let line = events.drain(1_500_000_002).next().expect("a line");
        assert_eq!((line.timestamp.sec, line.timestamp.nsec), (1, 500_000_002));
    }

    /// A plan that runs on while the arm stands: fault and mode alternate at 5 Hz for ten seconds.
    #[test]
    fn fault_that_alternates_is_one_event_not_ten_lines_a_second() {
        let mut events = Events::new();
        let mut found = Vec::new();
        for look in 0..4000_u64 {
            let is_fault = (500..2500).contains(&look) && look % 40 < 20;
            let now = if is_fault {
                states("bad input", Some("frozen"), "elbow")
            } else {
                states("estimating", Some("none"), "")
            };
            events.take_states(&now, look * 5_000_000);
            found.extend(drained(&mut events));
        }
        assert_eq!(
            found[..3],
            ["2 rivetd: estimating", "3 rivetd: bad input", "3 rivetd: input fault: frozen of elbow"]
        );
        let [mode, fault] = &found[3..] else { panic!("{found:#?}") };
        assert!(mode.starts_with("2 rivetd: estimating, after 99 changes in "), "{mode}");
        assert!(fault.starts_with("2 rivetd: input fault over: frozen, after 99 changes in "), "{fault}");
    }

    /// A controller that stops and follows again five times a second.
    #[test]
    fn stops_that_repeat_are_counted_and_not_a_line_each() {
        let (names, mut events, mut found) = (["elbow".to_owned()], Events::new(), Vec::new());
        let mut health = ControllerHealth { stop_cause: 15, stop_joints: 1, ..ControllerHealth::default() };
        for report in 0..=50_u64 {
            (health.stops, health.stop_causes[15], health.resumed) = (report, report, report);
            events.take_controller(&names, &health);
            events.take_counts(report * 200_000_000);
            found.extend(drained(&mut events));
        }
        assert_eq!(found.len(), 10, "{found:#?}");
        assert_eq!(found[0], "4 rivet-controller: stop: tracking error of elbow");
        assert_eq!(found[2], "4 rivet-controller: stop: tracking error of elbow, 10 times");
        assert_eq!(found[3], "2 rivet-controller: the plan is followed again, 10 times");
    }
}
