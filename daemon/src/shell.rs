//! What stands around [`Core`]: threads, clock, bus, signals.
//!
//! One thread is real-time: it waits, takes in queued samples and ticks the core. Publishing allocates and may work on
//! files, so it lives on the bus thread behind wait-free queues; the main thread watches and talks to the service
//! manager.

use crate::bus_thread::{self, Links, Requests};
use crate::consistent::{self, Projector, Waiting};
use crate::context::ThreadContext;
use crate::core::Core;
use crate::error::StartError;
use crate::flight::flight;
use crate::keeper::{Keeper, Latest};
use crate::loop_thread::{self, Channels, LoopSettings};
use crate::outbound::Outbound;
use crate::progress::Progress;
use crate::reload::Reloader;
use crate::snapshot::snapshots;
use rivet_config::{Realtime, Robot, Scheduler, Trigger};
use rivet_ipc_schema::{BusConfig, ControlCommand, RobotName};
use rivet_realtime::{Hangup, Overrun, RealTimeSettings, Scheduling, Shutdown};
use rivet_service::{Flight, Manager, Reason};
use std::path::PathBuf;
use std::sync::{Arc, mpsc};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// How the daemon is to run, beside what the robot file says.
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
    /// Folder of the store: accepted parameters are kept there, and taken up at the next start; without it nothing is kept.
    #[arg(long, value_name = "DIR")]
    pub state: Option<PathBuf>,
    /// State folder of an earlier installation: what it has of this robot is copied into --state, where that has nothing of it.
    #[arg(long, value_name = "DIR", requires = "state")]
    pub state_before: Option<PathBuf>,
    /// Go on without real-time scheduling and locked memory where they are refused.
    #[arg(long)]
    pub best_effort: bool,
    /// Refuse to start without them, regardless of `[realtime] required`.
    #[arg(long, conflicts_with = "best_effort")]
    pub require_real_time: bool,
    /// Overrides `[realtime] trigger`.
    #[arg(long, value_name = "timer|sample", value_parser = parse_trigger)]
    pub trigger: Option<Trigger>,
    /// End with the process that started this one.
    #[arg(long, hide = true)]
    pub die_with_parent: bool,
}

fn parse_trigger(word: &str) -> Result<Trigger, String> {
    match word {
        "timer" => Ok(Trigger::Timer),
        "sample" => Ok(Trigger::Sample),
        _ => Err("it must be timer or sample".to_owned()),
    }
}

/// Messages that may wait for the bus thread: about a quarter of a second of them at the usual rates.
const OUTBOUND: usize = 64;

/// A loop that stands still for this long is recorded, before the service manager's watchdog ends the process.
const STUCK: Duration = Duration::from_millis(700);

/// How long the end waits for threads.
const THREADS_END: Duration = Duration::from_millis(500);

/// How long the end waits for a reload that is under way.
const RELOAD_ENDS: Duration = Duration::from_millis(200);

/// Control requests that may wait for the loop.
const INBOUND: usize = 16;

