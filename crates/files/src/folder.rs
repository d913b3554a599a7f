//! An open folder: what is done in it does not depend on its name any more.

use crate::me;
use rustix::fs::{AtFlags, Dir, FileType, Mode, OFlags, Stat};
use rustix::io::Errno;
use std::ffi::{OsStr, OsString};
use std::fs::File;
use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::ffi::OsStringExt as _;
use std::path::{Component, Path, PathBuf};

/// As many links as Linux follows.
pub(crate) const MAX_LINKS: usize = 40;

/// Opens a folder to reach what is in it. It needs no right to list the folder, and mounts what is mounted on demand.
const FOLDER: OFlags = OFlags::PATH.union(OFlags::DIRECTORY).union(OFlags::NOFOLLOW).union(OFlags::CLOEXEC);

/// Opens a name to look at it: a link itself, and no pipe or device.
const ENTRY: OFlags = OFlags::PATH.union(OFlags::NOFOLLOW).union(OFlags::CLOEXEC);

/// A folder, opened component by component. Files in it are reached through its descriptor, whatever takes its name later.
#[derive(Debug)]
pub(crate) struct Folder {
    descriptor: OwnedFd,
    /// Absolute and without links when it was opened. For messages only.
    path: PathBuf,
}

/// A name in a folder, opened without following it: owner, kind and target belong to the same file.
#[derive(Debug)]
pub(crate) struct Entry {
    descriptor: OwnedFd,
    stat: Stat,
}

impl Folder {
    /// Opens it. Links of this user and of root are followed.
    ///
    /// # Errors
    /// It is missing or no folder, more than [`MAX_LINKS`] links are on the way, or one of another user.
    pub(crate) fn open(path: &Path) -> io::Result<Folder> {
        let mut walk = Walk::begin(path.is_absolute())?;
        let mut waiting = components_backwards(path);
        let mut links = 0;
        while let Some(next) = waiting.pop() {
            let Some(target) = walk.enter(&next, path)? else { continue };
            links += 1;
            if links > MAX_LINKS {
                return Err(io::Error::other(format!("{}: more than {MAX_LINKS} links on the way", path.display())));
            }
            if target.is_absolute() {
                walk = Walk::begin(true)?;
            }
            waiting.extend(components_backwards(&target));
        }
        Ok(Folder { descriptor: walk.last, path: walk.path })
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    pub(crate) fn stat(&self) -> io::Result<Stat> {
        Ok(rustix::fs::fstat(&self.descriptor)?)
    }

    pub(crate) fn entry(&self, name: &OsStr) -> io::Result<Entry> {
        Ok(Entry::open(&self.descriptor, name)?)
    }

    /// Opens or makes a file. A link is never followed.
    pub(crate) fn open_file(&self, name: &OsStr, flags: OFlags, mode: u32) -> io::Result<File> {
        let flags = flags | OFlags::NOFOLLOW | OFlags::CLOEXEC;
        Ok(File::from(rustix::fs::openat(&self.descriptor, name, flags, Mode::from_raw_mode(mode))?))
    }

    pub(crate) fn rename(&self, from: &OsStr, to: &OsStr) -> io::Result<()> {
        Ok(rustix::fs::renameat(&self.descriptor, from, &self.descriptor, to)?)
    }

    pub(crate) fn remove_file(&self, name: &OsStr) -> io::Result<()> {
        Ok(rustix::fs::unlinkat(&self.descriptor, name, AtFlags::empty())?)
    }

    /// The names in it, in any order. Those that cannot be read are left out.
    pub(crate) fn names(&self) -> io::Result<impl Iterator<Item = OsString>> {
        let flags = OFlags::RDONLY | OFlags::DIRECTORY | OFlags::CLOEXEC;
        let listed = rustix::fs::openat(&self.descriptor, ".", flags, Mode::empty())?;
        Ok(Dir::new(listed)?
            .map_while(Result::ok)
            .map(|entry| OsString::from_vec(entry.file_name().to_bytes().to_vec())))
    }
}

impl Entry {
    fn open(folder: &OwnedFd, name: &OsStr) -> rustix::io::Result<Entry> {
        let descriptor = rustix::fs::openat(folder, name, ENTRY, Mode::empty())?;
        let stat = rustix::fs::fstat(&descriptor)?;
        Ok(Entry { descriptor, stat })
    }

