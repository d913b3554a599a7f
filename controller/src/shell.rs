//! What stands around [`Core`]: clock, bus, signals, and a second thread for everything that may wait.

use crate::core::Core;
use crate::error::StartError;
use crate::gate::refusal_text;
use crate::law::Desired;
use crate::service_thread::{self, Pulse};
use rivet_config::Robot;
use rivet_ipc_schema::{
    BlackboardWriter, Bus, BusConfig, BusError, Command, ControllerHealth, ControllerState, JointState, OneSource,
    ParameterSource, Parameters, RobotName, SampleWait, Setpoint,
};
use rivet_realtime::{Hangup, RealTimeSettings, Scheduling, Shutdown, now_ns};
use rivet_service::Flight;
use rivet_store::Store;
use std::io::IsTerminal as _;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// How the controller is to run, beside what the robot file says.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct Options {
    /// The robot file (robot.toml, or model.toml of `rivet identify --export`).
    pub robot: PathBuf,
    /// Overrides `[bus] prefix`.
    #[arg(long)]
    pub prefix: Option<String>,
    /// Overrides `[bus] root`.
    #[arg(long)]
    pub root: Option<PathBuf>,
    /// Folder of the daemon's store, for the last good parameters, and of flight records; without it there are neither.
    #[arg(long, value_name = "DIR")]
    pub state: Option<PathBuf>,
    /// State folder of an earlier installation: read where --state has nothing of this robot.
    #[arg(long, value_name = "DIR", requires = "state")]
    pub state_before: Option<PathBuf>,
    /// Go on without real-time scheduling and locked memory where they are refused.
    #[arg(long)]
    pub best_effort: bool,
    /// Refuse to start without them, regardless of `[realtime] required`.
    #[arg(long, conflicts_with = "best_effort")]
    pub require_real_time: bool,
    /// Published parameters act from this sample number on; until then the robot file's values do.
    #[arg(long, value_name = "SEQ", default_value_t = 0)]
    pub adopt_from: u64,
    /// Published and stored parameters never act: the robot file's values stay.
    #[arg(long)]
    pub nominal: bool,
    /// The plant waits for each command (rivet-sim --lockstep): silence is a slow machine, and no stop reaction follows.
    #[arg(long)]
    pub lockstep: bool,
    /// End with the process that started this one.
    #[arg(long, hide = true)]
    pub die_with_parent: bool,
}

/// Before the first sample the loop still turns this often, so that it can stop.
const PATIENCE: Duration = Duration::from_millis(20);

/// Samples taken in per period; more would be an unbounded loop.
const CATCH_UP: usize = 32;

/// Looks for a sample in each sample period while the robot does not notify: the most that polling delays an answer is this
/// part of a period.
const POLLS_PER_PERIOD: u32 = 8;

/// Without samples for this long health is said, and then this often \[ns\].
const QUIET_NS: u64 = 500_000_000;

/// A change of state is said at once, but not more often than this: a state that chatters must not fill the journal \[ns\].
const STATE_NS: u64 = 200_000_000;

/// Messages that may wait for the service thread.
const OUTBOUND: usize = 64;

/// Silence of the robot controller or the planner that is heard after which another one may take its place while it is still
/// listed; the planner's and the daemon's in the samples' time, as the core reckons.
const SUCCESSION: Duration = Duration::from_secs(1);

struct Ports {
    states: OneSource<JointState>,
    arrival: SampleWait,
    setpoints: OneSource<Setpoint>,
    parameters: OneSource<Parameters>,
    command: BlackboardWriter<Command>,
}

fn open(bus: &Bus, robot: &Robot, lockstep: bool) -> Result<Ports, BusError> {
    // In lockstep silence is a slow machine.
    let robots = if lockstep { Duration::MAX } else { SUCCESSION };
    // A daemon is silent when its sets are no longer live.
    let timeout = Duration::from_secs_f64(robot.config.controller.parameter_timeout_s);
    let period = Duration::from_secs_f64(robot.config.sample_period_s);
    Ok(Ports {
        states: OneSource::new(bus.joint_state_subscriber()?, robots),
        arrival: SampleWait::new(bus.joint_state_listener()?, period / POLLS_PER_PERIOD),
        setpoints: OneSource::new(bus.setpoint_subscriber()?, SUCCESSION),
        parameters: OneSource::new(bus.parameters_subscriber()?, timeout),
        command: bus.command_writer()?,
    })
}

