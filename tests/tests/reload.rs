//! A robot file that changes while rivetd works: no sample is missed, no parameter steps, a bad file changes nothing.

use rivet_daemon::Core;
use rivet_ipc_schema::{
    Bus, ControlCommand, ControlStatus, LoadLevel, Parameters, PrivateBus, RobotName, parameter_flags,
};
use rivet_tests::process::{Process, eventually};
use rivet_tests::robot;
use rivet_tests::side::{Arm, daemon};
use rivet_tests::stage::{Stage, turn};
use std::fs;
use std::path::Path;
use std::time::Duration;

/// The two-link arm's file with another line in place of one.
fn write(folder: &Path, from: &str, to: &str) {
    let text = fs::read_to_string(robot("dd2")).expect("the arm is there");
    assert!(text.contains(from), "{from}");
    fs::write(folder.join("robot.toml"), text.replace(from, to)).expect("written");
}

#[test]
fn a_reload_under_load_loses_no_sample_and_a_bad_file_changes_nothing() {
    let folder = tempfile::tempdir().expect("a folder");
    fs::copy(robot("dd2").with_file_name("robot.urdf"), folder.path().join("robot.urdf")).expect("copied");
    write(folder.path(), "", "");
    let private = PrivateBus::new("reload");
    let config = private.config().clone();
    let bus = Bus::open(&config, &RobotName::new("dd2").expect("a name"), "test-robot").expect("the bus");
    let states = bus.joint_state_publisher().expect("a publisher");
    let health = bus.health_subscriber().expect("a subscriber");
    let parameters = bus.parameters_subscriber().expect("a subscriber");
    let (file, said) = (folder.path().join("robot.toml"), folder.path().join("said"));
    let mut arm = Arm::new(&rivet_config::load(&file).expect("the arm is there"));
    let process = Process::start(&mut daemon(&file, &config, &said));
    eventually("rivetd listens", || (states.subscribers() > 0).then_some(()));

    // Samples go on without a pause, at about ten times their rate, while a neighbour reloads three times.
    let (done, finished) = std::sync::mpsc::channel();
    let neighbour = {
        let (folder, said, pid) = (folder.path().to_owned(), said.clone(), process.0.id());
        std::thread::spawn(move || {
            let bus = Bus::open(&config, &RobotName::new("dd2").expect("a name"), "test-operator").expect("the bus");
            let client = bus.control_client().expect("a client");
            let ask = || {
                let reply = client.ask(ControlCommand::Reload, Duration::from_secs(30)).expect("asked");
                let reply = reply.expect("an answer");
                (ControlStatus::try_from(reply.status).expect("a known status"), reply.text().into_owned())
            };
            std::thread::sleep(Duration::from_millis(100));
            write(&folder, "window_s = 5.0", "window_s = 3.0");
            let other_window = ask();
            write(&folder, "model_filter_hz = 10.0 ", "model_filter_hz = 8.0 ");
            let other_filter = ask();
            write(&folder, "window_s = 5.0", "window_s = -5.0");
            let bad = ask();
            // Nobody writes into it: whoever opens it to read waits.
            let file = folder.join("robot.toml");
            fs::remove_file(&file).expect("removed");
            assert!(std::process::Command::new("mkfifo").arg(&file).status().expect("mkfifo runs").success());
            let pipe = ask();
            fs::remove_file(&file).expect("removed");
            write(&folder, "gravity = [0.0, 0.0, -9.81]", "gravity = [0.0, 0.0, -1.62]");
            let other_model = ask();
            // By the signal as well: what was in force before is again.
            write(&folder, "", "");
            let sent = std::process::Command::new("kill").args(["-HUP", &pid.to_string()]).status().expect("kill runs");
            assert!(sent.success());
            let by_signal = eventually("the signal is followed", || {
                let said = fs::read_to_string(&said).expect("it says something");
                said.lines().find(|line| line.contains("SIGHUP: ")).map(str::to_owned)
            });
            std::thread::sleep(Duration::from_millis(300));
            done.send(()).expect("the test waits");
            ([other_window, other_filter, bad, pipe, other_model], by_signal)
        })
    };
    let (mut seq, mut published) = (0, Vec::<Parameters>::new());
    while finished.try_recv().is_err() {
        seq += 1;
        states.send(&arm.at(seq)).expect("sent");
        std::thread::sleep(Duration::from_micros(100));
        while let Some(set) = parameters.receive().expect("received") {
            published.push(set);
        }
    }
    let ([other_window, other_filter, bad, pipe, other_model], by_signal) = neighbour.join().expect("no panic");
    let last =
        eventually("the last sample is in", || health.receive().expect("received").filter(|health| health.seq == seq));
    while let Some(set) = parameters.receive().expect("received") {
        published.push(set);
    }
    drop(process);

    assert_eq!((last.samples, last.lost, last.gaps), (seq, 0, 0), "every sample went in");
    assert!(published.windows(2).all(|pair| pair[1].epoch == pair[0].epoch + 1), "every publication came");
    assert_eq!(other_window.0, ControlStatus::Done, "{}", other_window.1);
    assert!(other_window.1.contains("so do the window and the filters"), "{}", other_window.1);
    assert_eq!(other_filter.0, ControlStatus::Done, "{}", other_filter.1);
    assert!(other_filter.1.contains("the filters settle anew"), "{}", other_filter.1);
    assert_eq!(bad.0, ControlStatus::Refused);
    assert!(bad.1.contains("robot.toml:25:12"), "the place is named: {}", bad.1);
    assert_eq!(pipe.0, ControlStatus::Refused);
    assert!(pipe.1.contains("robot.toml") && pipe.1.contains("a pipe or a device"), "{}", pipe.1);
    assert_eq!(other_model.0, ControlStatus::Refused);
    assert!(other_model.1.contains("restart"), "{}", other_model.1);
    assert!(by_signal.contains("the filters settle anew"), "{by_signal}");

    // The same samples through a core that is changed after the samples that were named: bit for bit what came over the bus. So
    // each change took effect, when it was said to, and none of them moved a parameter by itself.
    assert_eq!((last.load_level, last.load_changes), (u32::from(LoadLevel::Normal), 0), "the work fits");
    let changed = |from: &str, to: &str| {
        write(folder.path(), from, to);
        Box::new(Core::new(&rivet_config::load(&file).expect("a sound file")).expect("sound settings"))
    };
    let after = |text: &str| -> u64 {
        let number = text.split("after sample ").nth(1).and_then(|rest| rest.split(';').next()).expect("it is named");
        number.parse().expect("a number")
    };
    let mut changes = [
        (after(&other_window.1), changed("window_s = 5.0", "window_s = 3.0")),
        (after(&other_filter.1), changed("model_filter_hz = 10.0 ", "model_filter_hz = 8.0 ")),
        (after(&by_signal), changed("", "")),
    ];
    let mut core = changed("", "");
    let (mut replayed, mut set) = (Vec::new(), Parameters::default());
    for seq in 1..=last.seq {
        if core.tick(&arm.at(seq), None).publish {
            core.write_parameters(&mut set);
            replayed.push(set);
        }
        for (_, fresh) in changes.iter_mut().filter(|(after, _)| *after == seq) {
            core.write_parameters(&mut set);
            let before = set;
            core.reconfigure(fresh);
            core.write_parameters(&mut set);
            assert_eq!((set.values, set.std), (before.values, before.std), "no step after sample {seq}");
        }
    }
    assert_eq!(replayed.len(), published.len());
    for (mut live, off_line) in published.into_iter().zip(replayed) {
        live.flags &= !parameter_flags::LATE;
        assert_eq!(live, off_line, "sample {}", off_line.seq);
    }
}

/// Who takes SIGHUP for a wish to read the file anew must not let down the arm: the controller goes on, and says that it did not.
#[test]
fn a_hangup_does_not_end_the_controller() {
    let _turn = turn();
    let private = PrivateBus::new("hangup");
    let folder = tempfile::tempdir().expect("a folder");
    let stage = Stage::new(private.config(), folder.path(), "manutec-r3", "");
    let mut controller = stage.controller(&["--lockstep"]);
    let _plant = stage.plant(&["--lockstep", "2000", "--unpaced"]);
    let before = stage.wait("commands", |health| health.commands > 100);
    controller.signal("-HUP");
    stage.wait("more of them", |health| health.commands > before.commands + 2000);
    assert!(controller.end("-TERM").success());
}
