//! Every service end to end on private buses: what is sent arrives, late, early and in spite of overflow.

use std::time::{Duration, Instant};

use rivet_ipc_schema::{
    Answer, Bus, BusConfig, BusError, Command, CommandMode, ControlCommand, ControlStatus, Health, JointState,
    OneSource, Parameters, PrivateBus, RobotName, Setpoint, cleanup, purge,
};

fn robot() -> RobotName {
    RobotName::new("arm-1").expect("a good name")
}

fn open(bus: &PrivateBus, role: &str) -> Bus {
    Bus::open(bus.config(), &robot(), role).expect("bus")
}

fn joint_state(seq: u64) -> JointState {
    JointState { seq, stamp_ns: seq * 1_000_000, q: [seq as f64; 8], joints: 6, ..JointState::default() }
}

/// NaN temperatures make `==` useless: compares the bytes' meaning field by field through Debug.
fn same<T: core::fmt::Debug>(a: &T, b: &T) {
    assert_eq!(format!("{a:?}"), format!("{b:?}"));
}

#[test]
fn every_message_arrives_as_it_was_sent() {
    let private = PrivateBus::new("trip");
    let (there, here) = (open(&private, "there"), open(&private, "here"));
    macro_rules! round_trip {
        ($publisher:ident, $subscriber:ident, $message:expr) => {{
            let (publisher, subscriber) = (there.$publisher().unwrap(), here.$subscriber().unwrap());
            let message = $message;
            assert_eq!(publisher.send(&message).unwrap(), 1);
            same(&subscriber.receive().unwrap().expect("arrived"), &message);
            assert!(subscriber.receive().unwrap().is_none());
            assert_eq!((publisher.subscribers(), subscriber.publishers()), (1, 1));
        }};
    }
    let mut state = joint_state(7);
    (state.tau, state.faults) = ([-1.5; 8], 3);
    round_trip!(joint_state_publisher, joint_state_subscriber, state);
    let plan = Setpoint { seq: 7, stamp_ns: 9, q: [1.0; 8], qd: [2.0; 8], qdd: [3.0; 8], joints: 8, flags: 0 };
    round_trip!(setpoint_publisher, setpoint_subscriber, plan);
    let mut parameters = Parameters { epoch: 3, model_hash: u64::MAX, count: 128, joints: 7, ..Parameters::default() };
    parameters.values = core::array::from_fn(|i| i as f64);
    (parameters.state[127], parameters.reference[127], parameters.residual_rms[7]) = (2, -4.0, 0.25);
    round_trip!(parameters_publisher, parameters_subscriber, parameters);
    let mut health = Health { seq: 1, samples: 2, held: 3, worst_work_ns: 4, ..Health::default() };
    (health.wake_histogram[31], health.work_histogram[0]) = (5, 6);
    round_trip!(health_publisher, health_subscriber, health);
}

#[test]
fn the_order_of_arrival_does_not_matter() {
    let private = PrivateBus::new("order");
    let early = open(&private, "subscriber");
    let subscriber = early.joint_state_subscriber().unwrap();
    assert!(subscriber.receive().unwrap().is_none());
    let late = open(&private, "publisher");
    let publisher = late.joint_state_publisher().unwrap();
    for seq in 0..1000 {
        publisher.send(&joint_state(seq)).unwrap();
    }
    assert_eq!(subscriber.capacity(), 1024);
    for seq in 0..1000 {
        assert_eq!(subscriber.receive_with(|sample| sample.seq).unwrap(), Some(seq), "none lost, in order");
    }
}

