//! `rivet inspect`: what a recording holds, and how it would be read.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;
use rivet_analysis::inspect::inspect;

use crate::map::MapArgs;
use crate::table::{show, show_json};

/// Exit codes: usable with a doubt, and not usable as it is.
const DOUBT: u8 = 1;
const UNUSABLE: u8 = 2;

/// Arguments of `rivet inspect`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Recording: MCAP, rosbag2 folder, LeRobot folder, Parquet, HDF5, NPZ or a text table.
    recording: PathBuf,
    /// URDF or robot file of the arm: joints are matched by name, and the readings of the log are compared.
    #[arg(value_name = "URDF|ROBOT.toml")]
    robot: Option<PathBuf>,
    /// Print as JSON.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    map: MapArgs,
}

/// Exit codes: 0 usable as it is, 1 usable with a doubt, 2 not usable as it is.
pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    let inspection = inspect(&args.recording, args.robot.as_deref(), &args.map.entries)?;
    if args.json {
        show_json(&inspection.to_json())?;
    } else {
        show(&inspection.text())?;
    }
    Ok(match (inspection.refusal(), inspection.is_doubtful()) {
        (Some(_), _) => ExitCode::from(UNUSABLE),
        (None, true) => ExitCode::from(DOUBT),
        (None, false) => ExitCode::SUCCESS,
    })
}
