//! `rivet check`: is this configuration sound, and what does it resolve to.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;

use crate::table::show;

/// Arguments of `rivet check`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Robot file.
    #[arg(value_name = "ROBOT.toml")]
    robot: PathBuf,
}

/// Prints the resolved configuration, or every mistake.
pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    let robot = rivet_config::load(&args.robot)?;
    show(&robot.describe())?;
    Ok(ExitCode::SUCCESS)
}
