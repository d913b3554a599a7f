//! The verdict in lines: what to do, what it brings, what stays open, the next measurement; then the gap, its causes, its place.

use crate::document::{Cause, Document, is_contact};
use crate::next::MEASURE;
use crate::scores::Score;
use crate::words::{effect, figure, joints_in_short, list, percent, quantity_of, rival};

/// One of the lines.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Line {
    /// What the line is about, in a word or two.
    pub head: &'static str,
    /// The line.
    pub text: String,
    /// Whether it is what stands behind the answer: a page folds it away.
    pub detail: bool,
}

impl Line {
    fn new(head: &'static str, text: String) -> Line {
        Line { head, text, detail: false }
    }

    fn detail(head: &'static str, text: String) -> Line {
        Line { head, text, detail: true }
    }
}

/// Places named in the verdict, and cells named as not known.
const PLACES: usize = 3;
const UNKNOWN_CELLS: usize = 2;
/// Causes whose shrink is told.
const SHRINKS: usize = 3;
/// Sizes named in a sentence.
const SIZES: usize = 2;
/// Near standstill a joint misses this many times its noise where that is worth a word.
const STANDSTILL: f64 = 5.0;
/// Shares below this are not worth a word.
const WORTH_NAMING: f64 = 0.05;
/// Creeping is told where it is this share of what is left.
const CREEPING: f64 = 0.2;
/// Times the noise that are next to it.
const NEXT_TO_NOISE: f64 = 4.0;
/// Times its noise floor that the torque noise of a measured log leaves at least: the residual holds the noise itself.
const MEASURED: f64 = 0.7;
/// Times the noise that no sound joint keeps.
const SOUND: f64 = 2.0;
/// Times the noise that no right values leave, even where most joints keep more than it, as on measured arms.
const FAR: f64 = 20.0;

impl Document {
    /// The verdict in lines: first what to do, a line a cause. `scores` are those of cases whose answers are known.
    pub fn lines(&self, scores: &[Score]) -> Vec<Line> {
        if let Some(remark) = self.remark.as_ref().filter(|_| !self.needs_other_motion()) {
            let mut lines = vec![Line::new("Verdict", format!("Not evaluated: {remark}."))];
            if !self.log.is_empty() {
                lines.push(Line::new("Not covered", self.findings().join("; ") + "."));
            }
            let motion = if self.log.iter().any(|f| f.fault == "log_reading") {
                "Mend the log or the file as the verdict says, then diagnose again."
            } else {
                "Record a motion that uses every joint over its range and speed."
            };
            let next = self
                .next_of_signs()
                .unwrap_or_else(|| if self.has_computed() { MEASURE.to_owned() } else { motion.to_owned() });
            lines.push(Line::new("Next", next));
            return lines;
        }
        let named = !self.causes.is_empty();
        let mut lines: Vec<Line> =
            self.actions_by_weight(scores).into_iter().map(|text| Line::new("Do", text)).collect();
        if named {
            lines.extend(self.result_line().map(|text| Line::new("Result", text)));
        }
        // What to do says all causes; not what is unexplained.
        let is_unsaid = !named || self.verdict == "unexplained";
        lines.extend(is_unsaid.then(|| Line::new("Cause", self.cause_line())));
        lines.push(Line::new("Next", self.next_line()));
        lines.push(Line::new("Not covered", self.open_line()));
        lines.extend((!is_unsaid).then(|| Line::detail("Cause", self.cause_line())));
        lines.push(Line::detail("Gap", self.gap_line()));
        lines.push(Line::detail("Where", self.place_line()));
        lines.extend(named.then(|| Line::detail("How far", self.shrink_line())));
        lines
    }

    /// Whether all was evaluated, and what the sealed motion shows is values that the motion looked at does not.
    pub(crate) fn needs_other_motion(&self) -> bool {
        self.between_runs.as_deref() == Some("values_unseen")
    }