#[test]
fn a_full_ring_drops_the_oldest_and_never_blocks_the_publisher() {
    let private = PrivateBus::new("overflow");
    let bus = open(&private, "both");
    let (publisher, slow) = (bus.joint_state_publisher().unwrap(), bus.joint_state_subscriber().unwrap());
    for seq in 0..1500 {
        publisher.send(&joint_state(seq)).unwrap();
    }
    let received: Vec<u64> = core::iter::from_fn(|| slow.receive().unwrap()).map(|sample| sample.seq).collect();
    assert_eq!(received, (1500 - 1024..1500).collect::<Vec<u64>>());
    for seq in 0..5 {
        publisher.send(&joint_state(seq)).unwrap();
    }
    assert_eq!(slow.receive_newest().unwrap().map(|sample| sample.seq), Some(4));
    assert!(slow.receive_newest().unwrap().is_none());
}

#[test]
fn a_late_subscriber_gets_the_latest_parameters_without_a_new_publication() {
    let private = PrivateBus::new("late");
    let daemon = open(&private, "daemon");
    let publisher = daemon.parameters_publisher().unwrap();
    for epoch in 1..=5 {
        publisher.send(&Parameters { epoch, ..Parameters::default() }).unwrap();
    }
    let controller = open(&private, "controller");
    let subscriber = controller.parameters_subscriber().unwrap();
    publisher.refresh().unwrap();
    assert_eq!(subscriber.receive().unwrap().map(|parameters| parameters.epoch), Some(5));
    publisher.refresh().unwrap();
    assert!(subscriber.receive().unwrap().is_none(), "once");
}

#[test]
fn the_blackboard_shows_the_latest_value_to_early_and_late_readers() {
    let private = PrivateBus::new("board");
    let bus = open(&private, "robot");
    let mut early = bus.command_reader().unwrap();
    assert!(!early.is_connected() && early.latest().is_none());
    let controller = open(&private, "controller");
    let writer = controller.command_writer().unwrap();
    assert!(early.reopen_if_stale(1_000_000_000, Duration::from_millis(1)).unwrap());
    assert!(early.latest().is_none(), "nothing was written yet");
    for seq in 1..=3 {
        let mode = CommandMode::Nominal.into();
        writer.write(&Command { seq, stamp_ns: seq, tau: [seq as f64; 8], joints: 6, mode });
    }
    let late = bus.command_reader().unwrap();
    for reader in [&early, &late] {
        let command = reader.latest().expect("written");
        assert_eq!((command.seq, command.tau[7]), (3, 3.0));
    }
    // Stale, but still the same blackboard: nothing to move to, and the value stays readable.
    assert!(!early.reopen_if_stale(9_000_000_000, Duration::from_millis(1)).unwrap());
    assert_eq!(early.latest().map(|command| command.seq), Some(3));
}

#[test]
fn a_blackboard_has_one_writer_at_a_time() {
    let private = PrivateBus::new("single");
    let (first, second) = (open(&private, "first"), open(&private, "second"));
    let reader = second.latest_parameters_reader().unwrap();
    let writer = first.latest_parameters_writer().unwrap();
    let refusal = second.latest_parameters_writer().unwrap_err();
    assert!(matches!(refusal, BusError::WriterAlive { .. }), "{refusal}");
    assert!(refusal.to_string().contains("rivet/arm-1/parameters"), "{refusal}");
    // The command board is another one, and so is that of another robot.
    let _command = second.command_writer().unwrap();
    let other = Bus::open(private.config(), &RobotName::new("arm-2").unwrap(), "other").unwrap();
    let _other = other.latest_parameters_writer().unwrap();
    drop((writer, reader));
    second.latest_parameters_writer().expect("free again");
}

#[test]
fn a_writer_that_left_in_order_is_succeeded_on_the_same_blackboard() {
    let private = PrivateBus::new("succeed");
    let bus = open(&private, "reader");
    let writer = open(&private, "first").command_writer().unwrap();
    let reader = bus.command_reader().unwrap();
    writer.write(&Command { seq: 1, stamp_ns: 1, ..Command::default() });
    drop(writer);
    assert_eq!(reader.latest().map(|command| command.seq), Some(1));
    let writer = open(&private, "second").command_writer().unwrap();
    writer.write(&Command { seq: 2, stamp_ns: 2, ..Command::default() });
    assert_eq!(reader.latest().map(|command| command.seq), Some(2), "no need to reopen");
}

