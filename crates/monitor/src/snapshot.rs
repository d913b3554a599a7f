//! What is known of a robot's daemon and controller at one moment.

use anyhow::Result;
use rivet_config::Robot;
use rivet_files::printable;
use rivet_ipc_schema::{
    Bus, BusConfig, ControllerHealth, ControllerState, DaemonMode, Drift, DriftVerdict, HISTOGRAM_BINS, Health,
    InputFault, InstrumentSource, LoadLevel, PHASES, ParameterRefusal, ParameterSource, ParameterState, Parameters,
    PeriodCause, SourceReason, StateFolder, StopCause, Subscriber, Timing, parameter_flags, words,
};
use rivet_realtime::{LogHistogram, now_ns};

/// The pause between reports where nothing else is said \[ns\].
const USUAL_NS: u64 = 1_000_000_000;

/// What is listened to.
#[derive(Debug)]
pub struct Ports {
    health: Subscriber<Health>,
    drift: Subscriber<Drift>,
    controller: Subscriber<ControllerHealth>,
    parameters: Subscriber<Parameters>,
    timing: Subscriber<Timing>,
}

impl Ports {
    /// Subscribes to what daemon and controller report.
    ///
    /// # Errors
    /// The bus's.
    pub fn open(bus: &Bus) -> Result<Ports> {
        Ok(Ports {
            health: bus.health_subscriber()?,
            drift: bus.drift_subscriber()?,
            controller: bus.controller_health_subscriber()?,
            parameters: bus.parameters_subscriber()?,
            timing: bus.timing_subscriber()?,
        })
    }
}

/// A report, and the rate of something between it and the one before.
#[derive(Clone, Copy, Debug)]
pub struct Report<T> {
    /// The report.
    pub message: T,
    /// Samples (daemon) or commands (controller) a second; NaN before the second report.
    pub rate: f64,
    /// The last two pauses between reports, the newer one first \[ns\]; 0 where there was none.
    pauses_ns: [u64; 2],
}

/// What is known of a robot at one moment.
#[derive(Debug)]
pub struct Snapshot {
    pub(crate) robot: String,
    pub(crate) bus: String,
    pub(crate) joints: Vec<String>,
    pub(crate) names: Vec<String>,
    pub(crate) nominal: Vec<f64>,
    pub(crate) hash: u64,
    /// Longest pause between two reports, by the robot file \[ns\].
    pause_ns: u64,
    /// The daemon's last report.
    pub health: Option<Report<Health>>,
    /// Whether the arm is still the one that was accepted.
    pub drift: Option<Drift>,
    /// The controller's last report.
    pub controller: Option<Report<ControllerHealth>>,
    /// The last parameter set.
    pub parameters: Option<Parameters>,
    /// Where the daemon's periods go.
    pub timing: Option<Timing>,
    /// `CLOCK_MONOTONIC` of the last look \[ns\].
    pub(crate) now_ns: u64,
}

impl Snapshot {
    /// Nothing is known yet of `robot` on `bus`.
    pub fn new(robot: &Robot, bus: &BusConfig) -> Snapshot {
        let between_s = robot.config.publish.health_every as f64 * robot.config.sample_period_s;
        Snapshot {
            robot: robot.config.name.clone(),
            bus: format!("{} in {}", bus.prefix, bus.root.display()),
            // A terminal acts on control characters, and ratatui leaves them out.
            joints: robot.model.arm.joints.iter().map(|joint| printable(&joint.name).into_owned()).collect(),
            names: (0..robot.base.len()).map(|i| robot.base.name(&robot.model, i)).collect(),
            nominal: robot.nominal_base.clone(),
            hash: robot.hash,
            pause_ns: USUAL_NS.max((between_s * 1e9) as u64),
            health: None,
            drift: None,
            controller: None,
            parameters: None,
            timing: None,
            now_ns: now_ns(),
        }
    }

    /// Takes in what has come.
    ///
    /// # Errors
    /// A port's.
    pub fn take(&mut self, ports: &Ports) -> Result<()> {
        if let Some(message) = ports.health.receive_newest()? {
            self.take_health(&message);
        }
        if let Some(message) = ports.drift.receive_newest()? {
            self.drift = Some(message);
        }
        if let Some(message) = ports.controller.receive_newest()? {
            self.take_controller(&message);
        }
        if let Some(set) = ports.parameters.receive_newest()? {
            self.parameters = Some(set);
        }
        if let Some(timing) = ports.timing.receive_newest()? {
            self.timing = Some(timing);
        }
        self.now_ns = now_ns();
        Ok(())
    }

