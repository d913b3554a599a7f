//! What the tests share: a bus, a domain and two network namespaces of their own, and the programs as processes.

use rivet_ipc_schema::{PrivateBus, RobotName};
use rustix::process::Signal;
use serde_json::Value;
use std::fs::File;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicU16, Ordering};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError, mpsc};
use std::time::{Duration, Instant};

/// Waits for something without asking how long it takes; only a hang fails.
pub(crate) fn eventually<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let begin = Instant::now();
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(begin.elapsed() < Duration::from_secs(300), "never: {what}");
        std::thread::sleep(Duration::from_millis(1));
    }
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Says that something was not tested, past the test harness.
fn skipped(why: &str) {
    let _ = writeln!(std::io::stderr(), "SKIPPED: {why}");
}

/// Python of `RIVET_PYTHON`, else `python3`, if it has Cyclone DDS.
fn python() -> Option<PathBuf> {
    let python = PathBuf::from(std::env::var_os("RIVET_PYTHON").unwrap_or_else(|| "python3".into()));
    match Command::new(&python).args(["-c", "import cyclonedds.domain"]).output() {
        Ok(output) if output.status.success() => Some(python),
        Ok(output) => {
            let stderr = String::from_utf8_lossy(&output.stderr);
            let why = stderr.lines().last().unwrap_or_default();
            skipped(&format!("{} has no Cyclone DDS ({why}); pip install cyclonedds", python.display()));
            None
        }
        Err(why) => {
            skipped(&format!("{}: {why}", python.display()));
            None
        }
    }
}

/// Two network namespaces with a cable between them.
struct Namespaces([String; 2]);

impl Namespaces {
    /// `None` where the machine does not allow them.
    fn new(unique: &str) -> Option<Namespaces> {
        let made = Namespaces(["a", "b"].map(|side| format!("rv{unique}{side}")));
        let ip = |line: String| {
            let status = Command::new("ip").args(line.split(' ')).stdout(Stdio::null()).stderr(Stdio::null()).status();
            status.is_ok_and(|status| status.success())
        };
        let [a, b] = &made.0;
        let lines = [
            format!("netns add {a}"),
            format!("netns add {b}"),
            format!("link add {a} netns {a} type veth peer name {b} netns {b}"),
            format!("-n {a} addr add 10.77.0.1/24 dev {a}"),
            format!("-n {b} addr add 10.77.0.2/24 dev {b}"),
            format!("-n {a} link set lo up"),
            format!("-n {b} link set lo up"),
            format!("-n {a} link set {a} up"),
            format!("-n {b} link set {b} up"),
            // Whether a program may enter one.
            format!("netns exec {a} true"),
        ];
        if lines.into_iter().all(ip) { Some(made) } else { None }
    }
}

impl Drop for Namespaces {
    fn drop(&mut self) {
        for name in &self.0 {
            let _ = Command::new("ip").args(["netns", "del", name]).stderr(Stdio::null()).status();
        }
    }
}

/// A bus, a domain, a network and a folder of a test's own.
pub(crate) struct Stage {
    network: Option<Namespaces>,
    python: PathBuf,
    domain: u16,
    bus: PrivateBus,
    folder: tempfile::TempDir,
    _turn: MutexGuard<'static, ()>,
}

impl Stage {
    /// `None`, with a printed reason, where Python has no Cyclone DDS.
    pub(crate) fn new(label: &str) -> Option<Stage> {
        // One test after the other: each has several processes.
        static TURN: Mutex<()> = Mutex::new(());
        static COUNT: AtomicU16 = AtomicU16::new(0);
        let turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
        let python = python()?;
        let count = COUNT.fetch_add(2, Ordering::Relaxed);
        let process = std::process::id();
        // Domains 1 to 230: 0 may be somebody's.
        let domain = 1 + (process % 100 * 2) as u16 + count;
        let on_loopback = std::env::var_os("RIVET_ROS2_NETWORK").is_some_and(|name| name == "loopback");
        let network = if on_loopback { None } else { Namespaces::new(&format!("{}{count}", process % 100_000)) };
        let folder = tempfile::tempdir().expect("a folder");
        for file in ["robot.toml", "robot.urdf"] {
            let text =
                std::fs::read_to_string(root().join("examples/arm").join(file)).expect("the arm of the examples");
            let text = text.replace("sample_period_s = 0.001", "sample_period_s = 0.002");
            std::fs::write(folder.path().join(file), text).expect("written");
        }
        Some(Stage { network, python, domain, bus: PrivateBus::new(label), folder, _turn: turn })
    }

