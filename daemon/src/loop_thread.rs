//! The real-time thread: wait, take in what is queued, tick, hand over. Nothing else.

use crate::context::ThreadContext;
use crate::core::Core;
use crate::flight::Recorder;
use crate::ladder::Ladder;
use crate::outbound::Outbound;
use crate::progress::{Progress, Snapshot};
use crate::reload::Incoming;
use crate::snapshot::Snapshots;
use crate::streams::Streams;
use crate::timing::Timing;
use rivet_config::Trigger;
use rivet_ipc_schema::{
    Bus, BusConfig, BusError, ControlCommand, DaemonMode, Drift, Health, InputFault, LoopPhase, Parameters, RobotName,
    SampleWait, Timing as TimingMessage, parameter_flags,
};
use rivet_realtime::{Overrun, PeriodTimer, RealTimeSettings, Shutdown, Suspension, now_ns};
use rivet_service::Flight;
use std::sync::Arc;
use std::time::Duration;

/// What the daemon's services take of /dev/shm, with a little to spare \[bytes\].
pub(crate) const SHARED_MEMORY: u64 = 32 << 20;

/// How the loop runs.
#[derive(Clone, Debug)]
pub struct LoopSettings {
    /// Time between periods.
    pub period: Duration,
    /// What starts a period.
    pub trigger: Trigger,
    /// What becomes of periods that have passed.
    pub overrun: Overrun,
    /// Most samples taken in within one period.
    pub catch_up: usize,
    /// Samples between health messages, which come by time where samples do not.
    pub health_every: u64,
    /// Without a sample for this long the input counts as stale, and a set that is this much behind its sample as late \[ns\].
    pub stale_ns: u64,
    /// Scheduling and memory.
    pub realtime: RealTimeSettings,
}

/// Without samples a sample-triggered loop still turns this often, so that it can stop and report.
const SAMPLE_PATIENCE: Duration = Duration::from_millis(20);

/// Without samples health is reported this often \[ns\].
const IDLE_NS: u64 = 100_000_000;

/// What is news does not wait for the samples that make health due, but for this long since the last report \[ns\].
const NEWS_NS: u64 = 200_000_000;

/// Periods without a sample after which a stream counts as quiet.
const QUIET_PERIODS: u64 = 3;

enum Pace {
    Timer(PeriodTimer),
    Sample(Box<SampleWait>),
}

/// What the loop reads from, and what starts its periods.
struct Ports {
    input: Streams,
    pace: Pace,
}

impl Ports {
    fn open(bus: &Bus, settings: &LoopSettings) -> Result<Ports, BusError> {
        let input = Streams::open(bus)?;
        let pace = match settings.trigger {
            Trigger::Timer => Pace::Timer(PeriodTimer::new(settings.period).with_overrun(settings.overrun)),
            // Polled, it turns once a period, as with the timer.
            Trigger::Sample => Pace::Sample(Box::new(SampleWait::new(bus.joint_state_listener()?, settings.period))),
        };
        Ok(Ports { input, pace })
    }
}

/// A wake-up.
#[derive(Clone, Copy, Debug)]
pub struct Wake {
    /// How much later than due it came \[ns\]; 0 where a sample starts the period.
    pub lateness_ns: u64,
    /// Further periods that had passed by then.
    pub missed: u64,
}

impl Pace {
    fn received_sample(&mut self) {
        if let Pace::Sample(arrival) = self {
            arrival.received_sample();
        }
    }

    fn polls(&self) -> bool {
        matches!(self, Pace::Sample(arrival) if arrival.polls())
    }

    fn wait(&mut self) -> Wake {
        match self {
            Pace::Timer(timer) => {
                let tick = timer.wait();
                Wake { lateness_ns: tick.lateness_ns, missed: tick.missed }
            }
            Pace::Sample(arrival) => {
                // A listener that fails must not make the loop spin.
                if arrival.wait(SAMPLE_PATIENCE).is_err() {
                    std::thread::sleep(Duration::from_millis(1));
                }
                Wake { lateness_ns: 0, missed: 0 }
            }
        }
    }
}

