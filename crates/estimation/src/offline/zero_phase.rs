//! Butterworth low-pass run forwards and backwards: twice the attenuation, no phase.

use std::f64::consts::PI;

use multiversion::multiversion;
use rivet_dynamics::MAX_JOINTS;

use crate::filter::{Butterworth, Order};

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
        let filtered = self.side_by_side::<1>(&[&*x]);
        for filtered in filtered {
            x.copy_from_slice(&filtered);
        }
    }

    /// Several records of one length, filtered: as many side by side as an arm has joints take hardly longer than one.
    pub(super) fn of_all(&self, signals: &[Vec<f64>]) -> Vec<Vec<f64>> {
        signals.chunks(MAX_JOINTS).flat_map(|some| self.side_by_side::<MAX_JOINTS>(some)).collect()
    }

    /// At most so many records as there are lanes.
    fn side_by_side<const LANES: usize>(&self, signals: &[impl AsRef<[f64]>]) -> Vec<Vec<f64>> {
        let signals: Vec<&[f64]> = signals.iter().map(AsRef::as_ref).collect();
        let n = signals.first().map_or(0, |x| x.len());
        if n < 2 {
            return signals.iter().map(|x| x.to_vec()).collect();
        }
        let pad = self.padding(n);
        // Samples of all records side by side, a few at a time: beside the records there is room for no more than those and the last
        // ones beyond their end.
        let mut few = [[0.0; LANES]; ZERO_PHASE_CHUNK];
        let mut passes = Passes::new(&self.sections);
        for from in (0..pad).step_by(ZERO_PHASE_CHUNK) {
            let few = &mut few[..ZERO_PHASE_CHUNK.min(pad - from)];
            for (k, lanes) in (from..).zip(&mut *few) {
                lanes.iter_mut().zip(&signals).for_each(|(lane, x)| *lane = 2.0 * x[0] - x[pad - k]);
            }
            passes.run(few, Order::Forwards);
        }
        let mut filtered: Vec<Vec<f64>> = signals.iter().map(|x| Vec::with_capacity(x.len())).collect();
        for from in (0..n).step_by(ZERO_PHASE_CHUNK) {
            let few = &mut few[..ZERO_PHASE_CHUNK.min(n - from)];
            for (lane, x) in signals.iter().enumerate() {
                few.iter_mut().zip(&x[from..]).for_each(|(lanes, x)| lanes[lane] = *x);
            }
            passes.run(few, Order::Forwards);
            for (lane, filtered) in filtered.iter_mut().enumerate() {
                filtered.extend(few.iter().map(|lanes| lanes[lane]));
            }
        }
        let mut beyond = vec![[0.0; LANES]; pad];
        for (k, lanes) in beyond.iter_mut().enumerate() {
            lanes.iter_mut().zip(&signals).for_each(|(lane, x)| *lane = 2.0 * x[n - 1] - x[n - 2 - k]);
        }
        passes.run(&mut beyond, Order::Forwards);
        let mut passes = Passes::new(&self.sections);
        passes.run(&mut beyond, Order::Backwards);
        for from in (0..n).step_by(ZERO_PHASE_CHUNK).rev() {
            let few = &mut few[..ZERO_PHASE_CHUNK.min(n - from)];
            for (lane, x) in filtered.iter().enumerate() {
                few.iter_mut().zip(&x[from..]).for_each(|(lanes, x)| lanes[lane] = *x);
            }
            passes.run(few, Order::Backwards);
            for (lane, x) in filtered.iter_mut().enumerate() {
                x[from..].iter_mut().zip(&*few).for_each(|(x, lanes)| *x = lanes[lane]);
            }
        }
        filtered
    }
}

/// So many samples are filtered at a time.
const ZERO_PHASE_CHUNK: usize = 256;

/// A pass in one direction over samples that come in pieces: transposed direct form II, every section started as if the first value that it
/// sees had always been there.
struct Passes<'a, const LANES: usize> {
    sections: &'a [Section],
    states: Vec<[[f64; LANES]; 2]>,
    first: bool,
}

impl<'a, const LANES: usize> Passes<'a, LANES> {
    fn new(sections: &'a [Section]) -> Passes<'a, LANES> {
        Passes { sections, states: vec![[[0.0; LANES]; 2]; sections.len()], first: true }
    }

    fn run(&mut self, samples: &mut [[f64; LANES]], order: Order) {
        run(self.sections, &mut self.states, &mut self.first, samples, order);
    }
}

#[multiversion(targets("x86_64+avx+avx2"))]
fn run<const LANES: usize>(
    sections: &[Section],
    states: &mut [[[f64; LANES]; 2]],
    first: &mut bool,
    samples: &mut [[f64; LANES]],
    order: Order,
) {
    let mut step = |x: &mut [f64; LANES]| {
        for (Section { b, a }, [s1, s2]) in sections.iter().zip(&mut *states) {
            for lane in 0..LANES {
                let u = x[lane];
                if *first {
                    (s1[lane], s2[lane]) = (u * (1.0 - b[0]), u * (b[2] - a[1]));
                }
                let y = b[0] * u + s1[lane];
                s1[lane] = b[1] * u - a[0] * y + s2[lane];
                s2[lane] = b[2] * u - a[1] * y;
                x[lane] = y;
            }
        }
        *first = false;
    };
    match order {
        Order::Forwards => samples.iter_mut().for_each(&mut step),
        Order::Backwards => samples.iter_mut().rev().for_each(&mut step),
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
    fn side_by_side_records_are_filtered_like_each_alone() {
        let filter = ZeroPhase::new(12.0, 4, 0.002);
        for length in [0, 1, 2, 7, 900] {
            let wave = |j: i32| (0..length).map(|k| f64::from((k * 7919 + j * 31) % 101)).collect::<Vec<f64>>();
            let mut records: Vec<Vec<f64>> = (0..11).map(wave).collect();
            let together = filter.of_all(&records);
            for record in &mut records {
                filter.apply(record);
            }
            assert_eq!(together, records, "{length}");
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
