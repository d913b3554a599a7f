//! Who may talk to the daemon: its own user alone, and nobody else can hold it up. Needs root, to be two users.

use rivet_ipc_schema::{Bus, BusConfig, ControlCommand, ControlStatus, PrivateBus};
use rivet_tests::process::eventually;
use rivet_tests::stretch::{Feed, Stretch, least, stall_limit};
use rivet_tests::two_link::{daemon, name, running, sample};
use rivet_tests::{rivet, robot};
use std::fs;
use std::io::Write as _;
use std::os::unix::fs::{DirBuilderExt as _, PermissionsExt as _, chown};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::Duration;

/// How often a stranger tries each thing, and samples of a stretch at least.
const TRIES: usize = 3;
const SAMPLES: u64 = 300;

/// Program and robot where another user can read them.
struct Outside {
    folder: tempfile::TempDir,
}

impl Outside {
    fn new() -> Outside {
        let folder =
            tempfile::Builder::new().permissions(fs::Permissions::from_mode(0o755)).tempdir().expect("a folder");
        let copy = |from: &Path, name: &str, mode| {
            let to = folder.path().join(name);
            fs::copy(from, &to).expect("copied");
            fs::set_permissions(to, fs::Permissions::from_mode(mode)).expect("set");
        };
        copy(Path::new(rivet().get_program()), "rivet", 0o755);
        copy(&robot("dd2"), "robot.toml", 0o644);
        copy(&robot("dd2").with_file_name("robot.urdf"), "robot.urdf", 0o644);
        Outside { folder }
    }

    /// Runs `rivet WORDS...` on the bus as the user nobody, at most for five seconds.
    fn nobody(&self, words: &[&str], config: &BusConfig) -> Output {
        let path = |name: &str| -> PathBuf { self.folder.path().join(name) };
        let mut command = Command::new("setpriv");
        command.args(["--reuid=65534", "--regid=65534", "--clear-groups", "timeout", "5"]).arg(path("rivet"));
        command.arg(words[0]).arg(path("robot.toml")).args(&words[1..]);
        command.args(["--prefix", &config.prefix, "--root"]).arg(&config.root);
        command.current_dir("/").stdin(Stdio::null()).output().expect("setpriv runs")
    }
}

/// Share of the periods that had passed when the loop came to them.
fn missed<'a>(stretches: impl Iterator<Item = &'a Stretch>) -> f64 {
    let add = |(missed, all): (u64, u64), s: &Stretch| (missed + s.missed, all + s.missed + s.periods);
    let (missed, all) = stretches.fold((0, 0), add);
    missed as f64 / all as f64
}

#[test]
fn another_user_can_neither_publish_nor_read_nor_hold_up_the_daemon() {
    if !rustix::process::geteuid().is_root() {
        let _ = writeln!(std::io::stderr(), "SKIPPED: to be two users this needs root");
        return;
    }
    let private = PrivateBus::new("access");
    let config = private.config();
    let bus = Bus::open(config, &name(), "test-robot").expect("the bus");
    let daemon = running(config);
    let mut feed = Feed::begin(&bus, &daemon, Duration::from_micros(500));
    let outside = Outside::new();

    // Every file is its owner's alone, and no folder can be written by others.
    for folder in [Path::new("/dev/shm"), &config.root, &config.root.join("nodes"), &config.root.join("services")] {
        for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
            let ours =
                folder != Path::new("/dev/shm") || entry.file_name().to_string_lossy().starts_with(&config.prefix);
            let mode = entry.metadata().map_or(0, |data| data.permissions().mode());
            assert!(!ours || mode & 0o027 == 0, "{}: {:o}", entry.path().display(), mode & 0o777);
        }
    }

    let root = fs::metadata(&config.root).expect("the root of the bus").permissions().mode();
    assert_eq!(root & 0o022, 0, "{}: {:o}", config.root.display(), root & 0o777);

    // The stream runs while a stranger tries everything there is to try, again and again, and without him in between.
    let mut alone = Vec::new();
    let mut tried = Vec::new();
    for words in [
        &["monitor", "--once"][..],
        &["control", "freeze"],
        &["sim", "--duration", "1"],
        &["daemon", "--best-effort"],
        &["control", "reload"],
    ] {
        let mut with = Vec::new();
        for _ in 0..TRIES {
            alone.push(feed.stretch(SAMPLES, |_| {}).0);
            let (stretch, output) = feed.stretch(SAMPLES, |_| outside.nobody(words, config));
            with.push(stretch);
            let (what, said) = (words[0], String::from_utf8_lossy(&output.stderr));
            assert!(!output.status.success(), "a stranger's {what} worked: {said}");
            assert!(output.stdout.is_empty(), "a stranger's {what} read {}", String::from_utf8_lossy(&output.stdout));
        }
        tried.push((words[0], with));
    }
    let last = feed.health();
    assert_eq!((last.samples, last.lost, last.gaps), (last.seq, 0, 0), "every sample went in meanwhile");
    assert_ne!(last.mode, u32::from(rivet_ipc_schema::DaemonMode::Frozen));
    let send = |stretch: &Stretch| u64::try_from(stretch.longest_send.as_nanos()).unwrap_or(u64::MAX);
    let limits = [stall_limit(&alone, Stretch::stall), stall_limit(&alone, send)];
    for (what, with) in &tried {
        let held = [least(with, Stretch::stall), least(with, send)];
        println!(
            "{what}: the loop and who feeds it held up for {held:?} ns at most; {limits:?} ns are nothing unusual"
        );
        assert!(held[0] <= limits[0], "a stranger's {what} holds the loop up for {} ns each time", held[0]);
        assert!(held[1] <= limits[1], "a stranger's {what} holds the robot up for {} ns each time", held[1]);
    }
    // Many short stalls would be none of those. A twentieth more than without him is what a busy machine takes.
    let (without, with) = (missed(alone.iter()), missed(tried.iter().flat_map(|(_, with)| with)));
    assert!(with <= 4.0 * without + 0.05, "{with:.3} of the periods missed, {without:.3} without a stranger");
}

