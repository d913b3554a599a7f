//! Why the program ended.

use rivet_config::ConfigErrors;
use rivet_estimation::SettingsError;
use rivet_ipc_schema::{BusError, PortError};

use crate::server::ServerError;

/// Why the program did not start, or ended.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// The robot file.
    #[error("{0}")]
    Config(#[from] ConfigErrors),
    /// Settings of the estimator that do not suit the arm.
    #[error("{0}")]
    Settings(#[from] SettingsError),
    /// A file.
    #[error("{path}: {why}")]
    File {
        /// Which one.
        path: String,
        /// The system's reason.
        why: std::io::Error,
    },
    /// The bus.
    #[error("{0}")]
    Bus(#[from] BusError),
    /// A port of the bus.
    #[error("{0}")]
    Port(#[from] PortError),
    /// The address to listen at.
    #[error("{0}")]
    Server(#[from] ServerError),
    /// The counts could not be printed.
    #[error("{0}")]
    Output(std::io::Error),
    /// The system.
    #[error("{0}")]
    System(#[from] std::io::Error),
}

impl Failure {
    /// The exit code, as in sysexits.h.
    pub fn exit_code(&self) -> u8 {
        match self {
            Failure::Bus(_) | Failure::Server(_) => 69,
            Failure::File { .. } | Failure::Output(_) => 74,
            Failure::Config(_) | Failure::Settings(_) => 78,
            Failure::Port(_) | Failure::System(_) => 70,
        }
    }
}
