//! Line charts as SVG whose colours are the page's, so that one chart suits light and dark.
//!
//! Written here: chart crates write colours into the drawing, and a chart of a dozen polylines needs none.

use std::fmt::Write as _;

/// How a series is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stroke {
    /// A thin line, for repetitions over each other.
    Line,
    /// Dashes, for the truth.
    Dashes,
    /// Dots, no line.
    Dots,
}

/// Points in one colour.
#[derive(Clone, Debug)]
pub struct Series {
    /// In the legend; the same label is listed once.
    pub label: String,
    /// Which of the page's colours, 0 to 5.
    pub colour: usize,
    /// How it is drawn.
    pub stroke: Stroke,
    /// x and y.
    pub points: Vec<[f64; 2]>,
}

/// One chart.
#[derive(Clone, Debug)]
pub struct Panel {
    /// Above it.
    pub title: String,
    /// Name and unit below.
    pub x: String,
    /// Name and unit at the left.
    pub y: String,
    /// Limits of y; all points' own where there are none.
    pub range: Option<[f64; 2]>,
    /// What is drawn, later ones over earlier ones.
    pub series: Vec<Series>,
}

const WIDTH: f64 = 460.0;
const HEIGHT: f64 = 300.0;
const LEFT: f64 = 62.0;
const RIGHT: f64 = 12.0;
const TOP: f64 = 30.0;
const BOTTOM: f64 = 44.0;
/// The colour of what is not a measurement.
const NEUTRAL: usize = 5;
/// More points than this make a line no smoother on paper.
const MOST_POINTS: usize = 600;

impl Panel {
    /// The chart as an `<svg>` element; `id` must be the page's only one.
    #[must_use]
    pub fn svg(&self, id: &str) -> String {
        let all = || self.series.iter().flat_map(|s| &s.points).filter(|p| p[0].is_finite() && p[1].is_finite());
        let [x0, x1] = limits(all().map(|p| p[0]), 0.0);
        // An axis that all but starts at zero does.
        let x0 = if x0 > 0.0 && x0 < 0.05 * x1 { 0.0 } else { x0 };
        let [y0, y1] = self.range.unwrap_or_else(|| limits(all().map(|p| p[1]), 0.05));
        let (right, bottom) = (WIDTH - RIGHT, HEIGHT - BOTTOM);
        let px = |x: f64| LEFT + (x - x0) / (x1 - x0) * (right - LEFT);
        let py = |y: f64| bottom - (y - y0) / (y1 - y0) * (bottom - TOP);
        let mut out =
            format!("<svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{}\">", escape(&self.title));
        // Writing to a String cannot fail, here and below.
        let _ = write!(out, "<text class=\"t\" x=\"{LEFT}\" y=\"18\">{}</text>", escape(&self.title));
        for x in ticks(x0, x1, 6) {
            let at = px(x);
            let _ = write!(out, "<path class=\"g\" d=\"M{at:.1} {TOP}V{bottom}\"/>");
            let _ = write!(out, "<text class=\"m\" x=\"{at:.1}\" y=\"{:.1}\">{}</text>", bottom + 15.0, figure(x));
        }
        for y in ticks(y0, y1, 5) {
            let at = py(y);
            let _ = write!(out, "<path class=\"g\" d=\"M{LEFT} {at:.1}H{right}\"/>");
            let _ = write!(out, "<text class=\"e\" x=\"{:.1}\" y=\"{:.1}\">{}</text>", LEFT - 6.0, at + 4.0, figure(y));
        }
        let (middle, centre) = (f64::midpoint(LEFT, right), f64::midpoint(TOP, bottom));
        let _ = write!(out, "<text class=\"m\" x=\"{middle}\" y=\"{:.1}\">{}</text>", HEIGHT - 8.0, escape(&self.x));
        let turned = format!("transform=\"translate(14 {centre}) rotate(-90)\"");
        let _ = write!(out, "<text class=\"m\" {turned}>{}</text>", escape(&self.y));
        let _ = write!(
            out,
            "<clipPath id=\"{id}\"><rect x=\"{LEFT}\" y=\"{TOP}\" width=\"{}\" height=\"{}\"/></clipPath><g clip-path=\"url(#{id})\">",
            right - LEFT,
            bottom - TOP
        );
        // Far outside the frame is as good as outside, and keeps numbers short.
        let inside = |y: f64| py(y).clamp(-HEIGHT, 2.0 * HEIGHT);
        for series in &self.series {
            let step = series.points.len().div_ceil(MOST_POINTS).max(1);
            let points = series.points.iter().step_by(step).filter(|p| p[0].is_finite() && p[1].is_finite());
            let colour = series.colour;
            if series.stroke == Stroke::Dots {
                for [x, y] in points {
                    let _ = write!(
                        out,
                        "<circle class=\"f{colour}\" cx=\"{:.1}\" cy=\"{:.1}\" r=\"2.6\"/>",
                        px(*x),
                        inside(*y)
                    );
                }
                continue;
            }
            let dash = if series.stroke == Stroke::Dashes { " d" } else { "" };
            let _ = write!(out, "<polyline class=\"c{colour}{dash}\" points=\"");
            for [x, y] in points {
                let _ = write!(out, "{:.1},{:.1} ", px(*x), inside(*y));
            }
            out.push_str("\"/>");
        }
        let _ = write!(out, "</g><path class=\"a\" d=\"M{LEFT} {TOP}V{bottom}H{right}\"/></svg>");
        out
    }

