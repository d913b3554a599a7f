//! Butterworth low-pass run forwards and backwards: twice the attenuation, no phase.

use std::f64::consts::PI;

use crate::filter::Butterworth;

/// A second-order section, `y = b0 u + b1 u' + b2 u'' - a1 y' - a2 y''`.
#[derive(Clone, Copy, Debug)]
struct Section {
    b: [f64; 3],
    a: [f64; 2],
}

/// A zero-phase low-pass: Butterworth of even order (bilinear transform, frequency prewarped), both directions.
#[derive(Clone, Debug)]
pub struct ZeroPhase {
    sections: Vec<Section>,
    /// Samples at either end of a record that the unknown past and future still colour.
    edge: usize,
}

impl ZeroPhase {
    /// A low-pass of `cutoff_hz` (-6 dB after both passes) for records of period `period_s` \[s\].
    ///
    /// The cut-off is kept below 0.45 of the sampling rate; `order` is that of one pass, odd ones are rounded up.
    pub fn new(cutoff_hz: f64, order: usize, period_s: f64) -> ZeroPhase {
        let share = (cutoff_hz * period_s).min(0.45);
        let k = (PI * share).tan();
        let order = order.div_ceil(2).max(1) * 2;
        let section = |i: usize| {
            // Poles of the prototype at angles (2i+1)π/2n from the imaginary axis: 1/Q = 2 sin.
            let damping = 2.0 * (PI * (2 * i + 1) as f64 / (2 * order) as f64).sin();
            let scale = 1.0 / (1.0 + k * damping + k * k);
            let b = k * k * scale;
            Section { b: [b, 2.0 * b, b], a: [2.0 * (k * k - 1.0) * scale, (1.0 - k * damping + k * k) * scale] }
        };
        let sections = (0..order / 2).map(section).collect();
        ZeroPhase { sections, edge: (0.5 / share).ceil() as usize }
    }

    /// Samples to leave out at either end of a filtered record: half a period of the cut-off.
    pub fn edge(&self) -> usize {
        self.edge
    }

    /// Samples by which a record of `rows` samples is continued beyond either end.
    pub(super) fn padding(&self, rows: usize) -> usize {
        (6 * self.edge).min(rows.saturating_sub(1))
    }

    /// One pass as a filter over many channels.
    pub(super) fn butterworth(&self) -> Butterworth {
        Butterworth { sections: self.sections.iter().map(|s| [s.b[0], s.b[1], s.b[2], s.a[0], s.a[1]]).collect() }
    }

    /// Samples after which the start of a pass is forgotten, to 1e-14: the slowest poles lie π/2N from the imaginary axis
    /// and lose e^(−π·sin(π/2N)) in an edge, half a period of the cut-off.
    pub(super) fn settling(&self) -> usize {
        let slowest = PI * (PI / (4 * self.sections.len()) as f64).sin();
        (32.0 / slowest).ceil() as usize * self.edge
    }

    /// Filters a record in place. Beyond its ends the record is continued by turning it about its end points.
    pub fn apply(&self, x: &mut [f64]) {
        let n = x.len();
        if n < 2 {
            return;
        }
        let pad = self.padding(n);
        let (first, last) = (x[0], x[n - 1]);
        let mut y: Vec<f64> = (1..=pad).rev().map(|k| 2.0 * first - x[k]).collect();
        y.extend_from_slice(x);
        y.extend((1..=pad).map(|k| 2.0 * last - x[n - 1 - k]));
        for _ in 0..2 {
            for section in &self.sections {
                section.run(&mut y);
            }
            y.reverse();
        }
        x.copy_from_slice(&y[pad..pad + n]);
    }
}

impl Section {
    /// Transposed direct form II, started as if the first value had always been there.
    fn run(&self, x: &mut [f64]) {
        let (b, a) = (self.b, self.a);
        let start = x[0];
        let (mut s1, mut s2) = (start * (1.0 - b[0]), start * (b[2] - a[1]));
        for value in x {
            let u = *value;
            let y = b[0] * u + s1;
            s1 = b[1] * u - a[0] * y + s2;
            s2 = b[2] * u - a[1] * y;
            *value = y;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// |H|² of a Butterworth of order n with the bilinear warp: 1/(1 + (tan(πfT)/tan(πf_cT))^(2n)), no phase.
    #[test]
    fn response_is_butterworth_squared_without_phase() {
        for order in [2, 4, 6] {
            let (period, cutoff) = (0.001, 15.0);
            let filter = ZeroPhase::new(cutoff, order, period);
            for hz in [1.0, 10.0, 15.0, 30.0, 60.0] {
                let wave = |k: usize| (2.0 * PI * hz * k as f64 * period).sin();
                let mut x: Vec<f64> = (0..4000).map(wave).collect();
                filter.apply(&mut x);
                let ratio = (PI * hz * period).tan() / (PI * cutoff * period).tan();
                let gain = 1.0 / (1.0 + ratio.powf(2.0 * order as f64));
                for k in 1500..2500 {
                    assert!((x[k] - gain * wave(k)).abs() < 1e-6, "order {order}, {hz} Hz, sample {k}");
                }
            }
        }
    }

    #[test]
    fn a_straight_line_passes_unchanged_to_its_ends() {
        let mut x: Vec<f64> = (0..500).map(|k| 3.0 - 0.02 * f64::from(k)).collect();
        let line = x.clone();
        ZeroPhase::new(10.0, 4, 0.001).apply(&mut x);
        let far = x.iter().zip(&line).fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()));
        assert!(far < 1e-3, "{far}");
        let mut short = [1.0];
        ZeroPhase::new(10.0, 4, 0.001).apply(&mut short);
        assert_eq!(short, [1.0]);
    }
}
