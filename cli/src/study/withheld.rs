//! `rivet study withheld`: a known part of a measured arm's model is taken away; the diagnosis is asked what is missing.

use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, bail};
use rivet_config::Robot;
use rivet_logs::Log;
use rivet_studies::withheld::{self, Known};

use crate::progress::Progress;
use crate::table::show;
use crate::{identify, refine, runs};

/// Arguments of `rivet study withheld`.
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
    let identify = |robot: &Robot, logs: &[Log]| {
        let chosen = refine::refine(robot, logs).map_err(text)?.robot;
        let standard = identify::consistent(&chosen, logs).map_err(text)?;
        Ok(Known { model: (*chosen.model).clone(), standard })
    };
    let runs = |_: &Robot, log: &Log| {
        let pieces = runs::pieces(log, log.median_step_s()).map_err(text)?;
        runs::runs(&log.path, &pieces).map_err(text)
    };
    let line = RefCell::new(Progress::new("parts taken away", 100));
    let progress = |done: usize, of: usize| line.borrow_mut().set(100 * done / of.max(1));
    let engine = withheld::Engine { read: &read, identify: &identify, runs: &runs, progress: &progress };
    let (arms, skipped, failed) = withheld::run(&args.root, &args.data, &engine);
    line.borrow_mut().done();
    if arms.is_empty() && failed.is_empty() {
        bail!("{}: none of the data sets is there", args.data.display());
    }
    let table = withheld::markdown(&arms);
    show(&table)?;
    for name in skipped {
        show(&format!("skipped, no data: {name}\n"))?;
    }
    if let Some(path) = &args.markdown {
        runs::write_whole(path, &table).with_context(|| path.display().to_string())?;
    }
    if let Some(path) = &args.json {
        let text = format!("{:#}\n", withheld::to_json(&arms));
        runs::write_whole(path, &text).with_context(|| path.display().to_string())?;
    }
    if !failed.is_empty() {
        bail!("{}", failed.join("\n"));
    }
    Ok(ExitCode::SUCCESS)
}