    /// Takes in a report of the daemon.
    pub fn take_health(&mut self, message: &Health) {
        let before = self.health.map(|report| (report.message.samples, report.message.stamp_ns, report.pauses_ns));
        let (rate, pauses_ns) = follow(before, message.samples, message.stamp_ns);
        self.health = Some(Report { message: *message, rate, pauses_ns });
    }

    /// Takes in a report of the controller.
    pub fn take_controller(&mut self, message: &ControllerHealth) {
        let before = self.controller.map(|report| (report.message.commands, report.message.stamp_ns, report.pauses_ns));
        let (rate, pauses_ns) = follow(before, message.commands, message.stamp_ns);
        self.controller = Some(Report { message: *message, rate, pauses_ns });
    }

    /// Whether everything that is shown has come.
    pub fn is_complete(&self) -> bool {
        self.health.is_some() && self.controller.is_some() && self.parameters.is_some() && self.timing.is_some()
    }

    /// Whether neither daemon nor controller was heard.
    pub fn is_empty(&self) -> bool {
        self.health.is_none() && self.controller.is_none()
    }

    /// Whether the next report should have come long ago. A process may have been started with another robot file than this
    /// one: pauses count as well, the shorter of two, since one alone may have been an outage.
    fn gone(&self, stamp_ns: u64, pauses_ns: [u64; 2]) -> bool {
        let pause = self.pause_ns.max(pauses_ns[0].min(pauses_ns[1]));
        self.now_ns.saturating_sub(stamp_ns) > (pause / 2).saturating_mul(5)
    }

    /// What the daemon is doing; `None` while it is not heard of.
    pub(crate) fn mode(&self) -> Option<String> {
        let Report { message: health, pauses_ns, .. } = self.health?;
        let mode = DaemonMode::try_from(health.mode).map_or_else(|_| format!("mode {}", health.mode), words);
        Some(if self.gone(health.stamp_ns, pauses_ns) {
            format!("SILENT for {}, was {mode}", self.age(health.stamp_ns))
        } else {
            mode
        })
    }

    /// Whether the arm is still the one that was accepted; `None` while nothing is heard of it.
    pub(crate) fn accepted(&self) -> Option<String> {
        let drift = self.drift?;
        let of = |wanted: DriftVerdict| -> Vec<String> {
            let joints = self.joints.iter().zip(&drift.joint_verdict).zip(&drift.ratio);
            let those = joints.filter(|((_, verdict), _)| **verdict == u32::from(wanted));
            those.map(|((name, _), ratio)| format!("{name} ({} times the residual)", figure(*ratio))).collect()
        };
        Some(match DriftVerdict::try_from(drift.verdict) {
            Ok(DriftVerdict::Left) => format!("left by {}", of(DriftVerdict::Left).join(", ")),
            Ok(DriftVerdict::Within) => "residual as in its first 8 s".to_owned(),
            _ => "unresolved: too little motion so far".to_owned(),
        })
    }

    /// What the controller is doing; `None` while it is not heard of.
    pub(crate) fn state(&self) -> Option<String> {
        let Report { message: health, pauses_ns, .. } = self.controller?;
        let state = ControllerState::try_from(health.state).map_or_else(|_| format!("state {}", health.state), words);
        let stopped = [ControllerState::Stopping, ControllerState::Strayed].map(u32::from).contains(&health.state);
        let state =
            if stopped { format!("{state}: {}", self.cause(health.stop_cause, health.stop_joints)) } else { state };
        let gone = self.gone(health.stamp_ns, pauses_ns);
        Some(if gone { format!("SILENT for {}, was {state}", self.age(health.stamp_ns)) } else { state })
    }

    /// Why the controller stopped the arm or refused a plan, with the joints.
    pub(crate) fn cause(&self, cause: u32, joints: u32) -> String {
        let cause = StopCause::try_from(cause).map_or_else(|_| format!("cause {cause}"), words);
        let named = self.joints.iter().enumerate().filter(|(j, _)| joints >> j & 1 == 1);
        let named: Vec<&str> = named.map(|(_, name)| name.as_str()).collect();
        if named.is_empty() { cause } else { format!("{cause} of {}", named.join(", ")) }
    }

