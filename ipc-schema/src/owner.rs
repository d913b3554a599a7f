//! Whose a bus is. All parties of one run as one user; somebody else who joined an empty one by mistake, root above all, would
//! leave files that keep its own user out for good.

use std::fmt;
use std::fs;
use std::os::unix::fs::{DirBuilderExt as _, MetadataExt as _};
use std::path::{Path, PathBuf};

use crate::bus_config::{BusConfig, LOCK_DIRECTORY, SHARED_MEMORY, belongs};
use crate::error::BusError;

/// A user of this machine.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct User {
    /// The number.
    pub uid: u32,
    name: Option<String>,
}

impl User {
    /// The user of this process.
    pub fn me() -> User {
        User::of(rustix::process::geteuid().as_raw())
    }

    /// The user of that number.
    pub fn of(uid: u32) -> User {
        let users = fs::read_to_string("/etc/passwd").unwrap_or_default();
        User { uid, name: name_in(&users, uid) }
    }

    /// Words that run the command after them as this user, for whoever runs this process.
    pub fn run_as(&self) -> String {
        match &self.name {
            // Always there, as root; sudo need not be.
            Some(name) if rustix::process::geteuid().is_root() => format!("runuser -u {name} --"),
            Some(name) => format!("sudo -u {name}"),
            None => format!("sudo -u '#{}'", self.uid),
        }
    }
}

impl fmt::Display for User {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.name {
            Some(name) => f.write_str(name),
            None => write!(f, "number {}", self.uid),
        }
    }
}

/// The name that a list of users like `/etc/passwd` has for the number.
fn name_in(users: &str, uid: u32) -> Option<String> {
    users.lines().find_map(|line| {
        let mut fields = line.split(':');
        let (name, _, number) = (fields.next()?, fields.next()?, fields.next()?);
        (number.parse::<u32>() == Ok(uid)).then(|| name.to_owned())
    })
}

/// Something of a bus's, and whose it is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Owned {
    /// A file or a directory.
    pub path: PathBuf,
    /// Number of its user.
    pub uid: u32,
}

/// What of a bus belongs to whom.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Ownership {
    /// Number of the user whose bus it is: the owner of its directory or, where others may write there as well, of what the bus
    /// made in it; `None` while that is not there.
    pub owner: Option<u32>,
    /// What belongs to somebody else than the owner (without one: than the user of this process).
    pub strays: Vec<Owned>,
}

impl Ownership {
    /// The owner, where that is not `user`.
    pub fn other_than(&self, user: &User) -> Option<User> {
        self.owner.filter(|owner| *owner != user.uid).map(User::of)
    }
}

/// Looks whose the bus is. Nothing is opened or made.
pub fn ownership(config: &BusConfig) -> Ownership {
    let owner = owner(config);
    let expected = owner.unwrap_or_else(|| rustix::process::geteuid().as_raw());
    Ownership { owner, strays: everything(config).into_iter().filter(|owned| owned.uid != expected).collect() }
}

fn owner(config: &BusConfig) -> Option<u32> {
    let root = fs::metadata(&config.root).ok()?;
    let shared = root.mode() & 0o022 != 0;
    if shared { uid(&config.root.join("nodes")) } else { Some(root.uid()) }
}

/// Not of what a link points to: it is the link that is in the way.
fn uid(path: &Path) -> Option<u32> {
    fs::symlink_metadata(path).ok().map(|data| data.uid())
}

/// The directories in the bus's own, and its files in shared memory.
fn everything(config: &BusConfig) -> Vec<Owned> {
    let directories = ["nodes", "services", LOCK_DIRECTORY].map(|name| config.root.join(name));
    let entries = fs::read_dir(SHARED_MEMORY).into_iter().flatten().flatten();
    let files = entries.filter(|entry| belongs(entry.file_name().as_encoded_bytes(), &config.prefix));
    let paths = directories.into_iter().chain(files.map(|entry| entry.path()));
    paths.filter_map(|path| uid(&path).map(|uid| Owned { path, uid })).collect()
}

