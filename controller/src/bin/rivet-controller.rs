//! `rivet-controller ROBOT.toml`: the controller as systemd starts it.

use clap::Parser;
use std::process::ExitCode;

/// Computed-torque control with the parameters that rivetd publishes.
#[derive(Parser)]
#[command(version)]
struct Arguments {
    #[command(flatten)]
    options: rivet_controller::Options,
}

fn main() -> ExitCode {
    match rivet_controller::run(&Arguments::parse().options) {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            let code = why.exit_code();
            log::error!(rivet_event = "failed", exit_code = code; "{why}");
            ExitCode::from(code)
        }
    }
}
