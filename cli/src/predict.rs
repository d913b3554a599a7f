//! `rivet predict`: the torque a model expects along a log, on the log's own rows.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;
use rivet_analysis::predict::predict;

use crate::map::MapArgs;
use crate::outputs::{Outputs, write_json};
use crate::table::show;

/// Arguments of `rivet predict`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Robot file; its identified parameters are used, else the nominal ones.
    #[arg(value_name = "MODEL.toml")]
    model: PathBuf,
    /// Log with positions (docs/logs.md); torque is needed only to print errors.
    log: PathBuf,
    /// File for the columns t and tau_pred1..N, one row per row of the log: Parquet or CSV, by its ending.
    #[arg(long, value_name = "PRED.parquet|csv")]
    out: PathBuf,
    /// Also write the errors as JSON (docs/operating.md).
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    #[command(flatten)]
    map: MapArgs,
}

/// Predicts and writes; prints errors when the log has torque.
pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    let robot = args.map.load(&args.model)?;
    let outputs = Outputs::for_logs(&robot, &args.model, [&args.log]).file("--out", Some(&args.out));
    outputs.file("--json", args.json.as_ref()).check()?;
    rivet_logs::check_table_ending(&args.out)?;
    let prediction = predict(&robot, &args.log)?;
    prediction.write(&args.out)?;
    write_json(args.json.as_ref(), &prediction.to_json())?;
    show(&prediction.text())?;
    show(&format!("{} rows written to {}\n", prediction.t.len(), args.out.display()))?;
    Ok(ExitCode::SUCCESS)
}
