//! Programs beside this one that are built apart: their command becomes the program. Both have the same command line, which
//! [`rivet_service`] defines.

use std::os::unix::process::CommandExt as _;
use std::process::{Command, ExitCode};

use anyhow::{Context as _, Result, bail};

/// `rivet ros2` brings DDS.
pub(crate) const ROS2: OptionalProgram = OptionalProgram { name: "rivet-ros2", folder: "crates/ros2" };
/// `rivet view` brings WebSocket.
pub(crate) const VIEW: OptionalProgram = OptionalProgram { name: "rivet-view", folder: "crates/view" };

/// A program that is built apart.
#[derive(Clone, Copy, Debug)]
pub(crate) struct OptionalProgram {
    /// Its name, and that of its package.
    name: &'static str,
    /// The folder of its package below the workspace.
    folder: &'static str,
}

impl OptionalProgram {
    /// Replaces this process by the program of the same folder, which reads the words behind the command again; returns only where
    /// that cannot be.
    pub(crate) fn run(self) -> Result<ExitCode> {
        let OptionalProgram { name, folder } = self;
        let this = std::env::current_exe().context("cannot find this program's own file")?;
        let program = this.with_file_name(name);
        if !program.exists() {
            bail!(
                "{} is not built: cargo build --release -p {name}, or cargo install --path {folder}, puts it there",
                program.display()
            );
        }
        // It takes this process's place: signals and the exit code are its own.
        let why = Command::new(&program).args(std::env::args_os().skip(2)).exec();
        Err(why).with_context(|| format!("cannot start {}", program.display()))
    }
}
