//! What a diagnosis says, as it stands in JSON (`docs/diagnosis-json.md`, `docs/diagnosis.schema.json`).

mod export;
mod figures;
mod of_diagnosis;
mod passport;
mod self_check;

pub use export::{Format, FormatItem};
pub use figures::{Curve, Excerpt, Figures, Left, Order, Parameter, Point, Stage};
pub(crate) use of_diagnosis::number;
pub use passport::{Clock, ClockOff, Input, Passport, Tool};
pub use self_check::{Power, SelfCheck};

use std::collections::BTreeMap;

use rivet_diagnosis::{Effect, Kind};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Name and version of the format. Fields may be added within a version; a changed meaning is a new one.
pub const SCHEMA: &str = "rivet.diagnosis.v1";

/// A figure, or null for what JSON has no number for.
pub type Number = Option<f64>;

/// Size of an effect, by name with unit.
pub type Magnitude = BTreeMap<String, Number>;

/// The whole document.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Document {
    /// [`SCHEMA`].
    pub schema: String,
    /// The robot's name.
    pub robot: String,
    /// The answer in one word.
    pub verdict: String,
    /// Residual on the held-out log, relative to its torque.
    pub gap: Gap,
    /// Where it lies, largest share first.
    #[serde(rename = "where")]
    pub place: Vec<Cell>,
    /// In the order of adoption.
    pub causes: Vec<Cause>,
    /// Faults of the log itself.
    pub log: Vec<LogFinding>,
    /// Considered and not upheld.
    pub hints: Vec<Cause>,
    /// Share of the squared gap above the floor that is left.
    pub unexplained_share: Number,
    /// Of the squared gap that is left with all causes: how softly friction turns over where joints creep, which no exported file holds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub creeping_share: Number,
    /// What was used.
    pub data: DataUse,
    /// Why nothing was evaluated.
    pub remark: Option<String>,
    /// Steps whose equations had no solution; everything else stands without them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub left_out: Vec<String>,
    /// Whether the held-out log refutes the fit of the training logs: then no cause is named.
    #[serde(default, skip_serializing_if = "is_false")]
    pub refuted: bool,
    /// Difference between the training logs and the held-out log, where there is one. `sealed_differs`: the training logs reach their noise, the
    /// held-out log does not. `sealed_as_given`: the fit fails on the held-out log, and the nominal model fits it. `values_unseen`: one set of
    /// parameters fits all logs, but the training logs alone do not determine it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub between_runs: Option<String>,
    /// Joints whose bodies and rotors are off by more than a data sheet ever is, where that is most of them: then no cause is named.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub other_arm: Vec<String>,
    /// Which files and which build.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub passport: Option<Passport>,
    /// What stands behind the figures.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub figures: Option<Figures>,
    /// What each file format holds of the model that was found.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub export: Vec<Format>,
    /// What these very runs would have shown.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub self_check: Option<SelfCheck>,
    /// The corrected simulator in closed loop.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rollout: Option<crate::Rollout>,
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_false(flag: &bool) -> bool {
    !flag
}

/// Gaps of the held-out log.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Gap {
    /// Of the nominal model, all joints.
    pub before: Number,
    /// With all causes.
    pub after: Number,
    /// Of the torque signal's noise.
    pub noise_floor: Number,
    /// Base to flange.
    pub per_joint: Vec<JointGap>,
}

/// Gap of one joint, relative to its torque; in N·m where the name ends so.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[allow(missing_docs, reason = "before, after and noise floor of each measure are the names themselves")]
pub struct JointGap {
    pub joint: String,
    pub before: Number,
    pub after: Number,
    pub noise_floor: Number,
    /// In motion, where the direction of friction is known, over the noise of the torque signal: nominal model, all causes.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub in_motion: Vec<Number>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub torque_nm: Number,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub before_nm: Number,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub after_nm: Number,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise_floor_nm: Number,
    /// Where the noise floor comes from: `signal`, what changes too fast to be motion, or `repeats`, what torque differs by where the
    /// runs hold the same motion twice, if that is more.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub floor_from: Option<String>,
    /// What torque differs by there, root mean square in one of two runs \[N·m\].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub repeats_nm: Number,
    /// How much motion was seen twice \[s\].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub repeats_s: Number,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bias_before_nm: Number,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bias_after_nm: Number,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub peak_before_nm: Number,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub peak_after_nm: Number,
}

