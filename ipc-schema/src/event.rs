//! The event beside `joint-state`: wakes whoever works sample by sample.

use std::time::Duration;

use iceoryx2::node::Node;
use iceoryx2::port::listener::{Listener as IoxListener, ListenerWaitError};
use iceoryx2::port::notifier::Notifier as IoxNotifier;
use iceoryx2::prelude::{Config, ServiceName, ipc};
use iceoryx2::service::builder::event::{
    EventCreateError as CreateError, EventOpenError as OpenError, EventOpenOrCreateError as OpenOrCreateError,
};
use iceoryx2::service::port_factory::event::PortFactory;

use crate::bus::{MAX_NODES, MAX_PUBLISHERS, MAX_SUBSCRIBERS, retry};
use crate::error::{BusError, PortError};
use crate::name::Service;

/// Opens the event service, or creates it with the full limits.
pub(crate) fn open_service(
    node: &Node<ipc::Service>,
    config: &Config,
    name: &ServiceName,
    role: &'static str,
) -> Result<PortFactory<ipc::Service>, BusError> {
    let attempt = || {
        node.service_builder(name)
            .event()
            .max_notifiers(MAX_PUBLISHERS)
            .max_listeners(MAX_SUBSCRIBERS)
            .max_nodes(MAX_NODES)
            .open_or_create()
    };
    let passing = |e: &OpenOrCreateError| {
        use OpenOrCreateError::{EventCreateError as Create, EventOpenError as Open, SystemInFlux};
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
                        | CreateError::IsBeingCreatedByAnotherInstance
                        | CreateError::ServiceInCorruptedState
                )
        )
    };
    retry(config, attempt, passing).map_err(|e| BusError::Open {
        service: name.to_string(),
        role,
        why: format!("{e:?}"),
    })
}

/// Wakes the listeners of a service. Call after [`send`](crate::Publisher::send); one datagram a listener
/// (about 10 us), nothing when the last one is still unread.
#[derive(Debug)]
pub struct Notifier {
    port: IoxNotifier<ipc::Service>,
    service: Service,
}

impl Notifier {
    pub(crate) fn new(
        factory: &PortFactory<ipc::Service>,
        name: &ServiceName,
        service: Service,
    ) -> Result<Self, BusError> {
        let port = factory.notifier_builder().create().map_err(|e| BusError::Open {
            service: name.to_string(),
            role: "notifier",
            why: format!("{e:?}"),
        })?;
        Ok(Self { port, service })
    }

    /// Wakes all listeners; returns how many there were.
    pub fn notify(&self) -> Result<usize, PortError> {
        self.port.notify().map_err(|_| PortError {
            service: self.service,
            what: "notify",
            why: "a listener could not be reached",
        })
    }
}

/// Sleeps until a [`Notifier`] of the same service wakes it.
#[derive(Debug)]
pub struct Listener {
    port: IoxListener<ipc::Service>,
    service: Service,
}

impl Listener {
    pub(crate) fn new(
        factory: &PortFactory<ipc::Service>,
        name: &ServiceName,
        service: Service,
    ) -> Result<Self, BusError> {
        let port = factory.listener_builder().create().map_err(|e| BusError::Open {
            service: name.to_string(),
            role: "listener",
            why: format!("{e:?}"),
        })?;
        Ok(Self { port, service })
    }

    /// Sleeps until notified, at most `timeout`; true if notified. A notification sent before the call counts;
    /// several are one. A signal ends the sleep early with false.
    pub fn wait(&self, timeout: Duration) -> Result<bool, PortError> {
        // The socket's timeout counts whole microseconds, and none of them is without end.
        let timeout = timeout.max(Duration::from_micros(1));
        match self.port.timed_wait(|_| {}, timeout) {
            Ok(notifications) => Ok(notifications > 0),
            Err(ListenerWaitError::InterruptSignal) => Ok(false),
            Err(_) => Err(PortError { service: self.service, what: "wait", why: "internal error of the bus" }),
        }
    }
}