/// `rivet WORDS...` on the bus as root.
fn root(words: &[&str], config: &BusConfig) -> Output {
    let mut command = rivet();
    command.arg(words[0]).arg(robot("dd2")).args(&words[1..]).args(["--prefix", &config.prefix, "--root"]);
    command.arg(&config.root).output().expect("the program starts")
}

/// What the doctor says of the bus itself, to root.
fn verdict(config: &BusConfig, option: Option<&str>) -> serde_json::Value {
    let mut words = vec!["doctor", "--seconds", "0", "--json"];
    words.extend(option);
    let found: serde_json::Value = serde_json::from_slice(&root(&words, config).stdout).expect("JSON");
    let check = if option.is_some() { "clean" } else { "bus" };
    let finding = found["findings"].as_array().expect("a list").iter().find(|finding| finding["check"] == check);
    finding.expect("looked at").clone()
}

/// The bus of the service's user, and root who looks at it: nothing of root's is left there that would keep the daemon
/// out. What an older program has left there is named, and can be taken away.
#[test]
fn root_does_not_shut_the_owner_of_a_bus_out() {
    if !rustix::process::geteuid().is_root() {
        let _ = writeln!(std::io::stderr(), "SKIPPED: to be two users this needs root");
        return;
    }
    let private = PrivateBus::new("theirs");
    let config = private.config();
    let outside = Outside::new();
    fs::DirBuilder::new().mode(0o750).create(&config.root).expect("made");
    chown(&config.root, Some(65534), Some(65534)).expect("given away");
    for words in [&["monitor", "--once"][..], &["control", "freeze"], &["daemon", "--best-effort"]] {
        let output = root(words, config);
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success() && said.contains("run as one user"), "{words:?}: {said}");
        assert!(said.contains(&config.root.display().to_string()), "{words:?}: {said}");
    }
    assert_eq!(verdict(config, None)["severity"], "note");
    assert_eq!(fs::read_dir(&config.root).expect("there").count(), 0, "nothing was made");

    // As an older program of root's did.
    let nodes = config.root.join("nodes");
    fs::DirBuilder::new().mode(0o750).create(&nodes).expect("made");
    let refused = outside.nobody(&["daemon", "--best-effort"], config);
    let said = String::from_utf8_lossy(&refused.stderr);
    assert_eq!(refused.status.code(), Some(69), "{said}");
    assert!(said.contains(&format!("{} belongs to the user root", nodes.display())), "{said}");
    assert!(said.contains(&config.clean_command()), "{said}");
    let mixed = verdict(config, None);
    assert_eq!(mixed["severity"], "failure", "{mixed}");
    assert_eq!(verdict(config, Some("--clean"))["severity"], "ok");
    assert!(config.root.exists() && !nodes.exists(), "root's is gone, the owner's stays");
    let alone = outside.nobody(&["monitor", "--once", "--patience", "0.5"], config);
    let said = String::from_utf8_lossy(&alone.stderr);
    assert!(said.contains("neither rivetd nor rivet-controller"), "its user joins it: {said}");
}

#[test]
fn a_second_daemon_is_refused_and_the_first_works_on() {
    let private = PrivateBus::new("second");
    let config = private.config();
    let bus = Bus::open(config, &name(), "test-robot").expect("the bus");
    let states = bus.joint_state_publisher().expect("a publisher");
    let health = bus.health_subscriber().expect("a subscriber");
    let client = bus.control_client().expect("a client");
    let _first = running(config);
    eventually("rivetd listens", || (states.subscribers() > 0).then_some(()));
    // Answers come from one server: who asks is never answered by a second one.
    let ask = || client.ask(ControlCommand::Resume, Duration::from_secs(30)).expect("asked").expect("an answer");
    assert_eq!(ControlStatus::try_from(ask().status), Ok(ControlStatus::Done));
    let second = daemon(config).output().expect("the program starts");
    assert_eq!(second.status.code(), Some(69), "{second:?}");
    let said = String::from_utf8_lossy(&second.stderr);
    assert!(said.contains("another program is its writer"), "{said}");
    for seq in 1..=300 {
        states.send(&sample(seq)).expect("sent");
    }
    eventually("the first daemon has all samples", || {
        health.receive().expect("received").filter(|health| health.samples == 300 && health.lost == 0)
    });
    assert_eq!(ControlStatus::try_from(ask().status), Ok(ControlStatus::Done));
}
