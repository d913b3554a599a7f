//! What is left out when periods are too short for the work, and when it is taken up again.

use rivet_ipc_schema::LoadLevel;

/// Share of the period that the work of one sample may take before the period counts as overloaded, and below which it
/// counts as calm.
const OVER: f64 = 0.8;
const CALM: f64 = 0.5;
/// Overloaded periods, of the last 64 with a sample, that make the next level: not a processor that was away for a moment.
const MANY: u32 = 48;
/// Calm periods after which the level before is tried again; what an overloaded one takes back.
const PATIENCE: u64 = 2_000;
const SETBACK: u64 = 100;
/// A level that had to be taken back within this many periods makes the next trial wait twice as long, up to so long.
const HASTY: u64 = 10_000;
const LONGEST: u64 = 64_000;

/// Decides from the work of each period; a pure function of these numbers. The decision itself is published with every
/// parameter set, so that a replay knows it.
#[derive(Clone, Debug)]
pub struct Ladder {
    period_ns: u64,
    level: LoadLevel,
    /// The last 64 periods with a sample, a bit each.
    over: u64,
    calm: u64,
    patience: u64,
    since_down: u64,
}

impl Ladder {
    /// For periods of this length \[ns\].
    #[must_use]
    pub fn new(period_ns: u64) -> Ladder {
        Ladder {
            period_ns: period_ns.max(1),
            level: LoadLevel::Normal,
            over: 0,
            calm: 0,
            patience: PATIENCE,
            since_down: HASTY,
        }
    }

    /// What is left out now.
    #[must_use]
    pub fn level(&self) -> LoadLevel {
        self.level
    }

    /// Takes in a period: its work \[ns\], and how many samples that was for. Returns the new level when it changes.
    ///
    /// Several samples in one period are a delay that is made up for, not an overload: the work counts by sample.
    pub fn period(&mut self, work_ns: u64, samples: usize) -> Option<LoadLevel> {
        if samples == 0 {
            return None;
        }
        let share = work_ns as f64 / (samples as f64 * self.period_ns as f64);
        self.over = (self.over << 1) | u64::from(share > OVER);
        self.calm = if share < CALM { self.calm + 1 } else { self.calm.saturating_sub(SETBACK) };
        self.since_down = self.since_down.saturating_add(1);
        let next = if self.over.count_ones() >= MANY {
            if self.since_down < HASTY {
                self.patience = (2 * self.patience).min(LONGEST);
            }
            match self.level {
                LoadLevel::Normal => LoadLevel::PublishLess,
                LoadLevel::PublishLess => LoadLevel::Decimate,
                LoadLevel::Decimate | LoadLevel::Hold => LoadLevel::Hold,
            }
        } else if self.calm >= self.patience {
            match self.level {
                LoadLevel::Normal => {
                    self.patience = PATIENCE;
                    LoadLevel::Normal
                }
                LoadLevel::PublishLess => LoadLevel::Normal,
                LoadLevel::Decimate => LoadLevel::PublishLess,
                LoadLevel::Hold => LoadLevel::Decimate,
            }
        } else {
            return None;
        };
        // Each level is judged by periods of its own.
        self.over = 0;
        self.calm = 0;
        if next == self.level {
            return None;
        }
        self.since_down = if (next as u32) < (self.level as u32) { 0 } else { HASTY };
        self.level = next;
        Some(next)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(ladder: &mut Ladder, periods: usize, work_ns: u64) -> Vec<LoadLevel> {
        (0..periods).filter_map(|_| ladder.period(work_ns, 1)).collect()
    }

    #[test]
    fn steady_overload_goes_up_one_level_after_the_other_and_calm_goes_down_again() {
        let mut ladder = Ladder::new(1_000_000);
        assert!(run(&mut ladder, 10_000, 300_000).is_empty());
        let up = run(&mut ladder, 500, 900_000);
        assert_eq!(up, [LoadLevel::PublishLess, LoadLevel::Decimate, LoadLevel::Hold]);
        assert_eq!(run(&mut ladder, 47, 900_000), [], "held: there is nothing more to leave out");
        let down = run(&mut ladder, 6100, 100_000);
        assert_eq!(down, [LoadLevel::Decimate, LoadLevel::PublishLess, LoadLevel::Normal]);
    }

    #[test]
    fn a_processor_that_is_away_for_a_moment_changes_nothing() {
        let mut ladder = Ladder::new(1_000_000);
        for k in 0..100_000_u64 {
            let work = if k % 100 < 40 { 5_000_000 } else { 100_000 };
            assert_eq!(ladder.period(work, 1), None, "40 of 100 periods");
        }
        assert_eq!(ladder.period(16 * 300_000, 16), None);
        assert!((0..1000).all(|_| ladder.period(16 * 300_000, 16).is_none()), "catching up is no overload");
        assert!((0..1000).all(|_| ladder.period(u64::MAX, 0).is_none()), "nor are periods without samples");
    }

    /// Between the two thresholds nothing moves; a level that was taken back too early is tried less often.
    #[test]
    fn it_does_not_swing() {
        let mut ladder = Ladder::new(1_000_000);
        run(&mut ladder, 48, 900_000);
        assert_eq!(ladder.level(), LoadLevel::PublishLess);
        assert!(run(&mut ladder, 100_000, 700_000).is_empty());
        // Work that fits only while something is left out.
        let mut changes = 0;
        for _ in 0..200_000 {
            let work = if ladder.level() == LoadLevel::Normal { 900_000 } else { 400_000 };
            changes += u64::from(ladder.period(work, 1).is_some());
        }
        assert!(changes <= 16, "{changes} changes in 200 s");
    }
}
