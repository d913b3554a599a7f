//! `rivet check`: is this configuration sound, and what does it resolve to.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;
use rivet_analysis::robot_json::to_json;
use rivet_config::Robot;

use crate::table::{paragraph, show, show_json};

/// Arguments of `rivet check`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Robot file.
    #[arg(value_name = "ROBOT.toml")]
    robot: PathBuf,
    /// Print every key with its unit and line, and the base parameters
    #[arg(long)]
    all: bool,
    /// Print as JSON (docs/operating.md).
    #[arg(long)]
    json: bool,
}

/// Prints the robot with doubts, or every mistake.
pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    let robot = rivet_config::load(&args.robot)?;
    if args.json {
        show_json(&to_json(&robot))?;
        return Ok(ExitCode::SUCCESS);
    }
    show(&if args.all { robot.describe() } else { robot.summary() })?;
    show(&verdict(&robot))?;
    Ok(ExitCode::SUCCESS)
}

/// Notes, warnings, and one sentence.
pub(crate) fn verdict(robot: &Robot) -> String {
    let warnings = robot.warnings();
    let mut out = String::from("\n");
    for note in robot.notes() {
        out += &paragraph("note: ", &note);
    }
    for warning in &warnings {
        out += &paragraph("warning: ", warning);
    }
    let verdict = match warnings.len() {
        0 => "is sound".to_owned(),
        1 => "can be used, with 1 warning".to_owned(),
        n => format!("can be used, with {n} warnings"),
    };
    out + &format!("{} {verdict}.\n", robot.config.name)
}
