//! Two files in turn.

use crate::error::{Problem, StoreError};
use crate::format::{Entry, FORMAT_VERSION, Knowledge, decode, encode};
use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

/// No store file is longer \[bytes\]: whatever lies in its place is not read whole.
const LONGEST: u64 = 1 << 24;

/// The stored knowledge of one robot. One process writes it, others may read.
#[derive(Debug)]
pub struct Store {
    /// Held as long as this may write; the system lets go of it however the process ends.
    lock: Option<File>,
    refused: Option<StoreError>,
    folder: PathBuf,
    robot: String,
    /// Generation to write next; found at the first save.
    next: Option<u64>,
}

/// What was found.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Loaded {
    /// The newest that may be used.
    pub knowledge: Option<Knowledge>,
    /// What was there and may not be used, and why.
    pub problems: Vec<(PathBuf, Problem)>,
}

/// Whether a folder cannot be written for a reason that may pass.
fn is_unwritable(why: &io::Error) -> bool {
    use io::ErrorKind::{
        AlreadyExists, NotADirectory, PermissionDenied, QuotaExceeded, ReadOnlyFilesystem, StorageFull,
    };
    // A file in the place of the folder is the first or the second.
    let passing = [AlreadyExists, NotADirectory, PermissionDenied, QuotaExceeded, ReadOnlyFilesystem, StorageFull];
    passing.contains(&why.kind())
}

impl Store {
    /// Makes the folder when it is absent, and takes it for this process until this is dropped. `robot` is a robot's name and
    /// becomes part of file names. Removes what writers that were killed have left half written.
    ///
    /// A folder that cannot be written now (no permission, read-only, no room, a file in its place) is no error: what it holds can be read, and the first
    /// [`save`](Self::save) that finds it writable takes it. A daemon beside an arm must not end for it.
    ///
    /// # Errors
    /// Another process writes there, the folder is another user's or others may write there, or the system refuses for a reason that does not pass.
    pub fn open(folder: &Path, robot: &str) -> Result<Store, StoreError> {
        let mut store = Store::reader(folder, robot);
        match store.take() {
            Err(why) if is_unwritable(&why.source) => store.refused = Some(why),
            taken => taken?,
        }
        Ok(store)
    }

    /// Why the folder could not be taken when it was opened.
    pub fn refused(&self) -> Option<&StoreError> {
        self.refused.as_ref()
    }

    /// Takes the folder for this process, if it has not done so.
    fn take(&mut self) -> Result<(), StoreError> {
        if self.lock.is_some() {
            return Ok(());
        }
        let fail = |path: &Path, source| StoreError { path: path.to_owned(), source };
        fs::create_dir_all(&self.folder).map_err(|source| fail(&self.folder, source))?;
        rivet_files::ensure_guarded(&self.folder).map_err(|source| fail(&self.folder, source))?;
        let path = self.folder.join(format!("{}.lock", self.robot));
        let lock = rivet_files::open_lock(&path).map_err(|source| fail(&path, source))?;
        lock.try_lock().map_err(|why| match why {
            TryLockError::Error(source) => fail(&path, source),
            TryLockError::WouldBlock => fail(&path, io::Error::other("another process stores this robot's parameters")),
        })?;
        self.lock = Some(lock);
        self.remove_unfinished();
        Ok(())
    }

    fn remove_unfinished(&self) {
        rivet_files::sweep(&self.folder);
        // As programs up to 0.1 called them.
        let parts = [0, 1].map(|slot| format!("{}.{slot}.tmp", self.robot));
        let unfinished = |name: &str| parts.iter().any(|part| name.starts_with(part.as_str()));
        for entry in fs::read_dir(&self.folder).into_iter().flatten().flatten() {
            if entry.file_name().to_str().is_some_and(unfinished) {
                // What cannot be removed is never read either.
                let _ = fs::remove_file(entry.path());
            }
        }
    }

    /// As [`open`](Store::open) for a process that only reads: nothing is made.
    pub fn reader(folder: &Path, robot: &str) -> Store {
        Store { lock: None, refused: None, folder: folder.to_owned(), robot: robot.to_owned(), next: None }
    }

