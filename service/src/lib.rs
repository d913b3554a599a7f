//! What a service owes its manager: when it is ready, that it is alive, and a log whose entries carry
//! fields. Nothing here is for a real-time thread.
//!
//! Without a service manager every call does nothing, and the log is plain text on standard error.

mod journal;
mod manager;

pub use journal::log_as;
pub use manager::Manager;
