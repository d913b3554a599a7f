//! Blackboards: the latest value, one writer, many readers; clean in a real-time thread on both sides.
//!
//! A blackboard does not survive the death of its writer while a reader lives: the writer's place stays
//! taken. The next writer therefore removes the blackboard by force and makes a new one, under an exclusive
//! lock that proves the old writer gone; readers notice by the stamp and look for the new one.

use core::fmt;
use std::fs::{DirBuilder, File, TryLockError};
use std::os::unix::fs::DirBuilderExt as _;
use std::time::Duration;

use iceoryx2::node::Node;
use iceoryx2::port::reader::{EntryHandle, Reader};
use iceoryx2::port::writer::{EntryHandleMut, Writer};
use iceoryx2::prelude::{AttributeSpecifier, Config, MessagingPattern, ServiceName, ipc};
use iceoryx2::service::Service as _;
use iceoryx2::service::builder::blackboard::{BlackboardCreateError as CreateError, BlackboardOpenError as OpenError};
use iceoryx2::service::port_factory::PortFactory as _;
use iceoryx2::service::port_factory::blackboard::PortFactory;

use crate::bus_config::{BusConfig, LOCK_DIRECTORY, MAX_NODES, MAX_ONLOOKERS};
use crate::error::BusError;
use crate::join::retry;
use crate::messages::Stamped;
use crate::name::RobotName;
use crate::service::Service;
use crate::version;

/// The only entry of a blackboard.
const ENTRY: u64 = 0;

/// Attribute that carries the message's type name: a blackboard's own description names only the key's type.
const TYPE_ATTRIBUTE: &str = "rivet.type";

type Factory = PortFactory<ipc::Service, u64>;

/// Writes the latest value.
pub struct BlackboardWriter<T: Stamped> {
    // Dropped in this order: the lock is given up last.
    handle: EntryHandleMut<ipc::Service, u64, T>,
    _writer: Writer<ipc::Service, u64>,
    _factory: Factory,
    _removed: Option<(Factory, Node<ipc::Service>)>,
    _node: Node<ipc::Service>,
    _lock: Lock,
}

impl<T: Stamped> BlackboardWriter<T> {
    pub(crate) fn open(
        bus: &BusConfig,
        config: &Config,
        name: &ServiceName,
        robot: &RobotName,
        service: Service,
        role: &str,
    ) -> Result<Self, BusError> {
        let lock = Lock::take(bus, name, robot, service)?;
        let node = bus.join(config, role)?;
        let fail = |why: String| BusError::Open { service: name.to_string(), role: "writer", why };

        // A predecessor that left in order keeps its blackboard usable as long as a reader holds it.
        let mut removed = None;
        let taken = match create::<T>(&node, name) {
            Ok(factory) => Some(attach::<T>(&factory).map(|ports| (factory, ports)).map_err(fail)?),
            Err(_) => open_existing::<T>(&node, config, name)
                .and_then(|factory| attach::<T>(&factory).ok().map(|ports| (factory, ports))),
        };
        let (factory, (writer, handle)) = if let Some(taken) = taken {
            taken
        } else {
            // Readers of the dead writer's blackboard map it until they notice. Whoever leaves it last removes
            // the *name*, which by then is the new blackboard's; staying on it ourselves prevents that.
            let keeper = bus.join(config, role)?;
            removed = keeper.service_builder(name).blackboard_opener::<u64>().open().ok().map(|old| (old, keeper));
            remove_by_force(&node, name).map_err(fail)?;
            let factory =
                retry(config, || create::<T>(&node, name), |e| !matches!(e, CreateError::InsufficientPermissions))
                    .map_err(|e| fail(format!("{e:?}")))?;
            let ports = attach::<T>(&factory).map_err(fail)?;
            (factory, ports)
        };
        Ok(Self { handle, _writer: writer, _factory: factory, _removed: removed, _node: node, _lock: lock })
    }

    /// Replaces the value.
    ///
    /// Real-time safe: two copies of the message; no allocation, lock or system call, whatever readers do.
    pub fn write(&self, value: &T) {
        self.handle.update_with_copy(*value);
    }
}

impl<T: Stamped> fmt::Debug for BlackboardWriter<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "BlackboardWriter<{}>", T::TYPE_NAME)
    }
}

/// The exclusive lock that makes this program the writer; the kernel frees it when the process dies.
struct Lock(File);

