//! What the estimator knows, all of it, on its way from the loop to the store.

use crate::core::Core;
use rivet_ipc_schema::Parameters;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// A parameter set and the memory that it came from.
#[derive(Clone, Debug)]
pub(crate) struct Snapshot {
    pub(crate) parameters: Box<Parameters>,
    pub(crate) memory: Vec<f64>,
    /// What the memory means; 0, and it means nothing, while it is not of `length` numbers.
    pub(crate) fingerprint: u64,
    length: usize,
    /// The loop has ended: there will be no other.
    pub(crate) last: bool,
}

/// Buffers on their way: empty ones to the loop, filled ones back. One is always with the loop, for its end.
const BUFFERS: usize = 2;

/// The loop's end. Wait-free; nothing is allocated or dropped here.
pub struct Snapshots {
    wanted: Arc<AtomicBool>,
    empty: rtrb::Consumer<Snapshot>,
    filled: rtrb::Producer<Snapshot>,
}

impl Snapshots {
    /// Nobody asks.
    pub fn none() -> Snapshots {
        let wanted = Arc::new(AtomicBool::new(false));
        Snapshots { wanted, empty: rtrb::RingBuffer::new(1).1, filled: rtrb::RingBuffer::new(1).0 }
    }

    /// Fills a buffer if one is wanted. Real-time safe.
    pub(crate) fn serve(&mut self, core: &mut Core) {
        if self.wanted.load(Ordering::Acquire) && self.wanted.swap(false, Ordering::AcqRel) {
            self.fill(core, false);
        }
    }

    /// The loop ends: what it knows now.
    pub(crate) fn end(&mut self, core: &mut Core) {
        self.fill(core, true);
    }

    fn fill(&mut self, core: &mut Core, last: bool) {
        let Ok(mut snapshot) = self.empty.pop() else { return };
        core.write_parameters(&mut snapshot.parameters);
        let whole = core.write_memory(&mut snapshot.memory);
        (snapshot.fingerprint, snapshot.length) =
            (if whole { core.memory_fingerprint() } else { 0 }, core.memory_len());
        snapshot.last = last;
        // There is room for as many as there are.
        let _ = self.filled.push(snapshot);
    }
}

/// The store's end.
pub struct Asking {
    wanted: Arc<AtomicBool>,
    empty: rtrb::Producer<Snapshot>,
    filled: rtrb::Consumer<Snapshot>,
}

/// Both ends, for a core whose memory has `length` numbers.
pub fn snapshots(length: usize) -> (Asking, Snapshots) {
    let wanted = Arc::new(AtomicBool::new(false));
    let (mut empty, empty_end) = rtrb::RingBuffer::new(BUFFERS);
    let (filled_end, filled) = rtrb::RingBuffer::new(BUFFERS);
    for _ in 0..BUFFERS {
        let parameters = Box::new(Parameters::default());
        // There is room for as many as there are.
        let _ = empty.push(Snapshot { parameters, memory: vec![0.0; length], fingerprint: 0, length, last: false });
    }
    let loop_end = Snapshots { wanted: Arc::clone(&wanted), empty: empty_end, filled: filled_end };
    (Asking { wanted, empty, filled }, loop_end)
}

impl Asking {
    /// Has the loop fill a buffer at its next turn.
    pub fn ask(&self) {
        self.wanted.store(true, Ordering::Release);
    }

    /// Whether a buffer has been filled; it is given back as it is.
    pub fn is_answered(&mut self) -> bool {
        self.read_filled(|_| ()).is_some()
    }

    /// Works on a filled buffer, if there is one, and gives it back.
    pub(crate) fn read_filled<T>(&mut self, work: impl FnOnce(&Snapshot) -> T) -> Option<T> {
        let mut snapshot = self.filled.pop().ok()?;
        let result = work(&snapshot);
        // Another scheme since a reload has another memory: the next time there is room for it.
        snapshot.memory.resize(snapshot.length, 0.0);
        let _ = self.empty.push(snapshot);
        Some(result)
    }
}