    pub(crate) fn place(&self) -> &'static str {
        if self.network.is_some() { "two network namespaces" } else { "loopback" }
    }

    /// Cuts the cable, or joins it again; whether there is one.
    pub(crate) fn cut(&self, cut: bool) -> bool {
        let Some(Namespaces([name, _])) = &self.network else {
            skipped("no network namespaces here; the link is not cut");
            return false;
        };
        let state = if cut { "down" } else { "up" };
        let status = Command::new("ip").args(["-n", name, "link", "set", name, state]).status().expect("ip runs");
        assert!(status.success());
        true
    }

    pub(crate) fn domain(&self) -> u16 {
        self.domain
    }

    /// `program` on a side of the cable: 0 is the bridge's, 1 the robot's.
    fn command(&self, side: usize, program: &Path) -> Command {
        match &self.network {
            Some(namespaces) => {
                let mut command = Command::new("ip");
                command.args(["netns", "exec", &namespaces.0[side]]).arg(program);
                command
            }
            None => Command::new(program),
        }
    }

    fn on_bus<'a>(&self, command: &'a mut Command) -> &'a mut Command {
        let config = self.bus.config();
        command.arg(self.folder.path().join("robot.toml"));
        command.arg("--prefix").arg(&config.prefix).arg("--root").arg(&config.root).arg("--die-with-parent")
    }

    /// A party of the test's.
    pub(crate) fn join(&self) -> rivet_ipc_schema::Bus {
        let robot = RobotName::new("example-arm").expect("a sound name");
        rivet_ipc_schema::Bus::open(self.bus.config(), &robot, "test").expect("the bus opens")
    }

    /// `rivetd`, once it is on the bus.
    pub(crate) fn daemon(&self) -> Process {
        let health = self.join().health_subscriber().expect("a port");
        let mut command = Command::new(rivetd());
        self.on_bus(&mut command).arg("--best-effort").stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        let process = Process(command.spawn().expect("rivetd starts"));
        eventually("health", || health.receive_newest().expect("received"));
        process
    }

    /// The program under test.
    pub(crate) fn bridge(&self, words: &[&str]) -> Bridge {
        self.bridge_on(self.domain, words)
    }

    pub(crate) fn bridge_on(&self, domain: u16, words: &[&str]) -> Bridge {
        static COUNT: AtomicU16 = AtomicU16::new(0);
        let stderr = self.folder.path().join(format!("bridge-{}", COUNT.fetch_add(1, Ordering::Relaxed)));
        let mut command = self.command(0, Path::new(env!("CARGO_BIN_EXE_rivet-ros2")));
        self.on_bus(&mut command).args(["--json", "--domain", &domain.to_string()]).args(words).stdin(Stdio::null());
        command.stdout(Stdio::piped()).stderr(File::create(&stderr).expect("made"));
        Bridge { process: Process(command.spawn().expect("the program starts")), stderr }
    }
}

/// A child that does not outlive the test.
pub(crate) struct Process(Child);

