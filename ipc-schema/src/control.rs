//! The control service: request-response.

use std::time::{Duration, Instant};

use iceoryx2::active_request::ActiveRequest;
use iceoryx2::node::Node;
use iceoryx2::port::client::Client;
use iceoryx2::port::server::Server;
use iceoryx2::prelude::{BackpressureStrategy, Config, ServiceName, ipc};
use iceoryx2::service::builder::request_response::{
    RequestResponseCreateError as CreateError, RequestResponseOpenError as OpenError,
    RequestResponseOpenOrCreateError as OpenOrCreateError,
};
use iceoryx2::service::port_factory::request_response::PortFactory;

use crate::bus_config::{MAX_NODES, MAX_SUBSCRIBERS};
use crate::error::{BusError, PortError};
use crate::join::retry;
use crate::messages::{ControlCommand, ControlReply, ControlRequest, ControlStatus, Message as _};
use crate::service::Service;
use crate::version;

type Factory = PortFactory<ipc::Service, ControlRequest, (), ControlReply, ()>;

/// Opens the service, or creates it with the full limits.
pub(crate) fn open_service(
    node: &Node<ipc::Service>,
    config: &Config,
    name: &ServiceName,
    role: &'static str,
) -> Result<Factory, BusError> {
    let attempt = || {
        node.service_builder(name)
            .request_response::<ControlRequest, ControlReply>()
            .max_servers(1)
            .max_clients(MAX_SUBSCRIBERS)
            .max_nodes(MAX_NODES)
            .open_or_create()
    };
    let passing = |e: &OpenOrCreateError| {
        use OpenOrCreateError::{RequestResponseCreateError as Create, RequestResponseOpenError as Open, SystemInFlux};
        matches!(
            e,
            SystemInFlux
                | Open(
                    OpenError::DoesNotExist
                        | OpenError::HangsInCreation
                        | OpenError::IsMarkedForDestruction
                        | OpenError::ServiceInCorruptedState
                )
                | Create(
                    CreateError::AlreadyExists
                        | CreateError::HangsInCreation
                        | CreateError::IsBeingCreatedByAnotherInstance
                        | CreateError::ServiceInCorruptedState
                )
        )
    };
    retry(config, attempt, passing).map_err(|e| {
        if matches!(e, OpenOrCreateError::RequestResponseOpenError(OpenError::IncompatibleRequestOrResponseType))
            && let Some((request, reply)) = version::control_types(config, name)
        {
            return BusError::Version(if request == ControlRequest::TYPE_NAME {
                version::mismatch::<ControlReply>(name.as_str(), &reply)
            } else {
                version::mismatch::<ControlRequest>(name.as_str(), &request)
            });
        }
        BusError::Open { service: name.to_string(), role, why: format!("{e:?}") }
    })
}

fn failed(what: &'static str, why: &'static str) -> PortError {
    PortError { service: Service::Control, what, why }
}

/// What a daemon says to a request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Answer {
    /// How it ended, and a word about it.
    Now(ControlStatus, String),
    /// That takes a while: [`ControlServer::finish`] says how it ended. Who asks a second time meanwhile is refused.
    Later,
}

type Pending = ActiveRequest<ipc::Service, ControlRequest, (), ControlReply, ()>;

/// Takes control requests and answers them. Not for a real-time thread.
#[derive(Debug)]
pub struct ControlServer {
    /// The request that is answered later; before the port, as it is part of it.
    later: Option<Pending>,
    port: Server<ipc::Service, ControlRequest, (), ControlReply, ()>,
    _factory: Factory,
}

impl ControlServer {
    pub(crate) fn new(factory: Factory, name: &ServiceName) -> Result<Self, BusError> {
        let port = factory
            .server_builder()
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create()
            .map_err(|e| BusError::Open { service: name.to_string(), role: "server", why: format!("{e:?}") })?;
        Ok(Self { later: None, port, _factory: factory })
    }

    /// Answers the oldest request waiting, if any, with what `answer` makes of it and the `epoch` in force. Returns
    /// whether there was one. A command not known to this program is answered without asking.
    pub fn serve(&mut self, epoch: u64, answer: impl FnOnce(ControlCommand) -> Answer) -> Result<bool, PortError> {
        let request = self.port.receive().map_err(|_| failed("receive", "a client could not be connected"))?;
        let Some(request) = request else { return Ok(false) };
        let (status, text) = match ControlCommand::try_from(request.payload().command).map(answer) {
            Ok(Answer::Now(status, text)) => (status, text),
            Ok(Answer::Later) if self.later.is_none() => {
                self.later = Some(request);
                return Ok(true);
            }
            Ok(Answer::Later) => (ControlStatus::Refused, "another request is being worked on".to_owned()),
            Err(_) => (ControlStatus::Unknown, String::new()),
        };
        send(&request, &ControlReply::new(status, epoch, &text))?;
        Ok(true)
    }

    /// Whether a request waits for [`finish`](Self::finish).
    pub fn owes(&self) -> bool {
        self.later.is_some()
    }

    /// Answers the request that was to be answered later, if there is one.
    pub fn finish(&mut self, epoch: u64, status: ControlStatus, text: &str) -> Result<(), PortError> {
        let Some(request) = self.later.take() else { return Ok(()) };
        send(&request, &ControlReply::new(status, epoch, text))
    }
}

fn send(request: &Pending, reply: &ControlReply) -> Result<(), PortError> {
    request.send_copy(*reply).map_err(|_| failed("answer", "the client is gone"))
}

/// Sends control requests. Not for a real-time thread.
#[derive(Debug)]
pub struct ControlClient {
    port: Client<ipc::Service, ControlRequest, (), ControlReply, ()>,
    _factory: Factory,
}

impl ControlClient {
    pub(crate) fn new(factory: Factory, name: &ServiceName) -> Result<Self, BusError> {
        let port = factory
            .client_builder()
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create()
            .map_err(|e| BusError::Open { service: name.to_string(), role: "client", why: format!("{e:?}") })?;
        Ok(Self { port, _factory: factory })
    }

    /// Asks, and waits for the answer at most `timeout`. `None`: no daemon answered.
    pub fn ask(&self, command: ControlCommand, timeout: Duration) -> Result<Option<ControlReply>, PortError> {
        let begin = Instant::now();
        let mut pending = None;
        loop {
            // A daemon that has just started is met by the next sending, not by this one.
            if pending.is_none() {
                let sent = self
                    .port
                    .send_copy(ControlRequest::from(command))
                    .map_err(|_| failed("ask", "the request could not be sent"))?;
                pending = (sent.number_of_server_connections() > 0).then_some(sent);
            }
            if let Some(pending) = &pending
                && let Some(reply) =
                    pending.receive().map_err(|_| failed("ask", "the daemon could not be connected"))?
            {
                return Ok(Some(*reply.payload()));
            }
            if begin.elapsed() >= timeout {
                return Ok(None);
            }
            std::thread::sleep(Duration::from_micros(500));
        }
    }
}
