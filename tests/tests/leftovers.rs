//! What is left behind, and what is in the way: half-made files of a process that was killed while it started, a store that
//! cannot be written for a while, a state file that is none, a robot file with a mistake beside a daemon that runs.

use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, SystemTime};

use rivet_ipc_schema::{
    Bus, BusConfig, ControlClient, ControlCommand, ControlStatus, PrivateBus, RobotName, StateFolder,
};
use rivet_store::Store;
use rivet_tests::process::{Process, eventually};
use rivet_tests::side::{Arm, daemon};
use rivet_tests::{rivet, robot, two_link};

/// A file that its maker, who was killed some time ago, did not finish: the library makes files ready by their mode.
fn half_made(path: &Path, content: &[u8], mode: u32) {
    let _ = std::fs::remove_file(path);
    std::fs::write(path, content).expect("written");
    let file = std::fs::File::options().write(true).open(path).expect("opened");
    file.set_modified(SystemTime::now() - Duration::from_secs(60)).expect("set");
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(mode)).expect("set");
}

fn names(folder: &Path, suffix: &str, prefix: &str) -> Vec<std::path::PathBuf> {
    let entries = std::fs::read_dir(folder).expect("the folder is there").map(|entry| entry.expect("an entry").path());
    let name = |path: &Path| path.file_name().expect("a name").to_string_lossy().into_owned();
    entries.filter(|path| name(path).starts_with(prefix) && name(path).ends_with(suffix)).collect()
}

/// A daemon that listens, or what stood in its way.
fn comes_up(config: &BusConfig) -> Process {
    let process = two_link::running(config);
    let health = eventually("the bus", || two_link::bus(config, "test-onlooker").health_subscriber().ok());
    eventually("it reports", || health.receive().expect("received"));
    process
}

/// A process that is killed while it makes a service leaves a description that nobody may read yet, or half of the counter that
/// all need. Who comes next would wait for its maker for ever; it puts that right instead.
#[test]
fn what_a_killed_process_left_half_made_keeps_nobody_from_starting() {
    let private = PrivateBus::new("half");
    let config = private.config();
    let services = config.root.join("services");
    let mut first = comes_up(config);
    let made = names(&services, ".service", &config.prefix);
    assert!(made.len() >= 8, "the services are where we look: {made:?}");
    let counter = names(Path::new("/dev/shm"), ".global_mgmt", &config.prefix);
    assert_eq!(counter.len(), 1, "{counter:?}");
    assert!(first.end("-TERM").success());
    for content in [&b""[..], b"half of a description"] {
        for path in &made {
            half_made(path, content, 0o600);
        }
        assert!(comes_up(config).end("-TERM").success());
    }
    for (content, mode) in [(&[][..], 0o600), (&[0; 8], 0o200), (&[0; 16], 0o200)] {
        half_made(&counter[0], content, mode);
        assert!(comes_up(config).end("-TERM").success());
    }
}

/// A process that is killed between making shared memory and making it ready leaves what the bus library waits for, for ever: neither
/// who comes next does, nor who clears up, nor who only looks.
#[test]
fn memory_that_a_killed_process_left_half_made_holds_nobody_up() {
    let private = PrivateBus::new("halfmem");
    let config = private.config();
    let killed = || {
        let mut process = comes_up(config);
        assert!(!process.end("-KILL").success());
        let made = names(Path::new("/dev/shm"), ".dynamic", &config.prefix);
        assert!(made.len() >= 4, "memory is where we look: {made:?}");
        for path in &made {
            half_made(path, &[], 0o200);
        }
    };
    killed();
    assert!(comes_up(config).end("-TERM").success());
    killed();
    let mut look = rivet();
    look.arg("doctor").arg(robot("dd2")).args(["--seconds", "0", "--json", "--prefix", &config.prefix, "--root"]);
    Process::start(look.arg(&config.root).stdout(Stdio::null()).stderr(Stdio::null())).ends();
    killed();
    clean(config);
    assert_eq!(remains(config), Vec::<std::path::PathBuf>::new());
}

