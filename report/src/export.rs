//! What each file of an export carries of the corrected model.

use rivet_diagnosis::{FormatReport, Patch};

use crate::document::{Format, FormatItem};

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
