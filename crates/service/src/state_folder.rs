//! Whether the state folder can be written: asked now and then, so that it is known before something has to be stored.

use rivet_files::has_room;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Time between two questions.
const INTERVAL: Duration = Duration::from_secs(5);

/// Room that is asked for \[bytes\]: a flight record of a small arm, or the parameters of a large one.
const ROOM: usize = 64 << 10;

/// Whether a folder can be written, the worst last.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Storage {
    /// It can.
    Writable,
    /// It has no room.
    Full,
    /// It is missing or cannot be written.
    Unwritable,
}

impl Storage {
    /// What an attempt to write says.
    pub fn after<T>(attempt: &io::Result<T>) -> Storage {
        match attempt {
            Ok(_) => Storage::Writable,
            Err(why) => Storage::because(why),
        }
    }

    /// What an error says of the folder.
    pub fn because(why: &io::Error) -> Storage {
        match why.kind() {
            io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded | io::ErrorKind::FileTooLarge => Storage::Full,
            _ => Storage::Unwritable,
        }
    }
}

/// Looks after one state folder.
#[derive(Debug)]
pub struct StateFolder {
    folder: PathBuf,
    due: Option<Instant>,
    probed: Storage,
    written: Storage,
}

impl StateFolder {
    /// Of a folder that is made when it is absent.
    pub fn new(folder: &Path) -> StateFolder {
        StateFolder { folder: folder.to_owned(), due: None, probed: Storage::Writable, written: Storage::Writable }
    }

    /// Takes in how storing something ended. What failed stays known until something has been stored.
    pub fn note(&mut self, written: Storage) {
        self.written = written;
    }

    /// Tries the folder when it is due, and returns the worse of that and of what was stored last. A change is logged. Not for a
    /// real-time thread.
    pub fn look(&mut self, now: Instant) -> Storage {
        if self.due.is_none_or(|due| now >= due) {
            self.due = Some(now + INTERVAL);
            let tried = fs::create_dir_all(&self.folder).and_then(|()| has_room(&self.folder, ROOM));
            let probed = Storage::after(&tried);
            let folder = self.folder.display();
            match tried {
                Err(why) if probed != self.probed => {
                    log::error!(rivet_event = "state-unwritable"; "state folder {folder}: {why}; nothing can be stored or recorded");
                }
                Ok(()) if probed != self.probed => {
                    log::info!(rivet_event = "state-writable"; "state folder {folder} can be written again");
                }
                Ok(()) | Err(_) => {}
            }
            self.probed = probed;
        }
        self.probed.max(self.written)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_that_is_in_the_way_is_noticed_and_got_over() {
        let place = tempfile::tempdir().expect("a folder");
        let folder = place.path().join("state");
        let begin = Instant::now();
        let mut state = StateFolder::new(&folder);
        assert_eq!(state.look(begin), Storage::Writable);
        fs::remove_dir(&folder).expect("empty");
        fs::write(&folder, "a file in its place").expect("written");
        assert_eq!(state.look(begin), Storage::Writable, "not asked yet");
        assert_eq!(state.look(begin + INTERVAL), Storage::Unwritable);
        fs::remove_file(&folder).expect("removed");
        assert_eq!(state.look(begin + 2 * INTERVAL), Storage::Writable);
        state.note(Storage::Full);
        assert_eq!(state.look(begin + 3 * INTERVAL), Storage::Full, "what failed has not been stored yet");
        state.note(Storage::Writable);
        assert_eq!(state.look(begin + 3 * INTERVAL), Storage::Writable);
        assert_eq!(fs::read_dir(&folder).expect("there").count(), 0, "nothing is left of the questions");
    }

    /// A disk with less room than is asked for, and with room again. Needs root to mount one.
    #[test]
    fn a_full_disk_is_told_from_one_that_cannot_be_written() {
        use std::io::Write as _;
        let folder = tempfile::tempdir().expect("a folder");
        let mount = |options: &str| {
            let mut mount = std::process::Command::new("mount");
            mount.args(["-t", "tmpfs", "-o", options, "tmpfs"]).arg(folder.path());
            mount.output().is_ok_and(|output| output.status.success())
        };
        if !mount("size=32k") {
            let _ = writeln!(io::stderr(), "SKIPPED: no disk can be mounted: this needs root");
            return;
        }
        let begin = Instant::now();
        let mut state = StateFolder::new(folder.path());
        let full = state.look(begin);
        let left = fs::read_dir(folder.path()).map(Iterator::count).ok();
        let grown = mount("remount,size=1m");
        let room = state.look(begin + INTERVAL);
        let unmounted = std::process::Command::new("umount").arg(folder.path()).status();
        assert_eq!((full, left, grown, room), (Storage::Full, Some(0), true, Storage::Writable));
        assert!(unmounted.is_ok_and(|status| status.success()));
    }
}
