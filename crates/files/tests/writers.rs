//! What is written, where, and what stays untouched.

use rivet_files::{Draft, fill_whole, open_lock, sweep, writable, writable_folder, write_whole};
use rustix::fs::{CWD, RenameFlags, renameat_with};
use std::fs::{self, Permissions};
use std::io::{self, Write as _};
use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _, lchown, symlink};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

/// Another user than the one that runs the tests.
const STRANGER: u32 = 65534;

/// Rounds of a race, and results of each kind that it has to see.
const LEAST_ROUNDS: usize = 2000;
const MOST_ROUNDS: usize = 200_000;

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).expect("listed").flatten();
    let mut names: Vec<String> = entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// A folder like /tmp, or none where the tests do not run as root.
fn shared_folder() -> Option<tempfile::TempDir> {
    if !rustix::process::geteuid().is_root() {
        let _ = writeln!(io::stderr(), "SKIPPED: to be two users this needs root");
        return None;
    }
    let folder = tempfile::tempdir().expect("a folder");
    fs::set_permissions(folder.path(), Permissions::from_mode(0o1777)).expect("set");
    Some(folder)
}

fn strangers_link(to: &Path, at: &Path) {
    symlink(to, at).and_then(|()| lchown(at, Some(STRANGER), Some(STRANGER))).expect("a stranger's link");
}

#[test]
fn replaces_a_strangers_link_and_leaves_its_target() {
    let Some(folder) = shared_folder() else { return };
    let secret = tempfile::tempdir().expect("a folder");
    let (target, link) = (secret.path().join("target"), folder.path().join("report.json"));
    fs::write(&target, "root's").expect("written");
    strangers_link(&target, &link);
    writable(&link).and_then(|()| write_whole(&link, "report")).expect("written");
    assert_eq!(fs::read_to_string(&target).expect("there"), "root's");
    assert!(fs::symlink_metadata(&link).expect("there").is_file());
    assert_eq!(fs::read_to_string(&link).expect("there"), "report");
    // A link to a file that is not there makes none there.
    let (absent, link) = (secret.path().join("absent"), folder.path().join("new.json"));
    strangers_link(&absent, &link);
    write_whole(&link, "report").expect("written");
    assert!(!absent.exists() && fs::symlink_metadata(&link).expect("there").is_file());
}

#[test]
fn does_not_write_to_a_device_behind_a_strangers_link() {
    let Some(folder) = shared_folder() else { return };
    for to in ["/dev/null", "/dev/stdout", "/proc/self/fd/1"] {
        let link = folder.path().join("out");
        strangers_link(Path::new(to), &link);
        write_whole(&link, "report").expect("written");
        assert!(fs::symlink_metadata(&link).expect("there").is_file(), "{to}: the link was replaced");
        fs::remove_file(&link).expect("there");
    }
}

#[test]
fn refuses_a_strangers_link_on_the_way() {
    let Some(folder) = shared_folder() else { return };
    let secret = tempfile::tempdir().expect("a folder");
    let link = folder.path().join("folder");
    strangers_link(secret.path(), &link);
    let why = write_whole(&link.join("report.json"), "report").expect_err("refused").to_string();
    assert!(why.contains("is a link of user 65534"), "{why}");
    assert!(writable(&link.join("report.json")).is_err());
    assert_eq!(names(secret.path()), [""; 0]);
}

/// Exchanges two names until the guard is dropped.
struct Exchange {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Exchange {
    /// None where the file system cannot exchange names.
    fn begin(one: PathBuf, other: PathBuf) -> Option<Exchange> {
        let exchange = move || renameat_with(CWD, &one, CWD, &other, RenameFlags::EXCHANGE);
        if let Err(why) = exchange() {
            let _ = writeln!(io::stderr(), "SKIPPED: this file system does not exchange names: {why}");
            return None;
        }
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        let thread = std::thread::spawn(move || {
            while !stopped.load(Ordering::Relaxed) {
                exchange().expect("exchanged");
            }
        });
        Some(Exchange { stop, thread: Some(thread) })
    }
}

impl Drop for Exchange {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        let ended = self.thread.take().map(JoinHandle::join);
        assert!(std::thread::panicking() || ended.is_none_or(|ended| ended.is_ok()), "the exchange failed");
    }
}

