//! Files that are whole or as they were, and that never land where somebody else's link leads.
//!
//! A regular file is written under an unpredictable name in the same folder and renamed over the name that was given. A link that
//! stands there is replaced; what it leads to is not touched. Pipes and devices are written in place.
//!
//! The folder is opened once, component by component. All that follows uses its descriptor. `/proc` is not needed for this.

mod content;
mod destination;
mod draft;
mod folder;
mod lock;
mod printable;
mod status_line;
mod sweep;

pub use content::Content;
use destination::Destination;
pub use draft::Draft;
use folder::Folder;
pub use lock::open_lock;
pub use printable::{
    Printable, arguments_are_printable, is_unsafe, note, note_after, print, printable, printable_json,
};
use rustix::fs::OFlags;
pub use status_line::StatusLine;
use std::fs::{self, File};
use std::io::{self, Read as _, Write as _};
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
pub use sweep::sweep;

/// What files with measured or simulated numbers state about them: an array of text, an attribute, or a comment of a text table.
/// Whoever reads such a file does not apply the signs, scales and zeros of a robot file.
pub const CONVENTIONS_OF_THE_MODEL: &str = "SI units, signs and zeros of the model";

/// Writes `bytes` to `path`, so that a file there is whole or as it was. A pipe or a device is written in place.
///
/// # Errors
/// It cannot be written, or a link of another user is on the way to its folder.
pub fn write_whole(path: &Path, bytes: impl AsRef<[u8]>) -> io::Result<()> {
    fill_whole(path, |file| {
        file.write_all(bytes.as_ref())?;
        // A device or a pipe has nothing to be brought to a disk.
        if file.metadata()?.is_file() { file.sync_all() } else { Ok(()) }
    })
}

/// The same for what `fill` writes to the file that it gets.
///
/// # Errors
/// As [`write_whole`], and those of `fill`.
pub fn fill_whole<E: From<io::Error>>(path: &Path, fill: impl FnOnce(&mut File) -> Result<(), E>) -> Result<(), E> {
    match Destination::of(path)? {
        Destination::Replaced { folder, name } => {
            let mut draft = Draft::in_folder(folder, name)?;
            fill(draft.file())?;
            draft.publish()?;
            Ok(())
        }
        in_place => fill(&mut in_place.open()?),
    }
}

/// Makes a file that grows where it is, such as a recording. Nothing stands there before: neither a file nor a link is followed or
/// replaced.
///
/// # Errors
/// Something of that name is there ([`io::ErrorKind::AlreadyExists`]), a link of another user is on the way to its folder, or it
/// cannot be made.
pub fn create_new(path: &Path) -> io::Result<File> {
    let name = path.file_name().ok_or(io::ErrorKind::InvalidInput)?;
    let flags = OFlags::WRONLY | OFlags::CREATE | OFlags::EXCL;
    Folder::open(destination::parent(path))?.open_file(name, flags, destination::NEW_FILE)
}

/// That a path leads to a regular file: a reader of a pipe or a device might wait for ever.
///
/// # Errors
/// It leads to nothing, or to something else, which the error names.
pub fn ensure_regular(path: &Path) -> io::Result<fs::Metadata> {
    let what = fs::metadata(path)?;
    let unfit = |why: &str| Err(io::Error::new(io::ErrorKind::InvalidInput, why));
    if what.is_dir() {
        return unfit("it is a folder");
    }
    if !what.is_file() {
        return unfit("it is a pipe or a device, not a file");
    }
    Ok(what)
}

/// A file, whole. Of a pipe or a device a reader might wait for ever, which a service must not.
///
/// # Errors
/// It cannot be read, is no regular file, or has more than `largest` bytes.
pub fn read_whole(path: &Path, largest: u64) -> io::Result<Vec<u8>> {
    let what = ensure_regular(path)?;
    let too_long = |bytes: u64| {
        let why = format!("it has {bytes} bytes; at most {largest} are allowed");
        Err(io::Error::new(io::ErrorKind::InvalidInput, why))
    };
    if what.len() > largest {
        return too_long(what.len());
    }
    // A file of /proc has no length of its own, and one that grows has another one by now.
    let mut bytes = Vec::with_capacity(what.len().min(largest) as usize);
    File::open(path)?.take(largest.saturating_add(1)).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > largest {
        return too_long(bytes.len() as u64);
    }
    Ok(bytes)
}

/// The same of text.
///
/// # Errors
/// As [`read_whole`], and of text that is not UTF-8.
pub fn read_text(path: &Path, largest: u64) -> io::Result<String> {
    let bytes = read_whole(path, largest)?;
    String::from_utf8(bytes).map_err(|_| io::Error::new(io::ErrorKind::InvalidData, "it is not UTF-8 text"))
}

/// That [`write_whole`] can write there: asked before what takes long. Leaves nothing behind and opens no pipe.
///
/// # Errors
/// Why it cannot.
pub fn writable(path: &Path) -> io::Result<()> {
    match Destination::of(path)? {
        Destination::Replaced { folder, name } => Draft::in_folder(folder, name).map(drop),
        Destination::Stream(_) | Destination::InPlace(_) => Ok(()),
    }
}

/// That files can be written into a folder, which need not be there yet: asked before what takes long. Makes nothing.
///
/// # Errors
/// Why they cannot.
pub fn writable_folder(folder: &Path) -> io::Result<()> {
    let there =
        folder.ancestors().map(|a| if a.as_os_str().is_empty() { Path::new(".") } else { a }).find(|a| a.exists());
    match there {
        Some(there) if there.is_dir() => writable(&there.join("probe")),
        _ => Err(io::ErrorKind::NotADirectory.into()),
    }
}

/// Permission of all others to write.
const OTHERS_WRITE: u32 = 0o002;
/// In a folder with this bit nobody but a file's owner, the folder's owner and root renames or removes it.
const STICKY: u32 = 0o1000;

/// That nobody else decides what a folder holds: it belongs to this user or to root, and others may write there only under the sticky bit.
///
/// # Errors
/// Whose it is or who may write there, and what to do.
pub fn ensure_guarded(folder: &Path) -> io::Result<()> {
    let there = fs::metadata(folder)?;
    let refuse = |why: String| Err(io::Error::new(io::ErrorKind::InvalidInput, why));
    let (owner, mode) = (there.uid(), there.mode() & 0o7777);
    if owner != me() && owner != 0 {
        return refuse(format!(
            "it belongs to user {owner}, and this program runs as user {}; name another folder",
            me()
        ));
    }
    if mode & OTHERS_WRITE != 0 && mode & STICKY == 0 {
        return refuse(format!("others can write there (mode {mode:o}); use: chmod o-w {}", folder.display()));
    }
    Ok(())
}

/// That a folder has room for a file of so many bytes: writes them to a temporary file, which is gone afterwards.
///
/// # Errors
/// The folder is missing, cannot be written or is full.
pub fn has_room(folder: &Path, bytes: usize) -> io::Result<()> {
    Draft::new(&folder.join("probe"))?.file().write_all(&vec![0; bytes])
}

/// An absolute path of a folder without links and `..`.
///
/// # Errors
/// It is not there, or a link on the way belongs neither to this user nor to root.
pub fn resolve_folder(folder: &Path) -> io::Result<PathBuf> {
    Folder::open(folder).map(|opened| opened.path().to_owned())
}

/// Number of the user whose rights this process has.
fn me() -> u32 {
    rustix::process::geteuid().as_raw()
}