    /// Whether there is any file of this robot's, also one that was set aside.
    #[must_use]
    pub fn has_files(&self) -> bool {
        !self.files().is_empty()
    }

    /// Files of this robot's, the one written last first.
    fn files(&self) -> Vec<PathBuf> {
        let begins = [0, 1].map(|slot| format!("{}.{slot}.state", self.robot));
        let is_ours = |name: &str| begins.iter().any(|begin| name.starts_with(begin.as_str()));
        let entries = fs::read_dir(&self.folder).into_iter().flatten().flatten();
        let mut files: Vec<_> = entries
            .filter(|entry| entry.file_name().to_str().is_some_and(is_ours))
            .map(|entry| (entry.metadata().and_then(|data| data.modified()).ok(), entry.path()))
            .collect();
        files.sort_by_key(|(written, _)| std::cmp::Reverse(*written));
        files.into_iter().map(|(_, path)| path).collect()
    }

    /// Copies the files of this robot's from the folder of an earlier installation. Where there are some here already, nothing is
    /// done: what was forgotten by request stays forgotten. Returns the copies.
    ///
    /// # Errors
    /// A copy cannot be written.
    pub fn copy_from(&self, before: &Path) -> Result<Vec<PathBuf>, StoreError> {
        let mut copies = Vec::new();
        if self.has_files() {
            return Ok(copies);
        }
        // The newest first: a kill between two copies loses the older generation.
        for path in Store::reader(before, &self.robot).files() {
            let (Some(Ok(bytes)), Some(name)) = (read(&path), path.file_name()) else { continue };
            let copy = self.folder.join(name);
            rivet_files::write_whole(&copy, bytes).map_err(|source| StoreError { path: copy.clone(), source })?;
            copies.push(copy);
        }
        Ok(copies)
    }

    fn path(&self, slot: u64) -> PathBuf {
        self.folder.join(format!("{}.{slot}.state", self.robot))
    }

    /// Every slot's content, or why there is none; `None` where no file is.
    fn slots(&self) -> [(PathBuf, Option<Result<Entry, Problem>>); 2] {
        [0, 1].map(|slot| {
            let path = self.path(slot);
            let content = read(&path).map(|bytes| bytes.and_then(|bytes| decode(&bytes)));
            (path, content)
        })
    }

    /// The newest knowledge of this robot and of the model with `model_hash`.
    pub fn load(&self, model_hash: u64) -> Loaded {
        let (mut best, mut problems): (Option<Entry>, _) = (None, Vec::new());
        for (path, content) in self.slots() {
            match content {
                Some(Err(why)) => problems.push((path, why)),
                Some(Ok(entry)) if entry.robot != self.robot => {
                    problems.push((path, Problem::OtherRobot(entry.robot)));
                }
                Some(Ok(entry)) if entry.knowledge.model_hash != model_hash => {
                    let found = entry.knowledge.model_hash;
                    problems.push((path, Problem::OtherModel { found, expected: model_hash }));
                }
                Some(Ok(entry)) if best.as_ref().is_none_or(|best| entry.generation > best.generation) => {
                    best = Some(entry);
                }
                // No file, or the older generation.
                None | Some(Ok(_)) => {}
            }
        }
        Loaded { knowledge: best.map(|entry| entry.knowledge), problems }
    }

    /// Renames sound files of other models, and those that this program or user cannot read, so that saving does not write over
    /// them: a robot file that was changed by mistake, or a program, can be changed back ([`take_back`](Store::take_back)).
    /// Returns their new places.
    ///
    /// # Errors
    /// A file cannot be renamed.
    pub fn set_others_aside(&self, model_hash: u64) -> Result<Vec<PathBuf>, StoreError> {
        let mut moved = Vec::new();
        for (path, problem) in self.load(model_hash).problems {
            let extension = match problem {
                Problem::OtherModel { found, .. } => format!("state-of-{found:016x}"),
                Problem::Version { found, .. } => format!("state-of-version-{found}"),
                Problem::Unreadable(_) if path.is_file() => "state-unreadable".to_owned(),
                _ => continue,
            };
            let aside = path.with_extension(extension);
            fs::rename(&path, &aside).map_err(|source| StoreError { path, source })?;
            moved.push(aside);
        }
        Ok(moved)
    }

