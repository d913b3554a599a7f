//! What dead processes leave behind.

use std::fs::{self, File};
use std::hash::{BuildHasher as _, RandomState};
use std::io::{self, Read as _, Write as _};
use std::os::unix::fs::{DirBuilderExt as _, MetadataExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use iceoryx2::node::{Node, NodeState};
use iceoryx2::prelude::{CallbackProgression, Config, ipc};

use crate::bus_config::{BusConfig, LOCK_DIRECTORY, SHARED_MEMORY, belongs, quieten};
use crate::error::BusError;
use crate::owner::{User, cannot_join, ensure_own, ownership};

/// How long to wait for another process that clears up the same party.
const PATIENCE: Duration = Duration::from_secs(1);

/// Fails where shared memory has less room than this \[bytes\]: the bus library sets memory aside without asking whether it is
/// there, and whoever then writes to it is ended by SIGBUS.
pub fn ensure_room(needed: u64) -> Result<(), BusError> {
    match rustix::fs::statvfs(SHARED_MEMORY) {
        Ok(there) => {
            let free = there.f_bavail.saturating_mul(there.f_frsize);
            if free < needed { Err(BusError::SharedMemoryFull { free, needed }) } else { Ok(()) }
        }
        Err(why) => Err(BusError::File { path: PathBuf::from(SHARED_MEMORY), source: why.into() }),
    }
}

/// What was removed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Leftovers {
    /// Dead parties whose resources were freed.
    pub dead_nodes: usize,
    /// Files unlinked.
    pub files: usize,
}

/// Counts live nodes and frees what dead ones left.
fn sweep(config: &BusConfig) -> Result<(usize, usize), BusError> {
    quieten();
    let iceoryx = config.iceoryx()?;
    remove_half_made_memory(config)?;
    let (mut alive, mut freed) = (0, 0);
    let listed = Node::<ipc::Service>::list(&iceoryx, |state| {
        match state {
            // Another process, or another thread of this one, may be clearing up at this moment: wait for it.
            NodeState::Dead(view) => freed += usize::from(view.blocking_remove_stale_resources(PATIENCE).is_ok()),
            NodeState::Alive(_) | NodeState::Inaccessible(_) => alive += 1,
            NodeState::Undefined(_) => {}
        }
        CallbackProgression::Continue
    });
    listed.map_err(|e| cannot_join(config, &e))?;
    Ok((alive, freed + remove_unlisted(config, false)))
}

/// Removes the folders of parties that were killed between making their folder and their entry in the list of parties: no listing
/// shows them. Returns how many. A folder of another prefix stays, as does one that may still be under way. `unused`: no process uses the
/// prefix, so that nothing of it is under way, and it is waited for the rest.
fn remove_unlisted(config: &BusConfig, unused: bool) -> usize {
    let nodes = config.root.join("nodes");
    let entries: Vec<fs::DirEntry> = fs::read_dir(&nodes).into_iter().flatten().flatten().collect();
    let names: Vec<String> = entries.iter().map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    let is_party = |name: &str| !name.is_empty() && name.bytes().all(|byte| byte.is_ascii_digit());
    let is_listed = |id: &str| names.iter().any(|name| name != id && name.contains(id));
    let unlisted = entries.iter().zip(&names).filter(|(entry, name)| {
        is_party(name) && !is_listed(name) && entry.file_type().is_ok_and(|kind| kind.is_dir())
    });
    unlisted
        .filter(|(entry, _)| is_abandoned(config, &entry.path(), unused) && remove_party(config, &entry.path()))
        .count()
}

/// Whether nobody is at work on a party's folder.
fn is_abandoned(config: &BusConfig, folder: &Path, unused: bool) -> bool {
    let old = || fs::metadata(folder).map_or(true, |data| is_old(&data));
    if unused {
        let mut entries = fs::read_dir(folder).into_iter().flatten().flatten();
        let has_ours = entries.any(|entry| entry.file_name().as_encoded_bytes().starts_with(config.prefix.as_bytes()));
        // An empty one may be of another prefix.
        while !has_ours && !old() {
            std::thread::sleep(Duration::from_millis(20));
        }
        return true;
    }
    old()
}

