//! Ledger, heat map, waterfall, values, passport.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use super::html::{Table, escape, facts};
use crate::document::{Cell, Document, Number, Parameter, Stage};
use crate::verdict::regime;
use crate::words::{effect, figure, joints, percent, value_label};

/// Digits of a hash that a page shows; the JSON has all.
const HASH: usize = 16;

pub(super) fn nm(x: Number) -> String {
    x.map_or_else(|| "-".to_owned(), |x| figure(x, 3))
}

/// Two figures to be compared, \[N·m\]: as many decimals for both as give the larger one three digits.
pub(super) fn pair(before: Number, after: Number) -> [String; 2] {
    let most = [before, after].into_iter().flatten().fold(0.0_f64, |m, x| m.max(x.abs()));
    if !(1e-6..1e5).contains(&most) {
        return [nm(before), nm(after)];
    }
    let decimals = (2.0 - most.log10().floor()).max(0.0) as usize;
    // What rounds to nothing has no sign.
    let one = |x: f64| {
        let text = format!("{x:.decimals$}");
        if text.chars().any(|c| ('1'..='9').contains(&c)) { text } else { text.trim_start_matches('-').to_owned() }
    };
    [before, after].map(|x| x.map_or_else(|| "-".to_owned(), one))
}

pub(super) fn ledger(document: &Document) -> String {
    let mut out = String::from(
        "<p>Residual of each joint's torque on the held-out log. The noise is what changes too fast to be torque; no \
         model can go below it.</p>\n",
    );
    let head = [
        "Joint",
        "Torque, rms [N\u{a0}m]",
        "Nominal [%]",
        "With causes [%]",
        "Noise [%]",
        "Nominal, rms [N\u{a0}m]",
        "With causes, rms [N\u{a0}m]",
        "Noise, rms [N\u{a0}m]",
        "Moving: nominal / with causes [times the noise]",
        "Mean, nominal / with causes [N\u{a0}m]",
        "Largest, nominal / with causes [N\u{a0}m]",
    ];
    let mut table = Table::new("Gap of each joint on the held-out log", &head).class("ledger");
    for j in &document.gap.per_joint {
        table.row(&[
            j.joint.clone(),
            nm(j.torque_nm),
            percent(j.before),
            percent(j.after),
            percent(j.noise_floor),
            nm(j.before_nm),
            nm(j.after_nm),
            nm(j.noise_floor_nm),
            match j.in_motion.as_slice() {
                [Some(before), Some(after)] => format!("{} / {}", figure(*before, 2), figure(*after, 2)),
                _ => String::new(),
            },
            pair(j.bias_before_nm, j.bias_after_nm).join(" / "),
            pair(j.peak_before_nm, j.peak_after_nm).join(" / "),
        ]);
    }
    let gap = &document.gap;
    table.row(&[
        "all joints".to_owned(),
        String::new(),
        percent(gap.before),
        percent(gap.after),
        percent(gap.noise_floor),
        String::new(),
        String::new(),
        String::new(),
        String::new(),
        String::new(),
        String::new(),
    ]);
    out += &table.html();
    out
}

pub(super) fn place(document: &Document) -> String {
    let mut regimes: Vec<&str> = Vec::new();
    for name in ["rest", "reversal", "slow", "accelerating", "cruise"] {
        if document.place.iter().any(|c| c.regime == name) {
            regimes.push(name);
        }
    }
    for cell in &document.place {
        if !regimes.contains(&cell.regime.as_str()) {
            regimes.push(&cell.regime);
        }
    }
    let cells: BTreeMap<(&str, &str), &Cell> =
        document.place.iter().map(|c| ((c.joint.as_str(), c.regime.as_str()), c)).collect();
    let most = document.place.iter().filter_map(|c| c.share).fold(0.0_f64, f64::max).max(1e-9);
    let heads: Vec<String> = std::iter::once("Joint".to_owned()).chain(regimes.iter().map(|r| regime(r))).collect();
    let heads: Vec<&str> = heads.iter().map(String::as_str).collect();
    let caption = "Share of the squared gap of the nominal model, each joint's torque scaled to the same size [%]; \
                   below it the residual, nominal and with causes, rms [N m]. The stronger the colour, the larger the share. \
                   Hatched: too little data.";
    let mut table = Table::new(caption, &heads).class("heat");
    for joint in &document.gap.per_joint {
        let mut row = format!("<th scope=\"row\">{}</th>", escape(&joint.joint));
        for name in &regimes {
            let cell = cells.get(&(joint.joint.as_str(), *name));
            let _ = match cell {
                Some(cell) if cell.known => {
                    let share = cell.share.unwrap_or(0.0);
                    write!(
                        row,
                        "<td style=\"background:rgba(var(--heat),{:.2})\">{}<small>{}</small></td>",
                        0.55 * (share / most).clamp(0.0, 1.0).sqrt(),
                        percent(cell.share),
                        pair(cell.before_nm, cell.after_nm).join(" \u{2192} ")
                    )
                }
                Some(cell) => {
                    write!(row, "<td class=\"few\"><span>too little: {} s</span></td>", nm(cell.seconds))
                }
                None => write!(row, "<td class=\"few\"><span>not seen</span></td>"),
            };
        }
        table.raw(row);
    }
    let mut out = table.html();
    let worse: Vec<String> = worse(document)
        .map(|c| format!("{} {} ({} to {} N m)", c.joint, regime(&c.regime), nm(c.before_nm), nm(c.after_nm)))
        .collect();
    let said = if worse.is_empty() {
        "No joint became worse in any regime.".to_owned()
    } else {
        format!("What became worse: {}.", worse.join("; "))
    };
    let _ = writeln!(out, "<p>{}</p>", escape(&said));
    out
}

