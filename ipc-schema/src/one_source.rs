//! One publisher of a service is heard; what another one sends meanwhile is left out and counted.

use std::time::Duration;

use crate::error::PortError;
use crate::messages::Message;
use crate::pubsub::Subscriber;

/// A subscriber that keeps to the publisher that it heard first.
///
/// Another one takes its place when the first has gone, or is still listed (killed, hung) but has been silent for the time of
/// succession, as far as anyone listened. Until then none of its messages is given out: two streams of samples, plans or
/// parameters are never mixed.
#[derive(Debug)]
pub struct OneSource<T: Message> {
    port: Subscriber<T>,
    source: Option<u128>,
    heard_ns: u64,
    asked_ns: u64,
    succession_ns: u64,
    foreign: u64,
}

impl<T: Message> OneSource<T> {
    /// Listens at `port`; `succession`: silence after which another publisher is heard.
    pub fn new(port: Subscriber<T>, succession: Duration) -> OneSource<T> {
        let succession_ns = u64::try_from(succession.as_nanos()).unwrap_or(u64::MAX);
        OneSource { port, source: None, heard_ns: 0, asked_ns: 0, succession_ns, foreign: 0 }
    }

    /// The oldest message of the one publisher that was not yet received; `now_ns` on the caller's monotonic clock.
    ///
    /// Real-time safe as [`Subscriber::receive`]; bounded by the size of the ring.
    ///
    /// # Errors
    /// The port's.
    pub fn receive(&mut self, now_ns: u64) -> Result<Option<T>, PortError> {
        if now_ns.saturating_sub(self.asked_ns) > self.succession_ns {
            // Who did not listen (a stopped process, no sample to plan for) does not know who was silent.
            self.heard_ns = now_ns;
        }
        self.asked_ns = now_ns;
        for _ in 0..self.port.capacity() {
            let Some((message, from)) = self.port.receive_from()? else { break };
            let silent = now_ns.saturating_sub(self.heard_ns) > self.succession_ns;
            if self.source.is_some_and(|source| source != from) && !silent && self.port.publishers() > 1 {
                self.foreign += 1;
                continue;
            }
            self.source = Some(from);
            self.heard_ns = now_ns;
            return Ok(Some(message));
        }
        Ok(None)
    }

    /// The newest message of the one publisher, all older ones dropped.
    ///
    /// Real-time safe as [`receive`](Self::receive); bounded by the size of the ring.
    ///
    /// # Errors
    /// The port's.
    pub fn receive_newest(&mut self, now_ns: u64) -> Result<Option<T>, PortError> {
        let mut newest = None;
        for _ in 0..self.port.capacity() {
            match self.receive(now_ns)? {
                Some(message) => newest = Some(message),
                None => break,
            }
        }
        Ok(newest)
    }

    /// The publisher that is heard.
    pub fn source(&self) -> Option<u128> {
        self.source
    }

    /// How many messages the ring holds before the oldest is overwritten.
    pub fn capacity(&self) -> usize {
        self.port.capacity()
    }

    /// How many publishers are there at present.
    pub fn publishers(&self) -> usize {
        self.port.publishers()
    }

    /// Messages of other publishers that were left out.
    pub fn foreign(&self) -> u64 {
        self.foreign
    }
}
