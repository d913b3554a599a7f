//! `rivet robot ur` against a controller on loopback: every sample arrives, the arm is identified beside a real `rivetd`, and what
//! goes wrong is reported, counted and survived. The controller itself is read by an independent client.

use std::cell::RefCell;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use rivet_config::Robot;
use rivet_dynamics::Workspace;
use rivet_ipc_schema::{Bus, BusConfig, Health, JointState, PrivateBus, RobotName, Setpoint, Subscriber, faults};
use rivet_simulation::Disturbances;
use rivet_tests::closed::ClosedLoop;
use rivet_tests::process::{Process, daemon, eventually};
use rivet_tests::ur_controller::{Behaviour, GAIN, PERIOD_S, Period, UrController, motion, temperature};
use rivet_tests::{rivet, robot};
use serde_json::Value;

const ARM: &str = "ur10e";

/// The true arm, against its file.
const TRUE_ARM: Disturbances = Disturbances {
    bodies: 1.1,
    rotor_inertia: 1.0,
    friction: 1.2,
    bodies_spread: 0.0,
    rotor_inertia_spread: 0.0,
    friction_spread: 0.0,
    payload: None,
    seed: 1,
};

/// One test after the other: each has several threads and processes with a rate to keep.
fn turn() -> MutexGuard<'static, ()> {
    static TURN: Mutex<()> = Mutex::new(());
    TURN.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The robot file of an arm that sends at 500 Hz, with lines changed.
fn robot_file(folder: &Path, changes: &[(&str, &str)]) -> PathBuf {
    let original = robot(ARM);
    let urdf = format!("urdf = {:?}", original.with_file_name("robot.urdf").display().to_string());
    let mut text = std::fs::read_to_string(&original).expect("the robot file is there");
    let all = [
        ("urdf = \"robot.urdf\"", urdf.as_str()),
        ("sample_period_s = 0.001", "sample_period_s = 0.002"),
        ("half_width = 25 ", "half_width = 6 "),
        ("decimation = 20 ", "decimation = 10 "),
    ];
    for (from, to) in all.iter().chain(changes) {
        assert!(text.contains(from), "{from}");
        text = text.replacen(from, to, 1);
    }
    let file = folder.join("robot.toml");
    std::fs::write(&file, text).expect("written");
    file
}

/// A bus, a robot file and the party of a test.
struct Scene {
    private: PrivateBus,
    folder: tempfile::TempDir,
    file: PathBuf,
    states: Subscriber<JointState>,
    plans: Subscriber<Setpoint>,
    /// Setpoints whose samples have not come yet.
    ahead: RefCell<Vec<Setpoint>>,
    health: Subscriber<Health>,
    bus: Bus,
}

impl Scene {
    fn new(label: &str, changes: &[(&str, &str)]) -> Scene {
        let private = PrivateBus::new(label);
        let folder = tempfile::tempdir().expect("a folder");
        let file = robot_file(folder.path(), changes);
        let bus = Bus::open(private.config(), &RobotName::new(ARM).expect("a name"), "test").expect("the bus opens");
        Scene {
            folder,
            file,
            states: bus.joint_state_subscriber().expect("a subscriber"),
            plans: bus.setpoint_subscriber().expect("a subscriber"),
            ahead: RefCell::default(),
            health: bus.health_subscriber().expect("a subscriber"),
            bus,
            private,
        }
    }

    fn config(&self) -> &BusConfig {
        self.private.config()
    }

    fn robot(&self) -> Robot {
        rivet_config::load(&self.file).expect("a sound file")
    }

    /// `rivet robot ur`, what it says in a file.
    fn start(&self, port: u16, more: &[&str]) -> Process {
        let mut command = rivet();
        command.args(["robot", "ur"]).arg(&self.file).args([
            "--die-with-parent",
            "--host",
            "127.0.0.1",
            "--json",
            "--port",
        ]);
        command.arg(port.to_string()).args(more).args(["--prefix", &self.config().prefix, "--root"]);
        command.arg(&self.config().root).stdin(Stdio::null()).stdout(Stdio::piped());
        command.stderr(std::fs::File::create(self.folder.path().join("stderr")).expect("a file"));
        Process::start(&mut command)
    }

