//! Which samples are missing, and when a sample was taken, by the timestamps of the controller.

/// What a timestamp says of a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Arrival {
    /// The first sample, or the first of a controller that has started anew.
    First {
        /// When it was taken, in the time of the arrivals \[ns\].
        stamp_ns: u64,
    },
    /// The next one, behind this many that never came.
    Next {
        /// When it was taken, in the time of the arrivals \[ns\].
        stamp_ns: u64,
        /// Periods without a sample.
        missing: u64,
    },
    /// Half a period or less behind the last one: no new sample.
    Repeated,
    /// The timestamp is not finite.
    Broken,
}

/// Largest gap between the two clocks, relative; crystals are within a third of it \[1\].
const LARGEST_DRIFT: f64 = 100e-6;
/// How far a timestamp may lie ahead of the time of its arrival \[s\].
const LARGEST_LEAD_S: f64 = 1.0;
/// How late the first sample of a connection may be \[s\]: nothing waited to be read there.
const LARGEST_LAG_S: f64 = 2.0;
/// From this many periods between two samples on, some are missing.
const GAP_PERIODS: f64 = 1.5;

/// Follows the timestamps of one controller.
///
/// The time at which a sample was taken is its timestamp plus an offset. The offset is the smallest difference of arrival and
/// timestamp: delays only add to it. It may rise by 0.1 ms a second, as two clocks drift.
#[derive(Clone, Debug)]
pub struct Timeline {
    period_s: f64,
    last: Option<Last>,
}

#[derive(Clone, Copy, Debug)]
struct Last {
    timestamp_s: f64,
    /// Arrival less timestamp \[s\].
    offset_s: f64,
    stamp_ns: u64,
}

impl Timeline {
    /// Expects a sample every `period_s` seconds.
    pub fn new(period_s: f64) -> Timeline {
        Timeline { period_s, last: None }
    }

    /// Takes in a timestamp \[s\] that arrived at `arrival_ns` \[ns\]; `connected`: it is the first of its connection.
    pub fn take(&mut self, timestamp_s: f64, arrival_ns: u64, connected: bool) -> Arrival {
        if !timestamp_s.is_finite() {
            return Arrival::Broken;
        }
        let arrival_s = arrival_ns as f64 * 1e-9;
        let follows = self.last.filter(|last| {
            let late_s = arrival_s - (timestamp_s + last.offset_s);
            timestamp_s >= last.timestamp_s && late_s > -LARGEST_LEAD_S && (!connected || late_s < LARGEST_LAG_S)
        });
        let Some(last) = follows else {
            self.last = Some(Last { timestamp_s, offset_s: arrival_s - timestamp_s, stamp_ns: arrival_ns });
            return Arrival::First { stamp_ns: arrival_ns };
        };
        let passed_s = timestamp_s - last.timestamp_s;
        let periods = passed_s / self.period_s;
        if periods <= 0.5 {
            return Arrival::Repeated;
        }
        let offset_s = (last.offset_s + LARGEST_DRIFT * passed_s).min(arrival_s - timestamp_s);
        let stamp_ns = (((timestamp_s + offset_s) * 1e9).round() as u64).max(last.stamp_ns + 1);
        self.last = Some(Last { timestamp_s, offset_s, stamp_ns });
        let missing = if periods > GAP_PERIODS { periods.round() as u64 - 1 } else { 0 };
        Arrival::Next { stamp_ns, missing }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    fn next(arrival: Arrival) -> (u64, u64) {
        let Arrival::Next { stamp_ns, missing } = arrival else { panic!("{arrival:?}") };
        (stamp_ns, missing)
    }

    #[test]
    fn missing_samples_are_counted_by_the_timestamps() {
        let mut line = Timeline::new(0.002);
        assert_eq!(line.take(100.0, 5000 * MS, true), Arrival::First { stamp_ns: 5000 * MS });
        assert_eq!(next(line.take(100.002, 5002 * MS, false)), (5002 * MS, 0));
        assert_eq!(next(line.take(100.010, 5010 * MS, false)).1, 3);
        assert_eq!(line.take(100.010, 5010 * MS, false), Arrival::Repeated);
        assert_eq!(line.take(f64::NAN, 5012 * MS, false), Arrival::Broken);
        // 1.4 periods are jitter, 1.6 are a gap.
        assert_eq!(next(line.take(100.0128, 5013 * MS, false)).1, 0);
        assert_eq!(next(line.take(100.016, 5016 * MS, false)).1, 1);
    }

    #[test]
    fn stamps_are_evenly_spaced_however_late_samples_come() {
        let mut line = Timeline::new(0.002);
        line.take(1.0, 1000 * MS, true);
        for k in 1..2000_u64 {
            // Delays of up to 30 ms, and 300 ms once.
            let delay = (k * k % 31) * MS + if k == 700 { 300 * MS } else { 0 };
            let (stamp, missing) = next(line.take(1.0 + 0.002 * k as f64, (1000 + 2 * k) * MS + delay, false));
            assert_eq!(missing, 0);
            let error = stamp as f64 - ((1000 + 2 * k) * MS) as f64;
            assert!((0.0..4e5).contains(&(error + 1.0)), "sample {k}: {error} ns");
        }
    }

    #[test]
    fn a_connection_that_returns_goes_on_and_a_controller_that_restarts_begins() {
        let mut line = Timeline::new(0.002);
        line.take(50.0, 1000 * MS, true);
        assert_eq!(next(line.take(53.0, 4000 * MS, true)).1, 1499, "the same controller");
        assert!(matches!(line.take(2.0, 9000 * MS, true), Arrival::First { .. }), "its time begins anew");
        // Started anew 60 s ago, and its time has passed what it was before.
        assert!(matches!(line.take(30.0, 99_000 * MS, true), Arrival::First { .. }));
        assert!(
            matches!(line.take(1e9, 99_002 * MS, false), Arrival::First { .. }),
            "no million of samples is missing"
        );
        // A process that slept reads late, and all of it.
        let mut line = Timeline::new(0.002);
        line.take(1.0, 1000 * MS, true);
        assert_eq!(next(line.take(1.002, 9000 * MS, false)).1, 0);
    }
}