/// Removes a party's folder with what bears the prefix in it; whether it is gone.
fn remove_party(config: &BusConfig, folder: &Path) -> bool {
    let ours = |name: &[u8]| name.starts_with(config.prefix.as_bytes());
    unlink_below(folder, ours).is_ok() && fs::remove_dir(folder).is_ok()
}

/// Frees what killed processes left on the bus. Safe while others use it; 2 to 14 ms a dead party.
///
/// Joining the bus does the same; this is for a process that is about to leave no one behind.
///
/// # Errors
/// [`BusError::OtherUser`] on a bus of another user's; a bus that cannot be listed.
pub fn cleanup(config: &BusConfig) -> Result<Leftovers, BusError> {
    ensure_own(config)?;
    let (_, dead_nodes) = sweep(config)?;
    Ok(Leftovers { dead_nodes, files: 0 })
}

/// Removes every file of the bus, once no process uses it any more: a clean exit leaves one page, a killed
/// process more. Root may do so for any user.
///
/// # Errors
/// [`BusError::InUse`] while a process is on the bus; nothing but dead parties is then removed.
pub fn purge(config: &BusConfig) -> Result<Leftovers, BusError> {
    let (alive, dead_nodes) = sweep(config)?;
    let nodes = alive.max(mapped_elsewhere(config));
    if nodes > 0 {
        return Err(BusError::InUse { prefix: config.prefix.clone(), nodes });
    }
    Ok(Leftovers { dead_nodes, files: unlink_all(config)? })
}

/// Other processes that have mapped memory of the prefix, as far as this one may see: a party that is just joining, or
/// on a bus of the same prefix in another directory, is not listed, and would lose its files all the same.
fn mapped_elsewhere(config: &BusConfig) -> usize {
    let own = std::process::id().to_string();
    let maps = |process: fs::DirEntry| {
        let name = process.file_name();
        let other = name.as_encoded_bytes().iter().all(u8::is_ascii_digit) && name.to_str() != Some(own.as_str());
        let maps = if other { fs::read(process.path().join("maps")).unwrap_or_default() } else { Vec::new() };
        let maps = String::from_utf8_lossy(&maps);
        maps.lines()
            .filter_map(|line| line.split_once("/dev/shm/"))
            .any(|(_, file)| belongs(file.as_bytes(), &config.prefix))
    };
    fs::read_dir("/proc").into_iter().flatten().flatten().map(maps).filter(|uses| *uses).count()
}

/// Whether the bus has descriptions of services and shared memory. What cannot be asked is taken to be there.
pub(crate) fn has_files(config: &BusConfig, iceoryx: &Config) -> bool {
    [iceoryx.global.service_dir().to_string(), SHARED_MEMORY.to_owned()].iter().all(|folder| {
        match fs::read_dir(folder) {
            Ok(mut entries) => entries
                .any(|entry| entry.is_ok_and(|entry| belongs(entry.file_name().as_encoded_bytes(), &config.prefix))),
            Err(why) => why.kind() != io::ErrorKind::NotFound,
        }
    })
}

/// Looks after the files of a bus in use. Who is there when they are removed goes on through the memory that he has; who comes
/// from then on is not found. So that is told at once, and is a reason to begin anew only when nothing comes any more.
#[derive(Debug, Default)]
pub struct BusWatch {
    missing: u32,
    said: bool,
    count: u64,
    since: Option<Instant>,
}

/// Without anything for this long nobody is there.
const NOTHING_COMES: Duration = Duration::from_secs(5);

