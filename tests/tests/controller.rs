//! `rivet-controller` at its start, without samples, and with strangers on the bus: real processes.

use rivet_ipc_schema::{
    BlackboardReader, Bus, ControllerHealth, ControllerState, JointState, ParameterSource, PrivateBus, RobotName,
    SourceReason,
};
use rivet_tests::process::eventually;
use rivet_tests::stage::{Stage, columns, turn};
use std::time::Duration;

/// A controller that starts without a daemon starts on what an earlier daemon stored.
#[test]
fn a_controller_starts_on_stored_parameters() {
    let _turn = turn();
    let private = PrivateBus::new("stored");
    let folder = tempfile::tempdir().expect("a folder");
    let stage = Stage::new(private.config(), folder.path(), "manutec-r3", "");
    {
        let mut daemon = stage.daemon();
        let _controller = stage.controller(&["--lockstep"]);
        let _plant = stage.plant(&["--lockstep", "2000", "--unpaced"]);
        stage.wait_for(ParameterSource::Live);
        daemon.end("-TERM");
    }
    let robot = rivet_config::load(&stage.file).expect("sound");
    let store = rivet_store::Store::reader(&folder.path().join("state"), "manutec-r3");
    let loaded = store.load(robot.hash);
    assert_eq!(loaded.problems, []);
    let stored = loaded.knowledge.expect("SIGTERM writes what is left").parameters;
    assert_eq!(stored.values.len(), robot.base.len());
    let _controller = stage.controller(&["--lockstep"]);
    let _plant = stage.plant(&["--lockstep", "2000", "--unpaced"]);
    stage.wait("a new run", |health| health.commands < 2000 && health.seq > 0);
    // They pass the gate of live ones first; no daemon runs.
    let health = stage.wait_for(ParameterSource::LastGood);
    assert_eq!(SourceReason::try_from(health.source_reason), Ok(SourceReason::Stored));
}

/// First the controller is started anew, then the robot, which counts from 1 again, while the daemon goes on: numbers of the
/// run before lock nothing out, the new run's parameters are adopted and its plan is followed.
#[test]
fn a_controller_and_then_a_robot_that_start_anew_get_fresh_parameters() {
    let _turn = turn();
    let private = PrivateBus::new("anew");
    let folder = tempfile::tempdir().expect("a folder");
    let stage = Stage::new(private.config(), folder.path(), "manutec-r3", "");
    let _daemon = stage.daemon();
    let mut controller = stage.controller(&["--lockstep"]);
    let mut plant = stage.plant(&["--lockstep", "2000", "--unpaced", "--duration", "9"]);
    stage.wait_for(ParameterSource::Live);
    // In lockstep the controller speaks only with samples, every so many of them: not with the last.
    stage.wait("most of nine seconds", |health| health.seq >= 8000);
    plant.0.wait().expect("it ends by itself");
    controller.end("-TERM");
    let _controller = stage.controller(&["--lockstep"]);
    let _plant = stage.plant(&["--lockstep", "2000", "--unpaced"]);
    let new = stage.wait("a new run", |health| health.seq > 0 && health.seq < 3000 && health.commands < 3000);
    let health = stage.wait("live parameters", |health| {
        health.source == u32::from(ParameterSource::Live) || (health.seq >= 6000 && health.seq > new.seq)
    });
    assert_eq!(ParameterSource::try_from(health.source), Ok(ParameterSource::Live), "{health:?}");
    assert!(health.parameters_seq <= health.seq, "made from this run's samples");
    assert_eq!(ControllerState::try_from(health.state), Ok(ControllerState::Following));
}