impl Process {
    fn signal(&self, signal: Signal) {
        let pid = i32::try_from(self.0.id()).ok().and_then(rustix::process::Pid::from_raw).expect("a process");
        rustix::process::kill_process(pid, signal).expect("it runs");
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The program under test, with the file of its standard error.
pub(crate) struct Bridge {
    process: Process,
    stderr: PathBuf,
}

impl Bridge {
    /// Its exit code and its standard error, once it has ended by itself.
    pub(crate) fn ended(mut self) -> (Option<i32>, String) {
        let status = self.process.0.wait().expect("waited");
        (status.code(), std::fs::read_to_string(&self.stderr).expect("read"))
    }

    /// Ends it by SIGTERM; its counts.
    pub(crate) fn finish(self) -> Value {
        self.finish_by(Signal::TERM)
    }

    /// Ends it by a signal; its counts.
    pub(crate) fn finish_by(self, signal: Signal) -> Value {
        self.process.signal(signal);
        self.wait()
    }

    /// Ends it by SIGKILL.
    pub(crate) fn kill(self) {
        drop(self.process);
    }

    /// Waits for its clean end; its counts.
    pub(crate) fn wait(mut self) -> Value {
        let mut text = String::new();
        self.process.0.stdout.take().expect("a pipe").read_to_string(&mut text).expect("read");
        let (code, stderr) = self.ended();
        assert_eq!(code, Some(0), "{stderr}\n{text}");
        println!("{stderr}");
        serde_json::from_str(&text).unwrap_or_else(|why| panic!("{why}: {text}"))
    }
}

/// The robot.
pub(crate) struct Peer {
    process: Process,
    lines: mpsc::Receiver<String>,
}

impl Peer {
    pub(crate) fn spawn(stage: &Stage, words: &[&str]) -> Peer {
        let mut command = stage.command(1, &stage.python);
        command.arg("-B").arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/graph/peer.py"));
        command.arg(stage.domain.to_string()).args(words).stdin(Stdio::null()).stdout(Stdio::piped());
        let mut process = Process(command.spawn().expect("Python starts"));
        let output = BufReader::new(process.0.stdout.take().expect("a pipe"));
        let (give, lines) = mpsc::channel();
        std::thread::spawn(move || output.lines().map_while(Result::ok).try_for_each(|line| give.send(line)));
        Peer { process, lines }
    }

    /// Starts it and waits until it publishes.
    pub(crate) fn start(stage: &Stage, words: &[&str]) -> Peer {
        let peer = Peer::spawn(stage, words);
        let line = peer.lines.recv_timeout(Duration::from_secs(120)).expect("it publishes");
        assert_eq!(line, "publishing");
        peer
    }

    /// What came to it, once it has ended by itself.
    pub(crate) fn finish(mut self, meanwhile: &mut dyn FnMut()) -> Value {
        let text = eventually("the robot's end", || {
            meanwhile();
            self.lines.try_recv().ok()
        });
        assert!(self.process.0.wait().expect("waited").success());
        serde_json::from_str(&text).unwrap_or_else(|why| panic!("{why}: {text}"))
    }

    /// Ends it by SIGKILL.
    pub(crate) fn kill(self) {
        drop(self.process);
    }

    /// Stops it, as a debugger does.
    pub(crate) fn hang(&self) {
        self.process.signal(Signal::STOP);
    }
}

/// `rivetd` of the profile that these tests were built with. It is built on first use unless it is newer than what it is made of.
fn rivetd() -> PathBuf {
    static BUILT: OnceLock<()> = OnceLock::new();
    let folder = Path::new(env!("CARGO_BIN_EXE_rivet-ros2")).parent().expect("a folder").to_owned();
    let program = folder.join("rivetd");
    BUILT.get_or_init(|| {
        if is_newer_than_its_sources(&program) {
            return;
        }
        let mut build = Command::new(env!("CARGO"));
        build.args(["build", "--quiet", "--package", "rivet-daemon"]);
        build.arg("--target-dir").arg(folder.parent().expect("profiles lie in the target folder"));
        if !cfg!(debug_assertions) {
            build.arg("--release");
        }
        assert!(build.current_dir(root()).status().expect("cargo runs").success(), "rivetd builds");
    });
    program
}

fn is_newer_than_its_sources(program: &Path) -> bool {
    let changed = |path: &Path| path.metadata().and_then(|file| file.modified()).ok();
    let Some(built) = changed(program) else { return false };
    let crates = ["dynamics", "estimation", "files", "input-checks", "realtime", "service", "store"];
    let mut paths: Vec<PathBuf> = ["config", "daemon", "ipc-schema"].map(|path| root().join(path)).into();
    paths.extend(crates.map(|name| root().join("crates").join(name)));
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