/// A process that is killed between describing a service and making its memory leaves a description that looks ready. Who comes next would wait
/// for the memory.
#[test]
fn services_without_memory_keep_nobody_from_starting() {
    let private = PrivateBus::new("nomem");
    let config = private.config();
    let services = || names(&config.root.join("services"), ".service", &config.prefix);
    let orphan = |which: usize| {
        let mut process = comes_up(config);
        assert!(!process.end("-KILL").success());
        let made = names(Path::new("/dev/shm"), ".dynamic", &config.prefix);
        assert!(made.len() >= 4, "memory is where we look: {made:?}");
        for path in made.iter().skip(which).step_by(2) {
            std::fs::remove_file(path).expect("removed");
        }
        // The descriptions are older than a service that is being made.
        for path in services() {
            let description = std::fs::read(&path).expect("read");
            half_made(&path, &description, 0o400);
        }
    };
    for which in 0..2 {
        orphan(which);
        let waits = std::time::Instant::now();
        let mut up = comes_up(config);
        println!("up after {:?}", waits.elapsed());
        // What is left of the first run went, and the second has all of its services.
        let all = services().len();
        assert!(all >= 8 && names(Path::new("/dev/shm"), ".dynamic", &config.prefix).len() >= all, "{all}");
        assert!(up.end("-TERM").success());
    }
}

/// Kills of a test run; `RIVET_KILLS` asks for another number.
const KILLS: u64 = 25;

/// Every entry below a folder, and every file of the bus in shared memory.
fn remains(config: &BusConfig) -> Vec<std::path::PathBuf> {
    let mut found = names(Path::new("/dev/shm"), "", &config.prefix);
    let mut folders = vec![config.root.clone()];
    while let Some(folder) = folders.pop() {
        let Ok(entries) = std::fs::read_dir(&folder) else { continue };
        found.push(folder);
        for entry in entries.flatten() {
            if entry.file_type().is_ok_and(|kind| kind.is_dir()) {
                folders.push(entry.path());
            } else {
                found.push(entry.path());
            }
        }
    }
    found
}

fn clean(config: &BusConfig) {
    let mut doctor = rivet();
    doctor.args(["doctor", "--seconds", "0", "--clean", "--json", "--prefix", &config.prefix, "--root"]);
    let mut process = Process::start(doctor.arg(&config.root).stdout(Stdio::piped()));
    process.ends();
    let said = process.0.stdout.take().expect("a pipe");
    let found: serde_json::Value = serde_json::from_reader(said).expect("JSON");
    let clean = found["findings"].as_array().expect("a list").iter().find(|finding| finding["check"] == "clean");
    assert_eq!(clean.expect("cleaned")["severity"], "ok", "{found}");
}

