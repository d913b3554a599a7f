//! What dead processes leave behind.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

use iceoryx2::node::{Node, NodeState};
use iceoryx2::prelude::{CallbackProgression, ipc};

use crate::blackboard::LOCK_DIRECTORY;
use crate::bus::BusConfig;
use crate::error::BusError;

/// Where POSIX shared memory lies.
const SHARED_MEMORY: &str = "/dev/shm";

/// What was removed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Leftovers {
    /// Dead parties whose resources were freed.
    pub dead_nodes: usize,
    /// Files unlinked.
    pub files: usize,
}

/// Counts live nodes and frees what dead ones left.
fn sweep(config: &BusConfig) -> Result<(usize, usize), BusError> {
    let iceoryx = config.iceoryx()?;
    let (mut alive, mut freed) = (0, 0);
    let listed = Node::<ipc::Service>::list(&iceoryx, |state| {
        match state {
            NodeState::Dead(view) => freed += usize::from(view.try_remove_stale_resources().is_ok()),
            NodeState::Alive(_) | NodeState::Inaccessible(_) => alive += 1,
            NodeState::Undefined(_) => {}
        }
        CallbackProgression::Continue
    });
    listed.map_err(|e| BusError::Join {
        prefix: config.prefix.clone(),
        root: config.root.clone(),
        why: format!("{e:?}"),
    })?;
    Ok((alive, freed))
}

/// Frees what killed processes left on the bus. Safe while others use it; 2 to 14 ms a dead party.
///
/// Joining the bus does the same; this is for a process that is about to leave no one behind.
pub fn cleanup(config: &BusConfig) -> Result<Leftovers, BusError> {
    let (_, dead_nodes) = sweep(config)?;
    Ok(Leftovers { dead_nodes, files: 0 })
}

/// Removes every file of the bus, once no process uses it any more: a clean exit leaves one page, a killed
/// process more.
///
/// # Errors
/// [`BusError::InUse`] while a process is on the bus; nothing but dead parties is then removed.
pub fn purge(config: &BusConfig) -> Result<Leftovers, BusError> {
    let (alive, dead_nodes) = sweep(config)?;
    if alive > 0 {
        return Err(BusError::InUse { prefix: config.prefix.clone(), nodes: alive });
    }
    Ok(Leftovers { dead_nodes, files: unlink_all(config)? })
}

/// Unlinks the files of the bus, whoever may use them.
fn unlink_all(config: &BusConfig) -> Result<usize, BusError> {
    config.check()?;
    let fail = |path: &Path| {
        let path = path.to_owned();
        move |source| BusError::File { path, source }
    };
    let mut files = 0;
    let mut unlink_below = |directory: &Path, prefix: &str| -> Result<(), BusError> {
        let entries = match fs::read_dir(directory) {
            Ok(entries) => entries,
            Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(()),
            Err(e) => return Err(fail(directory)(e)),
        };
        for entry in entries.flatten() {
            if entry.file_name().as_encoded_bytes().starts_with(prefix.as_bytes()) {
                let path = entry.path();
                let removed = if path.is_dir() { fs::remove_dir_all(&path) } else { fs::remove_file(&path) };
                match removed {
                    Ok(()) => files += 1,
                    Err(e) if e.kind() == io::ErrorKind::NotFound => {}
                    Err(e) => return Err(fail(&path)(e)),
                }
            }
        }
        Ok(())
    };
    unlink_below(Path::new(SHARED_MEMORY), &config.prefix)?;
    // Only what the bus makes below its root, and of that only what bears the prefix: the root may be shared.
    for directory in ["nodes", "services", LOCK_DIRECTORY] {
        unlink_below(&config.root.join(directory), &config.prefix)?;
    }
    unlink_below(&config.root, &config.prefix)?;
    for directory in ["nodes", "services", LOCK_DIRECTORY, ""] {
        // Not empty means another prefix lives there.
        let _ = fs::remove_dir(config.root.join(directory));
    }
    Ok(files)
}

/// A bus of one's own: unique prefix and root, all files removed when dropped. For tests and demonstrations;
/// drop it last, after all parties.
#[derive(Debug)]
pub struct PrivateBus {
    config: BusConfig,
}

impl PrivateBus {
    /// A bus that no other process or test has. `label` (letters and digits) tells leftovers apart.
    pub fn new(label: &str) -> Self {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let label: String = label.chars().filter(char::is_ascii_alphanumeric).take(8).collect();
        let unique = format!("{}_{}", std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed));
        let prefix = format!("rvt_{unique}_");
        // Not the temporary directory of the environment: it may be longer than a socket's path allows.
        let root = PathBuf::from(format!("/tmp/rivet-{label}{unique}"));
        Self { config: BusConfig { prefix, root } }
    }

    /// Values to open it with, here or in a child process.
    pub fn config(&self) -> &BusConfig {
        &self.config
    }
}

impl Drop for PrivateBus {
    fn drop(&mut self) {
        // The bus is private and its owner is done with it: whoever still maps a file loses only its name.
        let _ = sweep(&self.config);
        let _ = unlink_all(&self.config);
    }
}