/// One regime of one joint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Cell {
    /// The joint's name.
    pub joint: String,
    /// What it does.
    pub regime: String,
    /// Of the squared gap of all joints.
    pub share: Number,
    /// How long \[s\].
    pub seconds: Number,
    /// Whether that is long enough for a decision.
    #[serde(default)]
    pub known: bool,
    /// RMS residual of the nominal model there \[N·m\].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub before_nm: Number,
    /// With all causes \[N·m\].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub after_nm: Number,
}

/// One cause.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Cause {
    /// Its name.
    pub effect: String,
    /// The joints' names; empty when it belongs to none or to all.
    pub joints: Vec<String>,
    /// Its size.
    pub magnitude: Magnitude,
    /// 90 % intervals of sizes, by the same names: over resampled blocks of the training logs and over the posterior. Inner values
    /// (a velocity, an order) and forces that come and go have none.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub magnitude_interval: BTreeMap<String, [f64; 2]>,
    /// How far the gap shrinks.
    pub shrink: Shrink,
    /// Share of the squared gap on the training logs, independent of the order of causes (Shapley value of the explained variance); null for
    /// a hint.
    #[serde(default)]
    pub share: Number,
    /// Family-wise p-value: chance that the strongest of all candidates looks as strong without an effect, by sign flips of blocks of the
    /// residual (max-T). Null for parameters and contact. Above 0.05 only where the prior of the parameters that imitate it decided, or a command
    /// beyond the limit.
    #[serde(default)]
    pub p_value: Number,
    /// 0 to 1.
    pub confidence: Number,
    /// Effects and parameters of the model that these logs do not separate from it.
    pub indistinguishable_from: Vec<String>,
    /// Principal angle between its torque and that of each of these \[degrees\]; 90 would be two that have nothing in common.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub angles_deg: Vec<Number>,
    /// The motion that would.
    pub separating_motion: Option<String>,
    /// The held-out log with and without it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub curves: Vec<Curve>,
    /// Of a hint outside of physical bounds, or that the motion does not separate from something else: why it is no cause. Its shrink is unknown.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub impossible: Option<String>,
}

/// `1 − after/before` on the held-out log, relative to the model with the causes listed before.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Shrink {
    /// Before the held-out torque was read.
    pub predicted: Number,
    /// Lower end of the 90 % interval.
    pub low: Number,
    /// Upper end.
    pub high: Number,
    /// On the held-out torque.
    pub measured: Number,
}

/// A fault of one joint's signals.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct LogFinding {
    /// The run's name.
    pub run: String,
    /// The joint's name.
    pub joint: String,
    /// What is wrong.
    pub fault: String,
    /// Its figure.
    pub value: Number,
    /// In a sentence.
    pub text: String,
}

/// Which data were used for what.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct DataUse {
    /// Logs, the held-out one included.
    pub runs: usize,
    /// Whether they are two parts of one log: the first is for training, the rest is held out.
    #[serde(default)]
    pub cut: bool,
    /// Looked at.
    pub fit_seconds: Number,
    /// Sealed.
    pub sealed_seconds: Number,
    /// Share of the time at speeds that are rarer on the training logs than on the held-out log, where it is so large that intervals are
    /// wider for it.
    #[serde(default)]
    pub of_another_kind: Number,
    /// Names of logs that were excluded, since their torque carries no information.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub unused: Vec<String>,
}

impl Cause {
    /// Sizes by which forms stand that have no name but that of what they would be taken for.
    pub(crate) const POSITION_GAIN: &str = "position_gain";
    pub(crate) const HYSTERESIS: &str = "hysteresis_Nm";
    pub(crate) const CONSTANT: &str = "constant_Nm";

    /// Whether it is a wrong value of the model, rather than an effect that the model lacks.
    pub(crate) fn is_value(&self) -> bool {
        is_value(&self.effect)
    }

