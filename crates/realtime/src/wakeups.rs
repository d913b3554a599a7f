//! How late wake-ups are, measured as cyclictest does: sleep to an absolute time, look at the clock, again.

use crate::clock::{PeriodTimer, now_ns};
use std::time::Duration;

/// Latencies in bins of a microsecond up to 20 ms, and the largest. Allocated once; nothing allocates afterwards.
#[derive(Clone, Debug)]
pub struct Latencies {
    bins: Vec<u32>,
    beyond: u64,
    total: u64,
    max_ns: u64,
}

/// Bins of a microsecond.
const BINS: usize = 20_000;

impl Default for Latencies {
    fn default() -> Self {
        Latencies { bins: vec![0; BINS], beyond: 0, total: 0, max_ns: 0 }
    }
}

impl Latencies {
    /// Counts one \[ns\].
    pub fn record(&mut self, ns: u64) {
        self.total += 1;
        self.max_ns = self.max_ns.max(ns);
        match self.bins.get_mut((ns / 1000) as usize) {
            Some(bin) => *bin = bin.saturating_add(1),
            None => self.beyond += 1,
        }
    }

    /// How many there are.
    pub fn total(&self) -> u64 {
        self.total
    }

    /// The largest \[ns\].
    pub fn max_ns(&self) -> u64 {
        self.max_ns
    }

    /// How many reached this \[ns\], to a microsecond.
    pub fn at_least(&self, ns: u64) -> u64 {
        let from = ((ns / 1000) as usize).min(BINS);
        self.beyond + self.bins[from..].iter().map(|&count| u64::from(count)).sum::<u64>()
    }

    /// What a share `p` does not exceed \[us\], to the end of a microsecond; the largest where that is beyond the bins.
    pub fn quantile_us(&self, p: f64) -> f64 {
        let rank = ((p.clamp(0.0, 1.0) * self.total as f64).ceil() as u64).max(1);
        let mut below = 0;
        for (us, &count) in self.bins.iter().enumerate() {
            below += u64::from(count);
            if below >= rank {
                return (us as f64 + 1.0).min(self.max_ns as f64 * 1e-3);
            }
        }
        self.max_ns as f64 * 1e-3
    }
}

/// Wakes up every `period` for `duration` on the calling thread, as it is scheduled, and does nothing else.
pub fn measure_wakeups(period: Duration, duration: Duration) -> Latencies {
    let mut latencies = Latencies::default();
    let mut timer = PeriodTimer::new(period);
    let end = now_ns().saturating_add(u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX));
    while now_ns() < end {
        latencies.record(timer.wait().lateness_ns);
    }
    latencies
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_to_a_microsecond() {
        let mut latencies = Latencies::default();
        (0..1000_u64).for_each(|us| latencies.record(us * 1000 + 500));
        assert_eq!((latencies.quantile_us(0.5), latencies.quantile_us(0.99)), (500.0, 990.0));
        assert_eq!(latencies.quantile_us(1.0), 999.5);
        latencies.record(70_000_000);
        assert_eq!((latencies.quantile_us(1.0), latencies.at_least(990_000), latencies.total()), (70_000.0, 11, 1001));
    }

    #[test]
    fn every_wake_up_is_counted() {
        let latencies = measure_wakeups(Duration::from_micros(500), Duration::from_millis(50));
        assert!(latencies.total() > 0 && latencies.total() <= 101);
    }
}
