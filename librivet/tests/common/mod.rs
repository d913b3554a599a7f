//! What the tests share: a bus of their own, the two programs as processes, the built library.
#![allow(dead_code, reason = "each test uses its part")]

use rivet_ipc_schema::{BusConfig, ControllerHealth, Health, Parameters, PrivateBus, RobotName, Subscriber};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};

/// Samples of a run.
pub(crate) const SAMPLES: u64 = 10_000;

/// The robot of the examples.
pub(crate) const ROBOT: &str = "example-arm";

/// One test after the other: each has several processes.
pub(crate) fn turn() -> MutexGuard<'static, ()> {
    static TURN: Mutex<()> = Mutex::new(());
    TURN.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Root of the checkout.
pub(crate) fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("this crate lies in the workspace")
}

/// `target/<profile>`.
pub(crate) fn profile_folder() -> PathBuf {
    let this = std::env::current_exe().expect("a running test has a file");
    this.ancestors().nth(2).expect("tests lie in target/<profile>/deps").to_owned()
}

/// Says that something was not tested, past the test harness.
pub(crate) fn skipped(why: &str) {
    let _ = writeln!(std::io::stderr(), "SKIPPED: {why}");
}

/// Whether a program of the machine runs.
pub(crate) fn runs(program: &str) -> bool {
    let found = Command::new(program).arg("--version").stdout(Stdio::null()).status().is_ok();
    if !found {
        skipped(&format!("{program} does not run"));
    }
    found
}

/// Runs a command to its end and returns what it printed; a failure is the test's.
pub(crate) fn succeed(command: &mut Command) -> String {
    let output = command.output().expect("the program starts");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{command:?} ended with {}\n{said}", output.status);
    assert_eq!(said, "", "{command:?}");
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Waits for something without asking how long it takes; only a hang fails.
pub(crate) fn eventually<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let begin = Instant::now();
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(begin.elapsed() < Duration::from_secs(120), "never: {what}");
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// A folder with the shared library under the names that a linker and a program look for.
pub(crate) fn library_folder(folder: &Path) -> PathBuf {
    let place = folder.join("lib");
    if !place.exists() {
        std::fs::create_dir(&place).expect("made");
        let library = profile_folder().join("deps/librivet.so");
        for name in ["librivet.so", "librivet.so.1"] {
            std::os::unix::fs::symlink(&library, place.join(name)).expect("linked");
        }
    }
    place
}

/// A bus of a test's own, and a folder.
pub(crate) struct Bus {
    private: PrivateBus,
    folder: tempfile::TempDir,
}

impl Bus {
    pub(crate) fn new(label: &str) -> Bus {
        Bus { private: PrivateBus::new(label), folder: tempfile::tempdir().expect("a folder") }
    }

    pub(crate) fn config(&self) -> &BusConfig {
        self.private.config()
    }

    pub(crate) fn prefix(&self) -> &str {
        &self.config().prefix
    }

    pub(crate) fn root(&self) -> &Path {
        &self.config().root
    }

    pub(crate) fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// A party of the test's.
    pub(crate) fn join(&self) -> rivet_ipc_schema::Bus {
        let robot = RobotName::new(ROBOT).expect("a sound name");
        rivet_ipc_schema::Bus::open(self.config(), &robot, "test").expect("the bus opens")
    }
}

/// A child that does not outlive the test.
pub(crate) struct Process(pub(crate) Child);

impl Process {
    /// `rivetd` or `rivet-controller` of the robot of the examples.
    pub(crate) fn program(name: &str, bus: &Bus) -> Process {
        let mut command = Command::new(program(name));
        command.arg(root().join("examples/arm/robot.toml")).args(["--best-effort", "--die-with-parent"]);
        command.arg("--prefix").arg(bus.prefix()).arg("--root").arg(bus.root());
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        Process(command.spawn().expect("the program starts"))
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A program of the profile that these tests were built with. It is built on first use unless it is newer than what it is made of.
fn program(name: &str) -> PathBuf {
    static BUILT: OnceLock<()> = OnceLock::new();
    let folder = profile_folder();
    BUILT.get_or_init(|| {
        if ["rivetd", "rivet-controller"].iter().all(|program| is_newer_than_its_sources(&folder.join(program))) {
            return;
        }
        let mut build = Command::new(env!("CARGO"));
        build.args(["build", "--quiet", "--package", "rivet-daemon", "--package", "rivet-controller"]);
        build.arg("--target-dir").arg(folder.parent().expect("profiles lie in the target folder"));
        if !cfg!(debug_assertions) {
            build.arg("--release");
        }
        assert!(build.current_dir(root()).status().expect("cargo runs").success(), "the programs build");
    });
    folder.join(name)
}

fn is_newer_than_its_sources(program: &Path) -> bool {
    let changed = |path: &Path| path.metadata().and_then(|file| file.modified()).ok();
    let Some(built) = changed(program) else { return false };
    let mut paths: Vec<PathBuf> =
        ["Cargo.lock", "config", "controller", "crates", "daemon", "ipc-schema"].map(|path| root().join(path)).into();
    while let Some(path) = paths.pop() {
        if path.is_dir() {
            let Ok(entries) = std::fs::read_dir(&path) else { return false };
            paths.extend(entries.flatten().map(|entry| entry.path()).filter(|path| !path.ends_with("tests")));
        } else if changed(&path).is_none_or(|changed| changed > built) {
            return false;
        }
    }
    true
}

/// `rivetd` and `rivet-controller`, and what they publish.
pub(crate) struct Programs {
    _bus: rivet_ipc_schema::Bus,
    health: Subscriber<Health>,
    controller_health: Subscriber<ControllerHealth>,
    parameters: Subscriber<Parameters>,
    _processes: [Process; 2],
}

impl Programs {
    /// Starts both and waits until both are on the bus.
    pub(crate) fn start(bus: &Bus) -> Programs {
        let party = bus.join();
        let programs = Programs {
            health: party.health_subscriber().expect("a port"),
            controller_health: party.controller_health_subscriber().expect("a port"),
            parameters: party.parameters_subscriber().expect("a port"),
            _bus: party,
            _processes: ["rivetd", "rivet-controller"].map(|name| Process::program(name, bus)),
        };
        programs.health_of_sample(0);
        programs.controller_health_of_sample(0);
        programs
    }

    /// Health of the daemon once it has taken in this sample.
    pub(crate) fn health_of_sample(&self, seq: u64) -> Health {
        eventually("health", || self.health.receive_newest().expect("received").filter(|health| health.seq >= seq))
    }

    /// Health of the controller once it has answered this sample.
    pub(crate) fn controller_health_of_sample(&self, seq: u64) -> ControllerHealth {
        let look = || self.controller_health.receive_newest().expect("received");
        eventually("health of the controller", || look().filter(|health| health.seq >= seq))
    }

    /// The latest parameters.
    pub(crate) fn parameters(&self) -> Parameters {
        eventually("parameters", || self.parameters.receive_newest().expect("received"))
    }
}
