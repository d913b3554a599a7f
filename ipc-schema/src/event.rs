//! The wake-up event of `joint-state`: wakes the processes that work sample by sample.
//!
//! It has the name of the service (`rivet/<robot>/joint-state`, messaging pattern *event*). A robot controller notifies
//! it after each published joint state, with event id 0. [`SampleWait`] polls for the samples of a robot that does not.

use std::time::Duration;

use iceoryx2::node::Node;
use iceoryx2::port::listener::{Listener as IoxListener, ListenerWaitError};
use iceoryx2::port::notifier::Notifier as IoxNotifier;
use iceoryx2::prelude::{Config, MessagingPattern, ServiceName, ipc};
use iceoryx2::service::Service as _;
use iceoryx2::service::builder::event::{
    EventCreateError as CreateError, EventOpenError as OpenError, EventOpenOrCreateError as OpenOrCreateError,
};
use iceoryx2::service::port_factory::event::PortFactory;

use crate::bus_config::{MAX_NODES, MAX_PUBLISHERS, MAX_SUBSCRIBERS};
use crate::error::{BusError, PortError};
use crate::join::retry;
use crate::service::Service;

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
    retry(config, attempt, passing).map_err(|e| {
        if matches!(&e, OpenOrCreateError::EventOpenError(why) if differs(*why))
            && let Some(found) = settings(config, name)
        {
            let needed = listed(MAX_PUBLISHERS, MAX_SUBSCRIBERS, MAX_NODES);
            return BusError::Settings { service: format!("{name} (event)"), found, needed };
        }
        BusError::Open { service: name.to_string(), role, why: format!("{e:?}") }
    })
}

/// Whether an event service was not opened since it has other settings than the ones asked for.
fn differs(why: OpenError) -> bool {
    matches!(
        why,
        OpenError::DoesNotSupportRequestedAmountOfNotifiers
            | OpenError::DoesNotSupportRequestedAmountOfListeners
            | OpenError::DoesNotSupportRequestedAmountOfNodes
    )
}

/// The settings of an existing event service.
fn settings(config: &Config, name: &ServiceName) -> Option<String> {
    let details = ipc::Service::details(name, config, MessagingPattern::Event).ok()??;
    let it = details.static_details.event();
    Some(listed(it.max_notifiers(), it.max_listeners(), it.max_nodes()))
}

fn listed(notifiers: usize, listeners: usize, nodes: usize) -> String {
    format!("notifiers {notifiers}, listeners {listeners}, nodes {nodes}")
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

    /// Takes the notifications that have arrived, without waiting; whether there were any.
    fn take(&self) -> Result<bool, PortError> {
        match self.port.try_wait(|_| {}) {
            Ok(notifications) => Ok(notifications > 0),
            Err(ListenerWaitError::InterruptSignal) => Ok(false),
            Err(_) => Err(PortError { service: self.service, what: "wait", why: "internal error of the bus" }),
        }
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

/// Samples in a row without a notification after which [`SampleWait`] polls. A sample taken between `send` and `notify`
/// explains one; sixteen are still a small part of a second.
const UNANNOUNCED_SAMPLES: u32 = 16;

/// Waits for joint states: until the robot's notification, or by polling as long as the robot sends none.
#[derive(Debug)]
pub struct SampleWait {
    listener: Listener,
    poll: Duration,
    unannounced: u32,
    notified: bool,
}

impl SampleWait {
    /// Waits on `listener`; `poll` is the time between two looks while the robot does not notify.
    pub fn new(listener: Listener, poll: Duration) -> SampleWait {
        SampleWait { listener, poll, unannounced: 0, notified: false }
    }

    /// Sleeps until notified, at most `timeout`; for the time between two looks while [`polls`](Self::polls).
    ///
    /// # Errors
    /// As [`Listener::wait`].
    pub fn wait(&mut self, timeout: Duration) -> Result<(), PortError> {
        self.notified = false;
        self.notified = if self.polls() {
            // A socket's timeout is rounded up to the kernel's tick (1 to 10 ms), which is longer than a period; a sleep is not.
            std::thread::sleep(timeout.min(self.poll));
            self.listener.take()?
        } else {
            self.listener.wait(timeout)?
        };
        if self.notified {
            self.unannounced = 0;
        }
        Ok(())
    }

    /// Counts a sample; to be called when the last [`wait`](Self::wait) was followed by a sample.
    pub fn received_sample(&mut self) {
        if !self.notified {
            self.unannounced = self.unannounced.saturating_add(1);
        }
    }

    /// Whether samples come without notifications, so that waiting polls.
    pub fn polls(&self) -> bool {
        self.unannounced >= UNANNOUNCED_SAMPLES
    }
}
