//! Verdicts against answers that were withheld: how many names were right.

use serde::Deserialize;

use crate::scores::{Bin, CONFIDENCES, Group, Outcome, Prediction, STRENGTHS, Score};

/// Effects with less torque than this, in units of the torque noise, nobody can see.
const VISIBLE: f64 = 0.5;
/// The effect of a gear that is elastic.
const ELASTICITY: &str = "joint_elasticity";
/// A prediction is good within so much of the measured shrink.
const CLOSE: f64 = 0.05;
/// Wrong values that are right to name, but no answer, where the nominal model is wrong throughout.
const VALUES: [&str; 4] = ["link_inertia", "rotor_inertia", "coulomb_friction", "viscous_friction"];

/// What a case holds.
#[derive(Debug, Deserialize)]
pub struct Answer {
    effects: Vec<True>,
    torque_change_over_noise: Vec<f64>,
    /// How wrong every value of the nominal model is; 0 or absent where they are those of the arm.
    nominal_error: Option<f64>,
    /// Torque of each joint's own elastic gear over the noise, of an arm that has elastic gears beside its effects.
    #[serde(default)]
    gear_elasticity_over_noise: Vec<f64>,
}

#[derive(Debug, Deserialize)]
struct True {
    effect: String,
    joints: Vec<usize>,
    /// Of this effect alone; not every generator tells.
    torque_change_over_noise: Option<Vec<f64>>,
}

/// What a diagnosis says of a case.
#[derive(Debug, Deserialize)]
pub struct Found {
    verdict: String,
    #[serde(default)]
    causes: Vec<Cause>,
    #[serde(default)]
    gap: GapOf,
}

#[derive(Debug, Deserialize, Default)]
struct GapOf {
    #[serde(default)]
    per_joint: Vec<Joint>,
}

#[derive(Debug, Deserialize)]
struct Joint {
    joint: String,
}

#[derive(Debug, Deserialize)]
struct Cause {
    effect: String,
    joints: Vec<String>,
    shrink: Shrink,
    #[serde(default)]
    confidence: Option<f64>,
    indistinguishable_from: Vec<String>,
}

impl Found {
    /// The verdict, as it stands in JSON.
    pub fn verdict(&self) -> &str {
        &self.verdict
    }

    /// The effects that count as names.
    pub fn names(&self, answer: &Answer) -> Vec<&str> {
        self.causes.iter().filter(|c| counts(answer, c)).map(|c| c.effect.as_str()).collect()
    }
}

impl Cause {
    /// Whether it is the effect, or in a class with it; effects and values alike.
    fn is(&self, truth: &True) -> bool {
        self.effect == truth.effect || self.indistinguishable_from.contains(&truth.effect)
    }
}

impl Answer {
    /// Names of its effects.
    pub fn effects(&self) -> Vec<&str> {
        self.effects.iter().map(|e| e.effect.as_str()).collect()
    }

    /// Whether a cause on joints (from 0) is of the case: one of its effects, or a gear of the arm whose elasticity can be seen.
    fn has(&self, cause: &Cause, joints: &[usize], is: impl Fn(&True) -> bool) -> bool {
        let seen = |joint: &usize| self.gear_elasticity_over_noise.get(*joint).is_some_and(|torque| *torque > VISIBLE);
        let is_gear = cause.effect == ELASTICITY && !joints.is_empty() && joints.iter().all(seen);
        is_gear || self.effects.iter().any(is)
    }

    /// Whether every value of the nominal model is wrong.
    fn is_file_wrong(&self) -> bool {
        self.nominal_error.is_some_and(|error| error > 0.0)
    }

    /// Whether the case holds an effect that no library has (`outside`, `outside:hose_hysteresis`).
    fn is_outside(&self) -> bool {
        self.effects.iter().any(|e| e.effect.split(':').next() == Some("outside"))
    }

    /// Largest torque of an effect on any joint, over the noise.
    fn strength(&self, truth: &True) -> f64 {
        let change = truth.torque_change_over_noise.as_ref().unwrap_or(&self.torque_change_over_noise);
        change.iter().fold(0.0_f64, |m, t| m.max(*t))
    }
}

#[derive(Debug, Deserialize)]
struct Shrink {
    predicted: Option<f64>,
    low: Option<f64>,
    high: Option<f64>,
    measured: Option<f64>,
}

/// Whether a cause counts as a name: wrong values do not where all values are wrong, unless their class holds something else.
fn counts(answer: &Answer, cause: &Cause) -> bool {
    let mut class = std::iter::once(&cause.effect).chain(&cause.indistinguishable_from);
    !answer.is_file_wrong() || class.any(|name| !VALUES.contains(&name.as_str()))
}