    fn stderr(&self) -> String {
        std::fs::read_to_string(self.folder.path().join("stderr")).expect("a file")
    }

    fn waits_for(&self, words: &str) {
        let begin = Instant::now();
        while !self.stderr().contains(words) {
            assert!(begin.elapsed() < Duration::from_secs(60), "never {words:?} in\n{}", self.stderr());
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    /// Samples with their setpoints that have come since the last call.
    fn received(&self) -> Vec<(JointState, Option<Setpoint>)> {
        let mut plans = self.ahead.borrow_mut();
        let states: Vec<JointState> = std::iter::from_fn(|| self.states.receive().expect("received")).collect();
        // The setpoint of a sample is sent before it.
        plans.extend(std::iter::from_fn(|| self.plans.receive().expect("received")));
        let newest = states.last().map_or(0, |state| state.seq);
        let pairs =
            states.into_iter().map(|state| (state, plans.iter().find(|plan| plan.seq == state.seq).copied())).collect();
        plans.retain(|plan| plan.seq > newest);
        pairs
    }

    /// Collects until `done`.
    fn collect(&self, what: &str, all: &mut Vec<JointState>, mut done: impl FnMut(&[JointState]) -> bool) {
        eventually(what, || {
            all.extend(self.received().into_iter().map(|(state, _)| state));
            done(all).then_some(())
        });
    }
}

/// Ends the program; its summary.
fn summary(process: &mut Process) -> Value {
    let status = process.end("-TERM");
    assert_eq!(status.code(), Some(0), "{status}");
    let printed = std::io::read_to_string(process.0.stdout.take().expect("piped")).expect("text");
    serde_json::from_str(&printed).expect("JSON")
}

/// A short piece of the motion, for tests in which it does not matter.
fn short(robot: &Robot) -> Vec<Period> {
    let mut periods = motion(robot, &TRUE_ARM, 1.0);
    periods.retain(|(sample, _)| sample.faults == 0);
    periods
}

#[test]
fn every_sample_reaches_rivetd_and_the_arm_is_identified() {
    const SECONDS: f64 = 60.0;
    let _turn = turn();
    let scene = Scene::new("ur", &[]);
    let robot = scene.robot();
    let periods = motion(&robot, &TRUE_ARM, SECONDS);
    let count = periods.len() as u64;
    let controller = UrController::start(
        "127.0.0.1:0",
        periods.clone(),
        Behaviour { repeats: false, piece: 100, ..Behaviour::default() },
    );
    let parameters = scene.bus.parameters_subscriber().expect("a subscriber");
    let _daemon = Process::start(daemon(&scene.file, scene.config()).stderr(Stdio::null()));
    eventually("rivetd is there", || scene.health.receive_newest().expect("received").map(|_| ()));
    let mut bridge = scene.start(controller.address().port(), &[]);
    let (mut seen, mut stamp_ns) = (0_u64, 0);
    let mut stamps = Vec::new();
    eventually("all samples", || {
        for (state, plan) in scene.received() {
            // This test may be too slow for its own ring; rivetd's counts are below.
            assert!(state.seq > seen && state.joints == 6, "in order");
            seen = state.seq;
            let (sample, setpoint) = &periods[seen as usize - 1];
            assert_eq!((state.q, state.tau), (sample.q, sample.tau), "sample {seen}");
            assert_eq!(state.faults, sample.faults, "sample {seen}");
            let plan = plan.expect("a setpoint");
            assert_eq!((plan.q, plan.qd, plan.qdd), (setpoint.q, setpoint.qd, setpoint.qdd), "setpoint {seen}");
            assert!(stamp_ns < state.stamp_ns, "stamps go forward");
            stamp_ns = state.stamp_ns;
            stamps.push((seen, stamp_ns));
            assert_eq!(state.temperature[5], temperature(5));
        }
        (seen == count).then_some(())
    });
    let health = eventually("rivetd has the last sample", || {
        scene.health.receive_newest().expect("received").filter(|health| health.seq == count)
    });
    let bad = (health.lost, health.setpoints_missing, health.refused_stale, health.refused_invalid);
    assert_eq!(bad, (0, 0, 0, 0), "{health:?}\n{}", scene.stderr());
    assert_eq!(health.samples + health.rejected_faults + health.samples_held, count, "{health:?}");
    let used_s = cpu_s(&bridge);
    let printed = summary(&mut bridge);
    println!("{printed:#}");
    assert_eq!(controller.sent(), count);
    let sent_ns = controller.sent_ns();
    let mut behind: Vec<f64> =
        stamps.iter().map(|(seq, stamp)| (*stamp as f64 - sent_ns[*seq as usize - 1] as f64) * 1e-6).collect();
    behind.sort_by(f64::total_cmp);
    let at = |share: f64| behind[(share * (behind.len() - 1) as f64) as usize];
    println!("stamps less times of sending, median, 1 and 99 %: {:.3} {:.3} {:.3} ms", at(0.5), at(0.01), at(0.99));
    println!("{used_s} s of processor time for {SECONDS} s");
    assert_eq!([&printed["samples"], &printed["lost"], &printed["not_sent"]], [count, 0, 0]);
    assert_eq!(printed["torque_field"], "actual_current_as_torque");
    let found = eventually("parameters", || parameters.receive_newest().expect("received"));
    near_the_plant(&robot, &found.values[..robot.base.len()], &periods);
}

/// Processor time that a running process has used \[s\], to 10 ms.
fn cpu_s(process: &Process) -> f64 {
    let text = std::fs::read_to_string(format!("/proc/{}/stat", process.0.id())).expect("it runs");
    let (_, fields) = text.rsplit_once(") ").expect("fields behind the name");
    fields.split(' ').skip(11).take(2).map(|ticks| ticks.parse::<f64>().expect("a number") * 0.01).sum()
}

/// Torques of the motion by the identified parameters, by those of the file, and by those of the plant.
fn near_the_plant(robot: &Robot, found: &[f64], periods: &[Period]) {
    let truth = ClosedLoop::truth(robot, &TRUE_ARM);
    let (n, p, b) = (robot.dof(), robot.model.len(), robot.base.len());
    let mut workspace = Workspace::new(&robot.model.arm);
    let (mut full, mut rows) = (vec![0.0; n * p], vec![0.0; n * b]);
    let mut squares = vec![[0.0_f64; 2]; n];
    for (_, plan) in periods.iter().step_by(50) {
        robot.model.regressor(&mut workspace, &plan.q[..n], &plan.qd[..n], &plan.qdd[..n], &mut full);
        robot.base.select(&full, p, &mut rows);
        for (j, row) in rows.chunks_exact(b).enumerate() {
            for (sum, values) in squares[j].iter_mut().zip([found, &robot.nominal_base]) {
                *sum += row.iter().zip(values).zip(&truth).map(|((y, x), x0)| y * (x - x0)).sum::<f64>().powi(2);
            }
        }
    }
    for (j, [found, nominal]) in squares.into_iter().enumerate() {
        let ratio = (found / nominal).sqrt();
        println!("joint {}: torque error {:.1} % of that of the robot file", j + 1, 100.0 * ratio);
        assert!(ratio < 0.2, "joint {}: {ratio}", j + 1);
    }
}

/// The client is `ur_rtde`, which knows nothing of this project.
#[test]
fn an_independent_client_reads_the_controller() {
    const SCRIPT: &str = "
import sys, time
import rtde_receive
fields = ['timestamp', 'actual_q', 'target_q', 'target_qd', 'target_qdd', 'actual_current', 'target_moment',
          'joint_temperatures', 'robot_mode', 'safety_mode']
robot = rtde_receive.RTDEReceiveInterface(sys.argv[1], 500.0, fields)
for _ in range(200):
    before = robot.getTimestamp()
    row = [robot.getActualQ(), robot.getTargetQ(), robot.getTargetQd(), robot.getTargetQdd(), robot.getActualCurrent(),
           robot.getJointTemperatures(), [robot.getRobotMode(), robot.getSafetyMode()]]
    if robot.getTimestamp() == before:
        print(repr(before), *[repr(x) for values in row for x in values])
    time.sleep(0.003)
robot.disconnect()
";
    let _turn = turn();
    let python = || Command::new(std::env::var_os("RIVET_PYTHON").unwrap_or_else(|| "python3".into()));
    if !python().args(["-c", "import rtde_receive"]).output().is_ok_and(|output| output.status.success()) {
        // Past the test harness, which keeps what a passing test prints to itself.
        let _ = writeln!(std::io::stderr(), "SKIPPED: Python lacks ur_rtde; pip install ur_rtde");
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let robot = rivet_config::load(robot_file(folder.path(), &[])).expect("sound");
    let periods = short(&robot);
    // The library knows no other port.
    let pid = std::process::id();
    let host = format!("127.{}.{}.{}", 1 + (pid >> 16) % 200, (pid >> 8) & 0xff, 1 + (pid & 0xff) % 200);
    let controller = UrController::start(&format!("{host}:30004"), periods.clone(), Behaviour::default());
    let output = python().args(["-c", SCRIPT, &host]).output().expect("Python runs");
    let (printed, stderr) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{}: {printed}\n{stderr}", output.status);
    assert!(controller.sent() > 200);
    let rows: Vec<Vec<f64>> = printed
        .lines()
        .filter_map(|line| line.split(' ').map(|word| word.parse().ok()).collect::<Option<Vec<f64>>>())
        .filter(|row| row.len() == 39)
        .collect();
    assert!(rows.len() > 20, "{printed}\n{stderr}");
    for row in &rows {
        let tick = ((row[0] - 1234.5) / PERIOD_S).round() as usize;
        let (sample, plan) = &periods[tick % periods.len()];
        let currents: Vec<f64> = sample.tau[..6].iter().map(|tau| tau / GAIN).collect();
        let temperatures: Vec<f64> = (0..6).map(temperature).collect();
        let parts = [&sample.q[..6], &plan.q[..6], &plan.qd[..6], &plan.qdd[..6], &currents, &temperatures];
        assert_eq!(row[1..], [parts.concat(), vec![7.0, 1.0]].concat(), "period {tick}");
    }
}

/// Lost samples, texts, stops, broken connections and a restart, one after the other in one run.
#[test]
fn what_goes_wrong_is_counted_and_survived() {
    let _turn = turn();
    let scene = Scene::new("ur-faults", &[]);
    let controller = UrController::start("127.0.0.1:0", short(&scene.robot()), Behaviour::default());
    let mut bridge = scene.start(controller.address().port(), &[]);
    let mut all = Vec::new();
    let last = |all: &[JointState]| all.last().map_or(0, |state| state.seq);
    scene.collect("samples", &mut all, |all| last(all) >= 200);
    // Numbers of samples that the network lost are left out.
    controller.mute(5);
    scene.collect("a gap", &mut all, |all| all.windows(2).any(|pair| pair[1].seq == pair[0].seq + 6));
    // A text shows as text.
    controller.say("joint 3 \u{1b}[31mis warm\n", "Safety", 2);
    scene.waits_for("the controller's Safety (warning): joint 3 \\u{1b}[31mis warm\\n");
    // A protective stop, and its end.
    controller.set_modes(7, 3);
    scene.waits_for("robot running, safety protective stop; samples carry a fault bit until that ends");
    scene.collect("a fault bit", &mut all, |all| all.last().is_some_and(|state| state.faults == faults::OTHER));
    controller.set_modes(3, 1);
    scene.waits_for("robot power off, safety normal");
    scene.collect("another", &mut all, |all| all.last().is_some_and(|state| state.faults == faults::STOPPED));
    controller.set_modes(7, 1);
    scene.collect("none", &mut all, |all| all.last().is_some_and(|state| state.faults == 0));
    // The connection breaks; the controller's time goes on, so the samples in between are lost.
    let before = last(&all);
    controller.hang_up();
    scene.waits_for("the controller closed the connection; trying again");
    scene.waits_for("connected again");
    scene.collect("more samples", &mut all, |all| last(all) >= before + 200);
    assert!(all.windows(2).all(|pair| pair[1].seq > pair[0].seq), "one sequence up to here");
    // A package longer than any.
    controller.inject(&[0xff, 0xff, b'U']);
    scene.waits_for("DATA_PACKAGE of 65535 bytes; 3 to 4096 are accepted");
    let before = last(&all);
    scene.collect("more samples", &mut all, |all| last(all) >= before + 200);
    // Silence: nothing is published, the connection is given up and made anew.
    controller.mute(1500);
    scene.waits_for("no new sample for 2 s; trying again");
    let before = last(&all);
    scene.collect("more samples", &mut all, |all| last(all) >= before + 1500);
    // The controller starts anew: samples count from 1.
    let lost = all.last().expect("samples").seq - all.len() as u64;
    controller.restart();
    scene.waits_for("the controller has started anew");
    let first = all.len();
    scene.collect("samples from 1 on", &mut all, |all| {
        all[first..].iter().position(|state| state.seq == 1).is_some_and(|at| all.len() > first + at + 50)
    });
    let printed = summary(&mut bridge);
    let sent = controller.sent();
    scene.collect("the rest", &mut all, |all| all.len() as u64 == printed["samples"].as_u64().expect("a count"));
    println!("{printed:#}\n{}", scene.stderr());
    assert!(lost >= 5 + 1000, "{lost}");
    assert_eq!(printed["lost"].as_u64(), Some(lost), "what the sequence leaves out");
    assert_eq!((&printed["restarts"], &printed["texts"]), (&1.into(), &1.into()));
    assert_eq!(printed["not_sent"], 0);
    assert!(printed["connections"].as_u64().expect("a count") >= 5, "{printed}");
    // What was under way when a connection ended did not arrive.
    assert!(printed["samples"].as_u64().expect("a count") <= sent, "{sent}");
}

#[test]
fn currents_become_torques_by_the_robot_file_or_not_at_all() {
    let _turn = turn();
    let old = Behaviour { version: [5, 12, 4, 7], unknown: vec!["actual_current_as_torque"], ..Behaviour::default() };
    let gains = "drive_gain = [14.87, 13.26, 11.13, 10.62, 11.03, 11.47]";
    let scene = Scene::new("ur-gain", &[(gains, "")]);
    let periods = short(&scene.robot());
    let controller = UrController::start("127.0.0.1:0", periods.clone(), old.clone());
    let mut bridge = scene.start(controller.address().port(), &[]);
    assert_eq!(bridge.ends().code(), Some(78));
    let stderr = scene.stderr();
    assert!(stderr.contains("PolyScope 5.12.4.7") && stderr.contains("set [drive] drive_gain (N m/A"), "{stderr}");
    assert!(scene.received().is_empty(), "nothing was published");

    let scene = Scene::new("ur-current", &[(gains, "drive_gain = [1, 2, 3, 4, 5, 6]")]);
    let controller = UrController::start("127.0.0.1:0", periods.clone(), old);
    let mut bridge = scene.start(controller.address().port(), &["--seconds", "0.2"]);
    let mut states = Vec::new();
    eventually("0.2 s at 500 Hz", || {
        states.extend(scene.received());
        (states.len() == 100).then_some(())
    });
    assert_eq!(bridge.ends().code(), Some(0));
    for ((state, _), (sample, _)) in states.iter().zip(&periods) {
        for j in 0..6 {
            assert_eq!(state.tau[j], (j + 1) as f64 * (sample.tau[j] / GAIN), "joint {}", j + 1);
        }
    }
    let stderr = scene.stderr();
    assert!(stderr.contains("torque: actual_current [A], measured, times drive_gain"), "{stderr}");

    // Neither: what a model computes is no torque.
    let neither = vec!["actual_current_as_torque", "actual_current"];
    let controller =
        UrController::start("127.0.0.1:0", periods, Behaviour { unknown: neither, ..Behaviour::default() });
    let mut bridge = scene.start(controller.address().port(), &[]);
    assert_eq!(bridge.ends().code(), Some(78));
    assert!(scene.stderr().contains("neither actual_current_as_torque nor actual_current"), "{}", scene.stderr());
}

#[test]
fn refusals_name_the_remedy() {
    let _turn = turn();
    let scene = Scene::new("ur-refused", &[]);
    let periods = short(&scene.robot());
    let refuses = |behaviour: Behaviour, more: &[&str]| {
        let controller = UrController::start("127.0.0.1:0", periods.clone(), behaviour);
        let mut bridge = scene.start(controller.address().port(), more);
        (bridge.ends().code(), scene.stderr())
    };
    let (code, stderr) = refuses(Behaviour { accepts_protocol: false, ..Behaviour::default() }, &[]);
    assert!(code == Some(70) && stderr.contains("does not accept protocol version 2"), "{code:?}: {stderr}");
    let (code, stderr) = refuses(Behaviour { version: [3, 15, 8, 0], ..Behaviour::default() }, &[]);
    assert!(code == Some(78) && stderr.contains("set sample_period_s = 0.008"), "{code:?}: {stderr}");
    let (code, stderr) = refuses(Behaviour { unknown: vec!["actual_q"], ..Behaviour::default() }, &[]);
    assert!(code == Some(70) && stderr.contains("does not have the field actual_q"), "{code:?}: {stderr}");
    let (code, stderr) = refuses(Behaviour::default(), &["--rate", "125"]);
    assert!(code == Some(64) && stderr.contains("set it to 0.008"), "{code:?}: {stderr}");
    // Without targets the arm is read all the same.
    let behaviour = Behaviour { unknown: vec!["target_qdd"], ..Behaviour::default() };
    let controller = UrController::start("127.0.0.1:0", periods.clone(), behaviour);
    let mut bridge = scene.start(controller.address().port(), &["--seconds", "0.1"]);
    let mut states = Vec::new();
    eventually("0.1 s at 500 Hz", || {
        states.extend(scene.received());
        (states.len() == 50).then_some(())
    });
    assert!(states.iter().all(|(_, plan)| plan.is_none()));
    assert_eq!(bridge.ends().code(), Some(0));
    assert!(scene.stderr().contains("setpoint: none"), "{}", scene.stderr());
}

/// A host that is not there yet: one line, attempts with growing waits, and an end by SIGINT within one of them.
#[test]
fn a_controller_may_come_later() {
    let _turn = turn();
    let scene = Scene::new("ur-later", &[]);
    let periods = short(&scene.robot());
    // A port that is free: it was just given back.
    let port = std::net::TcpListener::bind("127.0.0.1:0").expect("a port").local_addr().expect("an address").port();
    let mut bridge = scene.start(port, &[]);
    scene.waits_for("trying again");
    std::thread::sleep(Duration::from_secs(1));
    assert_eq!(scene.stderr().matches("trying again").count(), 1, "{}", scene.stderr());
    assert!(scene.received().is_empty());
    let controller = UrController::start(&format!("127.0.0.1:{port}"), periods, Behaviour::default());
    let mut all = Vec::new();
    scene.collect("samples", &mut all, |all| all.len() > 50);
    drop(controller);
    scene.waits_for("the controller closed the connection");
    let begin = Instant::now();
    assert_eq!(bridge.end("-INT").code(), Some(0));
    println!("ended within {:?}", begin.elapsed());
    // Nobody at all: the end is orderly, and says that nothing came.
    let mut bridge = scene.start(port, &[]);
    scene.waits_for("trying again");
    assert_eq!(bridge.end("-INT").code(), Some(70));
    assert!(scene.stderr().contains("no sample came from 127.0.0.1"), "{}", scene.stderr());
}
