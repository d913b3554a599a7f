//! The process from outside: a test plays the controller over shared memory. No absolute time is asserted: simulated time
//! waits for the commands.

use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command as Process, Stdio};
use std::time::{Duration, Instant};

use rivet_config::Robot;
use rivet_dynamics::Workspace;
use rivet_ipc_schema::{
    BlackboardWriter, Bus, Command, CommandMode, JointState, Listener, MAX_JOINTS, PrivateBus, RobotName, Setpoint,
    Subscriber, faults,
};
use rivet_realtime::now_ns;

/// Longest a step of these tests may take before it counts as hung.
const HANGS: Duration = Duration::from_secs(60);

fn robot_file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../robots").join(name).join("robot.toml")
}

/// A child that does not outlive a failed test.
struct Sim(Child);

impl Drop for Sim {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn sim(robot: &str, bus: &PrivateBus, arguments: &[&str]) -> Sim {
    let child = Process::new(env!("CARGO_BIN_EXE_rivet-sim"))
        .arg(robot_file(robot))
        .args(["--prefix", &bus.config().prefix, "--root", bus.config().root.to_str().expect("UTF-8")])
        .args(arguments)
        .stdout(Stdio::piped())
        .spawn()
        .expect("rivet-sim starts");
    Sim(child)
}

fn ended(mut sim: Sim) -> (bool, serde_json::Value) {
    let begin = Instant::now();
    let status = loop {
        if let Some(status) = sim.0.try_wait().expect("wait") {
            break status;
        }
        assert!(begin.elapsed() < HANGS, "rivet-sim does not end");
        std::thread::sleep(Duration::from_millis(5));
    };
    let mut text = String::new();
    sim.0.stdout.take().expect("piped").read_to_string(&mut text).expect("UTF-8");
    (status.success(), serde_json::from_str(&text).unwrap_or(serde_json::Value::Null))
}

/// The nominal model with a little feedback, as a controller process would.
struct Hold {
    robot: Robot,
    workspace: Workspace,
    y: Vec<f64>,
    states: Subscriber<JointState>,
    arrival: Listener,
    setpoints: Subscriber<Setpoint>,
    commands: BlackboardWriter<Command>,
    last: Option<JointState>,
    setpoint: Option<Setpoint>,
    _bus: Bus,
}

impl Hold {
    fn new(robot: &str, bus: &PrivateBus) -> Self {
        let robot = rivet_config::load(robot_file(robot)).expect("robot file");
        let bus = Bus::open(bus.config(), &RobotName::new(&robot.config.name).expect("name"), "test").expect("bus");
        Self {
            workspace: Workspace::new(&robot.model.arm),
            y: vec![0.0; robot.dof() * robot.model.len()],
            robot,
            states: bus.joint_state_subscriber().expect("states"),
            arrival: bus.joint_state_listener().expect("arrival"),
            setpoints: bus.setpoint_subscriber().expect("setpoints"),
            commands: bus.command_writer().expect("commands"),
            last: None,
            setpoint: None,
            _bus: bus,
        }
    }

    fn next(&mut self) -> (JointState, Setpoint) {
        let begin = Instant::now();
        loop {
            if let Some(state) = self.states.receive().expect("receive") {
                while self.setpoint.is_none_or(|s| s.seq < state.seq) {
                    match self.setpoints.receive().expect("receive") {
                        Some(setpoint) => self.setpoint = Some(setpoint),
                        None => break,
                    }
                }
                // States from before the subscription to setpoints are nobody's.
                let Some(setpoint) = self.setpoint.filter(|s| s.seq == state.seq) else {
                    assert!(self.last.is_none(), "state {} has no setpoint", state.seq);
                    continue;
                };
                return (state, setpoint);
            }
            assert!(begin.elapsed() < HANGS, "no sample comes");
            self.arrival.wait(Duration::from_millis(20)).expect("wait");
        }
    }