/// Runs until SIGTERM or SIGINT.
///
/// # Errors
/// Why it did not start, or which thread stopped.
pub fn run(options: &Options) -> Result<(), StartError> {
    // First of all: without it SIGHUP ends a process, and to the service manager that is a clean end.
    let hangup = Hangup::listen().map_err(StartError::Signals)?;
    let robot = rivet_config::load(&options.robot);
    let file = options.robot.to_string_lossy();
    let name = robot.as_ref().map_or("", |robot| robot.config.name.as_str());
    rivet_service::log_as("rivetd", &[("RIVET_FILE", &file), ("RIVET_ROBOT", name)]);
    let robot = robot?;
    for line in robot.model.effects_left_out() {
        log::warn!("{line}");
    }
    let shutdown = Shutdown::on_termination().map_err(StartError::Signals)?;
    if options.die_with_parent {
        rivet_realtime::die_with_parent().map_err(StartError::Signals)?;
    }
    let name = RobotName::new(&robot.config.name)?;
    let bus = BusConfig {
        prefix: options.prefix.clone().unwrap_or_else(|| robot.config.bus.prefix.clone()),
        root: options.root.clone().unwrap_or_else(|| robot.config.bus.root.clone()),
    };
    let mut core = Core::new(&robot).map_err(StartError::Settings)?;
    rivet_ipc_schema::ensure_room(loop_thread::SHARED_MEMORY)?;
    rivet_ipc_schema::cleanup(&bus)?;
    let keeper = match &options.state {
        Some(folder) => {
            let before = options.state_before.as_deref();
            Some(Keeper::open(folder, before, &name, &robot, &mut core)?)
        }
        None => None,
    };
    let (ready, readiness) = mpsc::channel();
    let context = ThreadContext { bus, name: name.clone(), shutdown: shutdown.clone(), ready };
    let threads = Threads::spawn(&robot, options, core, keeper, hangup, context)?;
    let started = threads.on_bus.iter().try_for_each(|_| started(&readiness, &shutdown));
    if started.is_ok() && !shutdown.is_requested() {
        log::info!(rivet_event = "waiting"; "{}: waiting for samples on {}", name, name.service_name(rivet_ipc_schema::Service::JointState));
        watch(&threads, &shutdown);
    }
    let early = started.is_ok() && threads.one_has_ended() && !shutdown.is_requested();
    shutdown.request();
    let progress = Arc::clone(&threads.progress);
    threads.join();
    started?;
    // What a thread met later: it had said that it was ready.
    readiness.try_iter().collect::<Result<(), StartError>>()?;
    if early {
        return Err(StartError::Thread("a thread of the daemon ended"));
    }
    let end = progress.read();
    log::info!(rivet_event = "stopped"; "stopped after {} samples ({} lost) in {} periods", end.samples, end.lost, end.periods);
    Ok(())
}

/// What the robot file and the command line say of the loop.
fn loop_settings(robot: &Robot, options: &Options) -> LoopSettings {
    let realtime = &robot.config.realtime;
    LoopSettings {
        period: Duration::from_secs_f64(robot.config.sample_period_s),
        trigger: options.trigger.unwrap_or(realtime.trigger),
        overrun: match realtime.overrun {
            rivet_config::Overrun::Skip => Overrun::Skip,
            rivet_config::Overrun::CatchUp => Overrun::CatchUp,
        },
        catch_up: realtime.catch_up,
        health_every: robot.config.publish.health_every as u64,
        stale_ns: (realtime.stale_periods as f64 * robot.config.sample_period_s * 1e9) as u64,
        realtime: RealTimeSettings {
            scheduling: scheduling(realtime, robot.config.sample_period_s),
            cpu: realtime.cpu,
            lock_memory: realtime.lock_memory,
            required: (realtime.required || options.require_real_time) && !options.best_effort,
        },
    }
}

/// The threads of the daemon other than the main one.
struct Threads {
    /// Those with ports on the bus; each reports that it has started.
    on_bus: Vec<JoinHandle<()>>,
    /// The store's, where there is one.
    keeping: Option<JoinHandle<()>>,
    reloading: JoinHandle<()>,
    progress: Arc<Progress>,
    flight: Option<Arc<Flight>>,
}