    /// Gravity as it is, where it points far elsewhere than the robot file says: then nothing else was asked.
    pub(crate) fn mounting(&self) -> Option<[f64; 3]> {
        let cause = self.causes.iter().find(|c| c.effect == "gravity_direction")?;
        // Thousandths are more than a mounting is known to; adding zero takes the sign off a negative zero.
        let thousandths = |value: f64| (value * 1e3).round() / 1e3 + 0.0;
        let along = |axis: &str| (*cause.magnitude.get(&format!("gravity_{axis}_m_s2"))?).map(thousandths);
        Some([along("x")?, along("y")?, along("z")?])
    }

    /// Motion first: at rest stiction holds a part of the torque, which no model knows.
    fn gap_line(&self) -> String {
        let gap = &self.gap;
        let seconds = self.data.sealed_seconds.unwrap_or(0.0);
        let others = if self.mounting().is_some() { "all else nominal" } else { "the other parameters refitted" };
        let changes = if self.causes.is_empty() { others.to_owned() } else { format!("the causes and {others}") };
        let moving = self.in_motion().map_or_else(String::new, |(before, after)| {
            let (before, after) = (figure(before, 2), figure(after, 2));
            format!(
                "In motion, the worst joint has {before} times its noise with the nominal model and {after} times with \
                 {changes}. "
            )
        });
        let repeated = gap.per_joint.iter().filter(|j| j.floor_from.as_deref() == Some("repeats"));
        let noise = match repeated.filter_map(|j| j.repeats_s).reduce(f64::max) {
            Some(seconds) => format!(
                "The noise floor is {} %, from torque that differs where the logs hold the same motion twice \
                 ({seconds:.0} s)",
                percent(gap.noise_floor)
            ),
            None => format!("The noise floor of the torque signal is {} %", percent(gap.noise_floor)),
        };
        format!(
            "{moving}Standstill included, the residual is {} % of the torque with the nominal model and {} % with {changes}, on \
             {seconds:.0} s of held-out motion; at rest stiction holds a part that no model predicts. {noise}.",
            percent(gap.before),
            percent(gap.after),
        )
    }

    /// Whether the values refitted leave next to nothing in motion.
    pub(crate) fn is_fitted(&self) -> bool {
        let left: Vec<f64> = self.gap.per_joint.iter().filter_map(|j| *j.in_motion.get(1)?).collect();
        !left.is_empty() && left.iter().all(|times| *times <= SOUND)
    }

    /// The most that a joint keeps in motion, as a clause.
    fn kept_in_motion(&self) -> String {
        let most = self.gap.per_joint.iter().filter_map(|j| *j.in_motion.get(1)?).fold(0.0, f64::max);
        format!("no joint keeps more than {} times its noise", figure(most, 2))
    }

    fn cause_line(&self) -> String {
        let impossible: Vec<String> = self
            .hints
            .iter()
            .filter_map(|hint| Some(format!(" Not named: {}, {}.", effect(&hint.effect), hint.impossible.as_ref()?)))
            .collect();
        self.answer() + &impossible.concat()
    }

