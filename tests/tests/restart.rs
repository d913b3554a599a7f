//! A daemon that is killed at any instant while the arm moves: its successor goes on from what the disk had.

use rivet_ipc_schema::{
    Bus, ControlClient, ControlCommand, ControlStatus, Parameters, PrivateBus, RobotName, parameter_flags,
};
use rivet_store::{Knowledge, Store};
use rivet_tests::process::{Process, eventually};
use rivet_tests::robot;
use rivet_tests::side::{Arm, daemon};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

/// SIGKILLs.
const KILLS: u64 = 10;

fn stored(folder: &Path, hash: u64) -> Option<Knowledge> {
    let loaded = Store::reader(folder, "dd2").load(hash);
    assert!(loaded.problems.is_empty(), "what is there is whole: {:?}", loaded.problems);
    loaded.knowledge
}

/// Asks for a file; the number of the sample that it is of, once the disk has it.
fn save(client: &ControlClient) -> Option<u64> {
    let reply = client.ask(ControlCommand::Save, Duration::from_secs(10)).expect("asked")?;
    let text = reply.text().into_owned();
    let done = ControlStatus::try_from(reply.status) == Ok(ControlStatus::Done);
    done.then(|| text.rsplit(' ').next().expect("a word").parse().expect("a number"))
}

#[test]
fn a_daemon_that_is_killed_in_mid_motion_loses_nothing_that_was_stored() {
    let folder = tempfile::tempdir().expect("a folder");
    let (state, said) = (folder.path().join("state"), folder.path().join("said"));
    let file = rivet_config::load(robot("dd2")).expect("the arm is there");
    let private = PrivateBus::new("restart");
    let config = private.config();
    let name = RobotName::new("dd2").expect("a name");
    let bus = Bus::open(config, &name, "test-onlooker").expect("the bus");
    let (parameters, client) = (bus.parameters_subscriber().expect("one"), bus.control_client().expect("one"));
    // The arm moves on, ten times as fast as it would, whatever becomes of the daemon.
    let (stop, now) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicU64::new(0)));
    let arm = {
        let (stop, now, file, config) = (Arc::clone(&stop), Arc::clone(&now), file.clone(), config.clone());
        std::thread::spawn(move || {
            let bus = Bus::open(&config, &RobotName::new("dd2").expect("a name"), "test-robot").expect("the bus");
            let states = bus.joint_state_publisher().expect("a publisher");
            let mut arm = Arm::new(&file);
            while !stop.load(Ordering::Relaxed) {
                let seq = now.load(Ordering::Relaxed) + 1;
                states.send(&arm.at(seq)).expect("sent");
                now.store(seq, Ordering::Relaxed);
                std::thread::sleep(Duration::from_micros(50));
            }
        })
    };
    let accepted = parameter_flags::PROVISIONAL | parameter_flags::SUSPENDED | parameter_flags::BAD_INPUT;
    let (mut acknowledged, mut before) = (0, None::<Knowledge>);
    for kill in 0..KILLS {
        let process = Process::start(daemon(&robot("dd2"), config, &said).arg("--state").arg(&state));
        let begin = now.load(Ordering::Relaxed);
        let mut first = None::<Parameters>;
        eventually("a set that it stands by", || {
            let set = parameters.receive().expect("received").filter(|set| set.seq > begin)?;
            first = first.or(Some(set));
            (set.flags & accepted == 0).then_some(())
        });
        if let (Some(first), Some(before)) = (&first, &before) {
            let known = &before.parameters;
            assert_eq!(first.flags & parameter_flags::PROVISIONAL, 0, "kill {kill}: it goes on, it does not begin");
            for (i, (value, std)) in known.values.iter().zip(&known.std).enumerate() {
                let off = (first.values[i] - value).abs();
                assert!(off <= *std, "kill {kill}: parameter {i} was {value} +- {std} and is {}", first.values[i]);
            }
        }
        // The last one has nobody who asks: what there is then comes of the interval alone.
        let seen = acknowledged;
        if kill + 1 < KILLS {
            acknowledged = eventually("a file", || save(&client));
        } else {
            eventually("a file by itself", || {
                stored(&state, file.hash).filter(|found| found.parameters.seq > seen).map(|_| ())
            });
        }
        assert!(acknowledged >= seen);
        // In the middle of the next one, or before, or after.
        let killer = std::thread::spawn(move || {
            std::thread::sleep(Duration::from_micros(kill * 7919 % 90_000));
            process.signal("-KILL");
            drop(process);
        });
        if kill + 1 < KILLS {
            let _ = client.ask(ControlCommand::Save, Duration::from_millis(100));
        }
        killer.join().expect("no panic");
        let found = stored(&state, file.hash).expect("something is stored");
        assert!(found.parameters.seq >= acknowledged, "kill {kill}: {} is older", found.parameters.seq);
        let memory = found.memory.as_ref().expect("the window is stored too");
        let mut successor = rivet_daemon::Core::new(&file).expect("sound settings");
        assert!(successor.resume(&memory.numbers), "kill {kill}");
        let mut set = Parameters::default();
        successor.write_parameters(&mut set);
        assert_eq!(set.values[..set.len()], found.parameters.values, "kill {kill}: set and window belong together");
        assert_eq!(set.std[..set.len()], found.parameters.std, "kill {kill}");
        before = Some(found);
    }
    stop.store(true, Ordering::Relaxed);
    arm.join().expect("no panic");
    let said = std::fs::read_to_string(said).expect("it said something");
    assert_eq!(said.matches("no stored parameters").count(), 1, "{said}");
    assert_eq!(said.matches("parameters, window and supervision").count() as u64, KILLS - 1, "{said}");
}