    pub(crate) fn stat(&self) -> &Stat {
        &self.stat
    }

    pub(crate) fn is_link(&self) -> bool {
        file_type(&self.stat) == FileType::Symlink
    }

    pub(crate) fn target(&self) -> io::Result<PathBuf> {
        let target = rustix::fs::readlinkat(&self.descriptor, "", Vec::new())?;
        Ok(PathBuf::from(OsString::from_vec(target.into_bytes())))
    }
}

pub(crate) fn file_type(stat: &Stat) -> FileType {
    FileType::from_raw_mode(stat.st_mode)
}

/// Whether a user is this one or root.
pub(crate) fn is_trusted(uid: u32) -> bool {
    uid == 0 || uid == me()
}

/// The way to a folder: the folders that are open, so that `..` leads back to where the walk came from.
struct Walk {
    last: OwnedFd,
    parents: Vec<OwnedFd>,
    path: PathBuf,
}

impl Walk {
    fn begin(at_root: bool) -> io::Result<Walk> {
        let (name, path) = if at_root { ("/", PathBuf::from("/")) } else { (".", std::env::current_dir()?) };
        let last = rustix::fs::open(name, FOLDER, Mode::empty())?;
        Ok(Walk { last, parents: Vec::new(), path })
    }

    /// Enters a folder. Of a link it returns the target and stays.
    fn enter(&mut self, name: &OsStr, searched: &Path) -> io::Result<Option<PathBuf>> {
        if name == ".." {
            self.last = match self.parents.pop() {
                Some(parent) => parent,
                // Above the current folder, or `/` itself.
                None => rustix::fs::openat(&self.last, "..", FOLDER, Mode::empty())?,
            };
            self.path.pop();
            return Ok(None);
        }
        let at = self.path.join(name);
        let failed = |why: Errno| match why {
            Errno::NOENT => {
                io::Error::new(io::ErrorKind::NotFound, format!("there is no folder {}", searched.display()))
            }
            why => io::Error::new(io::Error::from(why).kind(), format!("{}: {}", at.display(), io::Error::from(why))),
        };
        let entered = match rustix::fs::openat(&self.last, name, FOLDER, Mode::empty()) {
            Err(Errno::NOTDIR | Errno::LOOP) => {
                let entry = Entry::open(&self.last, name).map_err(failed)?;
                if entry.is_link() {
                    ensure_own_link(&at, entry.stat.st_uid)?;
                    return entry.target().map(Some);
                }
                if file_type(&entry.stat) != FileType::Directory {
                    return Err(failed(Errno::NOTDIR));
                }
                entry.descriptor
            }
            opened => opened.map_err(failed)?,
        };
        self.parents.push(std::mem::replace(&mut self.last, entered));
        self.path = at;
        Ok(None)
    }
}

fn components_backwards(path: &Path) -> Vec<OsString> {
    let named = |component: &Component| matches!(component, Component::Normal(_) | Component::ParentDir);
    path.components().rev().filter(named).map(|c| c.as_os_str().to_owned()).collect()
}

/// That a link is not another user's, who can let it lead elsewhere at any time.
fn ensure_own_link(link: &Path, uid: u32) -> io::Result<()> {
    if is_trusted(uid) {
        return Ok(());
    }
    let (link, me) = (link.display(), me());
    Err(io::Error::new(
        io::ErrorKind::PermissionDenied,
        format!(
            "{link} is a link of user {uid}, and only links of user {me} or root are followed; name a path without it"
        ),
    ))
}
