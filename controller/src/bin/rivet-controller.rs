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
            eprintln!("rivet-controller: {why}");
            ExitCode::from(why.exit_code())
        }
    }
}
