//! Fewer messages of a stream that is faster than anybody looks.

/// Lets through at most one message an interval, on an even grid of the stream's own stamps.
#[derive(Clone, Debug)]
pub(crate) struct Thinning {
    interval_ns: u64,
    due_ns: Option<u64>,
}

impl Thinning {
    /// At most `rate` messages a second \[Hz\], above zero.
    pub(crate) fn new(rate: f64) -> Thinning {
        Thinning { interval_ns: (1e9 / rate) as u64, due_ns: None }
    }

    /// Whether the message of this stamp \[ns\] goes through.
    pub(crate) fn passes(&mut self, stamp_ns: u64) -> bool {
        let due = match self.due_ns {
            // A robot that began anew may have an older clock.
            Some(due) if stamp_ns < due && due - stamp_ns <= self.interval_ns => return false,
            Some(due) if stamp_ns >= due && stamp_ns - due < self.interval_ns => due,
            _ => stamp_ns,
        };
        self.due_ns = Some(due + self.interval_ns);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn passed(rate: f64, stamps: impl Iterator<Item = u64>) -> Vec<u64> {
        let mut thinning = Thinning::new(rate);
        stamps.filter(|stamp| thinning.passes(*stamp)).collect()
    }

    #[test]
    fn the_rate_is_kept_and_slower_streams_are_whole() {
        let kilohertz = |k: u64| 5_000_000 + k * 1_000_000;
        assert_eq!(passed(100.0, (0..1000).map(kilohertz)).len(), 100);
        // A period that does not divide the interval: the mean rate is kept all the same.
        assert_eq!(passed(100.0, (0..4000).map(|k| k * 3_000_000)).len(), 1200);
        assert_eq!(passed(100.0, (0..50).map(|k| k * 20_000_000)).len(), 50);
    }

    #[test]
    fn a_clock_that_jumps_stops_nothing() {
        let stamps = (0..100).map(|k| 900_000_000_000 + k * 10_000_000).chain((0..100).map(|k| k * 10_000_000));
        assert_eq!(passed(100.0, stamps).len(), 200);
    }
}
