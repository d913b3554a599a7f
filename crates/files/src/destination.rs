//! Where bytes for a path go: over a name, or into what is open there.

use crate::me;
use std::fs::{self, File, Metadata, OpenOptions};
use std::io::{self, Write as _};
use std::os::fd::{AsFd as _, OwnedFd};
use std::os::unix::fs::{FileTypeExt as _, MetadataExt as _, OpenOptionsExt as _};
use std::path::{Component, Path, PathBuf};

/// As many links as Linux follows.
const MAX_LINKS: usize = 40;

/// The bit of a folder in which only a file's owner may rename or remove it.
const STICKY: u32 = 0o1000;

/// Where bytes for a path go.
#[derive(Debug)]
pub(crate) enum Destination {
    /// Standard output or standard error of this process, by its number.
    Stream(i32),
    /// A pipe or a device, or an open file of this process: written where it is.
    InPlace(PathBuf),
    /// A name in a folder: replaced, whatever file or link stands there. Both paths are free of links of other users.
    Replaced { folder: PathBuf, path: PathBuf },
}

impl Destination {
    pub(crate) fn of(path: &Path) -> io::Result<Destination> {
        if let Some(in_place) = in_place(path)? {
            return Ok(in_place);
        }
        if fs::metadata(path).is_ok_and(|there| there.is_dir()) {
            return Err(io::ErrorKind::IsADirectory.into());
        }
        let name = path.file_name().ok_or(io::ErrorKind::InvalidInput)?;
        let folder = resolved_folder(parent(path))?;
        let path = folder.join(name);
        ensure_replaceable(&folder, &path)?;
        Ok(Destination::Replaced { folder, path })
    }

    /// Opens what is written in place.
    pub(crate) fn open(self) -> io::Result<File> {
        let stream = |opened: io::Result<OwnedFd>| opened.map(File::from);
        match self {
            Destination::Stream(1) => {
                io::stdout().flush()?;
                stream(io::stdout().as_fd().try_clone_to_owned())
            }
            Destination::Stream(_) => stream(io::stderr().as_fd().try_clone_to_owned()),
            Destination::InPlace(path) => {
                // With O_CREAT the kernel keeps its protection of pipes in folders that everybody may write (fs.protected_fifos).
                let no_follow = if is_open_file(&path) { 0 } else { rustix::fs::OFlags::NOFOLLOW.bits() };
                let create = !is_open_file(&path);
                let file =
                    OpenOptions::new().append(true).create(create).custom_flags(no_follow.cast_signed()).open(&path)?;
                // What was looked at by its name may have been replaced by a link to a file since.
                let opened = file.metadata()?;
                if create && !is_special(&opened) {
                    let why =
                        format!("{} has become a file while it was opened; run the command again", path.display());
                    return Err(io::Error::new(io::ErrorKind::PermissionDenied, why));
                }
                if create {
                    ensure_trusted(&path, &opened)?;
                }
                Ok(file)
            }
            Destination::Replaced { .. } => Err(io::ErrorKind::InvalidInput.into()),
        }
    }
}