impl Threads {
    /// Starts them: service threads first, because what the loop thread starts would inherit its scheduling.
    fn spawn(
        robot: &Robot,
        options: &Options,
        core: Core,
        keeper: Option<Keeper>,
        hangup: Hangup,
        context: ThreadContext,
    ) -> Result<Threads, StartError> {
        let settings = loop_settings(robot, options);
        let progress = Arc::new(Progress::default());
        let (outbound, outbound_end) = rtrb::RingBuffer::<Outbound>::new(OUTBOUND);
        let (commands, commands_end) = rtrb::RingBuffer::<ControlCommand>::new(INBOUND);
        let waiting = Arc::new(Waiting::default());
        let kept = Arc::new(Latest::default());
        let flight = options.state.as_deref().map(|folder| Arc::new(flight(folder, robot)));
        rivet_service::abort_on_panic(flight.clone());
        let (outcome, outcomes) = mpsc::channel();
        let (asking, snapshots) = snapshots(core.memory_len());
        let keeping = match keeper.zip(flight.clone()) {
            Some((keeper, flight)) => {
                let (kept, shutdown, answers) = (Arc::clone(&kept), context.shutdown.clone(), outcome.clone());
                let progress = Arc::clone(&progress);
                Some(spawn("rivetd-store", move || keeper.run(&kept, asking, &flight, &answers, &progress, &shutdown))?)
            }
            None => None,
        };
        let (reloader, incoming) = Reloader::new(&options.robot, robot);
        let (reloads, asked) = mpsc::channel();
        let reloading = {
            let shutdown = context.shutdown.clone();
            spawn("rivetd-reload", move || reloader.run(&hangup, &asked, &outcome, &shutdown))?
        };
        let links = Links {
            outbound: outbound_end,
            requests: Requests { commands, reloads, outcomes },
            kept: keeping.is_some().then_some(kept),
            waiting: Arc::clone(&waiting),
            progress: Arc::clone(&progress),
        };
        let bus_context = context.clone();
        let mut on_bus = vec![spawn("rivetd-bus", move || bus_thread::run(&bus_context, links))?];
        let hz = robot.config.publish.consistent_hz;
        if hz > 0.0 {
            let (context, projector, period) =
                (context.clone(), Projector::new(robot), Duration::from_secs_f64(1.0 / hz));
            let body = move || consistent::run(&context, &projector, period, &waiting);
            on_bus.push(spawn("rivetd-consistent", body)?);
        }
        let channels = Channels {
            outbound,
            commands: commands_end,
            reload: incoming,
            snapshots,
            progress: Arc::clone(&progress),
            flight: flight.clone(),
        };
        on_bus.push(spawn("rivetd-loop", move || loop_thread::run(&context, core, &settings, channels))?);
        Ok(Threads { on_bus, keeping, reloading, progress, flight })
    }

    fn one_has_ended(&self) -> bool {
        self.on_bus.iter().any(JoinHandle::is_finished)
    }

