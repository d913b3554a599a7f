//! The clock of all stamps, and a periodic timer on it.

use std::time::Duration;

use rustix::thread::{ClockId as SleepClock, clock_nanosleep_absolute};
use rustix::time::{ClockId, Timespec, clock_gettime};

const NANOSECONDS: u64 = 1_000_000_000;

/// `CLOCK_MONOTONIC` \[ns\]: the clock of every `stamp_ns` on the bus. No system call (vDSO).
pub fn now_ns() -> u64 {
    let now = clock_gettime(ClockId::Monotonic);
    now.tv_sec as u64 * NANOSECONDS + now.tv_nsec as u64
}

/// Periodic wake-ups at absolute times: the period does not drift with the work done in it.
///
/// After an overrun the timer realigns to its grid. Deadlines that passed are counted and, as [`Overrun`] says, skipped or
/// run at once, one after the other.
#[derive(Debug)]
pub struct PeriodTimer {
    period_ns: u64,
    next_ns: u64,
    overrun: Overrun,
}

/// What becomes of deadlines that have passed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Overrun {
    /// They are left out.
    #[default]
    Skip,
    /// Each gets its period, at once: a burst after a delay.
    CatchUp,
}

/// One wake-up of a [`PeriodTimer`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tick {
    /// The time this wake-up was due, `CLOCK_MONOTONIC` \[ns\].
    pub deadline_ns: u64,
    /// How much later it came \[ns\].
    pub lateness_ns: u64,
    /// Further deadlines that had passed by then: skipped, or due at once.
    pub missed: u64,
}

impl PeriodTimer {
    /// A timer whose first deadline is one period from now. A period below 1 us is taken as 1 us.
    pub fn new(period: Duration) -> Self {
        Self::starting_at(period, now_ns())
    }

    fn starting_at(period: Duration, now_ns: u64) -> Self {
        let period_ns = u64::try_from(period.as_nanos()).unwrap_or(u64::MAX / 4).clamp(1_000, u64::MAX / 4);
        Self { period_ns, next_ns: now_ns + period_ns, overrun: Overrun::Skip }
    }

    /// Does with deadlines that have passed what `overrun` says.
    #[must_use]
    pub fn with_overrun(self, overrun: Overrun) -> Self {
        Self { overrun, ..self }
    }

    /// Sleeps until the next deadline; returns at once when it has passed.
    pub fn wait(&mut self) -> Tick {
        let mut now = now_ns();
        while now < self.next_ns {
            let until = Timespec {
                tv_sec: (self.next_ns / NANOSECONDS).cast_signed(),
                tv_nsec: (self.next_ns % NANOSECONDS).cast_signed(),
            };
            // A signal ends the sleep early: look at the clock and go on.
            let _ = clock_nanosleep_absolute(SleepClock::Monotonic, &until);
            now = now_ns();
        }
        self.advance(now)
    }

    /// The tick of a wake-up at `now`, which is at or after the deadline.
    fn advance(&mut self, now_ns: u64) -> Tick {
        let deadline_ns = self.next_ns;
        let lateness_ns = now_ns - deadline_ns;
        let missed = lateness_ns / self.period_ns;
        let skips = self.overrun == Overrun::Skip;
        let left_out = if skips { missed } else { 0 };
        // Caught up one by one, each of them is late once more: counted one by one too.
        let missed = if skips { missed } else { missed.min(1) };
        self.next_ns = deadline_ns + (left_out + 1) * self.period_ns;
        Tick { deadline_ns, lateness_ns, missed }
    }
}

/// Notices that the machine was suspended: `CLOCK_BOOTTIME` goes on meanwhile, `CLOCK_MONOTONIC` does not.
#[derive(Clone, Copy, Debug)]
pub struct Suspension {
    ahead_ns: i64,
}

/// Suspensions shorter than this are none \[ns\].
const LEAST_SUSPENSION: i64 = 1_000_000;

impl Suspension {
    /// From now on.
    pub fn watch() -> Self {
        let (boot, monotonic) = clocks();
        Self { ahead_ns: boot - monotonic }
    }

    /// How long the machine was suspended since the last look \[ns\], if it was. No system call (vDSO).
    pub fn look(&mut self) -> Option<u64> {
        let (boot, monotonic) = clocks();
        self.judge(boot, monotonic)
    }

