//! What is wrong with what comes, and what to do about it.

use std::collections::BTreeMap;

/// Time for which a problem counts as present after it was met last \[ns\].
const PRESENT_NS: u64 = 5_000_000_000;

/// A kind of problem.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Problem {
    /// Messages were lost on their way.
    Lost,
    /// A message is no message of its type.
    Malformed,
    /// Joints of the arm are missing in joint states, or there twice.
    Joints,
    /// The arrays of a joint state do not fit its names.
    Lengths,
    /// Joint states have no effort.
    NoEffort,
    /// An effort is not finite.
    EffortNotFinite,
    /// A position is not finite.
    PositionNotFinite,
    /// A stamp is not later than the one before.
    StampBack,
    /// Stamps are 0.
    NoStamp,
    /// The clock of the stamps was set.
    ClockStep,
    /// Joint states come at another rate than the robot file says.
    Rate,
    /// A second publisher sends joint states of this arm.
    OtherPublisher,
    /// A second publisher sends setpoints.
    OtherPlanner,
    /// Setpoints have no velocities or accelerations, or are not finite.
    Plan,
    /// Joints of the arm are missing in setpoints.
    PlanJoints,
    /// Setpoints belong to no joint state.
    PlanUnmatched,
    /// A publisher offers best effort, so that losses are not repaired.
    BestEffort,
    /// The description on the graph is of another arm.
    OtherArm,
    /// The bus did not take a sample.
    Bus,
    /// A message could not be sent on the graph.
    NotSent,
}

impl Problem {
    /// Whether samples are not used while it is present.
    pub fn is_serious(self) -> bool {
        matches!(
            self,
            Problem::Joints | Problem::Lengths | Problem::NoEffort | Problem::Rate | Problem::OtherArm | Problem::Bus
        )
    }
}

/// A problem that was met.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Met {
    /// How often.
    pub count: u64,
    /// When it was met last, `CLOCK_MONOTONIC` \[ns\].
    pub at_ns: u64,
    /// The first one: what was found, and what to do.
    pub text: String,
}

/// The problems that were met.
#[derive(Clone, Debug, Default)]
pub struct Problems {
    met: BTreeMap<Problem, Met>,
    news: Vec<Problem>,
}

impl Problems {
    /// Counts `times` of a problem at `now_ns`; `text` is asked for only the first time.
    pub fn count(&mut self, problem: Problem, times: u64, now_ns: u64, text: impl FnOnce() -> String) {
        let met = self.met.entry(problem).or_insert_with(|| {
            self.news.push(problem);
            Met { count: 0, at_ns: now_ns, text: text() }
        });
        met.count += times;
        met.at_ns = now_ns;
    }

    /// The problems that were met for the first time since the last call.
    pub fn news(&mut self) -> Vec<String> {
        std::mem::take(&mut self.news)
            .into_iter()
            .filter_map(|problem| Some(self.met.get(&problem)?.text.clone()))
            .collect()
    }

    /// All problems that were met.
    pub fn met(&self) -> impl Iterator<Item = (Problem, &Met)> {
        self.met.iter().map(|(problem, met)| (*problem, met))
    }

    /// How often a problem was met.
    pub fn times(&self, problem: Problem) -> u64 {
        self.met.get(&problem).map_or(0, |met| met.count)
    }

    /// The problems that are present at `now_ns`.
    pub fn present(&self, now_ns: u64) -> impl Iterator<Item = (Problem, &Met)> {
        self.met().filter(move |(_, met)| now_ns.saturating_sub(met.at_ns) < PRESENT_NS)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_problem_is_news_once_and_present_for_a_while() {
        let mut problems = Problems::default();
        problems.count(Problem::NoStamp, 1, 0, || "first".to_owned());
        problems.count(Problem::NoStamp, 2, 1_000_000_000, || panic!("asked for once"));
        assert_eq!(problems.news(), ["first"]);
        assert_eq!(problems.news(), [""; 0]);
        assert_eq!(problems.times(Problem::NoStamp), 3);
        assert_eq!(problems.present(5_999_999_999).count(), 1);
        assert_eq!(problems.present(6_000_000_000).count(), 0);
    }
}
