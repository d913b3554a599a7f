//! The gap divided otherwise than by regime: way since a reversal, load, power, torque, time, pose, frequency.

use rivet_diagnosis as diagnosis;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::document::{Number, number};
use crate::words::figure;

/// All divisions of the held-out log.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Views {
    /// By joint, axis, part. A joint whose load or pose hardly changes has none of that axis, one without a trusted torque none at all.
    pub cells: Vec<View>,
    /// The most uneven division with the nominal model; null where all are about even.
    pub contrast: Option<Contrast>,
}

/// A part of one joint's rows.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct View {
    /// The joint's name.
    pub joint: String,
    /// What its rows are divided by: `travel`, `load`, `power`, `torque`, `time`, `pose` or `frequency`.
    pub axis: String,
    /// Which part.
    pub part: String,
    /// Where the part begins in the unit; null where it has no ends.
    pub from: Number,
    /// Where it ends.
    pub to: Number,
    /// Unit of the ends.
    pub unit: String,
    /// How many rows.
    pub rows: usize,
    /// How long \[s\].
    pub seconds: Number,
    /// Stretches of half a second that hold some of them.
    pub stretches: usize,
    /// Whether these are enough for a decision.
    pub known: bool,
    /// RMS residual of the nominal model there \[N·m\]; in a band of frequency: of that band's share.
    pub before_nm: Number,
    /// With all causes.
    pub after_nm: Number,
    /// As given, in units of the noise of the joint's torque.
    pub before_over_noise: Number,
    /// With all causes.
    pub after_over_noise: Number,
}

/// The two parts of one joint's rows whose residuals of the nominal model differ most.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Contrast {
    /// The joint's name.
    pub joint: String,
    /// What its rows are divided by.
    pub axis: String,
    /// The part with the larger residual.
    pub more: String,
    /// The part with the smaller residual.
    pub less: String,
    /// How many times as much, root mean square.
    pub ratio: Number,
}

impl Views {
    pub(crate) fn new(found: &diagnosis::Views) -> Views {
        Views {
            cells: found.cells.iter().map(View::new).collect(),
            contrast: found.contrast.as_ref().map(|c| Contrast {
                joint: c.joint.clone(),
                axis: c.axis.name().to_owned(),
                more: c.more.to_owned(),
                less: c.less.to_owned(),
                ratio: number(c.ratio),
            }),
        }
    }
}

impl View {
    fn new(view: &diagnosis::View) -> View {
        View {
            joint: view.joint.clone(),
            axis: view.axis.name().to_owned(),
            part: view.part.to_owned(),
            from: view.ends.and_then(|ends| number(ends[0])),
            to: view.ends.and_then(|ends| number(ends[1])),
            unit: view.axis.unit().to_owned(),
            rows: view.rows,
            seconds: number(view.seconds),
            stretches: view.stretches,
            known: view.known,
            before_nm: number(view.before_nm),
            after_nm: number(view.after_nm),
            before_over_noise: number(view.before_nm / view.floor_nm),
            after_over_noise: number(view.after_nm / view.floor_nm),
        }
    }
}

impl Contrast {
    /// In a sentence, without its point.
    pub fn text(&self) -> String {
        let ratio = self.ratio.map_or_else(|| "many".to_owned(), |ratio| figure(ratio, 2));
        let (more, less) = during(&self.axis, &self.more, &self.less);
        format!("{} has {ratio} times the residual {more} as {less}", self.joint)
    }
}

/// Two parts as they stand in a sentence; the second leaves out what the first has said.
fn during(axis: &str, more: &str, less: &str) -> (String, String) {
    match (axis, more) {
        ("travel", "presliding") => ("within half a degree of a reversal".to_owned(), "beyond".to_owned()),
        ("travel", _) => ("beyond half a degree after a reversal".to_owned(), "within".to_owned()),
        ("power", _) => (format!("when {more}"), format!("when {less}")),
        ("load", _) => (format!("under {more} load"), format!("under {less}")),
        ("torque", _) => (format!("at {more} torque"), format!("at {less}")),
        ("time", _) => (format!("in the {more} part of the run"), format!("in the {less}")),
        ("pose", _) => (format!("in the {more} third of its range"), format!("in the {less}")),
        _ => (format!("at {axis} {}", more.replace('_', " ")), format!("at {}", less.replace('_', " "))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_contrast_reads_as_one_would_say_it() {
        let said = |axis: diagnosis::Axis, more: usize, less: usize| {
            let [more, less] = [more, less].map(|p| axis.parts()[p].to_owned());
            Contrast { joint: "elbow".to_owned(), axis: axis.name().to_owned(), more, less, ratio: Some(2.41) }.text()
        };
        assert_eq!(said(diagnosis::Axis::Power, 1, 0), "elbow has 2.4 times the residual when driven as when driving");
        assert_eq!(
            said(diagnosis::Axis::Time, 0, 2),
            "elbow has 2.4 times the residual in the first part of the run as in the third"
        );
        assert!(said(diagnosis::Axis::Load, 2, 0).ends_with("under high load as under low"));
        assert!(said(diagnosis::Axis::Travel, 0, 1).contains("within half a degree of a reversal as beyond"));
    }
}