/// Fails where this process's user is not the bus's, before anything is made there: root could join, and would shut the owner
/// out. Fails too where something of another user's will keep this one from joining.
///
/// # Errors
/// [`BusError::OtherUser`], with the path, its owner and what to do.
pub(crate) fn ensure_own(config: &BusConfig) -> Result<(), BusError> {
    let me = User::me();
    let refuse = |path: PathBuf, owner: &User, change: String| {
        Err(BusError::OtherUser { path, owner: owner.to_string(), me: me.to_string(), change })
    };
    if let Some(owner) = owner(config).filter(|owner| *owner != me.uid).map(User::of) {
        return refuse(
            config.root.clone(),
            &owner,
            format!("{} rivet ..., or choose another root (--root)", owner.run_as()),
        );
    }
    ensure_guarded(&config.root, me.uid)?;
    match in_the_way(&everything(config), config, me.uid) {
        Some(Owned { path, uid }) => {
            let other = User::of(uid);
            let change = format!(
                "once nothing of theirs uses this prefix, as root: {}; or choose another prefix (--prefix)",
                config.clean_command()
            );
            refuse(path, &other, change)
        }
        None => Ok(()),
    }
}

/// Write permission of the group and of all others.
const OTHERS_WRITE: u32 = 0o022;
/// In a directory with this bit only a file's owner, the directory's owner and root rename or remove it.
const STICKY: u32 = 0o1000;

/// Makes the bus's directory when it is absent, and fails where another user could replace it or what is in it. It has to be this
/// user's, and nobody else's to write. Each directory above it has to be this user's or root's; others may write there only under the
/// sticky bit, which keeps them from what is not theirs. Links on the way have to be this user's or root's.
///
/// # Errors
/// [`BusError::Exposed`]; it cannot be made.
fn ensure_guarded(root: &Path, me: u32) -> Result<(), BusError> {
    // What is there first: nothing is made where somebody else has a say.
    let there = root.ancestors().find(|folder| fs::symlink_metadata(folder).is_ok()).unwrap_or(root);
    ensure_guarded_folder(there, root, me)?;
    let made = fs::DirBuilder::new().recursive(true).mode(0o750).create(root);
    made.map_err(|source| BusError::File { path: root.to_owned(), source })?;
    ensure_guarded_folder(root, root, me)
}

/// The same for a directory on the way that is there: `there` is `root` or above it.
fn ensure_guarded_folder(there: &Path, root: &Path, me: u32) -> Result<(), BusError> {
    let exposed = |path: &Path, why: String, change: String| {
        Err(BusError::Exposed { path: path.to_owned(), root: root.to_owned(), why, change })
    };
    let fail = |path: &Path, source| BusError::File { path: path.to_owned(), source };
    // Also says whose a link on the way is.
    let resolved = rivet_files::resolve_folder(there).map_err(|source| fail(there, source))?;
    for folder in resolved.ancestors() {
        let data = fs::symlink_metadata(folder).map_err(|source| fail(folder, source))?;
        let is_root = there == root && folder == resolved;
        if data.uid() != me && (is_root || data.uid() != 0) {
            let owner = User::of(data.uid());
            return exposed(folder, format!("belongs to the user {owner}"), "choose another root (--root)".to_owned());
        }
        let guarded = data.mode() & OTHERS_WRITE == 0 || (!is_root && data.mode() & STICKY != 0);
        if !guarded {
            let why = format!("can be written by others (mode {:o})", data.mode() & 0o7777);
            let change = format!("use: chmod go-w {}, or another root (--root)", folder.display());
            return exposed(folder, why, change);
        }
    }
    Ok(())
}

/// What of another user's there is in shared memory under the bus's prefix, in words, for an opening that failed.
pub(crate) fn in_shared_memory(config: &BusConfig) -> Option<String> {
    let me = User::me();
    let theirs = everything(config).into_iter().find(|owned| owned.uid != me.uid)?;
    let (path, owner) = (theirs.path.display(), User::of(theirs.uid));
    let clean = config.clean_command();
    Some(format!("{path} belongs to the user {owner}; as root: {clean}, or choose another prefix (--prefix)"))
}

