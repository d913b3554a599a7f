//! By how much torque samples are late against position samples, joint by joint.
//!
//! Current loops, filters in the drive and field buses put torque and position of one log row at different times. To
//! first order the delay T of a joint's torque is one more parameter, fitted together with all others, since friction
//! and inertia would otherwise take a part of it (`ΔFv = J·ω²·T` at one frequency):
//!
//! ```text
//! τ(t + T) = D(t)·x   →   τ = D·x − T·τ̇         column −τ̇ of the measured torque, instrument −d/dt(D·x̂)
//! ```
//!
//! Then the torque is taken back by what was found, to second order, and the rest is fitted again: what is left is the
//! third order, a share (ωT)²/6 of T for content at ω.

use super::fit::{Fit, Method, fit};
use super::record::OfflineError;
use super::rows::{JointRows, Rows};

/// How often the torque is taken back and the rest fitted.
const ROUNDS: usize = 3;

/// How late a joint's torque is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Delay {
    /// Torque behind position \[s\]; negative where the torque is ahead.
    pub seconds: f64,
    /// Its standard deviation \[s\].
    pub std: f64,
}

/// Estimates the delay of every joint's torque together with the parameters.
///
/// * `nominal`, `prior`: as for [`fit`](super::fit())
/// * `found`: the fit without delays
///
/// An effect that is out of phase with the torque and that the model lacks (friction that depends on the past, a second
/// viscous law) looks like a delay; two logs of different speed tell.
///
/// # Errors
/// When the equations have no solution.
pub fn torque_delay(rows: &[Rows], nominal: &[f64], prior: f64, found: &Fit) -> Result<Vec<Delay>, OfflineError> {
    let (k, n) = (nominal.len(), rows.first().map_or(0, |r| r.joints.len()));
    let start: Vec<f64> = nominal.iter().copied().chain(std::iter::repeat_n(0.0, n)).collect();
    let mut delays = vec![Delay { seconds: 0.0, std: 0.0 }; n];
    for _ in 0..ROUNDS {
        let wider: Vec<Rows> = rows.iter().map(|record| with_rates(record, &found.values, &delays)).collect();
        let fitted = fit(&wider, &start, prior, Method::Instrumental)?;
        for (j, delay) in delays.iter_mut().enumerate() {
            delay.seconds += fitted.values[k + j];
            delay.std = fitted.std[k + j];
        }
    }
    Ok(delays)
}

/// The rows with one more column a joint, and torques taken back by `delays`.
fn with_rates(record: &Rows, x: &[f64], delays: &[Delay]) -> Rows {
    let n = record.joints.len();
    let joints = record.joints.iter().zip(delays).enumerate().map(|(j, (rows, delay))| {
        let late = delay.seconds;
        let expected = expected_rates(rows, x, record.row_period_s);
        let rates: Vec<f64> = rows.tau_rate.iter().zip(&rows.tau_bend).map(|(rate, bend)| rate + late * bend).collect();
        let terms = rows.tau.iter().zip(&rows.tau_rate).zip(&rows.tau_bend);
        JointRows {
            d: widen(&rows.d, &rates, x.len(), j, n),
            z: widen(&rows.z, &expected, x.len(), j, n),
            tau: terms.map(|((tau, rate), bend)| tau + late * (rate + 0.5 * late * bend)).collect(),
            ..rows.clone()
        }
    });
    Rows { columns: x.len() + n, joints: joints.collect(), ..record.clone() }
}

/// Rows of `k` entries, followed by zeros but for minus the rate in place `j` of `n`.
fn widen(rows: &[f64], rates: &[f64], k: usize, j: usize, n: usize) -> Vec<f64> {
    let own = |rate: f64| (0..n).map(move |place| if place == j { -rate } else { 0.0 });
    rows.chunks_exact(k).zip(rates).flat_map(|(row, rate)| row.iter().copied().chain(own(*rate))).collect()
}

/// Rate of the model's torque, from the rows before and after where both are there, else zero: an instrument need not be
/// exact.
fn expected_rates(rows: &JointRows, x: &[f64], row_period_s: f64) -> Vec<f64> {
    let torque: Vec<f64> = rows.d.chunks_exact(x.len()).map(|d| d.iter().zip(x).map(|(d, x)| d * x).sum()).collect();
    let rate = |k: usize| {
        let whole = k > 0 && k + 1 < torque.len() && rows.place[k + 1] - rows.place[k - 1] == 2;
        if whole { (torque[k + 1] - torque[k - 1]) / (2.0 * row_period_s) } else { 0.0 }
    };
    (0..torque.len()).map(rate).collect()
}