/// The link and the folder take each other's place between any two calls of the writer.
#[test]
fn never_writes_behind_a_strangers_link_that_takes_the_place_of_a_folder() {
    let Some(shared) = shared_folder() else { return };
    let secret = tempfile::tempdir().expect("a folder");
    let (folder, link) = (shared.path().join("folder"), shared.path().join("link"));
    fs::create_dir_all(folder.join("deep")).expect("made");
    fs::create_dir(secret.path().join("deep")).expect("made");
    let targets = ["report.json", "deep/report.json", ".rivet-0123456789ab.part"].map(|name| secret.path().join(name));
    for target in &targets {
        fs::write(target, "root's").expect("written");
    }
    strangers_link(secret.path(), &link);
    let Some(exchange) = Exchange::begin(folder.clone(), link) else { return };
    let (mut written, mut refused) = (0, 0);
    for round in 0..MOST_ROUNDS {
        let results = [
            fill_whole(&folder.join("report.json"), |part| part.write_all(b"report")),
            fill_whole(&folder.join("deep/report.json"), |part| part.write_all(b"report")),
            writable(&folder.join("other.json")),
            open_lock(&folder.join("lock")).map(drop),
        ];
        sweep(&folder);
        written += results.iter().filter(|result| result.is_ok()).count();
        refused += results.iter().filter(|result| result.is_err()).count();
        if round >= LEAST_ROUNDS && written.min(refused) >= LEAST_ROUNDS {
            break;
        }
    }
    drop(exchange);
    assert!(written > 0 && refused > 0, "{written} written, {refused} refused: the names were not exchanged");
    assert_eq!(names(secret.path()), [".rivet-0123456789ab.part", "deep", "report.json"]);
    assert_eq!(names(&secret.path().join("deep")), ["report.json"]);
    for target in &targets {
        assert_eq!(fs::read_to_string(target).expect("there"), "root's", "{}", target.display());
    }
}

/// Needs no root: the link is this user's, and comes after the folder was opened.
#[test]
fn stays_in_the_opened_folder_when_a_link_takes_its_place() {
    let around = tempfile::tempdir().expect("a folder");
    let [folder, moved, other] = ["folder", "moved", "other"].map(|name| around.path().join(name));
    for made in [&folder, &other] {
        fs::create_dir(made).expect("made");
    }
    fs::write(other.join("report.json"), "other").expect("written");
    let mut draft = Draft::new(&folder.join("report.json")).expect("begun");
    let dropped = Draft::new(&folder.join("dropped.json")).expect("begun");
    let replace_by_link = |_: &mut fs::File| fs::rename(&folder, &moved).and_then(|()| symlink(&other, &folder));
    fill_whole(&folder.join("filled.json"), replace_by_link).expect("written");
    draft.file().write_all(b"report").expect("written");
    draft.publish().expect("renamed");
    drop(dropped);
    assert_eq!(names(&moved), ["filled.json", "report.json"]);
    assert_eq!(fs::read_to_string(moved.join("report.json")).expect("there"), "report");
    assert_eq!(names(&other), ["report.json"]);
    assert_eq!(fs::read_to_string(other.join("report.json")).expect("there"), "other");
}

/// As an ordinary user, in a folder where somebody else has taken the name.
#[test]
fn names_the_owner_of_a_name_that_is_taken() {
    let Some(folder) = shared_folder() else { return };
    let taken = folder.path().join("report.json");
    fs::write(&taken, "root's").expect("written");
    let program = std::env::current_exe().expect("this program");
    let copy = folder.path().join("program");
    fs::copy(program, &copy).expect("copied");
    let output = Command::new("setpriv")
        .args(["--reuid=65534", "--regid=65534", "--clear-groups"])
        .arg(&copy)
        .args(["--exact", "writes_what_the_environment_names", "--nocapture"])
        .env("RIVET_TEST_OUTPUT", &taken)
        .current_dir("/")
        .output()
        .expect("setpriv runs");
    let said = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    assert!(said.contains("belongs to user 0, and only that user may replace it"), "{said}");
    assert_eq!(fs::read_to_string(&taken).expect("there"), "root's");
}

