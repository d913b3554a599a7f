//! Where bytes for a path go: over a name, or into what is open there.

use crate::folder::{Folder, MAX_LINKS, file_type, is_trusted};
use crate::me;
use rustix::fs::{FileType, OFlags, Stat};
use std::ffi::{OsStr, OsString};
use std::fs::{self, File, OpenOptions};
use std::io::{self, Write as _};
use std::os::fd::{AsFd as _, OwnedFd};
use std::os::unix::fs::FileTypeExt as _;
use std::path::{Path, PathBuf};

/// The bit of a folder in which only a file's owner may rename or remove it.
const STICKY: u32 = 0o1000;

/// Permissions of a new file before the umask.
pub(crate) const NEW_FILE: u32 = 0o666;

/// Where bytes for a path go.
#[derive(Debug)]
pub(crate) enum Destination {
    /// Standard output or standard error of this process, by its number.
    Stream(i32),
    /// Written where it is.
    InPlace(InPlace),
    /// A name in a folder: replaced, whatever file or link stands there.
    Replaced { folder: Folder, name: OsString },
}

/// What is not replaced.
#[derive(Debug)]
pub(crate) enum InPlace {
    /// The path of an open file of this process.
    OpenFile(PathBuf),
    /// The name of a pipe or a device.
    Special { folder: Folder, name: OsString },
}

impl Destination {
    pub(crate) fn of(path: &Path) -> io::Result<Destination> {
        if let Some(stream) = own_stream(path) {
            return Ok(stream);
        }
        if fs::metadata(path).is_ok_and(|there| there.is_dir()) {
            return Err(io::ErrorKind::IsADirectory.into());
        }
        let name = path.file_name().ok_or(io::ErrorKind::InvalidInput)?.to_owned();
        let folder = Folder::open(parent(path))?;
        if let Ok(there) = folder.entry(&name) {
            if is_special(there.stat()) {
                return special(folder, name, there.stat());
            }
            if there.is_link()
                && is_trusted(there.stat().st_uid)
                && let Some(in_place) = behind_link(parent(path).join(there.target()?))?
            {
                return Ok(in_place);
            }
            ensure_replaceable(&folder, &name, there.stat())?;
        }
        Ok(Destination::Replaced { folder, name })
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
            Destination::InPlace(InPlace::OpenFile(path)) => OpenOptions::new().append(true).open(path),
            Destination::InPlace(InPlace::Special { folder, name }) => open_special(&folder, &name),
            Destination::Replaced { .. } => Err(io::ErrorKind::InvalidInput.into()),
        }
    }
}

fn open_special(folder: &Folder, name: &OsStr) -> io::Result<File> {
    // With O_CREAT the kernel keeps its protection of pipes in folders that everybody may write (fs.protected_fifos).
    let file = folder.open_file(name, OFlags::WRONLY | OFlags::APPEND | OFlags::CREATE, NEW_FILE)?;
    // What was looked at by its name may have been replaced by a link to a file since.
    let opened = rustix::fs::fstat(&file)?;
    let path = folder.path().join(name);
    if !is_special(&opened) {
        let why = format!("{} has become a file while it was opened; run the command again", path.display());
        return Err(io::Error::new(io::ErrorKind::PermissionDenied, why));
    }
    ensure_trusted(&path, &opened)?;
    Ok(file)
}