#[test]
fn a_notification_wakes_the_listener_and_is_not_lost_when_early() {
    let private = PrivateBus::new("event");
    let (robot, daemon) = (open(&private, "robot"), open(&private, "daemon"));
    let listener = daemon.joint_state_listener().unwrap();
    let notifier = robot.joint_state_notifier().unwrap();
    assert!(!listener.wait(Duration::from_millis(1)).unwrap(), "nobody called");
    assert_eq!(notifier.notify().unwrap(), 1);
    notifier.notify().unwrap();
    assert!(listener.wait(Duration::from_secs(10)).unwrap());
    assert!(!listener.wait(Duration::from_millis(1)).unwrap(), "two calls are one");
}

/// Less than the system's clock counts in is not for ever.
#[test]
fn the_shortest_wait_ends() {
    let private = PrivateBus::new("short");
    let config = private.config().clone();
    let (ended, end) = std::sync::mpsc::channel();
    std::thread::spawn(move || {
        let bus = Bus::open(&config, &robot(), "daemon").unwrap();
        let listener = bus.joint_state_listener().unwrap();
        for nanoseconds in [0, 1, 999, 1000] {
            ended.send(listener.wait(Duration::from_nanos(nanoseconds)).unwrap()).unwrap();
        }
    });
    for _ in 0..4 {
        assert!(!end.recv_timeout(Duration::from_secs(60)).expect("the wait has an end"));
    }
}

#[test]
fn control_requests_are_answered_or_time_out() {
    let private = PrivateBus::new("control");
    let client_bus = open(&private, "client");
    let client = client_bus.control_client().unwrap();
    assert!(client.ask(ControlCommand::Freeze, Duration::from_millis(5)).unwrap().is_none(), "no daemon");
    let config = private.config().clone();
    let (stop, stopped) = std::sync::mpsc::channel::<()>();
    let daemon = std::thread::spawn(move || {
        let bus = Bus::open(&config, &robot(), "daemon").unwrap();
        let mut server = bus.control_server().unwrap();
        let mut seen = Vec::new();
        while stopped.try_recv().is_err() {
            let answer = |command| {
                seen.push(command);
                match command {
                    ControlCommand::Load => Answer::Now(ControlStatus::Failed, "the disk is full".to_owned()),
                    ControlCommand::Reload => Answer::Later,
                    _ => Answer::Now(ControlStatus::Done, String::new()),
                }
            };
            let served = server.serve(42, answer).unwrap();
            if server.owes() {
                std::thread::sleep(Duration::from_millis(5));
                server.finish(43, ControlStatus::Refused, &"robot.toml:3:1 ü".repeat(100)).unwrap();
            }
            if !served {
                std::thread::sleep(Duration::from_micros(200));
            }
        }
        seen
    });
    let patience = Duration::from_secs(10);
    let reply = client.ask(ControlCommand::Resume, patience).unwrap().expect("an answer");
    assert_eq!((ControlStatus::try_from(reply.status), reply.epoch), (Ok(ControlStatus::Done), 42));
    let reply = client.ask(ControlCommand::Load, patience).unwrap().expect("an answer");
    assert_eq!(ControlStatus::try_from(reply.status), Ok(ControlStatus::Failed));
    assert_eq!(reply.text(), "the disk is full");
    let reply = client.ask(ControlCommand::Reload, patience).unwrap().expect("a late answer");
    assert_eq!((ControlStatus::try_from(reply.status), reply.epoch), (Ok(ControlStatus::Refused), 43));
    let text = reply.text().into_owned();
    assert!(text.len() > 900 && "robot.toml:3:1 ü".repeat(100).starts_with(&text), "whole letters: {text}");
    stop.send(()).unwrap();
    assert_eq!(daemon.join().unwrap(), [ControlCommand::Resume, ControlCommand::Load, ControlCommand::Reload]);
}