/// How far sets are behind the samples they were made from, reckoned from the least that was seen lately: stamps may be of
/// another clock, a log's say, which jumps or drifts.
#[derive(Clone, Copy, Debug)]
struct Delay {
    /// In this span and in the one before.
    least: [i64; 2],
    since_ns: u64,
}

impl Default for Delay {
    fn default() -> Delay {
        Delay { least: [i64::MAX; 2], since_ns: 0 }
    }
}

/// How long a least delay counts, once more at most \[ns\].
const DELAY_SPAN: u64 = 10_000_000_000;

impl Delay {
    fn late(&mut self, now_ns: u64, stamp_ns: u64, limit_ns: u64) -> bool {
        if now_ns.saturating_sub(self.since_ns) >= DELAY_SPAN {
            self.least = [i64::MAX, self.least[0]];
            self.since_ns = now_ns;
        }
        let delay = now_ns.wrapping_sub(stamp_ns).cast_signed();
        self.least[0] = self.least[0].min(delay);
        delay.saturating_sub(self.least[0].min(self.least[1])).cast_unsigned() > limit_ns
    }
}

/// What is wrong with the input: what health does not wait to say.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Wrong {
    fault: InputFault,
    gone: bool,
    foreign: bool,
    full: bool,
}

impl Wrong {
    const NOTHING: Wrong = Wrong { fault: InputFault::None, gone: false, foreign: false, full: false };

    /// Whether this is news to whoever has heard `said`. That a second publisher was not heard since says little: it may send
    /// less often than health is told.
    fn is_news(self, said: Wrong) -> bool {
        Wrong { foreign: self.foreign || said.foreign, ..self } != said
    }
}

/// What ties the loop to the other threads; wait-free, all of it.
pub struct Channels {
    /// Messages for publication.
    pub outbound: rtrb::Producer<Outbound>,
    /// Requests.
    pub commands: rtrb::Consumer<ControlCommand>,
    /// Changed settings.
    pub reload: Incoming,
    /// What the store asks for.
    pub snapshots: Snapshots,
    /// How far the loop is.
    pub progress: Arc<Progress>,
    /// The flight record, if there is one.
    pub flight: Option<Arc<Flight>>,
}

/// Everything of the loop: made once, then [`period`](RealTimeLoop::period) again and again.
pub struct RealTimeLoop {
    core: Core,
    settings: LoopSettings,
    input: Streams,
    pace: Pace,
    channels: Channels,
    recorder: Recorder,
    /// A period with samples was in time.
    met: bool,
    timing: Timing,
    ladder: Ladder,
    suspension: Suspension,
    delay: Delay,
    parameters: Parameters,
    health: Health,
    drift: Drift,
    message: TimingMessage,
    since_health: u64,
    /// When health was last reported, and how long it may wait for the samples that make it due.
    reported_ns: u64,
    longest_ns: u64,
    said: Wrong,
    idle: u64,
    last_sample_ns: Option<u64>,
    foreign_reported: u64,
    gone: bool,
    /// Shared memory was full when last reported.
    full: bool,
    _bus: Bus,
}

impl RealTimeLoop {
    /// Opens the ports on the calling thread, which is the one to run it.
    ///
    /// # Errors
    /// The bus.
    pub fn open(
        core: Core,
        settings: &LoopSettings,
        config: &BusConfig,
        name: &RobotName,
        channels: Channels,
    ) -> Result<RealTimeLoop, BusError> {
        let bus = Bus::open(config, name, "rivetd-loop")?;
        let ports = Ports::open(&bus, settings)?;
        Ok(RealTimeLoop::new(core, settings, bus, ports, channels))
    }

