//! A file under way: written beside its place, then renamed over it.

use crate::destination::{Destination, NEW_FILE};
use crate::folder::{Folder, file_type};
use crate::me;
use crate::sweep::{PREFIX, RANDOM, SUFFIX, sweep_once};
use rustix::fs::{FileType, OFlags};
use std::ffi::{OsStr, OsString};
use std::fs::{self, File, Permissions, TryLockError};
use std::io;
use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _};
use std::path::Path;

/// Tries for a draft that nobody takes for an abandoned one between its making and its locking.
const TRIES: usize = 8;

/// Permissions of a file under way.
const CLOSED: u32 = 0o600;

/// A file under way: gone when dropped, in its place when published. A lock on it shows that its writer lives.
#[derive(Debug)]
pub struct Draft {
    // Dropped before the file: its name goes while it is locked.
    temporary: Temporary,
    file: File,
    name: OsString,
    mode: Option<u32>,
}

/// The name of a file under way, removed when dropped.
#[derive(Debug)]
struct Temporary {
    folder: Folder,
    /// None once it is published.
    name: Option<OsString>,
}

impl Drop for Temporary {
    fn drop(&mut self) {
        if let Some(name) = &self.name {
            // What cannot be removed is swept later.
            let _ = self.folder.remove_file(name);
        }
    }
}

impl Draft {
    /// Begins a file for `path`, in the same folder. The first one in a folder removes what killed writers have left there.
    ///
    /// # Errors
    /// The folder is missing or cannot be written, another user's link is on the way, or what is there may not be replaced. A pipe
    /// or a device has no draft.
    pub fn new(path: &Path) -> io::Result<Draft> {
        let Destination::Replaced { folder, name } = Destination::of(path)? else {
            let why = format!("{} is a pipe or a device, which has no draft", path.display());
            return Err(io::Error::new(io::ErrorKind::InvalidInput, why));
        };
        Draft::in_folder(folder, name)
    }

    pub(crate) fn in_folder(folder: Folder, name: OsString) -> io::Result<Draft> {
        sweep_once(&folder);
        let (file, temporary) = begin(&folder)?;
        Ok(Draft { temporary: Temporary { folder, name: Some(temporary) }, file, name, mode: None })
    }

    /// What is written to.
    pub fn file(&mut self) -> &mut File {
        &mut self.file
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
    pub fn publish(mut self) -> io::Result<File> {
        let folder = &self.temporary.folder;
        let mode = self.mode.unwrap_or_else(|| mode_at(folder, &self.name));
        self.file.set_permissions(Permissions::from_mode(mode))?;
        if let Some(temporary) = &self.temporary.name {
            folder.rename(temporary, &self.name)?;
        }
        self.temporary.name = None;
        // Nobody sweeps it under this name, and whoever gets it may want to lock it.
        drop(self.file.unlock());
        Ok(self.file)
    }
}

/// Makes a file under an unpredictable name and locks it. Returns it with the name.
fn begin(folder: &Folder) -> io::Result<(File, OsString)> {
    for _ in 0..TRIES {
        let (file, name) = make(folder)?;
        let is_ours = match file.try_lock() {
            // Swept between its making and its locking, it has no name any more.
            Ok(()) => file.metadata()?.nlink() > 0,
            Err(TryLockError::WouldBlock) => false,
            // A file system without locks: nobody can sweep there.
            Err(TryLockError::Error(_)) => true,
        };
        if is_ours {
            return Ok((file, name));
        }
        // Who holds the lock is about to remove it.
        let _ = folder.remove_file(&name);
    }
    Err(io::Error::other(format!("{}: temporary files are removed as fast as they are made", folder.path().display())))
}

/// `tempfile` chooses the name and tries again where one is taken. It does not open or remove anything by a path.
fn make(folder: &Folder) -> io::Result<(File, OsString)> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(PREFIX).suffix(SUFFIX).rand_bytes(RANDOM).disable_cleanup(true);
    // The folder is that of the descriptor. This one only keeps `tempfile` from asking for the current one.
    let made = builder.make_in("/", |path| {
        let name = path.file_name().unwrap_or_default();
        let flags = OFlags::RDWR | OFlags::CREATE | OFlags::EXCL;
        Ok((folder.open_file(name, flags, CLOSED)?, name.to_owned()))
    });
    let in_folder = |why: io::Error| io::Error::new(why.kind(), format!("{}: {why}", folder.path().display()));
    Ok(made.map_err(in_folder)?.into_parts().0)
}

fn mode_at(folder: &Folder, name: &OsStr) -> u32 {
    let is_own = |stat: &rustix::fs::Stat| file_type(stat) == FileType::RegularFile && stat.st_uid == me();
    match folder.entry(name) {
        Ok(there) if is_own(there.stat()) => there.stat().st_mode & 0o777,
        _ => NEW_FILE & !umask(),
    }
}

/// Read, not set and set back: another thread may make a file in between. What cannot be read is taken as the strictest.
fn umask() -> u32 {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("Umask:"));
    mask.and_then(|mask| u32::from_str_radix(mask.trim(), 8).ok()).unwrap_or(0o077)
}
