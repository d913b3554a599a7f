//! Failures of an analysis by whose fault they are.

use std::error::Error;

use rivet_config::ConfigErrors;
use rivet_diagnosis::DiagnosisError;
use rivet_estimation::offline::OfflineError;
use rivet_logs::{LogError, LogFault};

/// A failure of the analysis' own making.
#[derive(Debug, thiserror::Error)]
pub enum Fault {
    /// Arguments that each are valid and together ask for nothing there is.
    #[error("{0}")]
    Usage(String),
    /// Logs with which nothing can be done.
    #[error("{0}")]
    Data(String),
    /// A robot file that asks for something else than the analysis does.
    #[error("{0}")]
    Config(String),
    /// The user ended the command.
    #[error("interrupted; all processes that it started have ended")]
    Interrupted,
}

/// By whose fault an analysis fails.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Arguments.
    Usage,
    /// A log, or runs that cannot be diagnosed or identified.
    Data,
    /// A robot file.
    Config,
    /// A file that cannot be read or written.
    InputOutput,
    /// The user ended it.
    Interrupted,
    /// Anything else.
    Other,
}

/// By whose fault an analysis failed, from the causes of `error`.
///
/// ```
/// use rivet_analysis::fault::{Fault, Kind, kind};
/// let error = anyhow::Error::new(Fault::Data("no joint moves".to_owned())).context("log.parquet");
/// assert_eq!(kind(&error), Kind::Data);
/// ```
pub fn kind(error: &anyhow::Error) -> Kind {
    if let Some(fault) = error.chain().find_map(|e| e.downcast_ref::<Fault>()) {
        return match fault {
            Fault::Usage(_) => Kind::Usage,
            Fault::Data(_) => Kind::Data,
            Fault::Config(_) => Kind::Config,
            Fault::Interrupted => Kind::Interrupted,
        };
    }
    let of_data = |e: &(dyn Error + 'static)| {
        e.downcast_ref::<LogError>().is_some_and(|e| !matches!(e.fault, LogFault::Io(_)))
            || e.is::<DiagnosisError>()
            || e.is::<OfflineError>()
            || e.is::<serde_json::Error>()
    };
    if error.chain().any(<dyn Error>::is::<ConfigErrors>) {
        Kind::Config
    } else if error.chain().any(of_data) {
        Kind::Data
    } else if error.chain().any(|e| e.is::<std::io::Error>() || e.is::<LogError>()) {
        Kind::InputOutput
    } else {
        Kind::Other
    }
}
