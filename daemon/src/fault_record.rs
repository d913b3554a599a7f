//! Which faults were met, and how long it took to get over them.

use rivet_ipc_schema::{INPUT_FAULTS, InputFault};

/// A fault and the joints that it concerns, bit 0 the base's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Met {
    pub(crate) fault: InputFault,
    pub(crate) joints: u32,
}

/// What was wrong, how often, and how long it took to get over it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FaultRecord {
    pub(crate) now: InputFault,
    pub(crate) joints: u32,
    pub(crate) last: InputFault,
    pub(crate) counts: [u64; INPUT_FAULTS],
    /// Samples since the last faulty one, until the signals have settled; `None` once they have.
    since: Option<u64>,
    pub(crate) recovery: Option<u64>,
}

impl FaultRecord {
    pub(crate) const NONE: FaultRecord = FaultRecord {
        now: InputFault::None,
        joints: 0,
        last: InputFault::None,
        counts: [0; INPUT_FAULTS],
        since: None,
        recovery: None,
    };

    /// Counts an event that leaves the signals as they are.
    pub(crate) fn count(&mut self, fault: InputFault, times: u64) {
        let count = &mut self.counts[fault as usize % INPUT_FAULTS];
        *count = count.saturating_add(times);
        self.last = fault;
    }

    /// A fault after which the signals must settle anew.
    pub(crate) fn interrupt(&mut self, met: Met, times: u64) {
        self.count(met.fault, times);
        self.now = met.fault;
        self.joints = met.joints;
        self.since = Some(0);
    }

    /// A good sample was taken in; `settled`: the signals have no more of the fault in them.
    pub(crate) fn good(&mut self, settled: bool) {
        let Some(since) = &mut self.since else { return };
        *since += 1;
        if settled {
            self.recovery = Some(*since);
            self.since = None;
            self.now = InputFault::None;
            self.joints = 0;
        }
    }
}
