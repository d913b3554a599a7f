//! `rivet diagnose --live`: a window of what an arm says on the bus, diagnosed as a log is.

use std::process::Stdio;
use std::time::{Duration, Instant};

use rivet_controller::Core as Controller;
use rivet_ipc_schema::{Bus, JointState, PrivateBus, RobotName};
use rivet_logs::read_columns;
use rivet_simulation::motion::{Fourier, FourierSettings, MotionLimits, load_ratio};
use rivet_simulation::{Disturbances, Payload};
use rivet_tests::closed::{ClosedLoop, robot_with};
use rivet_tests::{rivet, robot};
use serde_json::Value;

const ARM: &str = "manutec-r3";
const SECONDS: f64 = 24.0;

/// What an arm with 8 kg at its flange says while it moves.
fn samples() -> Vec<JointState> {
    let robot = robot_with(ARM, &[]);
    let mut load = load_ratio(&robot.model, &robot.nominal, &robot.config.drive.torque_limit);
    let limits = MotionLimits::of(&robot.model.arm, 0.5);
    let motion = Fourier::new(&limits, &FourierSettings::default(), &mut load);
    let payload = Some(Payload { mass: 8.0, com: [0.0, 0.05, 0.1] });
    let mut arm = ClosedLoop::new(&robot, &Disturbances { payload, ..Disturbances::default() }, Box::new(motion), 4);
    let mut controller = Controller::new(&robot, 0).expect("sound settings");
    let mut samples = Vec::new();
    arm.run(&mut controller, SECONDS, |_, sample, _| samples.push(*sample), |_| ());
    samples
}

/// Played faster than it was: time is that of the stamps. The verdict is the payload, and the window can be kept. Samples that
/// nothing can be made of, and those of a second robot controller, are left out by name.
#[test]
fn a_running_arm_is_diagnosed() {
    let samples = samples();
    let folder = tempfile::tempdir().expect("a folder");
    let (json, kept) = (folder.path().join("live.json"), folder.path().join("window.parquet"));
    let private = PrivateBus::new("live");
    let config = private.config();
    let bus = Bus::open(config, &RobotName::new(ARM).expect("a name"), "test-robot").expect("the bus");
    let states = bus.joint_state_publisher().expect("a publisher");
    let mut command = rivet();
    command
        .arg("diagnose")
        .arg(robot(ARM))
        .args(["--live", "20", "--prefix", &config.prefix, "--root"])
        .arg(&config.root);
    command.arg("--json").arg(&json).arg("--keep").arg(&kept).stdout(Stdio::null()).stderr(Stdio::piped());
    let child = command.spawn().expect("the program starts");
    let begin = Instant::now();
    while states.subscribers() == 0 {
        assert!(begin.elapsed() < Duration::from_secs(60), "nobody listens");
        std::thread::sleep(Duration::from_millis(1));
    }
    let stranger = bus.joint_state_publisher().expect("a publisher");
    for (k, few) in samples.chunks(20).enumerate() {
        for sample in few {
            states.send(sample).expect("sent");
        }
        let last = few[few.len() - 1];
        let [mut none, mut ahead, mut foreign] = [last; 3];
        none.q[1] = f64::NAN;
        none.stamp_ns += 1_000;
        ahead.stamp_ns += 1_000_000_000_000;
        foreign.tau = [300.0; 8];
        foreign.stamp_ns += 2_000;
        if k == 100 {
            states.send(&none).expect("sent");
            states.send(&ahead).expect("sent");
        }
        if k >= 100 {
            stranger.send(&foreign).expect("sent");
        }
        // A fifth of real time: the ring holds a second.
        std::thread::sleep(Duration::from_millis(4));
    }
    let output = child.wait_with_output().expect("it ends");
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "a cause is named; {said}");
    assert!(said.contains("2 samples could not be used"), "{said}");
    assert!(said.contains("of another publisher of joint states were ignored"), "{said}");
    let found: Value = serde_json::from_str(&std::fs::read_to_string(&json).expect("a file")).expect("JSON");
    let causes = found["causes"].as_array().expect("causes");
    let payload = causes.iter().find(|c| c["effect"] == "payload").unwrap_or_else(|| panic!("{found:#}"));
    let mass = payload["magnitude"]["mass_kg"].as_f64().expect("a mass");
    assert!((mass / 8.0 - 1.0).abs() < 0.15, "{mass} kg");
    let t = read_columns(&kept, &["t"]).expect("a log").remove(0);
    assert!((t[t.len() - 1] - 20.0).abs() < 0.5, "{} s", t[t.len() - 1]);
    // What the log is short of are samples that never came.
    assert!(t.len() > 19_000, "{} samples", t.len());
}

/// Nobody there is an error, not an empty log.
#[test]
fn silence_is_an_error() {
    let private = PrivateBus::new("silence");
    let config = private.config();
    let mut command = rivet();
    command
        .arg("diagnose")
        .arg(robot(ARM))
        .args(["--live", "1", "--prefix", &config.prefix, "--root"])
        .arg(&config.root);
    let output = command.output().expect("the program starts");
    assert!(output.status.code().is_some_and(|code| code >= 64), "{output:?}");
    assert!(String::from_utf8_lossy(&output.stderr).contains("no joint states"), "{output:?}");
}
