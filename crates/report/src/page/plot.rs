//! Small charts as inline SVG. Colours are the page's; text stays readable because a chart is never drawn much wider or
//! narrower than it is.

use std::fmt::Write as _;

use super::html::escape;
use crate::words::figure;

const LEFT: f64 = 58.0;
const RIGHT: f64 = 10.0;
const TOP: f64 = 10.0;
const BOTTOM: f64 = 38.0;

/// An axis from `low` to `high`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Axis {
    low: f64,
    high: f64,
    log: bool,
}

impl Axis {
    /// Around values, with a little room; `zero` makes it reach zero.
    pub(crate) fn around(values: impl Iterator<Item = f64>, zero: bool) -> Axis {
        let (mut low, mut high) =
            values.filter(|v| v.is_finite()).fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        if zero || low > high {
            (low, high) = (low.min(0.0), high.max(0.0));
        }
        let room = if high > low { 0.05 * (high - low) } else { 1.0 };
        Axis { low: if zero && low == 0.0 { 0.0 } else { low - room }, high: high + room, log: false }
    }

    /// From one value to another.
    pub(crate) fn fixed(low: f64, high: f64) -> Axis {
        Axis { low, high, log: false }
    }

    /// Whole decades around positive values.
    pub(crate) fn decades(values: impl Iterator<Item = f64>) -> Axis {
        let (low, high) = values
            .filter(|v| *v > 0.0 && v.is_finite())
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v.log10()), h.max(v.log10())));
        let (low, high) = if low > high { (-1.0, 0.0) } else { (low.max(high - 5.0).floor(), high.ceil()) };
        Axis { low, high: high.max(low + 1.0), log: true }
    }

    fn place(self, v: f64) -> f64 {
        let v = if self.log { v.max(1e-300).log10() } else { v };
        ((v - self.low) / (self.high - self.low)).clamp(-0.02, 1.02)
    }

    /// Values at round steps of 1, 2 or 5.
    fn ticks(self) -> Vec<f64> {
        if self.log {
            return (self.low as i32..=self.high as i32).map(|d| 10.0_f64.powi(d)).collect();
        }
        let rough = (self.high - self.low) / 4.5;
        let decade = 10.0_f64.powf(rough.log10().floor());
        let step = decade * [1.0, 2.0, 5.0, 10.0].into_iter().find(|s| s * decade >= rough).unwrap_or(10.0);
        let first = (self.low / step).ceil() as i64;
        let last = (self.high / step).floor() as i64;
        (first..=last).map(|k| k as f64 * step).collect()
    }
}

/// A chart in the making.
pub(crate) struct Plot {
    width: f64,
    height: f64,
    x: Axis,
    y: Axis,
    body: String,
}

impl Plot {
    pub(crate) fn new(width: f64, height: f64, x: Axis, y: Axis) -> Plot {
        Plot { width, height, x, y, body: String::new() }
    }

    fn at(&self, x: f64, y: f64) -> (f64, f64) {
        let (w, h) = (self.width - LEFT - RIGHT, self.height - TOP - BOTTOM);
        (LEFT + w * self.x.place(x), TOP + h * (1.0 - self.y.place(y)))
    }

    pub(crate) fn line(&mut self, points: impl Iterator<Item = (f64, f64)>, class: &str) {
        let mut path = String::new();
        for (k, (x, y)) in points.filter(|(x, y)| x.is_finite() && y.is_finite()).enumerate() {
            let (x, y) = self.at(x, y);
            // Writing to a String cannot fail, here and below.
            let _ = write!(path, "{}{x:.1} {y:.1}", if k == 0 { "M" } else { "L" });
        }
        let _ = write!(self.body, "<path class=\"{class}\" d=\"{path}\"/>");
    }

    /// A band over the whole height from `from` to `to`.
    pub(crate) fn band(&mut self, from: f64, to: f64) {
        let (low, high) = (self.x.low.max(from), self.x.high.min(to));
        if high > low {
            let ((a, _), (b, _)) = (self.at(low, 0.0), self.at(high, 0.0));
            let tall = self.height - BOTTOM - TOP;
            let _ = write!(
                self.body,
                "<rect class=\"band\" x=\"{a:.1}\" y=\"{TOP}\" width=\"{:.1}\" height=\"{tall}\"/>",
                b - a
            );
        }
    }