/// Daemons and controllers that are killed at any instant of their start: afterwards `rivet doctor --clean` leaves nothing of the bus,
/// and the next daemon nothing half written in the state folder.
#[test]
fn processes_killed_while_they_start_leave_nothing_that_is_not_cleaned() {
    let kills = std::env::var("RIVET_KILLS").ok().and_then(|kills| kills.parse().ok()).unwrap_or(KILLS);
    let folder = tempfile::tempdir().expect("a folder");
    let (state, said) = (folder.path().join("state"), folder.path().join("said"));
    let private = PrivateBus::new("kills");
    let config = private.config();
    // A start takes some tens of milliseconds: the kills are spread over it, each kind of process at each instant.
    let start = {
        let begin = std::time::Instant::now();
        let mut first = comes_up(config);
        let took = begin.elapsed();
        assert!(first.end("-TERM").success());
        took
    };
    let mut left_folders = false;
    for kill in 0..kills {
        let mut command = if kill % 2 == 0 {
            daemon(&robot("dd2"), config, &said)
        } else {
            let mut controller = rivet();
            controller.arg("controller").arg(robot("dd2")).args([
                "--best-effort",
                "--prefix",
                &config.prefix,
                "--root",
            ]);
            controller.arg(&config.root).stderr(Stdio::null());
            controller
        };
        let mut process = Process::start(command.arg("--state").arg(&state));
        std::thread::sleep(start.mul_f64(kill as f64 / kills as f64));
        process.0.kill().and_then(|()| process.0.wait()).expect("killed");
        left_folders |= config.root.join("nodes").read_dir().is_ok_and(|mut entries| entries.next().is_some());
    }
    assert!(left_folders, "the kills fell into the starts");
    // As a writer that was killed leaves it.
    std::fs::write(state.join(".rivet-0123456789ab.part"), "half").expect("written");
    clean(config);
    assert_eq!(remains(config), Vec::<std::path::PathBuf>::new());
    let mut next = Process::start(daemon(&robot("dd2"), config, &said).arg("--state").arg(&state));
    let health = eventually("the bus", || two_link::bus(config, "test-onlooker").health_subscriber().ok());
    eventually("it reports", || health.receive().expect("received"));
    assert_eq!(names(&state, ".part", "."), Vec::<std::path::PathBuf>::new(), "its start swept");
    assert!(next.end("-TERM").success());
}

/// A demonstration that is killed leaves its bus and its files; the next one, or the doctor, removes them.
#[test]
fn a_killed_demonstration_is_cleaned_away() {
    let mut demo = rivet().arg("demo").stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("it starts");
    let begins = format!("rivet-demo{}_", demo.id());
    eventually("its folder", || (names(Path::new("/tmp"), "", &begins).len() > 1).then_some(()));
    demo.kill().and_then(|()| demo.wait()).expect("killed");
    assert!(!names(Path::new("/tmp"), "", &begins).is_empty(), "it was killed before it could");
    let private = PrivateBus::new("doctor");
    eventually("nothing is left", || {
        clean(private.config());
        names(Path::new("/tmp"), "", &begins).is_empty().then_some(())
    });
}

/// A state folder that cannot be written from the start ends no daemon: health reports it, and that it can be written again.
#[test]
fn a_daemon_starts_beside_a_state_folder_that_cannot_be_written() {
    let folder = tempfile::tempdir().expect("a folder");
    let (state, said) = (folder.path().join("state"), folder.path().join("said"));
    std::fs::write(&state, "a file in its place").expect("written");
    let private = PrivateBus::new("atstart");
    let mut side = Side::new(private.config());
    let mut process = Process::start(daemon(&robot("dd2"), private.config(), &said).arg("--state").arg(&state));
    eventually("it listens", || (side.states.subscribers() > 0).then_some(()));
    let health = two_link::bus(private.config(), "test-onlooker").health_subscriber().expect("a port");
    let mut reports = |wanted: StateFolder| {
        eventually("it reports", || {
            side.go(50);
            let found = health.receive_newest().expect("received");
            found.is_some_and(|health| health.state_folder == u32::from(wanted)).then_some(())
        });
    };
    reports(StateFolder::Unwritable);
    std::fs::remove_file(&state).and_then(|()| std::fs::create_dir(&state)).expect("a folder");
    reports(StateFolder::Writable);
    assert!(process.end("-TERM").success());
    let said = std::fs::read_to_string(&said).expect("it said something");
    assert!(said.contains("runs without storing"), "{said}");
}

/// A child that starts after its parent was killed belongs to another process already: it ends at once.
#[test]
fn a_child_whose_parent_has_ended_does_not_start() {
    let private = PrivateBus::new("orphan");
    let config = private.config();
    for words in [["daemon"].as_slice(), &["controller"], &["sim"]] {
        let mut command = rivet();
        command.args(words).arg(robot("dd2")).args(["--die-with-parent", "--prefix", &config.prefix, "--root"]);
        command.arg(&config.root);
        if words != ["sim"] {
            command.arg("--best-effort");
        }
        // No process has this number.
        command.env("RIVET_PARENT_PID", i32::MAX.to_string()).stdout(Stdio::null());
        let output = command.output().expect("the program starts");
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success() && said.contains("the parent process has ended"), "{words:?}: {said}");
    }
}

