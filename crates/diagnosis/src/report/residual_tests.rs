//! Residual diagnostics of the model with all causes: whether the residual is noise, and its spectrum otherwise.

use std::f64::consts::{PI, TAU};

use crate::fit::stages::Stages;
use crate::screen::prepared::Prepared;

/// Longest lag of the autocorrelation \[s\], and the time between lags \[s\].
const LAG_S: f64 = 1.0;
const LAG_STEP_S: f64 = 0.02;
/// Length of a segment of the spectrum \[s\].
const SPECTRUM_SEGMENT_S: f64 = 2.56;
/// The model filter leaves nothing above this \[Hz\].
const HIGHEST_HZ: f64 = 30.0;
/// Orders of the joint's angle: highest, and how many are kept, each the largest of its stretch.
const HIGHEST_ORDER: f64 = 420.0;
const ORDERS: usize = 140;
/// Slower than this \[rad/s\] a joint's angle is no clock.
const TURNING: f64 = 0.05;

/// Amplitude of a residual at one order of the joint's angle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Order {
    /// Cycles per turn of the joint.
    pub order: f64,
    /// With all causes \[N·m\].
    pub after: f64,
    /// With the model as given \[N·m\].
    pub before: f64,
}

/// What is left of one joint's torque.
#[derive(Clone, Debug, PartialEq)]
pub struct Leftover {
    /// The joint's name.
    pub joint: String,
    /// Time between lags \[s\].
    pub lag_s: f64,
    /// Autocorrelation, from lag 0 on.
    pub autocorrelation: Vec<f64>,
    /// Size below which 95 % of the values of white noise lie.
    pub white: f64,
    /// \[Hz\]
    pub frequencies: Vec<f64>,
    /// Amplitude density with all causes \[N·m/√Hz\].
    pub density_after: Vec<f64>,
    /// The same with the model as given.
    pub density_before: Vec<f64>,
    /// By order of the joint's angle; empty where the joint hardly turns.
    pub orders: Vec<Order>,
    /// Correlation with what is left on every joint.
    pub correlation: Vec<f64>,
    /// Share of its square that is above the noise of the torque signal.
    pub above_noise: f64,
}

