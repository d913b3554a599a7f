//! `rivet study`: computes a table anew from seeds and prints it.

mod friction;
mod measured;
mod real;
mod supervision;
mod withheld;

use crate::table::show;
use anyhow::{Context, Result};
use rivet_studies::tracking::{ARMS, Tracking, tracking};
use std::path::PathBuf;
use std::process::ExitCode;

/// Which study.
#[derive(clap::Subcommand)]
pub(crate) enum Args {
    /// Tracking error with wrong, live and true parameters, with an unknown payload and after it is let go of
    Tracking(TrackingArgs),
    /// Supervision schemes side by side on a staged workload
    Supervision(supervision::Args),
    /// Measured arms: trained on one motion, judged on another, beside plain least squares
    Real(measured::Args),
    /// Laws of friction, judged by motion that they were not fitted to
    Friction(friction::Args),
    /// Measured arms from whose identified model one known part is taken away: does the diagnosis name it?
    Withheld(measured::Args),
}

/// Without a robot file the arms of the table, from `robots/`.
#[derive(clap::Args)]
pub(crate) struct TrackingArgs {
    /// A robot file of your own, instead of the arms of the table
    #[arg(requires = "payload")]
    robot: Option<PathBuf>,
    /// What that arm carries unknown to its robot file (kg)
    #[arg(long, value_name = "KG", value_parser = |text: &str| crate::number::within(text, 0.0..=10_000.0))]
    payload: Option<f64>,
    /// Folder of the table's arms
    #[arg(long, value_name = "DIR", default_value = "robots")]
    robots: PathBuf,
    /// Decides the motion, the noise and which bodies are too heavy
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// So many seeds one after the other, and a line for each at the end
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=1000))]
    seeds: u64,
}

pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    match args {
        Args::Tracking(args) => run_tracking(args),
        Args::Supervision(args) => supervision::run(args),
        Args::Real(args) => real::run(args),
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
    let mut kept = true;
    let mut lines = String::new();
    for (file, payload) in arms {
        let robot = rivet_config::load(&file)?;
        for seed in (args.seed..).take(args.seeds as usize) {
            let table = tracking(&robot, payload, seed).context("the estimator refuses the settings")?;
            show(&table.to_string())?;
            kept &= table.keeps_bounds();
            lines += &line(&table, seed);
        }
    }
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
