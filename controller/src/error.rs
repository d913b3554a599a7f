//! Why the controller did not start, or stopped.

use std::io;

/// Start-up failures; each variant is something its user can change.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// The robot file or its URDF.
    #[error("{0}")]
    Config(#[from] rivet_config::ConfigErrors),
    /// Settings that are sound one by one but not together.
    #[error("the signal chain refuses the settings: {0}")]
    Settings(#[from] rivet_estimation::SettingsError),
    /// The bus.
    #[error("{0}")]
    Bus(#[from] rivet_ipc_schema::BusError),
    /// Real-time scheduling or locked memory was refused.
    #[error("{0}\n  to run without real time, for a trial: --best-effort")]
    RealTime(#[from] rivet_realtime::RealTimeError),
    /// Signal handlers could not be set up.
    #[error("signals cannot be handled: {0}")]
    Signals(#[source] io::Error),
    /// No thread could be started.
    #[error("a thread cannot be started: {0}")]
    Spawn(#[source] io::Error),
    /// A thread ended that should not have.
    #[error("{0}")]
    Thread(&'static str),
}

impl StartError {
    /// Exit status as in sysexits.h; the systemd unit does not restart on 77 and 78.
    pub fn exit_code(&self) -> u8 {
        match self {
            StartError::Config(_) | StartError::Settings(_) => 78,
            StartError::RealTime(_) => 77,
            StartError::Bus(_) => 69,
            StartError::Signals(_) | StartError::Spawn(_) => 71,
            StartError::Thread(_) => 70,
        }
    }
}
