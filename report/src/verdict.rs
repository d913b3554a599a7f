//! The verdict as a person would say it: the gap, its cause, its place, its worth, what is not covered, what to do next.

use crate::document::{Cause, Document};
use crate::words::{effect, figure, joints_in_short, list, percent, quantity, rival};

/// One of the six lines.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Line {
    /// What the line is about, in a word or two.
    pub head: &'static str,
    /// The line.
    pub text: String,
}

/// Places named in the verdict, and cells named as not known.
const PLACES: usize = 3;
const UNKNOWN_CELLS: usize = 4;
/// Causes whose shrink is told.
const SHRINKS: usize = 3;
/// Sizes named in a sentence.
const SIZES: usize = 2;
/// Shares below this are not worth a word.
const WORTH_NAMING: f64 = 0.05;
/// Times the noise that are next to it.
const NEXT_TO_NOISE: f64 = 4.0;
/// What to do about torque that was computed.
const MEASURE: &str = "Log the torque that was measured, or motor currents (drive_gain, and torque_from = \"current\" where torque \
                       columns are there too).";

impl Document {
    /// The verdict in six lines.
    pub fn lines(&self) -> Vec<Line> {
        if let Some(remark) = &self.remark {
            let mut lines = vec![Line { head: "Verdict", text: format!("Not evaluated: {remark}.") }];
            if !self.log.is_empty() {
                lines.push(Line { head: "Not covered", text: self.findings().join("; ") + "." });
            }
            let motion = "Record a motion that uses every joint over its range and speed.";
            let next = if self.has_computed() { MEASURE } else { motion };
            lines.push(Line { head: "Next", text: next.to_owned() });
            return lines;
        }
        vec![
            Line { head: "Gap", text: self.gap_line() },
            Line { head: "Cause", text: self.cause_line() },
            Line { head: "Where", text: self.place_line() },
            Line { head: "How far", text: self.shrink_line() },
            Line { head: "Not covered", text: self.open_line() },
            Line { head: "Next", text: self.next_line() },
        ]
    }

    fn gap_line(&self) -> String {
        let gap = &self.gap;
        let most = |at: usize| gap.per_joint.iter().filter_map(|j| *j.in_motion.get(at)?).reduce(f64::max);
        let moving = most(0).zip(most(1)).map_or_else(String::new, |(before, after)| {
            let (before, after) = (figure(before, 2), figure(after, 2));
            format!(
                " Where joints move and friction's direction is known, the worst joint misses {before} times its signal's noise \
                 as given and {after} times with that."
            )
        });
        let repeated = gap.per_joint.iter().filter(|j| j.floor_from.as_deref() == Some("repeats"));
        let noise = match repeated.filter_map(|j| j.repeats_s).reduce(f64::max) {
            Some(seconds) => format!(
                "Noise is {} %: by more than the torque signal's own, torque differs where the logs hold the same motion twice \
                 ({seconds:.0} s)",
                percent(gap.noise_floor)
            ),
            None => format!("Noise of the torque signal alone is {} %", percent(gap.noise_floor)),
        };
        format!(
            "On {:.0} s of motion that was kept sealed, the model as given misses the torque by {} %; with what is named \
             below and the other values refitted, by {} %. {noise}.{moving}",
            self.data.sealed_seconds.unwrap_or(0.0),
            percent(gap.before),
            percent(gap.after),
        )
    }

    /// Whether the values refitted leave next to nothing in motion.
    fn is_fitted(&self) -> bool {
        let left: Vec<f64> = self.gap.per_joint.iter().filter_map(|j| *j.in_motion.get(1)?).collect();
        !left.is_empty() && left.iter().all(|times| *times <= NEXT_TO_NOISE)
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
        match self.verdict.as_str() {
            "no_gap" => "Nothing is wrong that these logs could show.".to_owned(),
            "unexplained" if !self.other_arm.is_empty() => format!(
                "Unknown: bodies and rotors of {} are off by more than a data sheet ever is: is this the robot's file? What would \
                 have to be changed is among the hints.",
                list(&self.other_arm)
            ),
            "unexplained" if self.refuted => {
                "Unknown: what fits the other motion does not hold on the sealed one, so none of it is believed; the hints \
                 are what was refuted."
                    .to_owned()
            }
            "unexplained" if named.is_empty() && self.is_fitted() => {
                "Unknown: with its values refitted the model fits, but these logs do not tell which of them are wrong."
                    .to_owned()
            }
            "unexplained" if named.is_empty() => {
                "Unknown: there is a gap, and no effect of the library explains it.".to_owned()
            }
            "unexplained" => format!("Unknown: {} came out, and does not explain the gap.", list(&named)),
            "parameter" => format!("Wrong values of what the model has: {}.", list(&named)),
            _ => format!("{}.", list(&named)),
        }
    }