/// Stopped by its manager, with a fault before that: both are on record, and the records are logs.
#[test]
fn what_went_wrong_is_on_record() {
    let folder = tempfile::tempdir().expect("a folder");
    let (state, said) = (folder.path().join("state"), folder.path().join("said"));
    let file = rivet_config::load(robot("dd2")).expect("the arm is there");
    let private = PrivateBus::new("record");
    let bus = Bus::open(private.config(), &RobotName::new("dd2").expect("a name"), "test-robot").expect("the bus");
    let (states, health) = (bus.joint_state_publisher().expect("one"), bus.health_subscriber().expect("one"));
    let mut process = Process::start(daemon(&robot("dd2"), private.config(), &said).arg("--state").arg(&state));
    eventually("rivetd listens", || (states.subscribers() > 0).then_some(()));
    let mut arm = Arm::new(&file);
    let mut send = |seqs: std::ops::RangeInclusive<u64>, spoil: bool| {
        for seq in seqs {
            let mut sample = arm.at(seq);
            sample.q[1] += if spoil { 0.3 } else { 0.0 };
            states.send(&sample).expect("sent");
            if seq.is_multiple_of(10) {
                std::thread::sleep(Duration::from_millis(2));
            }
        }
    };
    send(1..=2000, false);
    send(2001..=2300, true);
    send(2301..=2900, false);
    let last = eventually("all is in", || health.receive().expect("received").filter(|health| health.seq == 2900));
    assert_eq!(last.lost, 0);
    let record = eventually("a record", || std::fs::read_to_string(state.join("dd2.rivetd-fault.0.flight.csv")).ok());
    let lines = record.lines().filter(|line| !line.starts_with('#'));
    let lines: Vec<Vec<&str>> = lines.map(|line| line.split(',').collect()).collect();
    let column = |name: &str| lines[0].iter().position(|found| *found == name).expect(name);
    assert_eq!(lines.len(), 1001);
    let (seq, fault, updates) = (column("seq"), column("input_fault"), column("updates"));
    let of = |at: u64| lines[1..].iter().find(|line| line[seq] == at.to_string()).expect("it is in the record");
    // An encoder jump has number 9; the first sample of it is the first that says so.
    assert_eq!([of(2000)[fault], of(2001)[fault], of(2300)[fault]], ["0", "9", "9"]);
    assert_eq!(of(2001)[updates], of(2300)[updates], "nothing is learnt meanwhile");
    assert_ne!(of(1800)[updates], of(2000)[updates]);
    assert_eq!(of(2200)[column("q2")], (arm.at(2200).q[1] + 0.3).to_string());
    assert_eq!(of(2000)[column("tau1")], arm.at(2000).tau[0].to_string());
    process.signal("-TERM");
    assert!(process.0.wait().expect("it ends").success());
    let stop = rivet_logs::read(state.join("dd2.rivetd-stop.0.flight.csv"), &rivet_logs::ReadOptions::new(2));
    let stop = stop.expect("a record is a log");
    assert_eq!(stop.len(), 1000);
    let said = std::fs::read_to_string(said).expect("it said something");
    assert_eq!(said.matches("flight record").count(), 2, "{said}");
}
