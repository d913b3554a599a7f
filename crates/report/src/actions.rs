//! What to do about a diagnosis, cause by cause, and what it brings.

use crate::document::{Cause, Document, JointGap, Parameter, is_contact};
use crate::scores::{Bin, Score};
use crate::words::{effect, figure, joints_in_short, parameter_label, printed_unit, quantity_of, rival, value_label};

/// Values of the model in one line. Of more, the line has the largest change, and the table of parameters has all.
const VALUES: usize = 3;
/// Confidence from which a cause stands among the first, and from which its line says what to do: below, what to check.
const SURE: f64 = 0.8;
const LIKELY: f64 = 0.5;
/// Digits of a size: more where the ends of its interval would be the same.
const DIGITS: [i32; 3] = [3, 4, 5];
/// Sizes that are factors, and the words for what they multiply.
const FACTORS: [(&str, [&str; 2]); 3] = [
    ("mass_gain", ["mass and inertia", "the file's"]),
    ("inertia_gain", ["inertia", "the file's"]),
    ("gain", ["torque at the joint", "the reported one"]),
];
/// Residual in motion over the noise from which another joint is named beside the worst one.
const KEEPS: f64 = 2.0;
/// A simulator further from the arm than this has lost it \[rad\]: no joint follows its plan any more.
pub(crate) const LOST: f64 = 1.0;
/// A figure that grew by more than this factor is worse.
const WORSE: f64 = 1.005;
/// What is known of the forces of contacts (docs/limits.md, sizes).
const FORCE_CAUTION: &str = " As a force at the flange; peaks come out 1.4 to 3 times too large.";
/// Confidence in words, on blind cases, needs so many names of that confidence.
const FEWEST_NAMES: usize = 20;
/// Confidence from which on ranges are one.
const HIGH: f64 = 0.9;

/// Residual in motion of a joint over its noise: nominal model, all causes.
struct Motion<'a> {
    name: &'a str,
    before: f64,
    after: f64,
}

impl Motion<'_> {
    fn is_worse(&self) -> bool {
        self.after > WORSE * self.before
    }
}

impl Document {
    /// One line a cause, in their order: what to do, with number, unit, interval and confidence. `scores` are those of cases whose
    /// answers are known.
    pub fn actions(&self, scores: &[Score]) -> Vec<String> {
        self.actions_of(&self.causes.iter().collect::<Vec<_>>(), scores)
    }

    /// The same in the order of a reader: what is sure, what is likely, what to check; of each, missing effects before wrong values, and
    /// of these what takes the largest share of the gap first.
    pub(crate) fn actions_by_weight(&self, scores: &[Score]) -> Vec<String> {
        self.actions_of(&self.causes_by_weight(), scores)
    }

    /// The causes in the order of [`Document::actions_by_weight`].
    pub(crate) fn causes_by_weight(&self) -> Vec<&Cause> {
        let mut causes: Vec<&Cause> = self.causes.iter().collect();
        let share = |cause: &Cause| cause.share.unwrap_or(0.0);
        let rank = |cause: &Cause| (!is_at_least(cause, SURE), !is_at_least(cause, LIKELY), cause.is_value());
        causes.sort_by(|a, b| rank(a).cmp(&rank(b)).then(share(b).total_cmp(&share(a))));
        causes
    }

    /// How often names of a range were right is stated once a range.
    fn actions_of(&self, causes: &[&Cause], scores: &[Score]) -> Vec<String> {
        let mut stated: Vec<String> = Vec::new();
        let mut lines = Vec::new();
        for cause in causes {
            let rate = rate(cause, scores);
            lines.push(self.action(cause, if stated.contains(&rate) { "" } else { &rate }));
            stated.push(rate);
        }
        lines
    }

