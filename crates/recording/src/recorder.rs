//! Takes messages and lets a thread of its own write them: a slow disk holds nothing up.

use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use crate::counts::{Counter, Counts};
use crate::error::RecordingError;
use crate::file::RecordingFile;
use crate::message::{Received, services};

/// Messages that wait for the file at most: eight seconds of joint states and setpoints at 1 kHz.
const WAITING: usize = 16 << 10;
/// Length of a chunk: what a killed process loses.
const CHUNK: Duration = Duration::from_secs(1);

/// A recording in the making.
#[derive(Debug)]
pub struct Recorder {
    to_file: SyncSender<Received>,
    thread: JoinHandle<Result<(), RecordingError>>,
    counter: Counter,
}

impl Recorder {
    /// Begins to write to `file`.
    pub fn start(file: RecordingFile) -> Recorder {
        let (to_file, messages) = sync_channel(WAITING);
        Recorder { to_file, thread: thread::spawn(move || write(file, &messages)), counter: Counter::new(services()) }
    }

    /// Takes a message; where the file is too slow for it, it is dropped and counted. Never waits.
    pub fn take(&mut self, received: Received) {
        let (place, origin) = (received.content.place(), received.origin());
        let is_kept = self.to_file.try_send(received).is_ok();
        self.counter.count(place, origin, is_kept);
    }

    /// What was recorded so far; `now_ns`: `CLOCK_MONOTONIC` \[ns\], `foreign`: messages of other publishers.
    pub fn counts(&self, now_ns: u64, foreign: u64) -> Counts {
        self.counter.counts(now_ns, foreign)
    }

    /// Whether the file can no longer be written; [`finish`](Self::finish) returns the reason.
    pub fn has_failed(&self) -> bool {
        self.thread.is_finished()
    }

    /// Writes what waits, `counts` as the last message, and the index.
    ///
    /// # Errors
    /// The file could not be written.
    pub fn finish(self, counts: Counts) -> Result<(), RecordingError> {
        let Recorder { to_file, thread, .. } = self;
        // Where nobody takes it the thread has ended with an error, which follows.
        let _ = to_file.send(Received::derived(counts.stamp_ns, counts.into()));
        drop(to_file);
        thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    }
}

/// Writes messages until nobody sends any more; ends a chunk every second.
fn write(mut file: RecordingFile, messages: &Receiver<Received>) -> Result<(), RecordingError> {
    let mut begin = Instant::now();
    loop {
        match messages.recv_timeout(CHUNK) {
            Ok(received) => file.write(&received)?,
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return file.finish(),
        }
        if begin.elapsed() >= CHUNK {
            file.end_chunk()?;
            begin = Instant::now();
        }
    }
}
