//! `rivet study`: computes a table anew from seeds and prints it.

mod supervision;

use crate::study_real;
use crate::table::show;
use anyhow::{Context, Result};
use rivet_studies::tracking::{ARMS, tracking};
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
    Real(study_real::Args),
}

/// Without a robot file the arms of the table, from `robots/`.
#[derive(clap::Args)]
pub(crate) struct TrackingArgs {
    /// A robot file of your own, instead of the arms of the table
    #[arg(requires = "payload")]
    robot: Option<PathBuf>,
    /// What that arm carries unknown to its robot file (kg)
    #[arg(long, value_name = "KG")]
    payload: Option<f64>,
    /// Folder of the table's arms
    #[arg(long, value_name = "DIR", default_value = "robots")]
    robots: PathBuf,
    /// Decides the motion, the noise and which bodies are too heavy
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    match args {
        Args::Tracking(args) => run_tracking(args),
        Args::Supervision(args) => supervision::run(args),
        Args::Real(args) => study_real::run(args),
    }
}

/// Success if every figure keeps its bound: a quarter of the error with nominal parameters, 1.15 of that with true ones.
fn run_tracking(args: &TrackingArgs) -> Result<ExitCode> {
    let arms: Vec<(PathBuf, f64)> = match (&args.robot, args.payload) {
        (Some(robot), Some(payload)) => vec![(robot.clone(), payload)],
        _ => ARMS.iter().map(|(arm, payload)| (args.robots.join(arm).join("robot.toml"), *payload)).collect(),
    };
    let mut kept = true;
    for (file, payload) in arms {
        let robot = rivet_config::load(&file)?;
        let table = tracking(&robot, payload, args.seed).context("the estimator refuses the settings")?;
        show(&table.to_string())?;
        let within = |(nominal, truth): (f64, f64)| nominal <= 0.25 && truth <= 1.15;
        kept &= table.phases.iter().all(|errors| within(errors.ratios()));
    }
    show(if kept { "every figure keeps its bound\n" } else { "A FIGURE IS BEYOND ITS BOUND\n" })?;
    Ok(if kept { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