    fn said(&self, cause: &Cause) -> String {
        let all = self.gap.per_joint.len();
        let mut sizes: Vec<String> = Vec::new();
        // Values of the model are too many for a sentence; the page lists them.
        for (name, value) in cause.magnitude.iter().filter(|(name, _)| !name.contains('.')) {
            let (name, unit) = quantity(name, self);
            if let Some(value) = value {
                sizes.push(format!("{name} {} {unit}", figure(*value, 3)).trim_end().to_owned());
            }
        }
        let sizes =
            if sizes.is_empty() || sizes.len() > SIZES { String::new() } else { format!(" ({})", sizes.join(", ")) };
        let rivals: Vec<String> = cause.indistinguishable_from.iter().map(|e| rival(e)).collect();
        let or = if rivals.is_empty() { String::new() } else { format!(" or {}", rivals.join(" or ")) };
        format!("{}{or} on {}{sizes}", effect(&cause.effect), joints_in_short(&cause.joints, all))
    }

    fn place_line(&self) -> String {
        let cells = self.place.iter().filter(|c| c.share.is_some_and(|s| s >= WORTH_NAMING)).take(PLACES);
        let named: Vec<String> =
            cells.map(|c| format!("{} {} {} %", c.joint, regime(&c.regime), percent(c.share))).collect();
        let contrast = self.figures.as_ref().and_then(|f| f.views.as_ref()?.contrast.as_ref());
        let uneven = contrast.map_or_else(String::new, |c| format!(" As given, {}.", c.text()));
        if named.is_empty() {
            return format!("The gap is spread over joints and regimes.{uneven}");
        }
        format!("Of the squared gap: {}.{uneven}", list(&named))
    }

    fn shrink_line(&self) -> String {
        if self.causes.is_empty() {
            return "No cause, so nothing to shrink.".to_owned();
        }
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
        format!("Shrink of the gap, predicted before the sealed torque was read: {}{more}.", each.join("; "))
    }

    fn open_line(&self) -> String {
        let mut open = self.findings();
        if !self.data.unused.is_empty() {
            let (out, all) = (self.data.unused.len(), self.data.unused.len() + self.data.runs);
            open.push(format!("{out} of {all} stretches of logs, whose torque says nothing, were left out"));
        }
        open.extend(self.left_out.iter().map(|what| format!("{what}: no solution")));
        if let Some(share) = self.unexplained_share.filter(|s| *s >= WORTH_NAMING) {
            open.push(format!("{:.0} % of the squared gap above the noise stays unexplained", 100.0 * share));
        }
        let unknown: Vec<&crate::Cell> = self.place.iter().filter(|c| !c.known).collect();
        if !unknown.is_empty() {
            let names: Vec<String> =
                unknown.iter().take(UNKNOWN_CELLS).map(|c| format!("{} {}", c.joint, regime(&c.regime))).collect();
            let more = unknown.len().saturating_sub(UNKNOWN_CELLS);
            let more = if more > 0 { format!(" and {more} more") } else { String::new() };
            open.push(format!("too little data for {}{more}", names.join(", ")));
        }
        if open.is_empty() { "Every joint and regime has data.".to_owned() } else { open.join("; ") + "." }
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
            format!("{} of {run}: {}", fault.replace('_', " "), list(&joints))
        };
        kinds.into_iter().map(of).collect()
    }

    fn has_computed(&self) -> bool {
        self.log.iter().any(|f| f.fault == "torque_computed")
    }

    fn next_line(&self) -> String {
        if self.has_computed() {
            return MEASURE.to_owned();
        }
        if self.log.iter().any(|f| f.fault == "torque_filtered") {
            return "Log the torque without its low-pass, or the positions through the same one.".to_owned();
        }
        let mut faults: Vec<String> =
            self.log.iter().filter(|f| f.fault.starts_with("torque_s")).map(|f| f.joint.clone()).collect();
        if !faults.is_empty() {
            faults.sort();
            faults.dedup();
            return format!(
                "Check sign, unit and scale of the torque of {} before believing anything else.",
                list(&faults)
            );
        }
        if !self.other_arm.is_empty() {
            return "Check that the robot file and its URDF are those of the arm in the logs.".to_owned();
        }
        if let Some(motion) = self.causes.iter().find_map(|c| c.separating_motion.as_ref()) {
            return format!("To tell the causes apart, record {motion}.");
        }
        match self.verdict.as_str() {
            "no_gap" => "Use the model; record other motion to trust it further.".to_owned(),
            "unexplained" => {
                "Look at what is left below, by frequency, angle and joint; record each joint alone, slow and fast."
                    .to_owned()
            }
            "parameter" => "Put the values found into the robot file and diagnose a new run.".to_owned(),
            _ => "Add the effect to the simulator and diagnose a new run.".to_owned(),
        }
    }
}

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
