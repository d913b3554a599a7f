//! `rivetd` as a process: what its neighbours on the bus see.

use rivet_ipc_schema::{Bus, BusConfig, ControlCommand, ControlStatus, JointState, PrivateBus, RobotName};
use rivet_tests::{rivet, robot};
use std::process::{Child, Command};
use std::time::{Duration, Instant};

/// A child that does not outlive the test.
struct Process(Child);

impl Process {
    fn start(command: &mut Command) -> Process {
        Process(command.spawn().expect("the program starts"))
    }

    fn terminate(&mut self) -> Option<i32> {
        let pid = self.0.id().to_string();
        assert!(Command::new("kill").args(["-TERM", &pid]).status().expect("kill runs").success());
        self.0.wait().expect("a child that ends").code()
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn daemon(config: &BusConfig) -> Process {
    let mut command = rivet();
    command.arg("daemon").arg(robot("dd2")).args(["--best-effort", "--die-with-parent", "--prefix", &config.prefix]);
    command.arg("--root").arg(&config.root);
    Process::start(&mut command)
}

fn bus(config: &BusConfig, role: &str) -> Bus {
    Bus::open(config, &RobotName::new("dd2").expect("a sound name"), role).expect("the bus opens")
}

/// Waits for something without asking how long it takes; only a hang fails.
fn eventually<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let begin = Instant::now();
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(begin.elapsed() < Duration::from_secs(60), "never: {what}");
        std::thread::sleep(Duration::from_millis(1));
    }
}

fn sample(seq: u64) -> JointState {
    let t = seq as f64 * 0.001;
    let mut state = JointState { seq, stamp_ns: seq * 1_000_000, joints: 2, ..JointState::default() };
    for j in 0..2 {
        state.q[j] = 0.5 * ((5.0 + j as f64) * t).sin();
        state.tau[j] = 3.0 * ((5.0 + j as f64) * t).cos();
    }
    state
}

#[test]
fn who_comes_late_gets_the_latest_parameters_without_waiting_for_the_next() {
    let private = PrivateBus::new("late");
    let robot_side = bus(private.config(), "test-robot");
    let states = robot_side.joint_state_publisher().expect("a publisher");
    let health = robot_side.health_subscriber().expect("a subscriber");
    let mut process = daemon(private.config());
    eventually("rivetd listens", || (states.subscribers() > 0).then_some(()));
    for seq in 1..=300 {
        states.send(&sample(seq)).expect("sent");
    }
    eventually("rivetd has taken 300 samples", || {
        health.receive().expect("received").filter(|health| health.samples == 300)
    });
    // Nothing is published any more: samples have stopped.
    let late = bus(private.config(), "test-late");
    let subscriber = late.parameters_subscriber().expect("a subscriber");
    let set = eventually("the latest set comes to a late subscriber", || subscriber.receive().expect("received"));
    assert_eq!((set.epoch, set.seq), (3, 300));
    let mut reader = late.latest_parameters_reader().expect("a reader");
    let latest = eventually("the blackboard is found", || {
        reader.reopen_if_stale(u64::MAX, Duration::ZERO).expect("reopened");
        reader.latest()
    });
    assert_eq!(latest.values, set.values);
    assert_eq!(process.terminate(), Some(0), "SIGTERM ends it in good order");
}

#[test]
fn requests_are_answered_and_take_effect() {
    let private = PrivateBus::new("control");
    let side = bus(private.config(), "test-robot");
    let states = side.joint_state_publisher().expect("a publisher");
    let parameters = side.parameters_subscriber().expect("a subscriber");
    let client = side.control_client().expect("a client");
    let _process = daemon(private.config());
    eventually("rivetd listens", || (states.subscribers() > 0).then_some(()));
    let ask = |command| {
        let reply = client.ask(command, Duration::from_secs(30)).expect("asked").expect("an answer");
        ControlStatus::try_from(reply.status).expect("a known status")
    };
    assert_eq!(ask(ControlCommand::Freeze), ControlStatus::Done);
    assert_eq!(ask(ControlCommand::Save), ControlStatus::Refused, "nothing is stored yet");
    for seq in 1..=200 {
        states.send(&sample(seq)).expect("sent");
    }
    let set = eventually("parameters come", || parameters.receive().expect("received"));
    assert_ne!(set.flags & rivet_ipc_schema::parameter_flags::FROZEN, 0);
}

#[test]
fn a_wrong_robot_file_ends_it_with_the_code_that_systemd_knows() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("robot.toml");
    std::fs::write(&file, "name = 7\n").expect("written");
    let output = rivet().arg("daemon").arg(&file).output().expect("the program starts");
    assert_eq!(output.status.code(), Some(78));
    assert!(String::from_utf8_lossy(&output.stderr).contains("robot.toml:1:8"), "{output:?}");
}