    /// The legend as HTML; empty for a single unnamed series.
    #[must_use]
    pub fn legend(&self) -> String {
        let mut seen: Vec<&str> = Vec::new();
        // A label that several colours share is shown in the colour of text.
        let neutral = |label: &str| {
            let mut colours = self.series.iter().filter(|s| s.label == label).map(|s| s.colour);
            let first = colours.next().unwrap_or(NEUTRAL);
            if colours.all(|c| c == first) { first } else { NEUTRAL }
        };
        let mut out = String::new();
        for series in &self.series {
            if series.label.is_empty() || seen.contains(&series.label.as_str()) {
                continue;
            }
            seen.push(&series.label);
            let kind = match series.stroke {
                Stroke::Line => "line",
                Stroke::Dashes => "dash",
                Stroke::Dots => "dot",
            };
            let _ = write!(
                out,
                "<span><i class=\"k{} {kind}\"></i>{}</span>",
                neutral(&series.label),
                escape(&series.label)
            );
        }
        out
    }
}

/// Least and largest with a margin, never equal.
fn limits(values: impl Iterator<Item = f64>, margin: f64) -> [f64; 2] {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    if low > high {
        return [0.0, 1.0];
    }
    let extra = if high > low { margin * (high - low) } else { 0.5 };
    [low - extra, high + extra]
}

/// Round values between the limits: steps of 1, 2 or 5 times a power of ten.
fn ticks(low: f64, high: f64, wanted: usize) -> Vec<f64> {
    let raw = (high - low) / wanted as f64;
    let decade = 10.0_f64.powf(raw.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].iter().map(|m| m * decade).find(|s| *s >= raw * 0.999).unwrap_or(raw);
    let first = (low / step).ceil() as i64;
    let last = (high / step + 1e-9).floor() as i64;
    (first..=last).map(|k| k as f64 * step).collect()
}

/// A tick's number, short.
fn figure(x: f64) -> String {
    if x != 0.0 && (x.abs() < 1e-3 || x.abs() >= 1e5) {
        return format!("{x:.0e}");
    }
    let text = format!("{x:.4}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".into() } else { text.to_owned() }
}

/// Text for HTML.
pub(crate) fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        assert_eq!(ticks(0.0, 10.0, 5), [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]);
        assert_eq!(ticks(-0.13, 0.31, 5), [-0.1, 0.0, 0.1, 0.2, 0.30000000000000004]);
        assert_eq!((figure(0.30000000000000004), figure(-0.0), figure(2e6)), ("0.3".into(), "0".into(), "2e6".into()));
    }

    #[test]
    fn what_is_not_finite_is_left_out_and_text_is_escaped() {
        let points = vec![[0.0, 1.0], [1.0, f64::NAN], [2.0, 1e300], [3.0, 2.0]];
        let series = Series { label: "a<b".into(), colour: 0, stroke: Stroke::Line, points };
        let panel = Panel {
            title: "x & y".into(),
            x: "t".into(),
            y: "v".into(),
            range: Some([0.0, 3.0]),
            series: vec![series],
        };
        let svg = panel.svg("one");
        assert!(!svg.contains("NaN") && svg.contains("x &amp; y") && panel.legend().contains("a&lt;b"));
    }
}