impl BusWatch {
    /// To be asked now and then: `whole` as [`Bus::is_whole`](crate::Bus::is_whole) says, `count` of what has come so far. What is
    /// to be told, once.
    ///
    /// # Errors
    /// [`BusError::Torn`]: nothing comes any more, and the process had better end and be started anew.
    pub fn look(
        &mut self,
        config: &BusConfig,
        whole: bool,
        count: u64,
        now: Instant,
    ) -> Result<Option<BusError>, BusError> {
        if count != self.count || self.since.is_none() {
            (self.count, self.since) = (count, Some(now));
        }
        // Twice: a service that is made anew at this moment is there the next time. But files that others make after that are not
        // those that this process has.
        self.missing = if whole && self.missing < 2 { 0 } else { self.missing.saturating_add(1) };
        if self.missing < 2 {
            return Ok(None);
        }
        let torn = BusError::Torn { root: config.root.clone() };
        if self.since.is_some_and(|since| now.saturating_duration_since(since) >= NOTHING_COMES) {
            return Err(torn);
        }
        Ok((!std::mem::replace(&mut self.said, true)).then_some(torn))
    }
}

/// Making a file of the bus takes well below a millisecond. One that is not ready after this belongs to nobody who lives; a
/// process that was stopped just then will find its work undone.
const HALF_MADE: Duration = Duration::from_secs(1);

/// Whether it has been as it is for so long that nobody is at work on it.
fn is_old(data: &fs::Metadata) -> bool {
    data.modified().ok().and_then(|at| at.elapsed().ok()).is_none_or(|age| age >= HALF_MADE)
}

/// Removes descriptions of services that their maker did not finish, since he was killed. The library writes a file, makes it read-only, then
/// makes the service's memory, and waits for both for ever.
pub(crate) fn remove_half_made(config: &Config) {
    let prefix = config.global.prefix.to_string();
    let services = config.global.service_dir();
    let Ok(entries) = fs::read_dir(services.to_string()) else { return };
    let half_made = |entry: &fs::DirEntry| {
        let name = entry.file_name();
        let ours = belongs(name.as_encoded_bytes(), &prefix) && name.as_encoded_bytes().ends_with(b".service");
        let Ok(data) = entry.metadata() else { return false };
        let unfinished = data.permissions().mode() & 0o200 != 0;
        ours && is_old(&data) && (unfinished || is_without_memory(&entry.path(), &prefix))
    };
    for entry in entries.flatten().filter(half_made) {
        // Who else starts now may have been faster.
        let _ = fs::remove_file(entry.path());
    }
}

/// Whether a service that is described at `path` has no memory. What cannot be read or asked has some.
fn is_without_memory(path: &Path, prefix: &str) -> bool {
    let Some(id) = fs::read_to_string(path).ok().and_then(|text| service_id(&text)) else { return false };
    let Ok(entries) = fs::read_dir(SHARED_MEMORY) else { return false };
    let memory = format!("_{id}.dynamic");
    let is_memory = |name: &[u8]| belongs(name, prefix) && name.ends_with(memory.as_bytes());
    !entries.flatten().any(|entry| is_memory(entry.file_name().as_encoded_bytes()))
}

/// The number in the name of a service's memory, from its description: `[unique_service_id]` has the two halves of it.
fn service_id(description: &str) -> Option<u128> {
    let section = description.split("[unique_service_id]").nth(1)?;
    let number = |key: &str| {
        let line =
            section.lines().skip(1).take_while(|line| !line.starts_with('[')).find(|line| line.starts_with(key))?;
        line.split_once('=')?.1.trim().parse::<u64>().ok()
    };
    Some(u128::from(number("unique_value")?) << 64 | u128::from(number("payload_value")?))
}

/// Bytes of the counter that all parties share.
const COUNTER: u64 = 16;

