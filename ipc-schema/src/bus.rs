//! Opening the bus of one robot and its ports.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use iceoryx2::node::Node;
use iceoryx2::prelude::{
    Config, FileName, LogLevel, NodeBuilder, NodeName, Path, SemanticString, ServiceName, SignalHandlingMode, ipc,
    set_log_level_from_env_or,
};

use crate::blackboard::{BlackboardReader, BlackboardWriter};
use crate::cleanup::{close_to_others, ensure_room, has_files, remove_half_made, remove_half_made_memory};
use crate::control::{self, ControlClient, ControlServer};
use crate::error::BusError;
use crate::event::{self, Listener, Notifier};
use crate::messages::{
    Command, ConsistentParameters, ControllerHealth, Drift, Health, JointState, LinkState, Message, Parameters,
    Setpoint, Stamped, Timing,
};
use crate::name::{RobotName, Service};
use crate::owner::{cannot_join, ensure_own, in_shared_memory};
use crate::pubsub::{self, Publisher, Quality, Subscriber};
use crate::version;

/// Publishers (and notifiers) of a service: one, and one for a network bridge that mirrors it.
pub(crate) const MAX_PUBLISHERS: usize = 2;
/// Subscribers (listeners, readers, clients) of a service.
pub(crate) const MAX_SUBSCRIBERS: usize = 16;
/// The same of what the daemon and the controller publish: anyone may look on.
pub(crate) const MAX_ONLOOKERS: usize = 72;
/// Parties of a service.
pub(crate) const MAX_NODES: usize = 96;

/// How long `send` may stall on a subscriber that it cannot reach (another user's). The default of a second
/// would stop a publisher for as long.
const CREATION_TIMEOUT: Duration = Duration::from_millis(10);

/// Room in shared memory for a party that only listens \[bytes\]: with less no one can join.
pub const LEAST_ROOM: u64 = 1 << 20;

/// How long an opening waits for a service that another process is making or removing.
const OPENING_PATIENCE: Duration = Duration::from_secs(2);

/// Which bus: processes with equal values meet, others do not see each other.
///
/// Always passed on explicitly; neither the working directory nor a configuration file of the user's has a say.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BusConfig {
    /// First part of the name of every file in shared memory; 3 to 32 of `a-z A-Z 0-9 - _`.
    pub prefix: String,
    /// Directory for the bus's own files, absolute; made when absent.
    pub root: PathBuf,
}

impl Default for BusConfig {
    /// Prefix `rivet_`, root `/tmp/rivet`.
    fn default() -> Self {
        Self { prefix: "rivet_".to_owned(), root: PathBuf::from("/tmp/rivet") }
    }
}

impl BusConfig {
    /// Longest root path and prefix together \[bytes\]: the bus adds up to 46 for the path of an event's socket,
    /// and the system allows 107.
    pub const MAX_LEN: usize = 60;

    /// Checks the values.
    ///
    /// # Errors
    /// The rule that one breaks.
    pub fn check(&self) -> Result<(), BusError> {
        let prefix_ok = (3..=32).contains(&self.prefix.len())
            && self.prefix.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'-' || b == b'_');
        if !prefix_ok {
            return Err(BusError::Prefix { prefix: self.prefix.clone() });
        }
        let refuse = |why| Err(BusError::Root { root: self.root.clone(), why });
        match self.root.to_str() {
            None => refuse("it must be valid UTF-8"),
            Some(root) if root.len() + self.prefix.len() > Self::MAX_LEN => {
                refuse("it and the prefix together must have at most 60 characters (the path of a socket is limited)")
            }
            Some(_) if !self.root.is_absolute() => refuse("it must be absolute"),
            Some(_) if self.root.parent().is_none() => refuse("it must not be the root of the file system"),
            Some(_) => Ok(()),
        }
    }

    /// The same as options of rivet's programs.
    pub fn options(&self) -> String {
        format!("--prefix {} --root {}", self.prefix, self.root.display())
    }

    /// What removes the leftovers of this bus, and nothing that is in use.
    pub fn clean_command(&self) -> String {
        format!("rivet doctor --seconds 0 --clean {}", self.options())
    }

    /// The same as the bus library wants it. For tests that put a foreign program onto a bus.
    #[doc(hidden)]
    pub fn iceoryx(&self) -> Result<Config, BusError> {
        self.check()?;
        let mut config = Config::default();
        config.global.prefix =
            FileName::new(self.prefix.as_bytes()).map_err(|_| BusError::Prefix { prefix: self.prefix.clone() })?;
        let root = self.root.to_str().and_then(|root| Path::new(root.as_bytes()).ok());
        let root =
            root.ok_or(BusError::Root { root: self.root.clone(), why: "it has a character paths may not have" })?;
        config.global.set_root_path(&root);
        config.global.creation_timeout = CREATION_TIMEOUT;
        Ok(config)
    }

    /// Joins the bus as `role`.
    pub(crate) fn join(&self, config: &Config, role: &str) -> Result<Node<ipc::Service>, BusError> {
        let name = NodeName::new(role).map_err(|e| cannot_join(self, &e))?;
        ensure_own(self)?;
        remove_half_made_memory(self)?;
        let node = NodeBuilder::new()
            .name(&name)
            .config(config)
            // Otherwise it takes SIGINT and SIGTERM away from the program.
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<ipc::Service>()
            .map_err(|e| cannot_join(self, &e))?;
        close_to_others(self);
        Ok(node)
    }
}