impl Lock {
    fn take(bus: &BusConfig, name: &ServiceName, robot: &RobotName, service: Service) -> Result<Self, BusError> {
        let directory = bus.root.join(LOCK_DIRECTORY);
        let path = directory.join(format!("{}.{robot}.{service}.lock", bus.prefix));
        let fail = |source| BusError::File { path: path.clone(), source };
        // As closed to others as the bus's own files: who can open the lock can hold it.
        DirBuilder::new().recursive(true).mode(0o750).create(&directory).map_err(fail)?;
        let file = rivet_files::open_lock(&path).map_err(fail)?;
        match file.try_lock() {
            Ok(()) => Ok(Self(file)),
            Err(TryLockError::WouldBlock) => {
                Err(BusError::WriterAlive { service: name.to_string(), lock: path.clone() })
            }
            Err(TryLockError::Error(e)) => Err(fail(e)),
        }
    }
}

impl Drop for Lock {
    /// A child that this process has forked and that has not replaced its image yet holds the file open as well: closing would not free it.
    fn drop(&mut self) {
        // Where the kernel cannot free it now, it does with the last copy.
        drop(self.0.unlock());
    }
}

fn create<T: Stamped>(node: &Node<ipc::Service>, name: &ServiceName) -> Result<Factory, CreateError> {
    let key = TYPE_ATTRIBUTE.try_into().map_err(|_| CreateError::InternalFailure)?;
    let value = T::TYPE_NAME.try_into().map_err(|_| CreateError::InternalFailure)?;
    let attributes = AttributeSpecifier::new().define(&key, &value).map_err(|_| CreateError::InternalFailure)?;
    node.service_builder(name)
        .blackboard_creator::<u64>()
        .add::<T>(ENTRY, T::EMPTY)
        .max_readers(MAX_ONLOOKERS)
        .max_nodes(MAX_NODES)
        .create_with_attributes(&attributes)
}

/// The blackboard of a predecessor, if it carries our message.
fn open_existing<T: Stamped>(node: &Node<ipc::Service>, config: &Config, name: &ServiceName) -> Option<Factory> {
    if carried_type(config, name)? != T::TYPE_NAME {
        return None;
    }
    node.service_builder(name).blackboard_opener::<u64>().open().ok()
}

type WriterPorts<T> = (Writer<ipc::Service, u64>, EntryHandleMut<ipc::Service, u64, T>);

fn attach<T: Stamped>(factory: &Factory) -> Result<WriterPorts<T>, String> {
    let writer = factory.writer_builder().create().map_err(|e| format!("{e:?}"))?;
    let handle = writer.entry::<T>(&ENTRY).map_err(|e| format!("{e:?}"))?;
    Ok((writer, handle))
}

#[allow(unsafe_code, reason = "the bus offers no safe way past a writer that was killed")]
fn remove_by_force(node: &Node<ipc::Service>, name: &ServiceName) -> Result<(), String> {
    // SAFETY: "no other process shall use the service". The caller holds the exclusive lock of this
    // blackboard, so no other writer lives. Readers may live: they only read, from a mapping that stays
    // valid when the name is unlinked, and find the new blackboard by its name once their stamp is stale.
    unsafe { node.force_remove_service(name, MessagingPattern::Blackboard) }.map(|_| ()).map_err(|e| format!("{e:?}"))
}

/// Type name that an existing blackboard says it carries.
fn carried_type(config: &Config, name: &ServiceName) -> Option<String> {
    let details = ipc::Service::details(name, config, MessagingPattern::Blackboard).ok()??;
    let key = TYPE_ATTRIBUTE.try_into().ok()?;
    Some(details.static_details.attributes().key_value(&key, 0)?.to_string())
}

/// What a reader holds of one incarnation of the blackboard.
struct Connection<T: Stamped> {
    // Dropped in this order.
    handle: EntryHandle<ipc::Service, u64, T>,
    _reader: Reader<ipc::Service, u64>,
    factory: Factory,
}

/// Reads the latest value.
///
/// The blackboard need not exist yet: [`latest`](Self::latest) is `None` until
/// [`reopen_if_stale`](Self::reopen_if_stale) has found it.
pub struct BlackboardReader<T: Stamped> {
    connection: Option<Connection<T>>,
    // Of its own, so that leaving one incarnation and joining the next never mixes with another reader's.
    node: Node<ipc::Service>,
    config: Config,
    name: ServiceName,
    tried_ns: Option<u64>,
}

#[allow(unsafe_code, reason = "the bus library marks its entry handle as bound to a thread, for its reference counts")]
// SAFETY: the counts that are not atomic belong to the ports of one reader. Node, service, reader and handle are private to this
// struct, no other port shares them, and none is handed out. They move together, so only one thread at a time counts.
unsafe impl<T: Stamped> Send for BlackboardReader<T> {}

