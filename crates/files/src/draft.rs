//! A file under way: written beside its place, then renamed over it.

use crate::destination::Destination;
use crate::{me, sweep};
use std::fs::{self, File, Permissions, TryLockError};
use std::io;
use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// A draft's name is this, random letters, and [`SUFFIX`].
pub(crate) const PREFIX: &str = ".rivet-";
/// How the name of a draft ends.
pub(crate) const SUFFIX: &str = ".part";
/// Random letters and digits in a draft's name: 62^12, beyond guessing.
pub(crate) const RANDOM: usize = 12;

/// Tries for a draft that nobody takes for an abandoned one between its making and its locking.
const TRIES: usize = 8;

/// Permissions of a new file before the umask.
const NEW_FILE: u32 = 0o666;

/// A file under way: gone when dropped, in its place when published. A lock on it shows that its writer lives.
#[derive(Debug)]
pub struct Draft {
    temporary: NamedTempFile,
    path: PathBuf,
    mode: Option<u32>,
}

impl Draft {
    /// Begins a file for `path`, in the same folder. The first one in a folder removes what killed writers have left there.
    ///
    /// # Errors
    /// The folder is missing or cannot be written, another user's link is on the way, or what is there may not be replaced. A pipe
    /// or a device has no draft.
    pub fn new(path: &Path) -> io::Result<Draft> {
        let Destination::Replaced { folder, path } = Destination::of(path)? else {
            let why = format!("{} is a pipe or a device, which has no draft", path.display());
            return Err(io::Error::new(io::ErrorKind::InvalidInput, why));
        };
        sweep::sweep_once(&folder);
        Ok(Draft { temporary: begin(&folder)?, path, mode: None })
    }

    /// What is written to.
    pub fn file(&mut self) -> &mut File {
        self.temporary.as_file_mut()
    }

    /// Permissions of the file, whatever the umask is.
    #[must_use]
    pub fn with_mode(self, mode: u32) -> Draft {
        Draft { mode: Some(mode), ..self }
    }

    /// Renames it over its place, and returns it. A file of this user keeps its permissions; a new one gets those of any new file.
    ///
    /// # Errors
    /// It cannot be renamed; what was there stays.
    pub fn publish(self) -> io::Result<File> {
        let mode = self.mode.unwrap_or_else(|| mode_at(&self.path));
        self.temporary.as_file().set_permissions(Permissions::from_mode(mode))?;
        let file = self.temporary.persist(&self.path).map_err(|why| why.error)?;
        // Nobody sweeps it under this name, and whoever gets it may want to lock it.
        drop(file.unlock());
        Ok(file)
    }
}

fn begin(folder: &Path) -> io::Result<NamedTempFile> {
    for _ in 0..TRIES {
        // 0600, made with O_EXCL, which follows no link.
        let temporary =
            tempfile::Builder::new().prefix(PREFIX).suffix(SUFFIX).rand_bytes(RANDOM).tempfile_in(folder)?;
        let is_ours = match temporary.as_file().try_lock() {
            // Swept between its making and its locking, it has no name any more.
            Ok(()) => temporary.as_file().metadata()?.nlink() > 0,
            Err(TryLockError::WouldBlock) => false,
            // A file system without locks: nobody can sweep there.
            Err(TryLockError::Error(_)) => true,
        };
        if is_ours {
            return Ok(temporary);
        }
    }
    Err(io::Error::other(format!("{}: temporary files are removed as fast as they are made", folder.display())))
}

fn mode_at(path: &Path) -> u32 {
    match fs::symlink_metadata(path) {
        Ok(there) if there.is_file() && there.uid() == me() => there.mode() & 0o777,
        _ => NEW_FILE & !umask(),
    }
}

/// Read, not set and set back: another thread may make a file in between. What cannot be read is taken as the strictest.
fn umask() -> u32 {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("Umask:"));
    mask.and_then(|mask| u32::from_str_radix(mask.trim(), 8).ok()).unwrap_or(0o077)
}
