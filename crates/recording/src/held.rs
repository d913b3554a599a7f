//! States that come and go within a short time are one event, not a line of the log each.

/// Time for which a value has to stay away until its return is a new event, and to stay until it is the event's end \[ns\].
///
/// It is twice the second that lies between two reports of health. A cause that alternates at the pace of the reports, such as a
/// plan that runs on while the arm stands (0.1 s each way), comes once and ends once.
pub(crate) const HOLD_NS: u64 = 2_000_000_000;

/// What is to be reported of a state.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Change<T> {
    /// What was reported before.
    pub(crate) before: T,
    /// The value now.
    pub(crate) value: T,
    /// How the value alternated since the last report; empty where it did not.
    pub(crate) alternation: String,
}

/// A state over time. A new value is reported at once; one that returns within [`HOLD_NS`] only once it has stayed so long.
#[derive(Clone, Debug)]
pub(crate) struct Held<T> {
    current: T,
    since_ns: u64,
    reported: T,
    /// Values that were left within [`HOLD_NS`], and when \[ns\].
    departed: Vec<(T, u64)>,
    /// Changes that were not reported, and the time of the first \[ns\].
    unreported: (u32, u64),
}

impl<T: Clone + PartialEq> Held<T> {
    pub(crate) fn new(value: T) -> Held<T> {
        Held { current: value.clone(), since_ns: 0, reported: value, departed: Vec::new(), unreported: (0, 0) }
    }

    /// Takes `value` as known and reported: what its publisher gave before no longer counts.
    pub(crate) fn forget(&mut self, value: T) {
        *self = Held::new(value);
    }

    /// Takes in the value at `now_ns`; what is to be reported.
    pub(crate) fn take(&mut self, value: &T, now_ns: u64) -> Option<Change<T>> {
        self.departed.retain(|(_, at)| now_ns.saturating_sub(*at) < HOLD_NS);
        if *value != self.current {
            let returns = self.departed.iter().any(|(departed, _)| departed == value);
            let before = std::mem::replace(&mut self.current, value.clone());
            self.departed.retain(|(departed, _)| *departed != before);
            self.departed.push((before, now_ns));
            self.since_ns = now_ns;
            if returns {
                let (changes, first_ns) = self.unreported;
                self.unreported = (changes.saturating_add(1), if changes == 0 { now_ns } else { first_ns });
                return None;
            }
            return Some(self.report(now_ns));
        }
        if now_ns.saturating_sub(self.since_ns) < HOLD_NS {
            return None;
        }
        if self.current == self.reported {
            self.unreported = (0, 0);
            return None;
        }
        Some(self.report(now_ns))
    }

    fn report(&mut self, now_ns: u64) -> Change<T> {
        let (changes, first_ns) = std::mem::take(&mut self.unreported);
        let seconds = now_ns.saturating_sub(first_ns) as f64 * 1e-9;
        let alternation =
            if changes > 1 { format!(", after {changes} changes in {seconds:.1} s") } else { String::new() };
        let before = std::mem::replace(&mut self.reported, self.current.clone());
        Change { before, value: self.current.clone(), alternation }
    }
}

/// Counts of something that happens, of which a line is written at most every [`HOLD_NS`].
#[derive(Clone, Debug, Default)]
pub(crate) struct Tally {
    count: u64,
    concerned: String,
    line_ns: Option<u64>,
}

impl Tally {
    /// Adds `count`; `concerned`: what the last of them concerned.
    pub(crate) fn add(&mut self, count: u64, concerned: String) {
        self.count += count;
        self.concerned = concerned;
    }

    /// How many there were since the last line, and what the last concerned, where a line is due.
    pub(crate) fn take_due(&mut self, now_ns: u64) -> Option<(u64, String)> {
        let is_due = self.line_ns.is_none_or(|at| now_ns.saturating_sub(at) >= HOLD_NS);
        if self.count == 0 || !is_due {
            return None;
        }
        self.line_ns = Some(now_ns);
        Some((std::mem::take(&mut self.count), std::mem::take(&mut self.concerned)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    #[test]
    fn value_that_comes_and_goes_is_one_event_with_one_end() {
        let mut held = Held::new("none");
        let mut reports = Vec::new();
        // 5 Hz for ten seconds, then quiet; looked at every 5 ms.
        for look in 0..3000_u64 {
            let (at_ns, is_fault) = (look * 5 * MS, (100..2100).contains(&look) && look % 40 < 20);
            if let Some(change) = held.take(&if is_fault { "frozen" } else { "none" }, at_ns) {
                reports.push((at_ns / MS, change.value, change.alternation));
            }
        }
        let [(begin, "frozen", first), (end, "none", last)] = &reports[..] else { panic!("{reports:?}") };
        assert_eq!((*begin, first.as_str()), (600, ""));
        assert_eq!((*end, last.as_str()), (10500 + 2000, ", after 99 changes in 11.8 s"));
    }

    #[test]
    fn value_that_stays_away_for_longer_is_a_new_event() {
        let mut held = Held::new(0);
        let mut taken = |value, at_ms: u64| held.take(&value, at_ms * MS).map(|change| (change.before, change.value));
        assert_eq!(taken(1, 3000), Some((0, 1)));
        assert_eq!(taken(2, 3100), Some((1, 2)), "another value is reported at once");
        assert_eq!(taken(0, 6000), Some((2, 0)));
        assert_eq!(taken(1, 6100), Some((0, 1)), "it was away for three seconds");
        assert_eq!(taken(0, 6200), None);
        assert_eq!(taken(0, 8100), None);
        assert_eq!(taken(0, 8200), Some((1, 0)));
    }

    #[test]
    fn lines_of_a_tally_are_apart_and_lose_no_count() {
        let mut tally = Tally::default();
        let mut counts = Vec::new();
        for second in 0..5_u64 {
            tally.add(3, second.to_string());
            counts.extend(tally.take_due(second * 1000 * MS));
        }
        assert_eq!(counts, [(3, "0".to_owned()), (6, "2".to_owned()), (6, "4".to_owned())]);
    }
}