/// Cells in which the model with all causes is further off than the one given, by more than a twentieth and by more than
/// a tenth of the joint's noise.
fn worse(document: &Document) -> impl Iterator<Item = &Cell> {
    document.place.iter().filter(|c| {
        let floor = document.gap.per_joint.iter().find(|j| j.joint == c.joint).and_then(|j| j.noise_floor_nm);
        let (Some(before), Some(after)) = (c.before_nm, c.after_nm) else { return false };
        c.known && after > 1.05 * before && after - before > 0.1 * floor.unwrap_or(0.0)
    })
}

pub(super) fn stages(document: &Document) -> String {
    let Some(figures) = &document.figures else { return String::new() };
    let stages = &figures.stages;
    if stages.len() < 2 {
        return String::new();
    }
    let most = stages
        .iter()
        .flat_map(|s| [s.predicted, s.high, s.measured])
        .flatten()
        .fold(0.0_f64, f64::max)
        .max(document.gap.noise_floor.unwrap_or(0.0))
        .max(1e-9);
    let share = |x: Number| 100.0 * (x.unwrap_or(0.0) / most).clamp(0.0, 1.0);
    let mut out = String::from(
        "<p>The gap as one thing after another is added to the model. Outlined: predicted from the held-out motion \
         before its torque was read, with the 90 % interval as a stroke. Filled: measured. Dashed: noise.</p>\n\
         <ol class=\"stages\">",
    );
    let all = document.gap.per_joint.len();
    for (k, stage) in stages.iter().enumerate() {
        let (name, note) = title(stage, k, stages.len(), all);
        let _ = write!(
            out,
            "<li><div>{}{}</div><div class=\"track\" aria-hidden=\"true\"><b class=\"p\" style=\"width:{:.1}%\"></b>\
             <b class=\"w\" style=\"left:{:.1}%;width:{:.1}%\"></b><b class=\"m\" style=\"width:{:.1}%\"></b>\
             <b class=\"n\" style=\"left:{:.1}%\"></b></div>\
             <div class=\"nums\">predicted <strong>{} %</strong> ({}..{})<br>measured <strong>{} %</strong></div></li>",
            escape(&name),
            if note.is_empty() { String::new() } else { format!(" <span class=\"soft\">{}</span>", escape(&note)) },
            share(stage.predicted),
            share(stage.low),
            share(stage.high) - share(stage.low),
            share(stage.measured),
            share(document.gap.noise_floor),
            percent(stage.predicted),
            percent(stage.low),
            percent(stage.high),
            percent(stage.measured),
        );
    }
    out.push_str("</ol>\n");
    if stages.iter().any(|stage| stage.effect.is_some() && !stage.upheld) {
        let _ = writeln!(
            out,
            "<p>The reported model leaves out what is not supported. It measures <strong>{} %</strong>.</p>",
            percent(document.gap.after)
        );
    }
    out
}

fn title(stage: &Stage, k: usize, count: usize, all: usize) -> (String, String) {
    match &stage.effect {
        Some(name) => {
            let on = format!("on {}", joints(&stage.joints, all));
            let note = if stage.upheld { on } else { format!("{on}; not supported, so not named") };
            (format!("with {}", effect(name)), note)
        }
        None if k == 0 => ("Nominal model".to_owned(), String::new()),
        None if k + 1 == count => (
            "with small changes of the other parameters".to_owned(),
            "offsets, timing, bodies within their usual error".to_owned(),
        ),
        None => (String::new(), String::new()),
    }
}

