//! `rivet-controller ROBOT.toml`: the controller as systemd starts it.

use clap::Parser;
use std::process::ExitCode;

/// Computed-torque control with the parameters that rivetd publishes.
#[derive(Parser)]
#[command(version, max_term_width = 100)]
struct Arguments {
    #[command(flatten)]
    options: rivet_controller::Options,
}

fn main() -> ExitCode {
    let arguments: Arguments = match rivet_service::command_line() {
        Ok(arguments) => arguments,
        Err(code) => return code,
    };
    match rivet_controller::run(&arguments.options) {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            let code = why.exit_code();
            log::error!(rivet_event = "failed", exit_code = code; "{why}");
            ExitCode::from(code)
        }
    }
}
