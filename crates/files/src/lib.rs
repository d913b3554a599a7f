//! Files that are whole or as they were.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

mod printable;

pub use printable::{Printable, is_unsafe, printable};

/// Where bytes meant for `path` go: the file that it links to, if it is a link.
fn target(path: &Path) -> PathBuf {
    let mut at = path.to_owned();
    // As many links as Linux follows.
    for _ in 0..40 {
        let Ok(next) = fs::read_link(&at) else { break };
        at = at.parent().map_or_else(|| next.clone(), |folder| folder.join(&next));
    }
    at
}

/// Whether something stands at `path` that is no file: a pipe, a terminal, `/dev/null`, and what `/dev/stdout` leads to. It is written to,
/// never replaced.
fn is_special(path: &Path) -> bool {
    fs::metadata(path).is_ok_and(|there| !there.is_file() && !there.is_dir())
}

/// Beside `path`, of this process.
fn beside(path: &Path) -> PathBuf {
    let mut temporary = path.as_os_str().to_owned();
    temporary.push(format!(".{}.part", std::process::id()));
    PathBuf::from(temporary)
}

/// Writes `bytes` beside `path` and renames, so that the file there is whole or as it was. What a link points to is replaced, not the
/// link; a pipe or a device is written to.
pub fn write_whole(path: &Path, bytes: impl AsRef<[u8]>) -> io::Result<()> {
    fill_whole(path, |part| {
        let mut file = OpenOptions::new().write(true).create(true).truncate(true).open(part)?;
        file.write_all(bytes.as_ref())?;
        // A device or a pipe has nothing to be brought to a disk.
        if file.metadata()?.is_file() { file.sync_all() } else { Ok(()) }
    })
}

/// The same for what `fill` writes to the path that it is given.
pub fn fill_whole<E: From<io::Error>>(path: &Path, fill: impl FnOnce(&Path) -> Result<(), E>) -> Result<(), E> {
    // Links of a process to its pipes lead to no path, so they are not followed here.
    if is_special(path) {
        return fill(path);
    }
    let path = target(path);
    let temporary = beside(&path);
    let written = fill(&temporary).and_then(|()| fs::rename(&temporary, &path).map_err(E::from));
    if written.is_err() {
        // The first error is the one to report; a file that was never made cannot be removed either.
        let _ = fs::remove_file(&temporary);
    }
    written
}

/// That [`write_whole`] can write there: asked before what takes long.
pub fn writable(path: &Path) -> io::Result<()> {
    if is_special(path) {
        return Ok(());
    }
    let path = target(path);
    if path.is_dir() {
        return Err(io::ErrorKind::IsADirectory.into());
    }
    if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty() && !folder.exists()) {
        let why = format!("there is no folder {}", folder.display());
        return Err(io::Error::new(io::ErrorKind::NotFound, why));
    }
    let probe = beside(&path);
    File::create(&probe).and_then(|_| fs::remove_file(&probe))
}

/// That files can be written into a folder, which need not be there yet: asked before what takes long. Makes nothing.
pub fn writable_folder(folder: &Path) -> io::Result<()> {
    let there =
        folder.ancestors().map(|a| if a.as_os_str().is_empty() { Path::new(".") } else { a }).find(|a| a.exists());
    match there {
        Some(there) if there.is_dir() => writable(&there.join("probe")),
        _ => Err(io::ErrorKind::NotADirectory.into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_asked_before_it_is_made() {
        let folder = tempfile::tempdir().expect("a folder");
        let (file, deep) = (folder.path().join("file"), folder.path().join("a/b/c"));
        fs::write(&file, "text").expect("written");
        assert!(writable_folder(folder.path()).is_ok() && writable_folder(&deep).is_ok());
        for no in [file.clone(), file.join("a"), PathBuf::from("/proc/x/y")] {
            assert!(writable_folder(&no).is_err(), "{}", no.display());
        }
        let names: Vec<_> = fs::read_dir(folder.path()).expect("there").flatten().map(|e| e.file_name()).collect();
        assert_eq!(names, ["file"], "nothing was made");
    }

    #[test]
    fn a_link_stays_one_and_what_it_points_to_is_replaced() {
        let folder = tempfile::tempdir().expect("a folder");
        let (file, link) = (folder.path().join("file"), folder.path().join("link"));
        std::os::unix::fs::symlink("file", &link).expect("a link");
        for text in ["first", "second"] {
            writable(&link).and_then(|()| write_whole(&link, text)).expect("written");
            assert_eq!(fs::read_to_string(&file).expect("there"), text);
        }
        assert!(fs::symlink_metadata(&link).expect("there").is_symlink());
        assert_eq!(fs::read_dir(folder.path()).expect("listed").count(), 2);
    }

    #[test]
    fn a_pipe_is_written_to() {
        let folder = tempfile::tempdir().expect("a folder");
        let pipe = folder.path().join("pipe");
        let made = std::process::Command::new("mkfifo").arg(&pipe).status();
        if !made.is_ok_and(|status| status.success()) {
            return;
        }
        let reader = std::thread::spawn({
            let pipe = pipe.clone();
            move || fs::read_to_string(pipe).expect("read")
        });
        writable(&pipe).and_then(|()| write_whole(&pipe, "through")).expect("written");
        assert_eq!(reader.join().expect("ended"), "through");
        assert!(is_special(&pipe));
    }

    #[test]
    fn a_folder_that_is_not_there_is_named() {
        let folder = tempfile::tempdir().expect("a folder");
        let why = writable(&folder.path().join("no/report.json")).expect_err("no folder").to_string();
        assert_eq!(why, format!("there is no folder {}", folder.path().join("no").display()));
        assert!(writable(Path::new("report.json")).is_ok(), "a bare name has a folder");
    }

    #[test]
    fn what_fails_leaves_what_was_there() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("file");
        write_whole(&file, "old").expect("written");
        let failed = fill_whole(&file, |part| fs::write(part, "new").and(Err(io::Error::other("full"))));
        assert!(failed.is_err() && fs::read_to_string(&file).expect("there") == "old");
        assert_eq!(fs::read_dir(folder.path()).expect("listed").count(), 1);
    }
}
