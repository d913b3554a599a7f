//! How good the procedure was on cases whose answers are known: what `rivet blind score --json` writes.

use serde::{Deserialize, Serialize};

/// What was said of a kind of truth.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Outcome {
    /// An effect's name, `nothing` or `outside` (an effect that the library does not hold).
    pub truth: String,
    /// How often it was there.
    pub cases: usize,
    /// Said by its name; of `nothing` and `outside`: rightly not named.
    pub right: usize,
    /// Another name was said and this one listed as not to be told from it.
    pub in_class: usize,
    /// Only other names were said.
    pub wrong: usize,
    /// No name; the gap was said to be unexplained.
    pub unexplained: usize,
    /// No name, and nothing said to be wrong.
    pub missed: usize,
    /// Names said instead.
    pub said_instead: Vec<String>,
}

/// Scores of one set of cases.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Score {
    /// What the set is called.
    pub set: String,
    /// Version of the program that gave the verdicts' counts.
    pub version: String,
    /// Cases in the set.
    pub cases: usize,
    /// Effects that cannot be seen in the torque noise; they are in no count below.
    pub invisible: usize,
    /// By truth.
    pub outcomes: Vec<Outcome>,
    /// Effects named, or in a class that holds them, whose joint was right.
    pub right_joint: usize,
    /// Names beside the truth, in all cases.
    pub beside: usize,
    /// Causes with a predicted and a measured shrink.
    pub predictions: usize,
    /// Those predicted within five points.
    pub close: usize,
    /// Those within their 90 % interval.
    pub covered: usize,
}

impl Score {
    /// Effects that could be seen.
    pub fn visible(&self) -> usize {
        self.effects().map(|o| o.cases).sum()
    }

    /// Effects named, or in a class that holds them.
    pub fn named(&self) -> usize {
        self.effects().map(|o| o.right + o.in_class).sum()
    }

    /// Outcomes of effects of the library.
    pub fn effects(&self) -> impl Iterator<Item = &Outcome> {
        self.outcomes.iter().filter(|o| o.truth != "nothing" && o.truth != "outside")
    }

    /// Outcome of `nothing` or `outside`.
    pub fn outcome(&self, truth: &str) -> Option<&Outcome> {
        self.outcomes.iter().find(|o| o.truth == truth)
    }
}