    /// `monotonic` was read after `boot`: a delay between the two readings makes the difference smaller, never larger.
    fn judge(&mut self, boot: i64, monotonic: i64) -> Option<u64> {
        let ahead = boot - monotonic;
        let gone = ahead - self.ahead_ns;
        self.ahead_ns = self.ahead_ns.max(ahead);
        (gone >= LEAST_SUSPENSION).then_some(gone.cast_unsigned())
    }
}

fn clocks() -> (i64, i64) {
    let boot = clock_gettime(ClockId::Boottime);
    (boot.tv_sec * NANOSECONDS.cast_signed() + boot.tv_nsec, now_ns().cast_signed())
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: Duration = Duration::from_millis(1);

    #[test]
    fn deadlines_lie_on_the_grid_whatever_the_lateness() {
        let mut timer = PeriodTimer::starting_at(PERIOD, 500);
        let on_time = timer.advance(1_000_500);
        assert_eq!(on_time, Tick { deadline_ns: 1_000_500, lateness_ns: 0, missed: 0 });
        let late = timer.advance(2_400_500);
        assert_eq!(late, Tick { deadline_ns: 2_000_500, lateness_ns: 400_000, missed: 0 });
        assert_eq!(timer.next_ns, 3_000_500);
    }

    #[test]
    fn an_overrun_skips_deadlines_instead_of_making_up_for_them() {
        let mut timer = PeriodTimer::starting_at(PERIOD, 0);
        let overrun = timer.advance(4_700_000); // due at 1 ms; 2, 3 and 4 ms have passed as well
        assert_eq!(overrun, Tick { deadline_ns: 1_000_000, lateness_ns: 3_700_000, missed: 3 });
        assert_eq!(timer.next_ns, 5_000_000, "the next deadline lies in the future");
        let exact = timer.advance(6_000_000); // one whole period late
        assert_eq!((exact.missed, timer.next_ns), (1, 7_000_000));
    }

    #[test]
    fn catching_up_gives_every_deadline_its_period() {
        let mut timer = PeriodTimer::starting_at(PERIOD, 0).with_overrun(Overrun::CatchUp);
        let due: Vec<u64> = (0..5).map(|_| timer.advance(4_700_000.max(timer.next_ns)).deadline_ns).collect();
        assert_eq!(due, [1_000_000, 2_000_000, 3_000_000, 4_000_000, 5_000_000]);
        assert_eq!(timer.next_ns, 6_000_000);
    }

    #[test]
    fn a_wait_never_ends_early_and_accounts_for_every_period() {
        let mut timer = PeriodTimer::new(Duration::from_micros(300));
        let first = timer.next_ns;
        let mut periods = 0;
        for _ in 0..20 {
            let tick = timer.wait();
            assert!(now_ns() >= tick.deadline_ns + tick.lateness_ns);
            assert_eq!(tick.deadline_ns, first + periods * 300_000);
            periods += 1 + tick.missed;
        }
    }

    #[test]
    fn the_clock_goes_forward() {
        let mut last = now_ns();
        for _ in 0..1000 {
            let now = now_ns();
            assert!(now >= last);
            last = now;
        }
    }

    #[test]
    fn a_suspension_is_noticed_once_and_a_delay_is_none() {
        let mut watch = Suspension { ahead_ns: 7_000 };
        assert_eq!(watch.judge(1_000_000_000 + 7_000, 1_000_000_000), None);
        assert_eq!(watch.judge(2_000_000_000 + 7_000, 2_300_000_000), None, "away between the two readings");
        assert_eq!(watch.judge(62_000_007_000, 3_000_000_000), Some(59_000_000_000));
        assert_eq!(watch.judge(63_000_007_000, 4_000_000_000), None);
        let mut real = Suspension::watch();
        assert!((0..1000).all(|_| real.look().is_none()));
    }

    #[test]
    fn absurd_periods_neither_spin_nor_overflow() {
        assert_eq!(PeriodTimer::starting_at(Duration::ZERO, 0).period_ns, 1_000);
        let mut timer = PeriodTimer::starting_at(Duration::MAX, now_ns());
        timer.advance(timer.next_ns);
    }
}
