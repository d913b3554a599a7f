//! The real-time thread: wait, take in what is queued, tick, hand over. Nothing else.

use crate::bus_thread::Outbound;
use crate::core::Core;
use crate::error::StartError;
use crate::progress::{Progress, Snapshot};
use crate::reload::Incoming;
use rivet_config::Trigger;
use rivet_ipc_schema::{
    Bus, BusConfig, BusError, ControlCommand, DaemonMode, Health, JointState, LinkState, Listener, Parameters,
    RobotName, Setpoint, Subscriber,
};
use rivet_realtime::{LogHistogram, PeriodTimer, RealTimeSettings, Shutdown, now_ns};
use std::sync::mpsc::Sender;
use std::time::Duration;

/// How the loop runs.
#[derive(Clone, Debug)]
pub(crate) struct LoopSettings {
    /// Time between periods.
    pub period: Duration,
    /// What starts a period.
    pub trigger: Trigger,
    /// Most samples taken in within one period.
    pub catch_up: usize,
    /// Samples between health messages.
    pub health_every: u64,
    /// Without a sample for this long the input counts as stale \[ns\].
    pub(crate) stale_ns: u64,
    /// Scheduling and memory.
    pub realtime: RealTimeSettings,
}

/// Without samples a sample-triggered loop still turns this often, so that it can stop and report.
const SAMPLE_PATIENCE: Duration = Duration::from_millis(20);

/// Periods after which health is reported even if no sample came.
const IDLE_HEALTH_PERIODS: u64 = 100;

/// Periods without a sample after which a stream counts as quiet.
const QUIET_PERIODS: u64 = 3;

struct Input {
    states: Subscriber<JointState>,
    setpoints: Subscriber<Setpoint>,
    links: Subscriber<LinkState>,
    /// A setpoint, and second encoders, that came before their sample.
    pending: Option<Setpoint>,
    pending_link: Option<LinkState>,
}

enum Pace {
    Timer(PeriodTimer),
    Sample(Box<Listener>),
}

struct Wake {
    lateness_ns: u64,
    missed: u64,
}

impl Input {
    /// The oldest sample not yet taken, and the setpoint and second encoders of its period if they have come. They are
    /// published before their sample, so they are there when the sample is. Bounded by their rings.
    fn next(&mut self) -> Option<(JointState, Option<Setpoint>, Option<LinkState>)> {
        // A port that fails has no sample; the publisher's absence shows in the health message.
        let state = self.states.receive().ok().flatten()?;
        for _ in 0..self.setpoints.capacity() {
            if self.pending.is_some_and(|setpoint| setpoint.seq >= state.seq) {
                break;
            }
            match self.setpoints.receive() {
                Ok(Some(setpoint)) => self.pending = Some(setpoint),
                _ => break,
            }
        }
        for _ in 0..self.links.capacity() {
            if self.pending_link.is_some_and(|link| link.seq >= state.seq) {
                break;
            }
            match self.links.receive() {
                Ok(Some(link)) => self.pending_link = Some(link),
                _ => break,
            }
        }
        let setpoint = self.pending.filter(|setpoint| setpoint.seq == state.seq);
        Some((state, setpoint, self.pending_link.filter(|link| link.seq == state.seq)))
    }
}

impl Pace {
    fn wait(&mut self) -> Wake {
        match self {
            Pace::Timer(timer) => {
                let tick = timer.wait();
                Wake { lateness_ns: tick.lateness_ns, missed: tick.missed }
            }
            Pace::Sample(listener) => {
                // A listener that fails must not make the loop spin.
                if listener.wait(SAMPLE_PATIENCE).is_err() {
                    std::thread::sleep(Duration::from_millis(1));
                }
                Wake { lateness_ns: 0, missed: 0 }
            }
        }
    }
}

/// What the loop measures about itself.
#[derive(Default)]
struct Timing {
    periods: u64,
    overruns: u64,
    catch_up_limited: u64,
    dropped: u64,
    wake: LogHistogram,
    work: LogHistogram,
}

impl Timing {
    fn write(&self, health: &mut Health) {
        health.periods = self.periods;
        health.overruns = self.overruns;
        health.catch_up_limited = self.catch_up_limited;
        health.dropped_messages = self.dropped;
        health.wake_histogram = *self.wake.counts();
        health.work_histogram = *self.work.counts();
        health.worst_wake_ns = self.wake.max();
        health.worst_work_ns = self.work.max();
    }
}

