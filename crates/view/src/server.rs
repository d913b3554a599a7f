//! Listens, and passes messages to the clients that subscribed.

use std::collections::VecDeque;
use std::io;
use std::net::{SocketAddr, TcpListener};
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use crate::client;
use crate::protocol::{self, Subscription};

/// Messages that wait for a client at most; the oldest makes room for the newest.
const WAITING: usize = 1024;
/// Clients at a time.
pub(crate) const MOST_CLIENTS: usize = 16;
/// Subscriptions of a client.
const MOST_SUBSCRIPTIONS: usize = 1024;
/// Time between two looks at whether someone connects.
const ACCEPT: Duration = Duration::from_millis(20);

/// A channel that is offered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Channel {
    /// Its topic.
    pub topic: String,
    /// Name of its schema.
    pub schema_name: String,
    /// JSON Schema of its messages.
    pub schema: String,
    /// Whether a client that subscribes gets the last message at once.
    pub is_kept: bool,
}

/// Why nothing is served.
#[derive(Debug, thiserror::Error)]
pub enum ServerError {
    /// Another program listens there.
    #[error("{host}:{port} is in use: another rivet view may run; give another --port, or --port 0 for a free one")]
    InUse {
        /// Host of the command line.
        host: String,
        /// Port of the command line.
        port: u16,
    },
    /// The address is not this machine's, or its name is not known.
    #[error("cannot listen at {host}:{port}: {why}; --host must be an address of this machine")]
    Address {
        /// Host of the command line.
        host: String,
        /// Port of the command line.
        port: u16,
        /// The system's reason.
        why: io::Error,
    },
}

/// A message on its way: channel, time of the log \[ns since 1970\], payload.
#[derive(Clone, Debug)]
pub(crate) struct Outgoing {
    pub(crate) channel: usize,
    pub(crate) log_time_ns: u64,
    pub(crate) payload: Arc<[u8]>,
}

/// What a client subscribed to, and what waits for it.
#[derive(Debug, Default)]
pub(crate) struct Mailbox {
    subscriptions: Vec<Subscription>,
    pub(crate) waiting: VecDeque<Outgoing>,
}

impl Mailbox {
    /// Ids of the subscriptions to a channel.
    pub(crate) fn ids(&self, channel: usize) -> impl Iterator<Item = u32> {
        let of_channel = move |s: &&Subscription| usize::try_from(s.channel).is_ok_and(|c| c == channel);
        self.subscriptions.iter().filter(of_channel).map(|s| s.id)
    }
}

/// Counts of one channel.
#[derive(Debug, Default)]
pub(crate) struct Tally {
    /// Messages that went to a client, each client by itself.
    pub(crate) sent: AtomicU64,
    /// Messages that gave way to newer ones, since the client was too slow.
    pub(crate) dropped: AtomicU64,
}

/// What threads share.
#[derive(Debug)]
pub(crate) struct Shared {
    pub(crate) name: String,
    pub(crate) session: String,
    pub(crate) channels: Vec<Channel>,
    pub(crate) tallies: Vec<Tally>,
    /// The last message of each channel that keeps it.
    kept: Mutex<Vec<Option<Outgoing>>>,
    clients: Mutex<Vec<Arc<Mutex<Mailbox>>>>,
    pub(crate) connected: AtomicUsize,
    pub(crate) ever: AtomicU64,
    pub(crate) refused: AtomicU64,
    pub(crate) stop: AtomicBool,
}

pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Shared {
    /// Adds subscriptions of a client; what to answer for each that cannot be.
    pub(crate) fn subscribe(&self, mailbox: &Mutex<Mailbox>, wanted: &[Subscription]) -> Vec<String> {
        let mut answers = Vec::new();
        // In the order of `publish`, so that no message is between the kept one and the next.
        let kept = lock(&self.kept);
        let mut mailbox = lock(mailbox);
        for subscription in wanted {
            let channel = usize::try_from(subscription.channel).ok().filter(|channel| *channel < self.channels.len());
            let Some(channel) = channel else {
                answers.push(format!("there is no channel {}", subscription.channel));
                continue;
            };
            if mailbox.subscriptions.iter().any(|s| s.id == subscription.id) {
                answers.push(format!("subscription {} is there already", subscription.id));
                continue;
            }
            if mailbox.subscriptions.len() >= MOST_SUBSCRIPTIONS {
                answers.push(format!("there are {MOST_SUBSCRIPTIONS} subscriptions already"));
                break;
            }
            mailbox.subscriptions.push(*subscription);
            if let Some(outgoing) = &kept[channel] {
                mailbox.waiting.push_back(outgoing.clone());
            }
        }
        answers
    }

    /// Removes subscriptions of a client; what to answer for each that is not there.
    pub(crate) fn unsubscribe(mailbox: &Mutex<Mailbox>, ids: &[u32]) -> Vec<String> {
        let mut mailbox = lock(mailbox);
        let mut answers = Vec::new();
        for id in ids {
            let before = mailbox.subscriptions.len();
            mailbox.subscriptions.retain(|s| s.id != *id);
            if mailbox.subscriptions.len() == before {
                answers.push(format!("there is no subscription {id}"));
            }
        }
        answers
    }

    pub(crate) fn join(&self, mailbox: &Arc<Mutex<Mailbox>>) {
        lock(&self.clients).push(Arc::clone(mailbox));
    }

    pub(crate) fn leave(&self, mailbox: &Arc<Mutex<Mailbox>>) {
        lock(&self.clients).retain(|other| !Arc::ptr_eq(other, mailbox));
    }
}