#[test]
fn two_robots_and_two_buses_do_not_hear_each_other() {
    let (one, two) = (PrivateBus::new("one"), PrivateBus::new("two"));
    let publisher_bus = open(&one, "publisher");
    let publisher = publisher_bus.joint_state_publisher().unwrap();
    let other_robot = Bus::open(one.config(), &RobotName::new("arm-2").unwrap(), "other").unwrap();
    let other_bus = open(&two, "other");
    let strangers = [other_robot.joint_state_subscriber().unwrap(), other_bus.joint_state_subscriber().unwrap()];
    assert_eq!(publisher.send(&joint_state(1)).unwrap(), 0);
    for stranger in &strangers {
        assert!(stranger.receive().unwrap().is_none());
    }
}

/// Many parties open the same services at the same instant; none may fail or end up alone.
#[test]
fn simultaneous_openings_meet() {
    const PARTIES: usize = 4;
    let private = PrivateBus::new("rush");
    let (gate, end) = (std::sync::Barrier::new(PARTIES), std::sync::Barrier::new(PARTIES));
    let meet = &|party: usize| -> Result<Option<u64>, String> {
        gate.wait();
        let joined = Bus::open(private.config(), &robot(), "rush").and_then(|bus| {
            let subscriber = bus.joint_state_subscriber()?;
            let publisher = (party == 0).then(|| bus.joint_state_publisher()).transpose()?;
            Ok((bus, subscriber, publisher))
        });
        end.wait();
        let sent = match &joined {
            Ok((_, _, Some(publisher))) => publisher.send(&joint_state(1)).map(drop),
            _ => Ok(()),
        };
        end.wait();
        let received = joined.as_ref().map(|(_, subscriber, _)| subscriber.receive());
        end.wait(); // a publisher that leaves before it was met takes its samples along
        sent.map_err(|e| e.to_string())?;
        Ok(received.map_err(ToString::to_string)?.map_err(|e| e.to_string())?.map(|sample| sample.seq))
    };
    let results: Vec<_> = std::thread::scope(|scope| {
        let parties: Vec<_> = (0..PARTIES).map(|party| scope.spawn(move || meet(party))).collect();
        parties.into_iter().map(|party| party.join().expect("no panic")).collect()
    });
    assert_eq!(results, vec![Ok(Some(1)); PARTIES]);
}

#[test]
fn a_private_bus_leaves_nothing_behind() {
    let private = PrivateBus::new("gone");
    let config = private.config().clone();
    let shared = || {
        let entries = std::fs::read_dir("/dev/shm").unwrap().flatten();
        entries.filter(|entry| entry.file_name().to_string_lossy().starts_with(&config.prefix)).count()
    };
    {
        let bus = open(&private, "party");
        let _ports = (bus.joint_state_publisher().unwrap(), bus.command_writer().unwrap());
        assert!(shared() > 0 && config.root.exists());
        assert!(matches!(purge(&config), Err(BusError::InUse { .. })), "someone is still there");
        assert_eq!(cleanup(&config).unwrap().dead_nodes, 0);
    }
    purge(&config).unwrap();
    assert!(shared() == 0 && !config.root.exists());
    drop(private);
}

#[test]
fn bad_names_are_refused_with_the_rule() {
    for (name, rule) in
        [("", "1 to 64"), ("UR10e", "a-z"), ("a/b", "a-z"), ("-a", "start"), (&"x".repeat(65), "1 to 64")]
    {
        let refusal = RobotName::new(name).unwrap_err().to_string();
        assert!(refusal.contains(rule), "{refusal}");
    }
    let root = std::path::PathBuf::from("/tmp/rivet-check");
    let good = BusConfig { prefix: "abc".to_owned(), root };
    assert!(good.check().is_ok());
    for prefix in ["", "ab", "a b", "a/b", "../x", &"x".repeat(33)] {
        assert!(BusConfig { prefix: (*prefix).to_owned(), ..good.clone() }.check().is_err(), "{prefix}");
    }
    for root in ["relative", "/", &format!("/{}", "x".repeat(57))] {
        assert!(BusConfig { root: root.into(), ..good.clone() }.check().is_err(), "{root}");
    }
}

