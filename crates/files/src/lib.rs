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

/// A file, whole. Of a pipe or a device a reader might wait for ever, which a service must not.
///
/// # Errors
/// It cannot be read, is no regular file, or has more than `largest` bytes.
pub fn read_whole(path: &Path, largest: u64) -> io::Result<Vec<u8>> {
    let what = fs::metadata(path)?;
    let unfit = |why: String| -> io::Result<Vec<u8>> { Err(io::Error::new(io::ErrorKind::InvalidInput, why)) };
    if what.is_dir() {
        return unfit("it is a folder".to_owned());
    }
    if !what.is_file() {
        return unfit("it is a pipe or a device, not a file".to_owned());
    }
    let too_long = |bytes: u64| unfit(format!("it has {bytes} bytes; at most {largest} are allowed"));
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
