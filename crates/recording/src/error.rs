//! Why nothing is recorded.

use std::io;
use std::path::PathBuf;

/// Why a recording is not made, or ends.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// There is a file of that name already.
    #[error("{}: it is there already, and a recording replaces no file; give another name or remove it", path.display())]
    Exists {
        /// The name that was given.
        path: PathBuf,
    },
    /// The file cannot be made or written.
    #[error("{}: {why}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What the system reports.
        why: io::Error,
    },
    /// The library refuses to write.
    #[error("{}: {why}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// What the library reports.
        why: String,
    },
}
