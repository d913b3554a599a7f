//! What was recorded, and what was lost.

use schemars::JsonSchema;
use serde::Serialize;

/// What was recorded of all services. It is a topic of the recording too, once a second and at its end.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, JsonSchema)]
pub struct Counts {
    /// When they were counted, `CLOCK_MONOTONIC` [ns].
    pub stamp_ns: u64,
    /// Messages of a second publisher of joint states, setpoints or second encoders; they are not recorded.
    pub foreign: u64,
    /// One entry a service.
    pub services: Vec<ServiceCounts>,
}

/// What was recorded of one service.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, JsonSchema)]
pub struct ServiceCounts {
    /// Name of the service, such as joint-state.
    pub service: String,
    /// Messages that were passed on to the file.
    pub messages: u64,
    /// Numbers of the sequence that never came: lost by the robot or overwritten before they were read.
    /// Planners that do not plan every period leave out numbers of setpoints.
    pub missing: u64,
    /// Messages that came and found no room, since the file was written too slowly.
    pub dropped: u64,
}

/// A number of the same publisher that is so far behind the last one comes late; one further behind begins anew.
const LATE: u64 = 64;
/// A sequence begins with this number at most.
const MAX_FIRST: u64 = 1;

/// Where a message stands in the sequence of its publisher.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Origin {
    /// Identity of the publisher on the bus.
    pub publisher: Option<u128>,
    /// Number of the message.
    pub number: u64,
}

/// Counts messages as they come.
#[derive(Clone, Debug)]
pub struct Counter {
    services: Vec<(ServiceCounts, Option<Origin>)>,
}

impl Counter {
    /// Counts messages of these services.
    pub fn new(services: impl Iterator<Item = &'static str>) -> Counter {
        let service = |name: &str| (ServiceCounts { service: name.to_owned(), ..ServiceCounts::default() }, None);
        Counter { services: services.map(service).collect() }
    }

    /// Counts a message of service `place` that has come; `is_kept`: whether there was room for it.
    ///
    /// Another publisher begins a sequence, and so does a number of at most 1 after a higher one: nothing is missing before it.
    pub fn count(&mut self, place: usize, origin: Option<Origin>, is_kept: bool) {
        let Some((counts, last)) = self.services.get_mut(place) else { return };
        if is_kept {
            counts.messages += 1;
        } else {
            counts.dropped += 1;
        }
        let Some(origin) = origin else { return };
        let Origin { publisher, number } = origin;
        match last.filter(|last| last.publisher == publisher).map(|last| last.number) {
            Some(before) if before < number => counts.missing += number - before - 1,
            Some(before) if before == number => return,
            // It comes late, and was counted as missing.
            Some(before) if number > MAX_FIRST && before - number < LATE => {
                counts.missing = counts.missing.saturating_sub(1);
                return;
            }
            // The first, or that of a process that began anew.
            _ => {}
        }
        *last = Some(origin);
    }

    /// What was counted; `stamp_ns`: `CLOCK_MONOTONIC` \[ns\], `foreign`: messages of other publishers.
    pub fn counts(&self, stamp_ns: u64, foreign: u64) -> Counts {
        Counts { stamp_ns, foreign, services: self.services.iter().map(|(counts, _)| counts.clone()).collect() }
    }
}

impl Counts {
    /// The counts of one service.
    pub fn of_service(&self, name: &str) -> Option<&ServiceCounts> {
        self.services.iter().find(|counts| counts.service == name)
    }

    /// Numbers that never came and messages without room, of all services but the setpoints.
    pub fn lost(&self) -> u64 {
        let known = |counts: &&ServiceCounts| counts.service != "setpoint";
        let missing: u64 = self.services.iter().filter(known).map(|counts| counts.missing).sum();
        missing + self.services.iter().map(|counts| counts.dropped).sum::<u64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn origin(publisher: u128, number: u64) -> Origin {
        Origin { publisher: Some(publisher), number }
    }

    #[test]
    fn numbers_that_never_came_are_counted_and_a_new_beginning_is_none() {
        let mut counter = Counter::new(["joint-state", "health"].into_iter());
        for number in [105, 106, 109, 109, 108, 110, 1, 2] {
            counter.count(0, Some(origin(7, number)), true);
        }
        counter.count(0, Some(origin(7, 3)), false);
        counter.count(1, None, true);
        // The counts themselves belong to no service.
        counter.count(2, None, true);
        let counts = counter.counts(7, 0);
        let states = counts.of_service("joint-state").expect("counted");
        assert_eq!((states.messages, states.missing, states.dropped), (8, 1, 1));
        assert_eq!(counts.of_service("health").map(|counts| counts.messages), Some(1));
        assert_eq!(counts.lost(), 2);
    }

    /// A daemon that is restarted within 64 sets: nothing that the first one lost comes late, and nothing new is missing.
    #[test]
    fn restart_after_few_messages_is_neither_late_nor_a_loss() {
        let missing = |messages: &[(u128, u64)]| {
            let mut counter = Counter::new(["parameters"].into_iter());
            for (publisher, number) in messages {
                counter.count(0, Some(origin(*publisher, *number)), true);
            }
            counter.counts(7, 0).of_service("parameters").expect("counted").missing
        };
        assert_eq!(missing(&[(1, 1), (1, 4), (2, 1), (2, 2), (2, 3)]), 2, "another publisher");
        assert_eq!(missing(&[(1, 1), (1, 4), (2, 3), (2, 4)]), 2, "another publisher whose first set was not seen");
        assert_eq!(missing(&[(1, 9), (1, 12), (1, 1), (1, 2), (1, 4)]), 3, "the same publisher counts from 1 again");
        assert_eq!(missing(&[(1, 3), (2, 40)]), 0, "the second one is seen from its 40th set on");
    }
}