/// A state folder that cannot be written shows in the health of both programs and in the monitor, and that it can again.
#[test]
fn a_state_folder_that_cannot_be_written_shows_in_health_and_monitor() {
    let folder = tempfile::tempdir().expect("a folder");
    let (state, said) = (folder.path().join("state"), folder.path().join("said"));
    let private = PrivateBus::new("unwrit");
    let config = private.config();
    let mut side = Side::new(config);
    let mut process = Process::start(daemon(&robot("dd2"), config, &said).arg("--state").arg(&state));
    let mut controller = rivet();
    controller.arg("controller").arg(robot("dd2")).args(["--best-effort", "--die-with-parent", "--prefix"]);
    controller.arg(&config.prefix).arg("--root").arg(&config.root).arg("--state").arg(&state);
    let mut controller = Process::start(controller.stderr(Stdio::null()));
    eventually("both listen", || (side.states.subscribers() > 1).then_some(()));
    let onlooker = two_link::bus(config, "test-onlooker");
    let (daemons, controllers) =
        (onlooker.health_subscriber().expect("a port"), onlooker.controller_health_subscriber().expect("a port"));
    let mut shows = |wanted: StateFolder| {
        let (mut of_daemon, mut of_controller) = (None, None);
        eventually("both say so", || {
            side.go(50);
            of_daemon = daemons.receive_newest().expect("received").map(|h| h.state_folder).or(of_daemon);
            of_controller = controllers.receive_newest().expect("received").map(|h| h.state_folder).or(of_controller);
            ([of_daemon, of_controller] == [Some(u32::from(wanted)); 2]).then_some(())
        });
        let mut monitor = rivet();
        monitor.args(["monitor", "--once", "--prefix", &config.prefix, "--root"]).arg(&config.root).arg(robot("dd2"));
        String::from_utf8(monitor.output().expect("the program starts").stdout).expect("text")
    };
    let text = shows(StateFolder::Writable);
    assert_eq!(text.matches("folder can be written").count(), 2, "{text}");
    let aside = folder.path().join("aside");
    std::fs::rename(&state, &aside).expect("moved");
    std::fs::write(&state, "a file in its place").expect("written");
    let text = shows(StateFolder::Unwritable);
    assert_eq!(text.matches("FOLDER CANNOT BE WRITTEN").count(), 2, "{text}");
    std::fs::remove_file(&state).and_then(|()| std::fs::rename(&aside, &state)).expect("moved back");
    shows(StateFolder::Writable);
    assert!(process.end("-TERM").success() && controller.end("-TERM").success());
    let said = std::fs::read_to_string(&said).expect("it said something");
    assert_eq!(said.matches("nothing can be stored or recorded").count(), 1, "once: {said}");
}

