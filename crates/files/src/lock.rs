//! Files that are locked, and nothing else.

use crate::destination::parent;
use crate::folder::Folder;
use crate::me;
use rustix::fs::OFlags;
use std::fs::{File, Permissions};
use std::io;
use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _};
use std::path::Path;

/// Permissions of a lock: whoever can open it can hold it.
const CLOSED: u32 = 0o600;

/// Opens or makes a file to be locked, closed to other users. A link is refused; a lock that an older program left open to others is
/// closed to them.
///
/// # Errors
/// It is a link, another user's or no file, or cannot be made. A link of another user is on the way.
pub fn open_lock(path: &Path) -> io::Result<File> {
    let name = path.file_name().ok_or(io::ErrorKind::InvalidInput)?;
    let flags = OFlags::RDWR | OFlags::CREATE | OFlags::NONBLOCK;
    let folder = Folder::open(parent(path))?;
    let file = folder.open_file(name, flags, CLOSED).map_err(|why| match folder.entry(name) {
        Ok(there) if there.is_link() => {
            let why = format!(
                "it is a symbolic link of user {}, and a lock is no link; remove it: rm {}",
                there.stat().st_uid,
                path.display()
            );
            io::Error::new(io::ErrorKind::InvalidInput, why)
        }
        _ => why,
    })?;
    let there = file.metadata()?;
    if !there.is_file() || there.uid() != me() {
        let why = format!("it must be a file of user {}, and user {} owns it; remove it", me(), there.uid());
        return Err(io::Error::new(io::ErrorKind::PermissionDenied, why));
    }
    if there.mode() & 0o777 != CLOSED {
        file.set_permissions(Permissions::from_mode(CLOSED))?;
    }
    Ok(file)
}
