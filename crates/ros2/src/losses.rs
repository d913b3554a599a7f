//! Samples that did not come.

/// Periods that may be skipped at once: a longer silence is a pause.
const MOST: u64 = 1_000_000;
/// Share by which the usual step of the stamps may differ from the period.
const USUAL: f64 = 0.2;
/// Share of a new step in the usual one.
const NEW_STEP_SHARE: f64 = 1.0 / 32.0;
/// Messages after which the usual step is known: what is left of the period it began with is below 1 %.
const SETTLED: u32 = 160;

/// What lies between a message and the one before it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Hole {
    /// Messages that the sender wrote and that did not come.
    pub(crate) lost: u64,
    /// Periods without a message; not below `lost`.
    pub(crate) periods: u64,
}

/// Finds holes by the sender's message numbers, which are exact, and by the stamps, which also show periods that it left out.
#[derive(Clone, Debug)]
pub(crate) struct Losses {
    period_ns: f64,
    last: Option<(i64, u64)>,
    usual_ns: f64,
    /// Steps in the usual one, at most [`SETTLED`].
    steps: u32,
}

impl Losses {
    /// `period_s`: `sample_period_s` of the robot file.
    pub(crate) fn new(period_s: f64) -> Losses {
        Losses { period_ns: period_s * 1e9, last: None, usual_ns: period_s * 1e9, steps: 0 }
    }

    /// The hole before message `number` with the mapped stamp `stamp_ns`.
    pub(crate) fn next(&mut self, number: i64, stamp_ns: u64) -> Hole {
        let Some((last_number, last_ns)) = self.last.replace((number, stamp_ns)) else { return Hole::default() };
        let step_ns = stamp_ns.saturating_sub(last_ns) as f64;
        let lost = u64::try_from(number.saturating_sub(last_number).saturating_sub(1)).unwrap_or(0).min(MOST);
        // A rate that is not the robot file's is the daemon's to refuse: it is no loss.
        let trusted = (self.usual_ns / self.period_ns - 1.0).abs() <= USUAL;
        let by_stamp = if trusted && step_ns > 1.5 * self.period_ns {
            ((step_ns / self.period_ns).round() as u64 - 1).min(MOST)
        } else {
            0
        };
        let single = step_ns / (lost as f64 + 1.0);
        self.steps = (self.steps + 1).min(SETTLED);
        // One pause does not change what is usual.
        self.usual_ns += NEW_STEP_SHARE * (single.min(4.0 * self.period_ns) - self.usual_ns);
        Hole { lost, periods: lost.max(by_stamp) }
    }

    /// The next message has the number `number`, as of another sender; the stamps go on.
    pub(crate) fn expect_number(&mut self, number: i64) {
        if let Some((last, _)) = &mut self.last {
            *last = number.saturating_sub(1);
        }
    }

    /// The stamps begin anew: what lies between is unknown.
    pub(crate) fn restart(&mut self) {
        self.last = None;
        self.usual_ns = self.period_ns;
        self.steps = 0;
    }

    /// Usual time between two messages \[s\].
    pub(crate) fn usual_s(&self) -> f64 {
        self.usual_ns * 1e-9
    }

    /// Whether messages come at the rate of the robot file; so too while their rate is not known yet.
    pub(crate) fn rate_fits(&self) -> bool {
        self.steps < SETTLED || (self.usual_ns / self.period_ns - 1.0).abs() <= USUAL
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    #[test]
    fn counts_messages_by_number_and_periods_by_stamp() {
        let mut losses = Losses::new(0.002);
        assert_eq!(losses.next(5, 10 * MS), Hole::default());
        assert_eq!(losses.next(6, 12 * MS), Hole::default());
        assert_eq!(losses.next(9, 18 * MS), Hole { lost: 2, periods: 2 });
        assert_eq!(losses.next(10, 24 * MS), Hole { lost: 0, periods: 2 }, "the sender was late");
        assert_eq!(losses.next(11, 26 * MS + 300_000), Hole::default(), "jitter");
    }

    #[test]
    fn another_rate_is_no_loss() {
        let mut losses = Losses::new(0.001);
        let periods: u64 = (1..200_u64).map(|k| losses.next(k.cast_signed(), 2 * MS * k).periods).sum();
        assert!(periods < 20, "only until it is known: {periods}");
        assert!(!losses.rate_fits());
        assert!((losses.usual_s() - 0.002).abs() < 1e-4);
    }

    #[test]
    fn a_sender_that_comes_back_leaves_the_periods_out() {
        let mut losses = Losses::new(0.002);
        losses.next(4000, 10 * MS);
        losses.expect_number(1);
        assert_eq!(losses.next(1, 1010 * MS), Hole { lost: 0, periods: 499 });
        losses.restart();
        assert_eq!(losses.next(2, 9999 * MS), Hole::default());
    }
}