/// Where each robot has a folder of its own now, what an earlier installation stored in one for all is taken up once.
#[test]
fn state_of_an_earlier_installation_is_taken_up_once() {
    let folder = tempfile::tempdir().expect("a folder");
    let (before, state, said) = (folder.path().join("all"), folder.path().join("all/dd2"), folder.path().join("said"));
    let private = PrivateBus::new("before");
    let config = private.config();
    let hash = rivet_config::load(robot("dd2")).expect("the arm is there").hash;
    let mut side = Side::new(config);
    let stored = |at: &Path| Store::reader(at, "dd2").load(hash).knowledge;
    let mut old = Process::start(daemon(&robot("dd2"), config, &said).arg("--state").arg(&before));
    eventually("it listens", || (side.states.subscribers() > 0).then_some(()));
    eventually("something is stored", || {
        side.go(500);
        stored(&before)
    });
    assert!(old.end("-TERM").success());
    // The bytes of the files: numbers that are none, as a memory has some, are not equal to themselves.
    let files = |at: &Path| -> Vec<_> {
        let mut paths = if at.is_dir() { names(at, ".state", "dd2.") } else { Vec::new() };
        paths.sort();
        let named = |path: &std::path::PathBuf| path.file_name().expect("a name").to_owned();
        paths.iter().map(|path| (named(path), std::fs::read(path).expect("read"))).collect()
    };
    let expected = files(&before);
    assert!(!expected.is_empty(), "stored");
    let with_both = |command: &mut Command| {
        command.arg("--state").arg(&state).arg("--state-before").arg(&before);
    };
    let mut command = daemon(&robot("dd2"), config, &said);
    with_both(&mut command);
    let mut new = Process::start(&mut command);
    eventually("it is copied", || (files(&state).len() == expected.len()).then_some(()));
    assert!(files(&state) == expected, "copied byte for byte");
    assert!(files(&before) == expected, "what was there stays");
    let bus = two_link::bus(config, "test-other");
    let client = bus.control_client().expect("a client");
    let reset = || {
        let reply = client.ask(ControlCommand::Reset, Duration::from_secs(30)).expect("asked").expect("answered");
        (ControlStatus::try_from(reply.status) == Ok(ControlStatus::Done)).then_some(())
    };
    eventually("the reset is done", reset);
    assert!(new.end("-TERM").success());
    let mut command = daemon(&robot("dd2"), config, &said);
    with_both(&mut command);
    let mut again = Process::start(&mut command);
    eventually("it says what it found", || {
        let said = std::fs::read_to_string(&said).expect("it said something");
        // The first daemon, with no state yet, has said so as well.
        (said.matches("starts from the robot file's").count() == 2).then_some(())
    });
    assert_eq!(stored(&state), None, "what was forgotten stays forgotten");
    assert!(again.end("-TERM").success());
}

/// The arm `dd2` on its bus, for as long as a test moves it.
struct Side {
    bus: Bus,
    states: rivet_ipc_schema::Publisher<rivet_ipc_schema::JointState>,
    arm: Arm,
    seq: u64,
}

impl Side {
    fn new(config: &BusConfig) -> Side {
        let bus = Bus::open(config, &RobotName::new("dd2").expect("a name"), "test-robot").expect("the bus");
        let states = bus.joint_state_publisher().expect("a publisher");
        let arm = Arm::new(&rivet_config::load(robot("dd2")).expect("the arm is there"));
        Side { bus, states, arm, seq: 0 }
    }

    fn go(&mut self, samples: u64) {
        for _ in 0..samples {
            self.seq += 1;
            self.states.send(&self.arm.at(self.seq)).expect("sent");
            std::thread::sleep(Duration::from_micros(100));
        }
    }
}

/// How a request to save ended, in words.
fn save(client: &ControlClient) -> (ControlStatus, String) {
    let reply = client.ask(ControlCommand::Save, Duration::from_secs(10)).expect("asked").expect("answered");
    (ControlStatus::try_from(reply.status).expect("known"), reply.text().into_owned())
}

