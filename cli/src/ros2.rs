//! `rivet ros2`: becomes the program `rivet-ros2` beside this one. It is built apart, since it brings DDS.

use std::ffi::OsString;
use std::process::ExitCode;

use anyhow::Result;

use crate::optional_program::OptionalProgram;

const PROGRAM: OptionalProgram = OptionalProgram { name: "rivet-ros2", folder: "crates/ros2" };

/// Arguments of `rivet ros2`: all of them are the program's.
#[derive(clap::Args)]
#[command(disable_help_flag = true)]
pub(crate) struct Args {
    /// Robot file and options of rivet-ros2; --help lists them
    #[arg(value_name = "ROBOT.toml", trailing_var_arg = true, allow_hyphen_values = true)]
    words: Vec<OsString>,
}

pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    PROGRAM.run(&args.words)
}
