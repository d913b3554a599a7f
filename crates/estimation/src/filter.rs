//! The model filter: one Butterworth low-pass over many channels at once.
//!
//! A linear filter over every column of the regressor and over the torque leaves the model equation as it is (paper,
//! 3.1.2), provided that it is the same filter with the same kind of initial state everywhere: here the state that a
//! constant first sample would have left, which is linear in that sample as well.

use std::f64::consts::PI;

use multiversion::multiversion;

/// `[b0, b1, b2, a1, a2]` of `H(z) = (b0 + b1·z⁻¹ + b2·z⁻²)/(1 + a1·z⁻¹ + a2·z⁻²)`.
pub type Section = [f64; 5];

/// Low-pass of even order as second-order sections, each of unit gain at 0 Hz.
#[derive(Clone, Debug, PartialEq)]
pub struct Butterworth {
    /// The sections, in the order in which they are applied.
    pub sections: Vec<Section>,
}

impl Butterworth {
    /// Low-pass of `order` (even) with −3 dB at `cutoff_hz` for samples at `sample_hz`, by the bilinear transform with
    /// the cut-off pre-warped: `K = tan(π·fc/fs)`, quality of section k `Q = 1/(2 sin(π(2k + 1)/2N))`.
    ///
    /// `cutoff_hz` must lie below half of `sample_hz`.
    #[must_use]
    pub fn low_pass(order: usize, cutoff_hz: f64, sample_hz: f64) -> Butterworth {
        let k = (PI * cutoff_hz / sample_hz).tan();
        let section = |i: usize| {
            let inverse_q = 2.0 * (PI * (2 * i + 1) as f64 / (2 * order) as f64).sin();
            let norm = 1.0 / (1.0 + k * inverse_q + k * k);
            let b = k * k * norm;
            [b, 2.0 * b, b, 2.0 * (k * k - 1.0) * norm, (1.0 - k * inverse_q + k * k) * norm]
        };
        Butterworth { sections: (0..order / 2).map(section).collect() }
    }

    /// Response to a single 1 until it has died out (below 1e-9 of its peak), at most `longest` samples.
    #[must_use]
    pub fn impulse_response(&self, longest: usize) -> Vec<f64> {
        let mut bank = Bank::new(self.clone(), 1);
        bank.start_at_rest();
        let mut response = Vec::new();
        let (mut peak, mut quiet) = (0.0_f64, 0);
        while response.len() < longest && quiet < 200 {
            let mut x = [f64::from(u8::from(response.is_empty()))];
            bank.step(&mut x);
            peak = peak.max(x[0].abs());
            quiet = if x[0].abs() <= 1e-9 * peak && response.len() > 10 { quiet + 1 } else { 0 };
            response.push(x[0]);
        }
        response
    }
}

/// Variance of a mean over filtered, decimated white noise, relative to what it were if those samples were
/// independent: `Σₖ r(kD) / r(0)` with the autocorrelation r of the response h.
///
/// This is what the model filter does to the variance of estimates from motion that is slow against its cut-off.
#[must_use]
pub fn correlation_factor(response: &[f64], decimation: usize) -> f64 {
    let r = |lag: usize| response.iter().zip(response.iter().skip(lag)).map(|(a, b)| a * b).sum::<f64>();
    let tail: f64 = (decimation..response.len()).step_by(decimation).map(r).sum();
    (1.0 + 2.0 * tail / r(0)).max(1e-3)
}

/// Correlation of neighbouring samples of filtered, decimated white noise.
#[must_use]
pub fn neighbour_correlation(response: &[f64], decimation: usize) -> f64 {
    let r = |lag: usize| response.iter().zip(response.iter().skip(lag)).map(|(a, b)| a * b).sum::<f64>();
    r(decimation) / r(0)
}

/// States smaller than this are set to zero: after a long rest the states would otherwise sink into denormal numbers,
/// which cost a hundred times as much as others.
const SILENCE: f64 = 1e-200;
/// One channel in so many is looked at each sample. No filter sinks from there to 1e-308 in that time: its
/// poles would have to lie within 1e-6 of the origin.
const UNDERFLOW_CHECK_PARTS: usize = 16;

/// The same filter over many channels, direct form II transposed.
#[derive(Clone, Debug)]
pub struct Bank {
    filter: Butterworth,
    channels: usize,
    /// Two states a section, all channels of one state together.
    state: Vec<f64>,
    primed: bool,
    /// Part of the channels that is looked at next.
    part: usize,
}

impl Bank {
    /// Room for so many channels; the first sample will be taken as what they had for ever.
    #[must_use]
    pub fn new(filter: Butterworth, channels: usize) -> Bank {
        let state = vec![0.0; 2 * filter.sections.len() * channels];
        Bank { filter, channels, state, primed: false, part: 0 }
    }

    /// The next sample will be taken as the value that all channels had for ever.
    pub fn restart(&mut self) {
        self.primed = false;
        self.part = 0;
    }

