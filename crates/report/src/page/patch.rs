//! What each target format can hold of what was found.

use std::fmt::Write as _;

use super::html::{Table, escape};
use crate::document::Document;
use crate::words::figure;

/// What each file written holds, and what it costs where it does not.
pub(super) fn patch(document: &Document) -> String {
    if document.export.is_empty() {
        return String::new();
    }
    let mut out = String::from(
        "<p>What the files that <code>rivet diagnose --export</code> writes hold of the corrected model, and the \
         torque that a reader lacks where they do not.</p>\n",
    );
    let joints = &document.gap.per_joint;
    for format in &document.export {
        let mut head = vec!["What", "Fidelity", "Where it stands, or why not"];
        head.extend(joints.iter().map(|j| j.joint.as_str()));
        let mut table = Table::new(&format!("{}: torque of each thing, rms [N m]", format.file), &head);
        let numbers = |values: &[f64]| -> String {
            values.iter().fold(String::new(), |mut row, v| {
                // Writing to a String cannot fail, here and below.
                let _ = write!(row, "<td>{}</td>", figure(*v, 2));
                row
            })
        };
        for item in &format.items {
            table.raw(format!(
                "<th scope=\"row\">{}</th><td class=\"state\">{}</td><td class=\"text\">{}</td>{}",
                escape(&item.what),
                escape(&item.fidelity),
                escape(&item.place),
                numbers(&item.torque_rms_nm)
            ));
        }
        for (what, values) in [
            ("torque that a reader lacks", &format.missed_nm),
            ("gap of a reader", &format.gap_nm),
            ("gap of the nominal model, in this format", &format.gap_before_nm),
        ]
        .into_iter()
        .filter(|(_, values)| !values.is_empty())
        {
            table.raw(format!("<th scope=\"row\">{what}</th><td></td><td></td>{}", numbers(values)));
        }
        let exact = format.items.iter().filter(|i| i.fidelity == "exact").count();
        let _ = writeln!(
            out,
            "<details><summary>{}: {exact} of {} things exact</summary>{}</details>",
            escape(&format.file),
            format.items.len(),
            table.html()
        );
    }
    out
}
