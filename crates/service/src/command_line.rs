//! The command line of a program.

use clap::Parser;
use std::process::ExitCode;

/// Exit code of a command line that is not understood, as in sysexits.h: the units do not try that again.
pub const USAGE: u8 = 64;

/// Parses the command line, with a usage error, help or version already shown.
///
/// # Errors
/// The code to exit with: [`USAGE`] after an error, success after help and version.
pub fn command_line<T: Parser>() -> Result<T, ExitCode> {
    T::try_parse().map_err(|why| {
        // Help and version go to standard output and are no error. A terminal that is gone changes nothing here.
        if rivet_files::arguments_are_printable() {
            let _ = why.print();
        } else {
            rivet_files::note(why.render());
        }
        if why.use_stderr() { ExitCode::from(USAGE) } else { ExitCode::SUCCESS }
    })
}
