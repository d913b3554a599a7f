//! Time between two attempts to connect.

use std::time::{Duration, Instant};

use rivet_realtime::Shutdown;

const SHORTEST: Duration = Duration::from_millis(100);
const LONGEST: Duration = Duration::from_secs(5);
/// Time between two looks at the shutdown flag.
const LOOK: Duration = Duration::from_millis(20);

/// Twice as long after each attempt, 0.1 s to 5 s.
pub(super) struct Backoff(Duration);

impl Backoff {
    pub(super) fn new() -> Backoff {
        Backoff(SHORTEST)
    }

    /// After a connection that worked.
    pub(super) fn reset(&mut self) {
        self.0 = SHORTEST;
    }

    /// Waits, unless the program is to end.
    pub(super) fn wait(&mut self, shutdown: &Shutdown) {
        let until = Instant::now() + self.next();
        while !shutdown.is_requested() && Instant::now() < until {
            std::thread::sleep(LOOK);
        }
    }

    fn next(&mut self) -> Duration {
        let now = self.0;
        self.0 = (2 * self.0).min(LONGEST);
        now
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waits_grow_to_a_bound_and_begin_anew() {
        let mut backoff = Backoff::new();
        let waits: Vec<u128> = (0..8).map(|_| backoff.next().as_millis()).collect();
        assert_eq!(waits, [100, 200, 400, 800, 1600, 3200, 5000, 5000]);
        backoff.reset();
        assert_eq!(backoff.next(), SHORTEST);
    }
}
