//! What neighbours on the bus do to `rivetd`: die, come twice, never read, come in crowds, speak another version, fill the
//! shared memory. Faults of the samples themselves are in `daemon/tests/faults`.

use rivet_ipc_schema::{BusConfig, DaemonMode, Health, InputFault, JointState, PrivateBus, Publisher, Subscriber};
use rivet_tests::process::{Process, eventually};
use rivet_tests::two_link::{bus, daemon, running, sample};
use rivet_tests::{rivet, robot};
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::time::Duration;

/// The first report that is as wanted; what came meanwhile is shown when it never does.
fn report(health: &Subscriber<Health>, what: &str, wanted: impl Fn(&Health) -> bool) -> Health {
    eventually(what, || health.receive().expect("received").filter(&wanted))
}

/// Sends as fast as the loop takes: more than the ring holds at once would be a loss that the robot made.
fn send(states: &Publisher<JointState>, seqs: std::ops::RangeInclusive<u64>) {
    for seq in seqs {
        states.send(&sample(seq)).expect("sent");
        if seq.is_multiple_of(10) {
            std::thread::sleep(Duration::from_millis(2));
        }
    }
}

/// Not a test: the robot that is killed. It publishes for ever where the environment says so.
#[test]
#[ignore = "run by a test as a process of its own"]
fn robot_that_publishes_until_it_is_killed() {
    let Ok(prefix) = std::env::var("RIVET_TEST_PREFIX") else { return };
    let root = PathBuf::from(std::env::var("RIVET_TEST_ROOT").expect("set together"));
    rivet_realtime::die_with_parent().expect("the test lives");
    let bus = bus(&BusConfig { prefix, root }, "test-robot");
    let states = bus.joint_state_publisher().expect("a publisher");
    for seq in 1.. {
        let _ = states.send(&sample(seq));
        std::thread::sleep(Duration::from_millis(1));
    }
}

fn killable_robot(config: &BusConfig) -> Process {
    let mut command = Command::new(std::env::current_exe().expect("a running test has a file"));
    command.args(["--ignored", "--exact", "robot_that_publishes_until_it_is_killed"]);
    command.env("RIVET_TEST_PREFIX", &config.prefix).env("RIVET_TEST_ROOT", &config.root);
    Process::start(command.stdout(Stdio::null()).stderr(Stdio::null()))
}

#[test]
fn a_robot_that_is_killed_is_missed_by_name_and_followed_when_it_comes_back() {
    let private = PrivateBus::new("killed");
    let _daemon = running(private.config());
    let side = bus(private.config(), "test-onlooker");
    let health = side.health_subscriber().expect("a subscriber");
    for turn in 1..=2_u64 {
        let robot = killable_robot(private.config());
        report(&health, "samples are taken", |h| {
            h.mode != u32::from(DaemonMode::Stale) && h.samples > 0 && h.input_fault == 0
        });
        let restarts = report(&health, "restarts are named", |h| {
            h.input_faults[InputFault::PublisherRestarted as usize] == turn - 1
        });
        assert_eq!(restarts.input_faults[InputFault::PublisherGone as usize], turn - 1);
        // Long enough that its numbers, begun anew, are seen to be old ones.
        std::thread::sleep(Duration::from_millis(500));
        robot.signal("-KILL");
        let gone = report(&health, "the robot is missed", |h| h.input_fault == u32::from(InputFault::PublisherGone));
        assert_eq!(DaemonMode::try_from(gone.mode), Ok(DaemonMode::Stale));
        drop(robot);
    }
}

#[test]
fn a_second_publisher_is_named_and_none_of_its_samples_is_used() {
    let private = PrivateBus::new("twice");
    let (first, second) = (bus(private.config(), "test-robot"), bus(private.config(), "test-stranger"));
    let states = first.joint_state_publisher().expect("a publisher");
    let health = first.health_subscriber().expect("a subscriber");
    let _daemon = running(private.config());
    eventually("rivetd listens", || (states.subscribers() > 0).then_some(()));
    send(&states, 1..=200);
    let before = report(&health, "the first is heard", |h| h.samples > 0);
    assert_eq!(before.publishers, 1);
    let stranger = second.joint_state_publisher().expect("another publisher");
    for seq in 201..=1200 {
        // The stranger's would pass for the next sample, or for one far ahead.
        let mut wrong = sample(seq + 1);
        wrong.q = [1.0; 8];
        stranger.send(&wrong).expect("sent");
        states.send(&sample(seq)).expect("sent");
        std::thread::sleep(Duration::from_millis(1));
    }
    let named = report(&health, "both are seen", |h| h.samples == 1200);
    assert_eq!((named.lost, named.refused_stale, named.publishers), (0, 0, 2));
    assert!(named.input_faults[InputFault::SecondPublisher as usize] >= 900, "{named:?}");
    assert_eq!(named.last_input_fault, u32::from(InputFault::SecondPublisher));
    // When the first is gone for good, the other one is heard.
    drop(states);
    drop(stranger);
    let successor = second.joint_state_publisher().expect("a publisher");
    eventually("rivetd listens", || (successor.subscribers() > 0).then_some(()));
    send(&successor, 1201..=1500);
    report(&health, "the successor is heard", |h| h.samples == 1500 && h.lost == 0);
}

