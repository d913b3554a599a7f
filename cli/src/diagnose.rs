//! `rivet diagnose`: where a simulator differs from the arm, which effect causes it, how far the gap shrinks.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, Result};
use rivet_analysis::diagnose::{Inputs, diagnose};
use rivet_diagnosis::Verdict;

use crate::control::bus_of;
use crate::fleet::{self, FleetArgs};
use crate::live;
use crate::map::MapArgs;
use crate::outputs::Outputs;
use crate::table::show_verdict;

/// Arguments of `rivet diagnose`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Robot file with the nominal model.
    #[arg(required_unless_present = "robots", value_name = "ROBOT.toml")]
    robot: Option<PathBuf>,
    /// Logs of the arm. With several logs the last is held out; a single log is cut at 60 %.
    #[arg(required_unless_present_any = ["live", "robots"], value_name = "LOG")]
    logs: Vec<PathBuf>,
    /// Record the arm on the bus for this time, as the last log [s].
    #[arg(long, value_name = "SECONDS")]
    live: Option<f64>,
    /// Store the recording of --live as a Parquet log.
    #[arg(long, value_name = "FILE", requires = "live")]
    keep: Option<PathBuf>,
    /// Override `[bus] prefix` for --live.
    #[arg(long, requires = "live")]
    prefix: Option<String>,
    /// Override `[bus] root` for --live.
    #[arg(long, requires = "live")]
    root: Option<PathBuf>,
    /// Write the verdict as JSON; with --table, a summary.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write the verdict as an HTML page without external parts.
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
    /// Write model.toml (robot file with the values and effects found), robot.urdf, robot.xml (MJCF) and not-expressible.md
    /// (what each format lacks, in N m) into this folder. For each confounded cause, also write separating-N.csv:
    /// setpoints for `rivet sim --setpoints` or a robot. They know no obstacles.
    #[arg(long, value_name = "DIR")]
    export: Option<PathBuf>,
    /// Add effects of graded strength to the logs and report which are found (at most the first minute).
    #[arg(long)]
    self_check: bool,
    /// Also print the gap, its place, and tables of causes, parameters and joints.
    #[arg(long)]
    details: bool,
    /// Report the candidates that are considered.
    #[arg(long, short)]
    verbose: bool,
    #[command(flatten)]
    map: MapArgs,
    #[command(flatten)]
    fleet: FleetArgs,
}

/// Exit codes: 0 no gap, 1 a cause named, 2 unexplained, 3 not evaluated; with --table those of [`fleet::run`].
pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    if args.fleet.die_with_parent {
        rivet_realtime::die_with_parent().context("ending with the parent process")?;
    }
    let robot_file = args.robot.as_deref();
    if let Some(table) = &args.fleet.table {
        let given = robot_file.map(|robot| (robot, args.logs.as_slice()));
        return fleet::run(&args.fleet, table, given, &args.map, args.json.as_ref());
    }
    // The command line requires it.
    let robot_file = robot_file.context("no robot file")?;
    let robot = args.map.load(robot_file)?;
    let outputs = Outputs::for_logs(&robot, robot_file, &args.logs).file("--keep", args.keep.as_ref());
    outputs
        .file("--json", args.json.as_ref())
        .file("--html", args.html.as_ref())
        .export(args.export.as_ref())
        .check()?;
    let folder = tempfile::tempdir().context("a folder for the window")?;
    let mut logs = args.logs.clone();
    if let Some(seconds) = args.live {
        let path = args.keep.clone().unwrap_or_else(|| folder.path().join("live.parquet"));
        live::record(&robot, &bus_of(&robot.config.bus, args.prefix.as_deref(), args.root.as_deref()), seconds, &path)?;
        logs.push(path);
    }
    let program = std::env::current_exe().context("the path of this program")?;
    let inputs = Inputs {
        robot_file,
        logs: &logs,
        is_last_live: args.live.is_some(),
        program: &program,
        is_verbose: args.verbose,
    };
    let mut found = diagnose(&robot, &inputs)?;
    // The verdict is shown whatever becomes of these two.
    let exported = args.export.as_ref().map_or(Ok(false), |folder| found.export(folder));
    let checked = if args.self_check { found.self_check() } else { Ok(()) };
    if let Some(path) = &args.json {
        rivet_files::write_whole(path, found.json()?).with_context(|| path.display().to_string())?;
    }
    if let Some(path) = &args.html {
        rivet_files::write_whole(path, found.html()?).with_context(|| path.display().to_string())?;
    }
    show_verdict(&found.text(args.details)?)?;
    exported?;
    checked?;
    Ok(ExitCode::from(match found.verdict() {
        Verdict::NoGap => 0,
        Verdict::Parameter | Verdict::Effect | Verdict::Several => 1,
        Verdict::Unexplained => 2,
        Verdict::NotEvaluated => 3,
    }))
}