/// Removes shared memory of the bus whose maker was killed on the way: the library makes it readable when it is ready, and would wait
/// for that for ever, in whoever joins or clears up. The counter from which ids of parties are made it would refuse for ever as well.
///
/// Waits for what is under way, which takes well below a millisecond.
///
/// # Errors
/// It is another user's.
pub(crate) fn remove_half_made_memory(config: &BusConfig) -> Result<(), BusError> {
    let Ok(entries) = fs::read_dir(SHARED_MEMORY) else { return Ok(()) };
    let ours = |entry: &fs::DirEntry| belongs(entry.file_name().as_encoded_bytes(), &config.prefix);
    for entry in entries.flatten().filter(ours) {
        let (path, counter) = (entry.path(), is_counter(config, &entry));
        let unfinished = || {
            let data = fs::metadata(&path).ok()?;
            let mode = data.permissions().mode();
            let is_made = if counter {
                data.len() >= COUNTER && mode & 0o600 == 0o600
            } else {
                data.len() > 0 && mode & 0o400 != 0
            };
            (!is_made).then_some(data)
        };
        while let Some(data) = unfinished() {
            if !is_old(&data) {
                std::thread::sleep(Duration::from_millis(5));
                continue;
            }
            match fs::remove_file(&path) {
                Ok(()) => {}
                Err(why) if why.kind() == io::ErrorKind::NotFound => {}
                Err(source) => return Err(BusError::File { path, source }),
            }
        }
    }
    Ok(())
}

fn is_counter(config: &BusConfig, entry: &fs::DirEntry) -> bool {
    let name = entry.file_name();
    belongs(name.as_encoded_bytes(), &config.prefix) && name.as_encoded_bytes().ends_with(b".global_mgmt")
}

/// Takes from other users the one file that the bus library makes for everybody: a counter from which it makes the ids of
/// parties.
pub(crate) fn close_to_others(config: &BusConfig) {
    let Ok(entries) = fs::read_dir(SHARED_MEMORY) else { return };
    for entry in entries.flatten().filter(|entry| is_counter(config, entry)) {
        // Only its owner can, and did: a failure means that joining has failed, or will.
        let _ = fs::set_permissions(entry.path(), fs::Permissions::from_mode(0o600));
    }
}

/// Unlinks the files of the bus, whoever may use them.
fn unlink_all(config: &BusConfig) -> Result<usize, BusError> {
    config.check()?;
    let lock_prefix = format!("{}.", config.prefix);
    let locks = config.root.join(LOCK_DIRECTORY);
    let mut files = unlink_below(Path::new(SHARED_MEMORY), |name| belongs(name, &config.prefix))?;
    // Only what the bus makes below its root, and of that only what bears the prefix: the root may be shared.
    for directory in [config.root.join("nodes"), config.root.join("services"), config.root.clone()] {
        files += unlink_below(&directory, |name| belongs(name, &config.prefix))?;
    }
    remove_unlisted(config, true);
    files += unlink_below(&locks, |name| name.starts_with(lock_prefix.as_bytes()))?;
    // Root cleans up for another user, who may be unable to make the directory again.
    let keep_root = ownership(config).other_than(&User::me()).is_some();
    for directory in ["nodes", "services", LOCK_DIRECTORY] {
        // Not empty means another prefix lives there.
        let _ = fs::remove_dir(config.root.join(directory));
    }
    if !keep_root {
        let _ = fs::remove_dir(&config.root);
    }
    Ok(files)
}

/// Unlinks the files of a directory whose names are `wanted`; counts them.
fn unlink_below(directory: &Path, wanted: impl Fn(&[u8]) -> bool) -> Result<usize, BusError> {
    let fail = |path: &Path, source| Err(BusError::File { path: path.to_owned(), source });
    let entries = match fs::read_dir(directory) {
        Ok(entries) => entries,
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(0),
        Err(e) => return fail(directory, e),
    };
    let mut files = 0;
    for entry in entries.flatten().filter(|entry| wanted(entry.file_name().as_encoded_bytes())) {
        match fs::remove_file(entry.path()) {
            Ok(()) => files += 1,
            // Another process cleans up as well.
            Err(e) if e.kind() == io::ErrorKind::NotFound => {}
            Err(e) => return fail(&entry.path(), e),
        }
    }
    Ok(files)
}