    fn answer(&mut self, state: &JointState, setpoint: &Setpoint) {
        let (n, width) = (self.robot.dof(), self.robot.model.len());
        let model = &self.robot.model;
        model.regressor(&mut self.workspace, &state.q[..n], &setpoint.qd[..n], &setpoint.qdd[..n], &mut self.y);
        let mut command =
            Command { seq: state.seq, joints: n as u32, mode: CommandMode::Nominal.into(), ..Command::default() };
        let period = self.robot.config.sample_period_s;
        let last = self.last.filter(|last| last.seq + 1 == state.seq).unwrap_or(*state);
        for j in 0..n {
            let feed_forward: f64 = (0..width).map(|p| self.y[j * width + p] * self.robot.nominal[p]).sum();
            let (e, de) = (setpoint.q[j] - state.q[j], setpoint.qd[j] - (state.q[j] - last.q[j]) / period);
            // About 3 Hz at the joint's rotor inertia and a fair share of links.
            let stiffness = 400.0 * (self.robot.config.drive.rotor_inertia[j] + 0.3);
            command.tau[j] = feed_forward + stiffness * e + 0.07 * stiffness * de;
        }
        command.stamp_ns = now_ns();
        self.commands.write(&command);
        self.last = Some(*state);
    }
}

/// Two thousand periods in lockstep: no sample lost, none late, the arm follows; truth, log, summary and what was received
/// say the same.
#[test]
fn a_controller_exchanges_two_thousand_periods() {
    let bus = PrivateBus::new("simloop");
    let folder = tempfile::tempdir().expect("folder");
    let path = |name: &str| folder.path().join(name).to_str().expect("UTF-8").to_owned();
    let (truth, log, summary) = (path("truth.json"), path("log.csv"), path("summary.json"));
    let child = sim(
        "ur10e",
        &bus,
        &[
            "--lockstep",
            "20000",
            "--unpaced",
            "--duration",
            "2",
            "--seed",
            "3",
            "--bodies",
            "0.9",
            "--friction",
            "1.1",
            "--payload",
            "1.5",
            "--payload-com",
            "0.1,0,-0.05",
            "--truth-out",
            &truth,
            "--log-out",
            &log,
            "--summary-out",
            &summary,
        ],
    );
    let mut hold = Hold::new("ur10e", &bus);
    let (mut seen, mut last_seq): (Vec<(JointState, Setpoint)>, u64) = (Vec::new(), 0);
    while seen.len() < 2000 {
        let (state, setpoint) = hold.next();
        assert!(last_seq == 0 || state.seq == last_seq + 1, "lost {} to {}", last_seq, state.seq);
        last_seq = state.seq;
        hold.answer(&state, &setpoint);
        if state.faults & faults::STOPPED == 0 {
            seen.push((state, setpoint));
        } else {
            assert!(seen.is_empty(), "the brakes closed in between");
            assert_eq!(setpoint.qd, [0.0; MAX_JOINTS], "a braked arm has no plan to move");
        }
    }
    let (success, printed) = ended(child);
    assert!(success);
    let written: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(&summary).expect("summary")).expect("JSON");
    assert_eq!(printed, written, "the line on standard output is the summary");
    assert_eq!((&printed["ended"], &printed["robot"]), (&"duration".into(), &"ur10e".into()));
    assert_eq!((&printed["brake_engagements"], &printed["lockstep_timeouts"]), (&0.into(), &0.into()));
    assert_eq!(printed["samples"], last_seq, "samples are counted as published");
    assert_eq!((&printed["moving"], &printed["late_commands"]), (&2000.into(), &0.into()));
    assert!(printed["tracking"][0]["rms"].as_array().expect("rms").iter().all(|e| e.as_f64().expect("number") < 0.02));
    assert!(seen.iter().any(|(s, _)| (s.q[0] - seen[0].0.q[0]).abs() > 0.02), "the arm moves");

    let text = std::fs::read_to_string(&log).expect("log");
    let mut lines = text.lines();
    assert_eq!(lines.next(), Some("# rivet: SI units, signs and zeros of the model"));
    let header: Vec<&str> = lines.next().expect("header").split(',').collect();
    assert_eq!((header.len(), header[0], header[1], header[7], header[30]), (31, "t", "q1", "tau1", "qdd_des6"));
    let mut rows = 0;
    for (line, (state, setpoint)) in lines.zip(&seen) {
        let row: Vec<f64> = line.split(',').map(|x| x.parse().expect("number")).collect();
        assert!((row[0] - (state.seq - 1) as f64 * 0.001).abs() < 1e-9, "time of row {rows}");
        for j in 0..6 {
            let columns = [row[1 + j], row[7 + j], row[13 + j], row[19 + j], row[25 + j]];
            assert_eq!(
                columns,
                [state.q[j], state.tau[j], setpoint.q[j], setpoint.qd[j], setpoint.qdd[j]],
                "row {rows}"
            );
        }
        rows += 1;
    }
    assert_eq!((rows, text.lines().count()), (2000, 2002));

