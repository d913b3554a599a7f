//! The filter from signals at the rate of the log to the rows that everything is fitted to.
//!
//! Every column and the torque go through the same chain: mean of `average` samples, zero-phase low-pass, every second
//! value. One model filter for all of them leaves the model equation as it is.

use std::ops::Range;

use rivet_estimation::offline::ZeroPhase;

/// Cut-off of the model filter \[Hz\], where the rate allows it.
const MODEL_HZ: f64 = 30.0;
/// Rate after averaging \[Hz\].
const AVERAGED_HZ: f64 = 200.0;
/// Rows of the end that are left out on either side, in periods of the cut-off: filters and differences are coloured
/// there.
const EDGE_PERIODS: f64 = 3.0;
/// Edges after which the filter has forgotten: its slowest poles lose e^-2.4 in a period of the cut-off.
const FORGOTTEN: usize = 5;

/// The way from samples to rows for one sampling period.
#[derive(Clone, Debug)]
pub(crate) struct Chain {
    average: usize,
    filter: ZeroPhase,
    edge: usize,
    cutoff_hz: f64,
    /// Time between rows \[s\].
    pub(crate) row_period_s: f64,
}

impl Chain {
    pub(crate) fn new(period_s: f64) -> Chain {
        Chain::up_to(MODEL_HZ, period_s)
    }

    /// With a model filter of another cut-off \[Hz\].
    pub(crate) fn up_to(hz: f64, period_s: f64) -> Chain {
        let average = (1.0 / (AVERAGED_HZ * period_s)).round().max(1.0) as usize;
        let averaged_s = period_s * average as f64;
        let cutoff = hz.min(0.2 / averaged_s);
        let edge = (EDGE_PERIODS / (cutoff * averaged_s)).ceil() as usize;
        Chain {
            average,
            filter: ZeroPhase::new(cutoff, 4, averaged_s),
            edge,
            cutoff_hz: cutoff,
            row_period_s: 2.0 * averaged_s,
        }
    }

    /// Rows of a full-rate signal.
    pub(crate) fn apply(&self, signal: &[f64]) -> Vec<f64> {
        self.filtered(self.averaged(signal))
    }

    pub(crate) fn averaged(&self, signal: &[f64]) -> Vec<f64> {
        signal.chunks_exact(self.average).map(|c| c.iter().sum::<f64>() / self.average as f64).collect()
    }

    fn rows(&self, x: &[f64]) -> Vec<f64> {
        self.span(x.len()).step_by(2).map(|k| x[k]).collect()
    }

    /// Cut-off of the filter \[Hz\]: half of what has this frequency is left.
    pub(crate) fn cutoff_hz(&self) -> f64 {
        self.cutoff_hz
    }

    /// How many samples are averaged first.
    pub(crate) fn average(&self) -> usize {
        self.average
    }

    /// Rows of a signal that is averaged already.
    pub(crate) fn filtered(&self, mut x: Vec<f64>) -> Vec<f64> {
        self.filter.apply(&mut x);
        self.rows(&x)
    }

    /// Rows of a full-rate signal as it is at each of these times later \[s\], no more than the edge that is left out.
    pub(crate) fn apply_later(&self, signal: &[f64], seconds: &[f64]) -> Vec<Vec<f64>> {
        let mut x = self.averaged(signal);
        self.filter.apply(&mut x);
        let last = x.len().saturating_sub(1);
        let later = |seconds: &f64| {
            let shift = 2.0 * seconds / self.row_period_s;
            let (whole, part) = (shift.floor(), shift - shift.floor());
            // What the filter lets through is slow beside the samples: six of them tell what is between.
            let taps: [f64; 6] = std::array::from_fn(|i| lagrange(i, part));
            let at = |k: usize| -> f64 {
                // Edges are wider than the six, so nothing is before the start but for moves that are too far.
                let sample = |i: usize| x[(k + i).saturating_add_signed(whole as isize - 2).min(last)];
                taps.iter().enumerate().map(|(i, tap)| tap * sample(i)).sum()
            };
            self.span(x.len()).step_by(2).map(at).collect()
        };
        seconds.iter().map(later).collect()
    }