/// The folder of a path; that of a bare name is the current one.
fn parent(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// A path that names an open file of this process.
fn is_open_file(path: &Path) -> bool {
    path.starts_with("/dev/fd") || (path.starts_with("/proc") && parent(path).ends_with("fd"))
}

fn own_stream(path: &Path) -> Option<Destination> {
    match path.to_str()? {
        "/dev/stdout" | "/dev/fd/1" | "/proc/self/fd/1" => Some(Destination::Stream(1)),
        "/dev/stderr" | "/dev/fd/2" | "/proc/self/fd/2" => Some(Destination::Stream(2)),
        _ => is_open_file(path).then(|| Destination::InPlace(path.to_owned())),
    }
}

fn is_special(there: &Metadata) -> bool {
    let kind = there.file_type();
    kind.is_fifo() || kind.is_char_device() || kind.is_block_device() || kind.is_socket()
}

/// Where a path leads if that is a pipe, a device or an open file of this process. Only links of this user or of root are followed,
/// and only so far.
fn in_place(path: &Path) -> io::Result<Option<Destination>> {
    let mut at = path.to_owned();
    for _ in 0..MAX_LINKS {
        if let Some(stream) = own_stream(&at) {
            return Ok(Some(stream));
        }
        let Ok(there) = fs::symlink_metadata(&at) else { return Ok(None) };
        if is_special(&there) {
            let Some(name) = at.file_name() else { return Ok(None) };
            ensure_trusted(&at, &there)?;
            return Ok(Some(Destination::InPlace(resolved_folder(parent(&at))?.join(name))));
        }
        if !there.is_symlink() || !is_trusted(there.uid()) {
            return Ok(None);
        }
        at = parent(&at).join(fs::read_link(&at)?);
    }
    Ok(None)
}

/// That a pipe is this user's or root's: another one's reader would get the output, or hold the command up for ever. A device is the
/// administrator's work, whoever owns it: in a container `/dev/null` is nobody's.
fn ensure_trusted(path: &Path, there: &Metadata) -> io::Result<()> {
    let kind = there.file_type();
    if is_trusted(there.uid()) || kind.is_char_device() || kind.is_block_device() {
        return Ok(());
    }
    let (path, uid, me) = (path.display(), there.uid(), me());
    Err(io::Error::new(
        io::ErrorKind::PermissionDenied,
        format!("{path} is a pipe of user {uid}, and only those of user {me} or root are written; name another path"),
    ))
}

fn is_trusted(uid: u32) -> bool {
    uid == 0 || uid == me()
}

/// The folder without links. A link of another user on the way is refused: it can lead elsewhere at any time.
pub(crate) fn resolved_folder(folder: &Path) -> io::Result<PathBuf> {
    let mut resolved = if folder.is_absolute() { PathBuf::from("/") } else { std::env::current_dir()? };
    let mut waiting: Vec<PathBuf> = components_backwards(folder);
    let mut links = 0;
    while let Some(next) = waiting.pop() {
        if next == Path::new("..") {
            resolved.pop();
            continue;
        }
        let at = resolved.join(&next);
        let Ok(there) = fs::symlink_metadata(&at) else {
            let missing = folder.display();
            return Err(io::Error::new(io::ErrorKind::NotFound, format!("there is no folder {missing}")));
        };
        if !there.is_symlink() {
            resolved = at;
            continue;
        }
        links += 1;
        if links > MAX_LINKS {
            return Err(io::Error::other(format!("{}: more than {MAX_LINKS} links on the way", folder.display())));
        }
        if !is_trusted(there.uid()) {
            return Err(foreign_link(&at, there.uid()));
        }
        let target = fs::read_link(&at)?;
        if target.is_absolute() {
            resolved = PathBuf::from("/");
        }
        waiting.extend(components_backwards(&target));
    }
    Ok(resolved)
}

fn components_backwards(path: &Path) -> Vec<PathBuf> {
    let named = |component: Component| matches!(component, Component::Normal(_) | Component::ParentDir);
    path.components().rev().filter(|c| named(*c)).map(|c| PathBuf::from(c.as_os_str())).collect()
}

fn foreign_link(link: &Path, uid: u32) -> io::Error {
    let (link, me) = (link.display(), me());
    io::Error::new(
        io::ErrorKind::PermissionDenied,
        format!(
            "{link} is a link of user {uid}, and only links of user {me} or root are followed; name a path without it"
        ),
    )
}

/// That a file of this user may take the place of what stands at `path`.
fn ensure_replaceable(folder: &Path, path: &Path) -> io::Result<()> {
    let Ok(there) = fs::symlink_metadata(path) else { return Ok(()) };
    let around = fs::metadata(folder)?;
    let me = me();
    if around.mode() & STICKY == 0 || me == 0 || [there.uid(), around.uid()].contains(&me) {
        return Ok(());
    }
    let (path, owner) = (path.display(), there.uid());
    Err(io::Error::new(
        io::ErrorKind::PermissionDenied,
        format!("{path} belongs to user {owner}, and only that user may replace it in this folder; name another place"),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn standard_streams_and_open_files_are_written_in_place() {
        assert!(matches!(Destination::of(Path::new("/dev/stdout")), Ok(Destination::Stream(1))));
        assert!(matches!(Destination::of(Path::new("/proc/self/fd/2")), Ok(Destination::Stream(2))));
        assert!(matches!(Destination::of(Path::new("/dev/fd/63")), Ok(Destination::InPlace(_))));
        assert!(matches!(Destination::of(Path::new("/dev/null")), Ok(Destination::InPlace(_))));
    }

    #[test]
    fn a_folder_is_resolved_through_own_links_and_parents() {
        let folder = tempfile::tempdir().expect("a folder");
        let real = folder.path().canonicalize().expect("there");
        fs::create_dir_all(real.join("a/b")).expect("made");
        std::os::unix::fs::symlink("a/../a/b", real.join("link")).expect("a link");
        assert_eq!(resolved_folder(&real.join("link/..")).expect("there"), real.join("a"));
        std::os::unix::fs::symlink("loop", real.join("loop")).expect("a link");
        assert!(resolved_folder(&real.join("loop")).expect_err("a loop").to_string().contains("links on the way"));
    }
}