    fn answer(&self) -> String {
        let named: Vec<String> = self.causes.iter().map(|c| self.said(c)).collect();
        let nameless: Vec<String> = self.hints.iter().filter(|h| h.is_nameless()).map(|h| self.said(h)).collect();
        match self.verdict.as_str() {
            "no_gap" => {
                let at_fault = self.late_ms().map_or_else(String::new, |ms| {
                    format!(", except in the logs: torque is logged {ms} ms late, which was corrected")
                });
                format!("These logs show nothing wrong{at_fault}.")
            }
            "not_evaluated" if self.needs_other_motion() => {
                format!("Not evaluated: {}.", self.remark.as_deref().unwrap_or_default())
            }
            "unexplained" if !self.other_arm.is_empty() => format!(
                "Unexplained: bodies and rotors of {} differ from the file by more than data sheets do. Check that \
                 it is the file of this robot; the hints list the differences.",
                list(&self.other_arm)
            ),
            "unexplained" if self.between_runs.as_deref() == Some("sealed_differs") => {
                let [training, held_out, reaches, change] = if self.data.cut {
                    ["the training part", "the held-out part", "reaches its", "during the run"]
                } else {
                    ["the training logs", "the held-out log", "reach their", "between the logs"]
                };
                format!(
                    "Unexplained: {training} {reaches} noise floor and {held_out} does not. Something changed \
                     {change}, or only the held-out motion shows it."
                )
            }
            "unexplained" if self.refuted => {
                let given = match self.between_runs.as_deref() {
                    Some("sealed_as_given") if self.data.cut => {
                        " The nominal model fits the held-out part to its noise: something changed during the run, \
                         or the signals before it are wrong."
                    }
                    Some("sealed_as_given") => {
                        " The nominal model fits the held-out log to its noise: something changed between the logs, \
                         or the signals of the others are wrong."
                    }
                    _ => "",
                };
                format!(
                    "Unexplained: what fits the training logs does not hold on the held-out log, so nothing is \
                     named. The hints are the rejected causes.{given}"
                )
            }
            "unexplained" if !nameless.is_empty() => {
                let also =
                    if named.is_empty() { String::new() } else { format!(", and wrong parameters: {}", list(&named)) };
                format!("Not in the list of effects: {}{also}.", list(&nameless))
            }
            "unexplained" if named.is_empty() && self.is_fitted() => {
                "Unexplained: with refitted parameters the model fits, but these logs do not identify which of them \
                 are wrong."
                    .to_owned()
            }
            "unexplained" if named.is_empty() => {
                "Unexplained: there is a gap, and no effect of the list explains it.".to_owned()
            }
            "unexplained" => {
                let left: Vec<String> = self.left_joints().into_iter().map(|(joint, _)| joint).collect();
                let on = if left.is_empty() { String::new() } else { format!(", most of it on {}", list(&left)) };
                format!(
                    "Unexplained: wrong parameters were found ({}), but {} % of the squared gap above the noise is \
                     not explained{on}.",
                    list(&named),
                    figure(100.0 * self.unexplained_share.unwrap_or(0.0), 2)
                )
            }
            "parameter" => format!("Wrong parameters of the nominal model: {}.", list(&named)),
            _ => format!("{}.", list(&named)),
        }
    }

    fn said(&self, cause: &Cause) -> String {
        let all = self.gap.per_joint.len();
        let mut sizes: Vec<String> = Vec::new();
        // Values of the model are too many for a sentence; the page lists them.
        for (name, value) in cause.magnitude.iter().filter(|(name, _)| !name.contains('.')) {
            let (name, unit) = quantity_of(name, &cause.joints, self);
            if let Some(value) = value {
                sizes.push(format!("{name} {} {unit}", figure(*value, 3)).trim_end().to_owned());
            }
        }
        let sizes =
            if sizes.is_empty() || sizes.len() > SIZES { String::new() } else { format!(" ({})", sizes.join(", ")) };
        let rivals: Vec<String> = cause.indistinguishable_from.iter().map(|e| rival(e)).collect();
        let or = if rivals.is_empty() { String::new() } else { format!(" or {}", rivals.join(" or ")) };
        format!("{}{or} on {}{sizes}", cause.word(), joints_in_short(&cause.joints, all))
    }

    fn place_line(&self) -> String {
        let cells = self.place.iter().filter(|c| c.share.is_some_and(|s| s >= WORTH_NAMING)).take(PLACES);
        let named: Vec<String> =
            cells.map(|c| format!("{} {} {} %", c.joint, regime(&c.regime), percent(c.share))).collect();
        let contrast = self.figures.as_ref().and_then(|f| f.views.as_ref()?.contrast.as_ref());
        let uneven = contrast.map_or_else(String::new, |c| format!(" With the nominal model, {}.", c.text()));
        if named.is_empty() {
            return format!("The gap is spread over joints and regimes.{uneven}");
        }
        format!("Of the squared gap: {}.{uneven}", list(&named))
    }