    fn action(&self, cause: &Cause, rate: &str) -> String {
        let sizes = self.action_sizes(cause);
        let sizes = if sizes.is_empty() { String::new() } else { format!(": {}", sizes.join(", ")) };
        let rivals: Vec<String> = cause.indistinguishable_from.iter().map(|name| rival(name)).collect();
        let or = if rivals.is_empty() {
            String::new()
        } else {
            format!(" These logs do not separate it from {}.", rivals.join(" or "))
        };
        let caution = match cause.effect.as_str() {
            // Else the limit seems refuted by the measured torque.
            "torque_saturation" => " Beyond it the log holds the command: the joint gets no more.",
            _ if is_contact(cause) => FORCE_CAUTION,
            _ => "",
        };
        let sure = cause.confidence.map_or_else(String::new, |sure| format!(" Confidence {sure:.2}{rate}."));
        format!("{}{sizes}.{caution}{sure}{or}", self.deed(cause))
    }

    /// Verb, effect and joints: what to do about a likely cause, what to check of another.
    fn deed(&self, cause: &Cause) -> String {
        let (what, on) = (effect(&cause.effect), joints_in_short(&cause.joints, self.gap.per_joint.len()));
        let of = if cause.joints.is_empty() { String::new() } else { format!(" of {on}") };
        let likely = is_at_least(cause, LIKELY);
        match cause.effect.as_str() {
            _ if is_contact(cause) && likely => format!("Keep away what touched {on}"),
            _ if is_contact(cause) => format!("Check whether something touched {on}"),
            "payload" if likely => "Add a payload at the flange".to_owned(),
            "payload" => "Check whether the flange carries a payload".to_owned(),
            "encoder_offset" => format!("{} joint_zero{of}", if likely { "Correct" } else { "Check" }),
            _ if cause.is_value() => format!("{} {what}{of}", if likely { "Set" } else { "Check" }),
            _ if !likely => format!("Check whether {what} acts on {on}"),
            _ if cause.joints.is_empty() => format!("Add {what}"),
            _ => format!("Add {what} to {on}"),
        }
    }

    /// Sizes with units and 90 % intervals: values of the model from the file's to the one found, the largest changes first.
    fn action_sizes(&self, cause: &Cause) -> Vec<String> {
        let sized = |name: &String, value: f64| {
            let Some([low, high]) = cause.magnitude_interval.get(name).filter(|[low, high]| low < high) else {
                return figure(value, DIGITS[0]);
            };
            let digits = digits_apart(*low, *high);
            format!("{} [{}, {}]", figure(value, digits), figure(*low, digits), figure(*high, digits))
        };
        let known = || cause.magnitude.iter().filter_map(|(name, value)| Some((name, (*value)?)));
        let values = self.changed_values(cause);
        if values.is_empty() {
            // What persists before peaks, masses before where they are.
            let is_first = |name: &String| ["mass_kg", "steady_N"].contains(&name.as_str());
            let (first, others): (Vec<_>, Vec<_>) = known().partition(|(name, _)| is_first(name));
            let one = |(name, value): (&String, f64)| {
                let value = sized(name, value);
                if let Some([what, of]) = FACTORS.iter().find_map(|(factor, words)| (factor == name).then_some(words)) {
                    return format!("{what} {value} times {of}");
                }
                let (label, unit) = quantity_of(name, &cause.joints, self);
                format!("{label} {value} {unit}").trim_end().to_owned()
            };
            return first.into_iter().chain(others).map(one).collect();
        }
        let listed = if values.len() > VALUES { 1 } else { values.len() };
        let more = values.len() - listed;
        let one = |(parameter, value): &(&Parameter, f64)| {
            let given = parameter.given.map_or_else(String::new, |given| format!("{} \u{2192} ", figure(given, 3)));
            let unit = printed_unit(&parameter.unit);
            // "Set rotor inertia of wrist" has said whose it is.
            let label = Some(parameter_label(parameter, self)).filter(|label| cause.joints != [label.as_str()]);
            let label = label.unwrap_or_default();
            format!("{label} {given}{} {unit}", sized(&parameter.name, *value)).trim().to_owned()
        };
        let listed = values.iter().take(listed).map(one);
        listed.chain((more > 0).then(|| format!("{more} more in the table of parameters"))).collect()
    }