/// What could not be stored is stored as soon as it can, though no sample has come since; and what was forgotten by request
/// is not, nor taken up by a successor.
#[test]
fn a_write_that_failed_is_made_up_for_and_a_reset_lasts() {
    let folder = tempfile::tempdir().expect("a folder");
    let (state, said) = (folder.path().join("state"), folder.path().join("said"));
    let hash = rivet_config::load(robot("dd2")).expect("the arm is there").hash;
    // Nothing can be renamed over a folder; nor is a pipe read.
    let slots = [0, 1].map(|slot| state.join(format!("dd2.{slot}.state")));
    std::fs::create_dir_all(&slots[0]).expect("made");
    assert!(Command::new("mkfifo").arg(&slots[1]).status().expect("mkfifo is there").success());
    let private = PrivateBus::new("made-up");
    let mut side = Side::new(private.config());
    let client = side.bus.control_client().expect("a client");
    let start = || Process::start(daemon(&robot("dd2"), private.config(), &said).arg("--state").arg(&state));
    let mut process = start();
    eventually("rivetd listens", || (side.states.subscribers() > 0).then_some(()));
    std::fs::remove_file(&slots[1]).expect("removed");
    std::fs::create_dir(&slots[1]).expect("made");
    eventually("something is worth storing, and cannot be", || {
        side.go(1000);
        (save(&client).0 == ControlStatus::Failed).then_some(())
    });
    for slot in &slots {
        std::fs::remove_dir(slot).expect("removed");
    }
    let (status, text) = save(&client);
    assert_eq!(status, ControlStatus::Done, "{text}");
    assert!(Store::reader(&state, "dd2").load(hash).knowledge.is_some());

    side.go(1000);
    client.ask(ControlCommand::Reset, Duration::from_secs(10)).expect("asked").expect("answered");
    let (status, text) = save(&client);
    assert_ne!(status, ControlStatus::Done, "{text}");
    assert!(process.end("-TERM").success());
    assert!(Store::reader(&state, "dd2").load(hash).knowledge.is_none(), "forgotten is forgotten");
    assert!(state.join("dd2.1.state-before-reset").is_file(), "but it can be put back");
    let text = std::fs::read_to_string(&said).expect("it said something");
    assert!(text.contains("it is no file"), "{text}");
}

/// A reset that comes while a save is under way, at every instant of it: both are answered, nobody is locked out by them, and
/// what was said to be done is.
#[test]
fn a_reset_beside_a_save_locks_nobody_out() {
    let folder = tempfile::tempdir().expect("a folder");
    let (state, said) = (folder.path().join("state"), folder.path().join("said"));
    let private = PrivateBus::new("crossing");
    let mut side = Side::new(private.config());
    let client = side.bus.control_client().expect("a client");
    let mut process = Process::start(daemon(&robot("dd2"), private.config(), &said).arg("--state").arg(&state));
    eventually("rivetd listens", || (side.states.subscribers() > 0).then_some(()));
    let patience = Duration::from_secs(20);
    for pause in [0, 1, 5, 20, 40, 60, 90] {
        eventually("something is stored", || {
            side.go(1000);
            (save(&client).0 == ControlStatus::Done).then_some(())
        });
        side.go(500);
        let config = private.config().clone();
        let saving = std::thread::spawn(move || {
            let client = two_link::bus(&config, "test-other").control_client().expect("a client");
            client.ask(ControlCommand::Save, patience).expect("asked").is_some()
        });
        std::thread::sleep(Duration::from_millis(pause));
        // While the save is worked on it is refused.
        eventually("the reset is done", || {
            let reply = client.ask(ControlCommand::Reset, patience).expect("asked").expect("answered");
            (ControlStatus::try_from(reply.status) == Ok(ControlStatus::Done)).then_some(())
        });
        assert!(names(&state, ".state", "dd2").is_empty(), "{pause} ms: done is done");
        assert!(saving.join().expect("no panic"), "{pause} ms: the save is answered");
        let reload = client.ask(ControlCommand::Reload, patience).expect("asked").expect("answered");
        assert_eq!(ControlStatus::try_from(reload.status), Ok(ControlStatus::Done), "{pause} ms: {}", reload.text());
    }
    assert!(process.end("-TERM").success());
}

