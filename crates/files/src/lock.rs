//! Files that are locked, and nothing else.

use crate::me;
use std::fs::{File, Permissions};
use std::io;
use std::os::unix::fs::{MetadataExt as _, OpenOptionsExt as _, PermissionsExt as _};
use std::path::Path;

/// Permissions of a lock: whoever can open it can hold it.
const CLOSED: u32 = 0o600;

/// Opens or makes a file to be locked, closed to other users. A link is refused; a lock that an older program left open to others is
/// closed to them.
///
/// # Errors
/// It is a link, another user's or no file, or cannot be made.
pub fn open_lock(path: &Path) -> io::Result<File> {
    let flags = (rustix::fs::OFlags::NOFOLLOW | rustix::fs::OFlags::NONBLOCK).bits();
    let mut options = File::options();
    options.create(true).truncate(false).read(true).write(true).mode(CLOSED).custom_flags(flags.cast_signed());
    let file = options.open(path)?;
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
