//! The thread that owns what may allocate or wait: the health publisher, the flight record's file, the log.

use crate::error::StartError;
use crate::gate::refusal_text;
use crate::stop_text::stop_text;
use rivet_ipc_schema::{
    Answer, Bus, BusConfig, BusError, BusWatch, ControlCommand, ControlStatus, ControllerHealth, ControllerState,
    ParameterRefusal, ParameterSource, Publisher, RobotName, SourceReason, StateFolder, StopCause,
};
use rivet_realtime::{Hangup, Shutdown};
use rivet_service::{Flight, Manager, Storage};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, mpsc};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// What the loop shows of itself, for the service manager.
#[derive(Debug, Default)]
pub(crate) struct Pulse {
    /// Periods since the start.
    pub(crate) periods: AtomicU64,
    /// Samples answered.
    pub(crate) commands: AtomicU64,
    /// Whether a sample has been answered in time.
    pub(crate) met: AtomicBool,
    /// Whether samples come without the robot's notifications, so that the loop polls.
    pub(crate) polls: AtomicBool,
    /// Somebody asks for the plan to be followed again.
    pub(crate) follow: AtomicBool,
}

/// Refused setpoints are named at most this often.
const NAMED_AGAIN: Duration = Duration::from_secs(5);

/// How often the queue is looked at.
const TURN: Duration = Duration::from_millis(5);

/// Turns between looks at the files of the bus.
const TURNS_PER_LOOK: u32 = 100;

struct Service {
    health: Publisher<ControllerHealth>,
    flight: Option<Arc<Flight>>,
    state_folder: Option<rivet_service::StateFolder>,
    name: RobotName,
    said: Option<(u32, u32, u32)>,
    said_state: Option<ControllerState>,
    /// Stops, setpoints refused, and when those were named last.
    stops: u64,
    refused: (u64, Option<Instant>),
    /// Of which services a second publisher has been named.
    named: [bool; 3],
}

/// Starts the thread; returns once its port is open.
pub(crate) fn start(
    config: &BusConfig,
    name: &RobotName,
    mut inbound: rtrb::Consumer<ControllerHealth>,
    flight: Option<Arc<Flight>>,
    pulse: &Arc<Pulse>,
    hangup: Option<Hangup>,
    shutdown: &Shutdown,
) -> Result<JoinHandle<Result<(), BusError>>, StartError> {
    let (config, name, shutdown, pulse) = (config.clone(), name.clone(), shutdown.clone(), Arc::clone(pulse));
    let (ready, readiness) = mpsc::channel();
    let body = move || {
        let opened = Bus::open(&config, &name, "rivet-controller-service").and_then(|bus| {
            let ports = (bus.controller_health_publisher()?, bus.controller_control_server()?);
            Ok((bus, ports))
        });
        let (bus, (health, mut control)) = match opened {
            Ok(opened) => opened,
            Err(why) => {
                // A receiver that is gone means that start-up failed elsewhere.
                let _ = ready.send(Err(why));
                return Ok(());
            }
        };
        let _ = ready.send(Ok(()));
        let state_folder = flight.as_ref().map(|flight| rivet_service::StateFolder::new(flight.folder()));
        let mut service = Service {
            health,
            flight,
            state_folder,
            name: name.clone(),
            said: None,
            said_state: None,
            stops: 0,
            refused: (0, None),
            named: [false; 3],
        };
        let mut manager = Manager::new();
        let (mut watch, mut turns, mut polled) = (BusWatch::default(), 0_u32, false);
        loop {
            let stopping = shutdown.is_requested();
            while let Ok(message) = inbound.pop() {
                service.take(&message);
            }
            if let Some(flight) = &service.flight {
                flight.serve();
            }
            // A client that has gone is no concern of the controller's.
            let _ = control.serve(0, |command| service.asked(command, &pulse));
            // Late subscribers get the latest health; a failure here is a subscriber's, and will show again.
            let _ = service.health.refresh();
            if hangup.as_ref().is_some_and(Hangup::take) {
                log::warn!("SIGHUP: nothing was changed: the robot file is read at the start");
            }
            if stopping {
                manager.stopping();
                return Ok(());
            }
            turns = turns.wrapping_add(1);
            if turns.is_multiple_of(TURNS_PER_LOOK) {
                let answered = pulse.commands.load(Ordering::Relaxed);
                match watch.look(&config, bus.is_whole(), answered, Instant::now()) {
                    Ok(None) => {}
                    Ok(Some(why)) => {
                        log::error!(rivet_event = "bus-removed"; "{why}; goes on with who is there, until nothing comes any more");
                    }
                    Err(why) => {
                        shutdown.request();
                        manager.stopping();
                        return Err(why);
                    }
                }
            }
            let polls = pulse.polls.load(Ordering::Relaxed);
            if polls && !polled {
                log::warn!(rivet_event = "not-notified"; "{}", rivet_service::NOT_NOTIFIED);
            }
            polled |= polls;
            if pulse.met.load(Ordering::Relaxed) {
                manager.ready();
            }
            manager.turn(pulse.periods.load(Ordering::Relaxed), || {
                format!("{} samples answered", pulse.commands.load(Ordering::Relaxed))
            });
            std::thread::sleep(TURN);
        }
    };
    let thread =
        std::thread::Builder::new().name("rivet-ctl-serv".to_owned()).spawn(body).map_err(StartError::Spawn)?;
    readiness.recv().unwrap_or(Ok(()))?;
    Ok(thread)
}

