//! What a failed command tells the shell (the numbers of sysexits.h).

use std::error::Error;
use std::path::PathBuf;

use rivet_analysis::fault::{Kind, kind};
// Below it a code is an answer (`rivet diagnose`: 0 to 3), never a failure.
use rivet_service::USAGE;

/// Two diagnoses that were made by different rules; a list of them.
#[derive(Debug, thiserror::Error)]
#[error("{} and {} do not compare: {}", .a.display(), .b.display(), .rules.join("; "))]
pub(crate) struct Mismatch {
    pub(crate) a: PathBuf,
    pub(crate) b: PathBuf,
    pub(crate) rules: Vec<String>,
}

/// Bad input data.
pub(crate) const DATA: u8 = 65;
/// A file that cannot be read or written.
pub(crate) const INPUT_OUTPUT: u8 = 74;
/// Ended by Ctrl-C or SIGTERM, as a shell counts SIGINT.
const INTERRUPTED: u8 = 130;
/// Whatever has no code of its own.
const OTHER: u8 = 70;
/// Bad configuration; systemd does not restart on it.
pub(crate) const CONFIG: u8 = 78;

/// The exit code of a failure: 64 for the command line, 78 for a robot file, 65 for a log, runs that cannot be
/// diagnosed or identified or files that are no diagnoses or do not compare, 74 for a file
/// that cannot be read or written, 130 for the user's Ctrl-C, 70 for the rest.
pub(crate) fn code(error: &anyhow::Error) -> u8 {
    match kind(error) {
        Kind::Usage => USAGE,
        Kind::Data => DATA,
        Kind::Config => CONFIG,
        Kind::InputOutput => INPUT_OUTPUT,
        Kind::Interrupted => INTERRUPTED,
        Kind::Other if error.chain().any(<dyn Error>::is::<Mismatch>) => DATA,
        Kind::Other => OTHER,
    }
}
