//! `rivet identify`: base parameters of a robot from whole logs.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;
use rivet_analysis::fault::Fault;
use rivet_analysis::identify::{Options, identify, identify_each};
use serde_json::Value;

use crate::map::MapArgs;
use crate::outputs::{Outputs, write_json};
use crate::table::show;

/// Arguments of `rivet identify`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Robot file: kinematics, nominal parameters, [signal] and [estimator].
    #[arg(value_name = "ROBOT.toml")]
    robot: PathBuf,
    /// Logs with positions and torque or current (docs/logs.md). Filters start anew in each.
    #[arg(required = true, value_name = "LOG")]
    logs: Vec<PathBuf>,
    /// Held-out log, on which the result is evaluated; may be given several times.
    #[arg(long, value_name = "LOG", conflicts_with_all = ["online", "compare"])]
    hold_out: Vec<PathBuf>,
    /// Also write the result as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write model.toml (robot file with the identified parameters), robot.urdf (physically consistent bodies) and
    /// not-expressible.md into this folder.
    #[arg(long, value_name = "DIR")]
    export: Option<PathBuf>,
    /// Run one log through the daemon's estimator, sample by sample, as `rivet replay` does.
    #[arg(long, conflicts_with = "export")]
    online: bool,
    /// First choose instruments or least squares and the friction law by cross-validation on parts of the logs.
    #[arg(long, conflicts_with_all = ["online", "compare"])]
    refine: bool,
    /// Fit every log separately and report whether they agree within their standard deviations.
    #[arg(long, conflicts_with_all = ["export", "online"])]
    compare: bool,
    /// With --online: write every published parameter set (CSV).
    #[arg(long, value_name = "FILE", requires = "online")]
    stream: Option<PathBuf>,
    #[command(flatten)]
    map: MapArgs,
}

/// Identifies, prints, exports.
pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    let robot = args.map.load(&args.robot)?;
    let outputs = Outputs::for_logs(&robot, &args.robot, args.logs.iter().chain(&args.hold_out));
    let outputs = outputs.file("--json", args.json.as_ref()).file("--stream", args.stream.as_ref());
    outputs.export(args.export.as_ref()).check()?;
    if args.online {
        let [log] = args.logs.as_slice() else {
            return Err(Fault::Usage(format!("--online takes one log; {} are given", args.logs.len())).into());
        };
        return crate::online::run(&robot, log, args.stream.as_deref(), args.json.as_deref());
    }
    if args.compare {
        let comparison = identify_each(&robot, &args.logs)?;
        show(&comparison.text()?)?;
        write_result(args, &comparison.to_json())?;
        return Ok(ExitCode::SUCCESS);
    }
    let options = Options { held_out: args.hold_out.clone(), refine: args.refine };
    let result = identify(&robot, &args.logs, &options)?;
    show(&result.text())?;
    write_result(args, &result.to_json())?;
    if let Some(folder) = &args.export {
        result.export(folder)?;
        show(&format!("model written to {}\n", folder.join("model.toml").display()))?;
    }
    Ok(ExitCode::SUCCESS)
}

fn write_result(args: &Args, result: &Value) -> Result<()> {
    write_json(args.json.as_ref(), result)?;
    let written = args.json.as_ref().map(|path| format!("result written to {}\n", path.display()));
    Ok(show(&written.unwrap_or_default())?)
}
