//! Whether samples come at the rate that the robot file says.

/// Stamps in one look at the rate.
const STAMPS: usize = 128;
/// Slopes between stamps half a look apart.
const SLOPES: usize = STAMPS / 2;
/// Largest relative difference of the measured period from the stated one.
const TOLERANCE: f64 = 0.03;

/// Compares stamps with sequence numbers: derivatives, filters and rate limits are all reckoned in the stated sample period,
/// and with another one they are wrong without looking so.
///
/// The measured period is the median of the 64 slopes between stamps 64 samples apart, every 128 samples: neither a single
/// wrong stamp nor samples that arrive in bursts move it. Samples without a stamp (zero) say nothing.
#[derive(Clone, Debug)]
pub struct SampleClock {
    stated_ns: f64,
    seen: [(u64, u64); STAMPS],
    filled: usize,
    measured_ns: Option<f64>,
}

impl SampleClock {
    /// Expects samples every `period_s` seconds.
    #[must_use]
    pub fn new(period_s: f64) -> SampleClock {
        SampleClock { stated_ns: period_s * 1e9, seen: [(0, 0); STAMPS], filled: 0, measured_ns: None }
    }

    /// Takes in sequence number and stamp \[ns\] of a sample; returns whether the rate is, as far as is known, the stated one.
    /// Numbers or stamps that do not go forward begin a new look. Real-time safe: bounded work.
    pub fn take(&mut self, seq: u64, stamp_ns: u64) -> bool {
        if stamp_ns != 0 {
            if self.filled > 0 {
                let (last_seq, last_ns) = self.seen[self.filled - 1];
                if seq <= last_seq || stamp_ns <= last_ns {
                    self.filled = 0;
                }
            }
            self.seen[self.filled] = (seq, stamp_ns);
            self.filled += 1;
            if self.filled == STAMPS {
                self.filled = 0;
                self.measured_ns = Some(median_slope(&self.seen));
            }
        }
        self.fits()
    }

    /// Begins a new look, after a stamp that jumped; what was measured before stands.
    pub fn begin(&mut self) {
        self.filled = 0;
    }

    /// Whether the rate is, as far as is known, the stated one.
    #[must_use]
    pub fn fits(&self) -> bool {
        self.measured_ns.is_none_or(|measured| (measured / self.stated_ns - 1.0).abs() <= TOLERANCE)
    }

    /// Whether the rate has been measured and is the stated one.
    #[must_use]
    pub fn confirmed(&self) -> bool {
        self.measured_ns.is_some() && self.fits()
    }

    /// The period measured last \[s\].
    #[must_use]
    pub fn measured_s(&self) -> Option<f64> {
        self.measured_ns.map(|ns| ns * 1e-9)
    }
}

fn median_slope(seen: &[(u64, u64); STAMPS]) -> f64 {
    let mut slopes = [0.0; SLOPES];
    for (slope, (from, to)) in slopes.iter_mut().zip(seen.iter().zip(&seen[SLOPES..])) {
        *slope = (to.1 - from.1) as f64 / (to.0 - from.0) as f64;
    }
    slopes.sort_unstable_by(f64::total_cmp);
    0.5 * (slopes[SLOPES / 2 - 1] + slopes[SLOPES / 2])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What the clock says after a thousand samples with these numbers and stamps.
    fn after(of: impl Fn(u64) -> (u64, u64)) -> SampleClock {
        let mut clock = SampleClock::new(0.001);
        for k in 1..=1000 {
            let (seq, stamp_ns) = of(k);
            clock.take(seq, stamp_ns);
        }
        clock
    }

    #[test]
    fn another_rate_is_seen_and_the_stated_one_is_confirmed() {
        assert!(after(|k| (k, 1_000_000 * k)).confirmed());
        let measured = after(|k| (k, 2_000_000 * k));
        assert!(!measured.fits() && (measured.measured_s().expect("measured") - 0.002).abs() < 1e-12);
        assert!(!after(|k| (k, 950_000 * k)).fits());
        assert!(!after(|k| (k, 1_050_000 * k)).fits());
    }

    #[test]
    fn lost_samples_bursts_jitter_and_single_wrong_stamps_do_not_matter() {
        assert!(after(|k| (3 * k, 3_000_000 * k)).confirmed(), "two of three are lost");
        assert!(after(|k| (k, 4_000_000 * (k / 4) + 1000 * (k % 4) + 1)).confirmed(), "four at a time");
        assert!(after(|k| (k, 1_000_000 * k + 400_000 * (k * k % 7) / 7)).confirmed(), "0.4 ms of jitter");
        let wrong = |k: u64| if k.is_multiple_of(100) { 500_000_000 } else { 0 };
        assert!(after(|k| (k, 1_000_000 * k + wrong(k))).fits(), "a stamp in a hundred is off by half a second");
    }

    #[test]
    fn without_stamps_nothing_is_known_and_a_new_robot_controller_is_looked_at_anew() {
        let silent = after(|k| (k, 0));
        assert!(silent.fits() && !silent.confirmed());
        let mut clock = after(|k| (k, 2_000_000 * k));
        for k in 1..=STAMPS as u64 {
            clock.take(k, 1_000_000 * k);
        }
        assert!(clock.confirmed());
    }
}