/// A bus of one's own: unique prefix and root, all files removed when dropped. For tests and demonstrations;
/// drop it last, after all parties.
#[derive(Debug)]
pub struct PrivateBus {
    config: BusConfig,
    /// Held as long as this lives, beside the root: shows that the bus is not abandoned.
    _lock: Option<File>,
}

/// Folder of private buses. Not the temporary directory of the environment: it may be longer than a socket's path allows.
const PRIVATE_FOLDER: &str = "/tmp";
/// How names of private buses' roots and prefixes begin.
const PRIVATE_ROOT: &str = "rivet-";
const PRIVATE_PREFIX: &str = "rvt_";
/// Ending of a private bus's lock, after the name of its root.
const PRIVATE_LOCK: &str = ".lock";
/// Letters and digits that nobody can guess, of a private bus's name.
const PRIVATE_RANDOM: usize = 8;

impl PrivateBus {
    /// A bus that no other process or test has. `label` (letters and digits) tells leftovers apart.
    pub fn new(label: &str) -> Self {
        let label: String = label.chars().filter(char::is_ascii_alphanumeric).take(8).collect();
        let unique = format!("{}_{}", std::process::id(), random_letters());
        let prefix = format!("{PRIVATE_PREFIX}{unique}_");
        let root = Path::new(PRIVATE_FOLDER).join(format!("{PRIVATE_ROOT}{label}{unique}"));
        let lock = private_lock(&root, &prefix).ok();
        Self { config: BusConfig { prefix, root }, _lock: lock }
    }

    /// A folder of the bus's for other files of its owner, closed to other users; gone with it.
    ///
    /// # Errors
    /// It cannot be made.
    pub fn folder(&self) -> Result<PathBuf, BusError> {
        let folder = self.config.root.join("files");
        let made = fs::DirBuilder::new().recursive(true).mode(0o700).create(&folder);
        made.map_err(|source| BusError::File { path: folder.clone(), source })?;
        ensure_own(&self.config)?;
        Ok(folder)
    }

    /// Values to open it with, here or in a child process.
    pub fn config(&self) -> &BusConfig {
        &self.config
    }
}

impl Drop for PrivateBus {
    fn drop(&mut self) {
        // The bus is private and its owner is done with it: whoever still maps a file loses only its name.
        let _ = sweep(&self.config);
        let _ = unlink_all(&self.config);
        let _ = fs::remove_dir_all(&self.config.root);
        let _ = fs::remove_file(lock_of(&self.config.root));
    }
}

fn random_letters() -> String {
    const LETTERS: &[u8; 36] = b"0123456789abcdefghijklmnopqrstuvwxyz";
    // Keyed by the system's random numbers, anew for each process, and changed for each call.
    let mut number = RandomState::new().hash_one(std::process::id());
    let letter = |_| {
        let letter = LETTERS[(number % 36) as usize];
        number /= 36;
        char::from(letter)
    };
    (0..PRIVATE_RANDOM).map(letter).collect()
}

fn lock_of(root: &Path) -> PathBuf {
    let mut path = root.as_os_str().to_owned();
    path.push(PRIVATE_LOCK);
    PathBuf::from(path)
}

fn private_lock(root: &Path, prefix: &str) -> io::Result<File> {
    let mut file = rivet_files::open_lock(&lock_of(root))?;
    file.try_lock()?;
    file.write_all(prefix.as_bytes())?;
    Ok(file)
}

/// Removes private buses of this user whose processes were killed: demonstrations, replays, tests. Returns how many.
pub fn sweep_private() -> usize {
    let entries = fs::read_dir(PRIVATE_FOLDER).into_iter().flatten().flatten();
    entries.filter(|entry| abandoned(&entry.path()).is_some_and(|(config, lock)| remove_private(&config, lock))).count()
}

