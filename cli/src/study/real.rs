//! `rivet study real`: measured arms, with the program's own identification and prediction.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, bail};
use rivet_config::Robot;
use rivet_logs::Log;
use rivet_studies::real;

use crate::table::show;
use crate::{identify, predict, refine, runs};

/// Arguments of `rivet study real`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Folder with one folder a data set.
    #[arg(long, value_name = "DIR", default_value = "../shared/data/real")]
    data: PathBuf,
    /// The checkout, whose robots/ and tests/robots/ are used.
    #[arg(long, value_name = "DIR", default_value = ".")]
    root: PathBuf,
    /// Also write the figures as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Also write the table as Markdown.
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,
}

/// Runs the study.
pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    let text = |e: anyhow::Error| format!("{e:#}");
    let read = |robot: &Robot, path: &Path| runs::read_log(robot, path).map_err(text);
    let refine = |robot: &Robot, logs: &[Log]| refine::refine(robot, logs).map(|found| found.robot).map_err(text);
    let fit = |robot: &Robot, logs: &[Log]| identify::found(robot, logs).map_err(text);
    let along = |robot: &Robot, log: &Log| predict::along(robot, log).map_err(text);
    let engine = real::Engine { read: &read, refine: &refine, identify: &fit, predict: &along };
    let (outcomes, skipped, failed) = real::run(&args.root, &args.data, &engine);
    if outcomes.is_empty() && failed.is_empty() {
        bail!("{}: none of the data sets is there", args.data.display());
    }
    let table = real::markdown(&outcomes);
    show(&table)?;
    for name in skipped {
        show(&format!("skipped, no data: {name}\n"))?;
    }
    if let Some(path) = &args.markdown {
        runs::write_whole(path, &table).with_context(|| path.display().to_string())?;
    }
    if let Some(path) = &args.json {
        let text = format!("{:#}\n", real::to_json(&outcomes));
        runs::write_whole(path, &text).with_context(|| path.display().to_string())?;
    }
    if !failed.is_empty() {
        bail!("{}", failed.join("\n"));
    }
    Ok(ExitCode::SUCCESS)
}
