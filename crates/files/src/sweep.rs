//! Removing what killed writers have left.

use crate::draft::{PREFIX, RANDOM, SUFFIX};
use crate::me;
use std::collections::BTreeSet;
use std::fs::{self, File, Metadata};
use std::io;
use std::os::unix::fs::{MetadataExt as _, OpenOptionsExt as _};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// Folders that this process has swept.
static SWEPT: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

pub(crate) fn sweep_once(folder: &Path) {
    let is_first = SWEPT.lock().unwrap_or_else(PoisonError::into_inner).insert(folder.to_owned());
    if is_first {
        sweep(folder);
    }
}

/// Removes temporary files of this user that killed writers have left in `folder`, and returns how many. A file that a living writer
/// holds stays, and so does everything else.
pub fn sweep(folder: &Path) -> usize {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries.filter(|entry| is_draft(entry.file_name().as_encoded_bytes()) && remove_abandoned(&entry.path())).count()
}

fn is_draft(name: &[u8]) -> bool {
    let random = name.strip_prefix(PREFIX.as_bytes()).and_then(|rest| rest.strip_suffix(SUFFIX.as_bytes()));
    random.is_some_and(|random| random.len() == RANDOM && random.iter().all(u8::is_ascii_alphanumeric))
}

fn is_own_file(there: &Metadata) -> bool {
    there.is_file() && there.uid() == me()
}

/// Whether it was abandoned and is gone. What cannot be opened or removed stays: it hurts nobody.
fn remove_abandoned(path: &Path) -> bool {
    let open = || -> io::Result<File> {
        // Asked before it is opened as well: to open a device can be felt.
        if !is_own_file(&fs::symlink_metadata(path)?) {
            return Err(io::ErrorKind::PermissionDenied.into());
        }
        let flags = (rustix::fs::OFlags::NOFOLLOW | rustix::fs::OFlags::NONBLOCK).bits();
        File::options().read(true).custom_flags(flags.cast_signed()).open(path)
    };
    let Ok(file) = open() else { return false };
    // Held to the end: a writer that makes a file of this name at this moment sees that it has been taken.
    file.metadata().is_ok_and(|there| is_own_file(&there)) && file.try_lock().is_ok() && fs::remove_file(path).is_ok()
}
