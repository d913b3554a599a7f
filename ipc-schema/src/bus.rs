//! Opening the bus of one robot and its ports.

use iceoryx2::node::Node;
use iceoryx2::prelude::{Config, ServiceName, ipc};

use crate::blackboard::{BlackboardReader, BlackboardWriter};
use crate::bus_config::{BusConfig, quieten};
use crate::cleanup::{ensure_room, has_files};
use crate::control::{self, ControlClient, ControlServer};
use crate::error::BusError;
use crate::event::{self, Listener, Notifier};
use crate::messages::{
    Command, ConsistentParameters, ControllerHealth, Drift, Health, JointState, LinkState, Message, Parameters,
    Setpoint, Stamped, Timing,
};
use crate::name::RobotName;
use crate::owner::in_shared_memory;
use crate::pubsub::{self, Publisher, Quality, Subscriber};
use crate::service::Service;
use crate::version;

/// Room in shared memory for a party that only listens \[bytes\]: with less no one can join.
pub const LEAST_ROOM: u64 = 1 << 20;

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
        let name = self.robot.service_name(service);
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