/// Run by another test, in a process of its own.
#[test]
fn writes_what_the_environment_names() {
    if let Some(path) = std::env::var_os("RIVET_TEST_OUTPUT") {
        println!("{:?}", write_whole(Path::new(&path), "a stranger's").map_err(|why| why.to_string()));
    }
}

#[test]
fn replaces_an_own_link_and_leaves_its_target() {
    let folder = tempfile::tempdir().expect("a folder");
    let (file, link) = (folder.path().join("file"), folder.path().join("link"));
    fs::write(&file, "old").expect("written");
    symlink("file", &link).expect("a link");
    writable(&link).and_then(|()| write_whole(&link, "new")).expect("written");
    assert_eq!([&file, &link].map(|path| fs::read_to_string(path).expect("there")), ["old", "new"]);
    assert!(fs::symlink_metadata(&link).expect("there").is_file());
    assert_eq!(names(folder.path()), ["file", "link"]);
}

#[test]
fn writes_to_a_pipe_also_through_an_own_link() {
    let folder = tempfile::tempdir().expect("a folder");
    let (pipe, link) = (folder.path().join("pipe"), folder.path().join("link"));
    let made = Command::new("mkfifo").arg(&pipe).status();
    if !made.is_ok_and(|status| status.success()) {
        return;
    }
    symlink("pipe", &link).expect("a link");
    for path in [&pipe, &link] {
        let reader = std::thread::spawn({
            let pipe = pipe.clone();
            move || fs::read_to_string(pipe).expect("read")
        });
        writable(path).and_then(|()| write_whole(path, "through")).expect("written");
        assert_eq!(reader.join().expect("ended"), "through");
    }
    assert_eq!(names(folder.path()), ["link", "pipe"]);
    write_whole(Path::new("/dev/null"), "nowhere").expect("a device");
}

/// Its reader would get the output, or hold the writer up for ever.
#[test]
fn pipe_of_another_user_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let (pipe, link) = (folder.path().join("pipe"), folder.path().join("link"));
    let made = Command::new("mkfifo").arg(&pipe).status().is_ok_and(|status| status.success());
    if !made || lchown(&pipe, Some(STRANGER), None).is_err() {
        let _ = writeln!(io::stderr(), "SKIPPED: only root can give a pipe away");
        return;
    }
    symlink("pipe", &link).expect("a link");
    for path in [&pipe, &link] {
        let why = writable(path).and_then(|()| write_whole(path, "secret")).expect_err("another user's").to_string();
        assert!(why.contains(&format!("pipe of user {STRANGER}")), "{why}");
    }
}

/// Into a file, a name of standard output goes on where the shell has begun.
#[test]
fn standard_output_in_a_file_is_written_where_it_stands() {
    let folder = tempfile::tempdir().expect("a folder");
    let (file, program) = (folder.path().join("said"), std::env::current_exe().expect("this program"));
    for name in ["/dev/stdout", "/proc/self/fd/1", "/dev/fd/1"] {
        let output = fs::File::create(&file).expect("made");
        let status = Command::new(&program)
            .args(["--exact", "writes_what_the_environment_names", "--nocapture"])
            .env("RIVET_TEST_OUTPUT", name)
            .stdout(output)
            .status()
            .expect("started");
        let said = fs::read_to_string(&file).expect("there");
        assert!(status.success() && said.contains("a stranger's") && said.contains("running 1 test"), "{name}: {said}");
        assert!(fs::symlink_metadata("/dev/stdout").expect("there").is_symlink(), "{name} stays what it is");
    }
}

#[test]
fn keeps_permissions_and_gives_those_of_a_new_file() {
    let folder = tempfile::tempdir().expect("a folder");
    let (plain, new, kept) = (folder.path().join("plain"), folder.path().join("new"), folder.path().join("kept"));
    fs::write(&plain, "").expect("written");
    fs::write(&kept, "").expect("written");
    fs::set_permissions(&kept, Permissions::from_mode(0o640)).expect("set");
    for path in [&new, &kept] {
        write_whole(path, "text").expect("written");
    }
    let mode = |path: &PathBuf| fs::metadata(path).expect("there").mode() & 0o777;
    assert_eq!((mode(&new), mode(&kept)), (mode(&plain), 0o640));
    Draft::new(&new).expect("begun").with_mode(0o755).publish().expect("there");
    assert_eq!(mode(&new), 0o755);
}