/// 64 subscribers of each kind that never read, beside one that does.
#[test]
fn a_crowd_that_never_reads_costs_no_sample() {
    let private = PrivateBus::new("crowd");
    let side = bus(private.config(), "test-robot");
    let states = side.joint_state_publisher().expect("a publisher");
    let health = side.health_subscriber().expect("a subscriber");
    let crowd = bus(private.config(), "test-crowd");
    let deaf: Vec<_> = (0..64)
        .map(|_| (crowd.parameters_subscriber().expect("room"), crowd.health_subscriber().expect("room")))
        .collect();
    let _daemon = running(private.config());
    eventually("rivetd listens", || (states.subscribers() > 0).then_some(()));
    send(&states, 1..=9000);
    let seen = report(&health, "all samples are taken", |h| h.samples == 9000);
    assert_eq!((seen.lost, seen.dropped_messages), (0, 0));
    // 90 sets into rings of 64: each has lost the oldest, none the newest.
    let last = deaf.iter().map(|(parameters, _)| parameters.receive_newest().expect("received").map(|set| set.epoch));
    assert!(last.into_iter().all(|epoch| epoch == Some(90)));
}

type ForeignNode = iceoryx2::node::Node<iceoryx2::prelude::ipc::Service>;

/// A program that was updated before `rivetd`: it has made the service of joint states for its own kind of message.
fn foreign_joint_states(config: &BusConfig) -> (ForeignNode, impl Sized + use<>) {
    use iceoryx2::prelude::{NodeBuilder, ServiceName, SignalHandlingMode, ZeroCopySend, ipc};
    #[derive(Clone, Copy, Debug, ZeroCopySend)]
    #[type_name("rivet.JointState.v2")]
    #[repr(C)]
    struct Newer {
        words: [u64; 31],
    }
    let node = NodeBuilder::new()
        .config(&config.iceoryx().expect("config"))
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create::<ipc::Service>()
        .expect("a node");
    let name = ServiceName::new("rivet/dd2/joint-state").expect("a name");
    let service = node.service_builder(&name).publish_subscribe::<Newer>().create().expect("a service");
    (node, service)
}

#[test]
fn a_message_of_another_version_is_named_until_the_other_side_is_updated() {
    let private = PrivateBus::new("version");
    let (node, service) = foreign_joint_states(private.config());
    let said = tempfile::NamedTempFile::new().expect("a file");
    let mut process =
        Process::start(daemon(private.config()).stderr(Stdio::from(said.reopen().expect("the same file"))));
    // The service is there only once the daemon is: until then there is nothing to subscribe to that is not of this test's making.
    let health = bus(private.config(), "test-onlooker").health_subscriber().expect("a subscriber");
    let waits = report(&health, "the daemon says what it waits for", |h| {
        h.input_fault == u32::from(InputFault::WrongVersion) && h.input_faults[InputFault::WrongVersion as usize] == 1
    });
    assert_eq!((DaemonMode::try_from(waits.mode), waits.samples), (Ok(DaemonMode::BadInput), 0));
    let text = std::fs::read_to_string(said.path()).expect("read");
    assert!(text.contains("rivet.JointState.v2") && text.contains("older"), "{text}");
    assert_eq!(text.matches("rivet.JointState.v2").count(), 1, "said once, not with every try: {text}");
    let doctor = rivet()
        .args(["doctor", "--seconds", "0", "--json", "--prefix", &private.config().prefix, "--root"])
        .arg(&private.config().root)
        .arg(robot("dd2"))
        .output()
        .expect("the program starts");
    assert_eq!(doctor.status.code(), Some(2));
    let found: serde_json::Value = serde_json::from_slice(&doctor.stdout).expect("JSON");
    let foreign = found["findings"].as_array().expect("a list").iter().find(|f| f["check"] == "foreign services");
    let foreign = foreign.expect("looked at");
    assert_eq!(foreign["severity"], "failure");
    assert!(foreign["found"].as_str().expect("text").contains("rivet.JointState.v2"), "{foreign}");
    // The other program is updated: nobody has to touch the daemon.
    drop((service, node));
    let side = bus(private.config(), "test-robot");
    let states = eventually("the name is free for the right version", || side.joint_state_publisher().ok());
    eventually("rivetd listens", || (states.subscribers() > 0).then_some(()));
    send(&states, 1..=3000);
    let after = report(&health, "all samples are taken", |h| h.seq == 3000);
    assert_eq!((after.samples, after.lost, after.input_fault), (3000, 0, 0));
    assert_eq!(after.last_input_fault, u32::from(InputFault::WrongVersion));
    assert!(process.end("-TERM").success());
}