    /// Renames files back that [`set_others_aside`](Store::set_others_aside) renamed when the robot file was another one, and
    /// those of this program's version; where a file is, it stays. Returns their places.
    ///
    /// # Errors
    /// A file cannot be renamed.
    pub fn take_back(&self, model_hash: u64) -> Result<Vec<PathBuf>, StoreError> {
        let mut moved = Vec::new();
        for path in [self.path(0), self.path(1)] {
            for extension in of_before(model_hash) {
                let aside = path.with_extension(extension);
                if !path.exists() && aside.is_file() {
                    fs::rename(&aside, &path).map_err(|source| StoreError { path: aside, source })?;
                    moved.push(path.clone());
                }
            }
        }
        Ok(moved)
    }

    /// Renames all files that a start with this model could take up, so that none does. Returns their new places.
    ///
    /// # Errors
    /// A file cannot be renamed.
    pub fn set_aside(&mut self, model_hash: u64) -> Result<Vec<PathBuf>, StoreError> {
        let mut moved = Vec::new();
        for slot in [0, 1] {
            let [of_model, of_version] = of_before(model_hash);
            for extension in ["state".to_owned(), of_model, of_version] {
                let path = self.path(slot).with_extension(&extension);
                let aside = path.with_extension(format!("{extension}-before-reset"));
                match fs::rename(&path, &aside) {
                    Ok(()) => moved.push(aside),
                    Err(why) if why.kind() == io::ErrorKind::NotFound => {}
                    Err(source) => return Err(StoreError { path, source }),
                }
            }
        }
        Ok(moved)
    }

    /// Stores `knowledge` in the place of the older generation.
    ///
    /// # Errors
    /// It could not be written; the generations are then as they were.
    pub fn save(&mut self, knowledge: &Knowledge) -> Result<(), StoreError> {
        if self.refused.is_some() {
            self.take()?;
            // A start that could not write has left files of other models in their places.
            self.set_others_aside(knowledge.model_hash)?;
            self.refused = None;
        }
        let newest = || {
            let sound = |(_, content): &(PathBuf, Option<Result<Entry, Problem>>)| match content {
                Some(Ok(entry)) => Some(entry.generation),
                _ => None,
            };
            self.slots().iter().map(sound).collect::<Vec<_>>()
        };
        // The slot of the newest sound generation stays; the other one is written.
        let (generation, slot) = match self.next {
            Some(generation) => (generation, generation % 2),
            None => match newest()[..] {
                [Some(a), Some(b)] if a > b => (a + 1, 1),
                [Some(a), None] => (a + 1, 1),
                [_, Some(b)] => (b + 1, 0),
                _ => (1, 1),
            },
        };
        // Generation and slot go in step from now on, whatever was found.
        let generation = if generation % 2 == slot { generation } else { generation + 1 };
        let entry = Entry { generation, robot: self.robot.clone(), knowledge: knowledge.clone() };
        let path = self.path(slot);
        if let Err(source) = rivet_files::write_whole(&path, encode(&entry)) {
            return Err(StoreError { path, source });
        }
        self.next = Some(generation + 1);
        // The name is on disk only once its folder is; a file system that cannot do that keeps the older generation.
        if let Ok(folder) = File::open(&self.folder) {
            let _ = folder.sync_all();
        }
        Ok(())
    }
}

/// What files end in that were set aside when the model, or the program, was another one.
fn of_before(model_hash: u64) -> [String; 2] {
    [format!("state-of-{model_hash:016x}"), format!("state-of-version-{FORMAT_VERSION}")]
}

fn read(path: &Path) -> Option<Result<Vec<u8>, Problem>> {
    let length = match fs::metadata(path) {
        Ok(data) if !data.is_file() => return Some(Err(Problem::Unreadable("it is no file".to_owned()))),
        Ok(data) => data.len(),
        Err(why) if why.kind() == io::ErrorKind::NotFound => return None,
        Err(why) => return Some(Err(Problem::Unreadable(why.to_string()))),
    };
    if length > LONGEST {
        return Some(Err(Problem::Length { found: length, expected: LONGEST }));
    }
    Some(fs::read(path).map_err(|why| Problem::Unreadable(why.to_string())))
}
