//! `rivetd ROBOT.toml`: the daemon as systemd starts it.

use clap::Parser;
use std::process::ExitCode;

/// Identifies the dynamics of a robot arm while it works.
#[derive(Parser)]
#[command(version, max_term_width = 100)]
struct Arguments {
    #[command(flatten)]
    options: rivet_daemon::Options,
}

fn main() -> ExitCode {
    let arguments: Arguments = match rivet_service::command_line() {
        Ok(arguments) => arguments,
        Err(code) => return code,
    };
    match rivet_daemon::run(&arguments.options) {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            let code = why.exit_code();
            log::error!(rivet_event = "failed", exit_code = code; "{why}");
            ExitCode::from(code)
        }
    }
}
