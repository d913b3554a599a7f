//! The thread that owns every port that may allocate or wait.

use crate::consistent::Waiting;
use crate::context::ThreadContext;
use crate::keeper::Latest;
use crate::outbound::Outbound;
use crate::progress::Progress;
use crate::reload::Outcome;
use crate::said::{Complaint, Said};
use rivet_ipc_schema::{
    Answer, Bus, BusError, BusWatch, ControlCommand, ControlStatus, Drift, Health, Parameters, Timing,
};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender};
use std::time::{Duration, Instant};

/// How often the queue is looked at; parameters change over seconds, so a millisecond costs nothing.
const TURN: Duration = Duration::from_millis(1);

/// Turns between looks for subscribers that joined: a late one has the latest parameters within this many milliseconds.
const TURNS_PER_REFRESH: u32 = 5;

/// Requests that are answered between two looks at the queue.
const REQUESTS_PER_TURN: usize = 8;

/// Turns between looks at the room that is left in shared memory.
const TURNS_PER_ROOM: u32 = 500;

struct Ports {
    parameters: rivet_ipc_schema::Publisher<Parameters>,
    latest: rivet_ipc_schema::BlackboardWriter<Parameters>,
    health: rivet_ipc_schema::Publisher<Health>,
    drift: rivet_ipc_schema::Publisher<Drift>,
    timing: rivet_ipc_schema::Publisher<Timing>,
    control: rivet_ipc_schema::ControlServer,
}

fn open(bus: &Bus) -> Result<Ports, BusError> {
    Ok(Ports {
        parameters: bus.parameters_publisher()?,
        latest: bus.latest_parameters_writer()?,
        health: bus.health_publisher()?,
        drift: bus.drift_publisher()?,
        timing: bus.timing_publisher()?,
        control: bus.control_server()?,
    })
}

/// What the bus thread shares with the others.
pub(crate) struct Links {
    /// From the loop.
    pub(crate) outbound: rtrb::Consumer<Outbound>,
    pub(crate) requests: Requests,
    /// To the store, where there is one.
    pub(crate) kept: Option<Arc<Latest>>,
    /// To the thread of consistent parameters.
    pub(crate) waiting: Arc<Waiting>,
    pub(crate) progress: Arc<Progress>,
}

/// Publishes until shut down, then what is left in the queue.
pub(crate) fn run(context: &ThreadContext, links: Links) {
    let opened = Bus::open(&context.bus, &context.name, "rivetd-bus");
    let (bus, ports) = match opened.and_then(|bus| open(&bus).map(|ports| (bus, ports))) {
        Ok(opened) => {
            context.report_ready();
            opened
        }
        Err(why) => {
            context.report_failure(why);
            return;
        }
    };
    let progress = Arc::clone(&links.progress);
    let mut publisher = Publisher { ports, links, said: Said::default() };
    let mut turns = 0_u32;
    let mut complaint = Complaint::default();
    let mut watch = BusWatch::default();
    loop {
        progress.bus_turned();
        let stopping = context.shutdown.is_requested();
        let refresh = turns.is_multiple_of(TURNS_PER_REFRESH);
        if let Err(why) = publisher.turn(refresh) {
            complaint.say(&why.to_string());
        }
        if turns.is_multiple_of(TURNS_PER_ROOM) {
            look_for_room(&progress);
            match watch.look(&context.bus, bus.is_whole(), progress.read().samples, Instant::now()) {
                Ok(Some(why)) => {
                    log::error!(rivet_event = "bus-removed"; "{why}; goes on with who is there, until nothing comes any more");
                }
                Err(why) if !stopping => {
                    context.report_failure(why);
                    return;
                }
                Ok(None) | Err(_) => {}
            }
        }
        if stopping {
            return;
        }
        turns = turns.wrapping_add(1);
        std::thread::sleep(TURN);
    }
}

