//! `rivet blind`: diagnoses of cases whose answers are withheld, and how good they were.

mod make;
mod run;
mod score;
mod scores;

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
    /// Draw cases: arms that differ from their robot files by withheld effects
    Make(make::Args),
    /// Diagnose every case of a folder (robot.toml and logs in each), each in its own process
    Run(run::Args),
    /// Score verdicts against the answers
    Score(score::Args),
    /// Scores of this version on the sets that it was tested with, side by side
    Scores(scores::Args),
}

pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    match &args.command {
        Command::Make(args) => make::run(args),
        Command::Run(args) => run::run(args),
        Command::Score(args) => score::run(args),
        Command::Scores(args) => scores::run(args),
    }
}
