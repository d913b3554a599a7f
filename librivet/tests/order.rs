//! Robot, daemon and controller start and restart in any order: real processes.

mod common;

use common::{Bus, Process, eventually};
use rivet::{Robot, now_ns};
use rivet_ipc_schema::{ControllerHealth, Health};
use std::process::{Command, Stdio};

/// The example in Rust, without end.
fn robot(bus: &Bus) -> Process {
    let mut robot = Command::new(common::profile_folder().join("examples/robot"));
    robot.arg("100000000").arg(bus.prefix()).arg(bus.root()).stdout(Stdio::null());
    Process(robot.spawn().expect("the example starts"))
}

/// What a reader on the bus sees.
struct Reader(Robot);

impl Reader {
    fn health(&mut self, what: &str, fits: impl Fn(&Health) -> bool) -> Health {
        eventually(what, || self.0.health().copied().filter(|health| fits(health)))
    }

    fn controller(&mut self, what: &str, fits: impl Fn(&ControllerHealth) -> bool) -> ControllerHealth {
        eventually(what, || self.0.controller_health().copied().filter(|health| fits(health)))
    }

    /// Waits for a command that was computed from now on.
    fn command(&mut self, what: &str) -> u64 {
        let begin = now_ns();
        eventually(what, || self.0.command().filter(|command| command.stamp_ns > begin)).seq
    }
}

#[test]
fn robot_daemon_and_controller_start_and_restart_in_any_order() {
    let _turn = common::turn();
    let bus = Bus::new("order");
    let mut reader = Reader(Robot::open(bus.config(), common::ROBOT, 0).expect("the bus opens"));

    // The robot is first.
    let first_robot = robot(&bus);
    let states = bus.join().joint_state_subscriber().expect("a port");
    eventually("samples without anyone else", || states.receive_newest().expect("received"));
    let controller = Process::program("rivet-controller", &bus);
    reader.command("a controller that came second");
    let daemon = Process::program("rivetd", &bus);
    let health = reader.health("a daemon that came last", |health| health.samples > 1000);
    assert_eq!(health.lost, 0, "{health:?}");
    reader.controller("the daemon's parameters", |health| health.accepted > 0);

    // Each is killed and comes back.
    let killed_ns = now_ns();
    drop(controller);
    let _controller = Process::program("rivet-controller", &bus);
    reader.command("the next controller");
    reader.controller("the next controller", |health| health.stamp_ns > killed_ns && health.accepted > 0);
    let killed_ns = now_ns();
    drop(daemon);
    let _daemon = Process::program("rivetd", &bus);
    let health = reader.health("the next daemon", |health| health.stamp_ns > killed_ns && health.samples > 1000);
    assert_eq!(health.lost, 0, "{health:?}");
    let before = reader.0.command().expect("a command").seq;
    drop(first_robot);
    let begin_ns = now_ns();
    let _robot = robot(&bus);
    // It counts from 1 again: far below the robot before it.
    let anew = |seq: u64, stamp_ns: u64| stamp_ns > begin_ns && seq < before / 2;
    reader.health("samples of the next robot", |health| health.seq > 0 && anew(health.seq, health.stamp_ns));
    eventually("answers to the next robot", || reader.0.command().filter(|c| anew(c.seq, c.stamp_ns)));
    assert_eq!(reader.0.problem(), "");
}

/// A robot that uses the bus by itself and sends no wake-up event: both programs take its samples and report it.
#[test]
fn the_programs_report_a_robot_that_sends_no_wake_up_event() {
    let _turn = common::turn();
    let bus = Bus::new("polls");
    let party = bus.join();
    let (states, arrival) =
        (party.joint_state_publisher().expect("a port"), party.joint_state_notifier().expect("a port"));
    let _programs = common::Programs::start(&bus);
    let mut reader = Reader(Robot::open(bus.config(), common::ROBOT, 0).expect("the bus opens"));
    let (mut seq, first_ns) = (0, now_ns());
    for (notifies, polls) in [(false, 1), (true, 0)] {
        let begin = seq;
        eventually("what both report", || {
            seq += 1;
            let q = (0.001 * seq as f64).sin();
            let mut state = rivet_ipc_schema::JointState {
                seq,
                stamp_ns: first_ns + 1_000_000 * seq,
                joints: 1,
                ..Default::default()
            };
            state.q[0] = q;
            states.send(&state).expect("sent");
            if notifies {
                arrival.notify().expect("notified");
            }
            let daemon = reader.0.health().is_some_and(|health| health.seq > begin && health.polls == polls);
            let controller =
                reader.0.controller_health().is_some_and(|health| health.seq > begin && health.polls == polls);
            (daemon && controller).then_some(())
        });
    }
}