/// Keeps the library to errors. Not warnings: they are dumps of internal state, made whenever a killed process is cleared away.
pub(crate) fn quieten() {
    set_log_level_from_env_or(LogLevel::Error);
}

/// Tries until it works, fails for good, or patience ends. What a process that was killed in the middle of making a service
/// has left half-made would stand in the way for ever: it is removed then, and it is tried once more.
pub(crate) fn retry<R, E>(
    config: &Config,
    mut attempt: impl FnMut() -> Result<R, E>,
    passing: impl Fn(&E) -> bool,
) -> Result<R, E> {
    let mut begin = Instant::now();
    let mut healed = false;
    loop {
        match attempt() {
            Err(e) if passing(&e) => {
                if begin.elapsed() >= OPENING_PATIENCE {
                    if healed {
                        return Err(e);
                    }
                    // Where there is none, another party may have removed it a moment ago and be about to make it anew.
                    remove_half_made(config);
                    (begin, healed) = (Instant::now(), true);
                }
                std::thread::sleep(Duration::from_millis(2));
            }
            result => return result,
        }
    }
}

/// One party on the bus of one robot. Stays on the thread that opened it, as do its ports.
///
/// The order in which the parties come does not matter: whoever is first creates a service, with limits
/// that suit all.
#[derive(Debug)]
pub struct Bus {
    node: Node<ipc::Service>,
    iceoryx: Config,
    config: BusConfig,
    robot: RobotName,
    role: String,
}

impl Bus {
    /// Joins the bus of `robot`. `role` names this party in diagnostics: `rivetd`.
    ///
    /// # Errors
    /// A value that breaks a rule, or the bus cannot be joined.
    pub fn open(config: &BusConfig, robot: &RobotName, role: &str) -> Result<Self, BusError> {
        quieten();
        ensure_room(LEAST_ROOM)?;
        let iceoryx = config.iceoryx()?;
        let node = config.join(&iceoryx, role)?;
        Ok(Self { node, iceoryx, config: config.clone(), robot: robot.clone(), role: role.to_owned() })
    }

    /// The robot.
    pub fn robot(&self) -> &RobotName {
        &self.robot
    }

    /// The values the bus was opened with; another thread or process opens its own with them.
    pub fn config(&self) -> &BusConfig {
        &self.config
    }

    /// Whether the bus still has files where those who come look for them. A party that has opened services has some.
    pub fn is_whole(&self) -> bool {
        has_files(&self.config, &self.iceoryx)
    }

    fn name(&self, service: Service) -> Result<ServiceName, BusError> {
        let name = service.of(&self.robot);
        ServiceName::new(&name).map_err(|e| BusError::Open { service: name, role: "service", why: format!("{e:?}") })
    }

    fn publisher<T: Message>(&self, service: Service) -> Result<Publisher<T>, BusError> {
        let name = self.name(service)?;
        let opened = pubsub::open_service(&self.node, &self.iceoryx, &name, service, "publisher");
        let factory = opened.map_err(|why| self.explained(why))?;
        Publisher::new(factory, service).map_err(|why| self.explained(why))
    }

    /// An opening that failed, with what of another user's may be in the way.
    fn explained(&self, why: BusError) -> BusError {
        let BusError::Open { service, role, why } = why else { return why };
        let theirs = in_shared_memory(&self.config).map_or_else(String::new, |theirs| format!(" ({theirs})"));
        BusError::Open { service, role, why: format!("{why}{theirs}") }
    }

