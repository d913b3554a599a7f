//! A row of the fleet table: one diagnosis, or why there is none.

use std::collections::BTreeMap;

use rivet_analysis::fault::Kind;
use rivet_report::{Cause, Document, JointGap};
use serde::{Deserialize, Serialize};

/// What a row is found by: robot, grouping, group of logs.
pub(crate) type Key = (Option<String>, String, String);

/// A row; `columns::COLUMNS` documents the fields.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Row {
    pub(crate) robot: Option<String>,
    pub(crate) group_by: String,
    pub(crate) log_group: String,
    pub(crate) robot_file: Option<String>,
    pub(crate) logs: Vec<String>,
    pub(crate) status: Status,
    pub(crate) error_kind: Option<ErrorKind>,
    pub(crate) error: Option<String>,
    pub(crate) exit_code: Option<i64>,
    pub(crate) verdict: Option<String>,
    pub(crate) remark: Option<String>,
    pub(crate) robot_name: Option<String>,
    pub(crate) gap_before: Option<f64>,
    pub(crate) gap_after: Option<f64>,
    pub(crate) gap_noise_floor: Option<f64>,
    pub(crate) unexplained_share: Option<f64>,
    pub(crate) runs: Option<i64>,
    pub(crate) training_s: Option<f64>,
    pub(crate) held_out_s: Option<f64>,
    pub(crate) joints: Option<Vec<JointCells>>,
    pub(crate) causes: Option<Vec<CauseCells>>,
    pub(crate) held_out: Option<String>,
    pub(crate) model: Option<String>,
    pub(crate) notes: Option<String>,
    pub(crate) duration_s: Option<f64>,
    pub(crate) finished_at: i64,
    pub(crate) channel_map: Vec<String>,
    pub(crate) rivet_version: String,
    pub(crate) program_sha256: String,
    pub(crate) robot_sha256: Option<String>,
    pub(crate) log_sha256: Vec<String>,
    pub(crate) fingerprint: String,
    pub(crate) diagnosis: Option<String>,
}

/// Whether a row holds a diagnosis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Status {
    Diagnosed,
    #[default]
    Failed,
}

/// Why there is no diagnosis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum ErrorKind {
    /// The path of the log names no robot.
    NoRobot,
    /// The diagnosis refuses its options.
    Usage,
    /// The log cannot be used.
    Data,
    /// The robot file has errors.
    Config,
    /// A file cannot be read.
    InputOutput,
    /// The diagnosis panicked or was ended by a signal.
    Crash,
    /// Any other error.
    Other,
}

impl From<Kind> for ErrorKind {
    fn from(kind: Kind) -> ErrorKind {
        match kind {
            Kind::Usage => ErrorKind::Usage,
            Kind::Data => ErrorKind::Data,
            Kind::Config => ErrorKind::Config,
            Kind::InputOutput => ErrorKind::InputOutput,
            Kind::Interrupted | Kind::Other => ErrorKind::Other,
        }
    }
}

impl ErrorKind {
    /// Whether the same inputs may give another result: the next run tries again.
    pub(crate) fn is_transient(self) -> bool {
        matches!(self, ErrorKind::InputOutput | ErrorKind::Crash)
    }
}

/// Gap of one joint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct JointCells {
    joint: String,
    before: Option<f64>,
    after: Option<f64>,
    noise_floor: Option<f64>,
    before_nm: Option<f64>,
    after_nm: Option<f64>,
    noise_floor_nm: Option<f64>,
}

impl From<&JointGap> for JointCells {
    fn from(gap: &JointGap) -> JointCells {
        JointCells {
            joint: gap.joint.clone(),
            before: gap.before,
            after: gap.after,
            noise_floor: gap.noise_floor,
            before_nm: gap.before_nm,
            after_nm: gap.after_nm,
            noise_floor_nm: gap.noise_floor_nm,
        }
    }
}

/// One cause.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct CauseCells {
    effect: String,
    joints: Vec<String>,
    magnitude: BTreeMap<String, Option<f64>>,
    shrink_predicted: Option<f64>,
    shrink_low: Option<f64>,
    shrink_high: Option<f64>,
    shrink_measured: Option<f64>,
    share: Option<f64>,
    p_value: Option<f64>,
    confidence: Option<f64>,
    indistinguishable_from: Vec<String>,
    separating_motion: Option<String>,
}

impl From<&Cause> for CauseCells {
    fn from(cause: &Cause) -> CauseCells {
        CauseCells {
            effect: cause.effect.clone(),
            joints: cause.joints.clone(),
            magnitude: cause.magnitude.clone(),
            shrink_predicted: cause.shrink.predicted,
            shrink_low: cause.shrink.low,
            shrink_high: cause.shrink.high,
            shrink_measured: cause.shrink.measured,
            share: cause.share,
            p_value: cause.p_value,
            confidence: cause.confidence,
            indistinguishable_from: cause.indistinguishable_from.clone(),
            separating_motion: cause.separating_motion.clone(),
        }
    }
}

impl Row {
    /// What the row is found by.
    pub(crate) fn key(&self) -> Key {
        (self.robot.clone(), self.group_by.clone(), self.log_group.clone())
    }

    /// The row with the figures of a diagnosis.
    ///
    /// # Errors
    /// A number that JSON does not have.
    pub(crate) fn with_diagnosis(self, document: Document) -> serde_json::Result<Row> {
        let passport = document.passport.as_ref();
        let (held_out, model) = (passport.map(|p| p.sealed.clone()), passport.map(|p| p.model.clone()));
        let document = document.brief();
        Ok(Row {
            status: Status::Diagnosed,
            verdict: Some(document.verdict.clone()),
            remark: document.remark.clone(),
            robot_name: Some(document.robot.clone()),
            gap_before: document.gap.before,
            gap_after: document.gap.after,
            gap_noise_floor: document.gap.noise_floor,
            unexplained_share: document.unexplained_share,
            runs: i64::try_from(document.data.runs).ok(),
            training_s: document.data.fit_seconds,
            held_out_s: document.data.sealed_seconds,
            joints: Some(document.gap.per_joint.iter().map(JointCells::from).collect()),
            causes: Some(document.causes.iter().map(CauseCells::from).collect()),
            held_out,
            model,
            diagnosis: Some(rivet_files::printable_json(serde_json::to_string(&document)?)),
            ..self
        })
    }

    /// The row of a diagnosis that failed.
    pub(crate) fn with_error(self, kind: ErrorKind, error: String) -> Row {
        Row { status: Status::Failed, error_kind: Some(kind), error: Some(error), ..self }
    }
}
