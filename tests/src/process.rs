//! Programs as children of a test, and waiting for what they do.

use rivet_ipc_schema::BusConfig;
use std::path::Path;
use std::process::{Child, Command, ExitStatus};
use std::time::{Duration, Instant};

/// A child that does not outlive the test.
#[derive(Debug)]
pub struct Process(pub Child);

impl Process {
    /// Starts it.
    pub fn start(command: &mut Command) -> Process {
        Process(command.spawn().expect("the program starts"))
    }

    /// Sends a signal, by its name with a dash: `-TERM`.
    pub fn signal(&self, name: &str) {
        let pid = self.0.id().to_string();
        assert!(Command::new("kill").args([name, &pid]).status().expect("kill runs").success());
    }

    /// Sends a signal and waits for the end.
    pub fn end(&mut self, signal: &str) -> ExitStatus {
        self.signal(signal);
        self.ends()
    }

    /// Waits for the end; only a hang fails.
    pub fn ends(&mut self) -> ExitStatus {
        eventually("the child ends", || self.0.try_wait().expect("a child"))
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// `rivet daemon` for the robot file on a bus of its own, without real time.
pub fn daemon(robot: &Path, config: &BusConfig) -> Command {
    let mut command = crate::rivet();
    command.arg("daemon").arg(robot).args(["--best-effort", "--die-with-parent", "--prefix", &config.prefix]);
    command.arg("--root").arg(&config.root);
    command
}

/// Waits for something without asking how long it takes; only a hang fails.
pub fn eventually<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let begin = Instant::now();
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(begin.elapsed() < Duration::from_secs(120), "never: {what}");
        std::thread::sleep(Duration::from_millis(1));
    }
}
