//! `rivet study real`: measured arms, with the program's own identification and prediction.

use std::path::Path;
use std::process::ExitCode;

use anyhow::Result;
use rivet_config::Robot;
use rivet_logs::Log;
use rivet_studies::real;

use super::measured::{Args, Findings};
use rivet_analysis::open_keys::OpenKeys;
use rivet_analysis::{identify, predict, refine, runs};

/// Runs the study.
pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    args.check()?;
    let (outcomes, skipped, failed) = with_engine(|engine| real::run(&args.root, &args.data, engine));
    let table = (!outcomes.is_empty()).then(|| real::markdown(&outcomes));
    args.tell(&Findings { table, json: real::to_json(&outcomes), skipped, failed })
}

/// Hands the program's own identification and prediction to a study.
pub(super) fn with_engine<T>(study: impl FnOnce(&real::Engine<'_>) -> T) -> T {
    let text = |e: anyhow::Error| format!("{e:#}");
    let read = |robot: &Robot, path: &Path| runs::read_log(robot, path).map_err(text);
    let refine = |robot: &Robot, logs: &[Log]| {
        let open = OpenKeys::choose(robot, logs.iter().map(|log| Ok(log.clone()))).map_err(text)?;
        refine::refine(&open.robot, logs).map(|found| found.robot).map_err(text)
    };
    let fit = |robot: &Robot, logs: &[Log]| {
        let identify::LogFit { robot, values, consistent, exports_consistent, condition } =
            identify::fit_logs(robot, logs).map_err(text)?;
        Ok(real::Found { robot, values, consistent, exports_consistent, condition })
    };
    let along = |robot: &Robot, log: &Log| predict::along(robot, log).map_err(text);
    study(&real::Engine { read: &read, refine: &refine, identify: &fit, predict: &along })
}
