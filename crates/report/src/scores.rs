//! How good the procedure was on cases whose answers are known: what `rivet blind score --json` writes.

use serde::{Deserialize, Serialize};
use std::fmt::Write as _;

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

/// Cases of one sort: how wrong the nominal model is, and how many effects there are.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Group {
    /// Whether every value of the nominal model is wrong.
    pub wrong_nominal: bool,
    /// Effects of a case.
    pub effects: usize,
    /// Cases.
    pub cases: usize,
    /// Effects that can be seen.
    pub visible: usize,
    /// Those named, or in a class that holds them.
    pub named: usize,
    /// Of those, on the right joint.
    pub right_joint: usize,
    /// Names that are none of the case's effects.
    pub beside: usize,
}

impl Group {
    /// Harmonic mean of the share of effects that are named and the share of names that are right.
    pub fn f1(&self) -> f64 {
        2.0 * self.named as f64 / (self.visible + self.named + self.beside).max(1) as f64
    }
}

/// How often what lies between two figures was right.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Bin {
    /// From here,
    pub from: f64,
    /// up to below here.
    pub to: f64,
    /// How many.
    pub count: usize,
    /// Of those, right.
    pub right: usize,
    /// Mean of the figure.
    pub mean: f64,
}

impl Bin {
    /// Empty bins between each two of `edges`.
    pub fn between(edges: &[f64]) -> Vec<Bin> {
        edges.windows(2).map(|w| Bin { from: w[0], to: w[1], ..Bin::default() }).collect()
    }

    /// Counts one.
    pub fn add(bins: &mut [Bin], value: f64, right: bool) {
        if let Some(bin) = bins.iter_mut().find(|bin| bin.from <= value && value < bin.to) {
            bin.mean += (value - bin.mean) / (bin.count + 1) as f64;
            bin.count += 1;
            bin.right += usize::from(right);
        }
    }
}

/// A cause's shrink, predicted and then measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Prediction {
    /// Its name.
    pub effect: String,
    /// Before the held-out torque was read.
    pub predicted: f64,
    /// 90 % interval.
    pub low: f64,
    /// Its other end.
    pub high: f64,
    /// On the held-out torque.
    pub measured: f64,
}

/// Scores of one set of cases.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Score {
    /// What the set is called.
    pub set: String,
    /// Version of the program that gave the verdicts' counts.
    pub version: String,
    /// Cases in the set.
    pub cases: usize,
    /// Effects that cannot be seen in the torque noise: whether they are named counts neither way.
    pub invisible: usize,
    /// Cases in which no effect can be seen.
    pub invisible_cases: usize,
    /// Names in those that are none of their effects.
    pub invisible_beside: usize,
    /// By truth.
    pub outcomes: Vec<Outcome>,
    /// Effects named, or in a class that holds them, whose joint was right.
    pub right_joint: usize,
    /// Names beside the truth, in all cases.
    pub beside: usize,
    /// Names in all cases.
    pub names: usize,
    /// Of those, such that stand for a class.
    pub classes: usize,
    /// Others in these classes: naming everything would be right and say nothing.
    pub class_members: usize,
    /// Causes with a predicted and a measured shrink.
    pub predictions: usize,
    /// Those predicted within five points.
    pub close: usize,
    /// Those within their 90 % interval.
    pub covered: usize,
    /// By nominal model and number of effects; what no library holds is in none of them.
    pub groups: Vec<Group>,
    /// Effects by their torque over the noise; right: named, or in a class that holds them.
    pub strength: Vec<Bin>,
    /// Causes by their confidence; right: one of the case's effects by its own name.
    pub confidence: Vec<Bin>,
    /// Each cause's shrink.
    pub shrinks: Vec<Prediction>,
}

/// The figures of several sets beside each other in Markdown, then how often causes of each range of confidence were right.
#[must_use]
pub fn markdown(scores: &[Score]) -> String {
    let mut out = String::new();
    let mut table = |first: &str, rows: &[(String, Vec<String>)]| {
        if !out.is_empty() {
            out.push('\n');
        }
        let sets: Vec<String> = scores.iter().map(|score| format!("{}, {} cases", score.set, score.cases)).collect();
        // Writing to a String cannot fail.
        let _ = writeln!(out, "| {first} | {} |", sets.join(" | "));
        let _ = writeln!(out, "|---{}|", "|---".repeat(sets.len()));
        for (name, cells) in rows {
            let _ = writeln!(out, "| {name} | {} |", cells.join(" | "));
        }
    };
    let figures: Vec<Vec<(&str, String)>> = scores.iter().map(Score::summary).collect();
    let names = figures.first().map_or(&[][..], Vec::as_slice).iter().map(|(name, _)| *name);
    let of = |k: usize| figures.iter().map(|figures| figures[k].1.clone()).collect();
    let rows: Vec<_> = names.enumerate().map(|(k, name)| (name.to_owned(), of(k))).collect();
    table("figure", &rows);
    let range = |from: f64, to: f64| if to > 1.0 { format!("{from} and more") } else { format!("{from} to {to}") };
    let cell = |score: &Score, k: usize| match score.confidence.get(k) {
        Some(bin) if bin.count > 0 => format!("{} of {}", bin.right, bin.count),
        _ => "-".to_owned(),
    };
    let rows: Vec<_> = CONFIDENCES
        .windows(2)
        .enumerate()
        .map(|(k, w)| (range(w[0], w[1]), scores.iter().map(|score| cell(score, k)).collect()))
        .collect();
    table("confidence: right", &rows);
    out
}

