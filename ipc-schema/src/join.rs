//! Joining a bus, past what killed processes left half-made.

use std::time::{Duration, Instant};

use iceoryx2::node::Node;
use iceoryx2::prelude::{Config, NodeBuilder, NodeName, SignalHandlingMode, ipc};

use crate::bus_config::BusConfig;
use crate::cleanup::{close_to_others, remove_half_made, remove_half_made_memory};
use crate::error::BusError;
use crate::owner::{cannot_join, ensure_own};

/// How long an opening waits for a service that another process is making or removing.
const OPENING_PATIENCE: Duration = Duration::from_secs(2);

impl BusConfig {
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
                    // Where there is none, another party may have removed it just before and be about to make it anew.
                    remove_half_made(config);
                    (begin, healed) = (Instant::now(), true);
                }
                std::thread::sleep(Duration::from_millis(2));
            }
            result => return result,
        }
    }
}
