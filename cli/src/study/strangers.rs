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
    /// Instead of measured arms so many drawn ones: simulated logs of arms that differ from their files
    #[arg(long, value_name = "N", conflicts_with = "only", value_parser = clap::value_parser!(u32).range(1..=1000))]
    drawn: Option<u32>,
    /// Seed of the first drawn arm; the next ones count on
    #[arg(long, default_value_t = 901, requires = "drawn")]
    seed: u64,
}

/// Runs the study.
pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    let Args { measured, only, drawn, seed } = args;
    if drawn.is_some() {
        measured.check_without_data()?;
    } else {
        measured.check()?;
    }
    let (outcomes, skipped, failed) = with_engine(|engine| match drawn {
        Some(count) => {
            let (outcomes, failed) = strangers::drawn::run(&measured.root, *count as usize, *seed, engine);
            (outcomes, Vec::new(), failed)
        }
        None => strangers::run(&measured.root, &measured.data, only, engine),
    });
    let table = (!outcomes.is_empty()).then(|| strangers::markdown(&outcomes));
    measured.tell(&Findings { table, json: strangers::to_json(&outcomes), skipped, failed })
}
