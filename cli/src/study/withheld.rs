//! `rivet study withheld`: a known part of a measured arm's model is taken away; the diagnosis is asked what is missing.

use std::cell::RefCell;
use std::path::Path;
use std::process::ExitCode;

use anyhow::Result;
use rivet_config::Robot;
use rivet_logs::Log;
use rivet_studies::withheld::{self, Known};

use super::measured::{Args, Findings};
use rivet_analysis::progress::Progress;
use rivet_analysis::{identify, refine, runs};

/// Runs the study.
pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    args.check()?;
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
    let line = RefCell::new(Progress::new("diagnosing without parts", 1));
    let progress = |done: usize, of: usize| line.borrow_mut().set_of(done, of);
    let engine = withheld::Engine { read: &read, identify: &identify, runs: &runs, progress: &progress };
    let (arms, skipped, failed) = withheld::run(&args.root, &args.data, &engine);
    line.borrow_mut().done();
    let table = (!arms.is_empty()).then(|| withheld::markdown(&arms));
    args.tell(&Findings { table, json: withheld::to_json(&arms), skipped, failed })
}