    /// The last stop of the controller first, then all of them by cause; `None` before the first.
    pub(crate) fn stops(&self, health: &ControllerHealth) -> Option<String> {
        let named = |(i, &count): (usize, &u64)| {
            let cause = u32::try_from(i).unwrap_or(u32::MAX);
            format!("{count} {}", self.cause(cause, 0))
        };
        let all: Vec<String> =
            health.stop_causes.iter().enumerate().filter(|(_, count)| **count > 0).map(named).collect();
        let last = self.cause(health.stop_cause, health.stop_joints);
        (health.stops > 0).then(|| format!("{last} (the last); {}; {} resumed", all.join(", "), health.resumed))
    }

    /// Setpoints that the controller refused; `None` before the first.
    pub(crate) fn refused_plan(&self, health: &ControllerHealth) -> Option<String> {
        let last = self.cause(health.plan_refusal, health.plan_joints);
        (health.setpoints_refused > 0)
            .then(|| format!("{} setpoints refused; the last: {last}", health.setpoints_refused))
    }

    /// Time since a stamp.
    pub(crate) fn age(&self, stamp_ns: u64) -> String {
        duration(self.now_ns.saturating_sub(stamp_ns))
    }

    /// Whether the parameters are of the model that this program reads out of the robot file.
    pub(crate) fn same_model(&self) -> bool {
        self.parameters.is_none_or(|set| set.model_hash == self.hash && set.len() == self.names.len())
    }

    /// Name of parameter `i` of the set.
    pub(crate) fn name(&self, i: usize) -> String {
        let known = self.same_model().then(|| self.names.get(i).cloned()).flatten();
        known.unwrap_or_else(|| format!("parameter {}", i + 1))
    }
}

/// Rate and pauses of a report with this count and stamp; `before`: count, stamp and pauses of the one before.
fn follow(before: Option<(u64, u64, [u64; 2])>, count: u64, stamp_ns: u64) -> (f64, [u64; 2]) {
    let Some((old_count, old_stamp_ns, pauses_ns)) = before else { return (f64::NAN, [0; 2]) };
    // A process that started anew counts from the beginning; nothing is known of its pauses.
    if count < old_count {
        return (f64::NAN, [0; 2]);
    }
    let pause_ns = stamp_ns.saturating_sub(old_stamp_ns);
    let rate = if pause_ns > 0 { (count - old_count) as f64 / (pause_ns as f64 * 1e-9) } else { f64::NAN };
    (rate, [pause_ns, pauses_ns[0]])
}

/// A fault in words. The message's name for a torque against the model is that of one cause; a model that is wrong, as after a
/// load it has not learnt, is another.
fn fault_words(fault: InputFault) -> String {
    match fault {
        InputFault::SignFlipped => "torque opposite to the model's: sign flipped or model wrong".to_owned(),
        other => words(other),
    }
}

/// A duration in ns with a unit that suits it.
pub(crate) fn duration(ns: u64) -> String {
    match ns {
        0..1_000 => format!("{ns} ns"),
        1_000..1_000_000 => format!("{:.0} us", ns as f64 * 1e-3),
        1_000_000..10_000_000_000 => format!("{:.1} ms", ns as f64 * 1e-6),
        _ => format!("{:.0} s", ns as f64 * 1e-9),
    }
}

/// Median, p99, p99.9 and the worst of a histogram.
pub(crate) fn quantiles(counts: &[u32; LogHistogram::BINS], worst_ns: u64) -> String {
    let histogram = LogHistogram::from_counts(*counts, worst_ns);
    let at = |p| duration(histogram.quantile(p));
    format!("p50 {}, p99 {}, p99.9 {}, worst {}", at(0.5), at(0.99), at(0.999), duration(worst_ns))
}

pub(crate) fn instruments(source: u32) -> String {
    InstrumentSource::try_from(source).map_or_else(|_| "unknown".to_owned(), words)
}

/// What a parameter set says of itself, as "; frozen, late"; nothing where there is nothing to say.
pub(crate) fn flags(set: &Parameters) -> String {
    let words: Vec<&str> = [
        (parameter_flags::SUSPENDED, "suspended"),
        (parameter_flags::FROZEN, "frozen"),
        (parameter_flags::PROVISIONAL, "provisional"),
        (parameter_flags::BAD_INPUT, "bad input"),
        (parameter_flags::LATE, "late"),
    ]
    .iter()
    .filter_map(|(bit, word)| (set.flags & bit != 0).then_some(*word))
    .collect();
    if words.is_empty() { String::new() } else { format!("; {}", words.join(", ")) }
}