    fn new(core: Core, settings: &LoopSettings, bus: Bus, ports: Ports, channels: Channels) -> RealTimeLoop {
        let Ports { input, pace } = ports;
        let period_ns = u64::try_from(settings.period.as_nanos()).unwrap_or(u64::MAX);
        RealTimeLoop {
            recorder: Recorder::new(channels.flight.clone(), core.dof()),
            core,
            settings: settings.clone(),
            input,
            pace,
            channels,
            met: false,
            timing: Timing::new(period_ns),
            ladder: Ladder::new(period_ns),
            suspension: Suspension::watch(),
            delay: Delay::default(),
            parameters: Parameters::default(),
            health: Health::default(),
            drift: Drift::default(),
            message: TimingMessage::default(),
            since_health: 0,
            reported_ns: now_ns(),
            // A stream that is a little slow, or loses samples, still comes to report after samples, not by the clock.
            longest_ns: (period_ns.saturating_mul(settings.health_every) / 4).saturating_mul(5).max(NEWS_NS),
            said: Wrong::NOTHING,
            idle: 0,
            last_sample_ns: None,
            foreign_reported: 0,
            gone: false,
            full: false,
            _bus: bus,
        }
    }

    /// One period.
    pub fn period(&mut self) {
        let wake = self.wait();
        self.work(wake);
    }

    /// Sleeps until the next period is due, or a sample has come.
    pub fn wait(&mut self) -> Wake {
        self.pace.wait()
    }

    /// The work of a period. Real-time safe: no allocation, lock or panic, and no system call but one, which reads the
    /// thread's counters with a message or a period that was one of the worst.
    pub fn work(&mut self, wake: Wake) {
        let start = self.timing.begin(wake.lateness_ns);
        if self.suspension.look().is_some() {
            self.core.note(InputFault::ClockSuspended, 1);
        }
        while let Ok(command) = self.channels.commands.pop() {
            self.core.control(command);
        }
        self.channels.reload.apply(&mut self.core);
        let taken = self.take(start);
        self.timing.overruns += wake.missed;
        self.timing.catch_up_limited += u64::from(taken == self.settings.catch_up);
        self.since_health += taken as u64;
        if taken > 0 {
            self.pace.received_sample();
            self.last_sample_ns = Some(start);
            self.gone = false;
        }
        self.idle = if taken == 0 { self.idle + 1 } else { 0 };
        // The last samples of a stream that stopped are reported too, soon after it went quiet.
        let went_quiet = self.idle == QUIET_PERIODS && self.since_health > 0;
        let due = self.since_health >= self.settings.health_every;
        let longest = if self.idle >= QUIET_PERIODS {
            IDLE_NS
        } else if self.wrong().is_news(self.said) {
            NEWS_NS
        } else {
            self.longest_ns
        };
        if due || went_quiet || start.saturating_sub(self.reported_ns) >= longest {
            self.report(start);
        }
        let counts = self.core.counts();
        let work = self.timing.so_far();
        // What came in late is not yet what the service was started for.
        self.met |= counts.samples > 0 && wake.missed == 0 && u128::from(work) <= self.settings.period.as_nanos();
        self.channels.progress.write(Snapshot {
            periods: self.timing.periods + 1,
            samples: counts.samples,
            lost: counts.lost,
            epoch: self.core.epoch(),
            met: self.met,
            polls: self.pace.polls(),
            wrong_period_ns: self.core.wrong_period_s().map_or(0, |period| (period * 1e9) as u64),
        });
        self.channels.snapshots.serve(&mut self.core);
        self.timing.done(LoopPhase::Publish);
        let work = self.timing.end();
        if let Some(level) = self.ladder.period(work, taken) {
            self.core.set_load(level);
        }
    }

    /// Takes in what is queued, at most `catch_up` samples; how many there were.
    fn take(&mut self, start: u64) -> usize {
        let mut taken = 0;
        while taken < self.settings.catch_up {
            let Some((sample, setpoint, link)) = self.input.next(start) else { break };
            self.timing.done(LoopPhase::Read);
            taken += 1;
            let timing = &mut self.timing;
            let output =
                self.core.tick_timed(&sample, setpoint.as_ref(), link.as_ref(), |phase| timing.estimator_done(phase));
            self.recorder.sample(&self.core, &sample, setpoint.as_ref());
            // Stamps of samples that are refused say nothing of the others.
            let late = output.taken.is_ok() && self.delay.late(start, sample.stamp_ns, self.settings.stale_ns);
            if output.publish {
                self.core.write_parameters(&mut self.parameters);
                if late {
                    self.timing.late_sets += 1;
                    self.parameters.flags |= parameter_flags::LATE;
                }
                let full = self.channels.outbound.push(Outbound::Parameters(self.parameters)).is_err();
                self.timing.dropped += u64::from(full);
                self.timing.done(LoopPhase::Publish);
            }
        }
        self.timing.done(LoopPhase::Read);
        taken
    }

