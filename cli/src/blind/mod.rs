//! `rivet blind`: diagnoses of cases whose answers are withheld, and how good they were.

mod run;
mod score;

use std::process::ExitCode;

use anyhow::Result;

/// Arguments of `rivet blind`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    /// Diagnose every case of a folder (each a folder with robot.toml and logs) in a process of its own
    Run(run::Args),
    /// Open the answers and count
    Score(score::Args),
}

pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    match &args.command {
        Command::Run(args) => run::run(args),
        Command::Score(args) => score::run(args),
    }
}