    /// Whether it stands by such a size: no effect of the list.
    pub(crate) fn is_nameless(&self) -> bool {
        [Self::POSITION_GAIN, Self::HYSTERESIS, Self::CONSTANT].iter().any(|name| self.magnitude.contains_key(*name))
    }

    /// What it is, in words: its name, but for a hint whose form has none of its own.
    pub fn word(&self) -> String {
        if self.magnitude.contains_key(Self::POSITION_GAIN) {
            "a scale of the position".to_owned()
        } else if self.magnitude.contains_key(Self::HYSTERESIS) {
            "hysteresis in parallel to friction".to_owned()
        } else if self.magnitude.contains_key(Self::CONSTANT) {
            "a constant torque".to_owned()
        } else {
            crate::terms::effect(&self.effect)
        }
    }
}

impl Document {
    /// The JSON Schema of documents.
    pub fn schema() -> schemars::Schema {
        schemars::schema_for!(Document)
    }

    /// Takes back what the log says as it is: it has to be read otherwise, as `why` says.
    pub fn is_misread(&mut self, why: &str) {
        "not_evaluated".clone_into(&mut self.verdict);
        self.remark = Some(why.to_owned());
        self.hints.splice(0..0, self.causes.drain(..));
        self.other_arm.clear();
    }

    /// The verdict alone, without what only a page shows.
    #[must_use]
    pub fn brief(mut self) -> Document {
        self.passport = None;
        self.figures = None;
        self.export.clear();
        for cause in self.causes.iter_mut().chain(&mut self.hints) {
            cause.curves.clear();
        }
        self
    }
}

/// Whether a name is that of a wrong value of the model, rather than of an effect that the model lacks.
pub fn is_value(name: &str) -> bool {
    Effect::ALL.iter().any(|effect| effect.name() == name && effect.kind() == Kind::Value)
}

/// Whether a cause is a touch from outside.
pub(crate) fn is_contact(cause: &Cause) -> bool {
    cause.effect == "external_force"
}

/// A document with no more than the contract asks for.
#[cfg(test)]
pub(crate) const CONTRACT: &str = r#"{"schema": "rivet.diagnosis.v1", "robot": "r", "verdict": "effect",
            "gap": {"before": 0.3, "after": 0.1, "noise_floor": 0.05, "per_joint":
                [{"joint": "j", "before": 0.3, "after": 0.1, "noise_floor": 0.05}]},
            "where": [{"joint": "j", "regime": "reversal", "share": 0.6, "seconds": 2.0}],
            "causes": [{"effect": "joint_spring", "joints": ["j"], "magnitude": {"stiffness_Nm_rad": 8.0},
                "shrink": {"predicted": 0.7, "low": 0.6, "high": 0.8, "measured": null}, "confidence": 0.9,
                "indistinguishable_from": [], "separating_motion": null}],
            "log": [], "hints": [], "unexplained_share": 0.1,
            "data": {"runs": 2, "fit_seconds": 10.0, "sealed_seconds": 5.0}, "remark": null}"#;

#[cfg(test)]
mod tests {
    use super::*;

    /// The committed schema is that of the documents: made anew by `cargo run -p rivet-report --example schema`.
    #[test]
    fn the_committed_schema_is_that_of_this_build() {
        let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/diagnosis.schema.json");
        let kept: serde_json::Value =
            serde_json::from_str(&std::fs::read_to_string(file).expect("a schema")).expect("JSON");
        assert_eq!(kept, serde_json::to_value(Document::schema()).expect("JSON"));
    }

    /// What the contract asks for is enough; whatever was added later may be absent.
    #[test]
    fn documents_with_the_contracts_fields_alone_are_read() {
        let document: Document = serde_json::from_str(CONTRACT).expect("a document");
        assert_eq!(document.causes[0].shrink.measured, None);
        // A page and a verdict can be made of no more than that.
        assert_eq!(document.lines(&[]).iter().filter(|line| line.head == "Do").count(), 1);
        assert!(crate::page(&document, &[]).contains("joint spring"));
    }
}
