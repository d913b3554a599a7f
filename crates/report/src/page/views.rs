//! The gap of each joint divided otherwise than by regime, one small table an axis.

use std::fmt::Write as _;

use rivet_diagnosis::Axis;

use super::html::{Table, escape};
use super::sections::{nm, pair};
use crate::document::Document;
use crate::views::View;
use crate::words::figure;

pub(super) fn views(document: &Document) -> String {
    let Some(views) = document.figures.as_ref().and_then(|f| f.views.as_ref()) else { return String::new() };
    let mut out = String::from(
        "<details><summary>Further divisions of the gap</summary>\n<p>Residual of each joint, nominal \u{2192} with causes, in units \
         of its noise; below it the same in N m, root mean square. Rows count while the joint moves and the direction of friction is known; bands of \
         frequency use all rows. The stronger the colour, the larger compared with the other parts of that row. Hatched: fewer \
         than six stretches of half a second, too little data. A dash: the quantity hardly varies.</p>\n",
    );
    if let Some(contrast) = &views.contrast {
        let _ = writeln!(out, "<p>Most uneven, nominal: {}.</p>", escape(&contrast.text()));
    }
    out.push_str("<div class=\"figures wide views\">");
    for axis in Axis::ALL {
        let cells: Vec<&View> = views.cells.iter().filter(|c| c.axis == axis.name()).collect();
        if cells.is_empty() {
            continue;
        }
        let mut heads = vec!["Joint"];
        heads.extend(axis.parts().iter().map(|part| head(part)));
        let mut table = Table::new(caption(axis), &heads).class("heat");
        for joint in &document.gap.per_joint {
            let own = |part: &str| cells.iter().find(|c| c.joint == joint.joint && c.part == part);
            let known = axis.parts().iter().filter_map(|part| own(part)).filter(|c| c.known);
            let most = known.filter_map(|c| c.before_nm).fold(f64::MIN_POSITIVE, f64::max);
            // Long names may break where their words end.
            let name = escape(&joint.joint).replace('_', "_<wbr>");
            let mut row = format!("<th scope=\"row\">{name}</th>");
            for part in axis.parts() {
                row += &own(part).map_or_else(|| "<td>-</td>".to_owned(), |c| cell(c, most));
            }
            table.raw(row);
        }
        let _ = write!(out, "<div>{}</div>", table.html());
    }
    out.push_str("</div></details>\n");
    out
}

/// `most`: of the row, as given \[N·m\].
fn cell(cell: &View, most: f64) -> String {
    let ends = match (cell.from, cell.to) {
        (Some(from), Some(to)) => {
            let unit = escape(&cell.unit);
            format!(" title=\"{} to {} {unit}, {} s\"", figure(from, 3), figure(to, 3), nm(cell.seconds))
        }
        _ => format!(" title=\"{} s\"", nm(cell.seconds)),
    };
    if !cell.known {
        let seconds = cell.seconds.map_or_else(|| "-".to_owned(), |s| figure(s, 2));
        return format!("<td class=\"few\"{ends}><span>too little: {seconds}&nbsp;s</span></td>");
    }
    let times = |x: Option<f64>| x.map_or_else(|| "-".to_owned(), |x| figure(x, 2));
    format!(
        "<td style=\"background:rgba(var(--heat),{:.2})\"{ends}>{} \u{2192} {}<small>{}</small></td>",
        0.4 * (cell.before_nm.unwrap_or(0.0) / most).clamp(0.0, 1.0).powi(2),
        times(cell.before_over_noise),
        times(cell.after_over_noise),
        pair(cell.before_nm, cell.after_nm).join(" \u{2192} ")
    )
}

fn caption(axis: Axis) -> &'static str {
    match axis {
        Axis::Travel => "Travel since the last reversal",
        Axis::Load => "Torque of links and payload by the nominal model, without sign: thirds of its range",
        Axis::Power => "Driving: the torque moves the joint; driven: the torque brakes it",
        Axis::Torque => "Measured torque, without sign: thirds of its range",
        Axis::Time => "Time since the run began: thirds",
        Axis::Pose => "Position of the joint: thirds of its range",
        Axis::Frequency => "Frequency of the residual",
    }
}

fn head(part: &'static str) -> &'static str {
    match part {
        "presliding" => "up to half a degree",
        "below_1_hz" => "below 1 Hz",
        "1_to_5_hz" => "1 to 5 Hz",
        "above_5_hz" => "above 5 Hz",
        other => other,
    }
}
