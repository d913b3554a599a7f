//! `rivet study recordings`: recordings of drawn formats and meanings, read as every command reads them.

use std::path::Path;
use std::process::ExitCode;

use anyhow::{Context, Result};
use rivet_analysis::inspect;
use rivet_analysis::progress::Progress;
use rivet_config::Robot;
use rivet_studies::recordings::{self, Found};

use super::measured::{self, Findings};
use super::real::with_engine;
use crate::table::show;

/// Arguments of `rivet study recordings`.
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    measured: measured::Args,
    /// Number of recordings
    #[arg(long, value_name = "N", default_value_t = 200, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    drawn: u32,
    /// Seed of the first recording; the next ones count on
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// Runs the study.
pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    let Args { measured, drawn, seed } = args;
    measured.check_without_data()?;
    let folder = tempfile::tempdir().context("a folder for recordings")?;
    let judge = |robot: &Robot, path: &Path| match inspect::meaning(robot, path) {
        Ok(found) => Ok(found.map(|(name, joints, probability)| Found { name: name.to_owned(), joints, probability })),
        Err(why) => Err(format!("{why:#}")),
    };
    let mut progress = Progress::new("reading drawn recordings", *drawn as usize);
    let (outcomes, failed) = with_engine(|engine| {
        let places = [&measured.root, &measured.data, folder.path()];
        recordings::run(places, *drawn as usize, *seed, engine, &judge, &mut |done| progress.set(done))
    });
    progress.done();
    let table = (!outcomes.is_empty()).then(|| recordings::markdown(&outcomes));
    let code = measured.tell(&Findings { table, json: recordings::to_json(&outcomes), skipped: Vec::new(), failed })?;
    show(&recordings::others(&outcomes))?;
    Ok(code)
}