    /// Waits for their end, for a limited time: a thread that hangs in the bus library hears nobody, and the process ends
    /// without it, so that a service manager need not kill it.
    fn join(self) {
        let patience = Instant::now() + THREADS_END;
        while self.on_bus.iter().any(|thread| !thread.is_finished()) && Instant::now() < patience {
            std::thread::sleep(Duration::from_millis(2));
        }
        let (ended, hung): (Vec<_>, Vec<_>) = self.on_bus.into_iter().partition(JoinHandle::is_finished);
        if !hung.is_empty() {
            let names: Vec<_> = hung.iter().filter_map(|thread| thread.thread().name()).collect();
            log::warn!("ends without {}, which does not answer", names.join(", "));
        }
        // The store is last: it writes what the others left.
        // A panic would have ended the process.
        ended.into_iter().chain(self.keeping).for_each(|thread| drop(thread.join()));
        // It has nothing that is to be kept, and a file system that hangs may hold it for ever.
        let patience = Instant::now() + RELOAD_ENDS;
        while !self.reloading.is_finished() && Instant::now() < patience {
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

/// Waits until a thread says that it is ready, or the daemon is to end.
fn started(readiness: &mpsc::Receiver<Result<(), StartError>>, shutdown: &Shutdown) -> Result<(), StartError> {
    while !shutdown.is_requested() {
        match readiness.recv_timeout(Duration::from_millis(20)) {
            Ok(ready) => return ready,
            Err(mpsc::RecvTimeoutError::Timeout) => {}
            Err(mpsc::RecvTimeoutError::Disconnected) => {
                return Err(StartError::Thread("a thread of the daemon ended"));
            }
        }
    }
    Ok(())
}

/// What the robot file says of the loop's scheduler.
pub fn scheduling(realtime: &Realtime, sample_period_s: f64) -> Option<Scheduling> {
    match realtime.scheduler {
        Scheduler::Fifo => realtime.priority.map(Scheduling::Fifo),
        Scheduler::Deadline => {
            let period_ns = (sample_period_s * 1e9) as u64;
            let runtime_ns = (realtime.deadline_share * period_ns as f64) as u64;
            Some(Scheduling::Deadline { runtime_ns, period_ns })
        }
    }
}

fn spawn(name: &str, body: impl FnOnce() + Send + 'static) -> Result<JoinHandle<()>, StartError> {
    std::thread::Builder::new().name(name.to_owned()).spawn(body).map_err(StartError::Spawn)
}

/// A thread that is not real-time: whether it goes round.
struct Round {
    name: &'static str,
    patience: Duration,
    seen: u64,
    moved: Instant,
    said: bool,
}

/// The bus thread looks at its queue every millisecond: what stands still for so long hangs.
const BUS_STUCK: Duration = Duration::from_secs(5);

/// One that hangs for so long comes back by a new start only: what the loop makes reaches nobody.
const BUS_DEAD: Duration = Duration::from_secs(30);

/// A disk may take its time.
const STORE_STUCK: Duration = Duration::from_secs(30);

impl Round {
    fn new(name: &'static str, patience: Duration, now: Instant) -> Round {
        Round { name, patience, seen: 0, moved: now, said: false }
    }

    /// For how long it has stood still; said when that is too long, and when it is over.
    fn look(&mut self, turns: u64, now: Instant) -> Duration {
        let still = now.saturating_duration_since(self.moved);
        if turns != self.seen {
            if self.said {
                log::warn!(rivet_event = "goes-on"; "{} goes on after {:.1} s", self.name, still.as_secs_f64());
            }
            (self.seen, self.moved, self.said) = (turns, now, false);
            return Duration::ZERO;
        }
        if !self.said && still > self.patience {
            self.said = true;
            log::error!(rivet_event = "stuck"; "{} has stood still for {:.1} s", self.name, still.as_secs_f64());
        }
        still
    }
}

/// Tells the service manager what is going on; its watchdog is fed only while the real-time loop moves, and not for ever beside
/// a bus thread that hangs.
fn watch(threads: &Threads, shutdown: &Shutdown) {
    let progress = &threads.progress;
    let mut manager = Manager::new();
    let (mut seen, mut moved, mut stuck) = (0, Instant::now(), false);
    let (mut flowing, mut complained, mut polled) = (false, false, false);
    let mut bus = Round::new("rivetd-bus", BUS_STUCK, moved);
    let mut store = threads.keeping.is_some().then(|| Round::new("rivetd-store", STORE_STUCK, moved));
    let mut fed = 0;
    while !shutdown.is_requested() && !threads.one_has_ended() {
        std::thread::sleep(Duration::from_millis(20));
        let now = progress.read();
        if !flowing && now.met {
            flowing = true;
            log::info!(rivet_event = "ready"; "samples are flowing");
            manager.ready();
        }
        if now.polls && !polled {
            polled = true;
            log::warn!(rivet_event = "not-notified"; "{}", rivet_service::NOT_NOTIFIED);
        }
        if now.periods != seen {
            (seen, moved, stuck) = (now.periods, Instant::now(), false);
        } else if !stuck && moved.elapsed() > STUCK {
            stuck = true;
            log::error!(rivet_event = "stuck"; "the real-time loop has stood still for {:.1} s", moved.elapsed().as_secs_f64());
            if let Some(flight) = &threads.flight {
                flight.ask(Reason::Stuck);
            }
        }
        if (now.wrong_period_ns > 0) != complained {
            complained = !complained;
            if complained {
                log::warn!(
                    rivet_event = "wrong-period";
                    "samples come every {:.4} ms by their stamps, which is not sample_period_s: none is used",
                    now.wrong_period_ns as f64 * 1e-6
                );
            } else {
                log::info!(rivet_event = "right-period"; "samples come at the robot file's rate again");
            }
        }
        let (bus_turns, store_turns) = progress.turns();
        if bus.look(bus_turns, Instant::now()) < BUS_DEAD {
            fed = now.periods;
        }
        if let Some(store) = &mut store {
            store.look(store_turns, Instant::now());
        }
        manager.turn(fed, || format!("{} samples, {} lost, epoch {}", now.samples, now.lost, now.epoch));
    }
    manager.stopping();
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thread_that_stands_still_is_told_from_one_that_goes_round() {
        let begin = Instant::now();
        let at = |seconds| begin + Duration::from_secs(seconds);
        let mut round = Round::new("thread", BUS_STUCK, begin);
        assert_eq!(round.look(1, at(1)), Duration::ZERO);
        assert_eq!(round.look(1, at(5)), Duration::from_secs(4));
        assert!(!round.said);
        assert_eq!(round.look(1, at(7)), Duration::from_secs(6));
        assert!(round.said);
        assert!(round.look(1, at(31)) >= BUS_DEAD);
        assert_eq!(round.look(2, at(32)), Duration::ZERO);
        assert!(!round.said);
    }
}