    fn subscriber<T: Message>(&self, service: Service) -> Result<Subscriber<T>, BusError> {
        let name = self.name(service)?;
        let opened = pubsub::open_service(&self.node, &self.iceoryx, &name, service, "subscriber");
        let factory = opened.map_err(|why| self.explained(why))?;
        Subscriber::new(factory, service, Quality::of(service).buffer).map_err(|why| self.explained(why))
    }

    fn writer<T: Stamped>(&self, service: Service) -> Result<BlackboardWriter<T>, BusError> {
        let name = self.name(service)?;
        BlackboardWriter::open(&self.config, &self.iceoryx, &name, &self.robot, service, &self.role)
            .map_err(|why| self.explained(why))
    }

    fn reader<T: Stamped>(&self, service: Service) -> Result<BlackboardReader<T>, BusError> {
        BlackboardReader::open(&self.config, &self.iceoryx, &self.name(service)?, &self.role)
            .map_err(|why| self.explained(why))
    }

    /// Whether what a daemon reads is spoken in this program's versions, as far as it is there. Opens nothing, so that it can be
    /// asked again and again beside others who work.
    ///
    /// # Errors
    /// [`BusError::Version`] of the first that is not.
    pub fn ensure_versions(&self) -> Result<(), BusError> {
        self.ensure_version::<JointState>(Service::JointState)?;
        self.ensure_version::<Setpoint>(Service::Setpoint)?;
        self.ensure_version::<LinkState>(Service::LinkState)
    }

    fn ensure_version<T: Message>(&self, service: Service) -> Result<(), BusError> {
        let name = self.name(service)?;
        match version::pubsub_type(&self.iceoryx, &name) {
            Some(carried) if carried != T::TYPE_NAME => {
                Err(BusError::Version(version::mismatch::<T>(name.as_str(), &carried)))
            }
            _ => Ok(()),
        }
    }

    /// Robot controller: publishes its state each period.
    pub fn joint_state_publisher(&self) -> Result<Publisher<JointState>, BusError> {
        self.publisher(Service::JointState)
    }

    /// Receives the arm's state; the ring holds 1024 samples.
    pub fn joint_state_subscriber(&self) -> Result<Subscriber<JointState>, BusError> {
        self.subscriber(Service::JointState)
    }

    /// Robot controller: wakes who waits for a joint state.
    pub fn joint_state_notifier(&self) -> Result<Notifier, BusError> {
        let name = self.name(Service::JointState)?;
        event::open_service(&self.node, &self.iceoryx, &name, "notifier")
            .and_then(|factory| Notifier::new(&factory, &name, Service::JointState))
            .map_err(|why| self.explained(why))
    }

    /// Sleeps until a joint state has come.
    pub fn joint_state_listener(&self) -> Result<Listener, BusError> {
        let name = self.name(Service::JointState)?;
        event::open_service(&self.node, &self.iceoryx, &name, "listener")
            .and_then(|factory| Listener::new(&factory, &name, Service::JointState))
            .map_err(|why| self.explained(why))
    }

    /// Planner: publishes the plan of each period, before the joint state of that period.
    pub fn setpoint_publisher(&self) -> Result<Publisher<Setpoint>, BusError> {
        self.publisher(Service::Setpoint)
    }

    /// Receives the plan; the ring holds 1024 samples.
    pub fn setpoint_subscriber(&self) -> Result<Subscriber<Setpoint>, BusError> {
        self.subscriber(Service::Setpoint)
    }

    /// Robot controller: publishes what second encoders see, before the joint state of that period.
    pub fn link_state_publisher(&self) -> Result<Publisher<LinkState>, BusError> {
        self.publisher(Service::LinkState)
    }

    /// Receives what second encoders see; the ring holds 1024 samples.
    pub fn link_state_subscriber(&self) -> Result<Subscriber<LinkState>, BusError> {
        self.subscriber(Service::LinkState)
    }

    /// Daemon: publishes the parameters. Call [`Publisher::refresh`] often: it hands the latest to late subscribers.
    pub fn parameters_publisher(&self) -> Result<Publisher<Parameters>, BusError> {
        self.publisher(Service::Parameters)
    }