/// Scores in the making.
#[derive(Debug)]
pub struct Tally(Score);

impl Tally {
    /// Of a set of so many cases; `version` is that of the program that gave the verdicts' counts.
    pub fn new(set: String, version: &str, cases: usize) -> Tally {
        Tally(Score {
            set,
            version: version.to_owned(),
            cases,
            strength: Bin::between(&STRENGTHS),
            confidence: Bin::between(&CONFIDENCES),
            ..Score::default()
        })
    }

    /// The scores.
    pub fn finish(mut self) -> Score {
        self.0.outcomes.sort_by(|a, b| a.truth.cmp(&b.truth));
        self.0.groups.sort_by_key(|g| (g.wrong_nominal, g.effects));
        self.0
    }

    /// Adds a case; returns a word on it.
    pub fn add(&mut self, answer: &Answer, found: &Found) -> String {
        self.shrinks(found);
        let names: Vec<&Cause> = found.causes.iter().filter(|c| counts(answer, c)).collect();
        let place = |name: &String| found.gap.per_joint.iter().position(|j| j.joint == *name);
        let joints = |cause: &Cause| cause.joints.iter().filter_map(place).collect::<Vec<usize>>();
        for cause in &names {
            self.0.names += 1;
            self.0.classes += usize::from(!cause.indistinguishable_from.is_empty());
            self.0.class_members += cause.indistinguishable_from.len();
            if let Some(sure) = cause.confidence {
                let right = answer.has(cause, &joints(cause), |t| cause.effect == t.effect);
                Bin::add(&mut self.0.confidence, sure, right);
            }
        }
        if answer.is_outside() {
            self.outcome("outside", names.is_empty(), false, found, &names);
            return if names.is_empty() { String::new() } else { "misnamed".to_owned() };
        }
        let beside = |c: &&&Cause| !answer.has(c, &joints(c), |t| c.is(t));
        let false_names = names.iter().filter(beside).count();
        self.0.beside += false_names;
        let group = self.group(answer);
        group.cases += 1;
        group.beside += false_names;
        if answer.effects.is_empty() {
            self.outcome("nothing", names.is_empty(), false, found, &names);
            return if names.is_empty() { String::new() } else { "false alarm".to_owned() };
        }
        let mut words = Vec::new();
        let seen = |truth: &&True| answer.strength(truth) > VISIBLE;
        if !answer.effects.iter().any(|truth| seen(&truth)) {
            self.0.invisible_cases += 1;
            self.0.invisible_beside += false_names;
            words.push("not visible");
        }
        self.0.invisible += answer.effects.iter().filter(|truth| !seen(truth)).count();
        for truth in answer.effects.iter().filter(seen) {
            let named = names.iter().find(|c| c.effect == truth.effect);
            let in_class = names.iter().find(|c| c.is(truth));
            // What another cause of the case is right about is not said instead of this one.
            let instead: Vec<&Cause> = names.iter().filter(beside).copied().collect();
            self.outcome(&truth.effect, named.is_some(), in_class.is_some(), found, &instead);
            let cause = named.or(in_class);
            Bin::add(&mut self.0.strength, answer.strength(truth), cause.is_some());
            let right = cause.is_some_and(|cause| {
                let joints = joints(cause);
                // An effect of the whole arm, or of the flange, needs no joint.
                let whole = cause.joints.is_empty() || truth.joints.len() == found.gap.per_joint.len();
                whole || truth.joints.iter().all(|j| joints.contains(j))
            });
            self.0.right_joint += usize::from(right);
            let group = self.group(answer);
            group.visible += 1;
            group.named += usize::from(cause.is_some());
            group.right_joint += usize::from(right);
            match (cause, right) {
                (None, _) => words.push("missed"),
                (Some(_), false) => words.push("wrong joint"),
                (Some(_), true) => {}
            }
        }
        if false_names > 0 {
            words.push("and more");
        }
        words.join(", ")
    }

    /// Shrinks, whatever the cause is.
    fn shrinks(&mut self, found: &Found) {
        for cause in &found.causes {
            let Shrink { predicted: Some(predicted), low, high, measured: Some(measured) } = cause.shrink else {
                continue;
            };
            let (low, high) = (low.unwrap_or(predicted), high.unwrap_or(predicted));
            self.0.predictions += 1;
            self.0.close += usize::from((predicted - measured).abs() <= CLOSE);
            self.0.covered += usize::from(low <= measured && measured <= high);
            self.0.shrinks.push(Prediction { effect: cause.effect.clone(), predicted, low, high, measured });
        }
    }

