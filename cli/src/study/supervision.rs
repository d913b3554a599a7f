//! `rivet study supervision`: supervision schemes side by side on a staged workload.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

use anyhow::{Context, Result};
use rivet_studies::supervision::{Options, Outcome, study, table};

use crate::outputs::{Outputs, write_json};
use crate::table::show;

/// Arguments of `rivet study supervision`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Robot file; may be given several times.
    #[arg(
        long = "arm",
        value_name = "ROBOT.toml",
        default_values = ["robots/manutec-r3/robot.toml", "robots/staubli-tx40/robot.toml"]
    )]
    arms: Vec<PathBuf>,
    /// Number of seeds.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u64).range(1..=1000))]
    seeds: u64,
    /// Time between rows \[ms\]: 10 is the daemon's; with 1 the oracle decomposes at every tick.
    #[arg(long, value_name = "MS", default_value_t = 10, value_parser = clap::value_parser!(u16).range(1..=50))]
    row_ms: u16,
    /// Rounds of rotations of the tracked scheme between two decisions.
    #[arg(long, default_value_t = 10, value_parser = clap::value_parser!(u16).range(1..=64))]
    rounds: u16,
    /// Hysteresis of the tracked scheme.
    #[arg(long, default_value_t = 0.7, value_parser = |text: &str| crate::number::within(text, 0.0..=1.0))]
    hysteresis: f64,
    /// Rows for which the tracked scheme keeps a direction held.
    #[arg(long, default_value_t = 20)]
    dwell: u32,
    /// Decide by the plain diagonal, without deflation.
    #[arg(long)]
    no_deflation: bool,
    /// Factor on all durations.
    #[arg(long, default_value_t = 1.0, value_parser = |text: &str| crate::number::within(text, 0.01..=100.0))]
    length: f64,
    /// Write the figures as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write the tables as Markdown.
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,
}

/// Runs the study on each arm.
pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    let mut options =
        Options { seeds: args.seeds, length: args.length, row: usize::from(args.row_ms), ..Options::default() };
    options.tracked.rounds = usize::from(args.rounds);
    options.tracked.hysteresis = args.hysteresis;
    options.tracked.dwell = args.dwell;
    options.tracked.deflation = !args.no_deflation;
    let files = Outputs::given(args.arms.iter().map(PathBuf::as_path).collect()).file("--json", args.json.as_ref());
    files.file("--markdown", args.markdown.as_ref()).check()?;
    let start = Instant::now();
    let clock = || start.elapsed().as_secs_f64();
    let (mut all, mut tables) = (serde_json::Map::new(), String::new());
    for arm in &args.arms {
        let robot = rivet_config::load(arm)?;
        let outcomes = study(&robot, &options, Some(&clock));
        let text = format!("{}:\n\n{}", robot.config.name, table(&outcomes));
        show(&text)?;
        tables += if tables.is_empty() { "" } else { "\n" };
        tables += &text;
        all.insert(robot.config.name.clone(), outcomes.iter().map(json).collect());
    }
    if let Some(path) = &args.markdown {
        rivet_files::write_whole(path, tables).with_context(|| path.display().to_string())?;
    }
    write_json(args.json.as_ref(), &all)?;
    Ok(ExitCode::SUCCESS)
}

fn json(outcome: &Outcome) -> serde_json::Value {
    serde_json::json!({
        "scheme": outcome.name,
        "error_sigma": outcome.phases,
        "efficiency": outcome.efficiency,
        "same_decisions": outcome.agreement,
        "held_moved": outcome.held,
        "time_ratio": outcome.time,
        "ticks": outcome.ticks,
    })
}