    /// All channels were 0 for ever.
    pub fn start_at_rest(&mut self) {
        self.state.fill(0.0);
        self.primed = true;
    }

    /// Filters one sample of each channel in place.
    pub fn step(&mut self, x: &mut [f64]) {
        self.prime(x);
        let n = self.channels;
        for (states, section) in self.state.chunks_exact_mut(2 * n).zip(&self.filter.sections) {
            let (s1, s2) = states.split_at_mut(n);
            run(section, x, s1, s2);
        }
        self.quieten();
    }

    /// Filters samples of all channels that follow each other, in place and in either order of time: what
    /// [`step`](Self::step) makes of one after the other.
    pub(crate) fn pass(&mut self, samples: &mut [f64], order: Order) {
        let length = FILTER_CHUNK * self.channels;
        match order {
            Order::Forwards => samples.chunks_mut(length).for_each(|few| self.pass_few::<false>(few)),
            Order::Backwards => samples.rchunks_mut(length).for_each(|few| self.pass_few::<true>(few)),
        }
    }

    fn pass_few<const BACKWARDS: bool>(&mut self, samples: &mut [f64]) {
        let n = self.channels;
        let first = if BACKWARDS { samples.len() - n } else { 0 };
        self.prime(&samples[first..first + n]);
        for (states, section) in self.state.chunks_exact_mut(2 * n).zip(&self.filter.sections) {
            let (s1, s2) = states.split_at_mut(n);
            run_through::<BACKWARDS>(section, samples, s1, s2);
        }
        (0..samples.len() / n).for_each(|_| self.quieten());
    }

    /// Takes the first sample as the value that all channels had for ever.
    fn prime(&mut self, x: &[f64]) {
        if self.primed {
            return;
        }
        self.primed = true;
        let n = self.channels;
        // Every section has unit gain at rest, so each of them sees the same constant.
        for (states, s) in self.state.chunks_exact_mut(2 * n).zip(&self.filter.sections) {
            let (s1, s2) = states.split_at_mut(n);
            for ((s1, s2), &x) in s1.iter_mut().zip(s2).zip(x) {
                *s1 = (1.0 - s[0]) * x;
                *s2 = (s[2] - s[4]) * x;
            }
        }
    }

    /// Sets states to zero that are next to nothing, of the channels whose turn it is.
    fn quieten(&mut self) {
        let n = self.channels;
        // All states of a channel at once: one that is left would wake the others.
        let size = n.div_ceil(UNDERFLOW_CHECK_PARTS);
        let part = n.min(self.part * size)..n.min((self.part + 1) * size);
        for states in self.state.chunks_exact_mut(n) {
            for s in &mut states[part.clone()] {
                *s = if s.abs() < SILENCE { 0.0 } else { *s };
            }
        }
        self.part = (self.part + 1) % UNDERFLOW_CHECK_PARTS;
    }
}

/// One section over all channels.
#[multiversion(targets("x86_64+avx+avx2"))]
fn run(&[b0, b1, b2, a1, a2]: &Section, x: &mut [f64], s1: &mut [f64], s2: &mut [f64]) {
    for ((s1, s2), x) in s1.iter_mut().zip(s2).zip(x) {
        let y = b0 * *x + *s1;
        *s1 = b1 * *x - a1 * y + *s2;
        *s2 = b2 * *x - a2 * y;
        *x = y;
    }
}

/// In which order samples go through a filter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Order {
    Forwards,
    Backwards,
}

/// So many samples go through a section before the next section, and so many channels through all of them before the next
/// channels: states then stay in registers and samples in the first cache.
pub(crate) const FILTER_CHUNK: usize = 4;
const ABREAST: usize = 8;

