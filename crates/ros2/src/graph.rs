//! The graph of ROS 2: a DDS participant, with readers and writers of its topics.

use std::collections::HashSet;
use std::net::IpAddr;

use rustdds::no_key::{DataReader, DataWriter};
use rustdds::policy::{Durability, History, Reliability};
use rustdds::{
    CDRDeserializerAdapter, CDRSerializerAdapter, DataReaderStatus, DomainParticipant, DomainParticipantBuilder,
    DomainParticipantStatusEvent, DomainParticipantStatusListener, LostReason, Publisher, QosPolicies,
    QosPolicyBuilder, ReadCondition, StatusEvented as _, Subscriber, Topic, TopicKind, mio1,
};
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::intake::Arrived;
use crate::messages::{RosMessage, dds_topic};
use crate::source::Guid;

/// Messages of a topic that a reader keeps until they are taken: more than a second at the highest rate.
const DEPTH: i32 = 4096;
/// Messages of a topic that a writer keeps until every reader has them.
const SENT_DEPTH: i32 = 256;
/// How long a write may wait for readers that do not keep up \[ms\]. Only the thread of the outputs waits.
const PATIENCE_MS: i64 = 20;
/// Errors of a reader in a row after which the rest waits for the next turn.
const ERRORS: usize = 16;

/// Why a part of the graph could not be made.
#[derive(Debug, thiserror::Error)]
pub enum GraphError {
    /// A topic breaks a rule of ROS.
    #[error("{0}")]
    Topic(String),
    /// DDS refused something.
    #[error("{what}: {why}")]
    Dds {
        /// What was to be made.
        what: String,
        /// The library's reason.
        why: String,
    },
}

fn refused(what: &str, why: &impl std::fmt::Debug) -> GraphError {
    GraphError::Dds { what: what.to_owned(), why: format!("{why:?}") }
}

/// This program on the graph.
pub(crate) struct Graph {
    domain: u16,
    interfaces: Vec<IpAddr>,
    status: DomainParticipantStatusListener,
    participant: DomainParticipant,
    publisher: Publisher,
    subscriber: Subscriber,
}

impl Graph {
    /// Joins the domain `domain` on the network interfaces with these addresses; on all of them without an address.
    ///
    /// # Errors
    /// The library's.
    pub(crate) fn join(domain: u16, interfaces: &[IpAddr]) -> Result<Graph, GraphError> {
        let mut builder = DomainParticipantBuilder::new(domain);
        for address in interfaces {
            // The library would join nothing, without a word.
            std::net::UdpSocket::bind((*address, 0)).map_err(|why| {
                refused(&format!("--interface {address} is no address of this machine (ip address lists them)"), &why)
            })?;
        }
        if !interfaces.is_empty() {
            builder = builder.with_only_networks(interfaces.iter().copied());
        }
        let participant = builder.build().map_err(|why| refused(&format!("domain {domain} cannot be joined"), &why))?;
        let qos = QosPolicyBuilder::new().build();
        let publisher = participant.create_publisher(&qos).map_err(|why| refused("no publisher", &why))?;
        let subscriber = participant.create_subscriber(&qos).map_err(|why| refused("no subscriber", &why))?;
        let status = participant.status_listener();
        Ok(Graph { domain, interfaces: interfaces.to_vec(), status, participant, publisher, subscriber })
    }

    /// Joins once more, as another participant.
    ///
    /// # Errors
    /// The library's.
    pub(crate) fn rejoin(&self) -> Result<Graph, GraphError> {
        Graph::join(self.domain, &self.interfaces)
    }

    /// Whether another participant has been silent for longer than its lease since the last call, as behind a link that is cut.
    ///
    /// It may still know this participant, whose lease is longer, and then does not introduce itself again: only another
    /// participant reaches it.
    pub(crate) fn has_lost_a_peer(&self) -> bool {
        let events = std::iter::from_fn(|| self.status.try_recv_status());
        let is_timeout = |event| {
            matches!(event, DomainParticipantStatusEvent::ParticipantLost { reason: LostReason::Timeout { .. }, .. })
        };
        // All of them: the queue has an end.
        events.filter_map(|event| is_timeout(event).then_some(())).count() > 0
    }

    fn topic<M: RosMessage>(&self, topic: &str, qos: &QosPolicies) -> Result<Topic, GraphError> {
        let name = dds_topic(topic).map_err(GraphError::Topic)?;
        self.participant
            .create_topic(name, M::dds_type(), qos, TopicKind::NoKey)
            .map_err(|why| refused(&format!("topic {topic} cannot be made"), &why))
    }