/// The robot controller is stopped dead: the stop reaction, and a flight record of the last thousand pairs; then it goes on.
#[test]
fn samples_that_stop_bring_the_stop_reaction_and_a_flight_record() {
    let _turn = turn();
    let private = PrivateBus::new("silent");
    let folder = tempfile::tempdir().expect("a folder");
    // A busy machine must not look like a stopped robot: half a second of silence.
    let stage = Stage::new(private.config(), folder.path(), "manutec-r3", "stale_periods = 500");
    let _controller = stage.controller(&[]);
    let plant = stage.plant(&["--stale-periods", "100000"]);
    stage.wait("a second of motion", |health| health.seq > 2000);
    plant.signal("-STOP");
    let stopped = stage.wait("the stop reaction", |health| health.stops == 1);
    assert_eq!(ControllerState::try_from(stopped.state), Ok(ControllerState::Stopping));
    let record = folder.path().join("state/manutec-r3.0.flight.csv");
    eventually("the flight record", || record.exists().then_some(()));
    let text = std::fs::read_to_string(&record).expect("read");
    assert_eq!(text.lines().count(), 1002, "what the numbers follow, a header, and the last thousand");
    let last: u64 = text.lines().last().and_then(|line| line.split(',').nth(1)?.parse().ok()).expect("a number");
    assert_eq!(last, stopped.seq, "up to the last sample");
    let (tau, command) = (columns(&record, "tau"), columns(&record, "command"));
    // The torque in force at a latch is the command that answered the sample before (there is no noise here).
    let follows = (1..1000).filter(|&k| (tau[k].1[0] - command[k - 1].1[0]).abs() < 1e-9).count();
    assert!(follows > 900, "{follows}");
    plant.signal("-CONT");
    // Samples are sound again, and the plan, which waited as well, is within reach.
    let following = |health: &ControllerHealth| health.state == u32::from(ControllerState::Following);
    let on = stage.wait("the plan is followed again", |health| health.seq > stopped.seq + 500 && following(health));
    assert_eq!((on.stops, on.resumed), (1, 1));
}

/// How long after the last answer the stop reaction comes, in periods: the configured number and no more than one beyond it, by the
/// controller's own stamps. The quickest of some silences, since any one of them may meet a busy machine.
#[test]
fn the_stop_reaction_comes_within_a_period_of_its_time() {
    const STALE: f64 = 25.0;
    let _turn = turn();
    let private = PrivateBus::new("in-time");
    let folder = tempfile::tempdir().expect("a folder");
    let arm = "kuka-kr300-r2500";
    let stage = Stage::new(private.config(), folder.path(), arm, &format!("stale_periods = {STALE}"));
    let robot = rivet_config::load(&stage.file).expect("sound");
    let period = Duration::from_secs_f64(robot.config.sample_period_s);
    let states = stage.bus.joint_state_publisher().expect("a port");
    let arrival = stage.bus.joint_state_notifier().expect("a port");
    let _controller = stage.controller(&[]);
    let commands =
        eventually("a controller", || stage.bus.command_reader().ok().filter(BlackboardReader::is_connected));
    let mut state = JointState { joints: robot.dof() as u32, ..JointState::default() };
    let mut late = Vec::new();
    for _ in 0..8 {
        for _ in 0..100 {
            state.seq += 1;
            state.stamp_ns = state.seq * period.as_nanos() as u64;
            states.send(&state).expect("sent");
            arrival.notify().expect("told");
            std::thread::sleep(period);
        }
        // The stop reaction answers the last sample anew.
        let of_last = || commands.latest().filter(|command| command.seq == state.seq).map(|command| command.stamp_ns);
        let answered = eventually("the last answer", of_last);
        let stopped = eventually("the stop reaction", || of_last().filter(|stamp| *stamp > answered));
        late.push((stopped - answered) as f64 / period.as_nanos() as f64);
    }
    println!("periods from the last answer to the stop reaction: {late:.2?}");
    let quickest = late.iter().copied().fold(f64::INFINITY, f64::min);
    assert!((STALE - 0.1..STALE + 1.0).contains(&quickest), "{late:?}");
}