/// Runs until SIGTERM or SIGINT.
///
/// # Errors
/// Why it did not start.
pub fn run(options: &Options) -> Result<(), StartError> {
    // A terminal that is closed ends what was started in it. A service goes on: an arm is not let down by who wants it to read
    // its file anew. First of all: without it SIGHUP ends a process, and to the service manager that is a clean end.
    let attended = std::io::stdin().is_terminal();
    let hangup = if attended { None } else { Some(Hangup::listen().map_err(StartError::Signals)?) };
    let robot = rivet_config::load(&options.robot);
    let file = options.robot.to_string_lossy();
    let name = robot.as_ref().map_or("", |robot| robot.config.name.as_str());
    rivet_service::log_as("rivet-controller", &[("RIVET_FILE", &file), ("RIVET_ROBOT", name)]);
    let robot = robot?;
    for line in robot.model.effects_left_out() {
        log::warn!("{line}");
    }
    let signals = if attended { Shutdown::on_signals() } else { Shutdown::on_termination() };
    let shutdown = signals.map_err(StartError::Signals)?;
    if options.die_with_parent {
        rivet_realtime::die_with_parent().map_err(StartError::Signals)?;
    }
    let name = RobotName::new(&robot.config.name)?;
    let config = BusConfig {
        prefix: options.prefix.clone().unwrap_or_else(|| robot.config.bus.prefix.clone()),
        root: options.root.clone().unwrap_or_else(|| robot.config.bus.root.clone()),
    };
    let mut core = Core::new(&robot, if options.nominal { u64::MAX } else { options.adopt_from })?;
    if let Some(folder) = options.state.as_ref().filter(|_| !options.nominal) {
        let mut store = Store::reader(folder, name.as_str());
        // Who starts first: the daemon copies it.
        if let Some(before) = options.state_before.as_deref().filter(|_| !store.has_files()) {
            store = Store::reader(before, name.as_str());
        }
        recall(&mut core, &store, robot.hash);
    }
    let bus = Bus::open(&config, &name, "rivet-controller")?;
    let ports = open(&bus, &robot, options.lockstep)?;
    // The service thread comes first: what this thread starts later would inherit its scheduling.
    let (outbound, inbound) = rtrb::RingBuffer::<ControllerHealth>::new(OUTBOUND);
    let pulse = Arc::new(Pulse::default());
    let columns = ["q", "tau", "q_des", "qd_des", "qdd_des", "command"].map(|column| (column, robot.dof()));
    let flight = options.state.as_deref().map(|folder| Arc::new(Flight::new(folder, name.as_str(), &columns)));
    rivet_service::abort_on_panic(flight.clone());
    let service = service_thread::start(&config, &name, inbound, flight.clone(), &pulse, hangup, &shutdown)?;
    let granted = rivet_realtime::enter(&realtime(&robot, options));
    let ended = granted.map_err(StartError::from).map(|granted| {
        for refused in &granted.refused {
            log::warn!("goes on without real time: {refused}");
        }
        log::info!(rivet_event = "waiting"; "{name}: waits for samples");
        let mut control = Loop::new(core, ports, outbound, flight, pulse, &robot, options.lockstep);
        while !shutdown.is_requested() {
            control.period();
        }
        control.core.counts()
    });
    shutdown.request();
    let joined = service.join();
    let counts = ended?;
    joined.map_err(|_| StartError::Thread("the service thread panicked"))??;
    log::info!(
        rivet_event = "stopped";
        "stopped after {} commands; {} parameter sets accepted, {} refused; {} stops",
        counts.commands, counts.accepted, counts.refused, counts.stops
    );
    Ok(())
}

