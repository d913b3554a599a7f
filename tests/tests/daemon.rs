//! `rivetd` as a process: what its neighbours on the bus see.

use rivet_ipc_schema::{ControlCommand, ControlStatus, PrivateBus};
use rivet_tests::process::eventually;
use rivet_tests::rivet;
use rivet_tests::two_link::{bus, running, sample};
use std::time::Duration;

#[test]
fn who_comes_late_gets_the_latest_parameters_without_waiting_for_the_next() {
    let private = PrivateBus::new("late");
    let robot_side = bus(private.config(), "test-robot");
    let states = robot_side.joint_state_publisher().expect("a publisher");
    let health = robot_side.health_subscriber().expect("a subscriber");
    let mut process = running(private.config());
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
    assert_eq!(process.end("-TERM").code(), Some(0), "SIGTERM ends it in good order");
}

#[test]
fn requests_are_answered_and_take_effect() {
    let private = PrivateBus::new("control");
    let side = bus(private.config(), "test-robot");
    let states = side.joint_state_publisher().expect("a publisher");
    let parameters = side.parameters_subscriber().expect("a subscriber");
    let client = side.control_client().expect("a client");
    let _process = running(private.config());
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
