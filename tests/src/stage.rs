//! Plant, daemon and controller of one arm as processes on a bus of their own, and what their log says.

use crate::process::{Process, eventually};
use crate::{rivet, robot};
use rivet_ipc_schema::{Bus, BusConfig, ControllerHealth, ParameterSource, RobotName, Subscriber};
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Three processes that wait for each other are enough for a small machine: one test after the other.
pub fn turn() -> MutexGuard<'static, ()> {
    static TURN: Mutex<()> = Mutex::new(());
    TURN.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A robot file in a folder of its own: an arm whose friction turns over smoothly (the jumps of Coulomb's law would hide every
/// other step of the torque), with some more lines in its controller section.
fn robot_file(arm: &str, folder: &Path, controller: &str) -> PathBuf {
    let original = robot(arm);
    let urdf = original.with_file_name("robot.urdf");
    let text = std::fs::read_to_string(&original).expect("the robot file is there");
    let text = text.replacen("urdf = \"robot.urdf\"", &format!("urdf = {:?}", urdf.display().to_string()), 1);
    let text: String =
        text.lines().filter(|line| !line.starts_with("friction_velocity")).flat_map(|line| [line, "\n"]).collect();
    // The rest of the section's head line may be a comment.
    let text = text.replacen("\n[signal]", "\n[signal]\nfriction_velocity = 0.3 #", 1);
    let text = text.replacen("[controller]\n", &format!("[controller]\n{controller}\n"), 1);
    let file = folder.join("robot.toml");
    std::fs::write(&file, text).expect("written");
    file
}

/// Plant, daemon and controller of one bus.
pub struct Stage<'a> {
    config: &'a BusConfig,
    /// The robot file.
    pub file: PathBuf,
    folder: &'a Path,
    /// What the controller says of itself.
    pub health: Subscriber<ControllerHealth>,
    /// The test's own party on the bus.
    pub bus: Bus,
}

impl<'a> Stage<'a> {
    /// Nothing runs yet. `controller`: more lines of that section of the robot file.
    pub fn new(config: &'a BusConfig, folder: &'a Path, arm: &str, controller: &str) -> Stage<'a> {
        let bus = Bus::open(config, &RobotName::new(arm).expect("a name"), "test").expect("the bus opens");
        let health = bus.controller_health_subscriber().expect("a subscriber");
        Stage { config, file: robot_file(arm, folder, controller), folder, health, bus }
    }

    fn process(&self, words: &[&str]) -> Process {
        let mut command = rivet();
        command.arg(words[0]).arg(&self.file).args(&words[1..]).args(["--die-with-parent", "--prefix"]);
        // What it prints is not wanted.
        Process::start(
            command
                .arg(&self.config.prefix)
                .arg("--root")
                .arg(&self.config.root)
                .stdin(Stdio::null())
                .stdout(Stdio::null()),
        )
    }

    fn state(&self) -> String {
        self.folder.join("state").display().to_string()
    }

    /// `rivetd`, which stores in the stage's folder.
    pub fn daemon(&self) -> Process {
        self.process(&["daemon", "--best-effort", "--trigger", "sample", "--state", &self.state()])
    }

    /// Asks the daemon to store what it knows, and waits until that is there.
    pub fn save(&self) {
        let robot = rivet_config::load(&self.file).expect("sound");
        let store = rivet_store::Store::reader(Path::new(&self.state()), &robot.config.name);
        let mut command = rivet();
        command.arg("control").arg(&self.file).args(["save", "--prefix"]).arg(&self.config.prefix);
        // It is refused when there is nothing new to store.
        command.arg("--root").arg(&self.config.root).output().expect("the program starts");
        eventually("stored parameters", || store.load(robot.hash).knowledge.map(|_| ()));
    }

    /// `rivet-controller`, with more words.
    pub fn controller(&self, lockstep: &[&str]) -> Process {
        let state = self.state();
        self.process(&[&["controller", "--best-effort", "--state", &state], lockstep].concat())
    }

    /// The true arm has half as much friction again and heavier bodies.
    pub fn plant(&self, more: &[&str]) -> Process {
        let words = ["sim", "--motion", "fourier", "--noise", "0", "--bodies", "1.1", "--friction", "1.5"];
        self.process(&[&words[..], &["--friction-velocity", "0.3"], more].concat())
    }

    /// Waits for a health message of which `fits` is true.
    pub fn wait(&self, what: &str, mut fits: impl FnMut(&ControllerHealth) -> bool) -> ControllerHealth {
        eventually(what, || std::iter::from_fn(|| self.health.receive().expect("received")).find(|health| fits(health)))
    }

    /// Waits until these parameters are in use.
    pub fn wait_for(&self, source: ParameterSource) -> ControllerHealth {
        self.wait(&format!("{source:?}"), |health| health.source == u32::from(source))
    }
}

/// Columns `name1..6` of a log, row by row, by the time of the row.
pub fn columns(log: &Path, name: &str) -> Vec<(f64, [f64; 6])> {
    let text = std::fs::read_to_string(log).expect("the log is there");
    let mut lines = text.lines().filter(|line| !line.starts_with('#'));
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

/// Largest step of the torque in force between two rows, in parts of the torque limits, and rms distance from the plan, over
/// the rows from `from_s` on.
pub fn quality(log: &Path, limits: &[f64], from_s: f64) -> (f64, f64) {
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
