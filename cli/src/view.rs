//! `rivet view`: becomes the program `rivet-view` beside this one. It is built apart, since it brings WebSocket.

use std::ffi::OsString;
use std::process::ExitCode;

use anyhow::Result;

use crate::optional_program::OptionalProgram;

const PROGRAM: OptionalProgram = OptionalProgram { name: "rivet-view", folder: "crates/view" };

/// Arguments of `rivet view`: all of them are the program's.
#[derive(clap::Args)]
#[command(disable_help_flag = true)]
pub(crate) struct Args {
    /// Robot file and options of rivet-view; --help lists them
    #[arg(value_name = "ROBOT.toml", trailing_var_arg = true, allow_hyphen_values = true)]
    words: Vec<OsString>,
}

pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    PROGRAM.run(&args.words)
}
