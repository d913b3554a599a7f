//! What changed between two diagnoses that were made by the same rules.

use serde::Serialize;

use crate::document::{Cause, Document, Number};

/// Rates that differ by more than this share are another protocol.
const RATE: f64 = 0.05;
/// Gaps that differ by less than this are the same.
const SAME_GAP: f64 = 0.01;

/// Something in two diagnoses.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Pair<T> {
    /// In the first.
    pub a: T,
    /// In the second.
    pub b: T,
}

/// A cause of both diagnoses.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Kept {
    /// Its name.
    pub effect: String,
    /// Its joints.
    pub joints: Vec<String>,
    /// Sizes by name.
    pub magnitude: Vec<(String, Pair<Number>)>,
    /// Measured shrink.
    pub shrink: Pair<Number>,
}

/// Gap of a joint, model as given.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct JointChange {
    /// The joint's name.
    pub joint: String,
    /// With the nominal model.
    pub before: Pair<Number>,
    /// With all causes.
    pub after: Pair<Number>,
}

/// A value that both diagnoses pin, with intervals that do not meet.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ValueChange {
    /// Its name.
    pub name: String,
    /// Its unit.
    pub unit: String,
    /// As found.
    pub found: Pair<Number>,
}

/// All that changed.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Changes {
    /// In one word each.
    pub verdict: Pair<String>,
    /// Gap of the model as given.
    pub before: Pair<Number>,
    /// With all causes.
    pub after: Pair<Number>,
    /// Joints whose gap differs by more than a point.
    pub joints: Vec<JointChange>,
    /// Named in the second only.
    pub appeared: Vec<(String, Vec<String>)>,
    /// Named in the first only.
    pub gone: Vec<(String, Vec<String>)>,
    /// Named in both.
    pub kept: Vec<Kept>,
    /// Values of the model.
    pub values: Vec<ValueChange>,
    /// What else differs and does not forbid the comparison: files, build.
    pub notes: Vec<String>,
}

impl Changes {
    /// From `a` to `b`.
    ///
    /// # Errors
    /// Every rule in which the two diagnoses differ: figures made by other rules do not compare.
    pub fn between(a: &Document, b: &Document) -> Result<Changes, Vec<String>> {
        let mismatches = mismatches(a, b);
        if !mismatches.is_empty() {
            return Err(mismatches);
        }
        let same = |x: &Cause, y: &Cause| x.effect == y.effect && x.joints == y.joints;
        let only = |x: &Document, y: &Document| -> Vec<(String, Vec<String>)> {
            let alone = x.causes.iter().filter(|c| !y.causes.iter().any(|d| same(c, d)));
            alone.map(|c| (c.effect.clone(), c.joints.clone())).collect()
        };
        let kept = a.causes.iter().filter_map(|c| Some((c, b.causes.iter().find(|d| same(c, d))?)));
        let far = |x: Number, y: Number| match (x, y) {
            (Some(x), Some(y)) => (x - y).abs() > SAME_GAP,
            _ => x != y,
        };
        let joints = a.gap.per_joint.iter().zip(&b.gap.per_joint);
        Ok(Changes {
            verdict: Pair { a: a.verdict.clone(), b: b.verdict.clone() },
            before: Pair { a: a.gap.before, b: b.gap.before },
            after: Pair { a: a.gap.after, b: b.gap.after },
            joints: joints
                .filter(|(x, y)| far(x.before, y.before) || far(x.after, y.after))
                .map(|(x, y)| JointChange {
                    joint: x.joint.clone(),
                    before: Pair { a: x.before, b: y.before },
                    after: Pair { a: x.after, b: y.after },
                })
                .collect(),
            appeared: only(b, a),
            gone: only(a, b),
            kept: kept.map(|(c, d)| Kept::new(c, d)).collect(),
            values: values(a, b),
            notes: notes(a, b),
        })
    }

