//! Publish-subscribe ports.

use iceoryx2::node::Node;
use iceoryx2::port::publisher::Publisher as IoxPublisher;
use iceoryx2::port::subscriber::Subscriber as IoxSubscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::port::{ReceiveError, SendError};
use iceoryx2::prelude::{BackpressureStrategy, Config, MessagingPattern, ServiceName, ipc};
use iceoryx2::service::Service as _;
use iceoryx2::service::builder::publish_subscribe::{
    PublishSubscribeCreateError as CreateError, PublishSubscribeOpenError as OpenError,
    PublishSubscribeOpenOrCreateError as OpenOrCreateError,
};
use iceoryx2::service::port_factory::PortFactory as _;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;

use crate::bus_config::{MAX_NODES, MAX_ONLOOKERS, MAX_PUBLISHERS, MAX_SUBSCRIBERS};
use crate::error::{BusError, PortError};
use crate::join::retry;
use crate::messages::Message;
use crate::service::Service;
use crate::version;

/// How a service is made by whoever comes first; all sides ask for the same.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Quality {
    /// Samples a late subscriber gets at once.
    pub(crate) history: usize,
    /// Samples a subscriber may fall behind before the oldest are overwritten.
    pub(crate) buffer: usize,
    /// Most subscribers; shared memory is set aside for the buffers of all.
    pub(crate) subscribers: usize,
}

impl Quality {
    /// The service's quality, stated once.
    pub(crate) fn of(service: Service) -> Self {
        match service {
            // A second of 1 kHz samples: the daemon must not lose any while it catches up.
            Service::JointState | Service::Setpoint | Service::LinkState => {
                Self { history: 0, buffer: 1024, subscribers: MAX_SUBSCRIBERS }
            }
            Service::Parameters => Self { history: 1, buffer: 64, subscribers: MAX_ONLOOKERS },
            // A late monitor has something to show before the next report.
            _ => Self { history: 1, buffer: 16, subscribers: MAX_ONLOOKERS },
        }
    }
}

impl Quality {
    /// The settings that all parties ask for, as words for an error.
    fn needed(self) -> String {
        self.listed(MAX_PUBLISHERS, MAX_NODES, MAX_BORROWED, true)
    }

    fn listed(self, publishers: usize, nodes: usize, borrowed: usize, overflow: bool) -> String {
        let Self { history, buffer, subscribers } = self;
        let overflow = if overflow { "on" } else { "off" };
        format!(
            "publishers {publishers}, subscribers {subscribers}, nodes {nodes}, history {history}, subscriber buffer {buffer}, \
             borrowed samples {borrowed}, safe overflow {overflow}"
        )
    }
}

/// Samples that a subscriber may hold at a time.
const MAX_BORROWED: usize = 2;

type Factory<T> = PortFactory<ipc::Service, T, ()>;

/// Opens the service, or creates it with the full limits.
pub(crate) fn open_service<T: Message>(
    node: &Node<ipc::Service>,
    config: &Config,
    name: &ServiceName,
    service: Service,
    role: &'static str,
) -> Result<Factory<T>, BusError> {
    let quality = Quality::of(service);
    let attempt = || {
        node.service_builder(name)
            .publish_subscribe::<T>()
            .max_publishers(MAX_PUBLISHERS)
            .max_subscribers(quality.subscribers)
            .max_nodes(MAX_NODES)
            .history_size(quality.history)
            .subscriber_max_buffer_size(quality.buffer)
            .subscriber_max_borrowed_samples(MAX_BORROWED)
            .enable_safe_overflow(true)
            .open_or_create()
    };
    // Two processes may create or leave at the same moment; the loser sees a service in the making.
    let passing = |e: &OpenOrCreateError| {
        use OpenOrCreateError::{
            PublishSubscribeCreateError as Create, PublishSubscribeOpenError as Open, SystemInFlux,
        };
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
        if matches!(e, OpenOrCreateError::PublishSubscribeOpenError(OpenError::IncompatibleTypes))
            && let Some(carried) = version::pubsub_type(config, name)
        {
            return BusError::Version(version::mismatch::<T>(name.as_str(), &carried));
        }
        if matches!(&e, OpenOrCreateError::PublishSubscribeOpenError(why) if differs(*why))
            && let Some(found) = settings(config, name)
        {
            return BusError::Settings { service: name.to_string(), found, needed: quality.needed() };
        }
        BusError::Open { service: name.to_string(), role, why: format!("{e:?}") }
    })
}

/// Whether a service was not opened since it has other settings than the ones asked for.
fn differs(why: OpenError) -> bool {
    matches!(
        why,
        OpenError::DoesNotSupportRequestedMinBufferSize
            | OpenError::DoesNotSupportRequestedMinHistorySize
            | OpenError::DoesNotSupportRequestedMinSubscriberBorrowedSamples
            | OpenError::DoesNotSupportRequestedAmountOfPublishers
            | OpenError::DoesNotSupportRequestedAmountOfSubscribers
            | OpenError::DoesNotSupportRequestedAmountOfNodes
            | OpenError::IncompatibleOverflowBehavior
    )
}

