//! `rivet ros2`: becomes the program `rivet-ros2` beside this one. It is built apart, since it brings DDS.

use std::ffi::OsString;
use std::os::unix::process::CommandExt as _;
use std::process::{Command, ExitCode};

use anyhow::{Context as _, Result, bail};

/// Name of the program.
const PROGRAM: &str = "rivet-ros2";

/// Arguments of `rivet ros2`: all of them are the program's.
#[derive(clap::Args)]
#[command(disable_help_flag = true)]
pub(crate) struct Args {
    /// Robot file and options of rivet-ros2; --help lists them
    #[arg(value_name = "ROBOT.toml", trailing_var_arg = true, allow_hyphen_values = true)]
    words: Vec<OsString>,
}

pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    let this = std::env::current_exe().context("cannot find this program's own file")?;
    let program = this.with_file_name(PROGRAM);
    if !program.exists() {
        bail!(
            "{} is not built: cargo build --release -p {PROGRAM}, or cargo install --path crates/ros2, puts it there",
            program.display()
        );
    }
    // It takes this process's place: signals and the exit code are its own.
    let why = Command::new(&program).args(&args.words).exec();
    Err(why).with_context(|| format!("cannot start {}", program.display()))
}
