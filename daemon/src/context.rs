//! What every thread with ports on the bus is given.

use crate::error::StartError;
use rivet_ipc_schema::{BusConfig, RobotName};
use rivet_realtime::Shutdown;
use std::sync::mpsc::Sender;

/// Where a thread opens its ports, when it ends, and who learns that it has started.
#[derive(Clone, Debug)]
pub(crate) struct ThreadContext {
    pub(crate) bus: BusConfig,
    pub(crate) name: RobotName,
    pub(crate) shutdown: Shutdown,
    pub(crate) ready: Sender<Result<(), StartError>>,
}

impl ThreadContext {
    /// Reports that the thread has started.
    pub(crate) fn report_ready(&self) {
        // A receiver that is gone means that start-up failed elsewhere; the shutdown flag is then set, too.
        let _ = self.ready.send(Ok(()));
    }

    /// Reports why the thread did not start, or cannot go on.
    pub(crate) fn report_failure(&self, why: impl Into<StartError>) {
        let _ = self.ready.send(Err(why.into()));
    }
}