/// The bus whose lock this is, if nobody holds it.
fn abandoned(path: &Path) -> Option<(BusConfig, File)> {
    let root = Path::new(PRIVATE_FOLDER).join(path.file_name()?.to_str()?.strip_suffix(PRIVATE_LOCK)?);
    let name = root.file_name()?.to_str()?.strip_prefix(PRIVATE_ROOT)?.to_owned();
    let data = fs::symlink_metadata(path).ok().filter(|data| data.is_file() && is_old(data))?;
    if data.uid() != User::me().uid {
        return None;
    }
    let mut lock = rivet_files::open_lock(path).ok()?;
    lock.try_lock().ok()?;
    let mut prefix = String::new();
    (&mut lock).take(64).read_to_string(&mut prefix).ok()?;
    // What the lock says must be what its name says. An empty one was killed before anything else was made.
    let unique = prefix.strip_prefix(PRIVATE_PREFIX).and_then(|rest| rest.strip_suffix('_'));
    let fits = prefix.is_empty() || unique.is_some_and(|unique| name.ends_with(unique));
    fits.then_some((BusConfig { prefix, root }, lock))
}

fn remove_private(config: &BusConfig, lock: File) -> bool {
    let is_empty = config.prefix.is_empty();
    // Its children may live a moment longer; the next sweep comes.
    if !is_empty && purge(config).is_err() {
        return false;
    }
    let _ = fs::remove_dir_all(&config.root);
    let removed = fs::remove_file(lock_of(&config.root)).is_ok();
    drop(lock);
    removed
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bus_is_left_when_its_files_are_gone_and_nothing_comes() {
        let (config, begin) = (BusConfig::default(), Instant::now());
        let at = |seconds| begin + Duration::from_secs(seconds);
        let mut watch = BusWatch::default();
        let mut look = |whole, count, second| watch.look(&config, whole, count, at(second)).map(|news| news.is_some());
        assert!(!look(true, 0, 0).unwrap() && !look(true, 0, 60).unwrap(), "nobody has to be there");
        assert!(!look(false, 1, 61).unwrap() && !look(true, 1, 62).unwrap(), "once is no loss");
        assert!(!look(false, 2, 63).unwrap());
        assert!(look(false, 3, 64).unwrap(), "it is told");
        // Others have made a bus of their own in its place.
        assert!(!look(true, 4, 65).unwrap() && !look(true, 4, 69).unwrap(), "once, and who is there is not left");
        assert!(matches!(look(true, 4, 70), Err(BusError::Torn { .. })));
    }

    #[test]
    fn a_prefix_does_not_own_the_files_of_a_longer_one() {
        let hash = "9204dd183d1c4d8e1ff592a30766ffa6765aa8b5";
        assert!(belongs(format!("rivet_{hash}_node.0_10_0.global_mgmt").as_bytes(), "rivet_"));
        assert!(belongs(format!("rivet_{hash}.service").as_bytes(), "rivet_"));
        assert!(belongs(b"rivet_237684936999141467275705456500.event", "rivet_"));
        for other in ["rivet_demo12_", "rivet_a1_", "rivet_0123_", "rivet-"] {
            assert!(!belongs(format!("{other}{hash}.service").as_bytes(), "rivet_"), "{other}");
        }
        assert!(!belongs(b"rivet_", "rivet_") && !belongs(b"", "rivet_"));
    }

    #[test]
    fn purging_one_bus_leaves_its_neighbours_in_the_same_root_alone() {
        use crate::{Bus, RobotName};
        let private = PrivateBus::new("near");
        let neighbour = BusConfig { prefix: format!("{}b_", private.config().prefix), ..private.config().clone() };
        let robot = RobotName::new("arm").unwrap();
        let bus = Bus::open(&neighbour, &robot, "neighbour").unwrap();
        let writer = bus.command_writer().unwrap();
        drop(Bus::open(private.config(), &robot, "short").unwrap().command_writer().unwrap());
        purge(private.config()).unwrap();
        writer.write(&crate::Command { stamp_ns: 1, ..Default::default() });
        assert!(bus.command_reader().unwrap().latest().is_some());
        assert!(bus.command_writer().is_err(), "the neighbour's lock is still there");
        drop((writer, bus));
        purge(&neighbour).unwrap();
        assert!(!neighbour.root.exists());
    }
}