/// Hands over stored parameters, where there are sound ones; says what it found either way.
fn recall(core: &mut Core, store: &Store, hash: u64) {
    let loaded = store.load(hash);
    for (path, problem) in &loaded.problems {
        log::warn!(rivet_event = "state-refused"; "{} {problem}", path.display());
    }
    match loaded.knowledge.map(|knowledge| core.recall(&knowledge.parameters.values)) {
        None => log::info!(rivet_event = "state-none"; "no stored parameters: starts on the robot file's"),
        Some(Ok(())) => {
            log::info!(rivet_event = "state-read"; "stored parameters act once they have passed the gate; until then the robot file's do");
        }
        Some(Err(why)) => {
            log::warn!(rivet_event = "state-refused"; "stored parameters are not used: {}", refusal_text(why));
        }
    }
}

fn realtime(robot: &Robot, options: &Options) -> RealTimeSettings {
    let settings = &robot.config.realtime;
    RealTimeSettings {
        // Below the daemon's loop: the command only needs the newest sample, the estimator needs every one.
        scheduling: settings.priority.map(|p| Scheduling::Fifo(p.saturating_sub(5).max(1))),
        cpu: settings.cpu,
        lock_memory: settings.lock_memory,
        required: (settings.required || options.require_real_time) && !options.best_effort,
    }
}

/// The real-time loop.
struct Loop {
    core: Core,
    ports: Ports,
    /// A parameter set that waits for a sample to be judged at.
    set: Option<Parameters>,
    outbound: rtrb::Producer<ControllerHealth>,
    flight: Option<Arc<Flight>>,
    joints: usize,
    pulse: Arc<Pulse>,
    period: Duration,
    health_every: u64,
    since_health: u64,
    /// When health was last said, and how long it may wait for the samples that make it due.
    said_ns: u64,
    longest_ns: u64,
    said: (ParameterSource, u64, [bool; 3]),
    said_state: ControllerState,
    answered_ns: Option<u64>,
    lockstep: bool,
}

impl Loop {
    fn new(
        core: Core,
        ports: Ports,
        outbound: rtrb::Producer<ControllerHealth>,
        flight: Option<Arc<Flight>>,
        pulse: Arc<Pulse>,
        robot: &Robot,
        lockstep: bool,
    ) -> Loop {
        let health_every = robot.config.publish.health_every as u64;
        let between_ns = health_every as f64 * robot.config.sample_period_s * 1e9;
        Loop {
            said_ns: now_ns(),
            // A plant that is a little slow still makes it due by its samples, not by the clock.
            longest_ns: ((1.25 * between_ns) as u64).max(QUIET_NS),
            said: (core.source(), 0, [false; 3]),
            said_state: core.state(),
            core,
            ports,
            set: None,
            outbound,
            flight,
            joints: robot.dof(),
            pulse,
            period: Duration::from_secs_f64(robot.config.sample_period_s),
            health_every,
            since_health: 0,
            answered_ns: None,
            lockstep,
        }
    }

