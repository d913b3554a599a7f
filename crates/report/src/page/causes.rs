//! Causes, each with the plot that shows it; what was considered and not upheld; stretches of torque.

use std::fmt::Write as _;

use rivet_diagnosis::Variable;

use super::html::{Table, escape, facts, figure as framed};
use super::plot::{Axis, Plot};
use crate::document::is_contact;
use crate::document::{Cause, Curve, Document, Excerpt, Figures, Point};
use crate::verdict::OTHER_CONTACT;
use crate::words::{figure, joints, list, percent, quantity_of, rival};

const WIDTH: f64 = 340.0;
const HEIGHT: f64 = 230.0;
/// Sizes listed beside a cause; more are folded away.
const FEW: usize = 6;
/// Causes that are not folded.
const MOST_OPEN: usize = 2;
/// Joints whose residual stands in the row of pictures of a cause; the third picture is against the torque of the cause.
const JOINTS_IN_ROW: usize = 2;
/// A friction curve is drawn up to this many times the velocity at which it bends, where so many points lie there.
const BEND_VELOCITIES: f64 = 5.0;
const FEWEST_AT_THE_BEND: usize = 6;
/// Chance below which the residual alone decided.
const SURE: f64 = 0.05;

pub(super) fn causes(document: &Document) -> String {
    let mut out = String::new();
    if document.causes.is_empty() {
        let said = match document.verdict.as_str() {
            "no_gap" => "Nothing is named: the nominal model is as good as the torque signal can show.",
            _ => {
                "Nothing is named: no effect of the list explains enough of the gap, on the training logs and on the \
                 held-out log. A guess would be worse."
            }
        };
        let _ = writeln!(out, "<p>{said}</p>");
    } else {
        out += "<p>In the order of what to do. Each is shown on the held-out log, which took no part in the selection.</p>\n";
        out += KEY;
    }
    for (k, cause) in document.causes_by_weight().into_iter().enumerate() {
        let (title, body) = (escape(&title(cause, document)), body(cause, document, true));
        let _ = if k < MOST_OPEN {
            writeln!(out, "<article><h3>{}. {title}</h3>{body}</article>", k + 1)
        } else {
            writeln!(out, "<details><summary>{}. {title}</summary>{body}</details>", k + 1)
        };
    }
    if !document.hints.is_empty() {
        let mut names: Vec<String> = document.hints.iter().map(Cause::word).collect();
        names.sort();
        names.dedup();
        let _ = writeln!(
            out,
            "<details><summary>Considered and not supported: {}</summary><p class=\"soft\">They explained a part of the \
             training logs, but did not transfer to the held-out log, explained too little, or were too small. They are hints, not findings.</p>",
            escape(&list(&names))
        );
        if document.causes.is_empty() {
            out += KEY;
        }
        for hint in &document.hints {
            let _ = writeln!(out, "<h4>{}</h4>", escape(&title(hint, document)));
            out += &body(hint, document, false);
        }
        out += "</details>\n";
    }
    out += &excerpts(document);
    out
}

const KEY: &str = "<p class=\"key\"><span><i class=\"k-given\"></i>residual without this cause (points; strokes: half of the rows)</span>\
                   <span><i class=\"k-found\"></i>residual with it</span></p>\n";

fn title(cause: &Cause, document: &Document) -> String {
    format!("{} on {}", cause.word(), joints(&cause.joints, document.gap.per_joint.len()))
}

