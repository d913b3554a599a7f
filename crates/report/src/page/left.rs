//! What is left: does it look like noise, and if not, like what?

use std::fmt::Write as _;

use super::html::{Table, escape, figure as framed};
use super::plot::{Axis, Plot};
use crate::document::{Document, Left, Number};
use crate::words::figure;

const WIDTH: f64 = 340.0;
const HEIGHT: f64 = 220.0;
/// Lines of an order or a frequency that are put into words.
const NAMED: usize = 2;

pub(super) fn left(document: &Document) -> String {
    let Some(figures) = document.figures.as_ref().filter(|f| !f.left.is_empty()) else { return String::new() };
    let ratios: &[f64] = document.passport.as_ref().map_or(&[], |p| &p.gear_ratio);
    let worst = figures
        .left
        .iter()
        .enumerate()
        .max_by(|a, b| excess(document, a.0).total_cmp(&excess(document, b.0)))
        .map_or(0, |(j, _)| j);
    let mut out = String::from(
        "<p>Residual of the model with all causes on the held-out log. The autocorrelation of noise falls into the \
         dashed band at once, and its spectrum is flat. A line at an order of the joint's angle is ripple of the \
         gear or the motor.</p>\n<p class=\"key\"><span><i class=\"k-given\"></i>nominal model</span>\
         <span><i class=\"k-found\"></i>with causes</span><span><i class=\"k-noise\"></i>noise, or a motor turn</span></p>\n",
    );
    for (j, left) in figures.left.iter().enumerate() {
        let _ = writeln!(
            out,
            "<details{}><summary>{}: {}</summary><div class=\"figures\">{}{}{}</div></details>",
            if j == worst { " open" } else { "" },
            escape(&left.joint),
            escape(&in_short(document, j, left)),
            autocorrelation(left),
            spectrum(document, j, left),
            orders(left, ratios.get(j).copied())
        );
    }
    out += &correlations(&figures.left);
    out
}

/// How many times the noise is left.
fn excess(document: &Document, j: usize) -> f64 {
    let Some(gap) = document.gap.per_joint.get(j) else { return 0.0 };
    match (gap.after, gap.noise_floor) {
        (Some(after), Some(floor)) if floor > 0.0 => after / floor,
        _ => 0.0,
    }
}

fn in_short(document: &Document, j: usize, left: &Left) -> String {
    let share = |x: Number| x.map_or_else(|| "-".to_owned(), |x| format!("{:.0} %", 100.0 * x));
    format!(
        "residual of {} times the noise; {} of its square is more than noise",
        figure(excess(document, j), 2),
        share(left.above_noise)
    )
}

fn autocorrelation(left: &Left) -> String {
    let lags = left.autocorrelation.len();
    let x = Axis::fixed(0.0, left.lag_s * lags.saturating_sub(1).max(1) as f64);
    let lowest = left.autocorrelation.iter().copied().fold(-0.2, f64::min);
    let mut plot = Plot::new(WIDTH, HEIGHT, x, Axis::fixed(lowest - 0.05, 1.05));
    plot.level(0.0, "axis");
    plot.level(left.white, "noise");
    plot.level(-left.white, "noise");
    for (k, value) in left.autocorrelation.iter().enumerate() {
        plot.bar(left.lag_s * k as f64, *value, "found");
    }
    let outside = left.autocorrelation.iter().skip(1).filter(|v| v.abs() > left.white).count();
    let said = format!(
        "Autocorrelation of {}: {outside} of {} lags outside the band of white noise",
        left.joint,
        lags.saturating_sub(1)
    );
    framed(&plot.svg("lag [s]", "autocorrelation", &said), &(said.clone() + "."))
}

fn spectrum(document: &Document, j: usize, left: &Left) -> String {
    let f = &left.frequencies_hz;
    let x = Axis::fixed(0.0, f.last().copied().unwrap_or(30.0));
    // White noise passes the model filter over its whole band.
    let floor = document
        .gap
        .per_joint
        .get(j)
        .and_then(|g| g.noise_floor_nm)
        .map(|n| n / f.last().copied().unwrap_or(30.0).sqrt());
    let y = Axis::decades(left.density_before.iter().chain(&left.density_after).copied().chain(floor));
    let mut plot = Plot::new(WIDTH, HEIGHT, x, y);
    if let Some(floor) = floor {
        plot.level(floor, "noise");
    }
    plot.line(f.iter().copied().zip(left.density_before.iter().copied()), "given");
    plot.line(f.iter().copied().zip(left.density_after.iter().copied()), "found");
    let top = (0..left.density_after.len()).max_by(|a, b| left.density_after[*a].total_cmp(&left.density_after[*b]));
    let said = match top {
        Some(top) => format!("Spectrum of the residual of {}: strongest at {} Hz", left.joint, figure(f[top], 2)),
        None => format!("Spectrum of the residual of {}: too short a run", left.joint),
    };
    framed(&plot.svg("frequency [Hz]", "density [N m/\u{221a}Hz]", &said), &(said.clone() + "."))
}

fn orders(left: &Left, ratio: Option<f64>) -> String {
    if left.orders.is_empty() {
        return "<figure><figcaption>The joint turns too little to separate orders of its angle.</figcaption></figure>"
            .to_owned();
    }
    let last = left.orders.last().map_or(1.0, |o| o.order);
    let y = Axis::around(left.orders.iter().flat_map(|o| [o.before, o.after]), true);
    let mut plot = Plot::new(WIDTH, HEIGHT, Axis::fixed(0.0, last), y);
    let motor = ratio.map(f64::abs).filter(|r| *r > 1.0);
    if let Some(ratio) = motor {
        let mut turn = 1.0;
        while turn * ratio < last && turn < 5.0 {
            plot.mark(turn * ratio, if turn == 1.0 { "motor turn" } else { "" });
            turn += 1.0;
        }
    }
    for o in &left.orders {
        plot.bar(o.order, o.before, "given");
    }
    for o in &left.orders {
        plot.bar(o.order, o.after, "found");
    }
    let mut strongest: Vec<&crate::Order> = left.orders.iter().collect();
    strongest.sort_by(|a, b| b.after.total_cmp(&a.after));
    let named: Vec<String> = strongest
        .iter()
        .take(NAMED)
        .map(|o| {
            let turns = motor.map_or_else(String::new, |r| format!(" ({} per motor turn)", figure(o.order / r, 2)));
            format!("{} N m at {} per joint turn{turns}", figure(o.after, 2), figure(o.order, 3))
        })
        .collect();
    let said = format!("Amplitude by order of the angle of {}: largest {}", left.joint, named.join(" and "));
    framed(&plot.svg("cycles per turn of the joint", "amplitude [N m]", &said), &(said.clone() + "."))
}

fn correlations(left: &[Left]) -> String {
    if left.len() < 2 {
        return String::new();
    }
    let heads: Vec<&str> = std::iter::once("Joint").chain(left.iter().map(|l| l.joint.as_str())).collect();
    let mut table =
        Table::new("Correlation of the residual between joints: contact and a wrong base show on several", &heads);
    for row in left {
        let mut cells = vec![row.joint.clone()];
        cells.extend(row.correlation.iter().map(|c| format!("{c:.2}")));
        table.row(&cells);
    }
    table.html()
}