    pub(crate) fn dot(&mut self, x: f64, y: f64) {
        let (x, y) = self.at(x, y);
        let _ = write!(self.body, "<circle class=\"dot\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"2.6\"/>");
    }

    /// A stroke from `low` to `high` at `x`.
    pub(crate) fn spread(&mut self, x: f64, low: f64, high: f64) {
        let ((x, a), (_, b)) = (self.at(x, low), self.at(x, high));
        let _ = write!(self.body, "<path class=\"spread\" d=\"M{x:.1} {a:.1}V{b:.1}\"/>");
    }

    /// A bar from zero.
    pub(crate) fn bar(&mut self, x: f64, y: f64, class: &str) {
        let ((x, a), (_, b)) = (self.at(x, 0.0), self.at(x, y));
        let _ = write!(self.body, "<path class=\"{class}\" d=\"M{x:.1} {a:.1}V{b:.1}\"/>");
    }

    pub(crate) fn level(&mut self, y: f64, class: &str) {
        self.line([(self.x.low, y), (self.x.high, y)].into_iter(), class);
    }

    pub(crate) fn mark(&mut self, x: f64, text: &str) {
        let ((x, a), (_, b)) = (self.at(x, self.y.low), self.at(x, self.y.high));
        let _ = write!(
            self.body,
            "<path class=\"noise\" d=\"M{x:.1} {:.1}V{:.1}\"/><text class=\"soft\" x=\"{:.1}\" y=\"{:.1}\">{}</text>",
            TOP + (a - b).abs(),
            TOP,
            x + 3.0,
            TOP + 10.0,
            escape(text)
        );
    }

    /// The chart; `said` is what a screen reader says of it.
    pub(crate) fn svg(self, x_label: &str, y_label: &str, said: &str) -> String {
        let (w, h) = (self.width, self.height);
        let scaled = |label: &str, axis: Axis| if axis.log { format!("{label}, log scale") } else { label.to_owned() };
        let (x_label, y_label) = (scaled(x_label, self.x), scaled(y_label, self.y));
        let mut out = format!("<svg viewBox=\"0 0 {w} {h}\" role=\"img\" aria-label=\"{}\">", escape(said));
        for tick in self.y.ticks() {
            let (_, y) = self.at(0.0, tick);
            let _ = write!(
                out,
                "<path class=\"grid\" d=\"M{LEFT} {y:.1}H{:.1}\"/><text class=\"soft\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
                w - RIGHT,
                LEFT - 5.0,
                y + 4.0,
                tick_text(tick)
            );
        }
        let base = h - BOTTOM;
        for tick in self.x.ticks() {
            let (x, _) = self.at(tick, 0.0);
            let _ = write!(
                out,
                "<path class=\"axis\" d=\"M{x:.1} {base}v4\"/><text class=\"soft\" x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
                base + 15.0,
                tick_text(tick)
            );
        }
        let _ = write!(
            out,
            "<path class=\"axis\" d=\"M{LEFT} {TOP}V{base}H{:.1}\"/><text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>\
             <text transform=\"translate(11 {:.1}) rotate(-90)\" text-anchor=\"middle\">{}</text>{}</svg>",
            w - RIGHT,
            0.5 * (LEFT + w - RIGHT),
            h - 5.0,
            escape(&x_label),
            0.5 * (TOP + base),
            escape(&y_label),
            self.body
        );
        out
    }
}

fn tick_text(x: f64) -> String {
    if x == 0.0 {
        return "0".to_owned();
    }
    let text = figure(x, 3);
    if text.contains('.') && !text.contains('e') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        let axis = Axis::around([-3.2, 7.9].into_iter(), false);
        assert_eq!(axis.ticks(), [0.0, 5.0]);
        assert_eq!(Axis::decades([0.02, 3.0].into_iter()).ticks().len(), 4);
        assert_eq!([0.5, 20.0, 0.25].map(tick_text), ["0.5", "20", "0.25"]);
    }

    #[test]
    fn nothing_to_draw_is_no_reason_to_fail() {
        let plot = Plot::new(300.0, 200.0, Axis::around(std::iter::empty(), false), Axis::decades(std::iter::empty()));
        let svg = plot.svg("x", "y", "empty");
        assert!(svg.starts_with("<svg") && !svg.contains("NaN") && !svg.contains("inf"), "{svg}");
        assert!(svg.contains(">y, log scale<") && svg.contains(">x<"), "{svg}");
    }
}