    /// Receives the parameters, the latest at once; the ring holds 64.
    pub fn parameters_subscriber(&self) -> Result<Subscriber<Parameters>, BusError> {
        self.subscriber(Service::Parameters)
    }

    /// Daemon: the latest parameters on the blackboard. One writer a robot; it is refused while another lives.
    pub fn latest_parameters_writer(&self) -> Result<BlackboardWriter<Parameters>, BusError> {
        self.writer(Service::Parameters)
    }

    /// Reads the latest parameters from the blackboard.
    pub fn latest_parameters_reader(&self) -> Result<BlackboardReader<Parameters>, BusError> {
        self.reader(Service::Parameters)
    }

    /// Daemon: publishes physically consistent parameters.
    pub fn consistent_parameters_publisher(&self) -> Result<Publisher<ConsistentParameters>, BusError> {
        self.publisher(Service::ParametersConsistent)
    }

    /// Receives physically consistent parameters, the latest at once; the ring holds 16.
    pub fn consistent_parameters_subscriber(&self) -> Result<Subscriber<ConsistentParameters>, BusError> {
        self.subscriber(Service::ParametersConsistent)
    }

    /// Daemon: publishes its health.
    pub fn health_publisher(&self) -> Result<Publisher<Health>, BusError> {
        self.publisher(Service::Health)
    }

    /// Receives the daemon's health, the latest at once; the ring holds 16.
    pub fn health_subscriber(&self) -> Result<Subscriber<Health>, BusError> {
        self.subscriber(Service::Health)
    }

    /// Daemon: publishes where its real-time thread spends its time.
    pub fn timing_publisher(&self) -> Result<Publisher<Timing>, BusError> {
        self.publisher(Service::Timing)
    }

    /// Receives where the daemon's real-time thread spends its time, the latest at once; the ring holds 16.
    pub fn timing_subscriber(&self) -> Result<Subscriber<Timing>, BusError> {
        self.subscriber(Service::Timing)
    }

    /// Daemon: publishes whether the arm has left the accepted model.
    pub fn drift_publisher(&self) -> Result<Publisher<Drift>, BusError> {
        self.publisher(Service::Drift)
    }

    /// Receives whether the arm has left the accepted model, the latest at once; the ring holds 16.
    pub fn drift_subscriber(&self) -> Result<Subscriber<Drift>, BusError> {
        self.subscriber(Service::Drift)
    }

    /// Controller: publishes its health.
    pub fn controller_health_publisher(&self) -> Result<Publisher<ControllerHealth>, BusError> {
        self.publisher(Service::ControllerHealth)
    }

    /// Receives the controller's health, the latest at once; the ring holds 16.
    pub fn controller_health_subscriber(&self) -> Result<Subscriber<ControllerHealth>, BusError> {
        self.subscriber(Service::ControllerHealth)
    }

    /// Controller: the torque it asks for. One writer a robot; it is refused while another lives.
    pub fn command_writer(&self) -> Result<BlackboardWriter<Command>, BusError> {
        self.writer(Service::Command)
    }

    /// Robot controller: reads the torque that is asked for.
    pub fn command_reader(&self) -> Result<BlackboardReader<Command>, BusError> {
        self.reader(Service::Command)
    }

    /// Daemon: answers control requests.
    pub fn control_server(&self) -> Result<ControlServer, BusError> {
        self.server(Service::Control)
    }

    /// Controller: answers control requests.
    pub fn controller_control_server(&self) -> Result<ControlServer, BusError> {
        self.server(Service::ControllerControl)
    }

    fn server(&self, service: Service) -> Result<ControlServer, BusError> {
        let name = self.name(service)?;
        control::open_service(&self.node, &self.iceoryx, &name, "server")
            .and_then(|factory| ControlServer::new(factory, &name))
            .map_err(|why| self.explained(why))
    }

    /// Asks the daemon for something.
    pub fn control_client(&self) -> Result<ControlClient, BusError> {
        self.client(Service::Control)
    }

    /// Asks the controller for something.
    pub fn controller_control_client(&self) -> Result<ControlClient, BusError> {
        self.client(Service::ControllerControl)
    }

    fn client(&self, service: Service) -> Result<ControlClient, BusError> {
        let name = self.name(service)?;
        control::open_service(&self.node, &self.iceoryx, &name, "client")
            .and_then(|factory| ControlClient::new(factory, &name))
            .map_err(|why| self.explained(why))
    }
}