    /// Whether the two say the same: verdict and names of causes.
    pub fn is_same(&self) -> bool {
        self.verdict.a == self.verdict.b && self.appeared.is_empty() && self.gone.is_empty()
    }
}

impl Kept {
    fn new(a: &Cause, b: &Cause) -> Kept {
        let sizes =
            a.magnitude.iter().filter_map(|(name, x)| Some((name.clone(), Pair { a: *x, b: *b.magnitude.get(name)? })));
        Kept {
            effect: a.effect.clone(),
            joints: a.joints.clone(),
            magnitude: sizes.collect(),
            shrink: Pair { a: a.shrink.measured, b: b.shrink.measured },
        }
    }
}

/// Rules in which two diagnoses differ.
fn mismatches(a: &Document, b: &Document) -> Vec<String> {
    let mut found = Vec::new();
    let mut rule = |what: &str, a: String, b: String| {
        if a != b {
            found.push(format!("{what}: {a} against {b}"));
        }
    };
    rule("format", a.schema.clone(), b.schema.clone());
    rule("robot", a.robot.clone(), b.robot.clone());
    let joints = |d: &Document| d.gap.per_joint.iter().map(|j| j.joint.as_str()).collect::<Vec<_>>().join(" ");
    // A diagnosis that was not evaluated has no joints; its verdict says so.
    if a.remark.is_none() && b.remark.is_none() {
        rule("joints", joints(a), joints(b));
    }
    let (Some(x), Some(y)) = (&a.passport, &b.passport) else {
        found.push(
            "passport: at least one of the two has none, so it is unknown whether they were made alike".to_owned(),
        );
        return found;
    };
    rule("version", x.tool.version.clone(), y.tool.version.clone());
    rule("kinematics and structure of the model", x.model.clone(), y.model.clone());
    rule("torque", x.torque.clone(), y.torque.clone());
    let whole = |d: &Document| {
        if d.data.cut { "the rest of the training log" } else { "a separate log" }
    };
    rule("held-out data", whole(a).to_owned(), whole(b).to_owned());
    let step = |p: &crate::Passport| {
        let steps: Vec<f64> = p.inputs.iter().filter_map(|i| i.clock.as_ref()).map(|c| c.step_s).collect();
        steps.iter().sum::<f64>() / steps.len().max(1) as f64
    };
    let (s, t) = (step(x), step(y));
    if (s - t).abs() > RATE * s.max(t) {
        found.push(format!("rate: {s:.4} s a sample against {t:.4} s"));
    }
    found
}

/// Values that both diagnoses pin and that differ by more than both intervals.
fn values(a: &Document, b: &Document) -> Vec<ValueChange> {
    let (Some(x), Some(y)) = (&a.figures, &b.figures) else { return Vec::new() };
    x.parameters
        .iter()
        .filter_map(|p| Some((p, y.parameters.iter().find(|q| q.name == p.name)?)))
        .filter(|(p, q)| p.state == "pinned" && q.state == "pinned")
        .filter(|(p, q)| p.high < q.low || q.high < p.low)
        .map(|(p, q)| ValueChange {
            name: p.name.clone(),
            unit: p.unit.clone(),
            found: Pair { a: p.found, b: q.found },
        })
        .collect()
}

fn notes(a: &Document, b: &Document) -> Vec<String> {
    let mut notes = Vec::new();
    let (Some(x), Some(y)) = (&a.passport, &b.passport) else { return notes };
    if x.tool.sha256 != y.tool.sha256 {
        notes.push("another build of the same version".to_owned());
    }
    for (role, name) in [("robot", "robot file"), ("urdf", "URDF"), ("log", "logs")] {
        let of = |p: &crate::Passport| -> Vec<String> {
            p.inputs.iter().filter(|i| i.role == role).map(|i| i.sha256.clone()).collect()
        };
        if of(x) == of(y) {
            notes.push(format!("same {name}"));
        } else {
            notes.push(format!("other {name}"));
        }
    }
    notes
}
