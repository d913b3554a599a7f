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

/// Wrong usage, as in sysexits.h and as the other programs have it.
const USAGE: u8 = 64;

fn main() -> ExitCode {
    let line = match Line::try_parse() {
        Ok(line) => line,
        Err(why) => {
            // Help and version go to standard output and are no error.
            if rivet_files::arguments_are_printable() {
                let _ = why.print();
            } else {
                rivet_files::note(why.render());
            }
            return if why.use_stderr() { ExitCode::from(USAGE) } else { ExitCode::SUCCESS };
        }
    };
    rivet_simulation::process::main(&line.options)
}