    /// As far as it shows between two reports; that samples do not come, reports without samples find out.
    fn wrong(&self) -> Wrong {
        Wrong {
            fault: self.core.input_fault(),
            gone: self.gone,
            foreign: self.input.foreign() > self.foreign_reported,
            full: self.channels.progress.no_room(),
        }
    }

    fn report(&mut self, start: u64) {
        self.since_health = 0;
        self.reported_ns = start;
        let publishers = self.input.publishers();
        let foreign = self.input.foreign() - self.foreign_reported;
        self.foreign_reported += foreign;
        if foreign > 0 {
            self.core.note(InputFault::SecondPublisher, foreign);
        }
        let silent = self.last_sample_ns.is_some_and(|last| start.saturating_sub(last) > self.settings.stale_ns);
        // A publisher that was killed is listed until someone clears it away.
        let gone = silent || (publishers == 0 && self.last_sample_ns.is_some());
        if gone && !self.gone {
            self.core.note(InputFault::PublisherGone, 1);
            self.recorder.gone();
        }
        self.gone = gone;
        let full = self.channels.progress.no_room();
        if full && !self.full {
            self.core.note(InputFault::SharedMemoryFull, 1);
        }
        self.full = full;
        self.said = Wrong { fault: self.core.input_fault(), gone, foreign: foreign > 0, full };
        let health = &mut self.health;
        self.core.write_health(health);
        self.timing.write_health(health);
        health.stamp_ns = start;
        health.publishers = publishers as u32;
        health.polls = self.pace.polls().into();
        if foreign > 0 && health.input_fault == u32::from(InputFault::None) {
            health.input_fault = InputFault::SecondPublisher.into();
        }
        if full && health.input_fault == u32::from(InputFault::None) {
            health.input_fault = InputFault::SharedMemoryFull.into();
        }
        if gone {
            health.input_fault = InputFault::PublisherGone.into();
        }
        if silent {
            health.mode = DaemonMode::Stale.into();
        }
        self.core.write_drift(&mut self.drift);
        self.drift.stamp_ns = start;
        self.timing.dropped += u64::from(self.channels.outbound.push(Outbound::Drift(self.drift)).is_err());
        self.timing.write(&mut self.message);
        self.message.stamp_ns = start;
        self.timing.dropped += u64::from(self.channels.outbound.push(Outbound::Health(self.health)).is_err());
        self.timing.dropped += u64::from(self.channels.outbound.push(Outbound::Timing(self.message)).is_err());
    }
}

/// Runs the loop until shut down. Ports are opened and real time is entered before the first period.
pub(crate) fn run(context: &ThreadContext, core: Core, settings: &LoopSettings, channels: Channels) {
    let shutdown = &context.shutdown;
    // Where another program speaks another version of what is read, the daemon is there all the same, and says so.
    let opened =
        Bus::open(&context.bus, &context.name, "rivetd-loop").and_then(|bus| match Ports::open(&bus, settings) {
            Err(BusError::Version(_)) => Ok((bus, None)),
            ports => ports.map(|ports| (bus, Some(ports))),
        });
    let (bus, ports) = match opened {
        Ok(opened) => opened,
        Err(why) => {
            context.report_failure(why);
            return;
        }
    };
    match rivet_realtime::enter(&settings.realtime) {
        Ok(granted) => {
            for refused in &granted.refused {
                log::warn!("goes on without real time: {refused}");
            }
            context.report_ready();
        }
        Err(why) => {
            context.report_failure(why);
            return;
        }
    }
    let (mut core, mut channels) = (core, channels);
    let ports = match ports.map_or_else(|| until_understood(&bus, settings, &mut core, &mut channels, shutdown), Ok) {
        Ok(ports) => ports,
        Err(why) => {
            channels.snapshots.end(&mut core);
            // Not when the daemon ends anyway.
            if let Some(why) = why {
                context.report_failure(why);
            }
            return;
        }
    };
    let mut turning = RealTimeLoop::new(core, settings, bus, ports, channels);
    while !shutdown.is_requested() {
        turning.period();
    }
    turning.channels.snapshots.end(&mut turning.core);
}

