//! What a failed command tells the shell (the numbers of sysexits.h).

use std::error::Error;
use std::path::PathBuf;

use rivet_config::ConfigErrors;
use rivet_diagnosis::DiagnosisError;
use rivet_estimation::offline::OfflineError;
use rivet_logs::{LogError, LogFault};
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
const DATA: u8 = 65;
/// A file that cannot be read or written.
const INPUT_OUTPUT: u8 = 74;
/// Ended by Ctrl-C or SIGTERM, as a shell counts SIGINT.
const INTERRUPTED: u8 = 130;
/// Whatever has no code of its own.
const OTHER: u8 = 70;
/// Bad configuration; systemd does not restart on it.
const CONFIG: u8 = 78;

/// A failure of this command's own making, by whose fault it is.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Fault {
    /// Words on the command line that each are understood and together ask for nothing there is.
    #[error("{0}")]
    Usage(String),
    /// Logs with which nothing can be done.
    #[error("{0}")]
    Data(String),
    /// A robot file that asks for something else than the command does.
    #[error("{0}")]
    Config(String),
    /// The user ended the command.
    #[error("interrupted; all processes that it started have ended")]
    Interrupted,
}

/// The exit code of a failure: 64 for the command line, 78 for a robot file, 65 for a log, runs that cannot be
/// diagnosed or identified or files that are no diagnoses or do not compare, 74 for a file
/// that cannot be read or written, 130 for the user's Ctrl-C, 70 for the rest.
pub(crate) fn code(error: &anyhow::Error) -> u8 {
    if let Some(fault) = error.chain().find_map(|e| e.downcast_ref::<Fault>()) {
        return match fault {
            Fault::Usage(_) => USAGE,
            Fault::Data(_) => DATA,
            Fault::Config(_) => CONFIG,
            Fault::Interrupted => INTERRUPTED,
        };
    }
    let of_data = |e: &(dyn Error + 'static)| {
        e.downcast_ref::<LogError>().is_some_and(|e| !matches!(e.fault, LogFault::Io(_)))
            || e.is::<DiagnosisError>()
            || e.is::<OfflineError>()
            || e.is::<Mismatch>()
            || e.is::<serde_json::Error>()
    };
    if error.chain().any(<dyn Error>::is::<ConfigErrors>) {
        CONFIG
    } else if error.chain().any(of_data) {
        DATA
    } else if error.chain().any(|e| e.is::<std::io::Error>() || e.is::<LogError>()) {
        INPUT_OUTPUT
    } else {
        OTHER
    }
}
