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

/// A number that is so far behind the last one comes late; one further behind is that of a process that began anew.
const LATE: u64 = 64;

/// Counts messages as they come.
#[derive(Clone, Debug)]
pub struct Counter {
    services: Vec<(ServiceCounts, Option<u64>)>,
}

impl Counter {
    /// Counts messages of these services.
    pub fn new(services: impl Iterator<Item = &'static str>) -> Counter {
        let service = |name: &str| (ServiceCounts { service: name.to_owned(), ..ServiceCounts::default() }, None);
        Counter { services: services.map(service).collect() }
    }

    /// Counts a message of service `place` that has come; `is_kept`: whether there was room for it.
    pub fn count(&mut self, place: usize, number: Option<u64>, is_kept: bool) {
        let Some((counts, last)) = self.services.get_mut(place) else { return };
        if is_kept {
            counts.messages += 1;
        } else {
            counts.dropped += 1;
        }
        let Some(number) = number else { return };
        match *last {
            Some(before) if before < number => counts.missing += number - before - 1,
            // It comes late, and was counted as missing.
            Some(before) if before - number < LATE => {
                counts.missing = counts.missing.saturating_sub(u64::from(before != number));
                return;
            }
            // The first, or that of a process that began anew.
            _ => {}
        }
        *last = Some(number);
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

    #[test]
    fn numbers_that_never_came_are_counted_and_a_new_beginning_is_none() {
        let mut counter = Counter::new(["joint-state", "health"].into_iter());
        for number in [105, 106, 109, 109, 108, 110, 1, 2] {
            counter.count(0, Some(number), true);
        }
        counter.count(0, Some(3), false);
        counter.count(1, None, true);
        // The counts themselves belong to no service.
        counter.count(2, None, true);
        let counts = counter.counts(7, 0);
        let states = counts.of_service("joint-state").expect("counted");
        assert_eq!((states.messages, states.missing, states.dropped), (8, 1, 1));
        assert_eq!(counts.of_service("health").map(|counts| counts.messages), Some(1));
        assert_eq!(counts.lost(), 2);
    }
}
