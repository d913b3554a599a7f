//! `rivet robot`: robots that are read by their own protocols.

mod backoff;
mod ur;

use anyhow::Result;
use std::process::ExitCode;

/// Which robot.
#[derive(clap::Subcommand)]
pub(crate) enum Args {
    /// Universal Robots, CB3, e-Series and later, by RTDE
    Ur(ur::Args),
}

pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    match args {
        Args::Ur(args) => ur::run(args),
    }
}