pub(super) fn parameters(document: &Document) -> String {
    let Some(figures) = &document.figures else { return String::new() };
    let mut out = String::from(
        "<p>Parameters of the model after the refit. PINNED: the logs determine the value. NOT PINNED: they carry \
         little information, and the prior (the file's value with its usual error) decides. AT BOUND: the value is \
         outside of physical bounds, so something else acts through it. Intervals are 90 %, over resampled blocks of \
         the training logs. Only combinations of body parameters act on torque, so single ones are usually not \
         pinned.</p>\n",
    );
    if let Some(scale) = figures.nominal_error {
        let _ = writeln!(
            out,
            "<p>The values of the robot file are about {} times as wrong as those of CAD models and data sheets usually are.</p>",
            figure(scale, 2)
        );
    }
    let is_body = |p: &&Parameter| p.name.starts_with('l') && p.name[1..].starts_with(|c: char| c.is_ascii_digit());
    let table = |caption: &str, lines: Vec<&Parameter>| {
        let mut table = Table::new(caption, &["Parameter", "Unit", "Nominal", "Found", "90 %", "State", "Evidence"]);
        for p in lines {
            let state = match p.state.as_str() {
                "pinned" => "PINNED",
                "at_bound" => "AT BOUND",
                _ => "NOT PINNED",
            };
            table.row(&[
                value_label(p, document),
                p.unit.clone(),
                nm(p.given),
                nm(p.found),
                format!("{}..{}", nm(p.low), nm(p.high)),
                state.to_owned(),
                if p.wrong { "for the change".to_owned() } else { "for the nominal value".to_owned() },
            ]);
        }
        if table.is_empty() { String::new() } else { table.html() }
    };
    out += &table("Drives and friction", figures.parameters.iter().filter(|p| !is_body(p)).collect());
    let bodies =
        table("Bodies, in the frames of the URDF's links", figures.parameters.iter().filter(is_body).collect());
    if !bodies.is_empty() {
        let _ = writeln!(out, "<details><summary>Bodies of the links</summary>{bodies}</details>");
    }
    out
}

pub(super) fn passport(document: &Document) -> String {
    let data = &document.data;
    let seconds = |x: Number| format!("{} s", nm(x));
    let mut pairs = vec![
        ("Runs", data.runs.to_string()),
        ("Training logs", seconds(data.fit_seconds)),
        ("Held-out log", seconds(data.sealed_seconds)),
    ];
    let mut out = String::new();
    if let Some(passport) = &document.passport {
        pairs.push(("Held out", passport.sealed.clone()));
        pairs.push(("Torque", passport.torque.clone()));
        pairs.push(("Model", passport.model.clone()));
        pairs.push((
            "Program",
            format!(
                "rivet {}, SHA-256 {}\u{2026}",
                passport.tool.version,
                &passport.tool.sha256.get(..HASH).unwrap_or_default()
            ),
        ));
        let head = [
            "File",
            "Role",
            "Rows",
            "Length [s]",
            "Step [ms]",
            "Jitter [ms]",
            "Holes",
            "Longest [ms]",
            "Repeated positions [%]",
            "SHA-256",
        ];
        let mut table = Table::new("Files", &head);
        for input in &passport.inputs {
            let clock = input.clock.as_ref();
            let of = |f: &dyn Fn(&crate::Clock) -> String| clock.map_or_else(String::new, f);
            table.row(&[
                input.name.clone(),
                input.role.clone(),
                of(&|c| c.rows.to_string()),
                of(&|c| figure(c.seconds, 4)),
                of(&|c| figure(1e3 * c.step_s, 3)),
                of(&|c| {
                    let even = if c.stamps_jitter_s.is_some() { " (taken as even)" } else { "" };
                    figure(1e3 * c.jitter_s, 2) + even
                }),
                of(&|c| c.gaps.to_string()),
                of(&|c| figure(1e3 * c.longest_gap_s, 3)),
                of(&|c| figure(100.0 * c.repeated, 2)),
                input.sha256.chars().take(HASH).collect(),
            ]);
        }
        out += &table.html();
        for input in &passport.inputs {
            if let Some(off) = input.clock.as_ref().and_then(|clock| clock.off.as_ref()) {
                let _ = writeln!(out, "<p>{}: {}.</p>", escape(&input.name), escape(&off.text));
            }
        }
    }
    out = facts(&pairs) + &out;
    if document.log.is_empty() {
        out += "<p>No fault of the logs was found: no torque against motion, no other unit, no limit, no joint at \
                rest throughout.</p>\n";
    } else {
        let mut table = Table::new("Faults of the logs", &["Run", "Joint", "Fault", "What it means"]);
        for finding in &document.log {
            table.raw(format!(
                "<th scope=\"row\">{}</th><td>{}</td><td>{}</td><td class=\"text\">{}</td>",
                escape(&finding.run),
                escape(&finding.joint),
                escape(&finding.fault.replace('_', " ")),
                escape(&finding.text)
            ));
        }
        out += &table.html();
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_figures_side_by_side_have_the_same_decimals() {
        for ([before, after], told) in [
            ([9.32e-4, 0.00208], ["0.00093", "0.00208"]),
            ([-1.5e-9, 0.123], ["0.000", "0.123"]),
            ([-14.13, -13.2], ["-14.1", "-13.2"]),
            ([345.6, 2.0], ["346", "2"]),
            ([0.0, 0.0], ["0", "0"]),
        ] {
            assert_eq!(pair(Some(before), Some(after)), told);
        }
        assert_eq!(pair(None, Some(1.0)), ["-", "1.00"]);
    }
}