/// The settings of an existing service, as [`Quality::needed`] states them.
fn settings(config: &Config, name: &ServiceName) -> Option<String> {
    let details = ipc::Service::details(name, config, MessagingPattern::PublishSubscribe).ok()??;
    let it = details.static_details.publish_subscribe();
    let found = Quality {
        history: it.history_size(),
        buffer: it.subscriber_max_buffer_size(),
        subscribers: it.max_subscribers(),
    };
    let borrowed = it.subscriber_max_borrowed_samples();
    Some(found.listed(it.max_publishers(), it.max_nodes(), borrowed, it.has_safe_overflow()))
}

/// Sends messages of one service. Not for a real-time thread: [`send`](Self::send) allocates and, when a
/// subscriber joins or leaves, works on files.
///
/// Keep it until its messages were taken: a subscriber meets a publisher at its first
/// [`receive`](Subscriber::receive) after the publisher came, and a publisher that left before that takes its
/// messages along.
#[derive(Debug)]
pub struct Publisher<T: Message> {
    port: IoxPublisher<ipc::Service, T, ()>,
    factory: Factory<T>,
    service: Service,
}

impl<T: Message> Publisher<T> {
    pub(crate) fn new(factory: Factory<T>, service: Service) -> Result<Self, BusError> {
        let port = factory
            .publisher_builder()
            .max_loaned_samples(1)
            // The default waits for a stuck subscriber for ever, should a foreign creator have turned overflow off.
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create()
            .map_err(|e| BusError::Open {
                service: factory.name().to_string(),
                role: "publisher",
                why: format!("{e:?}"),
            })?;
        Ok(Self { port, factory, service })
    }

    /// Sends a message; returns how many subscribers got it.
    pub fn send(&self, message: &T) -> Result<usize, PortError> {
        self.port.send_copy(*message).map_err(|e| PortError {
            service: self.service,
            what: "send",
            why: match e {
                SendError::ConnectionBrokenSinceSenderNoLongerExists => "this publisher was removed by another process",
                SendError::ConnectionCorrupted => "the connection to a subscriber is corrupted",
                SendError::LoanError(_) => "no memory for the message",
                SendError::ConnectionError(_) => "a subscriber could not be connected (another user's?)",
                SendError::UnableToDeliver => "a subscriber did not take the message",
                SendError::InternalError => "internal error of the bus",
            },
        })
    }

    /// Meets subscribers that joined since the last [`send`](Self::send) and gives them the history. Call it
    /// every few milliseconds where messages are rare and late subscribers must not wait for the next one.
    pub fn refresh(&self) -> Result<(), PortError> {
        self.port.update_connections().map_err(|_| PortError {
            service: self.service,
            what: "refresh",
            why: "a subscriber could not be connected (another user's?)",
        })
    }

    /// How many subscribers are there at present.
    pub fn subscribers(&self) -> usize {
        self.factory.dynamic_config().number_of_subscribers()
    }
}

/// Receives messages of one service, in order, from a ring that overwrites the oldest when full.
#[derive(Debug)]
pub struct Subscriber<T: Message> {
    port: IoxSubscriber<ipc::Service, T, ()>,
    factory: Factory<T>,
    service: Service,
}

impl<T: Message> Subscriber<T> {
    pub(crate) fn new(factory: Factory<T>, service: Service, buffer: usize) -> Result<Self, BusError> {
        let port = factory.subscriber_builder().buffer_size(buffer).create().map_err(|e| BusError::Open {
            service: factory.name().to_string(),
            role: "subscriber",
            why: format!("{e:?}"),
        })?;
        Ok(Self { port, factory, service })
    }

    /// The oldest message not yet received, copied out.
    ///
    /// Real-time safe: no allocation and no system call while the set of publishers stays as it is.
    pub fn receive(&self) -> Result<Option<T>, PortError> {
        self.receive_with(|message| *message)
    }

    /// [`receive`](Self::receive), and the number of the publisher that sent it.
    pub fn receive_from(&self) -> Result<Option<(T, u128)>, PortError> {
        match self.port.receive() {
            Ok(sample) => Ok(sample.map(|sample| (*sample.payload(), sample.header().publisher_id().value()))),
            Err(e) => Err(self.not_received(e)),
        }
    }

    /// [`receive`](Self::receive) without the copy: `look` sees the message in shared memory.
    pub fn receive_with<R>(&self, look: impl FnOnce(&T) -> R) -> Result<Option<R>, PortError> {
        match self.port.receive() {
            Ok(sample) => Ok(sample.map(|sample| look(sample.payload()))),
            Err(e) => Err(self.not_received(e)),
        }
    }

    fn not_received(&self, why: ReceiveError) -> PortError {
        let why = match why {
            ReceiveError::ExceedsMaxBorrows => "too many messages are borrowed",
            ReceiveError::ConnectionFailure(_) => "a publisher could not be connected (another user's?)",
        };
        PortError { service: self.service, what: "receive", why }
    }

    /// The newest message, all older ones dropped; `None` when nothing new has come.
    ///
    /// Real-time safe as [`receive`](Self::receive); bounded by the size of the ring.
    pub fn receive_newest(&self) -> Result<Option<T>, PortError> {
        let mut newest = None;
        for _ in 0..self.port.buffer_size() {
            match self.receive()? {
                Some(message) => newest = Some(message),
                None => break,
            }
        }
        Ok(newest)
    }

    /// How many messages the ring holds before the oldest is overwritten.
    pub fn capacity(&self) -> usize {
        self.port.buffer_size()
    }

    /// How many publishers are there at present.
    pub fn publishers(&self) -> usize {
        self.factory.dynamic_config().number_of_publishers()
    }
}
