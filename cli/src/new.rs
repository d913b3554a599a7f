//! `rivet new`: a robot file from a URDF and logs, with what nobody knows marked.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result};
use rivet_analysis::fault::Fault;
use rivet_analysis::robot_file::{ensure_urdf, robot_file};
use serde_json::json;

use crate::check;
use crate::table::{paragraph, show, show_json};

/// Arguments of `rivet new`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// URDF of the arm.
    #[arg(value_name = "URDF")]
    urdf: PathBuf,
    /// Logs of it: sample rate, encoder step and largest torques are taken from them.
    #[arg(value_name = "LOG")]
    logs: Vec<PathBuf>,
    /// Robot file to write; `-` is standard output.
    #[arg(long, short, value_name = "FILE", default_value = "robot.toml")]
    output: PathBuf,
    /// Gravity in base axes \[m/s^2\], where the arm does not stand upright.
    #[arg(long, value_name = "X,Y,Z", value_delimiter = ',', num_args = 3, allow_negative_numbers = true, default_values_t = [0.0, 0.0, -9.81])]
    gravity: Vec<f64>,
    /// Write over a file that is there.
    #[arg(long)]
    force: bool,
    /// Print what is unknown as JSON (docs/operating.md).
    #[arg(long)]
    json: bool,
}

/// Writes the file, reads it back and reports what is unknown.
pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    let to_output = args.output.as_os_str() == "-";
    ensure_urdf(&args.urdf)?;
    if !to_output && args.output.exists() && !args.force {
        return Err(Fault::Usage(format!(
            "{} is there already: give another file with --output, or --force",
            args.output.display()
        ))
        .into());
    }
    if to_output && args.json {
        return Err(Fault::Usage("--json prints where --output - writes: give a file with --output".to_owned()).into());
    }
    let folder = if to_output { Path::new("") } else { args.output.parent().unwrap_or(Path::new("")) };
    let new = robot_file(&args.urdf, &args.logs, &args.gravity, folder)?;
    if to_output {
        show(&new.text)?;
        return Ok(ExitCode::SUCCESS);
    }
    // What is written has to load.
    let robot = rivet_config::parse(&args.output, &new.text)?;
    rivet_files::write_whole(&args.output, &new.text).with_context(|| args.output.display().to_string())?;
    if args.json {
        let file = args.output.display().to_string();
        let value = json!({"file": file, "unknown": new.unknown, "notes": robot.notes(), "warnings": robot.warnings()});
        show_json(&value)?;
        return Ok(ExitCode::SUCCESS);
    }
    show(&format!("written to {}\n", args.output.display()))?;
    if !new.unknown.is_empty() {
        let text = format!("{}. The file marks them; parameters among them have a wide prior", new.unknown.join("; "));
        show(&paragraph("unknown: ", &text))?;
    }
    show(&check::verdict(&robot))?;
    Ok(ExitCode::SUCCESS)
}