/// Time between two tries to open what another version of a message stands in the way of.
const RETRY: Duration = Duration::from_millis(100);

/// Waits until what is read carries the messages of this version, with [`InputFault::WrongVersion`] in health meanwhile. Not
/// real-time: there are no samples yet.
///
/// # Errors
/// What else stands in the way; `None` when the daemon is to end.
fn until_understood(
    bus: &Bus,
    settings: &LoopSettings,
    core: &mut Core,
    channels: &mut Channels,
    shutdown: &Shutdown,
) -> Result<Ports, Option<BusError>> {
    let mut last_news = String::new();
    let mut health = Health::default();
    core.note(InputFault::WrongVersion, 1);
    let mut periods = 0;
    while !shutdown.is_requested() {
        // Names are looked at first: ports that come and go would disturb whoever sends on those that are right.
        let opened = bus.ensure_versions().and_then(|()| {
            rivet_ipc_schema::ensure_room(SHARED_MEMORY)?;
            Ports::open(bus, settings)
        });
        match opened {
            Ok(ports) => {
                log::info!(rivet_event = "right-version"; "messages are of the right version now");
                return Ok(ports);
            }
            Err(why @ (BusError::Version(_) | BusError::SharedMemoryFull { .. })) => {
                // How much room there is changes all the time, and is said once.
                let full = matches!(why, BusError::SharedMemoryFull { .. });
                let news = if full { "full".to_owned() } else { why.to_string() };
                if news != last_news {
                    let event = if full { "shared-memory-full" } else { "wrong-version" };
                    log::error!(rivet_event = event; "{why}; waits for that to end");
                    last_news = news;
                }
            }
            Err(why) => return Err(Some(why)),
        }
        periods += 1;
        while let Ok(command) = channels.commands.pop() {
            core.control(command);
        }
        channels.reload.apply(core);
        channels.snapshots.serve(core);
        core.write_health(&mut health);
        health.mode = DaemonMode::BadInput.into();
        health.input_fault = InputFault::WrongVersion.into();
        health.stamp_ns = now_ns();
        // A message that finds no room is followed by the next.
        let _ = channels.outbound.push(Outbound::Health(health));
        channels.progress.write(Snapshot { periods, ..Snapshot::default() });
        std::thread::sleep(RETRY);
    }
    Err(None)
}

#[cfg(test)]
mod tests {
    use super::Delay;

    #[test]
    fn lateness_is_reckoned_from_the_least_delay_whatever_the_clock() {
        for ahead in [0_u64, 5_000_000_000_000] {
            let mut delay = Delay::default();
            let mut late = |now: u64, stamp: u64| delay.late(now, stamp.wrapping_add(ahead), 20_000_000);
            assert!(!late(1_000_000_000, 999_950_000));
            assert!(!late(1_021_000_000, 1_001_000_000), "20 ms");
            assert!(late(1_024_000_000, 1_002_000_000), "22 ms");
            assert!(!late(1_025_000_000, 1_024_900_000));
            // One stamp of a second ahead makes all others late, but not for ever.
            assert!(!late(1_026_000_000, 2_026_000_000));
            assert!(late(1_027_000_000, 1_026_950_000));
            let again: Vec<bool> = (2..40).map(|s| late(s * 1_000_000_000, s * 1_000_000_000 - 50_000)).collect();
            assert!(again[0] && !again[20..].contains(&true), "{again:?}");
        }
    }
}