    /// Where cases like this one are counted.
    fn group(&mut self, answer: &Answer) -> &mut Group {
        let (wrong_nominal, effects) = (answer.is_file_wrong(), answer.effects.len());
        let groups = &mut self.0.groups;
        let place = groups.iter().position(|g| g.wrong_nominal == wrong_nominal && g.effects == effects);
        let place = place.unwrap_or_else(|| {
            groups.push(Group { wrong_nominal, effects, ..Group::default() });
            groups.len() - 1
        });
        &mut groups[place]
    }

    /// Counts what was said of one truth.
    fn outcome(&mut self, truth: &str, right: bool, in_class: bool, found: &Found, names: &[&Cause]) {
        let place = self.0.outcomes.iter().position(|o| o.truth == truth).unwrap_or_else(|| {
            self.0.outcomes.push(Outcome { truth: truth.to_owned(), ..Outcome::default() });
            self.0.outcomes.len() - 1
        });
        let outcome = &mut self.0.outcomes[place];
        outcome.cases += 1;
        match () {
            () if right => outcome.right += 1,
            () if in_class => outcome.in_class += 1,
            () if !names.is_empty() => {
                outcome.wrong += 1;
                outcome.said_instead.extend(names.iter().map(|c| c.effect.clone()));
            }
            () if found.verdict == "unexplained" => outcome.unexplained += 1,
            () => outcome.missed += 1,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Value, json};

    fn answer(effects: &Value, wrong_nominal: bool) -> Answer {
        let mut answer = json!({ "effects": effects, "torque_change_over_noise": [0.1, 3.0] });
        if wrong_nominal {
            answer["nominal_error"] = json!(0.1);
        }
        serde_json::from_value(answer).expect("an answer")
    }

    fn found(verdict: &str, causes: &[(&str, &[&str], &[&str])]) -> Found {
        let cause = |(effect, joints, class): &(&str, &[&str], &[&str])| {
            json!({
                "effect": effect, "joints": joints, "indistinguishable_from": class, "confidence": 0.9,
                "shrink": { "predicted": 0.5, "low": 0.4, "high": 0.6, "measured": 0.58 },
            })
        };
        let causes: Vec<Value> = causes.iter().map(cause).collect();
        let gap = json!({ "per_joint": [{ "joint": "a" }, { "joint": "b" }] });
        serde_json::from_value(json!({ "verdict": verdict, "causes": causes, "gap": gap })).expect("a verdict")
    }

    fn tally(cases: &[(Answer, Found)]) -> (Tally, Vec<String>) {
        let mut tally = Tally(Score {
            strength: Bin::between(&STRENGTHS),
            confidence: Bin::between(&CONFIDENCES),
            ..Score::default()
        });
        let words = cases.iter().map(|(answer, found)| tally.add(answer, found)).collect();
        (tally, words)
    }

    fn one(effect: &str, joints: &[usize]) -> Value {
        json!([{ "effect": effect, "joints": joints }])
    }

    #[test]
    fn a_name_a_class_a_wrong_joint_and_a_miss_are_told_apart() {
        let (tally, words) = tally(&[
            (answer(&one("backlash", &[1]), false), found("gap", &[("backlash", &["b"], &[])])),
            (answer(&one("backlash", &[1]), false), found("gap", &[("elasticity", &["b"], &["backlash"])])),
            (answer(&one("backlash", &[1]), false), found("gap", &[("backlash", &["a"], &[])])),
            (answer(&one("backlash", &[1]), false), found("gap", &[("payload", &[], &[])])),
            (answer(&one("backlash", &[1]), false), found("unexplained", &[])),
        ]);
        assert_eq!(words, ["", "", "wrong joint", "missed, and more", "missed"]);
        let Outcome { cases, right, in_class, wrong, unexplained, missed, said_instead, .. } = &tally.0.outcomes[0];
        assert_eq!((*cases, *right, *in_class, *wrong, *unexplained, *missed), (5, 2, 1, 1, 1, 0));
        assert_eq!(said_instead, &["payload"]);
        let Group { visible, named, right_joint, beside, .. } = &tally.0.groups[0];
        assert_eq!((*visible, *named, *right_joint, *beside), (5, 3, 2, 1));
        // Right by its own name: two of four causes that said how sure they are.
        let sure: Vec<_> = tally.0.confidence.iter().map(|bin| (bin.count, bin.right)).filter(|b| b.0 > 0).collect();
        assert_eq!(sure, [(4, 2)]);
        // 0.5 for 0.58: not within five points, within its interval.
        assert_eq!((tally.0.predictions, tally.0.close, tally.0.covered), (4, 0, 4));
    }

    #[test]
    fn a_gear_of_the_arm_that_is_elastic_is_no_false_name() {
        let elastic = |gears: &[f64]| {
            let mut answer = json!({ "effects": [], "torque_change_over_noise": [0.0, 0.0] });
            answer["gear_elasticity_over_noise"] = json!(gears);
            serde_json::from_value::<Answer>(answer).expect("an answer")
        };
        let named = || found("effect", &[(ELASTICITY, &["b"], &[])]);
        let (tally, _) =
            tally(&[(elastic(&[0.0, 2.0]), named()), (elastic(&[2.0, 0.1]), named()), (elastic(&[]), named())]);
        assert_eq!(tally.0.beside, 2);
        let sure: Vec<_> = tally.0.confidence.iter().map(|bin| (bin.count, bin.right)).filter(|b| b.0 > 0).collect();
        assert_eq!(sure, [(3, 1)]);
    }

    #[test]
    fn an_effect_of_no_library_may_have_a_name_and_a_file_with_an_error_of_0_is_exact() {
        let hose = answer(&one("outside:hose_hysteresis", &[0]), false);
        let (tally, words) = tally(&[(hose, found("effect", &[("backlash", &["a"], &[])]))]);
        assert_eq!((words[0].as_str(), tally.0.outcomes[0].truth.as_str()), ("misnamed", "outside"));
        let mut exact = answer(&one("rotor_inertia", &[1]), true);
        exact.nominal_error = Some(0.0);
        assert!(counts(&exact, &found("parameter", &[("rotor_inertia", &["b"], &[])]).causes[0]));
    }

    #[test]
    fn a_name_where_nothing_is_wrong_or_nothing_fits_is_a_false_alarm() {
        let (tally, words) = tally(&[
            (answer(&json!([]), false), found("no_gap", &[])),
            (answer(&json!([]), false), found("gap", &[("payload", &[], &[])])),
            (answer(&one("outside", &[0]), false), found("unexplained", &[])),
            (answer(&one("outside", &[0]), false), found("gap", &[("backlash", &["a"], &[])])),
        ]);
        assert_eq!(words, ["", "false alarm", "", "misnamed"]);
        let right: Vec<_> = tally.0.outcomes.iter().map(|o| (o.truth.as_str(), o.cases, o.right)).collect();
        assert_eq!(right, [("nothing", 2, 1), ("outside", 2, 1)]);
    }

    /// Where every value is wrong, saying so of a value is right and answers nothing: it counts neither way.
    #[test]
    fn values_count_only_where_the_nominal_model_is_exact() {
        let verdict = || found("gap", &[("rotor_inertia", &["a"], &[])]);
        let (tally, words) = tally(&[(answer(&json!([]), true), verdict()), (answer(&json!([]), false), verdict())]);
        assert_eq!(words, ["", "false alarm"]);
        let groups: Vec<_> = tally.0.groups.iter().map(|g| (g.wrong_nominal, g.beside)).collect();
        assert_eq!(groups, [(true, 0), (false, 1)]);
    }

    /// A class of a value and an effect holds both, whichever is named; an effect in it is no free guess.
    #[test]
    fn a_class_of_a_value_and_an_effect_counts_as_a_name() {
        let value_first = || found("gap", &[("coulomb_friction", &["b"], &["friction_asymmetry"])]);
        let effect_first = || found("gap", &[("friction_asymmetry", &["b"], &["coulomb_friction"])]);
        let cases = |said: &dyn Fn() -> Found| {
            [
                (answer(&one("friction_asymmetry", &[1]), true), said()),
                (answer(&one("coulomb_friction", &[1]), false), said()),
                (answer(&json!([]), true), said()),
                (answer(&one("backlash", &[1]), true), said()),
            ]
        };
        for said in [&value_first as &dyn Fn() -> Found, &effect_first] {
            let (tally, words) = tally(&cases(said));
            assert_eq!(words, ["", "", "false alarm", "missed, and more"]);
            assert_eq!((tally.0.names, tally.0.classes, tally.0.class_members), (4, 4, 4));
        }
    }

    #[test]
    fn what_nobody_can_see_need_not_be_named() {
        let faint = json!([{ "effect": "backlash", "joints": [0], "torque_change_over_noise": [0.2, 0.1] }]);
        let (tally, words) = tally(&[
            (answer(&faint, false), found("no_gap", &[])),
            (answer(&faint, false), found("gap", &[("payload", &[], &[])])),
        ]);
        assert_eq!(words, ["not visible", "not visible, and more"]);
        assert_eq!((tally.0.invisible, tally.0.invisible_cases, tally.0.invisible_beside), (2, 2, 1));
        assert_eq!(tally.0.visible(), 0);
    }
}
