//! How far the loop is, for threads that must not disturb it.

use rivet_ipc_schema::StateFolder;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};

/// Counters that the loop stores and others read; each is its own truth, they are not one snapshot.
#[derive(Debug, Default)]
pub struct Progress {
    periods: AtomicU64,
    samples: AtomicU64,
    lost: AtomicU64,
    epoch: AtomicU64,
    wrong_period_ns: AtomicU64,
    met: AtomicBool,
    polls: AtomicBool,
    no_room: AtomicBool,
    state_folder: AtomicU32,
    bus_turns: AtomicU64,
    store_turns: AtomicU64,
}

/// What [`Progress`] held.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Snapshot {
    /// Periods since the start.
    pub periods: u64,
    /// Samples used.
    pub samples: u64,
    /// Samples lost on the way.
    pub lost: u64,
    /// Parameter sets published.
    pub epoch: u64,
    /// Period at which samples come \[ns\] where that is not the robot file's; else 0.
    pub wrong_period_ns: u64,
    /// Whether a period has used samples and ended in time.
    pub met: bool,
    /// Whether samples come without the robot's notifications, so that a loop triggered by samples polls.
    pub polls: bool,
}

impl Progress {
    /// The bus thread has gone round once more.
    pub(crate) fn bus_turned(&self) {
        self.bus_turns.fetch_add(1, Ordering::Relaxed);
    }

    /// So has the store's.
    pub(crate) fn store_turned(&self) {
        self.store_turns.fetch_add(1, Ordering::Relaxed);
    }

    /// How often both have.
    pub(crate) fn turns(&self) -> (u64, u64) {
        (self.bus_turns.load(Ordering::Relaxed), self.store_turns.load(Ordering::Relaxed))
    }

    /// Stores whether shared memory is full, which the bus thread looks after.
    pub(crate) fn set_no_room(&self, full: bool) {
        self.no_room.store(full, Ordering::Relaxed);
    }

    /// Whether shared memory is full.
    pub(crate) fn no_room(&self) -> bool {
        self.no_room.load(Ordering::Relaxed)
    }

    /// Stores whether the state folder can be written, which the store's thread looks after.
    pub(crate) fn set_state_folder(&self, state: StateFolder) {
        self.state_folder.store(state.into(), Ordering::Relaxed);
    }

    /// A [`StateFolder`].
    pub(crate) fn state_folder(&self) -> u32 {
        self.state_folder.load(Ordering::Relaxed)
    }

    /// Stores; wait-free.
    pub fn write(&self, now: Snapshot) {
        self.samples.store(now.samples, Ordering::Relaxed);
        self.lost.store(now.lost, Ordering::Relaxed);
        self.epoch.store(now.epoch, Ordering::Relaxed);
        self.wrong_period_ns.store(now.wrong_period_ns, Ordering::Relaxed);
        self.met.store(now.met, Ordering::Relaxed);
        self.polls.store(now.polls, Ordering::Relaxed);
        self.periods.store(now.periods, Ordering::Relaxed);
    }

    /// Reads.
    pub fn read(&self) -> Snapshot {
        Snapshot {
            periods: self.periods.load(Ordering::Relaxed),
            samples: self.samples.load(Ordering::Relaxed),
            lost: self.lost.load(Ordering::Relaxed),
            epoch: self.epoch.load(Ordering::Relaxed),
            met: self.met.load(Ordering::Relaxed),
            polls: self.polls.load(Ordering::Relaxed),
            wrong_period_ns: self.wrong_period_ns.load(Ordering::Relaxed),
        }
    }
}
