//! The thread that owns the ports which allocate, wait or work on files.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use rivet_ipc_schema::{
    BlackboardReader, Bus, BusConfig, BusError, Command, ControllerHealth, Health, JointState, Notifier, Parameters,
    PortError, Publisher, RobotName, Setpoint, Subscriber,
};

use crate::clock::now_ns;
use crate::latest::Giver;

/// Time between two looks at what daemon and controller publish.
const LOOK: Duration = Duration::from_millis(5);

/// Age of the command after which a new blackboard is looked for.
const SEARCH: Duration = Duration::from_millis(100);

/// Joint state of one period, with its setpoint.
pub(crate) type Outgoing = (Option<Setpoint>, JointState);

/// What both threads see.
#[derive(Default)]
pub(crate) struct Shared {
    pub(crate) stop: AtomicBool,
    pub(crate) sent: AtomicU64,
    pub(crate) failed: AtomicU64,
    /// Why something failed last; empty before.
    pub(crate) problem: Mutex<String>,
}

impl Shared {
    fn report(&self, problem: &impl ToString) {
        *self.problem.lock().unwrap_or_else(PoisonError::into_inner) = problem.to_string();
    }
}

/// The ends of the channels on this thread.
pub(crate) struct Channels {
    pub(crate) samples: rtrb::Consumer<Outgoing>,
    /// A reader of each new incarnation of the command's blackboard.
    pub(crate) readers: rtrb::Producer<BlackboardReader<Command>>,
    /// Readers that the cycle has replaced.
    pub(crate) retired: rtrb::Consumer<BlackboardReader<Command>>,
    pub(crate) parameters: Giver<Parameters>,
    pub(crate) health: Giver<Health>,
    pub(crate) controller_health: Giver<ControllerHealth>,
}

/// What a robot controller sends by; a reader has none of it.
struct Output {
    setpoints: Publisher<Setpoint>,
    states: Publisher<JointState>,
    arrival: Notifier,
}

impl Output {
    fn open(bus: &Bus) -> Result<Output, BusError> {
        Ok(Output {
            setpoints: bus.setpoint_publisher()?,
            states: bus.joint_state_publisher()?,
            arrival: bus.joint_state_notifier()?,
        })
    }

    /// The setpoint first: whoever takes in the joint state then holds its setpoint.
    fn send(&self, setpoint: Option<&Setpoint>, state: &JointState) -> Result<(), PortError> {
        if let Some(setpoint) = setpoint {
            self.setpoints.send(setpoint)?;
        }
        self.states.send(state).map(drop)
    }
}

pub(crate) struct Ports {
    output: Option<Output>,
    parameters: Subscriber<Parameters>,
    health: Subscriber<Health>,
    controller_health: Subscriber<ControllerHealth>,
    /// Notices when the command's blackboard is a new one.
    command: BlackboardReader<Command>,
    bus: Bus,
    channels: Channels,
    shared: Arc<Shared>,
}

impl Ports {
    /// Opens the ports of a robot controller, or of a reader, whether the other parties are there or not.
    pub(crate) fn open(
        config: &BusConfig,
        robot: &RobotName,
        publishes: bool,
        channels: Channels,
        shared: Arc<Shared>,
    ) -> Result<Ports, BusError> {
        let bus = Bus::open(config, robot, "librivet")?;
        let mut ports = Ports {
            output: if publishes { Some(Output::open(&bus)?) } else { None },
            parameters: bus.parameters_subscriber()?,
            health: bus.health_subscriber()?,
            controller_health: bus.controller_health_subscriber()?,
            command: bus.command_reader()?,
            bus,
            channels,
            shared,
        };
        if ports.command.is_connected() {
            ports.hand_over_reader()?;
        }
        Ok(ports)
    }

    /// Sends what is queued and receives, until asked to stop; what is queued then is still sent.
    pub(crate) fn run(mut self) {
        let mut looked: Option<Instant> = None;
        loop {
            let stop = self.shared.stop.load(Ordering::Acquire);
            while let Ok((setpoint, state)) = self.channels.samples.pop() {
                self.send(setpoint.as_ref(), &state);
            }
            if stop {
                return;
            }
            match looked.and_then(|looked| LOOK.checked_sub(looked.elapsed())) {
                Some(left) if !left.is_zero() => std::thread::park_timeout(left),
                _ => {
                    looked = Some(Instant::now());
                    self.look();
                }
            }
        }
    }

    fn send(&self, setpoint: Option<&Setpoint>, state: &JointState) {
        let Some(output) = &self.output else { return };
        match output.send(setpoint, state) {
            Ok(()) => self.shared.sent.fetch_add(1, Ordering::Relaxed),
            Err(why) => {
                self.shared.report(&why);
                self.shared.failed.fetch_add(1, Ordering::Relaxed)
            }
        };
        // Also after a failure: a sample that reached one subscriber of two is there.
        if let Err(why) = output.arrival.notify() {
            self.shared.report(&why);
        }
    }

    /// Takes in what the others publish.
    fn look(&mut self) {
        let parameters = self.received(self.parameters.receive_newest());
        self.channels.parameters.give(parameters);
        let health = self.received(self.health.receive_newest());
        self.channels.health.give(health);
        let controller_health = self.received(self.controller_health.receive_newest());
        self.channels.controller_health.give(controller_health);
        while self.channels.retired.pop().is_ok() {}
        match self.command.reopen_if_stale(now_ns(), SEARCH) {
            Ok(false) => {}
            Ok(true) => {
                if let Err(why) = self.hand_over_reader() {
                    self.shared.report(&why);
                }
            }
            Err(why) => self.shared.report(&why),
        }
    }

    fn received<T>(&self, received: Result<Option<T>, PortError>) -> Option<T> {
        received.unwrap_or_else(|why| {
            self.shared.report(&why);
            None
        })
    }

    /// Gives the cycle a reader of the present blackboard.
    fn hand_over_reader(&mut self) -> Result<(), BusError> {
        let reader = self.bus.command_reader()?;
        // A cycle that does not read commands needs no newer one.
        let _ = self.channels.readers.push(reader);
        Ok(())
    }
}