/// Joint by joint.
pub(crate) fn by_joint(run: &Prepared, stages: &Stages, names: &[String]) -> Vec<Leftover> {
    let residuals = |model: &Vec<Vec<f64>>| -> Vec<Vec<f64>> {
        stages.tau.iter().zip(model).map(|(t, m)| t.iter().zip(m).map(|(t, m)| t - m).collect()).collect()
    };
    let before = residuals(&stages.models[0]);
    let after = residuals(&stages.models[stages.models.len() - 1]);
    let period = run.chain.row_period_s;
    names
        .iter()
        .enumerate()
        .map(|(j, name)| {
            let step = (LAG_STEP_S / period).round().max(1.0) as usize;
            let lags = ((LAG_S / period) as usize).min(after[j].len() / 4);
            let (frequencies, density_after) = spectrum(&after[j], period);
            let (_, density_before) = spectrum(&before[j], period);
            let power = dot(&after[j], &after[j]) / after[j].len().max(1) as f64;
            Leftover {
                joint: name.clone(),
                lag_s: step as f64 * period,
                autocorrelation: (0..lags).step_by(step).map(|lag| autocorrelation(&after[j], lag)).collect(),
                white: 1.96 / (after[j].len().max(1) as f64).sqrt(),
                frequencies,
                density_after,
                density_before,
                orders: orders(run, j, &before[j], &after[j]),
                correlation: after.iter().map(|other| correlation(&after[j], other)).collect(),
                above_noise: (1.0 - run.floor[j].powi(2) / power.max(f64::MIN_POSITIVE)).clamp(0.0, 1.0),
            }
        })
        .collect()
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn autocorrelation(x: &[f64], lag: usize) -> f64 {
    dot(&x[lag..], x) / dot(x, x).max(f64::MIN_POSITIVE)
}

fn correlation(a: &[f64], b: &[f64]) -> f64 {
    dot(a, b) / (dot(a, a) * dot(b, b)).sqrt().max(f64::MIN_POSITIVE)
}

/// Frequencies \[Hz\] and one-sided amplitude densities: Hann windows, half overlapped (Welch 1967).
fn spectrum(x: &[f64], period_s: f64) -> (Vec<f64>, Vec<f64>) {
    let n = ((SPECTRUM_SEGMENT_S / period_s).round() as usize).min(x.len());
    if n < 16 {
        return (Vec::new(), Vec::new());
    }
    let window: Vec<f64> = (0..n).map(|k| 0.5 - 0.5 * (TAU * (k as f64 + 0.5) / n as f64).cos()).collect();
    let energy: f64 = window.iter().map(|w| w * w).sum();
    let starts: Vec<usize> = (0..=x.len() - n).step_by(n / 2).collect();
    let step_hz = 1.0 / (n as f64 * period_s);
    let count = ((HIGHEST_HZ / step_hz) as usize).min(n / 2 - 1);
    let density = |bin: usize| {
        let turn = TAU * bin as f64 / n as f64;
        let power: f64 = starts
            .iter()
            .map(|from| {
                let (mut re, mut im) = (0.0, 0.0);
                for k in 0..n {
                    let (s, c) = (turn * k as f64).sin_cos();
                    let v = x[from + k] * window[k];
                    re += v * c;
                    im += v * s;
                }
                re * re + im * im
            })
            .sum();
        (2.0 * period_s * power / (energy * starts.len() as f64)).sqrt()
    };
    let bins = 1..=count;
    (bins.clone().map(|b| b as f64 * step_hz).collect(), bins.map(density).collect())
}

/// Amplitudes by order of the joint's angle, over the rows that turn slowly enough for the order to pass the model filter.
fn orders(run: &Prepared, j: usize, before: &[f64], after: &[f64]) -> Vec<Order> {
    let q = run.chain.sample(&run.motion.q[j]);
    let qd = run.chain.sample(&run.motion.qd[j]);
    let (low, high) = q.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
    let range = high - low;
    if range.is_nan() || range < 0.2 {
        return Vec::new();
    }
    // Orders that the range holds at least twice; closer ones are not told apart.
    let (lowest, step) = (2.0 * TAU / range, 0.5 * PI / range);
    let count = ((HIGHEST_ORDER - lowest) / step).max(1.0) as usize;
    let each = count.div_ceil(ORDERS);
    let amplitude = |order: f64| {
        let (mut sums, mut rows) = ([0.0; 4], 0usize);
        for k in 0..q.len() {
            if qd[k].abs() < TURNING || order * qd[k].abs() > TAU * 0.7 * HIGHEST_HZ {
                continue;
            }
            let (s, c) = (order * q[k]).sin_cos();
            sums[0] += before[k] * c;
            sums[1] += before[k] * s;
            sums[2] += after[k] * c;
            sums[3] += after[k] * s;
            rows += 1;
        }
        let scale = 2.0 / rows.max(1) as f64;
        let known = rows as f64 * run.chain.row_period_s > 1.0;
        known.then(|| Order { order, before: scale * sums[0].hypot(sums[1]), after: scale * sums[2].hypot(sums[3]) })
    };
    (0..count)
        .step_by(each)
        .filter_map(|first| {
            let amplitudes = (first..(first + each).min(count)).filter_map(|i| amplitude(lowest + step * i as f64));
            amplitudes.max_by(|a, b| a.before.max(a.after).total_cmp(&b.before.max(b.after)))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sine of amplitude a has the power a²/2 at its frequency and nothing elsewhere.
    #[test]
    fn the_spectrum_holds_the_power_of_a_sine_at_its_frequency() {
        let (period, hz, amplitude) = (0.01, 6.25, 3.0);
        let x: Vec<f64> = (0..4096).map(|k| amplitude * (TAU * hz * period * f64::from(k)).sin()).collect();
        let (frequencies, density) = spectrum(&x, period);
        let step = frequencies[1] - frequencies[0];
        let power: f64 = density.iter().map(|d| d * d * step).sum();
        assert!((power - 0.5 * amplitude * amplitude).abs() < 0.01 * power, "{power}");
        let top = (0..density.len()).max_by(|a, b| density[*a].total_cmp(&density[*b])).expect("bins");
        assert!((frequencies[top] - hz).abs() <= step, "{}", frequencies[top]);
    }

    #[test]
    fn autocorrelation_is_one_at_once_and_turns_with_a_sine() {
        let x: Vec<f64> = (0..2000).map(|k| (TAU * f64::from(k) / 40.0).sin()).collect();
        assert_eq!(autocorrelation(&x, 0), 1.0);
        assert!(autocorrelation(&x, 20) < -0.95 && autocorrelation(&x, 10).abs() < 0.05);
    }
}
