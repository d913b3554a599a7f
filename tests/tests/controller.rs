//! `rivet-controller` beside a daemon that dies, and without samples: real processes.

use rivet_ipc_schema::{
    Bus, BusConfig, ControllerHealth, ControllerState, ParameterSource, PrivateBus, RobotName, SourceReason, Subscriber,
};
use rivet_tests::{rivet, robot};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Three processes that wait for each other are enough for a small machine: one test after the other.
fn turn() -> MutexGuard<'static, ()> {
    static TURN: Mutex<()> = Mutex::new(());
    TURN.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A child that does not outlive the test.
struct Process(Child);

impl Process {
    fn start(command: &mut Command) -> Process {
        Process(command.stdout(Stdio::null()).spawn().expect("the program starts"))
    }

    fn signal(&self, signal: &str) {
        let pid = self.0.id().to_string();
        assert!(Command::new("kill").args([signal, &pid]).status().expect("kill runs").success());
    }

    fn end(&mut self, signal: &str) {
        self.signal(signal);
        self.0.wait().expect("a child that ends");
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Waits for something without asking how long it takes; only a hang fails.
fn eventually<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let begin = Instant::now();
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(begin.elapsed() < Duration::from_secs(120), "never: {what}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// A robot file in a folder of its own: the manutec r3 whose friction turns over smoothly (the jumps of Coulomb's law would
/// hide every other step of the torque), with some more lines in its controller section.
fn robot_file(folder: &Path, controller: &str) -> PathBuf {
    let original = robot("manutec-r3");
    let urdf = original.with_file_name("robot.urdf");
    let text = std::fs::read_to_string(&original).expect("the robot file is there");
    let text = text.replacen("urdf = \"robot.urdf\"", &format!("urdf = {:?}", urdf.display().to_string()), 1);
    let text = text.replacen("[signal]\n", "[signal]\nfriction_velocity = 0.3\n", 1);
    let text = text.replacen("[controller]\n", &format!("[controller]\n{controller}\n"), 1);
    let file = folder.join("robot.toml");
    std::fs::write(&file, text).expect("written");
    file
}

/// Plant, daemon and controller of one bus.
struct Stage<'a> {
    config: &'a BusConfig,
    file: PathBuf,
    folder: &'a Path,
    health: Subscriber<ControllerHealth>,
    _bus: Bus,
}

impl<'a> Stage<'a> {
    fn new(config: &'a BusConfig, folder: &'a Path, controller: &str) -> Stage<'a> {
        let bus = Bus::open(config, &RobotName::new("manutec-r3").expect("a name"), "test").expect("the bus opens");
        let health = bus.controller_health_subscriber().expect("a subscriber");
        Stage { config, file: robot_file(folder, controller), folder, health, _bus: bus }
    }

    fn process(&self, words: &[&str]) -> Process {
        let mut command = rivet();
        command.arg(words[0]).arg(&self.file).args(&words[1..]).args(["--die-with-parent", "--prefix"]);
        Process::start(command.arg(&self.config.prefix).arg("--root").arg(&self.config.root))
    }

    fn state(&self) -> String {
        self.folder.join("state").display().to_string()
    }

    fn daemon(&self) -> Process {
        self.process(&["daemon", "--best-effort", "--trigger", "sample", "--state", &self.state()])
    }

    fn controller(&self, lockstep: &[&str]) -> Process {
        let state = self.state();
        self.process(&[&["controller", "--best-effort", "--state", &state], lockstep].concat())
    }

    /// The true arm has half as much friction again and heavier bodies.
    fn plant(&self, more: &[&str]) -> Process {
        let words = ["sim", "--motion", "fourier", "--noise", "0", "--bodies", "1.1", "--friction", "1.5"];
        self.process(&[&words[..], &["--friction-velocity", "0.3"], more].concat())
    }

    /// Waits for a health message of which `fits` is true.
    fn wait(&self, what: &str, mut fits: impl FnMut(&ControllerHealth) -> bool) -> ControllerHealth {
        eventually(what, || std::iter::from_fn(|| self.health.receive().expect("received")).find(|health| fits(health)))
    }

    fn wait_for(&self, source: ParameterSource) -> ControllerHealth {
        self.wait(&format!("{source:?}"), |health| health.source == u32::from(source))
    }
}

/// Columns `name1..6` of a log, row by row, by the time of the row.
fn columns(log: &Path, name: &str) -> Vec<(f64, [f64; 6])> {
    let text = std::fs::read_to_string(log).expect("the log is there");
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().expect("a header").split(',').collect();
    let place = |wanted: &str| header.iter().position(|h| *h == wanted).expect("a column of that name");
    let (t, first) = (place("t"), place(&format!("{name}1")));
    lines
        .map(|line| {
            let values: Vec<f64> = line.split(',').map(|v| v.parse().unwrap_or(f64::NAN)).collect();
            (values[t], std::array::from_fn(|j| values[first + j]))
        })
        .collect()
}

/// Largest step of the torque in force between two rows, and rms distance from the plan, over the rows from `from_s` on.
fn quality(log: &Path, from_s: f64) -> (f64, f64) {
    let limits = [945.0, 1890.0, 540.0, 210.7, 185.9, 75.0];
    let tau = columns(log, "tau");
    let steps = tau.windows(2).filter(|rows| rows[0].0 >= from_s);
    let step =
        steps.flat_map(|rows| (0..6).map(|j| (rows[1].1[j] - rows[0].1[j]).abs() / limits[j])).fold(0.0, f64::max);
    let (q, plan) = (columns(log, "q"), columns(log, "q_des"));
    let errors: Vec<f64> = q
        .iter()
        .zip(&plan)
        .filter(|(row, _)| row.0 >= from_s)
        .flat_map(|(row, plan)| (0..6).map(|j| (row.1[j] - plan.1[j]).powi(2)))
        .collect();
    (step, (errors.iter().sum::<f64>() / errors.len() as f64).sqrt())
}

/// One run of about 20 s of motion; `disturb` acts on the daemon some seconds after live parameters came into use. Returns step,
/// tracking error, and the health at the end.
fn run(name: &str, disturb: impl FnOnce(&Stage<'_>, &mut Process)) -> (f64, f64, ControllerHealth) {
    let private = PrivateBus::new(name);
    let folder = tempfile::tempdir().expect("a folder");
    let stage = Stage::new(private.config(), folder.path(), "");
    let log = folder.path().join("log.csv");
    let mut daemon = stage.daemon();
    let _controller = stage.controller(&["--lockstep"]);
    let log_words = log.display().to_string();
    let mut plant = stage.plant(&["--lockstep", "2000", "--unpaced", "--log-out", &log_words]);
    let live = stage.wait_for(ParameterSource::Live);
    // Five seconds for the estimate to become good.
    let from = stage.wait("a good estimate", |health| health.seq >= live.seq + 5000).seq;
    disturb(&stage, &mut daemon);
    let enough = stage.wait("the end", |health| health.seq >= from + 14_000);
    plant.end("-TERM");
    // The log counts motion, the samples began before it: what is left out of the log's start is a little more.
    let (step, error) = quality(&log, from as f64 * 0.001);
    (step, error, enough)
}

/// The daemon is killed in mid motion, and started again: the arm goes on tracking, the torque takes no step that an
/// undisturbed run does not take, and the new daemon's parameters are adopted.
#[test]
fn a_daemon_that_is_killed_leaves_the_last_good_parameters() {
    let _turn = turn();
    let (step, error, health) = run("undisturbed", |_, _| ());
    assert_eq!(health.stops, 0);
    let (killed_step, killed_error, killed_health) = run("killed", |stage, daemon| {
        daemon.end("-KILL");
        let health = stage.wait_for(ParameterSource::LastGood);
        assert_eq!(SourceReason::try_from(health.source_reason), Ok(SourceReason::Silent));
        let seq = health.seq;
        stage.wait("two seconds without a daemon", |health| health.seq >= seq + 2000);
        *daemon = stage.daemon();
        let health = stage.wait_for(ParameterSource::Live);
        assert_eq!(SourceReason::try_from(health.source_reason), Ok(SourceReason::Adopted));
    });
    assert_eq!(killed_health.stops, 0);
    println!(
        "undisturbed: step {step:.5} of the limit, error {error:.3e} rad; killed: {killed_step:.5}, {killed_error:.3e} rad"
    );
    // The largest of 10⁴ noisy steps differs by some 15 % from run to run; the rate limit itself would be 1.45 times it.
    assert!(killed_step <= 1.25 * step, "largest step {killed_step} of the torque limit, undisturbed {step}");
    assert!(killed_error <= 1.1 * error, "tracking error {killed_error} rad, undisturbed {error}");
}

/// A controller that starts without a daemon starts on what an earlier daemon stored.
#[test]
fn a_controller_starts_on_stored_parameters() {
    let _turn = turn();
    let private = PrivateBus::new("stored");
    let folder = tempfile::tempdir().expect("a folder");
    let stage = Stage::new(private.config(), folder.path(), "");
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
    let health = stage.wait("a new run", |health| health.commands < 2000 && health.seq > 0);
    assert_eq!(ParameterSource::try_from(health.source), Ok(ParameterSource::LastGood));
    assert_eq!(SourceReason::try_from(health.source_reason), Ok(SourceReason::Stored));
}

/// First the controller is started anew, then the robot, which counts from 1 again, while the daemon goes on: numbers of the
/// run before lock nothing out, the new run's parameters are adopted and its plan is followed.
#[test]
fn a_controller_and_then_a_robot_that_start_anew_get_fresh_parameters() {
    let _turn = turn();
    let private = PrivateBus::new("anew");
    let folder = tempfile::tempdir().expect("a folder");
    let stage = Stage::new(private.config(), folder.path(), "");
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
    let stage = Stage::new(private.config(), folder.path(), "stale_periods = 500\nstop_reaction = \"ramp\"");
    let _controller = stage.controller(&[]);
    let plant = stage.plant(&["--stale-periods", "100000"]);
    stage.wait("a second of motion", |health| health.seq > 2000);
    plant.signal("-STOP");
    let stopped = stage.wait("the stop reaction", |health| health.stops == 1);
    assert_eq!(ControllerState::try_from(stopped.state), Ok(ControllerState::Stopping));
    let record = folder.path().join("state/manutec-r3.0.flight.csv");
    eventually("the flight record", || record.exists().then_some(()));
    let text = std::fs::read_to_string(&record).expect("read");
    assert_eq!(text.lines().count(), 1001, "a header and the last thousand");
    let last: u64 = text.lines().last().and_then(|line| line.split(',').nth(1)?.parse().ok()).expect("a number");
    assert_eq!(last, stopped.seq, "up to the last sample");
    let (tau, command) = (columns(&record, "tau"), columns(&record, "command"));
    // The torque in force at a latch is the command that answered the sample before (there is no noise here).
    let follows = (1..1000).filter(|&k| (tau[k].1[0] - command[k - 1].1[0]).abs() < 1e-9).count();
    assert!(follows > 900, "{follows}");
    plant.signal("-CONT");
    let on = stage.wait("samples again", |health| health.seq > stopped.seq + 500);
    assert_ne!(ControllerState::try_from(on.state), Ok(ControllerState::Stopping));
}