/// What is known of a cause, and its plot; the confidence is that of a name, which a cause that is not `upheld` has not.
fn body(cause: &Cause, document: &Document, upheld: bool) -> String {
    let s = &cause.shrink;
    let angles = cause.angles_deg.iter().map(|a| a.map(|a| format!(" (angle {a:.0}°)")));
    let angles = angles.map(Option::unwrap_or_default).chain(std::iter::repeat(String::new()));
    let rivals: Vec<String> =
        cause.indistinguishable_from.iter().zip(angles).map(|(name, angle)| rival(name) + &angle).collect();
    let mut pairs = vec![(
        "Shrink of the gap",
        format!(
            "predicted {} % ({}..{}), measured {} %",
            percent(s.predicted),
            percent(s.low),
            percent(s.high),
            percent(s.measured)
        ),
    )];
    if upheld {
        pairs.push(("Confidence", cause.confidence.map_or_else(|| "-".to_owned(), |c| format!("{c:.2} of 1"))));
    }
    if cause.share.is_some() {
        pairs.push(("Share of the squared gap, whatever the order", format!("{} %", percent(cause.share))));
    }
    if let Some(p) = cause.p_value {
        let why = if p > SURE { "; the prior of the parameters, or a command beyond the limit, decided" } else { "" };
        pairs.push((
            "Family-wise p-value: chance that one of all candidates looks as strong without an effect",
            format!("{p:.3}{why}"),
        ));
    }
    if is_contact(cause) {
        pairs.push(("On the held-out log", OTHER_CONTACT.to_owned() + "."));
    }
    if let Some(impossible) = &cause.impossible {
        pairs.push(("Not named", impossible.clone()));
    }
    if !rivals.is_empty() {
        pairs.push(("In these logs not distinguishable from", list(&rivals)));
    }
    if let Some(motion) = &cause.separating_motion {
        pairs.push((if rivals.is_empty() { "Record also" } else { "Motion that separates them" }, motion.clone()));
    }
    let sizes: Vec<(String, String)> = cause
        .magnitude
        .iter()
        .map(|(name, value)| {
            let (label, unit) = quantity_of(name, &cause.joints, document);
            let size = |v| format!("{} {unit}", figure(v, 3)).trim_end().to_owned();
            (label, value.map_or_else(|| "-".to_owned(), size))
        })
        .collect();
    let mut out = String::new();
    if (1..=FEW).contains(&sizes.len()) {
        let all = sizes.iter().map(|(name, value)| format!("{name} {value}")).collect::<Vec<_>>().join(", ");
        pairs.push(("Size", all));
        out += &facts(&pairs);
    } else {
        out += &facts(&pairs);
        let mut table = Table::new("Sizes", &["Value", "Size"]);
        for (name, value) in &sizes {
            table.row(&[name.clone(), value.clone()]);
        }
        let _ = write!(out, "<details><summary>{} sizes</summary>{}</details>", sizes.len(), table.html());
    }
    if !cause.curves.is_empty() {
        let (row, more) = cause.curves.split_at(cause.curves.len().min(JOINTS_IN_ROW));
        let pictures = |curves: &[Curve]| curves.iter().map(|curve| shown(cause, curve)).collect::<String>();
        let is_against_torque = |curve: &&Curve| curve.variable == Variable::OwnTorque.label().0;
        let against =
            row.first().filter(|c| !is_against_torque(c)).map_or_else(String::new, |first| against(cause, first));
        let _ = writeln!(out, "<div class=\"figures\">{}{against}</div>", pictures(row));
        if !more.is_empty() {
            let (names, figures) =
                (list(&more.iter().map(|curve| curve.joint.clone()).collect::<Vec<_>>()), pictures(more));
            let _ = writeln!(
                out,
                "<details><summary>The same of {}</summary><div class=\"figures\">{figures}</div></details>",
                escape(&names)
            );
        }
    }
    out
}

/// Residual with and without the cause against the quantity in which it shows.
fn shown(cause: &Cause, curve: &Curve) -> String {
    let bend = cause.magnitude.get("velocity_rad_s").copied().flatten().map(|v| BEND_VELOCITIES * v);
    let about_bend =
        |most: f64| -> Vec<Point> { curve.points.iter().filter(|p| p.at.abs() <= most).copied().collect() };
    let near = bend.map(about_bend).filter(|near| near.len() >= FEWEST_AT_THE_BEND);
    let points = near.as_ref().unwrap_or(&curve.points);
    let x = Axis::around(points.iter().map(|p| p.at), false);
    let values = points.iter().flat_map(|p| [p.without, p.with, p.spread[0], p.spread[1]]);
    let y = Axis::around(values, true);
    let mut plot = Plot::new(WIDTH, HEIGHT, x, y);
    plot.level(0.0, "axis");
    for p in points {
        plot.spread(p.at, p.spread[0], p.spread[1]);
        plot.dot(p.at, p.without);
    }
    plot.line(points.iter().map(|p| (p.at, p.with)), "found");
    let mean = |f: &dyn Fn(&Point) -> f64| {
        let (square, rows) = points.iter().fold((0.0, 0.0), |(s, n), p| {
            let rows = p.rows as f64;
            (s + rows * f(p).powi(2), n + rows)
        });
        f64::sqrt(square / f64::max(rows, 1.0))
    };
    let said = format!(
        "{}: mean residual against {}, {} N m rms without {}, {} N m with it",
        curve.joint,
        curve.variable,
        figure(mean(&|p| p.without), 3),
        cause.word(),
        figure(mean(&|p| p.with), 3)
    );
    let along = if curve.along_motion { ", along the motion" } else { "" };
    framed(
        &plot.svg(&format!("{} [{}]", curve.variable, curve.unit), &format!("residual{along} [N m]"), &said),
        &(said.clone() + "."),
    )
}

