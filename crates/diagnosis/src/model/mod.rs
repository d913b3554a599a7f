//! Data that everything shares: runs and their rows, the nominal model, the gap, faults of a log.

pub(crate) mod clock;
pub(crate) mod gap;
pub(crate) mod history;
pub(crate) mod listener;
pub(crate) mod log_fault;
pub(crate) mod nominal;
pub(crate) mod rows;
pub(crate) mod run;
pub(crate) mod standstill;