    fn shrink_line(&self) -> String {
        let each: Vec<String> = self
            .causes
            .iter()
            .take(SHRINKS)
            .map(|c| {
                let s = &c.shrink;
                format!(
                    "{} {} % (90 %: {}..{}), measured {} %",
                    effect(&c.effect),
                    percent(s.predicted),
                    percent(s.low),
                    percent(s.high),
                    percent(s.measured)
                )
            })
            .collect();
        let more = self.causes.len().saturating_sub(SHRINKS);
        let more = if more > 0 { format!("; {more} more below") } else { String::new() };
        let contact = if self.causes.iter().any(is_contact) { format!(" {OTHER_CONTACT}.") } else { String::new() };
        let kind = self.data.of_another_kind.map_or_else(String::new, |share| {
            let share = 100.0 * share;
            format!(
                " The held-out motion is of another kind ({share:.0} % of the time at speeds that are rarer in the \
                 training logs): intervals are wider."
            )
        });
        let each = each.join("; ");
        format!("Shrink of the gap, predicted before the held-out torque was read: {each}{more}.{kind}{contact}")
    }

    /// Joints that keep a gap in motion with all that is named, in times of their noise (of an unexplained arm from twice on); where more
    /// of them do than do not, those that keep far more than is usual on measured arms.
    pub(crate) fn left_joints(&self) -> Vec<(String, f64)> {
        let after = self.gap.per_joint.iter().filter_map(|j| Some((j.joint.clone(), (*j.in_motion.get(1)?)?)));
        let next_to_noise = if self.verdict == "unexplained" { SOUND } else { NEXT_TO_NOISE };
        let (left, fitted): (Vec<_>, Vec<_>) = after.partition(|(_, times)| *times > next_to_noise);
        if left.len() <= fitted.len() { left } else { left.into_iter().filter(|(_, times)| *times > FAR).collect() }
    }

    fn open_line(&self) -> String {
        let mut open = self.findings();
        if !self.data.unused.is_empty() {
            let (out, all) = (self.data.unused.len(), self.data.unused.len() + self.data.runs);
            open.push(format!("{out} of {all} stretches of logs were excluded: their torque carries no information"));
        }
        open.extend(self.left_out.iter().map(|what| format!("{what}: no solution")));
        open.extend(self.is_without_noise().then(|| {
            "these logs have hardly any noise, as those of a simulator: a measured log shows less, and its intervals are wider".to_owned()
        }));
        let nothing_missing = self.verdict == "no_gap";
        if let Some(share) = self.unexplained_share.filter(|s| *s >= WORTH_NAMING && !nothing_missing) {
            open.extend(match (self.is_fitted(), self.verdict.as_str()) {
                _ if self.causes.iter().any(is_contact) => Some(format!(
                    "{:.0} % of the squared gap above the noise stays, the contact's torque with it: no model holds that",
                    100.0 * share
                )),
                (true, "unexplained") => Some(format!(
                    "{:.0} % of the squared gap above the noise stays unexplained, at rest or at reversals: in motion {}",
                    100.0 * share,
                    self.kept_in_motion()
                )),
                // A right model leaves this, too: a share of it would read as a cause that is missing.
                (true, _) => Some(format!(
                    "in motion {}; at rest and at reversals stiction holds a part of the torque that no model predicts",
                    self.kept_in_motion()
                )),
                (false, "unexplained") => {
                    Some(format!("{:.0} % of the squared gap above the noise stays unexplained", 100.0 * share))
                }
                // Of a diagnosis that named what it found the share is mostly torque at rest. The joints that are left in motion follow.
                (false, _) => None,
            });
        }
        let open_gap = self.unexplained_share.is_some_and(|share| share >= CREEPING) && !nothing_missing;
        if let Some(share) = self.creeping_share.filter(|s| open_gap && *s >= CREEPING) {
            open.push(format!(
                "{:.0} % of the remaining squared gap is friction that changes sign gradually near zero speed \
                 ([signal] friction_velocity of the robot file)",
                100.0 * share
            ));
        }
        open.extend(self.near_standstill().filter(|_| nothing_missing));
        let left = self.left_joints();
        if !left.is_empty() && !nothing_missing {
            let times: Vec<String> =
                left.iter().map(|(joint, times)| format!("{joint} {}", figure(*times, 2))).collect();
            open.push(format!("in motion, with all causes, {} times the noise", list(&times)));
        }
        // At rest nothing is judged, whatever the data.
        let unknown: Vec<&crate::Cell> = self.place.iter().filter(|c| !c.known && c.regime != "rest").collect();
        if !unknown.is_empty() {
            let names: Vec<String> =
                unknown.iter().take(UNKNOWN_CELLS).map(|c| format!("{} {}", c.joint, regime(&c.regime))).collect();
            let more = unknown.len().saturating_sub(UNKNOWN_CELLS);
            let more = if more > 0 { format!(" and {more} more") } else { String::new() };
            open.push(format!("too little data for {}{more}", names.join(", ")));
        }
        if open.is_empty() { "Nothing: every joint and regime has data.".to_owned() } else { open.join("; ") + "." }
    }