/// What is asked of it while it waits it does, and another one ends while it waits.
#[test]
fn a_daemon_that_waits_for_the_right_version_does_what_it_is_asked() {
    let private = PrivateBus::new("waits");
    let (node, service) = foreign_joint_states(private.config());
    let mut process = running(private.config());
    let health = bus(private.config(), "test-onlooker").health_subscriber().expect("a subscriber");
    report(&health, "it waits", |h| h.input_fault == u32::from(InputFault::WrongVersion) && h.periods == 0);
    let asked = rivet()
        .args(["control", "--prefix", &private.config().prefix, "--root"])
        .arg(&private.config().root)
        .arg(robot("dd2"))
        .arg("freeze")
        .output()
        .expect("the program starts");
    assert!(asked.status.success(), "{asked:?}");
    // It is what it was asked for, once it has samples.
    drop((service, node));
    let side = bus(private.config(), "test-robot");
    let states = eventually("the name is free for the right version", || side.joint_state_publisher().ok());
    eventually("rivetd listens", || (states.subscribers() > 0).then_some(()));
    send(&states, 1..=500);
    report(&health, "it has frozen", |h| h.samples > 0 && h.mode == u32::from(DaemonMode::Frozen));
    assert!(process.end("-TERM").success());
}

/// A process that stands still for longer than its samples are kept is not told from one that was suspended: what is lost is
/// counted, and it goes on.
#[test]
fn a_daemon_that_is_stopped_for_a_while_goes_on() {
    let private = PrivateBus::new("stopped");
    let side = bus(private.config(), "test-robot");
    let states = side.joint_state_publisher().expect("a publisher");
    let health = side.health_subscriber().expect("a subscriber");
    let process = running(private.config());
    eventually("rivetd listens", || (states.subscribers() > 0).then_some(()));
    send(&states, 1..=300);
    report(&health, "samples are taken", |h| h.samples == 300);
    process.signal("-STOP");
    for seq in 301..=3000 {
        states.send(&sample(seq)).expect("sent: a receiver that stands still stops no one");
    }
    process.signal("-CONT");
    let after = report(&health, "it goes on", |h| h.seq == 3000);
    assert_eq!(after.samples + after.lost, 3000);
    assert!(after.lost > 0 && after.input_faults[InputFault::Lost as usize] == after.lost, "{after:?}");
    assert!(after.overruns > 0, "periods that passed are counted");
}

/// Runs a program where `/dev/shm` has this size. `None`: this machine does not let us.
fn with_shared_memory_of(size: &str, command: &Command) -> Option<std::process::Output> {
    let mount = format!("mount -t tmpfs -o size={size} tmpfs /dev/shm && exec \"$@\"");
    let mut inside = Command::new("unshare");
    inside.args(["--mount", "sh", "-c", &mount, "sh"]).arg(command.get_program()).args(command.get_args());
    for (name, value) in command.get_envs() {
        inside.env(name, value.unwrap_or_default());
    }
    let Ok(output) = inside.output() else {
        eprintln!("SKIPPED: no unshare");
        return None;
    };
    let said = String::from_utf8_lossy(&output.stderr);
    if said.contains("unshare failed") || said.contains("permission denied") || said.contains("must be superuser") {
        eprintln!("SKIPPED: mounting needs root");
        return None;
    }
    Some(output)
}

/// `/dev/shm` of a few pages: the daemon ends with a reason and a code, not with a signal.
#[test]
fn full_shared_memory_at_the_start_is_an_error_that_says_so() {
    let private = PrivateBus::new("full");
    let Some(output) = with_shared_memory_of("64k", &daemon(private.config())) else { return };
    assert_eq!(output.status.code(), Some(69), "{output:?}");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(said.contains("/dev/shm"), "{said}");
}

/// `/dev/shm` that is filled by others while the daemon works: it says so, goes on as if nothing were, and says when it is over.
#[test]
fn shared_memory_that_fills_up_is_named_and_costs_no_sample() {
    run_where_memory_is_small("robot_beside_which_shared_memory_fills_up");
}