/// One section over all channels of a few samples.
#[multiversion(targets("x86_64+avx+avx2"))]
fn run_through<const BACKWARDS: bool>(section: &Section, samples: &mut [f64], s1: &mut [f64], s2: &mut [f64]) {
    let n = s1.len();
    let &[b0, b1, b2, a1, a2] = section;
    let ((groups1, rest1), (groups2, rest2)) = (s1.as_chunks_mut::<ABREAST>(), s2.as_chunks_mut::<ABREAST>());
    for (k, (group1, group2)) in groups1.iter_mut().zip(groups2).enumerate() {
        let (mut s1, mut s2) = (*group1, *group2);
        let mut step = |sample: &mut [f64]| {
            for x in sample[k * ABREAST..].as_chunks_mut::<ABREAST>().0.iter_mut().take(1) {
                for i in 0..ABREAST {
                    let y = b0 * x[i] + s1[i];
                    s1[i] = b1 * x[i] - a1 * y + s2[i];
                    s2[i] = b2 * x[i] - a2 * y;
                    x[i] = y;
                }
            }
        };
        if BACKWARDS {
            samples.rchunks_exact_mut(n).for_each(&mut step);
        } else {
            samples.chunks_exact_mut(n).for_each(&mut step);
        }
        (*group1, *group2) = (s1, s2);
    }
    let rest = n - rest1.len();
    let mut step = |sample: &mut [f64]| run(section, &mut sample[rest..], rest1, rest2);
    if BACKWARDS {
        samples.rchunks_exact_mut(n).for_each(&mut step);
    } else {
        samples.chunks_exact_mut(n).for_each(&mut step);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gain(order: usize, cutoff: f64, rate: f64, at: f64) -> f64 {
        let mut bank = Bank::new(Butterworth::low_pass(order, cutoff, rate), 2);
        let total = (400.0 * rate / at).ceil() as usize;
        let (mut c, mut s, mut count) = (0.0, 0.0, 0.0);
        for i in 0..total {
            let phase = 2.0 * PI * at * i as f64 / rate;
            let mut x = [phase.cos(), phase.sin()];
            bank.step(&mut x);
            if i > total / 2 {
                // Output of cos and sin inputs: its modulus is the gain, whatever the phase.
                c += x[0] * x[0];
                s += x[1] * x[1];
                count += 1.0;
            }
        }
        ((c + s) / count).sqrt()
    }

    /// |H|² = 1/(1 + (tan(πf/fs)/tan(πfc/fs))^2N), the bilinear image of the analogue filter.
    #[test]
    fn frequency_response_is_butterworth() {
        for (order, power) in [(2, 4), (4, 8), (6, 12), (8, 16)] {
            for (cutoff, rate) in [(20.0, 1000.0), (6.0, 94.0), (50.0, 125.0)] {
                assert!((gain(order, cutoff, rate, cutoff) - 0.5_f64.sqrt()).abs() < 1e-6, "{order} {cutoff}");
                for at in [0.2 * cutoff, 0.9 * cutoff] {
                    let ratio = (PI * at / rate).tan() / (PI * cutoff / rate).tan();
                    let expected = 1.0 / (1.0 + ratio.powi(power)).sqrt();
                    assert!((gain(order, cutoff, rate, at) - expected).abs() < 1e-6, "{order} {cutoff} {at}");
                }
            }
        }
    }

    /// The first sample makes no step: a constant passes unchanged from the start, and after a restart.
    #[test]
    fn a_constant_passes_unchanged() {
        let mut bank = Bank::new(Butterworth::low_pass(4, 20.0, 1000.0), 3);
        for round in 0..2 {
            for _ in 0..50 {
                let mut x = [7.0, -3.0e5, 0.0];
                bank.step(&mut x);
                for (x, e) in x.iter().zip([7.0, -3.0e5, 0.0]) {
                    // 1 − b0 and b2 − a2 lose digits to cancellation in the poles near 1
                    assert!((x - e).abs() <= 1e-11 * f64::abs(e), "{round}: {x} vs {e}");
                }
            }
            bank.restart();
        }
    }

    /// Sum over all time of the response is the gain at 0 Hz.
    #[test]
    fn impulse_response_is_complete() {
        let h = Butterworth::low_pass(4, 20.0, 1000.0).impulse_response(100_000);
        assert!((h.iter().sum::<f64>() - 1.0).abs() < 1e-7);
        // Uncorrelated samples: factor 1. Samples at 5 times the cut-off: close to fs/(2·1.026·fc) = 2.44.
        assert!((correlation_factor(&[1.0], 1) - 1.0).abs() < 1e-15);
        let factor = correlation_factor(&h, 10);
        assert!((factor - 2.437).abs() < 0.02, "{factor}");
    }

    #[test]
    fn many_samples_at_once_are_the_same_as_one_after_the_other() {
        let filter = Butterworth::low_pass(4, 20.0, 1000.0);
        for (channels, count) in [(1, 3), (8, 4), (21, 10)] {
            let samples: Vec<f64> = (0..channels * count).map(|k| f64::from(k as u32 * 7919 % 101) - 50.0).collect();
            let mut bank = Bank::new(filter.clone(), channels);
            let (mut stepped, mut passed) = (samples.clone(), samples.clone());
            stepped.chunks_exact_mut(channels).for_each(|sample| bank.step(sample));
            bank.restart();
            bank.pass(&mut passed, Order::Forwards);
            assert_eq!(stepped, passed);
            bank.restart();
            stepped.chunks_exact_mut(channels).rev().for_each(|sample| bank.step(sample));
            bank.restart();
            bank.pass(&mut passed, Order::Backwards);
            assert_eq!(stepped, passed);
        }
    }

    #[test]
    fn rest_ends_in_zero_not_in_denormals() {
        let mut bank = Bank::new(Butterworth::low_pass(4, 20.0, 1000.0), 1);
        bank.step(&mut [1.0]);
        for _ in 0..100_000 {
            let mut x = [0.0];
            bank.step(&mut x);
            assert!(x[0] == 0.0 || x[0].is_normal());
        }
        assert!(bank.state.iter().all(|&s| s == 0.0));
    }
}
