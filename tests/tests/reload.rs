//! A robot file that changes while rivetd works: no sample is missed, no parameter steps, a bad file changes nothing.

use rivet_ipc_schema::{Bus, ControlCommand, ControlStatus, JointState, Parameters, PrivateBus, RobotName};
use rivet_tests::{rivet, robot};
use std::fs;
use std::path::Path;
use std::process::{Child, Command};
use std::time::{Duration, Instant};

struct Process(Child);

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
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
    let mut command = rivet();
    command.arg("daemon").arg(folder.path().join("robot.toml"));
    command.args(["--best-effort", "--die-with-parent", "--prefix", &config.prefix, "--root"]).arg(&config.root);
    let process = Process(command.spawn().expect("the program starts"));
    eventually("rivetd listens", || (states.subscribers() > 0).then_some(()));

    // Samples go on without a pause, at about ten times their rate, while a neighbour reloads three times.
    let (done, finished) = std::sync::mpsc::channel();
    let neighbour = {
        let (folder, pid) = (folder.path().to_owned(), process.0.id());
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
            write(&folder, "gravity = [0.0, 0.0, -9.81]", "gravity = [0.0, 0.0, -1.62]");
            let other_model = ask();
            // By the signal as well: what was in force before is again.
            write(&folder, "", "");
            let sent = Command::new("kill").args(["-HUP", &pid.to_string()]).status().expect("kill runs");
            assert!(sent.success());
            std::thread::sleep(Duration::from_millis(300));
            done.send(()).expect("the test waits");
            [other_window, other_filter, bad, other_model]
        })
    };
    let (mut seq, mut published) = (0, Vec::<Parameters>::new());
    while finished.try_recv().is_err() {
        seq += 1;
        states.send(&sample(seq)).expect("sent");
        std::thread::sleep(Duration::from_micros(100));
        while let Some(set) = parameters.receive().expect("received") {
            published.push(set);
        }
    }
    let [other_window, other_filter, bad, other_model] = neighbour.join().expect("no panic");
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
    assert_eq!(other_model.0, ControlStatus::Refused);
    assert!(other_model.1.contains("restart"), "{}", other_model.1);
}