impl<T: Stamped> fmt::Debug for BlackboardReader<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "BlackboardReader<{}> of {}", T::TYPE_NAME, self.name)
    }
}

impl<T: Stamped> BlackboardReader<T> {
    pub(crate) fn open(bus: &BusConfig, config: &Config, name: &ServiceName, role: &str) -> Result<Self, BusError> {
        let mut reader = Self {
            connection: None,
            node: bus.join(config, role)?,
            config: config.clone(),
            name: *name,
            tried_ns: None,
        };
        reader.connect()?;
        Ok(reader)
    }

    /// The latest value written; `None` while there is no blackboard or nothing was written yet. Judge its age
    /// by the stamp: the value of a writer that died stays.
    ///
    /// Real-time safe: one copy of the message; no allocation, lock or system call.
    pub fn latest(&self) -> Option<T> {
        let value = *self.connection.as_ref()?.handle.get();
        (value.stamp_ns() != 0).then_some(value)
    }

    /// Whether a blackboard was found.
    pub fn is_connected(&self) -> bool {
        self.connection.is_some()
    }

    /// Looks for a (new) blackboard when the value is missing or older than `max_age`, at most once every
    /// `max_age`. Returns true when it moved to a new one. Not real-time: works on files when it looks.
    ///
    /// `now_ns` is `CLOCK_MONOTONIC` \[ns\].
    ///
    /// # Errors
    /// The blackboard found carries another version, or this reader is one too many.
    pub fn reopen_if_stale(&mut self, now_ns: u64, max_age: Duration) -> Result<bool, BusError> {
        let max_age = u64::try_from(max_age.as_nanos()).unwrap_or(u64::MAX);
        let stale = |since: u64| now_ns.saturating_sub(since) > max_age;
        if self.latest().is_some_and(|value| !stale(value.stamp_ns())) || self.tried_ns.is_some_and(|at| !stale(at)) {
            return Ok(false);
        }
        self.tried_ns = Some(now_ns);
        if let Some(connection) = &self.connection {
            let details = ipc::Service::details(&self.name, &self.config, MessagingPattern::Blackboard);
            let same = match details {
                Ok(Some(details)) => {
                    details.static_details.unique_service_id() == connection.factory.unique_service_id()
                }
                // Gone or in the making: the old value is the best there is.
                Ok(None) | Err(_) => true,
            };
            if same {
                return Ok(false);
            }
        }
        // Leave the old one first: one party is registered once for each name.
        self.connection = None;
        self.connect()
    }

    /// Opens the blackboard if there is one; true when connected.
    fn connect(&mut self) -> Result<bool, BusError> {
        let fail = |why: String| BusError::Open { service: self.name.to_string(), role: "reader", why };
        let factory = match self.node.service_builder(&self.name).blackboard_opener::<u64>().open() {
            Ok(factory) => factory,
            // Absent, or being made or removed at this moment: the next look will find it.
            Err(
                OpenError::DoesNotExist
                | OpenError::HangsInCreation
                | OpenError::IsMarkedForDestruction
                | OpenError::ServiceInCorruptedState,
            ) => return Ok(false),
            Err(e) => return Err(fail(format!("{e:?}"))),
        };
        let reader = factory.reader_builder().create().map_err(|e| fail(format!("{e:?}")))?;
        let Ok(handle) = reader.entry::<T>(&ENTRY) else {
            let carried = carried_type(&self.config, &self.name).unwrap_or_else(|| "no message of rivet's".to_owned());
            return Err(BusError::Version(version::mismatch::<T>(self.name.as_str(), &carried)));
        };
        self.connection = Some(Connection { handle, _reader: reader, factory });
        Ok(true)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cleanup::PrivateBus;

    /// What a child holds between fork and exec: the same open file.
    #[test]
    fn a_copy_of_the_lock_does_not_hold_it() {
        let private = PrivateBus::new("lock");
        let robot = RobotName::new("arm-1").expect("a good name");
        let name = ServiceName::new("lock").expect("a good name");
        let take = || Lock::take(private.config(), &name, &robot, Service::Command);
        let lock = take().expect("free");
        let copy = lock.0.try_clone().expect("a copy");
        assert!(matches!(take().err(), Some(BusError::WriterAlive { .. })));
        drop(lock);
        assert!(take().is_ok(), "given up, though the copy is open");
        drop(copy);
    }
}