pub(crate) fn parameter_state(state: u8) -> &'static str {
    match ParameterState::try_from(state) {
        Ok(ParameterState::Active) => "active",
        Ok(ParameterState::Held) => "held",
        Ok(ParameterState::Unidentified) => "open",
        Err(_) => "unknown",
    }
}

/// What a process that polls for samples reports.
pub(crate) const POLLS: &str = "POLLS: the robot controller does not send the wake-up event";

/// Whether a process can write its state folder.
pub(crate) fn state_folder(state: u32) -> String {
    match StateFolder::try_from(state) {
        Ok(StateFolder::None) => "no folder: nothing is stored or recorded".to_owned(),
        Ok(StateFolder::Writable) => "folder can be written".to_owned(),
        Ok(StateFolder::Unwritable) => "FOLDER CANNOT BE WRITTEN: nothing is stored or recorded".to_owned(),
        Ok(StateFolder::Full) => "FOLDER IS FULL: less than 64 KiB are left, records may be missing".to_owned(),
        Err(_) => format!("state of the folder {state}"),
    }
}

/// Whether something is wrong with a state folder, which has to be looked after.
pub(crate) fn is_state_lost(state: u32) -> bool {
    ![StateFolder::None, StateFolder::Writable].map(u32::from).contains(&state)
}

/// Whose parameters the controller uses, and why.
pub(crate) fn source(health: &ControllerHealth) -> String {
    let source = ParameterSource::try_from(health.source).map_or_else(|_| "unknown".to_owned(), words);
    let reason = SourceReason::try_from(health.source_reason).map_or_else(|_| "unknown".to_owned(), words);
    format!("{source} ({reason})")
}

/// Refusals that have happened, the most frequent first.
pub(crate) fn refusals(health: &ControllerHealth) -> Vec<(String, u64)> {
    let named = |(i, &count): (usize, &u64)| {
        let kind = u32::try_from(i).ok().and_then(|i| ParameterRefusal::try_from(i).ok());
        (kind.map_or_else(|| format!("reason {i}"), words), count)
    };
    // The first entry stands for no refusal.
    let mut out: Vec<_> =
        health.refusals.iter().enumerate().skip(1).filter(|(_, count)| **count > 0).map(named).collect();
    out.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    out
}

/// What was wrong with samples, and how often, the most frequent first.
pub fn faults_met(health: &Health) -> Vec<(String, u64)> {
    let named = |(i, &count): (usize, &u64)| {
        let kind = u32::try_from(i).ok().and_then(|i| InputFault::try_from(i).ok());
        (kind.map_or_else(|| format!("fault {i}"), fault_words), count)
    };
    // The first entry stands for no fault.
    let mut out: Vec<_> =
        health.input_faults.iter().enumerate().skip(1).filter(|(_, count)| **count > 0).map(named).collect();
    out.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    out
}

/// A number in at most ten characters; a dash where there is none.
pub(crate) fn figure(x: f64) -> String {
    match x.abs() {
        _ if !x.is_finite() => "-".to_owned(),
        0.0 => "0".to_owned(),
        size if !(1e-3..1e5).contains(&size) => format!("{x:.2e}"),
        size if size >= 100.0 => format!("{x:.1}"),
        _ => format!("{x:.4}"),
    }
}

/// Counts that are not zero, as "3 stale, 1 lost"; "none" where all are.
pub(crate) fn happened(counts: &[(&str, u64)]) -> String {
    let some: Vec<_> = counts.iter().filter(|(_, n)| *n > 0).map(|(what, n)| format!("{n} {what}")).collect();
    if some.is_empty() { "none".to_owned() } else { some.join(", ") }
}

