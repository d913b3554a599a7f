//! Processes that this program starts and always ends.

use anyhow::{Context, Result};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// Time a child has for a clean end before it is killed.
const PATIENCE: Duration = Duration::from_secs(3);

/// Children of this program, ended in reverse order of their start when this goes out of scope.
#[derive(Default)]
pub(crate) struct Children {
    running: Vec<(String, Child)>,
}

impl Children {
    /// Starts this very executable with other words: `words[0]` is the subcommand and the name in messages.
    ///
    /// What the child says goes to `log`, or is discarded when there is none.
    pub(crate) fn start(&mut self, words: &[String], log: Option<std::fs::File>) -> Result<()> {
        let name = words.first().cloned().unwrap_or_default();
        let program = std::env::current_exe().context("cannot find this program's own file")?;
        let mut command = Command::new(program);
        command.args(words).arg("--die-with-parent").stdin(Stdio::null()).stdout(Stdio::null());
        command.stderr(log.map_or_else(Stdio::null, Stdio::from));
        // A child that starts after this program was killed must not live on.
        command.env(rivet_realtime::PARENT_VARIABLE, std::process::id().to_string());
        let child = command.spawn().with_context(|| format!("cannot start rivet {name}"))?;
        self.running.push((name, child));
        Ok(())
    }

    /// The first child that has ended by itself, with its status.
    pub(crate) fn ended(&mut self) -> Option<(&str, ExitStatus)> {
        self.running.iter_mut().find_map(|(name, child)| child.try_wait().ok().flatten().map(|s| (name.as_str(), s)))
    }

    /// Ends all children: SIGTERM, then, where that is not heard, SIGKILL.
    pub(crate) fn end(&mut self) {
        while let Some((_, mut child)) = self.running.pop() {
            terminate(&child);
            let deadline = Instant::now() + PATIENCE;
            while matches!(child.try_wait(), Ok(None)) && Instant::now() < deadline {
                std::thread::sleep(Duration::from_millis(5));
            }
            // Both fail only for a child that has ended.
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

impl Drop for Children {
    fn drop(&mut self) {
        self.end();
    }
}

fn terminate(child: &Child) {
    let pid = i32::try_from(child.id()).ok().and_then(rustix::process::Pid::from_raw);
    if let Some(pid) = pid {
        // Fails only for a child that has ended.
        let _ = rustix::process::kill_process(pid, rustix::process::Signal::TERM);
    }
}