/// A robot controller that publishes joint states and never notifies the wake-up event is answered as one that does: the
/// controller polls. Compared within one run, since both halves meet the same busy machine.
#[test]
fn answers_a_robot_that_does_not_notify() {
    const SAMPLES: u64 = 500;
    let _turn = turn();
    let private = PrivateBus::new("unnotified");
    let folder = tempfile::tempdir().expect("a folder");
    let stage = Stage::new(private.config(), folder.path(), "kuka-kr300-r2500", "stale_periods = 500");
    let robot = rivet_config::load(&stage.file).expect("sound");
    let period = Duration::from_secs_f64(robot.config.sample_period_s);
    let states = stage.bus.joint_state_publisher().expect("a port");
    let arrival = stage.bus.joint_state_notifier().expect("a port");
    let _controller = stage.controller(&[]);
    let commands =
        eventually("a controller", || stage.bus.command_reader().ok().filter(BlackboardReader::is_connected));
    let mut state = JointState { joints: robot.dof() as u32, ..JointState::default() };
    let mut answered = |notifies: bool| {
        let (mut count, mut last) = (0, None);
        for _ in 0..SAMPLES {
            state.seq += 1;
            state.stamp_ns = state.seq * period.as_nanos() as u64;
            states.send(&state).expect("sent");
            if notifies {
                arrival.notify().expect("notified");
            }
            std::thread::sleep(period);
            let answer = commands.latest().map(|command| command.seq);
            count += u64::from(answer.is_some() && answer != last);
            last = answer;
        }
        count
    };
    let (notified, polled) = (answered(true), answered(false));
    println!("of {SAMPLES} samples answered: {notified} with the event, {polled} without");
    assert!(notified > SAMPLES / 2, "{notified}");
    assert!(polled as f64 > 0.9 * notified as f64, "{polled} without the event, {notified} with it");
}

/// A second robot controller, a second planner and a second daemon on the bus of an arm in motion: each is named, and nothing
/// that they send moves the arm.
#[test]
fn second_publishers_are_named_and_nothing_of_theirs_is_used() {
    let _turn = turn();
    let private = PrivateBus::new("strangers");
    let folder = tempfile::tempdir().expect("a folder");
    // A publisher that is silent for long is succeeded: on a busy machine none of the real ones may seem to be.
    let patience = "stale_periods = 500\nparameter_timeout_s = 20.0";
    let stage = Stage::new(private.config(), folder.path(), "manutec-r3", patience);
    let _daemon = stage.daemon();
    let _controller = stage.controller(&["--lockstep"]);
    // Paced: an arm that is faster than its clock leaves a daemon behind that has to share a core.
    let _plant = stage.plant(&["--lockstep", "2000"]);
    let live = stage.wait_for(ParameterSource::Live);
    // What the real ones sent, as it was before there are strangers.
    let states = stage.bus.joint_state_subscriber().expect("a port");
    let plans = stage.bus.setpoint_subscriber().expect("a port");
    let sets = stage.bus.parameters_subscriber().expect("a port");
    let before = stage.wait("two seconds more", |health| health.seq >= live.seq + 2000);
    let mut state = eventually("a joint state", || states.receive_newest().expect("received"));
    let mut plan = eventually("a setpoint", || plans.receive_newest().expect("received"));
    let mut set = eventually("a set", || sets.receive_newest().expect("received"));
    drop((states, plans, sets));
    for q in state.q.iter_mut().chain(&mut plan.q) {
        *q += 0.1;
    }

    let name = RobotName::new("manutec-r3").expect("a name");
    let stranger = Bus::open(private.config(), &name, "stranger").expect("a bus");
    let wrong_states = stranger.joint_state_publisher().expect("a second robot controller");
    let wrong_plans = stranger.setpoint_publisher().expect("a second planner");
    let wrong_sets = stranger.parameters_publisher().expect("a second daemon");
    let named = stage.wait("all three are named", |health| {
        // Each would pass for one of the real ones: by its number, and the set by its epoch.
        for seq in health.seq..health.seq + 500 {
            (state.seq, state.stamp_ns, plan.seq) = (seq, seq * 1_000_000, seq);
            wrong_states.send(&state).expect("sent");
            wrong_plans.send(&plan).expect("sent");
            if seq % 50 == 0 {
                (set.seq, set.epoch) = (health.seq, FAR + seq);
                wrong_sets.send(&set).expect("sent");
            }
        }
        let least = health.foreign_joint_states.min(health.foreign_setpoints);
        least >= 1000 && health.foreign_parameters >= 20
    });
    // A stranger's sample is 0.1 rad and more away, a stranger's plan too: either would show.
    assert_eq!(ControllerState::try_from(named.state), Ok(ControllerState::Following));
    assert_eq!((named.stops, named.refused_stale), (0, before.refused_stale));
    assert!(named.epoch < FAR, "a stranger's set was adopted: epoch {}", named.epoch);
    for j in 0..6 {
        let (is, was) = (named.tracking_rms[j], before.tracking_rms[j]);
        assert!(is < was + 0.005, "joint {}: {is} rad from the plan, {was} rad before", j + 1);
    }
}

/// Added to the epoch of a stranger's sets.
const FAR: u64 = 1 << 40;