    /// Whether every joint stays far below its noise floor in motion: there is no noise in the torque then.
    fn is_without_noise(&self) -> bool {
        let mut left = self.gap.per_joint.iter().map(|j| *j.in_motion.get(1)?).peekable();
        left.peek().is_some() && left.all(|times| times.is_some_and(|times| times < MEASURED))
    }

    /// The joint of which most is missed over a whole run, where that is far more than noise: nothing is missing in motion, so it is near
    /// standstill, where nobody knows what friction holds.
    fn near_standstill(&self) -> Option<String> {
        let known = self.gap.per_joint.iter().filter_map(|j| Some((j, j.after?, j.noise_floor?)));
        let (joint, missed, noise) = known.max_by(|a, b| a.1.total_cmp(&b.1))?;
        let much = missed > STANDSTILL * noise && missed >= WORTH_NAMING;
        much.then(|| {
            format!(
                "near standstill the direction of friction is unknown, so nothing is decided there: the residual of \
                 {} is then {} % of its torque ({} % is noise); record slow motion",
                joint.joint,
                percent(Some(missed)),
                percent(Some(noise))
            )
        })
    }

    /// Faults of the log, the joints of a run and a fault together.
    fn findings(&self) -> Vec<String> {
        let mut kinds: Vec<(&str, &str)> = Vec::new();
        for finding in &self.log {
            let kind = (finding.fault.as_str(), finding.run.as_str());
            if !kinds.contains(&kind) {
                kinds.push(kind);
            }
        }
        let of = |(fault, run): (&str, &str)| {
            let same = self.log.iter().filter(|f| f.fault == fault && f.run == run);
            let joints: Vec<String> = same.map(|f| f.joint.clone()).collect();
            let on = if joints.len() > 1 && joints.len() == self.gap.per_joint.len() {
                "all joints".to_owned()
            } else {
                list(&joints)
            };
            let fault = fault.replace('_', " ");
            // What belongs to no log is a fact about the robot file.
            match (run.is_empty(), on.is_empty()) {
                (true, true) => fault,
                (false, true) => format!("{fault} of {run}"),
                _ => format!("{fault} of {run}: {on}"),
            }
        };
        kinds.into_iter().map(of).collect()
    }

    /// By how much torque is logged after the motion that it makes \[ms\], the most of all joints; none where it is not.
    pub(crate) fn late_ms(&self) -> Option<String> {
        let late = self.log.iter().filter(|f| f.fault == "torque_late").filter_map(|f| f.value);
        late.reduce(f64::max).map(|seconds| figure(1e3 * seconds, 2))
    }

    pub(crate) fn has_computed(&self) -> bool {
        self.log.iter().any(|f| f.fault == "torque_computed")
    }
}

/// Why a contact has a share and shrinks nothing.
pub(crate) const OTHER_CONTACT: &str = "A contact is not a part of the arm: one in the held-out log is another \
                                        contact, which no model of the first predicts. It has no shrink there, and \
                                        its residual stays unexplained. Its share is of the training logs";