/// Whoever removes the files of a bus that is in use cuts off who comes from then on. Those who are there say so, go on with each
/// other, and end once nothing comes any more, so that they are started anew.
#[test]
fn a_bus_that_is_removed_is_told_and_left_when_nobody_is_there() {
    for shared in [false, true] {
        let folder = tempfile::tempdir().expect("a folder");
        let (said, heard) = (folder.path().join("said"), folder.path().join("heard"));
        let private = PrivateBus::new(if shared { "torn-shm" } else { "torn-root" });
        let config = private.config();
        let mut side = Side::new(config);
        let mut process = Process::start(&mut daemon(&robot("dd2"), config, &said));
        let mut controller = rivet();
        controller.arg("controller").arg(robot("dd2")).args(["--best-effort", "--die-with-parent", "--prefix"]);
        controller.arg(&config.prefix).arg("--root").arg(&config.root);
        controller.stderr(std::fs::File::create(&heard).expect("a file"));
        let mut controller = Process::start(&mut controller);
        eventually("both listen", || (side.states.subscribers() > 1).then_some(()));
        side.go(1000);
        if shared {
            for path in names(Path::new("/dev/shm"), "", &config.prefix) {
                std::fs::remove_file(path).expect("removed");
            }
        } else {
            std::fs::remove_dir_all(&config.root).expect("removed");
        }
        let text = || [&said, &heard].map(|file| std::fs::read_to_string(file).expect("it said something"));
        eventually("both say so", || {
            side.go(100);
            text().iter().all(|text| text.contains("goes on with who is there")).then_some(())
        });
        assert!(process.0.try_wait().expect("asked").is_none() && controller.0.try_wait().expect("asked").is_none());
        for process in [&mut process, &mut controller] {
            let status = eventually("it ends", || process.0.try_wait().expect("asked"));
            assert_eq!(status.code(), Some(69), "{:?}", text());
        }
    }
}

fn ask(config: &BusConfig, file: &Path, command: &str) -> Output {
    let mut rivet = rivet();
    rivet.args(["control", "--prefix", &config.prefix, "--root"]).arg(&config.root).arg(file).arg(command);
    rivet.output().expect("the program starts")
}

/// A mistake in the robot file keeps nobody from asking the daemon that runs: a reload is refused by the daemon, with the rule, and the
/// rest works.
#[test]
fn a_file_with_a_mistake_reaches_the_daemon() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("robot.toml");
    std::fs::copy(robot("dd2").with_file_name("robot.urdf"), folder.path().join("robot.urdf")).expect("copied");
    let text = std::fs::read_to_string(robot("dd2")).expect("read");
    std::fs::write(&file, &text).expect("written");
    let private = PrivateBus::new("mistake");
    let said = folder.path().join("said");
    let mut process = Process::start(&mut daemon(&file, private.config(), &said));
    let health = two_link::bus(private.config(), "test-onlooker").health_subscriber().expect("a subscriber");
    eventually("it reports", || health.receive().expect("received"));
    std::fs::write(&file, text.replace("[estimator]", "[estimator]\nwindow_s = -1")).expect("written");
    let reload = ask(private.config(), &file, "reload");
    let why = String::from_utf8_lossy(&reload.stderr);
    assert!(!reload.status.success() && why.contains("window_s") && why.contains("refused"), "{why}");
    assert!(ask(private.config(), &file, "freeze").status.success());
    std::fs::write(&file, text.replace("name = ", "nam = ")).expect("written");
    let nameless = ask(private.config(), &file, "freeze");
    let why = String::from_utf8_lossy(&nameless.stderr);
    assert!(nameless.status.code() == Some(78) && why.contains("name"), "{why}");
    assert!(process.end("-TERM").success());
    let text = std::fs::read_to_string(&said).expect("it said something");
    assert!(text.contains("window_s"), "the daemon has said so as well: {text}");
}

#[test]
fn words_that_are_none_end_with_the_code_that_is_not_tried_again() {
    let mut command = daemon(&robot("dd2"), &BusConfig::default(), Path::new("/dev/null"));
    let status = command.arg("--bogus").stdout(Stdio::null()).status().expect("the program starts");
    assert_eq!(status.code(), Some(64));
}