/// The same while it waits for the right version: what it waits for comes, and there is no room to join.
#[test]
fn a_daemon_that_waits_outlasts_full_shared_memory() {
    run_where_memory_is_small("daemon_that_waits_while_shared_memory_fills_up");
}

fn run_where_memory_is_small(test: &str) {
    let mut inner = Command::new(std::env::current_exe().expect("a running test has a file"));
    inner.args(["--ignored", "--exact", "--nocapture", test]);
    inner.env("RIVET_TEST_SMALL", "1");
    let Some(output) = with_shared_memory_of("160m", &inner) else { return };
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success() && said.contains("1 passed"), "{output:?}");
}

/// Takes all the shared memory there is, to the last page: the write that finds no more room is the end. It is free again
/// when both are gone: a file takes its room until nobody has it open.
fn fill_shared_memory() -> (std::fs::File, tempfile::TempPath) {
    let file = tempfile::NamedTempFile::new_in("/dev/shm").expect("a file");
    let (mut file, path) = file.into_parts();
    let filled = std::io::copy(&mut std::io::repeat(0), &mut file).expect_err("memory has an end");
    assert_eq!(filled.kind(), std::io::ErrorKind::StorageFull);
    (file, path)
}

/// Not a test: what the one above runs in shared memory of its own.
#[test]
#[ignore = "run by a test where /dev/shm is small"]
fn daemon_that_waits_while_shared_memory_fills_up() {
    if std::env::var_os("RIVET_TEST_SMALL").is_none() {
        return;
    }
    let private = PrivateBus::new("waitsfull");
    let (node, service) = foreign_joint_states(private.config());
    let log = tempfile::NamedTempFile::new().expect("a file");
    let mut process =
        Process::start(daemon(private.config()).stderr(Stdio::from(log.reopen().expect("the same file"))));
    let health = bus(private.config(), "test-onlooker").health_subscriber().expect("a subscriber");
    report(&health, "it waits", |h| h.input_fault == u32::from(InputFault::WrongVersion) && h.periods == 0);
    let filled = fill_shared_memory();
    drop((service, node));
    let said = || std::fs::read_to_string(log.path()).expect("read");
    eventually("it says what it waits for now", || said().contains("/dev/shm").then_some(()));
    drop(filled);
    let side = bus(private.config(), "test-robot");
    let states = eventually("the name is free for the right version", || side.joint_state_publisher().ok());
    eventually("rivetd listens", || (states.subscribers() > 0).then_some(()));
    send(&states, 1..=3000);
    let after = report(&health, "all samples are taken", |h| h.seq == 3000);
    assert_eq!((after.samples, after.lost, after.input_fault), (3000, 0, 0));
    assert!(process.end("-TERM").success());
}

/// Not a test: what the one above runs in shared memory of its own.
#[test]
#[ignore = "run by a test where /dev/shm is small"]
fn robot_beside_which_shared_memory_fills_up() {
    if std::env::var_os("RIVET_TEST_SMALL").is_none() {
        return;
    }
    let private = PrivateBus::new("fills");
    let side = bus(private.config(), "test-robot");
    let states = side.joint_state_publisher().expect("a publisher");
    let health = side.health_subscriber().expect("a subscriber");
    let _daemon = running(private.config());
    eventually("rivetd listens", || (states.subscribers() > 0).then_some(()));
    send(&states, 1..=500);
    report(&health, "samples are taken", |h| h.samples == 500 && h.input_fault == 0);
    let filled = fill_shared_memory();
    let full = u32::from(InputFault::SharedMemoryFull);
    // Of an arm that does not send, that would be what is wrong.
    let mut seq = 500;
    let mut report_of = |what: &str, wanted: &dyn Fn(&Health) -> bool| {
        eventually(what, || {
            send(&states, seq + 1..=seq + 20);
            seq += 20;
            health.receive().expect("received").filter(wanted)
        })
    };
    report_of("it is named", &|h| h.input_fault == full && h.input_faults[full as usize] == 1);
    let meanwhile = report_of("it estimates", &|h| h.active > 0 && h.seq > 3000);
    assert_eq!((meanwhile.samples, meanwhile.lost, meanwhile.dropped_messages), (meanwhile.seq, 0, 0));
    drop(filled);
    let after = report_of("it is over", &|h| h.input_fault == 0);
    // Where this side gets no processor for a while, silence may be the last fault.
    let faults = after.input_faults[full as usize];
    assert_eq!((after.samples, after.lost, faults, after.mode), (after.seq, 0, 1, meanwhile.mode));
}
