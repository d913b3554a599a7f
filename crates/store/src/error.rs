//! What can be wrong with a stored file, and with storing one.

use std::io;
use std::path::PathBuf;

/// Why nothing could be stored.
#[derive(Debug, thiserror::Error)]
#[error("{}: {source}", path.display())]
pub struct StoreError {
    /// Which file or folder.
    pub path: PathBuf,
    /// Why.
    pub source: io::Error,
}

/// Why a file was not used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Problem {
    /// Fewer bytes than it says, or more.
    #[error("is cut short or too long: {found} bytes, its header has {expected}")]
    Length {
        /// Bytes that are there.
        found: u64,
        /// Bytes that it says it has.
        expected: u64,
    },
    /// It does not begin as a store file does.
    #[error("is no store file of rivet's")]
    Foreign,
    /// Its bytes are not those that were written.
    #[error("is damaged: its checksum does not fit")]
    Checksum,
    /// Written by a newer program.
    #[error("has format version {found}, this program reads up to {known}")]
    Version {
        /// Its version.
        found: u32,
        /// The newest this program knows.
        known: u32,
    },
    /// Its content breaks a rule although the checksum fits.
    #[error("{0}")]
    Content(&'static str),
    /// It belongs to another robot.
    #[error("belongs to robot \"{0}\"")]
    OtherRobot(String),
    /// Its numbers belong to another model: kinematics, gravity, structure or base columns differ.
    #[error("belongs to another model ({found:016x}, not {expected:016x}): the robot file or its URDF has changed")]
    OtherModel {
        /// Its model.
        found: u64,
        /// The model at hand.
        expected: u64,
    },
    /// The system would not give it out.
    #[error("cannot be read: {0}")]
    Unreadable(String),
}
