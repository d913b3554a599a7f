//! Listens, and passes messages to the clients that subscribed.

use std::io;
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread::{self, JoinHandle};
use std::time::Duration;

use crate::channel::Channel;
use crate::client;
use crate::protocol;
use crate::shared::Shared;

/// Clients at a time.
const MAX_CLIENTS: usize = 16;
/// Time between two looks at whether someone connects.
const ACCEPT: Duration = Duration::from_millis(20);

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
    /// Ports below 1024 are the superuser's.
    #[error("cannot listen at {host}:{port}: this user may not; give a --port from 1024 on")]
    NotPermitted {
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
        // As addresses of IPv6 stand in a URL.
        let host = host.strip_prefix('[').and_then(|inner| inner.strip_suffix(']')).unwrap_or(host);
        let host_text = if host.contains(':') { format!("[{host}]") } else { host.to_owned() };
        let fail = |why: io::Error| match why.kind() {
            io::ErrorKind::AddrInUse => ServerError::InUse { host: host_text.clone(), port },
            io::ErrorKind::PermissionDenied => ServerError::NotPermitted { host: host_text.clone(), port },
            _ => ServerError::Address { host: host_text.clone(), port, why },
        };
        let listener = TcpListener::bind((host, port)).map_err(&fail)?;
        listener.set_nonblocking(true).map_err(&fail)?;
        let address = listener.local_addr().map_err(&fail)?;
        let shared = Arc::new(Shared::new(name, session, channels));
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
        self.shared.wants(channel)
    }

    /// Passes a message to all clients that subscribed to its channel. Never waits for one.
    pub fn publish(&self, channel: usize, log_time_ns: u64, payload: &[u8]) {
        self.shared.publish(channel, log_time_ns, payload);
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
                if threads.len() >= MAX_CLIENTS {
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
