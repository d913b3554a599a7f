//! The figures of Schmidt & Pruefer, "Parameter identification in robot control", computed by the estimators of the
//! daemon, each with numbers that must hold.

mod bench;
mod filtering;
mod noise;
mod page;
mod plot;
mod slow;
mod unidentified;

pub use page::page;
pub use plot::{Panel, Series, Stroke};

use serde_json::{Value, json};
use std::fmt::Write as _;

/// Numbers of the figures there are, in the paper's order.
pub const FIGURES: [u32; 12] = [3, 5, 6, 7, 8, 9, 12, 13, 15, 16, 18, 19];

/// A number that must keep its limit.
#[derive(Clone, Debug, PartialEq)]
pub struct Check {
    /// What was measured.
    pub what: String,
    /// Its value, as text.
    pub measured: String,
    /// Its limit, as text.
    pub limit: String,
    /// Whether it keeps the limit.
    pub pass: bool,
}

impl Check {
    /// `value` must be at most `most`, both shown in `unit` with `scale`.
    fn most(what: impl Into<String>, value: f64, most: f64, unit: Unit) -> Check {
        Check {
            what: what.into(),
            measured: unit.text(value),
            limit: format!("≤ {}", unit.text(most)),
            pass: value <= most,
        }
    }

    /// `value` must be at least `least`.
    fn least(what: impl Into<String>, value: f64, least: f64, unit: Unit) -> Check {
        Check {
            what: what.into(),
            measured: unit.text(value),
            limit: format!("≥ {}", unit.text(least)),
            pass: value >= least,
        }
    }

    /// A statement that must be true.
    fn holds(what: impl Into<String>, pass: bool) -> Check {
        Check { what: what.into(), measured: if pass { "yes" } else { "no" }.into(), limit: "yes".into(), pass }
    }

    /// `value` must lie within `margin` of `expected`.
    fn near(what: impl Into<String>, value: f64, expected: f64, margin: f64, unit: Unit) -> Check {
        let limit = format!("{} ± {}", unit.text(expected), unit.text(margin));
        Check { what: what.into(), measured: unit.text(value), limit, pass: (value - expected).abs() <= margin }
    }
}

/// How a value is shown.
#[derive(Clone, Copy)]
enum Unit {
    Plain,
    Percent,
    Milliseconds,
    Degrees,
    Celsius,
}

impl Unit {
    fn text(self, value: f64) -> String {
        match self {
            Unit::Plain if value != 0.0 && (value.abs() < 1e-3 || value.abs() >= 1e4) => format!("{value:.1e}"),
            Unit::Plain => format!("{value:.3}"),
            Unit::Percent if value != 0.0 && value.abs() < 1e-5 => format!("{value:.1e}"),
            Unit::Percent => format!("{:.2} %", 100.0 * value),
            Unit::Celsius => format!("{value:.1} °C"),
            Unit::Milliseconds => format!("{:.0} ms", 1000.0 * value),
            Unit::Degrees => format!("{:.2}°", value.to_degrees()),
        }
    }
}

/// One figure.
#[derive(Clone, Debug)]
pub struct Figure {
    /// Its number in the paper.
    pub number: u32,
    /// What it shows.
    pub title: String,
    /// How it was made and what to see.
    pub caption: String,
    /// Its charts.
    pub panels: Vec<Panel>,
    /// What must hold.
    pub checks: Vec<Check>,
}

/// Numbers, titles and checks of figures; measured values and limits as text with their units.
pub fn to_json(figures: &[Figure]) -> Value {
    let check = |check: &Check| json!({ "what": check.what, "measured": check.measured, "limit": check.limit, "pass": check.pass });
    let figure = |figure: &Figure| {
        json!({
            "figure": figure.number, "title": figure.title,
            "checks": figure.checks.iter().map(check).collect::<Vec<_>>(),
        })
    };
    figures.iter().map(figure).collect()
}

/// Repetitions that the paper draws over each other.
pub const REPETITIONS: u64 = 6;

/// Computes figure `number` with so many repetitions of each experiment; `None` if there is none of that number.
#[must_use]
pub fn figure(number: u32, repetitions: u64) -> Option<Figure> {
    Some(match number {
        3 => slow::temperature(repetitions),
        5 => noise::acceleration(),
        6 => noise::least_squares(repetitions),
        7 => noise::instruments(repetitions),
        8 => noise::filtered_acceleration(),
        9 => noise::filtered(repetitions),
        12 => filtering::functions(),
        13 => filtering::estimates(repetitions),
        15 => noise::energy(repetitions),
        16 => slow::drift(repetitions),
        18 => unidentified::one_parameter(repetitions),
        19 => unidentified::a_combination(repetitions),
        _ => return None,
    })
}

/// What must hold, as a table in Markdown.
#[must_use]
pub fn markdown(figures: &[Figure]) -> String {
    let mut out = String::from("| figure | what | measured | must hold |\n|---|---|---|---|\n");
    for figure in figures {
        for check in &figure.checks {
            let mark = if check.pass { "" } else { " (FAIL)" };
            let _ =
                writeln!(out, "| {} | {} | {} | {}{mark} |", figure.number, check.what, check.measured, check.limit);
        }
    }
    out
}

fn line(label: &str, colour: usize, points: Vec<[f64; 2]>) -> Series {
    Series { label: label.into(), colour, stroke: Stroke::Line, points }
}

fn dashes(label: &str, colour: usize, points: Vec<[f64; 2]>) -> Series {
    Series { label: label.into(), colour, stroke: Stroke::Dashes, points }
}

fn panel(title: &str, x: &str, y: &str, range: Option<[f64; 2]>, series: Vec<Series>) -> Panel {
    Panel { title: title.into(), x: x.into(), y: y.into(), range, series }
}
