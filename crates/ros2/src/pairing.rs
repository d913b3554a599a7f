//! Joint states with the setpoints of their periods, which come on another topic and in any order.

use std::collections::VecDeque;

use rivet_ipc_schema::MAX_JOINTS;

/// Joint states, and setpoints, that may wait.
const QUEUE: usize = 1024;
/// Silence after which no setpoint is waited for \[ns\].
const SILENT_NS: u64 = 1_000_000_000;

/// The plan of one period; stamps are the sender's \[ns\].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Plan {
    /// When it is for.
    pub(crate) stamp_ns: i64,
    /// Positions \[rad, or m\].
    pub(crate) q: [f64; MAX_JOINTS],
    /// Velocities \[rad/s, or m/s\].
    pub(crate) qd: [f64; MAX_JOINTS],
    /// Accelerations \[rad/s^2, or m/s^2\].
    pub(crate) qdd: [f64; MAX_JOINTS],
}

/// A joint state, and what is kept of it, with its sender's stamp and its arrival on the monotonic clock \[ns\].
#[derive(Clone, Debug)]
struct Waiting<T> {
    stamp_ns: i64,
    arrival_ns: u64,
    state: T,
}

/// Puts joint states and setpoints together.
#[derive(Clone, Debug)]
pub(crate) struct Pairing<T> {
    /// Half the period: how far the stamps of a pair may be apart \[ns\].
    apart_ns: i64,
    /// How long a joint state waits for its setpoint \[ns\].
    patience_ns: u64,
    states: VecDeque<Waiting<T>>,
    plans: VecDeque<Plan>,
    last_message_ns: Option<u64>,
    unmatched: u64,
}

impl<T> Pairing<T> {
    /// `period_s`: `sample_period_s` of the robot file; `patience_s`: how long a joint state waits for its setpoint \[s\].
    pub(crate) fn new(period_s: f64, patience_s: f64) -> Pairing<T> {
        Pairing {
            apart_ns: (0.5e9 * period_s) as i64,
            patience_ns: (1e9 * patience_s) as u64,
            states: VecDeque::with_capacity(QUEUE),
            plans: VecDeque::with_capacity(QUEUE),
            last_message_ns: None,
            unmatched: 0,
        }
    }

    /// Takes a joint state in.
    pub(crate) fn state(&mut self, stamp_ns: i64, arrival_ns: u64, state: T) {
        self.states.push_back(Waiting { stamp_ns, arrival_ns, state });
    }

    /// Takes a setpoint in that came at `arrival_ns`.
    pub(crate) fn plan(&mut self, plan: Plan, arrival_ns: u64) {
        self.last_message_ns = Some(arrival_ns);
        if self.plans.len() == QUEUE {
            self.plans.pop_front();
            self.unmatched += 1;
        }
        self.plans.push_back(plan);
    }

    /// The oldest joint state with its setpoint, unless the setpoint may still come; `now_ns`: the monotonic clock.
    pub(crate) fn next(&mut self, now_ns: u64) -> Option<(T, Option<Plan>)> {
        let (stamp_ns, arrival_ns) = self.states.front().map(|state| (state.stamp_ns, state.arrival_ns))?;
        while self.plans.front().is_some_and(|plan| stamp_ns - plan.stamp_ns > self.apart_ns) {
            self.plans.pop_front();
            self.unmatched += 1;
        }
        let plan = match self.plans.front() {
            Some(plan) if plan.stamp_ns - stamp_ns <= self.apart_ns => self.plans.pop_front(),
            // The setpoints are beyond it.
            Some(_) => None,
            None => {
                let comes = self.last_message_ns.is_some_and(|last| now_ns.saturating_sub(last) < SILENT_NS);
                let patient = now_ns.saturating_sub(arrival_ns) < self.patience_ns;
                if comes && patient && self.states.len() < QUEUE {
                    return None;
                }
                None
            }
        };
        self.states.pop_front().map(|waiting| (waiting.state, plan))
    }

    /// Forgets the setpoints: the sender's clock was set.
    pub(crate) fn restart(&mut self) {
        self.unmatched += self.plans.len() as u64;
        self.plans.clear();
        self.last_message_ns = None;
    }

    /// Whether joint states wait.
    pub(crate) fn waits(&self) -> bool {
        !self.states.is_empty()
    }

    /// Setpoints that belong to no joint state.
    pub(crate) fn unmatched(&self) -> u64 {
        self.unmatched
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    fn plan(stamp_ms: i64) -> Plan {
        Plan {
            stamp_ns: stamp_ms * 1_000_000,
            q: [stamp_ms as f64; MAX_JOINTS],
            qd: [0.0; MAX_JOINTS],
            qdd: [0.0; MAX_JOINTS],
        }
    }

    fn pairing() -> Pairing<u64> {
        Pairing::new(0.002, 0.01)
    }

    #[test]
    fn pairs_equal_stamps_whichever_comes_first() {
        let mut pairing = pairing();
        pairing.plan(plan(2), 0);
        pairing.state(2_000_000, MS, 1);
        assert_eq!(pairing.next(MS), Some((1, Some(plan(2)))));
        pairing.state(4_000_000, 3 * MS, 2);
        assert_eq!(pairing.next(3 * MS), None, "its setpoint may come");
        pairing.plan(plan(4), 4 * MS);
        assert_eq!(pairing.next(4 * MS), Some((2, Some(plan(4)))));
    }

    #[test]
    fn a_state_does_not_wait_for_long_nor_for_a_silent_sender() {
        let mut pairing = pairing();
        pairing.state(2_000_000, MS, 1);
        assert_eq!(pairing.next(MS), Some((1, None)), "no setpoint has ever come");
        pairing.plan(plan(4), 2 * MS);
        pairing.state(4_000_000, 3 * MS, 2);
        assert_eq!(pairing.next(3 * MS), Some((2, Some(plan(4)))));
        pairing.state(6_000_000, 5 * MS, 3);
        assert_eq!(pairing.next(14 * MS), None);
        assert_eq!(pairing.next(15 * MS), Some((3, None)));
        pairing.state(8_000_000, 2000 * MS, 4);
        assert_eq!(pairing.next(2000 * MS), Some((4, None)));
    }

    #[test]
    fn setpoints_at_a_tenth_of_the_rate_do_not_hold_the_states_back() {
        let mut pairing = pairing();
        let mut paired = 0;
        for k in 0..100_u64 {
            let at = 2 * MS * k;
            if k % 10 == 0 {
                pairing.plan(plan(2 * k.cast_signed()), at);
            }
            pairing.state(at.cast_signed(), at, k);
            while let Some((_, plan)) = pairing.next(at) {
                paired += usize::from(plan.is_some());
            }
            assert!(pairing.states.len() <= 5, "10 ms at most");
        }
        assert_eq!((paired, pairing.unmatched()), (10, 0));
    }

    #[test]
    fn old_setpoints_are_counted() {
        let mut pairing = pairing();
        pairing.plan(plan(1), 0);
        pairing.plan(plan(3), 0);
        pairing.state(9_000_000, MS, 1);
        pairing.plan(plan(9), 0);
        assert_eq!(pairing.next(MS), Some((1, Some(plan(9)))));
        assert_eq!(pairing.unmatched(), 2);
        assert!(!pairing.waits());
    }
}