    /// Values of the model that a cause changes, with the ones found, the largest changes first.
    fn changed_values(&self, cause: &Cause) -> Vec<(&Parameter, f64)> {
        let parameters = || self.figures.iter().flat_map(|figures| &figures.parameters);
        let changed = |(name, value): (&String, f64)| {
            let parameter = parameters().find(|p| p.name == *name)?;
            (parameter.given != Some(value)).then_some((parameter, value))
        };
        let known = cause.magnitude.iter().filter_map(|(name, value)| Some((name, (*value)?)));
        let mut values: Vec<(&Parameter, f64)> = known.filter_map(changed).collect();
        // Changes in one unit compare; others by how clear they are.
        let change = |(parameter, value): &(&Parameter, f64)| (value - parameter.given.unwrap_or(0.0)).abs();
        if values.iter().all(|(parameter, _)| parameter.unit == values[0].0.unit) {
            values.sort_by(|a, b| change(b).total_cmp(&change(a)));
        } else {
            values.sort_by(|a, b| b.0.clearness().total_cmp(&a.0.clearness()));
        }
        values
    }

    /// Rows of the values that the causes change, where a line of [`Document::actions`] has not all of a cause's: the value in words,
    /// the file's, the one found, its 90 % interval, its unit.
    pub fn value_rows(&self) -> Vec<[String; 5]> {
        let long = |cause: &&Cause| self.changed_values(cause).len() > VALUES;
        let row = |cause: &Cause, (parameter, value): (&Parameter, f64)| {
            let ends = cause.magnitude_interval.get(&parameter.name).filter(|[low, high]| low < high);
            [
                value_label(parameter, self),
                parameter.given.map_or_else(|| "-".to_owned(), |given| figure(given, 3)),
                figure(value, ends.map_or(DIGITS[0], |[low, high]| digits_apart(*low, *high))),
                ends.map_or_else(
                    || "-".to_owned(),
                    |[low, high]| {
                        let digits = digits_apart(*low, *high);
                        format!("{}..{}", figure(*low, digits), figure(*high, digits))
                    },
                ),
                printed_unit(&parameter.unit),
            ]
        };
        let of = |cause: &'_ Cause| {
            self.changed_values(cause).into_iter().map(|value| row(cause, value)).collect::<Vec<_>>()
        };
        self.causes.iter().filter(long).flat_map(of).collect()
    }

    /// What the causes bring: residual in motion over the noise of the headline joint, of the one that was furthest off, and of one that
    /// is worse or keeps a gap; and the simulator's error. None where nothing is known of the motion.
    #[must_use]
    pub fn result_line(&self) -> Option<String> {
        let joints = self.motions();
        let headline = self.headline_joint()?;
        let shown = joints.iter().find(|j| j.name == headline)?;
        let others = || joints.iter().filter(|j| j.name != headline);
        let most = |a: &&Motion, b: &&Motion| a.after.total_cmp(&b.after);
        let first = others().max_by(|a, b| a.before.total_cmp(&b.before)).filter(|j| j.before > shown.before);
        let kept = || others().filter(|j| j.after > KEEPS && first.is_none_or(|first| first.name != j.name));
        let steps = |j: &Motion, unit: &str| {
            let [before, after] = [j.before, j.after].map(|times| figure(times, 2));
            format!("{before} \u{2192} {after}{unit}{}", worse(j.before, j.after))
        };
        let named = |j: &Motion| format!("{} {}", j.name, steps(j, ""));
        let spoilt = kept().filter(|j| j.is_worse()).max_by(most).map(named);
        let open = || kept().max_by(most).map(|j| format!("{} still {}", j.name, figure(j.after, 2)));
        let headline = Some(format!("{headline}: {}", steps(shown, " times the noise")));
        let residuals = [headline, first.map(named), spoilt.or_else(open)];
        let residuals = residuals.into_iter().flatten().collect::<Vec<_>>().join("; ");
        let touched =
            if self.causes.iter().any(is_contact) { " A contact stays in it: no model holds that." } else { "" };
        let motion = format!("Residual in motion of {residuals}.{touched}");
        let end = self.rollout.as_ref().and_then(|rollout| rollout.points.last());
        let simulator = end.map_or_else(String::new, |end| {
            format!(
                " Simulator in closed loop after {} s: {} \u{2192} {} mrad{}.",
                end.horizon_s,
                distance(end.position_before_rad),
                distance(end.position_after_rad),
                worse(end.position_before_rad, end.position_after_rad)
            )
        });
        Some(motion + &simulator)
    }

    /// The joint that headline and picture are of: where nothing explains the gap the one that keeps most, else the one that was
    /// furthest off among those of the first line of what to do.
    pub(crate) fn headline_joint(&self) -> Option<&str> {
        let joints = self.motions();
        let most = |of: &dyn Fn(&Motion) -> f64, among: &[String]| {
            // The first of equals.
            let some = joints.iter().rev().filter(|j| among.is_empty() || among.iter().any(|name| name == j.name));
            some.max_by(|a, b| of(a).total_cmp(&of(b))).map(|j| j.name)
        };
        if self.verdict == "unexplained" {
            return most(&|j| j.after, &[]);
        }
        let first = self.causes_by_weight().first().map_or(&[][..], |cause| cause.joints.as_slice());
        most(&|j| j.before, first).or_else(|| most(&|j| j.before, &[]))
    }

    /// Joints that keep a gap in motion which is larger than that of the nominal model, with both, as text; none where there are none.
    #[must_use]
    pub fn worse_joints(&self) -> Option<String> {
        let joints = self.motions();
        let worse = joints.iter().filter(|j| j.after > KEEPS && j.is_worse());
        let all: Vec<String> = worse
            .map(|j| format!("{} ({} \u{2192} {} times the noise)", j.name, figure(j.before, 2), figure(j.after, 2)))
            .collect();
        (!all.is_empty()).then(|| all.join(", "))
    }

    /// Joints of which a residual in motion is known.
    fn motions(&self) -> Vec<Motion<'_>> {
        let both = |j: &JointGap| Some(((*j.in_motion.first()?)?, (*j.in_motion.get(1)?)?));
        let known = self.gap.per_joint.iter().filter_map(|j| both(j).map(|of| (j.joint.as_str(), of)));
        known.map(|(name, (before, after))| Motion { name, before, after }).collect()
    }

    /// Residual in motion over the noise of the worst joint: nominal model, all causes.
    pub(crate) fn in_motion(&self) -> Option<(f64, f64)> {
        let most = |at: usize| self.gap.per_joint.iter().filter_map(|j| *j.in_motion.get(at)?).reduce(f64::max);
        most(0).zip(most(1))
    }
}

