//! From the bus to the graph: the thread that may wait for readers on the network.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, mpsc};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use rivet_config::Robot;
use rivet_ipc_schema::{
    Bus, BusConfig, BusError, ConsistentParameters, ControllerHealth, Drift, Health, MAX_JOINTS, Parameters, RobotName,
    Subscriber, parameter_flags,
};
use rivet_realtime::{Shutdown, now_ns};

use crate::error::Failure;
use crate::graph::{Graph, GraphError, Output};
use crate::messages::{DiagnosticArray, Float64MultiArray, Header, Text, Time, WrenchStamped, topic_part};
use crate::report::{BridgeState, Report};
use crate::{model, parameters};

/// Time between two looks at the bus.
const TURN: Duration = Duration::from_millis(10);
/// Time between two reports on `/diagnostics`.
const BETWEEN_REPORTS: Duration = Duration::from_secs(1);
/// Least time between two URDFs: it is a long message.
const BETWEEN_URDFS: Duration = Duration::from_secs(5);

/// What the thread of the inputs hands over.
#[derive(Clone, Debug, Default)]
pub(crate) struct Measured {
    /// Positions and stamp of the last joint state \[rad, or m\].
    pub(crate) position: Option<([f64; MAX_JOINTS], Time)>,
    /// What it knows of itself.
    pub(crate) bridge: BridgeState,
}

/// What both threads see.
#[derive(Debug, Default)]
pub(crate) struct Shared {
    measured: Mutex<Measured>,
    pub(crate) parameters: AtomicU64,
    pub(crate) wrenches: AtomicU64,
    pub(crate) urdfs: AtomicU64,
    pub(crate) reports: AtomicU64,
    pub(crate) not_sent: AtomicU64,
    /// How often the graph was joined again.
    pub(crate) rejoined: AtomicU64,
}

impl Shared {
    pub(crate) fn measured(&self) -> MutexGuard<'_, Measured> {
        self.measured.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn sent(&self, counter: &AtomicU64, sent: bool) {
        let counter = if sent { counter } else { &self.not_sent };
        counter.fetch_add(1, Ordering::Relaxed);
    }
}

struct Ports {
    parameters: Subscriber<Parameters>,
    consistent: Subscriber<ConsistentParameters>,
    health: Subscriber<Health>,
    controller: Subscriber<ControllerHealth>,
    drift: Subscriber<Drift>,
    _bus: Bus,
}

impl Ports {
    fn open(bus: Bus) -> Result<Ports, BusError> {
        Ok(Ports {
            parameters: bus.parameters_subscriber()?,
            consistent: bus.consistent_parameters_subscriber()?,
            health: bus.health_subscriber()?,
            controller: bus.controller_health_subscriber()?,
            drift: bus.drift_subscriber()?,
            _bus: bus,
        })
    }
}

/// Topics that are published.
#[derive(Clone, Debug)]
pub(crate) struct Topics {
    pub(crate) parameters: String,
    pub(crate) payload: String,
    pub(crate) description: String,
    pub(crate) diagnostics: String,
}

impl Topics {
    pub(crate) fn new(robot: &str) -> Topics {
        let of_robot = |name: &str| format!("/rivet/{}/{name}", topic_part(robot));
        Topics {
            parameters: of_robot("parameters"),
            payload: of_robot("payload"),
            description: of_robot("robot_description"),
            diagnostics: "/diagnostics".to_owned(),
        }
    }
}

struct Writers {
    parameters: Output<Float64MultiArray>,
    payload: Output<WrenchStamped>,
    description: Output<Text>,
    diagnostics: Output<DiagnosticArray>,
}

impl Writers {
    fn open(graph: &Graph, topics: &Topics) -> Result<Writers, GraphError> {
        Ok(Writers {
            parameters: graph.output(&topics.parameters, false)?,
            payload: graph.output(&topics.payload, false)?,
            description: graph.output(&topics.description, true)?,
            diagnostics: graph.output(&topics.diagnostics, false)?,
        })
    }
}

/// What the outputs need.
pub(crate) struct Start<'a> {
    pub(crate) robot: Arc<Robot>,
    /// Text of the robot file's URDF.
    pub(crate) urdf: String,
    pub(crate) config: &'a BusConfig,
    /// Of the outputs alone: they join again without an interruption of the inputs.
    pub(crate) graph: Graph,
    pub(crate) topics: Topics,
    pub(crate) shared: Arc<Shared>,
}

/// Everything that goes to the graph.
pub(crate) struct Outputs {
    robot: Arc<Robot>,
    names: Vec<String>,
    urdf: String,
    ports: Ports,
    writers: Writers,
    graph: Graph,
    topics: Topics,
    shared: Arc<Shared>,
    latest: Latest,
}

#[derive(Default)]
struct Latest {
    parameters: Option<Parameters>,
    consistent: Option<ConsistentParameters>,
    health: Option<Health>,
    controller: Option<ControllerHealth>,
    drift: Option<Drift>,
    /// The last URDF.
    description: Option<String>,
    /// Time of the last URDF and of the last report.
    urdf: Option<Instant>,
    report: Option<Instant>,
    complained: bool,
}