/// The folder of a path; that of a bare name is the current one.
pub(crate) fn parent(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// A path that names an open file of a process: `/dev/fd/N`, `/proc/self/fd/N` or `/proc/PID/fd/N`, and nothing that leads elsewhere.
fn is_open_file(path: &Path) -> bool {
    let Some(path) = path.to_str() else { return false };
    let is_number = |part: &str| !part.is_empty() && part.bytes().all(|byte| byte.is_ascii_digit());
    match path.split('/').collect::<Vec<&str>>()[..] {
        ["", "dev", "fd", number] => is_number(number),
        ["", "proc", process, "fd", number] => (process == "self" || is_number(process)) && is_number(number),
        _ => false,
    }
}

fn own_stream(path: &Path) -> Option<Destination> {
    match path.to_str()? {
        "/dev/stdout" | "/dev/fd/1" | "/proc/self/fd/1" => Some(Destination::Stream(1)),
        "/dev/stderr" | "/dev/fd/2" | "/proc/self/fd/2" => Some(Destination::Stream(2)),
        _ => is_open_file(path).then(|| Destination::InPlace(InPlace::OpenFile(path.to_owned()))),
    }
}

fn is_device(there: &Stat) -> bool {
    matches!(file_type(there), FileType::CharacterDevice | FileType::BlockDevice)
}

fn is_special(there: &Stat) -> bool {
    is_device(there) || matches!(file_type(there), FileType::Fifo | FileType::Socket)
}

fn special(folder: Folder, name: OsString, there: &Stat) -> io::Result<Destination> {
    ensure_trusted(&folder.path().join(&name), there)?;
    Ok(Destination::InPlace(InPlace::Special { folder, name }))
}

/// Where the target of a link leads if that is a pipe, a device or an open file of this process. Only links of this user or of root are
/// followed, and only so far.
fn behind_link(target: PathBuf) -> io::Result<Option<Destination>> {
    let mut at = target;
    for _ in 1..MAX_LINKS {
        if let Some(stream) = own_stream(&at) {
            return Ok(Some(stream));
        }
        let Some(name) = at.file_name() else { return Ok(None) };
        let folder = match Folder::open(parent(&at)) {
            Ok(folder) => folder,
            Err(why) => return if names_special(&at) { Err(why) } else { Ok(None) },
        };
        let Ok(there) = folder.entry(name) else { return Ok(None) };
        if is_special(there.stat()) {
            return special(folder, name.to_owned(), there.stat()).map(Some);
        }
        if !there.is_link() || !is_trusted(there.stat().st_uid) {
            return Ok(None);
        }
        at = parent(&at).join(there.target()?);
    }
    Ok(None)
}

/// Whether a pipe or a device is behind a folder that was refused. The link to it is not replaced then.
fn names_special(path: &Path) -> bool {
    fs::symlink_metadata(path).is_ok_and(|there| {
        let kind = there.file_type();
        kind.is_fifo() || kind.is_char_device() || kind.is_block_device() || kind.is_socket()
    })
}

/// That a pipe is this user's or root's: another one's reader would get the output, or hold the command up for ever. A device is the
/// administrator's work, whoever owns it: in a container `/dev/null` is nobody's.
fn ensure_trusted(path: &Path, there: &Stat) -> io::Result<()> {
    if is_trusted(there.st_uid) || is_device(there) {
        return Ok(());
    }
    let (path, uid, me) = (path.display(), there.st_uid, me());
    Err(io::Error::new(
        io::ErrorKind::PermissionDenied,
        format!("{path} is a pipe of user {uid}, and only those of user {me} or root are written; name another path"),
    ))
}

/// That a file of this user may take the place of what stands at `name`.
fn ensure_replaceable(folder: &Folder, name: &OsStr, there: &Stat) -> io::Result<()> {
    let around = folder.stat()?;
    let me = me();
    if around.st_mode & STICKY == 0 || me == 0 || [there.st_uid, around.st_uid].contains(&me) {
        return Ok(());
    }
    let (path, owner) = (folder.path().join(name), there.st_uid);
    Err(io::Error::new(
        io::ErrorKind::PermissionDenied,
        format!(
            "{} belongs to user {owner}, and only that user may replace it in this folder; name another place",
            path.display()
        ),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn opened(path: &Path) -> io::Result<PathBuf> {
        Folder::open(path).map(|folder| folder.path().to_owned())
    }

    #[test]
    fn only_numbers_below_fd_are_open_files() {
        for path in ["/dev/fd/3", "/proc/self/fd/3", "/proc/17/fd/0"] {
            assert!(is_open_file(Path::new(path)), "{path}");
        }
        for path in
            ["/dev/fd/../shm/x", "/proc/../tmp/fd/3", "/proc/self/fd/x", "/proc/self/cwd/fd/3", "/dev/fd/", "fd/3"]
        {
            assert!(!is_open_file(Path::new(path)), "{path}");
        }
    }

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
        assert_eq!(opened(&real.join("link/..")).expect("there"), real.join("a"));
        std::os::unix::fs::symlink("loop", real.join("loop")).expect("a link");
        assert!(opened(&real.join("loop")).expect_err("a loop").to_string().contains("links on the way"));
    }

    #[test]
    fn opens_the_folder_above_the_current_one_and_refuses_a_file() {
        let current = std::env::current_dir().expect("there");
        assert_eq!(opened(Path::new("..")).expect("there"), current.parent().expect("one above"));
        assert_eq!(opened(Path::new("/..")).expect("there"), Path::new("/"));
        let file = tempfile::NamedTempFile::new().expect("a file");
        let why = opened(&file.path().join("..")).expect_err("a file");
        assert_eq!(why.kind(), io::ErrorKind::NotADirectory);
        assert!(why.to_string().contains(&*file.path().to_string_lossy()), "{why}");
    }
}
