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

use nalgebra::DVector;
use rayon::prelude::*;

use super::fit::{Fit, Method, Solution};
use super::record::OfflineError;
use super::rows::JointRows;
use super::sums::{Equations, JointSums, Normal, Stretch};
use crate::linear::axpy;

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
pub fn torque_delay(
    equations: &Equations<'_>,
    nominal: &[f64],
    prior: f64,
    found: &Fit,
) -> Result<Vec<Delay>, OfflineError> {
    let (k, n) = (nominal.len(), equations.joints.len());
    let start = DVector::from_iterator(k + n, nominal.iter().copied().chain(std::iter::repeat_n(0.0, n)));
    let weights: Vec<f64> = found.noise.iter().zip(&found.correlation).map(|(s, c)| 1.0 / (s * s * c)).collect();
    let rates: Vec<Vec<Rates>> = (0..n).into_par_iter().map(|j| rates(equations, j, &found.values)).collect();
    let mut delays = vec![Delay { seconds: 0.0, std: 0.0 }; n];
    for round in 1..=ROUNDS {
        let widened = |j: usize| widen(&equations.joints[j], &rates[j], k + j, delays[j].seconds);
        let joints: Vec<JointSums> = (0..n).map(widened).collect();
        let normals: Vec<Normal> = joints.iter().map(|j| Normal::new(j, k + n, Method::Instrumental)).collect();
        let solution = Solution::new(&normals, &weights, &start, prior, Method::Instrumental)?;
        delays.iter_mut().enumerate().for_each(|(j, delay)| delay.seconds += solution.x[k + j]);
        if round == ROUNDS {
            let covariance = solution.long_run_covariance(&joints, &weights, Method::Instrumental);
            let std = solution.certainty(&covariance).0;
            delays.iter_mut().zip(&std[k..]).for_each(|(delay, std)| delay.std = *std);
        }
    }
    Ok(delays)
}

/// Products of a stretch's rows with r = τ̇, b = τ̈ and the instrument e.
struct Rates {
    d: [Vec<f64>; 3],
    z: [Vec<f64>; 3],
    /// Products of τ, r, b and e with each other.
    own: [[f64; 4]; 4],
}

/// Sums with the rates of joint `j`, stretch by stretch.
fn rates(equations: &Equations<'_>, j: usize, x: &[f64]) -> Vec<Rates> {
    let mut found = Vec::new();
    let width = equations.joints[j].columns.len();
    let zeros = || [(); 3].map(|()| vec![0.0; width]);
    for record in equations.rows {
        let joint = &record.joints[j];
        let expected = expected_rates(joint, x, record.row_period_s);
        for range in equations.ranges(record, j) {
            let mut sums = Rates { d: zeros(), z: zeros(), own: [[0.0; 4]; 4] };
            for row in range {
                let all = [joint.tau[row], joint.tau_rate[row], joint.tau_bend[row], expected[row]];
                let at = row * width..(row + 1) * width;
                for (k, value) in all[1..].iter().enumerate() {
                    axpy(*value, &joint.d[at.clone()], &mut sums.d[k]);
                    axpy(*value, &joint.z[at.clone()], &mut sums.z[k]);
                }
                for (own, a) in sums.own.iter_mut().zip(all) {
                    own.iter_mut().zip(all).for_each(|(sum, b)| *sum += a * b);
                }
            }
            found.push(sums);
        }
    }
    found
}

/// The sums with one more column (index `place`), minus the rate; torque and rate are taken back by `late` \[s\], to
/// second order.
fn widen(joint: &JointSums, rates: &[Rates], place: usize, late: f64) -> JointSums {
    let n = joint.columns.len();
    let square = 0.5 * late * late;
    // Products with the torque taken back, from those with torque, rate and bend; likewise with the rate.
    let torque = |with: &[f64; 4]| with[0] + late * with[1] + square * with[2];
    let rate = |with: &[f64; 4]| with[1] + late * with[2];
    let rates_of = |[r, b, _]: &[Vec<f64>; 3]| -> Vec<f64> { r.iter().zip(b).map(|(r, b)| r + late * b).collect() };
    let torques_of = |t: &[f64], [r, b, _]: &[Vec<f64>; 3], added: f64| -> Vec<f64> {
        let own = t.iter().zip(r).zip(b).map(|((t, r), b)| t + late * r + square * b);
        own.chain([-added]).collect()
    };
    let bordered = |m: &[f64], right: &[f64], below: &[f64], corner: f64| -> Vec<f64> {
        let row = |i: usize| m[i * n..(i + 1) * n].iter().copied().chain([-right[i]]);
        (0..n).flat_map(row).chain(below.iter().map(|x| -x)).chain([corner]).collect()
    };
    let of = |(sums, rates): (&Stretch, &Rates)| {
        let (dr, zr) = (rates_of(&rates.d), rates_of(&rates.z));
        let [by_torque, by_rate, by_bend, by_expected] = &rates.own;
        Stretch {
            dd: bordered(&sums.dd, &dr, &dr, rate(by_rate) + late * rate(by_bend)),
            zd: bordered(&sums.zd, &zr, &rates.d[2], rate(by_expected)),
            zz: bordered(&sums.zz, &rates.z[2], &rates.z[2], by_expected[3]),
            dt: torques_of(&sums.dt, &rates.d, torque(by_rate) + late * torque(by_bend)),
            zt: torques_of(&sums.zt, &rates.z, torque(by_expected)),
            tt: torque(by_torque) + late * torque(by_rate) + square * torque(by_bend),
            count: sums.count,
        }
    };
    let columns = joint.columns.iter().copied().chain([place]).collect();
    JointSums { columns, stretches: joint.stretches.iter().zip(rates).map(of).collect() }
}

/// Rate of the model's torque, from the rows before and after where both are there, else zero: an instrument need not be
/// exact.
fn expected_rates(rows: &JointRows, x: &[f64], row_period_s: f64) -> Vec<f64> {
    let torque = rows.torque(x);
    let rate = |k: usize| {
        let whole = k > 0 && k + 1 < torque.len() && rows.place[k + 1] - rows.place[k - 1] == 2;
        if whole { (torque[k + 1] - torque[k - 1]) / (2.0 * row_period_s) } else { 0.0 }
    };
    (0..torque.len()).map(rate).collect()
}