impl Service {
    fn take(&mut self, health: &ControllerHealth) {
        self.say(health);
        self.say_state(health);
        let state_folder = u32::from(self.state_folder());
        // A subscriber that cannot be reached is not the controller's concern.
        let _ = self.health.send(&ControllerHealth { state_folder, ..*health });
    }

    /// What a request comes to.
    fn asked(&self, command: ControlCommand, pulse: &Pulse) -> Answer {
        let refused = |why: &str| Answer::Now(ControlStatus::Refused, why.to_owned());
        match (command, self.said_state) {
            (ControlCommand::Follow, Some(ControllerState::Stopping | ControllerState::Strayed)) => {
                pulse.follow.store(true, Ordering::Relaxed);
                Answer::Now(
                    ControlStatus::Done,
                    "the plan is followed again once it is within reach of the arm".to_owned(),
                )
            }
            (ControlCommand::Follow, _) => refused("the arm is not stopped"),
            _ => refused("only rivetd does that"),
        }
    }

    /// Journals stops with their cause, changes of state and refused setpoints.
    fn say_state(&mut self, health: &ControllerHealth) {
        let state = ControllerState::try_from(health.state).unwrap_or(ControllerState::Waiting);
        if health.stops > self.stops {
            self.stops = health.stops;
            let why = stop_text(health.stop_cause, health.stop_joints);
            match self.flight.as_ref().map(|flight| flight.write(self.name.as_str())) {
                None => log::error!(rivet_event = "stop"; "stop reaction: {why}; no --state DIR, no flight record"),
                Some(Ok(path)) => {
                    log::error!(rivet_event = "stop"; "stop reaction: {why}; flight record {}", path.display());
                }
                Some(Err(no)) => log::error!(rivet_event = "stop"; "stop reaction: {why}; no flight record: {no}"),
            }
        }
        let before = self.said_state.replace(state);
        if before != Some(state) {
            match state {
                ControllerState::Holding => {
                    log::warn!(rivet_event = "holding"; "holding: no plan within reach; the arm is held where it is");
                }
                ControllerState::Strayed => {
                    log::error!(rivet_event = "strayed"; "strayed: {}", stop_text(health.stop_cause, health.stop_joints));
                }
                ControllerState::Following => log::info!(rivet_event = "following"; "following the plan"),
                ControllerState::WrongPeriod => {
                    let why = stop_text(StopCause::WrongPeriod.into(), 0);
                    log::error!(rivet_event = "wrong-period"; "{why}; the plan is not followed");
                }
                // The cause has been said.
                ControllerState::Stopping | ControllerState::Waiting => {}
            }
        }
        let (counted, named) = self.refused;
        if health.setpoints_refused > counted && named.is_none_or(|at| at.elapsed() >= NAMED_AGAIN) {
            self.refused = (health.setpoints_refused, Some(Instant::now()));
            let why = stop_text(health.plan_refusal, health.plan_joints);
            log::warn!(rivet_event = "plan-refused"; "{} setpoints refused so far; the last: {why}", health.setpoints_refused);
        }
    }

    fn state_folder(&mut self) -> StateFolder {
        match self.state_folder.as_mut().map(|folder| folder.look(Instant::now())) {
            None => StateFolder::None,
            Some(Storage::Writable) => StateFolder::Writable,
            Some(Storage::Full) => StateFolder::Full,
            Some(Storage::Unwritable) => StateFolder::Unwritable,
        }
    }

    fn say(&mut self, health: &ControllerHealth) {
        let foreign = [
            (health.foreign_joint_states, "joint states"),
            (health.foreign_setpoints, "setpoints"),
            (health.foreign_parameters, "parameters"),
        ];
        for ((count, what), named) in foreign.into_iter().zip(&mut self.named) {
            if count > 0 && !*named {
                *named = true;
                log::warn!(rivet_event = "second-publisher"; "a second publisher of {what}: left out while the first one sends");
            }
        }
        let now = (health.source, health.source_reason, health.last_refusal);
        if self.said == Some(now) {
            return;
        }
        let source = match ParameterSource::try_from(health.source) {
            Ok(ParameterSource::Live) => "the daemon's",
            Ok(ParameterSource::LastGood) => "the last good ones",
            _ => "the robot file's",
        };
        let reason = match SourceReason::try_from(health.source_reason) {
            Ok(SourceReason::Start) | Err(_) => "from the start",
            Ok(SourceReason::Stored) => "from the store",
            Ok(SourceReason::Adopted) => "enough of them in a row passed the gate",
            Ok(SourceReason::Silent) => "the daemon is silent",
            Ok(SourceReason::Refused) => "what the daemon publishes does not pass the gate",
            Ok(SourceReason::WorseThanNominal) => "others predicted recent torques worse",
            Ok(SourceReason::BetterThanNominal) => "they predict recent torques better than the robot file's",
            Ok(SourceReason::InertiaNotPositive) => "the inertia matrix of those in use was no arm's at this pose",
        };
        if self.said.map(|(source, reason, _)| (source, reason)) != Some((now.0, now.1)) {
            log::info!(rivet_event = "source"; "parameters in use: {source} ({reason})");
        }
        match ParameterRefusal::try_from(health.last_refusal) {
            Ok(ParameterRefusal::None) | Err(_) => {}
            Ok(why) => log::warn!(rivet_event = "refusal"; "published parameters refused: {}", refusal_text(why)),
        }
        self.said = Some(now);
    }
}