/// The fewest digits in which the ends of an interval differ, if any do.
fn digits_apart(low: f64, high: f64) -> i32 {
    let differ = |digits: &i32| figure(low, *digits) != figure(high, *digits);
    DIGITS.into_iter().find(differ).unwrap_or(DIGITS[0])
}

/// Whether a cause has this confidence, or none is known.
fn is_at_least(cause: &Cause, confidence: f64) -> bool {
    cause.confidence.is_none_or(|sure| sure >= confidence)
}

/// That the causes made a figure larger, where its three digits show it.
fn worse(before: f64, after: f64) -> &'static str {
    if after > WORSE * before { " (worse)" } else { "" }
}

/// Distance of a simulator from the arm \[mrad\]: beyond [`LOST`] the figure means nothing.
pub(crate) fn distance(rad: f64) -> String {
    if rad > LOST { format!("more than {:.0}", 1e3 * LOST) } else { figure(1e3 * rad, 3) }
}

/// How often names of a cause's range of confidence were right on blind cases, where there are enough of them.
fn rate(cause: &Cause, scores: &[Score]) -> String {
    let Some(sure) = cause.confidence else { return String::new() };
    let is_of = |bin: &Bin| bin.from <= sure && sure < bin.to;
    // Two digits do not tell the highest ranges apart.
    let alike = |bin: &&Bin| is_of(bin) || bin.from.min(sure) >= HIGH;
    let bins: Vec<&Bin> = scores.iter().flat_map(|score| score.confidence.iter().filter(alike)).collect();
    let (right, all) = bins.iter().fold((0, 0), |(right, all), bin| (right + bin.right, all + bin.count));
    if all < FEWEST_NAMES {
        return String::new();
    }
    let from = bins.iter().fold(f64::INFINITY, |from, bin| from.min(bin.from));
    let to = bins.iter().fold(0.0, |to, bin| bin.to.max(to));
    format!(" ({right} of {all} names {} were right on blind cases)", range(from, to))
}

