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

/// Wrong usage, as in sysexits.h: the unit does not try that again.
const USAGE: u8 = 64;

fn main() -> ExitCode {
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
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
    match rivet_daemon::run(&arguments.options) {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            let code = why.exit_code();
            log::error!(rivet_event = "failed", exit_code = code; "{why}");
            ExitCode::from(code)
        }
    }
}