/// What is wrong with the samples now, and was last; "none" while and as long as nothing was.
pub(crate) fn input_state(s: &Snapshot, h: &Health) -> String {
    let name = |fault: u32| InputFault::try_from(fault).map_or_else(|_| format!("fault {fault}"), fault_words);
    let last = usize::try_from(h.last_input_fault).unwrap_or(usize::MAX);
    let times = h.input_faults.get(last).copied().unwrap_or(0);
    if h.input_fault != u32::from(InputFault::None) {
        let of: Vec<&str> = s
            .joints
            .iter()
            .enumerate()
            .filter(|(j, _)| h.input_joints >> j & 1 == 1)
            .map(|(_, n)| n.as_str())
            .collect();
        let of = if of.is_empty() { String::new() } else { format!(" of {}", of.join(", ")) };
        format!("{}{of}", name(h.input_fault).to_uppercase())
    } else if h.last_input_fault != u32::from(InputFault::None) {
        let over = if h.recovery_s.is_finite() { format!(", over in {:.2} s", h.recovery_s) } else { String::new() };
        format!("sound; last {}, {times} times{over}", name(h.last_input_fault))
    } else {
        "none".to_owned()
    }
}

/// What is left out for want of time.
pub(crate) fn load(h: &Health) -> String {
    let level = LoadLevel::try_from(h.load_level).map_or_else(|_| format!("level {}", h.load_level), words);
    let since = if h.load_changes == 0 { String::new() } else { format!(" since sample {}", h.load_seq) };
    let more = happened(&[
        ("changes", h.load_changes),
        ("samples left aside", h.samples_held),
        ("rows in doubt", h.rows_doubted),
        ("late sets", h.late_sets),
    ]);
    if more == "none" { format!("{level}{since}") } else { format!("{level}{since}; {more}") }
}

/// Names of the phases after the wait, short.
pub(crate) const WORK: [&str; PHASES - 1] = ["read", "diff", "model", "est", "sup", "pub"];

/// The time that 99 of 100 periods spend in each phase of [`WORK`] at most \[us\].
pub(crate) fn phase_quantiles_us(timing: &Timing) -> impl Iterator<Item = f64> {
    let bins = timing.phase_histogram.chunks_exact(HISTOGRAM_BINS).zip(timing.phase_max_ns).skip(1);
    bins.map(|(bins, max)| {
        let mut counts = [0; LogHistogram::BINS];
        counts.copy_from_slice(bins);
        LogHistogram::from_counts(counts, max).quantile(0.99) as f64 * 1e-3
    })
}

/// The same in words.
pub(crate) fn phases(timing: &Timing) -> String {
    let each = WORK.iter().zip(phase_quantiles_us(timing)).map(|(name, us)| format!("{name} {us:.0}"));
    each.collect::<Vec<_>>().join(", ")
}

/// The worst period of the last hour, and what the worst ones were long by.
pub(crate) fn worst(timing: &Timing) -> String {
    let count = (timing.count as usize).min(timing.worst_cause.len());
    if count == 0 {
        return "none".to_owned();
    }
    let cause = |code: u32| PeriodCause::try_from(code).map_or_else(|_| format!("cause {code}"), words);
    let total: u64 = timing.worst_phase_ns[..PHASES].iter().map(|&ns| u64::from(ns)).sum();
    let mut causes: Vec<(String, usize)> = Vec::new();
    for code in &timing.worst_cause[..count] {
        let name = cause(*code);
        match causes.iter_mut().find(|(known, _)| *known == name) {
            Some((_, times)) => *times += 1,
            None => causes.push((name, 1)),
        }
    }
    causes.sort_by_key(|(_, times)| std::cmp::Reverse(*times));
    let causes: Vec<_> = causes.iter().map(|(name, times)| format!("{times} {name}")).collect();
    format!("{}, {}; of {count}: {}", duration(total), cause(timing.worst_cause[0]), causes.join(", "))
}

/// What went wrong on the daemon's input.
pub(crate) fn input_faults(health: &Health) -> String {
    happened(&[
        ("lost", health.lost),
        ("stale", health.refused_stale),
        ("invalid", health.refused_invalid),
        ("with fault bits", health.rejected_faults),
        ("gaps", health.gaps),
        ("without a setpoint", health.setpoints_missing),
    ])
}

/// What went wrong in the daemon itself.
pub(crate) fn drops(health: &Health) -> String {
    happened(&[
        ("periods missed", health.overruns),
        ("times at the catch-up limit", health.catch_up_limited),
        ("messages dropped", health.dropped_messages),
    ])
}