/// A range of confidences.
fn range(from: f64, to: f64) -> String {
    if to > 1.0 {
        format!("with {from} and more")
    } else if from > 0.0 {
        format!("with {from} to {to}")
    } else {
        format!("with less than {to}")
    }
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;
    use crate::verdict::tests::{cause, document};

    fn of(effect: &str, joints: &[&str], magnitude: &Value) -> Value {
        let mut cause = cause(effect, magnitude);
        cause["joints"] = json!(joints);
        cause
    }

    fn actions(causes: &[Value], more: &[(&str, Value)], scores: &[Score]) -> Vec<String> {
        let mut fields = more.to_vec();
        fields.push(("causes", json!(causes)));
        document(&fields).actions(scores)
    }

    #[test]
    fn an_effect_is_added_with_its_sizes_and_how_often_such_names_were_right() {
        let mut friction = of("stribeck_friction", &["elbow"], &json!({"strength_Nm": 1.47, "velocity_rad_s": 0.081}));
        friction["magnitude_interval"] = json!({"strength_Nm": [1.4, 1.55]});
        let bin = |count: usize, right: usize| Bin { from: 0.9, to: 0.97, count, right, mean: 0.93 };
        let scores = |count, right| vec![Score { confidence: vec![bin(count, right)], ..Score::default() }; 2];
        let said = |count, right| actions(std::slice::from_ref(&friction), &[], &scores(count, right)).concat();
        let known = said(30, 29);
        assert!(
            known.starts_with("Add Stribeck friction to elbow: strength 1.47 [1.40, 1.55] N m, velocity 0.0810 rad/s."),
            "{known}"
        );
        assert!(
            known.contains("Confidence 0.90 (58 of 60 names with 0.9 to 0.97 were right on blind cases)."),
            "{known}"
        );
        assert!(said(4, 4).ends_with("Confidence 0.90."), "eight names are no frequency: {}", said(4, 4));
        let bins = vec![bin(30, 29), Bin { from: 0.97, to: 1.01, count: 20, right: 20, mean: 0.97 }];
        let both = actions(std::slice::from_ref(&friction), &[], &[Score { confidence: bins, ..Score::default() }]);
        assert!(both[0].ends_with("(49 of 50 names with 0.9 and more were right on blind cases)."), "{}", both[0]);
        let twice = actions(&[friction.clone(), friction], &[], &scores(30, 29));
        assert!(twice[1].ends_with("Confidence 0.90."), "once a range: {}", twice[1]);
    }

    #[test]
    fn a_value_goes_from_the_files_to_the_one_found() {
        let parameter = json!({"name": "j4.rotor_inertia", "unit": "kg m²", "joint": 4, "given": 0.5, "found": 0.65, "low": 0.63,
            "high": 0.67, "state": "pinned", "wrong": true});
        let figures =
            json!({"floor": [], "stages": [], "parameters": [parameter], "excerpts": [], "left": [], "power": []});
        let mut rotor = of("rotor_inertia", &["wrist"], &json!({"j4.rotor_inertia": 0.651}));
        rotor["magnitude_interval"] = json!({"j4.rotor_inertia": [0.63, 0.67]});
        let said = actions(&[rotor], &[("figures", figures)], &[]).concat();
        assert!(
            said.starts_with("Set rotor inertia of wrist: j4.rotor_inertia 0.500 → 0.651 [0.630, 0.670] kg m²."),
            "{said}"
        );
    }

    #[test]
    fn values_beyond_those_of_a_line_have_rows() {
        let value = |name: &str, given: f64, found: f64| {
            json!({"name": name, "unit": "N m", "joint": 1, "given": given, "found": found, "low": found - 0.1,
                "high": found + 0.1, "state": "pinned", "wrong": true})
        };
        let names = ["j1.coulomb", "j2.coulomb", "j3.coulomb", "j4.coulomb"];
        let parameters: Vec<Value> = (1..).zip(names).map(|(k, name)| value(name, 1.0, 1.0 + f64::from(k))).collect();
        let found = |count: usize| {
            let sizes: serde_json::Map<_, _> = names[..count]
                .iter()
                .zip(2..)
                .map(|(name, found)| ((*name).to_owned(), json!(f64::from(found))))
                .collect();
            let figures =
                json!({"floor": [], "stages": [], "parameters": parameters, "excerpts": [], "left": [], "power": []});
            let gap = |joint: &str| json!({"joint": joint, "before": 0.3, "after": 0.1, "noise_floor": 0.05, "in_motion": [2.0, 1.0]});
            let gap =
                json!({"before": 0.3, "after": 0.1, "noise_floor": 0.05, "per_joint": names.map(|_| gap("arm_lift"))});
            let mut cause = of("coulomb_friction", &[], &Value::Object(sizes));
            cause["magnitude_interval"] = json!({"j4.coulomb": [4.5, 5.5]});
            document(&[("causes", json!([cause])), ("figures", figures), ("gap", gap)])
        };
        assert!(found(3).value_rows().is_empty(), "the line has them");
        let rows = found(4).value_rows();
        assert_eq!(rows.len(), 4);
        assert_eq!(rows[0], ["arm_lift Coulomb", "1.00", "5.00", "4.50..5.50", "N m"], "the largest change first");
        assert!(found(4).actions(&[]).concat().contains(" N m, 3 more in the table of parameters"));
    }

    #[test]
    fn the_largest_share_of_the_gap_comes_first() {
        let with_share = |effect: &str, share: f64| {
            let mut one = of(effect, &["wrist"], &json!({}));
            one["share"] = json!(share);
            one
        };
        let causes = json!([with_share("rotor_inertia", 0.1), with_share("joint_spring", 0.9)]);
        let found = document(&[("causes", causes)]);
        let begins = |lines: Vec<String>| lines.iter().map(|line| line[..3].to_owned()).collect::<Vec<_>>();
        assert_eq!(begins(found.actions(&[])), ["Set", "Add"], "in the order of causes");
        assert_eq!(begins(found.actions_by_weight(&[])), ["Add", "Set"]);
        let causes = json!([with_share("rotor_inertia", 0.9), with_share("joint_spring", 0.1)]);
        let found = document(&[("causes", causes)]);
        assert_eq!(begins(found.actions_by_weight(&[])), ["Add", "Set"], "a missing effect before wrong values");
    }

    #[test]
    fn what_is_not_likely_comes_last_and_is_to_be_checked() {
        let with_confidence = |effect: &str, confidence: f64| {
            let mut one = of(effect, &["wrist"], &json!({}));
            one["confidence"] = json!(confidence);
            one
        };
        let all = [
            ("joint_elasticity", 0.47),
            ("backlash", 0.58),
            ("rotor_inertia", 0.92),
            ("payload", 0.3),
            ("link_inertia", 0.4),
        ];
        let causes: Vec<Value> = all.iter().map(|(effect, sure)| with_confidence(effect, *sure)).collect();
        let lines = document(&[("causes", json!(causes))]).actions_by_weight(&[]);
        let starts = [
            "Set rotor inertia of wrist",
            "Add backlash to wrist",
            "Check whether joint elasticity acts on wrist",
            "Check whether the flange carries a payload",
            "Check link inertia of wrist",
        ];
        assert_eq!(lines.len(), starts.len());
        for (line, start) in lines.iter().zip(starts) {
            assert!(line.starts_with(start), "{line}");
        }
    }

    #[test]
    fn measured_torque_beyond_a_limit_is_said_to_be_the_command() {
        let limit = of("torque_saturation", &["elbow"], &json!({"limit_Nm": 33.2}));
        let said = actions(&[limit], &[], &[]).concat();
        assert!(
            said.contains("limit 33.2 N m. Beyond it the log holds the command: the joint gets no more."),
            "{said}"
        );
    }

    #[test]
    fn a_narrow_interval_has_the_digits_that_show_it() {
        let mut limit = of("torque_ripple", &["elbow"], &json!({"cycles_per_turn": 100.83}));
        let with = |limit: &Value| actions(std::slice::from_ref(limit), &[], &[]).concat();
        limit["magnitude_interval"] = json!({"cycles_per_turn": [100.78, 101.36]});
        assert!(with(&limit).contains("cycles 100.8 [100.8, 101.4] per turn"), "{}", with(&limit));
        limit["magnitude_interval"] = json!({"cycles_per_turn": [100.8299999, 100.8300001]});
        assert!(with(&limit).contains("cycles 101 [101, 101] per turn"), "{}", with(&limit));
    }

    #[test]
    fn a_factor_is_said_to_be_one() {
        let rotor = of("rotor_inertia", &["wrist"], &json!({"inertia_gain": 1.63}));
        let said = actions(&[rotor], &[], &[]).concat();
        assert!(said.starts_with("Set rotor inertia of wrist: inertia 1.63 times the file's."), "{said}");
    }

    #[test]
    fn a_contact_is_kept_away_and_a_class_is_said() {
        let touch = of("external_force", &[], &json!({"largest_N": 39.5}));
        assert!(actions(&[touch], &[], &[]).concat().starts_with("Keep away what touched the whole arm"));
        let mut asymmetry = of("friction_asymmetry", &["j"], &json!({"difference_Nm": 1.0}));
        asymmetry["indistinguishable_from"] = json!(["torque_ripple"]);
        let said = actions(&[asymmetry], &[], &[]).concat();
        assert!(said.ends_with("These logs do not separate it from torque ripple."), "{said}");
    }

    #[test]
    fn what_the_causes_bring_is_in_motion_and_in_closed_loop() {
        let joint = |name: &str, before: f64, after: f64| json!({"joint": name, "before": 0.3, "after": 0.1, "noise_floor": 0.05, "in_motion": [before, after]});
        let gap = json!({"before": 0.3, "after": 0.1, "noise_floor": 0.05, "per_joint": [joint("a", 14.0, 1.1), joint("b", 3.0, 2.4)]});
        let rollout = json!({"closer": true, "starts": 12, "not_simulated": [], "points": [{"horizon_s": 1.0,
            "position_before_rad": 0.141, "position_after_rad": 0.00037, "torque_before": 0.1, "torque_after": 0.01}]});
        let found = document(&[("gap", gap), ("rollout", rollout)]);
        let line = found.result_line().expect("a line");
        assert_eq!(
            line,
            "Residual in motion of a: 14 → 1.1 times the noise; b still 2.4. Simulator in closed loop after 1 s: 141 → 0.370 mrad."
        );
    }

    /// A joint that was further off, one that became worse, and where nothing explains the gap the joint that keeps it.
    #[test]
    fn the_result_hides_no_joint_that_is_worse() {
        let joint = |name: &str, before: f64, after: f64| json!({"joint": name, "before": 0.3, "after": 0.1, "noise_floor": 0.05, "in_motion": [before, after]});
        let gap = json!({"before": 0.3, "after": 0.1, "noise_floor": 0.05,
            "per_joint": [joint("a", 5.0, 1.7), joint("b", 24.0, 1.5), joint("c", 9.9, 17.0)]});
        let of = |verdict: &str| {
            let causes = json!([of("stribeck_friction", &["a"], &json!({}))]);
            document(&[("gap", gap.clone()), ("causes", causes), ("verdict", json!(verdict))])
        };
        let line = of("effect").result_line().expect("a line");
        assert_eq!(line, "Residual in motion of a: 5.0 → 1.7 times the noise; b 24 → 1.5; c 9.9 → 17 (worse).");
        let line = of("unexplained").result_line().expect("a line");
        assert!(line.starts_with("Residual in motion of c: 9.9 → 17 times the noise (worse); b 24 → 1.5."), "{line}");
        assert_eq!(of("effect").worse_joints().as_deref(), Some("c (9.9 → 17 times the noise)"));
    }
}