/// The longest names that the rules allow still make valid file names and sockets.
#[test]
fn the_longest_names_work() {
    let private = PrivateBus::new("longest");
    let mut config = private.config().clone();
    config.prefix = format!("{}{}", config.prefix, "p".repeat(32 - config.prefix.len()));
    let room = BusConfig::MAX_LEN - config.prefix.len();
    let root = format!("/tmp/rl{}_", std::process::id());
    config.root = format!("{root}{}", "r".repeat(room - root.len())).into();
    let begin = Instant::now();
    {
        let bus = Bus::open(&config, &RobotName::new(&"n".repeat(RobotName::MAX_LEN)).unwrap(), "long").unwrap();
        let (publisher, subscriber) = (bus.parameters_publisher().unwrap(), bus.parameters_subscriber().unwrap());
        publisher.send(&Parameters::default()).unwrap();
        assert!(subscriber.receive().unwrap().is_some());
        let (listener, notifier) = (bus.joint_state_listener().unwrap(), bus.joint_state_notifier().unwrap());
        notifier.notify().unwrap();
        assert!(listener.wait(Duration::from_secs(10)).unwrap());
        let (writer, reader) = (bus.command_writer().unwrap(), bus.command_reader().unwrap());
        writer.write(&Command { stamp_ns: 1, ..Command::default() });
        assert!(reader.latest().is_some());
        let _control = (bus.control_server().unwrap(), bus.control_client().unwrap());
    }
    assert!(begin.elapsed() < Duration::from_secs(60));
    purge(&config).unwrap();
}

/// Of two publishers the first is heard, until it has been silent for the time of succession or is gone.
#[test]
fn one_source_keeps_to_its_publisher_until_that_is_silent_or_gone() {
    const MS: u64 = 1_000_000;
    let private = PrivateBus::new("source");
    let (a, b, here) = (open(&private, "a"), open(&private, "b"), open(&private, "here"));
    let mut states = OneSource::new(here.joint_state_subscriber().unwrap(), Duration::from_millis(100));
    let (first, second) = (a.joint_state_publisher().unwrap(), b.joint_state_publisher().unwrap());
    // Sequence numbers tell who sent it: the second's are above a hundred.
    let mut turn = |now: u64, sent: &[(bool, u64)]| {
        for (by_first, seq) in sent {
            if *by_first { &first } else { &second }.send(&joint_state(*seq)).unwrap();
        }
        let heard: Vec<u64> =
            core::iter::from_fn(|| states.receive(now * MS).unwrap()).map(|sample| sample.seq).collect();
        (heard, states.foreign())
    };
    assert_eq!(turn(1000, &[(true, 1)]), (vec![1], 0));
    let (heard, foreign) = turn(1001, &[(false, 101), (true, 2), (false, 102), (true, 3)]);
    assert_eq!((heard, foreign), (vec![2, 3], 2));
    assert_eq!(turn(1101, &[(false, 103)]), (vec![], 3), "a hundred milliseconds are not yet silence");
    assert_eq!(turn(1102, &[(false, 104)]), (vec![104], 3), "the second has succeeded");
    assert_eq!(turn(1103, &[(true, 4), (false, 105)]), (vec![105], 4), "the first is now the stranger");
    // Nobody listened for long: that was no silence.
    assert_eq!(turn(9000, &[(true, 5)]), (vec![], 5));
    assert_eq!(turn(9001, &[(false, 106)]), (vec![106], 5));
    drop(second);
    first.send(&joint_state(6)).unwrap();
    assert_eq!(
        states.receive(9002 * MS).unwrap().map(|sample| sample.seq),
        Some(6),
        "the only one left is heard at once"
    );
}