    /// Subscribes to a topic: reliable, and best effort where a publisher offers no more. `latched`: also what was sent before.
    ///
    /// # Errors
    /// The name breaks a rule; the library's.
    pub(crate) fn input<M: RosMessage + DeserializeOwned + 'static>(
        &self,
        topic: &str,
        latched: bool,
    ) -> Result<Input<M>, GraphError> {
        let qos = reader_qos(true, latched);
        let topic = self.topic::<M>(topic, &qos)?;
        let reader = reader(&self.subscriber, &topic, &qos)?;
        Ok(Input {
            reader,
            topic,
            subscriber: self.subscriber.clone(),
            latched,
            reliable: true,
            matched: HashSet::new(),
        })
    }

    /// Publishes a topic, reliable. `latched`: who comes later gets the last message.
    ///
    /// # Errors
    /// The name breaks a rule; the library's.
    pub(crate) fn output<M: RosMessage + Serialize>(
        &self,
        topic: &str,
        latched: bool,
    ) -> Result<Output<M>, GraphError> {
        let qos = QosPolicyBuilder::new()
            .reliability(Reliability::Reliable { max_blocking_time: rustdds::Duration::from_millis(PATIENCE_MS) })
            .durability(if latched { Durability::TransientLocal } else { Durability::Volatile })
            .history(History::KeepLast { depth: if latched { 1 } else { SENT_DEPTH } })
            .build();
        let made = self.topic::<M>(topic, &qos)?;
        let writer = self.publisher.create_datawriter_no_key_cdr(&made, Some(qos));
        Ok(Output { writer: writer.map_err(|why| refused(&format!("{topic} cannot be published"), &why))? })
    }
}

fn reader_qos(reliable: bool, latched: bool) -> QosPolicies {
    let reliability = if reliable {
        Reliability::Reliable { max_blocking_time: rustdds::Duration::from_millis(PATIENCE_MS) }
    } else {
        Reliability::BestEffort
    };
    QosPolicyBuilder::new()
        .reliability(reliability)
        .durability(if latched { Durability::TransientLocal } else { Durability::Volatile })
        .history(History::KeepLast { depth: DEPTH })
        .build()
}

type Reader<M> = DataReader<M, CDRDeserializerAdapter<M>>;

fn reader<M: DeserializeOwned + 'static>(
    subscriber: &Subscriber,
    topic: &Topic,
    qos: &QosPolicies,
) -> Result<Reader<M>, GraphError> {
    subscriber
        .create_datareader_no_key_cdr(topic, Some(qos.clone()))
        .map_err(|why| refused("a topic cannot be read", &why))
}

/// What happened to the publishers of a topic.
#[derive(Debug, Default)]
pub(crate) struct Changes {
    /// Publishers that have left.
    pub(crate) departed: Vec<Guid>,
    /// Whether the reader is a new one, which has to be registered: it asks for best effort only.
    pub(crate) renewed: bool,
}

/// A subscription.
pub(crate) struct Input<M: DeserializeOwned + 'static> {
    reader: Reader<M>,
    topic: Topic,
    subscriber: Subscriber,
    latched: bool,
    reliable: bool,
    matched: HashSet<Guid>,
}

impl<M: DeserializeOwned + 'static> Input<M> {
    /// What wakes a poll when messages have come.
    pub(crate) fn wakeup(&mut self) -> &mut dyn mio1::event::Source {
        &mut self.reader
    }

    /// Passes at most `most` messages to `take`, in the order of their coming. Returns how many were none of this type.
    pub(crate) fn take(&mut self, most: usize, at_ns: u64, wall_ns: i64, take: &mut impl FnMut(Arrived<M>)) -> u64 {
        let (mut taken, mut malformed) = (0, 0);
        while taken < most && malformed < ERRORS as u64 {
            match self.reader.take(most - taken, ReadCondition::not_read()) {
                Ok(messages) if messages.is_empty() => break,
                Ok(messages) => {
                    taken += messages.len();
                    for message in messages {
                        let identity = message.sample_info().sample_identity();
                        let (from, number) = (identity.writer_guid.to_bytes(), i64::from(identity.sequence_number));
                        take(Arrived { from, number, at_ns, wall_ns, message: message.into_value() });
                    }
                }
                Err(_) => malformed += 1,
            }
        }
        malformed
    }

    /// What happened to the publishers. A publisher that offers best effort is read so from then on.
    ///
    /// # Errors
    /// The library's, of a new reader.
    pub(crate) fn changes(&mut self) -> Result<Changes, GraphError> {
        let mut changes = Changes::default();
        while let Some(status) = self.reader.try_recv_status() {
            match status {
                DataReaderStatus::SubscriptionMatched { current, writer, .. } => {
                    if current.count_change() < 0 {
                        self.matched.remove(&writer.to_bytes());
                        changes.departed.push(writer.to_bytes());
                    } else {
                        self.matched.insert(writer.to_bytes());
                    }
                }
                DataReaderStatus::RequestedIncompatibleQos { .. } if self.reliable => changes.renewed = true,
                _ => {}
            }
        }
        if changes.renewed {
            self.reliable = false;
            self.matched.clear();
            self.reader = reader(&self.subscriber, &self.topic, &reader_qos(false, self.latched))?;
        }
        Ok(changes)
    }

    /// How many publishers are there.
    pub(crate) fn publishers(&self) -> usize {
        self.matched.len()
    }
}

/// A publication.
pub(crate) struct Output<M: Serialize> {
    writer: DataWriter<M, CDRSerializerAdapter<M>>,
}

impl<M: Serialize> Output<M> {
    /// Sends a message; whether it could be sent: it is left out where a reader has not kept up.
    pub(crate) fn send(&self, message: M) -> bool {
        self.writer.write(message, None).is_ok()
    }
}