    /// Waits for the next sample and answers it, or, when there has been none for too long, gives the stop reaction.
    fn period(&mut self) {
        // To the next whole period since the last answer: late wake-ups do not add up to a late stop reaction.
        let period = (self.period.as_nanos() as u64).max(1);
        let patience = match self.answered_ns.filter(|_| !self.lockstep) {
            Some(answered) => Duration::from_nanos(period - now_ns().saturating_sub(answered) % period),
            None => PATIENCE,
        };
        if self.ports.arrival.wait(patience).is_err() {
            // A listener that fails must not make the loop spin.
            std::thread::sleep(Duration::from_millis(1));
        }
        if self.pulse.follow.swap(false, Ordering::Relaxed) {
            self.core.ask_to_follow();
        }
        let now = now_ns();
        let sample = self.newest_sample(now);
        if sample.is_some() {
            self.ports.arrival.received_sample();
        }
        let counts = self.core.counts();
        let samples_ns = (counts.commands + counts.passed_over).saturating_mul(self.period.as_nanos() as u64);
        // Heard in every period, or a publisher would seem silent that is not. A plan comes before its sample.
        if let Ok(Some(setpoint)) = self.ports.setpoints.receive_newest(samples_ns) {
            self.core.offer_setpoint(&setpoint);
        }
        if let Ok(Some(set)) = self.ports.parameters.receive_newest(samples_ns) {
            self.set = Some(set);
        }
        let answered = sample.is_some_and(|sample| self.answer(&sample, now));
        if answered {
            self.pulse.commands.fetch_add(1, Ordering::Relaxed);
            if u128::from(now_ns().saturating_sub(now)) <= self.period.as_nanos() {
                self.pulse.met.store(true, Ordering::Relaxed);
            }
        }
        self.pulse.polls.store(self.ports.arrival.polls(), Ordering::Relaxed);
        self.pulse.periods.fetch_add(1, Ordering::Relaxed);
        if !answered && !self.lockstep {
            self.react(now);
        }
        // Said at once when something changes, else now and then.
        let foreign = [self.ports.states.foreign(), self.ports.setpoints.foreign(), self.ports.parameters.foreign()];
        let saying = (self.core.source(), self.core.counts().stops, foreign.map(|count| count > 0));
        let quiet = self.answered_ns.is_none_or(|answered| now.saturating_sub(answered) >= QUIET_NS);
        let longest = if quiet { QUIET_NS } else { self.longest_ns };
        let overdue = now.saturating_sub(self.said_ns) >= longest;
        let state = self.core.state();
        let changed = state != self.said_state && now.saturating_sub(self.said_ns) >= STATE_NS;
        if self.since_health >= self.health_every || overdue || changed || saying != self.said {
            self.said_state = state;
            self.since_health = 0;
            self.said_ns = now;
            self.said = saying;
            let mut health = ControllerHealth::default();
            self.core.write_health(&mut health);
            health.stamp_ns = now;
            health.polls = self.ports.arrival.polls().into();
            [health.foreign_joint_states, health.foreign_setpoints, health.foreign_parameters] = foreign;
            // A service thread that does not keep up costs messages, never the loop's time.
            let _ = self.outbound.push(health);
        }
    }

    /// The newest sample at hand; those before it are only remembered.
    fn newest_sample(&mut self, now: u64) -> Option<JointState> {
        let mut newest: Option<JointState> = None;
        for _ in 0..CATCH_UP {
            // A port that fails has no message: the stop reaction follows.
            let Some(sample) = self.ports.states.receive(now).ok().flatten() else { break };
            // One that comes twice, or after a newer one, is dropped. Where the robot controller began anew, its next sample shows it.
            if newest.as_ref().is_some_and(|newest| sample.seq <= newest.seq) {
                continue;
            }
            if let Some(older) = newest.replace(sample) {
                self.core.observe(&older);
            }
        }
        newest
    }

    fn answer(&mut self, sample: &JointState, now: u64) -> bool {
        if let Some(set) = self.set.take() {
            self.core.offer_parameters(&set, sample);
        }
        let Ok(mut command) = self.core.tick(sample) else { return false };
        command.stamp_ns = now_ns();
        self.ports.command.write(&command);
        self.answered_ns = Some(now);
        self.since_health += 1;
        if let Some(flight) = &self.flight {
            let n = self.joints;
            // Without a plan the arm was to stay where it was.
            let plan = self.core.plan().copied().unwrap_or(Desired { q: sample.q, ..Desired::default() });
            let columns = [&sample.q, &sample.tau, &plan.q, &plan.qd, &plan.qdd, &command.tau];
            flight.push(sample.stamp_ns, sample.seq, sample.faults, columns.into_iter().flat_map(|c| &c[..n]).copied());
        }
        true
    }

    fn react(&mut self, now: u64) {
        let Some(answered) = self.answered_ns else { return };
        let periods = now.saturating_sub(answered) / (self.period.as_nanos() as u64).max(1);
        let Some(mut command) = self.core.missing(periods) else { return };
        command.stamp_ns = now_ns();
        self.ports.command.write(&command);
        self.since_health += 1;
    }
}
