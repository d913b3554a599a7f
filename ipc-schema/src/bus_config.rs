//! Which bus, and what all of its parties agree on.

use std::path::PathBuf;
use std::time::Duration;

use iceoryx2::prelude::{Config, FileName, LogLevel, Path, SemanticString, set_log_level_from_env_or};

use crate::error::BusError;

/// Publishers (and notifiers) of a service: one, and one for a network bridge that mirrors it.
pub(crate) const MAX_PUBLISHERS: usize = 2;
/// Subscribers (listeners, readers, clients) of a service.
pub(crate) const MAX_SUBSCRIBERS: usize = 16;
/// The same of what the daemon and the controller publish: anyone may look on.
pub(crate) const MAX_ONLOOKERS: usize = 72;
/// Parties of a service.
pub(crate) const MAX_NODES: usize = 96;

/// How long `send` may stall on a subscriber that it cannot reach (another user's). The default of a second
/// would stop a publisher for as long.
const CREATION_TIMEOUT: Duration = Duration::from_millis(10);

/// Where POSIX shared memory lies.
pub(crate) const SHARED_MEMORY: &str = "/dev/shm";

/// Below the root of the bus: locks of writers.
pub(crate) const LOCK_DIRECTORY: &str = "locks";

/// Which bus: processes with equal values meet, others do not see each other.
///
/// Always passed on explicitly; neither the working directory nor a configuration file of the user's has a say.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BusConfig {
    /// First part of the name of every file in shared memory; 3 to 32 of `a-z A-Z 0-9 - _`.
    pub prefix: String,
    /// Directory for the bus's own files, absolute; made when absent.
    pub root: PathBuf,
}

impl Default for BusConfig {
    /// Prefix `rivet_`, root `/tmp/rivet`.
    fn default() -> Self {
        Self { prefix: "rivet_".to_owned(), root: PathBuf::from("/tmp/rivet") }
    }
}

impl BusConfig {
    /// Longest root path and prefix together \[bytes\]: the bus adds up to 46 for the path of an event's socket,
    /// and the system allows 107.
    pub const MAX_LEN: usize = 60;

    /// Checks the values.
    ///
    /// # Errors
    /// The rule that one breaks.
    pub fn check(&self) -> Result<(), BusError> {
        let prefix_ok = (3..=32).contains(&self.prefix.len())
            && self.prefix.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'-' || b == b'_');
        if !prefix_ok {
            return Err(BusError::Prefix { prefix: self.prefix.clone() });
        }
        let refuse = |why| Err(BusError::Root { root: self.root.clone(), why });
        match self.root.to_str() {
            None => refuse("it must be valid UTF-8"),
            Some(root) if root.len() + self.prefix.len() > Self::MAX_LEN => {
                refuse("it and the prefix together must have at most 60 characters (the path of a socket is limited)")
            }
            Some(_) if !self.root.is_absolute() => refuse("it must be absolute"),
            Some(_) if self.root.parent().is_none() => refuse("it must not be the root of the file system"),
            Some(_) => Ok(()),
        }
    }

    /// The same as options of rivet's programs.
    pub fn options(&self) -> String {
        format!("--prefix {} --root {}", self.prefix, self.root.display())
    }

    /// What removes the leftovers of this bus, and nothing that is in use.
    pub fn clean_command(&self) -> String {
        format!("rivet doctor --seconds 0 --clean {}", self.options())
    }

    /// The same as the bus library wants it. For tests that put a foreign program onto a bus.
    #[doc(hidden)]
    pub fn iceoryx(&self) -> Result<Config, BusError> {
        self.check()?;
        let mut config = Config::default();
        config.global.prefix =
            FileName::new(self.prefix.as_bytes()).map_err(|_| BusError::Prefix { prefix: self.prefix.clone() })?;
        let root = self.root.to_str().and_then(|root| Path::new(root.as_bytes()).ok());
        let root =
            root.ok_or(BusError::Root { root: self.root.clone(), why: "it has a character paths may not have" })?;
        config.global.set_root_path(&root);
        config.global.creation_timeout = CREATION_TIMEOUT;
        Ok(config)
    }
}

/// Keeps the library to errors. Not warnings: they are dumps of internal state, made whenever a killed process is cleared away.
pub(crate) fn quieten() {
    set_log_level_from_env_or(LogLevel::Error);
}

/// Whether a file of the bus's belongs to `prefix`, and not to a longer prefix that begins alike: what follows
/// is a hash or an id, to the next `_` or `.`.
pub(crate) fn belongs(name: &[u8], prefix: &str) -> bool {
    let Some(rest) = name.strip_prefix(prefix.as_bytes()) else { return false };
    let id = rest.iter().take_while(|byte| matches!(byte, b'0'..=b'9' | b'a'..=b'f')).count();
    id >= 12 && matches!(rest.get(id), Some(b'_' | b'.'))
}
