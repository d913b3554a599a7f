//! `rivet blind`: diagnoses of cases whose answers are withheld, and how good they were.

mod make;
mod run;
mod score;

use std::process::ExitCode;

use anyhow::{Context, Result};
use rivet_report::Score;

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
}

pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    match &args.command {
        Command::Make(args) => make::run(args),
        Command::Run(args) => run::run(args),
        Command::Score(args) => score::run(args),
    }
}

/// Scores of this version on the cases with answers, as `rivet blind score --json` wrote them (`docs/validation.md`).
pub(crate) fn scores() -> Result<Vec<Score>> {
    serde_json::from_str(include_str!("scores.json")).context("the scores that are part of this program")
}
