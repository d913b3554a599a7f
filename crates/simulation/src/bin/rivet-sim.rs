//! The simulated robot controller as a process of its own.

use std::process::ExitCode;

use clap::Parser;

/// Plays a robot controller's shared memory with a simulated arm: publishes joint-state and setpoint, takes command.
#[derive(Parser)]
#[command(name = "rivet-sim", version, max_term_width = 100)]
struct Line {
    #[command(flatten)]
    options: rivet_simulation::process::Options,
}

fn main() -> ExitCode {
    let line: Line = match rivet_service::command_line() {
        Ok(line) => line,
        Err(code) => return code,
    };
    rivet_simulation::process::main(&line.options)
}