#[test]
fn a_folder_is_asked_before_it_is_made() {
    let folder = tempfile::tempdir().expect("a folder");
    let (file, deep) = (folder.path().join("file"), folder.path().join("a/b/c"));
    fs::write(&file, "text").expect("written");
    assert!(writable_folder(folder.path()).is_ok() && writable_folder(&deep).is_ok());
    for no in [file.clone(), file.join("a"), PathBuf::from("/proc/x/y")] {
        assert!(writable_folder(&no).is_err(), "{}", no.display());
    }
    assert_eq!(names(folder.path()), ["file"], "nothing was made");
}

#[test]
fn a_folder_that_is_not_there_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let why = writable(&folder.path().join("no/report.json")).expect_err("no folder").to_string();
    assert_eq!(why, format!("there is no folder {}", folder.path().join("no").display()));
    assert!(writable(folder.path()).is_err(), "a folder is no file");
    assert!(writable(Path::new("report.json")).is_ok(), "a bare name has a folder");
}

#[test]
fn what_fails_leaves_what_was_there() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("file");
    write_whole(&file, "old").expect("written");
    let failed = fill_whole(&file, |part| part.write_all(b"new").and(Err(io::Error::other("full"))));
    assert!(failed.is_err() && fs::read_to_string(&file).expect("there") == "old");
    assert_eq!(names(folder.path()), ["file"]);
}

#[test]
fn sweeps_what_a_killed_writer_left_and_nothing_else() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let living = Draft::new(&at("living")).expect("begun");
    let held = names(folder.path());
    let kept = [".rivet-short.part", ".rivet-0123456789ab", "0123456789ab.part", ".rivet-0123456789-b.part"];
    for name in kept.iter().chain(&[".rivet-0123456789ab.part", ".rivet-ABCDEFGHIJKL.part"]) {
        fs::write(at(name), "half").expect("written");
    }
    symlink(at(kept[0]), at(".rivet-linklinklink.part")).expect("a link");
    let mut stay: Vec<String> = kept.map(str::to_owned).into_iter().chain(held).collect();
    stay.push(".rivet-linklinklink.part".to_owned());
    if rustix::process::geteuid().is_root() {
        fs::write(at(".rivet-strangers123.part"), "theirs").expect("written");
        lchown(at(".rivet-strangers123.part"), Some(STRANGER), None).expect("given away");
        stay.push(".rivet-strangers123.part".to_owned());
    }
    stay.sort();
    assert_eq!(sweep(folder.path()), 2);
    assert_eq!(names(folder.path()), stay);
    living.publish().expect("its writer lives");
    assert!(at("living").is_file());
}

#[test]
fn a_lock_is_closed_to_others_and_no_link() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let mode = |name: &str| fs::metadata(at(name)).expect("there").mode() & 0o777;
    open_lock(&at("new")).expect("made");
    fs::write(at("open"), "").expect("written");
    fs::set_permissions(at("open"), Permissions::from_mode(0o644)).expect("set");
    open_lock(&at("open")).expect("opened");
    assert_eq!((mode("new"), mode("open")), (0o600, 0o600));
    symlink(at("new"), at("link")).expect("a link");
    assert!(open_lock(&at("link")).is_err());
    if rustix::process::geteuid().is_root() {
        lchown(at("open"), Some(STRANGER), None).expect("given away");
        assert!(open_lock(&at("open")).expect_err("theirs").to_string().contains("user 65534 owns it"));
    }
}

#[test]
fn a_new_file_replaces_and_follows_nothing() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.mcap");
    rivet_files::create_new(&path).and_then(|mut file| file.write_all(b"first")).expect("made");
    let again = rivet_files::create_new(&path).expect_err("it is there");
    assert_eq!(again.kind(), io::ErrorKind::AlreadyExists);
    assert_eq!(fs::read(&path).expect("there"), b"first");
    // Nor is a link followed, wherever it leads.
    let (target, link) = (folder.path().join("absent"), folder.path().join("link.mcap"));
    symlink(&target, &link).expect("a link");
    let linked = rivet_files::create_new(&link).expect_err("a link");
    assert_eq!(linked.kind(), io::ErrorKind::AlreadyExists);
    assert!(!target.exists());
}