    let truth: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(&truth).expect("truth")).expect("JSON");
    let robot = &hold.robot;
    let values = |key: &str, what: &str| -> Vec<f64> {
        truth[key].as_array().expect("list").iter().map(|p| p[what].as_f64().expect("number")).collect()
    };
    assert_eq!(truth["model_hash"], format!("{:016x}", robot.hash));
    // The file has every digit; the reader of JSON in use here is good to a unit in the last place.
    let same =
        |a: &[f64], b: &[f64]| a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-15 * a.abs());
    assert!(same(&values("standard", "nominal"), &robot.nominal));
    assert!(same(&values("base", "nominal"), &robot.nominal_base));
    let standard = values("standard", "value");
    for (value, by_hand) in values("base", "value").iter().zip(robot.base.from_standard(&standard)) {
        assert!((value - by_hand).abs() <= 1e-12 * (1.0 + by_hand.abs()));
    }
    let index =
        |name: &str| robot.model.parameters.iter().position(|p| p.name(&robot.model.arm) == name).expect("named");
    let ratio = |name: &str| standard[index(name)] / robot.nominal[index(name)];
    assert!((ratio("l2.m") - 0.9).abs() < 1e-12 && (ratio("j1.viscous") - 1.1).abs() < 1e-12);
    let last = index("l6.m");
    assert!((standard[last] - 0.9 * robot.nominal[last] - 1.5).abs() < 1e-12, "payload");
    let moment = index("l6.mcx");
    assert!((standard[moment] - 0.9 * robot.nominal[moment] - 0.15).abs() < 1e-12, "payload's first moment");
}

/// Commands that stay away close the brakes, which hold; the next command opens them and the motion runs on.
#[test]
fn brakes_close_when_commands_stay_away() {
    let bus = PrivateBus::new("simbrake");
    let child = sim("dd2", &bus, &["--lockstep", "2", "--stale-periods", "5", "--duration", "4", "--seed", "1"]);
    let mut hold = Hold::new("dd2", &bus);
    let stopped = |state: &JointState| state.faults & faults::STOPPED != 0;
    let mut moving = 0;
    while moving < 500 {
        let (state, setpoint) = hold.next();
        hold.answer(&state, &setpoint);
        moving += usize::from(!stopped(&state));
    }
    // Silence until the arm has been braked for a while.
    let mut braked = Vec::new();
    while braked.len() < 400 {
        let (state, setpoint) = hold.next();
        if stopped(&state) {
            braked.push((state.q, setpoint.q));
        }
    }
    let (held, planned) = braked[200];
    for (q, plan) in &braked[200..] {
        // Within a few encoder steps of noise.
        assert!((0..2).all(|j| (q[j] - held[j]).abs() < 5e-5), "a braked arm stands");
        assert_eq!(*plan, planned, "and so does its plan");
        assert!((0..2).all(|j| (q[j] - plan[j]).abs() < 5e-5), "which is the pose held");
    }
    let mut last: Option<Setpoint> = None;
    let mut farthest = 0.0_f64;
    let mut again = 0;
    while again < 2000 {
        let (state, setpoint) = hold.next();
        hold.answer(&state, &setpoint);
        if !stopped(&state) {
            again += 1;
            if let Some(last) = last.filter(|last| last.seq + 1 == setpoint.seq) {
                assert!((0..2).all(|j| (setpoint.q[j] - last.q[j]).abs() < 0.02), "the plan jumps");
            }
            farthest = farthest.max((setpoint.q[0] - held[0]).abs());
            last = Some(setpoint);
        }
    }
    assert!(farthest > 0.05, "the motion runs on");
    // A signal ends it in order.
    Process::new("kill").arg(child.0.id().to_string()).status().expect("kill");
    let (success, summary) = ended(child);
    assert!(success && summary["ended"] == "signal");
    assert!(summary["brake_engagements"].as_u64().expect("count") >= 1);
}

/// Two runs in lockstep from the same seed publish the same bits once the brakes are open.
#[test]
fn a_run_repeats_bit_by_bit() {
    let run = || {
        let bus = PrivateBus::new("simbits");
        let child =
            sim("staubli-tx40", &bus, &["--lockstep", "20000", "--unpaced", "--duration", "0.3", "--seed", "8"]);
        let mut hold = Hold::new("staubli-tx40", &bus);
        let mut bits = Vec::new();
        while bits.len() < 300 {
            let (state, setpoint) = hold.next();
            hold.answer(&state, &setpoint);
            if state.faults & faults::STOPPED == 0 {
                bits.push((state.q.map(f64::to_bits), state.tau.map(f64::to_bits)));
            }
        }
        assert!(ended(child).0);
        bits
    };
    assert_eq!(run(), run());
}

/// Nobody commands: it says so and fails, after the time it was given.
#[test]
fn patience_ends() {
    let bus = PrivateBus::new("simalone");
    let (success, _) = ended(sim("dd2", &bus, &["--patience", "0.2"]));
    assert!(!success);
}
