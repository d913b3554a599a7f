//! Latency histogram of fixed size.

/// Counts durations in 32 bins of doubling width: bin 0 holds 0 and 1 ns, bin b holds 2^b ..= 2^(b+1) - 1 ns,
/// the last one everything from 2^31 ns (2.1 s) on. The bins of the health message.
///
/// Nothing allocates. When a bin is full (after 49 days at 1 kHz) all are halved: shares and quantiles stay, and the total
/// is no longer how often it was recorded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LogHistogram {
    counts: [u32; Self::BINS],
    max: u64,
}

impl Default for LogHistogram {
    fn default() -> Self {
        Self::new()
    }
}

impl LogHistogram {
    /// Number of bins.
    pub const BINS: usize = 32;

    /// An empty histogram.
    pub const fn new() -> Self {
        Self { counts: [0; Self::BINS], max: 0 }
    }

    /// The histogram that another process published; `max` is the largest value it saw \[ns\].
    pub const fn from_counts(counts: [u32; Self::BINS], max: u64) -> Self {
        Self { counts, max }
    }

    /// Counts a duration \[ns\].
    pub fn record(&mut self, ns: u64) {
        let bin = ((ns | 1).ilog2() as usize).min(Self::BINS - 1);
        if self.counts[bin] == u32::MAX {
            for count in &mut self.counts {
                *count /= 2;
            }
        }
        self.counts[bin] += 1;
        self.max = self.max.max(ns);
    }

    /// Adds another histogram's counts; those of a bin that is full with that saturate.
    pub fn merge(&mut self, other: &Self) {
        for (mine, theirs) in self.counts.iter_mut().zip(&other.counts) {
            *mine = mine.saturating_add(*theirs);
        }
        self.max = self.max.max(other.max);
    }

    /// The counts of the bins.
    pub const fn counts(&self) -> &[u32; Self::BINS] {
        &self.counts
    }

    /// How many durations were counted.
    pub fn total(&self) -> u64 {
        self.counts.iter().map(|&count| u64::from(count)).sum()
    }

    /// The largest duration \[ns\], exact.
    pub const fn max(&self) -> u64 {
        self.max
    }

    /// A duration \[ns\] that a share `p` (0..=1) of all does not exceed: the upper end of the bin, so at most
    /// twice the true quantile and never above [`max`](Self::max). 0 when nothing was counted.
    pub fn quantile(&self, p: f64) -> u64 {
        let total = self.total();
        // At least one, so that p = 0 is the smallest duration's bin.
        let rank = ((p.clamp(0.0, 1.0) * total as f64).ceil() as u64).max(1);
        let mut below = 0;
        for (bin, &count) in self.counts.iter().enumerate() {
            below += u64::from(count);
            if below >= rank {
                let upper = if bin + 1 == Self::BINS { u64::MAX } else { (2_u64 << bin) - 1 };
                return upper.min(self.max);
            }
        }
        self.max
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bins_double() {
        let mut histogram = LogHistogram::new();
        for (ns, bin) in [(0, 0), (1, 0), (2, 1), (3, 1), (4, 2), (1023, 9), (1024, 10), (1 << 31, 31), (u64::MAX, 31)]
        {
            let before = histogram.counts()[bin];
            histogram.record(ns);
            assert_eq!(histogram.counts()[bin], before + 1, "{ns}");
        }
        assert_eq!((histogram.total(), histogram.max()), (9, u64::MAX));
    }

    /// The stated bound: true quantile <= quantile < 2 * true quantile, for values from 1 ns to 16 s.
    #[test]
    fn quantiles_are_within_a_factor_of_two() {
        let mut histogram = LogHistogram::new();
        let mut values: Vec<u64> = (0..5000_u64).map(|i| 1 + (i * i * 7919) % (1 << (1 + i % 31))).collect();
        for &value in &values {
            histogram.record(value);
        }
        values.sort_unstable();
        for p in [0.0, 0.001, 0.5, 0.9, 0.99, 0.999, 1.0] {
            let rank = ((p * values.len() as f64).ceil() as usize).max(1);
            let (truth, estimate) = (values[rank - 1], histogram.quantile(p));
            assert!(truth <= estimate && estimate < 2 * truth, "p {p}: {truth} {estimate}");
        }
        assert_eq!(histogram.quantile(1.0), *values.last().unwrap());
    }

    #[test]
    fn merging_equals_recording_everything_into_one() {
        let (mut a, mut b, mut both) = (LogHistogram::new(), LogHistogram::new(), LogHistogram::new());
        for i in 0..1000_u64 {
            let part = if i % 3 == 0 { &mut a } else { &mut b };
            part.record(i * 37);
            both.record(i * 37);
        }
        a.merge(&b);
        assert_eq!(a, both);
        assert_eq!(LogHistogram::from_counts(*both.counts(), both.max()), both);
    }

    #[test]
    fn an_empty_histogram_and_a_full_bin_are_harmless() {
        assert_eq!(LogHistogram::new().quantile(0.5), 0);
        let mut full = LogHistogram::from_counts([u32::MAX; 32], 5);
        full.merge(&full.clone());
        assert_eq!(full.counts()[0], u32::MAX);
    }

    /// A year at 1 kHz: what is usual now still shows, and what was long ago counts ever less.
    #[test]
    fn a_full_bin_halves_all_and_shares_stay() {
        let mut counts = [0; 32];
        (counts[10], counts[20]) = (u32::MAX, u32::MAX / 1000);
        let mut histogram = LogHistogram::from_counts(counts, 2_000_000);
        let before = histogram.quantile(0.9995);
        histogram.record(1500);
        assert_eq!(histogram.counts()[10], u32::MAX / 2 + 1);
        assert_eq!(histogram.counts()[20], u32::MAX / 2000);
        assert_eq!(histogram.quantile(0.9995), before);
        assert_eq!(histogram.quantile(0.5), 2047);
    }
}