/// What went wrong in the controller.
pub(crate) fn controller_faults(health: &ControllerHealth) -> String {
    happened(&[
        ("stops", health.stops),
        ("times strayed from the plan", health.strayed),
        ("setpoints refused", health.setpoints_refused),
        ("broken torques", health.broken),
        ("stale samples", health.refused_stale),
        ("invalid samples", health.refused_invalid),
        ("samples passed over", health.passed_over),
        ("commands at the torque limit", health.saturated),
        ("commands at the rate limit", health.rate_limited),
        ("setpoints brought back", health.setpoints_limited),
        ("joint states of a second publisher", health.foreign_joint_states),
        ("setpoints of a second publisher", health.foreign_setpoints),
        ("parameters of a second publisher", health.foreign_parameters),
    ])
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    const S: u64 = 1_000_000_000;
    const BEGIN: u64 = 1000 * S;

    /// The UR10e, with samples at this period and health after so many of them.
    fn robot(sample_period_s: f64, health_every: usize) -> Snapshot {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../robots/ur10e/robot.toml");
        let mut robot = rivet_config::load(file).expect("the arm is there");
        robot.config.sample_period_s = sample_period_s;
        robot.config.publish.health_every = health_every;
        Snapshot::new(&robot, &BusConfig::default())
    }

    /// Reports of both processes at these times \[s\] after the beginning, each with more behind it than the one before.
    fn report(s: &mut Snapshot, times_s: &[u64]) {
        for &t in times_s {
            let stamp_ns = BEGIN + t * S;
            s.take_health(&Health { stamp_ns, samples: t + 1, ..Health::default() });
            s.take_controller(&ControllerHealth { stamp_ns, commands: t + 1, ..ControllerHealth::default() });
        }
    }

    /// Whether daemon and controller are called silent so long after the beginning \[s\].
    fn silent(s: &mut Snapshot, at_s: f64) -> [bool; 2] {
        s.now_ns = BEGIN + (at_s * 1e9) as u64;
        [s.mode(), s.state()].map(|said| said.expect("it was heard").starts_with("SILENT"))
    }

    #[test]
    fn how_long_is_silent_depends_on_the_period_and_on_what_the_robot_file_asks_for() {
        // 8 ms and 1000 samples: a report every eight seconds.
        for (period_s, every, still_s, gone_s) in
            [(0.001, 1000, 2.4, 2.6), (0.008, 125, 2.4, 2.6), (0.008, 1000, 19.9, 20.1), (0.001, 10, 2.4, 2.6)]
        {
            let mut s = robot(period_s, every);
            report(&mut s, &[0]);
            assert_eq!(silent(&mut s, still_s), [false; 2], "{period_s} s, {every} samples: {still_s} s");
            assert_eq!(silent(&mut s, gone_s), [true; 2], "{period_s} s, {every} samples: {gone_s} s");
        }
    }

    /// Started with another robot file than the monitor was.
    #[test]
    fn who_was_seen_to_report_less_often_is_waited_for() {
        let mut s = robot(0.001, 1000);
        report(&mut s, &[0, 8, 16]);
        assert_eq!(silent(&mut s, 16.0 + 19.9), [false; 2]);
        assert_eq!(silent(&mut s, 16.0 + 20.1), [true; 2]);
    }

    #[test]
    fn one_outage_does_not_make_the_next_one_look_sound() {
        let mut s = robot(0.001, 1000);
        report(&mut s, &[0, 1, 2, 62]);
        assert_eq!(silent(&mut s, 64.4), [false; 2]);
        assert_eq!(silent(&mut s, 64.6), [true; 2]);
        // Nor do the pauses of a process that has ended: its successor counts from the beginning.
        report(&mut s, &[70, 80]);
        s.take_health(&Health { stamp_ns: BEGIN + 90 * S, samples: 1, ..Health::default() });
        s.take_controller(&ControllerHealth { stamp_ns: BEGIN + 90 * S, commands: 1, ..ControllerHealth::default() });
        assert_eq!(silent(&mut s, 92.4), [false; 2]);
        assert_eq!(silent(&mut s, 92.6), [true; 2]);
    }

    #[test]
    fn a_parameter_set_that_is_late_says_so() {
        let mut s = robot(0.001, 1000);
        let mut said = |bits| {
            s.parameters = Some(Parameters { flags: bits, epoch: 5, ..Parameters::default() });
            let text = crate::as_text(&s);
            text.lines().find(|line| line.starts_with("parameters ")).expect("it is there").to_owned()
        };
        assert!(said(parameter_flags::LATE | parameter_flags::FROZEN).contains("; frozen, late"));
        let level = 2_u32 << parameter_flags::LOAD_SHIFT;
        assert!(!said(level).contains("late"), "a load level is no lateness");
    }
}
