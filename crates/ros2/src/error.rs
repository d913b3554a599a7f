//! Why the program ended.

use rivet_config::ConfigErrors;
use rivet_ipc_schema::{BusError, PortError};

use crate::graph::GraphError;
use crate::joints::JointsError;

/// Why the program did not start, or ended.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// The command line.
    #[error("{0}")]
    Usage(String),
    /// The robot file.
    #[error("{0}")]
    Config(#[from] ConfigErrors),
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
    /// The library that sends samples.
    #[error("{0}")]
    Robot(#[from] rivet::OpenError),
    /// The graph.
    #[error("{0}")]
    Graph(#[from] GraphError),
    /// Joint states come, and none has the joints of the arm.
    #[error(
        "{topic}: {why}; name the joints in the robot's URDF as its driver does, or give --joint-states another topic"
    )]
    Joints {
        /// Topic of the joint states.
        topic: String,
        /// What is wrong with them.
        why: JointsError,
    },
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
            Failure::Usage(_) => rivet_service::USAGE,
            Failure::Joints { .. } => 65,
            Failure::Bus(_) | Failure::Robot(_) => 69,
            Failure::File { .. } | Failure::Output(_) => 74,
            Failure::Config(_) => 78,
            Failure::Port(_) | Failure::Graph(_) | Failure::System(_) => 70,
        }
    }
}
