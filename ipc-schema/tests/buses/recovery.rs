//! Processes that are killed: the next one takes over, readers follow, nothing stays behind.

use std::io::{BufRead, BufReader};
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use rivet_ipc_schema::{Bus, BusConfig, BusError, Command, JointState, PrivateBus, RobotName, cleanup};

const ROLE: &str = "RIVET_TEST_ROLE";
const SECOND: u64 = 1_000_000_000;

fn open(config: &BusConfig, role: &str) -> Bus {
    Bus::open(config, &RobotName::new("arm").expect("a good name"), role).expect("bus")
}

fn command(seq: u64) -> Command {
    Command { seq, stamp_ns: seq * SECOND, ..Command::default() }
}

/// The body of the processes that get killed: this binary again, with a role in its environment.
#[test]
fn child() {
    let Ok(role) = std::env::var(ROLE) else { return };
    let mut words = role.split(' ');
    let mut word = || words.next().expect("three words").to_owned();
    let (role, prefix, root) = (word(), word(), word());
    let bus = open(&BusConfig { prefix, root: root.into() }, &role);
    let ready = || println!("\nready");
    match role.as_str() {
        "writer" => {
            let writer = bus.command_writer().expect("writer");
            writer.write(&command(1));
            ready();
            std::thread::sleep(Duration::from_secs(60));
        }
        "publisher" => {
            let publisher = bus.joint_state_publisher().expect("publisher");
            ready();
            loop {
                publisher.send(&JointState { seq: 1, ..JointState::default() }).expect("send");
                std::thread::sleep(Duration::from_millis(1));
            }
        }
        "subscriber" => {
            let subscriber = bus.joint_state_subscriber().expect("subscriber");
            let _ = subscriber.receive().expect("receive");
            ready();
            std::thread::sleep(Duration::from_secs(60));
        }
        other => panic!("no role {other}"),
    }
}

/// A child process that is killed (SIGKILL) when dropped.
struct Victim(Child);

impl Victim {
    fn start(role: &str, config: &BusConfig) -> Self {
        let mut child = std::process::Command::new(std::env::current_exe().expect("this binary"))
            .args(["--exact", "recovery::child", "--nocapture"])
            .env(ROLE, format!("{role} {} {}", config.prefix, config.root.display()))
            .stdout(Stdio::piped())
            .spawn()
            .expect("child");
        let lines = BufReader::new(child.stdout.take().expect("piped")).lines();
        let victim = Self(child);
        assert!(lines.map_while(Result::ok).any(|line| line == "ready"), "the {role} did not start");
        victim
    }
}

impl Drop for Victim {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn a_killed_writer_is_succeeded_and_its_readers_follow() {
    let private = PrivateBus::new("kill");
    let config = private.config();
    let bus = open(config, "robot");
    let (mut reader, mut second) = (bus.command_reader().unwrap(), bus.command_reader().unwrap());
    let age = Duration::from_millis(20);
    let mut now = SECOND;
    // Twice over: the second succession meets the remains of the first.
    for round in 1..=2_u64 {
        let victim = Victim::start("writer", config);
        now += SECOND;
        reader.reopen_if_stale(now, age).unwrap();
        second.reopen_if_stale(now, age).unwrap();
        assert_eq!(reader.latest().map(|command| command.seq), Some(1), "round {round}");
        let refusal = open(config, "rival").command_writer().unwrap_err();
        assert!(matches!(refusal, BusError::WriterAlive { .. }), "{refusal}");
        drop(victim);
        assert_eq!(reader.latest().map(|command| command.seq), Some(1), "the last value stays readable");
        now += SECOND;
        assert!(!reader.reopen_if_stale(now, age).unwrap(), "there is no successor yet");

        let successor = open(config, "successor");
        let writer = successor.command_writer().unwrap();
        writer.write(&command(now / SECOND + 1));
        assert_eq!(reader.latest().map(|command| command.seq), Some(1), "the old blackboard, whose stamp is stale");
        now += SECOND;
        assert!(reader.reopen_if_stale(now, age).unwrap());
        assert_eq!(reader.latest().map(|command| command.seq), Some(now / SECOND));
        assert!(!reader.reopen_if_stale(now, age).unwrap(), "fresh");
        // Leaving the old blackboard must not take the new one's name away: others still find it.
        let late = bus.command_reader().unwrap();
        assert_eq!(late.latest().map(|command| command.seq), Some(now / SECOND));
        // The last reader of the old one leaves by and by.
        assert!(second.reopen_if_stale(now, age).unwrap());
        let later = bus.command_reader().unwrap();
        writer.write(&command(now / SECOND + 1));
        for reader in [&reader, &second, &late, &later] {
            assert_eq!(reader.latest().map(|command| command.seq), Some(now / SECOND + 1), "round {round}");
        }
        now += SECOND;
    }
}

#[test]
fn a_killed_writer_without_readers_is_succeeded() {
    let private = PrivateBus::new("alone");
    drop(Victim::start("writer", private.config()));
    let bus = open(private.config(), "successor");
    let writer = bus.command_writer().unwrap();
    writer.write(&command(2));
    assert_eq!(bus.command_reader().unwrap().latest().map(|command| command.seq), Some(2));
}

#[test]
fn a_killed_publisher_is_succeeded_without_its_subscribers_doing_anything() {
    let private = PrivateBus::new("pub");
    let bus = open(private.config(), "daemon");
    let subscriber = bus.joint_state_subscriber().unwrap();
    // More often than there are places: the dead ones must give theirs back.
    for _ in 0..4 {
        let victim = Victim::start("publisher", private.config());
        assert!(arrives(|| subscriber.receive().unwrap().is_some()));
        drop(victim);
        while subscriber.receive().unwrap().is_some() {}
    }
    let publisher = open(private.config(), "robot").joint_state_publisher().unwrap();
    publisher.send(&JointState { seq: 9, ..JointState::default() }).unwrap();
    assert_eq!(subscriber.receive().unwrap().map(|sample| sample.seq), Some(9));
}

#[test]
fn killed_subscribers_neither_stop_a_publisher_nor_keep_their_places() {
    let private = PrivateBus::new("sub");
    let bus = open(private.config(), "robot");
    let publisher = bus.joint_state_publisher().unwrap();
    for _ in 0..3 {
        let victim = Victim::start("subscriber", private.config());
        assert_eq!(publisher.send(&JointState::default()).unwrap(), 1);
        drop(victim);
        for _ in 0..2000 {
            publisher.send(&JointState::default()).unwrap();
        }
        cleanup(private.config()).unwrap();
        assert_eq!(publisher.subscribers(), 0);
    }
}

/// Waits generously for something that another process does.
fn arrives(mut condition: impl FnMut() -> bool) -> bool {
    let begin = Instant::now();
    while begin.elapsed() < Duration::from_secs(30) {
        if condition() {
            return true;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    false
}
