//! Removing what killed writers have left.

use crate::folder::{Folder, file_type};
use crate::me;
use rustix::fs::{FileType, OFlags, Stat};
use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::fs::File;
use std::io;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

/// A draft's name is this, random letters, and [`SUFFIX`].
pub(crate) const PREFIX: &str = ".rivet-";
/// How the name of a draft ends.
pub(crate) const SUFFIX: &str = ".part";
/// Random letters and digits in a draft's name: 62^12, beyond guessing.
pub(crate) const RANDOM: usize = 12;

/// Folders that this process has swept: device and inode.
static SWEPT: Mutex<BTreeSet<(u64, u64)>> = Mutex::new(BTreeSet::new());

pub(crate) fn sweep_once(folder: &Folder) {
    let Ok(there) = folder.stat() else { return };
    let is_first = SWEPT.lock().unwrap_or_else(PoisonError::into_inner).insert((there.st_dev, there.st_ino));
    if is_first {
        sweep_opened(folder);
    }
}

/// Removes temporary files of this user that killed writers have left in `folder`, and returns how many. A file that a living writer
/// holds stays, and so does everything else. A folder behind a link of another user is left alone.
pub fn sweep(folder: &Path) -> usize {
    Folder::open(folder).map_or(0, |folder| sweep_opened(&folder))
}

fn sweep_opened(folder: &Folder) -> usize {
    let names = folder.names().into_iter().flatten();
    names.filter(|name| is_draft(name.as_encoded_bytes()) && remove_abandoned(folder, name)).count()
}

fn is_draft(name: &[u8]) -> bool {
    let random = name.strip_prefix(PREFIX.as_bytes()).and_then(|rest| rest.strip_suffix(SUFFIX.as_bytes()));
    random.is_some_and(|random| random.len() == RANDOM && random.iter().all(u8::is_ascii_alphanumeric))
}

fn is_own_file(there: &Stat) -> bool {
    file_type(there) == FileType::RegularFile && there.st_uid == me()
}

/// Whether it was abandoned and is gone. What cannot be opened or removed stays: it hurts nobody.
fn remove_abandoned(folder: &Folder, name: &OsStr) -> bool {
    let open = || -> io::Result<File> {
        // Asked before it is opened as well: to open a device can be felt.
        if !is_own_file(folder.entry(name)?.stat()) {
            return Err(io::ErrorKind::PermissionDenied.into());
        }
        folder.open_file(name, OFlags::RDONLY | OFlags::NONBLOCK, 0)
    };
    let Ok(file) = open() else { return false };
    // Held to the end: a writer that makes a file of this name at this moment sees that it has been taken.
    rustix::fs::fstat(&file).is_ok_and(|there| is_own_file(&there))
        && file.try_lock().is_ok()
        && folder.remove_file(name).is_ok()
}