fn open(bus: &Bus, settings: &LoopSettings) -> Result<(Input, Pace), BusError> {
    let input = Input {
        states: bus.joint_state_subscriber()?,
        setpoints: bus.setpoint_subscriber()?,
        links: bus.link_state_subscriber()?,
        pending: None,
        pending_link: None,
    };
    let pace = match settings.trigger {
        Trigger::Timer => Pace::Timer(PeriodTimer::new(settings.period)),
        Trigger::Sample => Pace::Sample(Box::new(bus.joint_state_listener()?)),
    };
    Ok((input, pace))
}

/// Runs the loop until shut down. Ports are opened and real time is entered before the first period.
pub(crate) fn run(
    mut core: Core,
    settings: &LoopSettings,
    config: &BusConfig,
    name: &RobotName,
    mut outbound: rtrb::Producer<Outbound>,
    mut commands: rtrb::Consumer<ControlCommand>,
    mut reload: Incoming,
    progress: &Progress,
    shutdown: &Shutdown,
    ready: &Sender<Result<(), StartError>>,
) {
    let opened = Bus::open(config, name, "rivetd-loop").and_then(|bus| open(&bus, settings).map(|ports| (bus, ports)));
    let (_bus, (mut input, mut pace)) = match opened {
        Ok(opened) => opened,
        Err(why) => {
            let _ = ready.send(Err(why.into()));
            return;
        }
    };
    match rivet_realtime::enter(&settings.realtime) {
        Ok(granted) => {
            for refused in &granted.refused {
                log::warn!("goes on without real time: {refused}");
            }
            let _ = ready.send(Ok(()));
        }
        Err(why) => {
            let _ = ready.send(Err(why.into()));
            return;
        }
    }
    let mut timing = Timing::default();
    let (mut since_health, mut idle) = (0_u64, 0_u64);
    let mut last_sample_ns: Option<u64> = None;
    let mut met = false;
    let (mut parameters, mut health) = (Parameters::default(), Health::default());
    while !shutdown.is_requested() {
        let wake = pace.wait();
        let start = now_ns();
        while let Ok(command) = commands.pop() {
            core.control(command);
        }
        reload.apply(&mut core);
        let mut taken = 0;
        while taken < settings.catch_up {
            let Some((sample, setpoint, link)) = input.next() else { break };
            taken += 1;
            if core.tick_with_link(&sample, setpoint.as_ref(), link.as_ref()).publish {
                core.write_parameters(&mut parameters);
                timing.dropped += u64::from(outbound.push(Outbound::Parameters(parameters)).is_err());
            }
        }
        timing.periods += 1;
        timing.overruns += wake.missed;
        timing.catch_up_limited += u64::from(taken == settings.catch_up);
        timing.wake.record(wake.lateness_ns);
        let work = now_ns().saturating_sub(start);
        timing.work.record(work);
        // What came in late is not yet what the service was started for.
        met |= core.counts().samples > 0 && wake.missed == 0 && u128::from(work) <= settings.period.as_nanos();
        since_health += taken as u64;
        if taken > 0 {
            last_sample_ns = Some(start);
        }
        idle = if taken == 0 { idle + 1 } else { 0 };
        // The last samples of a stream that stopped are reported too, soon after it went quiet.
        let went_quiet = idle == QUIET_PERIODS && since_health > 0;
        if since_health >= settings.health_every || went_quiet || (idle > 0 && idle % IDLE_HEALTH_PERIODS == 0) {
            since_health = 0;
            core.write_health(&mut health);
            timing.write(&mut health);
            health.stamp_ns = start;
            if last_sample_ns.is_some_and(|last| start.saturating_sub(last) > settings.stale_ns) {
                health.mode = DaemonMode::Stale.into();
            }
            timing.dropped += u64::from(outbound.push(Outbound::Health(health)).is_err());
        }
        let counts = core.counts();
        progress.write(Snapshot {
            periods: timing.periods,
            samples: counts.samples,
            lost: counts.lost,
            epoch: core.epoch(),
            met,
            wrong_period_ns: core.wrong_period_s().map_or(0, |period| (period * 1e9) as u64),
        });
    }
}
