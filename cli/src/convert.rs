//! `rivet convert`: a recording in another format.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;
use rivet_analysis::convert::{Conversion, convert};
use serde_json::json;

use crate::map::MapArgs;
use crate::table::{paragraph, show, show_json};

/// Names that are listed of columns that are left out.
const MOST_LISTED: usize = 8;

/// Arguments of `rivet convert`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Recording: MCAP, rosbag2 folder, LeRobot folder, Parquet, HDF5, NPZ or a text table.
    recording: PathBuf,
    /// File to write: .parquet, .csv, .npz, .h5 or .mcap (ROS 2 joint states).
    out: PathBuf,
    /// URDF or robot file of the arm: joints are matched by name.
    #[arg(value_name = "URDF|ROBOT.toml")]
    robot: Option<PathBuf>,
    /// Replace OUT where it is there.
    #[arg(long)]
    force: bool,
    /// Print the result as JSON.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    map: MapArgs,
}

pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    let done = convert(&args.recording, &args.out, args.robot.as_deref(), &args.map.entries, args.force)?;
    if args.json {
        let value = json!({"recording": args.recording.display().to_string(), "format": done.from,
                           "file": args.out.display().to_string(), "rows": done.rows, "joints": done.joints,
                           "columns": done.columns, "notes": done.notes, "unused": done.unused,
                           "left_out": done.left_out});
        show_json(&value)?;
    } else {
        show(&report(args, &done))?;
    }
    Ok(ExitCode::SUCCESS)
}

fn report(args: &Args, done: &Conversion) -> String {
    let joints = done.joints.len();
    let mut out = format!("{}: {} rows of {joints} joints, from {}\n", args.out.display(), done.rows, done.from);
    let mut line = |label: &str, text: &str| out += &paragraph(&format!("{label:<10} "), text);
    line("columns", &done.columns.join(" "));
    for note in &done.notes {
        line("note", note);
    }
    if !done.left_out.is_empty() {
        line("left out", &format!("{}: this format has no place for them", done.left_out.join(", ")));
    }
    if !done.unused.is_empty() {
        let more = done.unused.len().saturating_sub(MOST_LISTED);
        let more = if more > 0 { format!(" and {more} more") } else { String::new() };
        let names = &done.unused[..done.unused.len().min(MOST_LISTED)];
        line("not used", &format!("{}{more}", names.join(", ")));
    }
    out
}