/// Residual without the cause against the torque that the cause says: on the diagonal where it explains all.
fn against(cause: &Cause, curve: &Curve) -> String {
    let mut points = curve.points.clone();
    points.sort_by(|a, b| a.cause.total_cmp(&b.cause));
    let both = || points.iter().flat_map(|p| [p.cause, p.without]);
    let (x, y) = (Axis::around(both(), false), Axis::around(both(), false));
    let mut plot = Plot::new(WIDTH, HEIGHT, x, y);
    let (low, high) = both().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    plot.line([(low, low), (high, high)].into_iter(), "found");
    for p in &points {
        plot.dot(p.cause, p.without);
    }
    let (xy, xx) = points.iter().fold((0.0, 0.0), |(a, b), p| {
        let rows = p.rows as f64;
        (a + rows * p.cause * p.without, b + rows * p.cause * p.cause)
    });
    let slope = if xx > 0.0 { xy / xx } else { f64::NAN };
    let said = format!(
        "{}: residual without {} against the torque of the cause; slope {} (1 explains it)",
        curve.joint,
        cause.word(),
        figure(slope, 3)
    );
    framed(&plot.svg("torque of the cause [N m]", "residual without it [N m]", &said), &(said.clone() + "."))
}

fn excerpts(document: &Document) -> String {
    let Some(figures) = &document.figures else { return String::new() };
    // The top of the page has that of the worst joint.
    let others: Vec<&Excerpt> = match worst(document, figures) {
        Some(first) => figures.excerpts.iter().filter(|excerpt| !std::ptr::eq(*excerpt, first)).collect(),
        None => Vec::new(),
    };
    if others.is_empty() {
        return String::new();
    }
    let mut out = format!(
        "<details><summary>Torque of the other joints, measured and modelled</summary>{}<div class=\"figures wide\">",
        key(document)
    );
    for excerpt in others {
        out += &stretch(excerpt, "", document);
    }
    out += "</div></details>\n";
    out
}

/// What the lines of measured and modelled signals are.
pub(super) fn key(document: &Document) -> String {
    format!(
        "<p class=\"key\"><span><i class=\"k-measured\"></i>measured</span>\
         <span><i class=\"k-given\"></i>nominal model</span><span><i class=\"k-found\"></i>{}</span>\
         <span><i class=\"k-rest\"></i>standstill: stiction holds what no model predicts</span></p>\n",
        corrected(document)
    )
}

/// The model that is compared with the nominal one.
fn corrected(document: &Document) -> &'static str {
    if document.causes.is_empty() { "parameters refitted" } else { "corrected model" }
}

/// The excerpt of the headline joint, or the first.
pub(super) fn worst<'a>(document: &Document, figures: &'a Figures) -> Option<&'a Excerpt> {
    let headline = document.headline_joint();
    let of = figures.excerpts.iter().find(|excerpt| Some(excerpt.joint.as_str()) == headline);
    of.or_else(|| figures.excerpts.first())
}

/// Torque of a stretch of the held-out log; `why` it is shown follows the joint's name.
pub(super) fn stretch(e: &Excerpt, why: &str, document: &Document) -> String {
    let time = |k: usize| e.from_s + e.step_s * k as f64;
    let x = Axis::fixed(time(0), time(e.measured.len().saturating_sub(1)));
    let y = Axis::around(e.measured.iter().chain(&e.given).chain(&e.with_causes).copied(), false);
    let mut plot = Plot::new(420.0, 230.0, x, y);
    for [from, to] in &e.standstill_s {
        plot.band(*from, *to);
    }
    for (signal, class) in [(&e.given, "given"), (&e.with_causes, "found"), (&e.measured, "measured")] {
        plot.line(signal.iter().enumerate().map(|(k, v)| (time(k), *v)), class);
    }
    // Ends of stretches are rounded and lie between samples.
    let moves = |k: usize| !e.standstill_s.iter().any(|[from, to]| (*from..*to).contains(&(time(k) + 0.5 * e.step_s)));
    let rms = |model: &[f64]| {
        let moving = e.measured.iter().zip(model).enumerate().filter(|(k, _)| moves(*k));
        let (square, count) = moving.fold((0.0, 0), |(sum, n), (_, (a, b))| (sum + (a - b).powi(2), n + 1));
        f64::sqrt(square / f64::from(count.max(1)))
    };
    let said = format!(
        "{}{why}: residual in motion {} N m rms, {} {} N m",
        e.joint,
        figure(rms(&e.given), 3),
        corrected(document),
        figure(rms(&e.with_causes), 3)
    );
    framed(&plot.svg("time in the held-out log [s]", "torque [N m]", &said), &(said.clone() + "."))
}
