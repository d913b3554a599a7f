//! What the journal is told of the loop and the bus, and how often: a fault that lasts for days is not a line a second.

use rivet_ipc_schema::{Health, INPUT_FAULTS, InputFault};
use std::time::{Duration, Instant};

/// Time between two lines of one kind, at first.
const PAUSE: Duration = Duration::from_secs(60);

/// The longest: an arm that stands in its brakes for a week is not news every minute.
const LONGEST_PAUSE: Duration = Duration::from_secs(86_400);

/// Input faults that the journal knows of.
#[derive(Debug, Default)]
pub(crate) struct Said {
    /// Of each fault: how often it had been met when it was said last, and when that was.
    counts: [u64; INPUT_FAULTS],
    when: [Option<Instant>; INPUT_FAULTS],
    /// How long each has to wait then: twice as long with every line, as long as it goes on.
    pauses: [Duration; INPUT_FAULTS],
    /// A fault was said, and its end was not.
    open: bool,
}

impl Said {
    /// Says what is new since the last health.
    pub(crate) fn take(&mut self, health: &Health, now: Instant) {
        for line in self.lines(health, now) {
            log::warn!(rivet_event = "input-fault"; "{line}");
        }
        if self.open && health.input_fault == u32::from(InputFault::None) {
            self.open = false;
            log::info!(rivet_event = "input-right"; "samples are valid again");
        }
    }

    fn lines(&mut self, health: &Health, now: Instant) -> Vec<String> {
        let mut lines = Vec::new();
        for fault in 0..INPUT_FAULTS {
            let (met, said) = (health.input_faults[fault], self.counts[fault]);
            let since = self.when[fault].map(|when| now.saturating_duration_since(when));
            let pause = self.pauses[fault];
            if met <= said || since.is_some_and(|since| since < pause) {
                continue;
            }
            let goes_on = since.is_some_and(|since| since < 2 * pause);
            self.pauses[fault] = if goes_on { (2 * pause).min(LONGEST_PAUSE) } else { PAUSE };
            (self.counts[fault], self.when[fault]) = (met, Some(now));
            self.open = true;
            let name = u32::try_from(fault).ok().and_then(|fault| InputFault::try_from(fault).ok());
            let name = name.map_or_else(|| format!("fault {fault}"), |fault| format!("{fault:?}"));
            lines.push(format!("{name}: {} more, {met} in all (samples, or events)", met - said));
        }
        lines
    }
}

/// Errors of the bus: what is said is not said again for a while, and what is new at once.
#[derive(Debug, Default)]
pub(crate) struct Complaint(Option<(String, Instant)>);

impl Complaint {
    /// Says `why`, unless that has just been said.
    pub(crate) fn say(&mut self, why: &str) {
        if self.is_news(why, Instant::now()) {
            log::warn!("{why} (reported at most once a minute)");
        }
    }

    fn is_news(&mut self, why: &str, now: Instant) -> bool {
        let known =
            self.0.as_ref().is_some_and(|(said, when)| said == why && now.saturating_duration_since(*when) < PAUSE);
        if !known {
            self.0 = Some((why.to_owned(), now));
        }
        !known
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fault_is_said_when_it_is_new_and_ever_less_while_it_lasts() {
        let (mut said, begin) = (Said::default(), Instant::now());
        let mut health = Health::default();
        let at = |seconds| begin + Duration::from_secs(seconds);
        assert!(said.lines(&health, begin).is_empty());
        let lost = InputFault::Lost as usize;
        let mut when = Vec::new();
        for second in 0..1000 {
            health.input_faults[lost] += 2;
            let news = said.lines(&health, at(second));
            if second == 60 {
                assert_eq!(news, ["Lost: 120 more, 122 in all (samples, or events)"]);
            }
            when.extend(news.iter().map(|_| second));
        }
        assert_eq!(when, [0, 60, 180, 420, 900]);
        health.input_faults[InputFault::PublisherGone as usize] = 1;
        assert_eq!(said.lines(&health, at(999)).len(), 1, "another one does not wait");
        assert!(said.open);
        said.take(&health, at(999));
        assert!(!said.open, "it is over");
        for second in [5000, 5060] {
            health.input_faults[lost] += 1;
            assert_eq!(said.lines(&health, at(second)).len(), 1, "what comes again is new");
        }
    }

    #[test]
    fn an_error_that_is_new_is_said_at_once() {
        let (mut complaint, begin) = (Complaint::default(), Instant::now());
        let news = ["a", "a", "b", "a"].map(|why| complaint.is_news(why, begin));
        assert_eq!(news, [true, false, true, true]);
        assert!(complaint.is_news("a", begin + PAUSE));
    }
}