/// Edges of [`Score::strength`].
pub const STRENGTHS: [f64; 6] = [0.5, 1.0, 2.0, 5.0, 20.0, f64::MAX];
/// Edges of [`Score::confidence`].
pub const CONFIDENCES: [f64; 6] = [0.0, 0.5, 0.8, 0.9, 0.97, 1.01];

impl Score {
    /// What was found of how many: a figure and its value a line. An effect counts as named if its class holds it.
    #[must_use]
    pub fn summary(&self) -> Vec<(&'static str, String)> {
        let share = |part: usize, whole: usize| {
            if whole == 0 { "no case".to_owned() } else { format!("{part} of {whole}") }
        };
        let misnamed =
            |truth: &str| self.outcome(truth).map_or_else(|| share(0, 0), |o| share(o.cases - o.right, o.cases));
        vec![
            ("visible effects named", share(self.named(), self.visible())),
            ("right joint, of those", share(self.right_joint, self.named())),
            ("false positives", self.beside.to_string()),
            (
                "the same where no effect is visible",
                format!("{} in {} cases", self.invisible_beside, self.invisible_cases),
            ),
            ("names that stand for a class", share(self.classes, self.names)),
            ("other members of these classes", self.class_members.to_string()),
            ("named on sound arms", misnamed("nothing")),
            ("outside the list, misnamed", misnamed("outside")),
            ("±5 points", share(self.close, self.predictions)),
            ("in the interval", share(self.covered, self.predictions)),
        ]
    }

    /// [`Score::summary`] as a table in Markdown.
    #[must_use]
    pub fn markdown(&self) -> String {
        let mut out = format!("| figure | {}, {} cases |\n|---|---|\n", self.set, self.cases);
        for (figure, value) in self.summary() {
            let _ = writeln!(out, "| {figure} | {value} |");
        }
        out
    }

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn f1_is_the_harmonic_mean_of_recall_and_precision() {
        let group = Group { visible: 8, named: 6, beside: 4, ..Group::default() };
        let (recall, precision) = (6.0 / 8.0, 6.0 / 10.0);
        assert!((group.f1() - 2.0 * recall * precision / (recall + precision)).abs() < 1e-12);
        assert_eq!(Group { visible: 5, named: 5, ..Group::default() }.f1(), 1.0);
        assert_eq!(Group { visible: 5, beside: 3, ..Group::default() }.f1(), 0.0);
        assert_eq!(Group::default().f1(), 0.0, "an empty group is no division by zero");
    }

    #[test]
    fn sets_stand_beside_each_other() {
        let mut confidence = Bin::between(&CONFIDENCES);
        Bin::add(&mut confidence, 0.97, true);
        let of =
            |set: &str, confidence: Vec<Bin>| Score { set: set.to_owned(), cases: 3, confidence, ..Score::default() };
        let text = markdown(&[of("a", confidence), of("b", Vec::new())]);
        assert!(
            text.starts_with("| figure | a, 3 cases | b, 3 cases |\n|---|---|---|\n| visible effects named |"),
            "{text}"
        );
        assert!(text.contains("\n\n| confidence: right | a, 3 cases | b, 3 cases |\n"), "{text}");
        assert!(text.ends_with("| 0.97 and more | 1 of 1 | - |\n"), "{text}");
    }

    #[test]
    fn a_figure_falls_into_the_bin_that_begins_with_it() {
        let mut bins = Bin::between(&[0.0, 1.0, 2.0]);
        for (value, right) in [(0.5, true), (1.0, true), (1.5, false), (2.0, true), (-0.1, true)] {
            Bin::add(&mut bins, value, right);
        }
        let said: Vec<(usize, usize, f64)> = bins.iter().map(|bin| (bin.count, bin.right, bin.mean)).collect();
        assert_eq!(said, [(1, 1, 0.5), (2, 1, 1.25)], "what is outside is in none");
    }
}
