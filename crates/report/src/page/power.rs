//! The power of the logs: the weakest effect that would have been found.

use std::fmt::Write as _;

use super::html::{Table, escape};
use crate::document::{Document, Power};
use crate::words::{effect, figure};

pub(super) fn power(document: &Document) -> String {
    let Some(check) = &document.self_check else { return String::new() };
    let mut out = format!(
        "<p>Effects of graded strength, made by a simulated arm's physics along the motion of these logs, were added to the \
         measured torque of {} s. Below is the weakest that is then named first on its joint; strengths are a factor \
         of two apart. \u{201c}found\u{201d} means that the logs already show the effect, so that nothing could be \
         added; \u{201c}as\u{201d} gives the name of the strongest instead. With nothing added and the residual's \
         sign changed block by block, {} of {} resamplings were given a name (false alarms).</p>\n",
        figure(check.seconds, 3),
        check.false_alarms,
        check.resamplings
    );
    let joints: Vec<&str> = document.gap.per_joint.iter().map(|j| j.joint.as_str()).collect();
    let mut head = vec!["Effect", "Unit"];
    head.extend(&joints);
    let mut table =
        Table::new("Weakest effect found, by joint; in brackets its torque over what the model leaves", &head);
    for name in names(&check.powers, true) {
        let of = |joint: &str| check.powers.iter().find(|p| p.effect == name && p.joint.as_deref() == Some(joint));
        let unit = check.powers.iter().find(|p| p.effect == name).map_or("", |p| p.unit.as_str());
        let mut row = format!("<th scope=\"row\">{}</th><td>{}</td>", escape(&effect(name)), escape(unit));
        for joint in &joints {
            let _ = write!(row, "<td>{}</td>", of(joint).map_or_else(|| "-".to_owned(), said));
        }
        table.raw(row);
    }
    out += &table.html();
    let mut table = Table::new("The same of effects on the whole arm", &["Effect", "Unit", "Weakest found"]);
    for name in names(&check.powers, false) {
        if let Some(power) = check.powers.iter().find(|p| p.effect == name) {
            table.row(&[effect(name), escape(&power.unit), escape(&said(power))]);
        }
    }
    if !table.is_empty() {
        out += &table.html();
    }
    out
}

fn names(powers: &[Power], on_joints: bool) -> Vec<&str> {
    let mut names: Vec<&str> = Vec::new();
    for power in powers.iter().filter(|p| p.joint.is_some() == on_joints) {
        if !names.contains(&power.effect.as_str()) {
            names.push(&power.effect);
        }
    }
    names
}

fn said(power: &Power) -> String {
    match (power.smallest, power.named_already) {
        (_, true) => "found".to_owned(),
        (Some(size), false) => {
            let over = power.over_noise.map_or_else(String::new, |o| format!(" ({})", figure(o, 2)));
            format!("{}{over}", figure(size, 2))
        }
        (None, false) => match &power.instead {
            Some(name) => format!("as {}", effect(name)),
            None => format!("not at {}", figure(power.strongest, 2)),
        },
    }
}
