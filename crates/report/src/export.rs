//! What each file of an export carries of the corrected model.

use rivet_diagnosis::{FormatReport, Patch};

use crate::document::{Document, Format, FormatItem};

impl Document {
    /// Of the motion that would tell a cause from its rivals, the one that was found for these runs and is expected to tell; `names`: of the joints.
    pub fn tells_motions(&mut self, patch: &Patch, names: &[String]) {
        for motion in patch.motions.iter().filter(|motion| motion.is_conclusive()) {
            let joints: Vec<&String> = motion.joints.iter().map(|j| &names[*j]).collect();
            let of = |cause: &&mut crate::Cause| {
                cause.effect == motion.effect.name() && cause.joints.iter().eq(joints.iter().copied())
            };
            if let Some(cause) = self.causes.iter_mut().find(of) {
                cause.separating_motion = Some(motion.text.clone());
            }
        }
    }
}

/// All files of an export, for [`Document::export`](crate::Document::export).
pub fn formats(patch: &Patch) -> Vec<Format> {
    let format = |report: &FormatReport| Format {
        file: report.format.file().to_owned(),
        items: report
            .items
            .iter()
            .map(|i| FormatItem {
                what: i.what.clone(),
                fidelity: i.fidelity.name().to_owned(),
                place: i.place.clone(),
                torque_rms_nm: i.torque_rms.clone(),
            })
            .collect(),
        missed_nm: report.missed.clone(),
        gap_nm: report.gap.clone(),
        gap_before_nm: report.gap_before.clone(),
    };
    patch.formats.iter().map(format).collect()
}