    /// Rows of a signal that is only looked up, not part of the equations: the value amid each row's samples.
    pub(crate) fn sample(&self, signal: &[f64]) -> Vec<f64> {
        let middle: Vec<f64> = signal.chunks_exact(self.average).map(|c| c[self.average / 2]).collect();
        self.span(middle.len()).step_by(2).map(|k| middle[k]).collect()
    }

    /// Standard deviation of rows per standard deviation of white noise on the samples.
    pub(crate) fn white_gain(&self) -> f64 {
        let middle = 40 * self.edge;
        let mut pulse = vec![0.0; 2 * middle];
        pulse[middle] = 1.0;
        self.filter.apply(&mut pulse);
        (pulse.iter().map(|p| p * p).sum::<f64>() / self.average as f64).sqrt()
    }

    /// Rows whose middle is among samples of a run of so many.
    pub(crate) fn rows_of(&self, within: Range<usize>, samples: usize) -> Range<usize> {
        let averaged = samples / self.average;
        let span = self.span(averaged);
        let row = |k: usize| k.clamp(span.start, span.end).saturating_sub(span.start).div_ceil(2);
        row(within.start.div_ceil(self.average))..row(within.end.div_ceil(self.average))
    }

    /// Samples around others beyond which the filter has forgotten these, and the rows of what is within.
    pub(crate) fn around(&self, within: Range<usize>, samples: usize) -> (Range<usize>, Range<usize>) {
        let tail = FORGOTTEN * self.edge;
        let from = (within.start / self.average).saturating_sub(tail) * self.average;
        let to = (within.end.div_ceil(self.average) + tail).min(samples / self.average) * self.average;
        (from..to, self.rows_of(from..to, samples))
    }

    /// `rows` of a signal that is nothing but for this part of it, which begins at sample `from` of a run of so many.
    pub(crate) fn part(&self, signal: &[f64], from: usize, rows: &Range<usize>) -> Vec<f64> {
        let mut x = self.averaged(signal);
        self.filter.apply(&mut x);
        rows.clone().map(|row| x[self.edge + 2 * row - from / self.average]).collect()
    }

    fn span(&self, len: usize) -> Range<usize> {
        let edge = self.edge.min(len / 2);
        edge..len - edge
    }

    /// Full-rate sample amid row `row`.
    pub(crate) fn sample_of(&self, row: usize) -> usize {
        (self.edge + 2 * row) * self.average + self.average / 2
    }
}

/// Weight of sample `i` of six for a place this far behind the third.
fn lagrange(i: usize, part: f64) -> f64 {
    let place = |k: usize| k as f64 - 2.0;
    (0..6).filter(|k| *k != i).map(|k| (part - place(k)) / (place(i) - place(k))).product()
}

/// One column of the equations in one run: rows by joint, `None` where it is zero throughout.
pub(crate) type Column = Vec<Option<Vec<f64>>>;

/// Filters a full-rate column, dropping joints on which it is nothing.
pub(crate) fn column(chain: &Chain, full: Vec<Option<Vec<f64>>>) -> Column {
    full.into_iter()
        .map(|signal| {
            let rows = chain.apply(&signal?);
            rows.iter().any(|v| *v != 0.0).then_some(rows)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sine of 3 Hz at 1 kHz.
    fn sine(late_s: f64) -> Vec<f64> {
        (0..4000).map(|k| (std::f64::consts::TAU * 3.0 * (1e-3 * f64::from(k) - late_s)).sin()).collect()
    }

    fn farthest(a: &[f64], b: &[f64]) -> f64 {
        a.iter().zip(b).fold(0.0, |m, (a, b)| f64::max(m, (a - b).abs()))
    }

    #[test]
    fn rows_of_a_signal_taken_later_are_those_of_one_that_came_earlier() {
        let chain = Chain::new(1e-3);
        for late in [-0.0123, 0.0, 0.0047, 0.03] {
            let rows = chain.apply_later(&sine(late), &[late]);
            assert!(farthest(&rows[0][20..300], &chain.apply(&sine(0.0))[20..300]) < 1e-4, "{late}");
        }
    }
}