/// What keeps the user `me` from joining: a directory in which parties are listed, or the counter from which their ids
/// are made, and that not if there is one of the user's own (each version of the library has its own).
fn in_the_way(all: &[Owned], config: &BusConfig, me: u32) -> Option<Owned> {
    let has_counter = all.iter().any(|owned| owned.uid == me && is_counter(&owned.path));
    let lists = ["nodes", "services"].map(|name| config.root.join(name));
    let blocks = |path: &PathBuf| lists.contains(path) || (is_counter(path) && !has_counter);
    all.iter().find(|owned| owned.uid != me && blocks(&owned.path)).cloned()
}

fn is_counter(path: &Path) -> bool {
    path.as_os_str().as_encoded_bytes().ends_with(b".global_mgmt")
}

/// The bus was refused by its library, which names neither file nor user: `why`, and what of another user's there is.
pub(crate) fn cannot_join(config: &BusConfig, why: &dyn fmt::Debug) -> BusError {
    let theirs = ownership(config).strays.into_iter().next();
    let theirs =
        theirs.map(|Owned { path, uid }| format!(" ({} belongs to the user {})", path.display(), User::of(uid)));
    let why = format!("{why:?}{}", theirs.unwrap_or_default());
    BusError::Join { prefix: config.prefix.clone(), root: config.root.clone(), why }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Bus, PrivateBus, RobotName};
    use std::io::Write as _;
    use std::os::unix::fs::{PermissionsExt as _, chown};

    const NOBODY: u32 = 65534;

    #[test]
    fn a_user_goes_by_name_where_there_is_one() {
        let users = "root:x:0:0:root:/root:/bin/sh\n\nbroken\nrivet:x:997:997::/:/bin/false\n";
        assert_eq!(name_in(users, 997).as_deref(), Some("rivet"));
        assert_eq!(name_in(users, 99), None);
        let unknown = User { uid: 4242, name: None };
        assert_eq!((unknown.to_string(), unknown.run_as()), ("number 4242".to_owned(), "sudo -u '#4242'".to_owned()));
    }

    #[test]
    fn a_counter_of_another_user_is_in_the_way_of_who_has_none() {
        let config = BusConfig::default();
        let owned = |path: &str, uid| Owned { path: path.into(), uid };
        let theirs = owned("/dev/shm/rivet_9204dd183d1c_node.0_10_0.global_mgmt", 0);
        let mine = owned("/dev/shm/rivet_9204dd183d1c_node.0_11_0.global_mgmt", 997);
        let data = owned("/dev/shm/rivet_9204dd183d1c_1.data", 0);
        let nodes = Owned { path: config.root.join("nodes"), uid: 0 };
        let found = |all: &[&Owned]| {
            let all: Vec<Owned> = all.iter().copied().cloned().collect();
            in_the_way(&all, &config, 997)
        };
        assert_eq!(found(&[&data, &theirs]), Some(theirs.clone()));
        assert_eq!(found(&[&theirs, &mine, &data]), None);
        assert_eq!(found(&[&mine, &nodes]), Some(nodes.clone()));
    }

    #[test]
    fn who_is_not_the_owner_is_refused_before_anything_is_made() {
        if !rustix::process::geteuid().is_root() {
            let _ = writeln!(std::io::stderr(), "SKIPPED: to be two users this needs root");
            return;
        }
        let private = PrivateBus::new("owner");
        let config = private.config();
        let robot = RobotName::new("arm").unwrap();
        fs::DirBuilder::new().mode(0o750).create(&config.root).unwrap();
        chown(&config.root, Some(NOBODY), Some(NOBODY)).unwrap();
        let refused = Bus::open(config, &robot, "stranger").unwrap_err();
        assert!(matches!(&refused, BusError::OtherUser { path, .. } if *path == config.root), "{refused}");
        assert!(refused.to_string().contains(&User::of(NOBODY).run_as()), "{refused}");
        assert!(crate::cleanup(config).is_err(), "the daemon's first step");
        assert_eq!(fs::read_dir(&config.root).unwrap().count(), 0, "nothing was made");
        assert_eq!(ownership(config), Ownership { owner: Some(NOBODY), strays: Vec::new() });

        // On a directory of its own root works on.
        chown(&config.root, Some(0), Some(0)).unwrap();
        let bus = Bus::open(config, &robot, "owner").unwrap();
        assert_eq!(ownership(config), Ownership { owner: Some(0), strays: Vec::new() });
        drop(bus);
        let nodes = config.root.join("nodes");
        chown(&nodes, Some(NOBODY), Some(NOBODY)).unwrap();
        assert_eq!(ownership(config).strays, [Owned { path: nodes, uid: NOBODY }]);
        let why = cannot_join(config, &"no").to_string();
        assert!(why.contains("nodes belongs to the user"), "{why}");
    }

    /// Whoever may write to a directory on the way can put another one in its place; under the sticky bit nobody can.
    #[test]
    fn a_bus_that_others_could_replace_is_refused() {
        let private = PrivateBus::new("guard");
        let above = private.config().root.clone();
        let config = BusConfig { root: above.join("bus"), ..private.config().clone() };
        let robot = RobotName::new("arm").unwrap();
        let set = |path: &Path, mode| fs::set_permissions(path, fs::Permissions::from_mode(mode)).unwrap();
        drop(Bus::open(&config, &robot, "owner").unwrap());
        let refused = |path: &Path| {
            let why = Bus::open(&config, &robot, "owner").unwrap_err();
            assert!(matches!(&why, BusError::Exposed { path: exposed, .. } if exposed == path), "{why}");
            assert!(why.to_string().contains(&format!("chmod go-w {}", path.display())), "{why}");
        };
        for mode in [0o770, 0o702, 0o1777] {
            set(&config.root, mode);
            refused(&config.root);
        }
        set(&config.root, 0o750);
        for mode in [0o770, 0o777] {
            set(&above, mode);
            refused(&above);
        }
        for mode in [0o1777, 0o755] {
            set(&above, mode);
            drop(Bus::open(&config, &robot, "owner").unwrap());
        }
    }

    #[test]
    fn a_bus_below_another_users_directory_or_link_is_refused() {
        if !rustix::process::geteuid().is_root() {
            let _ = writeln!(std::io::stderr(), "SKIPPED: to be two users this needs root");
            return;
        }
        let private = PrivateBus::new("below");
        let (above, robot) = (private.config().root.clone(), RobotName::new("arm").unwrap());
        let at = |root: PathBuf| BusConfig { root, ..private.config().clone() };
        let (theirs, link) = (above.join("theirs"), above.join("link"));
        fs::create_dir_all(&theirs).unwrap();
        chown(&theirs, Some(NOBODY), Some(NOBODY)).unwrap();
        let why = Bus::open(&at(theirs.join("bus")), &robot, "owner").unwrap_err().to_string();
        assert!(why.contains("theirs: belongs to the user"), "{why}");
        std::os::unix::fs::symlink(&above, &link).unwrap();
        std::os::unix::fs::lchown(&link, Some(NOBODY), Some(NOBODY)).unwrap();
        let why = Bus::open(&at(link.join("bus")), &robot, "owner").unwrap_err().to_string();
        assert!(why.contains("is a link of user 65534"), "{why}");
    }

    /// Root too: a counter that somebody else may change gives ids twice.
    #[test]
    fn a_counter_that_another_user_made_first_is_named() {
        if !rustix::process::geteuid().is_root() {
            let _ = writeln!(std::io::stderr(), "SKIPPED: to be two users this needs root");
            return;
        }
        let private = PrivateBus::new("first");
        let (config, robot) = (private.config(), RobotName::new("arm").unwrap());
        drop(Bus::open(config, &robot, "owner").unwrap());
        let counter = everything(config).into_iter().find(|owned| is_counter(&owned.path)).unwrap().path;
        chown(&counter, Some(NOBODY), Some(NOBODY)).unwrap();
        let why = Bus::open(config, &robot, "owner").unwrap_err().to_string();
        for part in [counter.to_str().unwrap(), &User::of(NOBODY).to_string(), &config.clean_command(), "--prefix"] {
            assert!(why.contains(part), "{part}: {why}");
        }
    }
}
