//! `rivet control`: asks a running rivetd or rivet-controller for something.

use anyhow::{Context as _, Result, bail};
use clap::ValueEnum as _;
use clap::builder::{PathBufValueParser, TypedValueParser as _};
use rivet_ipc_schema::{Bus, BusConfig, ControlCommand, ControlStatus, RobotName};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use crate::table::show_json;

/// Which bus, where that is not the one of the robot file.
#[derive(clap::Args)]
pub(crate) struct OnBus {
    /// The robot file.
    #[arg(value_name = "ROBOT.toml", value_parser = PathBufValueParser::new().try_map(no_command))]
    pub(crate) robot: PathBuf,
    /// Override `[bus] prefix`.
    #[arg(long)]
    pub(crate) prefix: Option<String>,
    /// Override `[bus] root`.
    #[arg(long)]
    pub(crate) root: Option<PathBuf>,
}

/// That a robot file stands before a command.
fn no_command(path: PathBuf) -> Result<PathBuf, String> {
    let is_command = path.to_str().is_some_and(|text| Word::from_str(text, false).is_ok());
    if is_command && !path.exists() {
        return Err("this is a command; the robot file comes first: ROBOT.toml COMMAND".to_owned());
    }
    Ok(path)
}

impl OnBus {
    /// The robot file's `bus`, unless told otherwise.
    pub(crate) fn config(&self, bus: &rivet_config::Bus) -> BusConfig {
        bus_of(bus, self.prefix.as_deref(), self.root.as_deref())
    }
}

/// The robot file's `bus`, unless told otherwise.
pub(crate) fn bus_of(bus: &rivet_config::Bus, prefix: Option<&str>, root: Option<&Path>) -> BusConfig {
    BusConfig {
        prefix: prefix.map_or_else(|| bus.prefix.clone(), str::to_owned),
        root: root.map_or_else(|| bus.root.clone(), Path::to_owned),
    }
}

/// Asks a running rivetd or rivet-controller for something.
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    bus: OnBus,
    /// Command.
    #[arg(value_enum)]
    command: Word,
    /// Print the answer as JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum Word {
    /// Stop the adaptation
    Freeze,
    /// Continue the adaptation
    Resume,
    /// Restart from the robot file's parameters with an empty window; discard the stored state
    Reset,
    /// Write the parameters to the store now
    Save,
    /// Read the robot file again; filters, window and thresholds change between two samples
    Reload,
    /// rivet-controller: follow the plan again after a stop, once it is within reach
    Follow,
}

/// The daemon answers within milliseconds; a reload takes as long as reading the file and building the model.
const PATIENCE: Duration = Duration::from_secs(10);

pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    let (name, at) = rivet_config::address(&args.bus.robot)?;
    let name = RobotName::new(&name)?;
    let bus = Bus::open(&args.bus.config(&at), &name, "rivet-control")?;
    let command = match args.command {
        Word::Freeze => ControlCommand::Freeze,
        Word::Resume => ControlCommand::Resume,
        Word::Reset => ControlCommand::Reset,
        Word::Save => ControlCommand::Save,
        Word::Reload => ControlCommand::Reload,
        Word::Follow => ControlCommand::Follow,
    };
    let (client, program) = match args.command {
        Word::Follow => (bus.controller_control_client()?, "rivet-controller"),
        _ => (bus.control_client()?, "rivetd"),
    };
    let reply = client.ask(command, PATIENCE)?.with_context(|| format!("no {program} answers on this bus"))?;
    let text = reply.text();
    if args.json {
        let status = match ControlStatus::try_from(reply.status) {
            Ok(ControlStatus::Done) => "done",
            Ok(ControlStatus::Refused) => "refused",
            Ok(ControlStatus::Failed) => "failed",
            _ => "unknown_command",
        };
        show_json(&json!({"robot": name.as_str(), "program": program, "status": status, "text": text}))?;
        return Ok(ExitCode::from(u8::from(status != "done")));
    }
    match ControlStatus::try_from(reply.status) {
        Ok(ControlStatus::Done) => {
            rivet_files::note(if text.is_empty() { "done" } else { &text });
            Ok(ExitCode::SUCCESS)
        }
        Ok(ControlStatus::Refused) => bail!("refused: {text}"),
        Ok(ControlStatus::Failed) => bail!("failed: {text}"),
        _ => bail!("this {program} does not know the command: it is older"),
    }
}