/// What is there goes on where shared memory is full; who comes cannot join, and whoever is on call should know.
fn look_for_room(progress: &Progress) {
    // Where it is just full, every service that comes and goes would be news.
    let needed = if progress.no_room() { 2 * rivet_ipc_schema::LEAST_ROOM } else { rivet_ipc_schema::LEAST_ROOM };
    let full = match rivet_ipc_schema::ensure_room(needed) {
        Err(why @ BusError::SharedMemoryFull { .. }) => {
            if !progress.no_room() {
                log::error!(rivet_event = "shared-memory-full"; "{why}; samples are taken as before, but no one can join");
            }
            true
        }
        Ok(()) | Err(_) => false,
    };
    if progress.no_room() && !full {
        log::info!(rivet_event = "shared-memory-room"; "/dev/shm has room again");
    }
    progress.set_no_room(full);
}

/// The ports, and what goes through them.
struct Publisher {
    ports: Ports,
    links: Links,
    said: Said,
}

impl Publisher {
    /// Sends what the loop has queued and serves some requests; `refresh`: looks for subscribers that joined.
    fn turn(&mut self, refresh: bool) -> Result<(), rivet_ipc_schema::PortError> {
        let Publisher { ports, links: Links { outbound, requests, kept, waiting, progress }, said } = self;
        let kept = kept.as_deref();
        while let Ok(message) = outbound.pop() {
            match message {
                Outbound::Parameters(parameters) => {
                    if let Some(kept) = kept {
                        kept.offer(&parameters);
                    }
                    ports.latest.write(&parameters);
                    waiting.put(&parameters);
                    ports.parameters.send(&parameters)?;
                }
                Outbound::Health(mut health) => {
                    health.state_folder = progress.state_folder();
                    said.take(&health, Instant::now());
                    ports.health.send(&health)?;
                }
                Outbound::Drift(drift) => {
                    ports.drift.send(&drift)?;
                }
                Outbound::Timing(timing) => {
                    ports.timing.send(&timing)?;
                }
            }
        }
        if refresh {
            ports.parameters.refresh()?;
            ports.health.refresh()?;
            ports.timing.refresh()?;
            ports.drift.refresh()?;
        }
        let epoch = progress.read().epoch;
        if let Ok((status, text)) = requests.outcomes.try_recv() {
            ports.control.finish(epoch, status, &text)?;
        }
        // Bounded: who floods the service with requests keeps nobody from parameters.
        for _ in 0..REQUESTS_PER_TURN {
            let owes = ports.control.owes();
            if !ports.control.serve(epoch, |command| requests.hand_over(kept, command, owes))? {
                break;
            }
        }
        Ok(())
    }
}

/// Where requests of the control service go.
pub(crate) struct Requests {
    /// To the loop.
    pub(crate) commands: rtrb::Producer<ControlCommand>,
    /// To the thread that reads the robot file; how that ended, or what was asked of the store.
    pub(crate) reloads: Sender<()>,
    pub(crate) outcomes: Receiver<Outcome>,
}

impl Requests {
    /// The loop executes a request at its next period; the reply says that it is on its way.
    fn hand_over(&mut self, kept: Option<&Latest>, command: ControlCommand, owes: bool) -> Answer {
        let refused = |why: &str| Answer::Now(ControlStatus::Refused, why.to_owned());
        let done = || Answer::Now(ControlStatus::Done, String::new());
        match (command, kept) {
            // Who works on a request for another thread answers for itself: `Later` refuses a second one.
            (ControlCommand::Save | ControlCommand::Reload, _) | (ControlCommand::Reset, Some(_)) if owes => {
                Answer::Later
            }
            (ControlCommand::Save, Some(kept)) if kept.save_now() => Answer::Later,
            (ControlCommand::Save, Some(_)) => refused("there is nothing new that is worth storing"),
            (ControlCommand::Save, None) => refused("rivetd runs without --state: nothing is stored"),
            (ControlCommand::Follow, _) => refused("only rivet-controller follows a plan"),
            (ControlCommand::Load, _) => refused("what is stored is taken up at the start only"),
            (ControlCommand::Reload, _) => match self.reloads.send(()) {
                Ok(()) => Answer::Later,
                Err(_) => refused("rivetd is on its way out"),
            },
            (ControlCommand::Freeze | ControlCommand::Resume | ControlCommand::Reset, _) => {
                if self.commands.push(command).is_err() {
                    return Answer::Now(ControlStatus::Failed, "too many requests at once".to_owned());
                }
                match (command, kept) {
                    (ControlCommand::Reset, Some(kept)) => {
                        kept.forget();
                        Answer::Later
                    }
                    _ => done(),
                }
            }
        }
    }
}
