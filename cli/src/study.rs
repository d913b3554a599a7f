//! `rivet study`: computes a table anew from seeds and prints it.

mod friction;
mod measured;
mod real;
mod recordings;
mod strangers;
mod supervision;
mod withheld;

use crate::outputs::{Outputs, write_json};
use crate::table::show;
use anyhow::{Context, Result};
use rivet_studies::tracking::{ARMS, Tracking, tracking};
use serde_json::{Value, json};
use std::path::PathBuf;
use std::process::ExitCode;

/// Which study.
#[derive(clap::Subcommand)]
pub(crate) enum Args {
    /// Tracking error with wrong, live and true parameters, with an unknown payload and after its release
    Tracking(TrackingArgs),
    /// Compare supervision schemes on a staged workload
    Supervision(supervision::Args),
    /// Measured arms: held-out prediction, compared with plain least squares
    Real(measured::Args),
    /// Measured arms with robot files as a new user writes them, compared with plain least squares
    Strangers(strangers::Args),
    /// Recordings of drawn formats and meanings: is the meaning of their channels found?
    Recordings(recordings::Args),
    /// Friction laws, compared on held-out logs
    Friction(friction::Args),
    /// Measured arms: does the diagnosis name a part that was removed from the model?
    Withheld(measured::Args),
}

/// Without a robot file the arms of the table, from `robots/`.
#[derive(clap::Args)]
pub(crate) struct TrackingArgs {
    /// Robot file [default: the arms of the table]
    #[arg(requires = "payload")]
    robot: Option<PathBuf>,
    /// Payload of that arm that its robot file does not contain (kg)
    #[arg(long, value_name = "KG", value_parser = |text: &str| crate::number::within(text, 0.0..=10_000.0))]
    payload: Option<f64>,
    /// Folder of the table's arms
    #[arg(long, value_name = "DIR", default_value = "robots")]
    robots: PathBuf,
    /// Seed of motion, noise and body errors
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Number of seeds, with one line each at the end
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=1000))]
    seeds: u64,
    /// Also write the figures as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    match args {
        Args::Tracking(args) => run_tracking(args),
        Args::Supervision(args) => supervision::run(args),
        Args::Real(args) => real::run(args),
        Args::Strangers(args) => strangers::run(args),
        Args::Recordings(args) => recordings::run(args),
        Args::Friction(args) => friction::run(args),
        Args::Withheld(args) => withheld::run(args),
    }
}

/// Success if every figure keeps its bound: a quarter of the error with nominal parameters, 1.15 of that with true ones, and
/// never 1.25 of the way off the plan that nominal ones lead.
fn run_tracking(args: &TrackingArgs) -> Result<ExitCode> {
    let arms: Vec<(PathBuf, f64)> = match (&args.robot, args.payload) {
        (Some(robot), Some(payload)) => vec![(robot.clone(), payload)],
        _ => ARMS.iter().map(|(arm, payload)| (args.robots.join(arm).join("robot.toml"), *payload)).collect(),
    };
    Outputs::given(arms.iter().map(|(file, _)| file.as_path()).collect()).file("--json", args.json.as_ref()).check()?;
    let mut kept = true;
    let mut lines = String::new();
    let mut all: Vec<Value> = Vec::new();
    for (file, payload) in &arms {
        let robot = rivet_config::load(file)?;
        for seed in (args.seed..).take(args.seeds as usize) {
            let table = tracking(&robot, *payload, seed).context("the estimator refuses the settings")?;
            show(&table.to_string())?;
            kept &= table.keeps_bounds();
            lines += &line(&table, seed);
            all.push(json!({ "seed": seed, "table": table.to_json() }));
        }
    }
    write_json(args.json.as_ref(), &all)?;
    if args.seeds > 1 {
        show("arm             seed   live/nominal     live/true    furthest    first live  changes seen\n")?;
        show(&lines)?;
    }
    show(if kept { "every figure keeps its bound\n" } else { "A FIGURE IS BEYOND ITS BOUND\n" })?;
    Ok(if kept { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// One table in one line: both phases.
fn line(table: &Tracking, seed: u64) -> String {
    let [loaded, empty] = [table.phases[0].ratios(), table.phases[1].ratios()];
    let adopted = table.adopted_s.map_or("never".to_owned(), |s| format!("{s:.1} s"));
    let verdict = if table.keeps_bounds() { "" } else { "   BEYOND" };
    format!(
        "{:<15} {seed:>4}   {:.3}  {:.3}   {:.3}  {:.3}   {:>8.3}   {adopted:>9}  {:>12}{verdict}\n",
        table.robot,
        loaded.0,
        empty.0,
        loaded.1,
        empty.1,
        table.farther(),
        table.changes
    )
}