/// A regime in a sentence.
pub(crate) fn regime(name: &str) -> String {
    match name {
        "rest" => "at rest".to_owned(),
        "reversal" => "at reversals".to_owned(),
        "slow" => "when slow".to_owned(),
        "accelerating" => "accelerating".to_owned(),
        "cruise" => "at cruise".to_owned(),
        other => other.replace('_', " "),
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use serde_json::{Value, json};

    use super::*;

    /// A document of the contract's fields, and these.
    pub(crate) fn document(more: &[(&str, Value)]) -> Document {
        let mut all = json!({"schema": "rivet.diagnosis.v1", "robot": "r", "verdict": "effect",
            "gap": {"before": 0.3, "after": 0.1, "noise_floor": 0.05, "per_joint":
                [{"joint": "j", "before": 0.3, "after": 0.1, "noise_floor": 0.05}]},
            "where": [], "causes": [], "log": [], "hints": [], "unexplained_share": 0.1,
            "data": {"runs": 2, "fit_seconds": 10.0, "sealed_seconds": 5.0}, "remark": null});
        for (name, value) in more {
            all[*name] = value.clone();
        }
        serde_json::from_value(all).expect("a document")
    }

    pub(crate) fn cause(effect: &str, magnitude: &Value) -> Value {
        json!({"effect": effect, "joints": [], "magnitude": magnitude, "shrink":
            {"predicted": 0.7, "low": 0.6, "high": 0.8, "measured": 0.7}, "confidence": 0.9,
            "indistinguishable_from": [], "separating_motion": null})
    }

    pub(crate) fn line(document: &Document, head: &str) -> String {
        document.lines(&[]).into_iter().find(|l| l.head == head).map(|l| l.text).unwrap_or_default()
    }

    /// What is left may be where joints stand, of which no model knows more.
    #[test]
    fn what_is_left_at_rest_is_said_to_be_there() {
        let told = |after: f64| {
            let joint =
                json!({"joint": "j", "before": 0.3, "after": 0.1, "noise_floor": 0.05, "in_motion": [9.0, after]});
            let gap = json!({"before": 0.3, "after": 0.1, "noise_floor": 0.05, "per_joint": [joint]});
            line(&document(&[("unexplained_share", json!(0.71)), ("gap", gap)]), "Not covered")
        };
        assert!(told(1.1).contains("at rest") && !told(1.1).contains("unexplained"), "{}", told(1.1));
        assert!(!told(2.9).contains("at rest"), "{}", told(2.9));
    }

    #[test]
    fn a_contact_is_nothing_to_add_to_a_simulator() {
        let touched = document(&[("causes", json!([cause("external_force", &json!({"largest_N": 80.0}))]))]);
        let next = line(&touched, "Next");
        assert!(next.contains("what touched the arm") && !next.contains("Add the effect"), "{next}");
        // A share of the runs looked at beside a shrink of 0 on the sealed one.
        let why =
            |touched: &Document| line(touched, "How far").contains("is another contact, which no model of the first");
        assert!(why(&touched) && crate::page(&touched, &[]).matches("is another contact").count() == 2);
        let spring = document(&[("causes", json!([cause("joint_spring", &json!({}))]))]);
        assert!(!why(&spring));
        assert!(line(&spring, "Next").contains("Add the effect to the simulator"));
    }

    #[test]
    fn motion_of_another_kind_is_said_to_widen_intervals() {
        let of = |share: Value| {
            let data = json!({"runs": 2, "fit_seconds": 10.0, "sealed_seconds": 5.0, "of_another_kind": share});
            let spring = json!([cause("joint_spring", &json!({}))]);
            line(&document(&[("causes", spring), ("data", data)]), "How far")
        };
        assert!(of(json!(0.62)).contains("of another kind (62 % of the time"), "{}", of(json!(0.62)));
        assert!(!of(Value::Null).contains("of another kind"));
    }

    #[test]
    fn runs_that_differ_are_said_to() {
        let of = |refuted: bool, between: &str| {
            let more =
                [("verdict", json!("unexplained")), ("refuted", json!(refuted)), ("between_runs", json!(between))];
            let document = document(&more);
            (line(&document, "Cause"), line(&document, "Next"))
        };
        let (cause, next) = of(false, "sealed_differs");
        assert!(
            cause.contains("changed between the logs") && next.contains("what changed between the runs"),
            "{cause} {next}"
        );
        let (cause, _) = of(true, "sealed_as_given");
        assert!(cause.contains("The nominal model fits the held-out log"), "{cause}");
    }

    #[test]
    fn nothing_is_missing_where_the_model_is_right() {
        let open = |verdict: &str| {
            line(&document(&[("verdict", json!(verdict)), ("unexplained_share", json!(0.98))]), "Not covered")
        };
        assert!(open("unexplained").contains("98 % of the squared gap above the noise stays unexplained"));
        assert!(!open("no_gap").contains("unexplained"), "{}", open("no_gap"));
        assert!(!open("effect").contains("98 %"), "{}", open("effect"));
    }

    /// Friction that falls with speed below 0.1 rad/s, 13 times the noise, was "nothing is wrong" and no word more.
    #[test]
    fn what_is_missed_near_standstill_is_said_where_nothing_else_is() {
        let of = |verdict: &str, after: f64| {
            let joint = json!({"joint": "wrist", "before": after, "after": after, "noise_floor": 0.004, "in_motion": [1.0, 1.0]});
            let gap = json!({"before": after, "after": after, "noise_floor": 0.004, "per_joint": [joint]});
            line(&document(&[("verdict", json!(verdict)), ("gap", gap)]), "Not covered")
        };
        let said = of("no_gap", 0.12);
        assert!(said.contains("near standstill") && said.contains("wrist is then 12.0 %"), "{said}");
        for (verdict, after) in [("no_gap", 0.015), ("no_gap", 0.045), ("unexplained", 0.12)] {
            assert!(!of(verdict, after).contains("standstill"), "{}", of(verdict, after));
        }
    }

    #[test]
    fn a_log_without_noise_is_called_that() {
        let of = |after: [Value; 2]| {
            let joints = after.map(|times| json!({"joint": "j", "before": 0.1, "after": 0.01, "noise_floor": 0.01, "in_motion": [9.0, times]}));
            let gap = json!({"before": 0.1, "after": 0.01, "noise_floor": 0.01, "per_joint": joints});
            line(&document(&[("gap", gap)]), "Not covered")
        };
        assert!(of([json!(0.5), json!(0.12)]).contains("hardly any noise"));
        for sound in [[json!(0.5), json!(1.0)], [json!(0.5), Value::Null]] {
            assert!(!of(sound.clone()).contains("hardly any noise"), "{sound:?}");
        }
    }

    #[test]
    fn a_log_at_fault_is_said_beside_a_sound_arm() {
        let of = |log: &Value| document(&[("verdict", json!("no_gap")), ("log", log.clone())]);
        let sound = of(&json!([]));
        assert_eq!(line(&sound, "Cause"), "These logs show nothing wrong.");
        assert!(line(&sound, "Next").starts_with("Use the model"));
        let late = of(&json!([{"run": "a.csv", "joint": "j", "fault": "torque_late", "value": 0.0097, "text": ""}]));
        let (cause, next) = (line(&late, "Cause"), line(&late, "Next"));
        assert!(cause.contains("torque is logged 9.7 ms late") && next.contains("9.7 ms"), "{cause} {next}");
    }

    /// A cause on one joint says nothing of another that keeps hundreds of times its noise.
    #[test]
    fn a_joint_that_is_left_is_told_beside_a_cause() {
        let joint = |name: &str, after: f64| json!({"joint": name, "before": 0.3, "after": 0.1, "noise_floor": 0.01, "in_motion": [690.0, after]});
        let told = |others: f64| {
            let joints = json!([joint("a", 1.2), joint("b", others), joint("c", 689.0)]);
            let gap = json!({"before": 0.3, "after": 0.1, "noise_floor": 0.05, "per_joint": joints});
            let all = document(&[("gap", gap), ("causes", json!([cause("load_dependent_friction", &json!({}))]))]);
            (line(&all, "Not covered"), line(&all, "Next"))
        };
        let (open, next) = told(1.1);
        assert!(open.contains("c 689 times the noise"), "{open}");
        assert!(next.contains("on c something else is missing"), "{next}");
        // Where most joints keep more, as on measured arms, only what is far more is news.
        let (open, next) = told(12.0);
        assert!(open.contains("with all causes, c 689 times the noise"), "{open}");
        assert!(next.contains("on c something else is missing"), "{next}");
    }
}
