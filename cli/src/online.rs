//! `rivet identify --online`: the daemon's core over a log, without processes: bit for bit what `rivet replay` gives.

use crate::stream::{Recording, write_stream};
use crate::summary::{Summary, nothing};
use crate::table::show;
use anyhow::{Context, Result};
use rivet_config::Robot;
use rivet_daemon::Core;
use rivet_ipc_schema::{Health, Parameters};
use std::path::Path;
use std::process::ExitCode;

/// Ticks through the log and shows what the last parameter set says.
pub(crate) fn run(robot: &Robot, log: &Path, stream_file: Option<&Path>, json: Option<&Path>) -> Result<ExitCode> {
    let recording = Recording::read(robot, log)?;
    rivet_files::note(&recording.report);
    let mut core = Core::new(robot).context("the estimator refuses the settings")?;
    let mut stream: Vec<Parameters> = Vec::new();
    let mut progress = rivet_analysis::progress::Progress::new("identifying samples", recording.len());
    for k in 0..recording.len() {
        let period = recording.period(k);
        if core.tick_with_link(&period.state, period.setpoint.as_ref(), period.link.as_ref()).publish {
            let mut parameters = Parameters::default();
            core.write_parameters(&mut parameters);
            stream.push(parameters);
        }
        progress.set(k + 1);
    }
    progress.done();
    let mut health = Health::default();
    core.write_health(&mut health);
    if let Some(path) = stream_file {
        write_stream(path, robot, &stream)?;
    }
    let Some(last) = stream.last() else { return Err(nothing(robot, &recording, &health).into()) };
    let summary = Summary::new(robot, &recording, last, &health);
    show(&format!("{summary}\n"))?;
    if let Some(path) = json {
        rivet_files::write_whole(path, summary.json().to_string())
            .with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(ExitCode::SUCCESS)
}
