//! `rivet diagnose --table`: many robots and logs, a process each, into one table that can be continued.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use rivet_files::StatusLine;
use rivet_fleet::{GroupBy, Pair, Progress, Settings, states_json, states_text};
use rivet_realtime::Shutdown;

use crate::exit;
use crate::map::MapArgs;
use crate::outputs::Outputs;
use crate::table::show;

/// Most diagnoses at a time.
const MAX_JOBS: i64 = 1024;
/// Time between two drawings.
const REDRAW: Duration = Duration::from_millis(200);
/// A shorter run prints no lines where standard error is no terminal.
const SILENT: Duration = Duration::from_secs(2);
/// Where standard error is no terminal, one line for each such part of the pairs.
const PARTS: usize = 10;

/// Arguments of a table of diagnoses.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Table of diagnoses (docs/fleet.md)")]
pub(crate) struct FleetArgs {
    /// Robots of a fleet: a folder with FOLDER/robot.toml for each robot, at any depth, or with NAME.toml.
    #[arg(long, value_name = "DIR", requires_all = ["table", "patterns"], conflicts_with = "robot")]
    robots: Option<PathBuf>,
    /// Logs of the fleet: a pattern in quotes (`logs/**/*.parquet`), or paths. A log belongs to the robot that its path names.
    #[arg(long = "logs", value_name = "GLOB", num_args = 1.., requires = "robots")]
    patterns: Vec<String>,
    /// Write one row for each diagnosis into this Parquet table, and continue one that is there: only what is missing or changed is
    /// diagnosed.
    #[arg(long, value_name = "OUT.parquet", conflicts_with_all = ["live", "html", "export", "self_check", "verbose"])]
    pub(crate) table: Option<PathBuf>,
    /// Logs of one diagnosis.
    #[arg(long, value_name = "UNIT", value_enum, default_value_t, requires = "robots")]
    group: GroupBy,
    /// Diagnoses at a time; each takes its share of the processors [default: number of processors]
    #[arg(long, value_name = "N", requires = "table", value_parser = clap::value_parser!(i64).range(1..=MAX_JOBS))]
    jobs: Option<i64>,
    /// Diagnose failed pairs again; else only those that crashed or had a file that could not be read.
    #[arg(long, requires = "table")]
    retry_failed: bool,
    /// List the pairs of robot and logs with what would be done, and diagnose nothing.
    #[arg(long, requires = "table")]
    dry_run: bool,
    /// End when the process that started this one ends.
    #[arg(long, hide = true)]
    pub(crate) die_with_parent: bool,
}

/// Diagnoses a fleet, or one pair that is `given`, into a table.
///
/// Exit codes: 0 every pair has its diagnosis, 1 at least one failed.
///
/// # Errors
/// The pairs are ambiguous, the table cannot be continued or written, or the user ended the command.
pub(crate) fn run(
    args: &FleetArgs,
    table: &PathBuf,
    given: Option<(&Path, &[PathBuf])>,
    map: &MapArgs,
    json: Option<&PathBuf>,
) -> Result<ExitCode> {
    let pairs = match given {
        Some((robot, logs)) => vec![Pair::of_files(robot, logs)],
        None => pairs(args, table)?,
    };
    check_outputs(&pairs, table, json, args.dry_run)?;
    let settings = Settings {
        table,
        program: &std::env::current_exe().context("the path of this program")?,
        map: &map.entries,
        workers: args.jobs.and_then(|jobs| usize::try_from(jobs).ok()),
        retry_failed: args.retry_failed,
        kind_of_exit: exit::kind_of_code,
    };
    if args.dry_run {
        let states = rivet_fleet::list(pairs, &settings)?;
        write_json(json, || states_json(&states))?;
        show(&states_text(&states))?;
        return Ok(ExitCode::SUCCESS);
    }
    let shutdown = Shutdown::on_signals().context("signal handlers")?;
    let mut line = Line::new();
    let done = rivet_fleet::diagnose(pairs, &settings, &shutdown, |progress| line.show(progress));
    line.clear();
    let summary = done?;
    write_json(json, || summary.json())?;
    show(&summary.text())?;
    Ok(ExitCode::from(u8::from(summary.has_failures())))
}

fn pairs(args: &FleetArgs, table: &Path) -> Result<Vec<Pair>> {
    let folder = args.robots.as_deref().context("no folder of robots")?;
    let robots = rivet_fleet::robots(folder)?;
    let mut excluded: Vec<&Path> = robots.iter().map(|robot| robot.file.as_path()).collect();
    excluded.push(table);
    let logs = rivet_fleet::recordings(&args.patterns, &excluded)?;
    rivet_fleet::pairs(&robots, &logs, args.group)
}

/// That nothing that is read is overwritten; a list of pairs reads the table.
fn check_outputs(pairs: &[Pair], table: &PathBuf, json: Option<&PathBuf>, is_list: bool) -> Result<()> {
    let robots = pairs.iter().filter_map(|pair| pair.robot.as_ref().map(|robot| robot.file.as_path()));
    let mut inputs: Vec<&Path> = robots.collect();
    inputs.extend(pairs.iter().flat_map(|pair| pair.logs.iter().map(PathBuf::as_path)));
    if is_list {
        inputs.push(table);
    }
    let outputs = Outputs::given(inputs).file("--json", json);
    if is_list { outputs } else { outputs.file("--table", Some(table)) }.check()
}

fn write_json(path: Option<&PathBuf>, json: impl FnOnce() -> Result<String>) -> Result<()> {
    match path {
        Some(path) => rivet_files::write_whole(path, json()?).with_context(|| path.display().to_string()),
        None => Ok(()),
    }
}

/// The line on standard error: redrawn on a terminal, else printed ten times.
struct Line {
    status: StatusLine,
    begin: Instant,
    drawn: Option<Instant>,
    /// Tenths that were printed.
    parts: usize,
}

impl Line {
    fn new() -> Line {
        Line { status: StatusLine::new(true), begin: Instant::now(), drawn: None, parts: 0 }
    }

    fn show(&mut self, progress: &Progress) {
        if self.status.is_shown() {
            if self.drawn.is_none_or(|at| at.elapsed() >= REDRAW) {
                self.drawn = Some(Instant::now());
                self.status.draw(&progress.line());
            }
            return;
        }
        let parts = PARTS * progress.finished / progress.pairs.max(1);
        if parts > self.parts && self.begin.elapsed() >= SILENT {
            self.parts = parts;
            rivet_files::note(progress.line());
        }
    }

    /// Removes the line from a terminal.
    fn clear(&mut self) {
        self.status.remove();
    }
}