/// A server with its threads: one listens, one a client.
#[derive(Debug)]
pub struct Server {
    shared: Arc<Shared>,
    address: SocketAddr,
    listening: Option<JoinHandle<()>>,
}

impl Server {
    /// Listens at `host` and `port`; 0 is a free port. `session` is another text at each start.
    ///
    /// # Errors
    /// The port is in use, or the host is not this machine's.
    pub fn start(
        host: &str,
        port: u16,
        name: &str,
        session: &str,
        channels: Vec<Channel>,
    ) -> Result<Server, ServerError> {
        let host_text = host.to_owned();
        let fail = |why: io::Error| match why.kind() {
            io::ErrorKind::AddrInUse => ServerError::InUse { host: host_text.clone(), port },
            _ => ServerError::Address { host: host_text.clone(), port, why },
        };
        let listener = TcpListener::bind((host, port)).map_err(&fail)?;
        listener.set_nonblocking(true).map_err(&fail)?;
        let address = listener.local_addr().map_err(&fail)?;
        let shared = Arc::new(Shared {
            name: name.to_owned(),
            session: session.to_owned(),
            tallies: channels.iter().map(|_| Tally::default()).collect(),
            kept: Mutex::new(vec![None; channels.len()]),
            channels,
            clients: Mutex::default(),
            connected: AtomicUsize::new(0),
            ever: AtomicU64::new(0),
            refused: AtomicU64::new(0),
            stop: AtomicBool::new(false),
        });
        let listening = {
            let shared = Arc::clone(&shared);
            thread::spawn(move || listen(&listener, &shared))
        };
        Ok(Server { shared, address, listening: Some(listening) })
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Whether a message of a channel goes anywhere: a client has subscribed, or the last message is kept.
    pub fn wants(&self, channel: usize) -> bool {
        self.shared.channels[channel].is_kept
            || lock(&self.shared.clients).iter().any(|mailbox| lock(mailbox).ids(channel).next().is_some())
    }

    /// Passes a message to all clients that subscribed to its channel. Never waits for one.
    pub fn publish(&self, channel: usize, log_time_ns: u64, payload: &[u8]) {
        let outgoing = Outgoing { channel, log_time_ns, payload: payload.into() };
        let mut kept = lock(&self.shared.kept);
        if self.shared.channels[channel].is_kept {
            kept[channel] = Some(outgoing.clone());
        }
        for mailbox in lock(&self.shared.clients).iter() {
            let mut mailbox = lock(mailbox);
            if mailbox.ids(channel).next().is_none() {
                continue;
            }
            if mailbox.waiting.len() >= WAITING
                && let Some(oldest) = mailbox.waiting.pop_front()
            {
                self.shared.tallies[oldest.channel].dropped.fetch_add(1, Ordering::Relaxed);
            }
            mailbox.waiting.push_back(outgoing.clone());
        }
    }

    /// Clients that are connected now, and all so far.
    pub fn clients(&self) -> (usize, u64) {
        (self.shared.connected.load(Ordering::Relaxed), self.shared.ever.load(Ordering::Relaxed))
    }

    /// Connections that were refused: one too many, or of another protocol.
    pub fn refused(&self) -> u64 {
        self.shared.refused.load(Ordering::Relaxed)
    }

    /// Messages of a channel that went to clients, each client by itself, and those that were dropped.
    pub fn counts(&self, channel: usize) -> (u64, u64) {
        let tally = &self.shared.tallies[channel];
        (tally.sent.load(Ordering::Relaxed), tally.dropped.load(Ordering::Relaxed))
    }
}

impl Drop for Server {
    /// Closes all connections.
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        if let Some(listening) = self.listening.take() {
            // It can only have panicked, which was reported on standard error.
            let _ = listening.join();
        }
    }
}

/// Accepts connections until the end, then waits for the threads of all clients.
fn listen(listener: &TcpListener, shared: &Arc<Shared>) {
    let first = [protocol::server_info(&shared.name, &shared.session), protocol::advertise(&shared.channels)];
    let first: Arc<[String]> = first.into();
    let mut threads: Vec<JoinHandle<()>> = Vec::new();
    while !shared.stop.load(Ordering::Relaxed) {
        match listener.accept() {
            Ok((stream, _)) => {
                threads.retain(|thread| !thread.is_finished());
                if threads.len() >= MOST_CLIENTS {
                    // The connection is closed.
                    shared.refused.fetch_add(1, Ordering::Relaxed);
                    continue;
                }
                let (shared, first) = (Arc::clone(shared), Arc::clone(&first));
                threads.push(thread::spawn(move || client::serve(stream, &shared, &first)));
            }
            // Nobody connects, or a connection that is gone again; too many open files pass too.
            Err(_) => thread::sleep(ACCEPT),
        }
    }
    for thread in threads {
        let _ = thread.join();
    }
}