impl Outputs {
    /// Starts a thread that hands on what comes, once its ports are open. It ends after the shutdown.
    ///
    /// # Errors
    /// The bus's, the graph's, the system's.
    pub(crate) fn start(start: Start<'_>, shutdown: &Shutdown) -> Result<JoinHandle<()>, Failure> {
        let Start { robot, urdf, config, graph, topics, shared } = start;
        let writers = Writers::open(&graph, &topics)?;
        let (report, opened) = mpsc::channel();
        let (config, shutdown) = (config.clone(), shutdown.clone());
        let work = move || {
            let ports = RobotName::new(&robot.config.name)
                .and_then(|name| Bus::open(&config, &name, "rivet-ros2"))
                .and_then(Ports::open);
            match ports {
                Ok(ports) => {
                    let _ = report.send(Ok(()));
                    let names = (0..robot.base.len()).map(|i| robot.base.name(&robot.model, i)).collect();
                    Outputs { robot, names, urdf, ports, graph, topics, writers, shared, latest: Latest::default() }
                        .run(&shutdown);
                }
                Err(why) => {
                    let _ = report.send(Err(why));
                }
            }
        };
        let thread = std::thread::Builder::new().name("outputs".to_owned()).spawn(work)?;
        match opened.recv() {
            Ok(result) => result.map(|()| thread).map_err(Failure::Bus),
            Err(_) => Err(Failure::System(std::io::Error::other("the thread of the outputs panicked"))),
        }
    }

    /// Hands on what comes until shut down.
    fn run(mut self, shutdown: &Shutdown) {
        while !shutdown.is_requested() {
            if let Err(why) = self.turn()
                && !std::mem::replace(&mut self.latest.complained, true)
            {
                rivet_files::note(format_args!("rivet-ros2: {why} (reported once)"));
            }
            std::thread::sleep(TURN);
        }
    }

    /// Joins once more where a participant was lost without a goodbye: it may be back.
    fn rejoin_if_lost(&mut self) -> Result<(), GraphError> {
        if self.graph.has_lost_a_peer() {
            let graph = self.graph.rejoin()?;
            self.writers = Writers::open(&graph, &self.topics)?;
            self.graph = graph;
            self.shared.rejoined.fetch_add(1, Ordering::Relaxed);
            // Who comes later gets the URDF as before.
            if let Some(data) = self.latest.description.clone() {
                self.shared.sent(&self.shared.urdfs, self.writers.description.send(Text { data }));
            }
        }
        Ok(())
    }

    fn turn(&mut self) -> Result<(), Failure> {
        self.rejoin_if_lost()?;
        for _ in 0..self.ports.parameters.capacity() {
            let Some(set) = self.ports.parameters.receive()? else { break };
            // Of another model the names would be wrong.
            if set.model_hash == self.robot.hash {
                let sent = self.writers.parameters.send(parameters::message(&set, &self.names));
                self.shared.sent(&self.shared.parameters, sent);
                self.latest.parameters = Some(set);
            }
        }
        let latest = &mut self.latest;
        latest.health = self.ports.health.receive_newest()?.or(latest.health);
        latest.controller = self.ports.controller.receive_newest()?.or(latest.controller);
        latest.drift = self.ports.drift.receive_newest()?.or(latest.drift);
        if let Some(set) = self.ports.consistent.receive_newest()?
            && set.model_hash == self.robot.hash
            && set.flags & parameter_flags::PROVISIONAL == 0
        {
            self.payload(&set);
            self.latest.consistent = Some(set);
        }
        if self.latest.consistent.is_some() && is_due(self.latest.urdf, BETWEEN_URDFS) {
            self.description();
        }
        if is_due(self.latest.report, BETWEEN_REPORTS) {
            self.report();
        }
        Ok(())
    }

    fn payload(&self, set: &ConsistentParameters) {
        let Some((q, stamp)) = self.shared.measured().position else { return };
        let arm = &self.robot.model.arm;
        let wrench = model::payload(&self.robot, set, &q[..arm.dof()]);
        let header = Header { stamp, frame_id: arm.joints[arm.dof() - 1].link.clone() };
        self.shared.sent(&self.shared.wrenches, self.writers.payload.send(WrenchStamped { header, wrench }));
    }

    fn description(&mut self) {
        let Some(set) = self.latest.consistent.take() else { return };
        match model::consistent_urdf(&self.robot, &self.urdf, &set) {
            Ok(data) => {
                self.latest.description = Some(data.clone());
                self.shared.sent(&self.shared.urdfs, self.writers.description.send(Text { data }));
                self.latest.urdf = Some(Instant::now());
            }
            Err(why) if !self.latest.complained => {
                self.latest.complained = true;
                rivet_files::note(format_args!("rivet-ros2: no consistent URDF: {why} (reported once)"));
            }
            Err(_) => {}
        }
    }

    fn report(&mut self) {
        self.latest.report = Some(Instant::now());
        let mut bridge = self.shared.measured().bridge.clone();
        bridge.not_sent = self.shared.not_sent.load(Ordering::Relaxed);
        let latest = &self.latest;
        let report = Report {
            robot: &self.robot.config.name,
            names: &self.names,
            now_ns: now_ns(),
            health: latest.health.as_ref(),
            controller: latest.controller.as_ref(),
            drift: latest.drift.as_ref(),
            parameters: latest.parameters.as_ref(),
            bridge: &bridge,
        };
        let sent = self.writers.diagnostics.send(report.message(Time::from_ns(wall_ns())));
        self.shared.sent(&self.shared.reports, sent);
    }
}

fn is_due(last: Option<Instant>, between: Duration) -> bool {
    last.is_none_or(|last| last.elapsed() >= between)
}

/// The wall clock, since the epoch \[ns\].
pub(crate) fn wall_ns() -> i64 {
    let since_epoch = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    i64::try_from(since_epoch.as_nanos()).unwrap_or(i64::MAX)
}
