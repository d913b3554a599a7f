//! `rivet study strangers`: measured arms with robot files as a new user writes them.

use std::process::ExitCode;

use anyhow::Result;
use rivet_studies::strangers;

use super::measured::{self, Findings};
use super::real::with_engine;

/// Arguments of `rivet study strangers`.
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    measured: measured::Args,
    /// Only splits whose name contains this text
    #[arg(long, value_name = "TEXT", default_value = "")]
    only: String,
}

/// Runs the study.
pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    let Args { measured, only } = args;
    measured.check()?;
    let (outcomes, skipped, failed) =
        with_engine(|engine| strangers::run(&measured.root, &measured.data, only, engine));
    let table = (!outcomes.is_empty()).then(|| strangers::markdown(&outcomes));
    measured.tell(&Findings { table, json: strangers::to_json(&outcomes), skipped, failed })
}
