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
//! The first order holds for a fraction of a period of the motion only. So all delays of a wide range are looked at first
//! ([`shifts`](super::shifts)); from the best of them the torque is taken back by what is found, to second order, and the
//! rest is fitted again. Where the data do not single out one delay, none is given.

use nalgebra::DVector;
use rayon::prelude::*;

use super::fit::{Fit, Method, Solution};
use super::record::OfflineError;
use super::rows::JointRows;
use super::shifts::{REACH_S, STEP_S, search};
use super::sums::{Equations, JointSums, Normal, Stretch};
use crate::linear::axpy;

/// How often the torque is taken back and the rest fitted, and how often at most it is taken back anew from where that led.
const DELAY_ROUNDS: usize = 3;
const STARTS: usize = 3;
/// Beyond this the second order is no longer exact enough \[s\].
const NEAR_S: f64 = STEP_S;
/// Instruments and least squares differ by no more than this \[s\], or by this many standard deviations.
const APART_S: f64 = 1.5 * STEP_S;
const APART_STD: f64 = 3.0;
/// A motion shorter than this says of no delay whether it is one: a few moves leave the model as free as the delay, and what sets them
/// apart is not in the deviation \[s\]. Sound simulated logs of 3 s read 36 +- 5 ms.
const LEAST_MOTION_S: f64 = 4.0;
/// A delay less certain than this (one standard deviation) is as good as unknown \[s\].
const LEAST_CERTAIN_S: f64 = 0.03;

/// How late a joint's torque is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Delay {
    /// Torque behind position \[s\]; negative where the torque is ahead. With a doubt, no more than where it began.
    pub seconds: f64,
    /// Its standard deviation \[s\].
    pub std: f64,
    /// Why `seconds` is not to be used.
    pub doubt: Option<DelayDoubt>,
}

/// Why the data give no delay.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum DelayDoubt {
    /// The best is at the end of what was looked at.
    #[error("beyond {:.0} ms", 1e3 * REACH_S)]
    OutOfReach,
    /// Two delays explain the torque about as well.
    #[error("{:.0} or {:.0} ms", 1e3 * either_s, 1e3 * or_s)]
    Two {
        /// The better one \[s\].
        either_s: f64,
        /// The other \[s\].
        or_s: f64,
    },
    /// Too short a motion: a delay and the model are not told apart.
    #[error("too short a motion")]
    Short,
    /// No delay explains the torque clearly better than another, or its standard deviation is too large.
    #[error("not told by this motion")]
    NotTold,
}

/// Estimates the delay of every joint's torque together with the parameters, from 0.12 s ahead to 0.12 s behind.
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
    if equations.rows.iter().map(|rows| rows.kept as f64 * rows.row_period_s).sum::<f64>() < LEAST_MOTION_S {
        return Ok(vec![Delay { seconds: 0.0, std: f64::INFINITY, doubt: Some(DelayDoubt::Short) }; n]);
    }
    let coarse = search(equations, found, &DVector::from_column_slice(nominal), prior)?;
    // Next to no delay is what is expected: exactly 0 would be a value that nobody gave.
    let none = std::iter::repeat_n(f64::MIN_POSITIVE, n);
    let start = DVector::from_iterator(k + n, nominal.iter().copied().chain(none));
    let (weights, mut late) = (&coarse.weights, coarse.late_s.clone());
    let sums = equations.trusting(&found.trust);
    let rates_at = |j: usize, late_s: f64| rates(equations, j, &coarse.values, late_s, found.trust[j]);
    let mut rates: Vec<Vec<Rates>> = (0..n).into_par_iter().map(|j| rates_at(j, late[j])).collect();
    let (mut more, mut std) = (vec![0.0_f64; n], vec![0.0; n]);
    for begun in 1..=STARTS {
        for round in 1..=DELAY_ROUNDS {
            let widened = |j: usize| {
                let joint = widen(&sums[j], &rates[j], k + j, more[j]);
                let normal = Normal::new(&joint, k + n, Method::Instrumental);
                (joint, normal)
            };
            let (joints, normals): (Vec<JointSums>, Vec<Normal>) = (0..n).into_par_iter().map(widened).unzip();
            let solution = Solution::new(&normals, weights, &start, (prior, equations.most()), Method::Instrumental)?;
            let next = |(j, more): (usize, &mut f64)| *more = (*more + solution.x[k + j]).clamp(-APART_S, APART_S);
            more.iter_mut().enumerate().for_each(next);
            if round == DELAY_ROUNDS {
                let covariance = solution.long_run_covariance(&joints, weights, Method::Instrumental);
                std.copy_from_slice(&solution.certainty(&covariance).0[k..]);
            }
        }
        let far: Vec<usize> = (0..n).filter(|j| more[*j].abs() > NEAR_S).collect();
        if far.is_empty() || begun == STARTS {
            break;
        }
        for j in far {
            late[j] += std::mem::take(&mut more[j]);
            rates[j] = rates_at(j, late[j]);
        }
    }
    let delay_of_joint = |j: usize| {
        let seconds = late[j] + more[j];
        let apart = (seconds - coarse.late_s[j]).abs();
        // Whatever is not a number is no delay either.
        let is_identified =
            std[j] < LEAST_CERTAIN_S && apart < APART_S.max(APART_STD * std[j]) && more[j].abs() < APART_S;
        Delay { seconds, std: std[j], doubt: coarse.doubt[j].or((!is_identified).then_some(DelayDoubt::NotTold)) }
    };
    Ok((0..n).map(delay_of_joint).collect())
}

/// Products of a stretch's rows with τ, r = τ̇, b = τ̈ and the instrument e; the first three as long after the row as the
/// search found.
struct Rates {
    d: [Vec<f64>; 4],
    z: [Vec<f64>; 4],
    /// Products of τ, r, b and e with each other.
    own: [[f64; 4]; 4],
}

/// Sums with the torque of joint `j` so late \[s\] and its rates, stretch by stretch, rows beside a stop counting `trust`.
fn rates(equations: &Equations<'_>, j: usize, x: &[f64], late_s: f64, trust: f64) -> Vec<Rates> {
    let mut found = Vec::new();
    let width = equations.joints[j].columns.len();
    let zeros = || [(); 4].map(|()| vec![0.0; width]);
    for record in equations.rows {
        let joint = &record.joints[j];
        let modelled = joint.torque(x);
        let expected = expected_rates(joint, &modelled, record.row_period_s);
        for range in equations.ranges(record, j) {
            let mut sums = Rates { d: zeros(), z: zeros(), own: [[0.0; 4]; 4] };
            for row in range {
                // Where the record has no such torque, what is expected says nothing new.
                let torque = record.torque_after(j, joint.place[row], late_s);
                let [torque, rate, bend] = torque.unwrap_or([modelled[row], expected[row], 0.0]);
                let all = [torque, rate, bend, expected[row]];
                let (at, counts) = (row * width..(row + 1) * width, joint.weight(row, trust));
                for (k, value) in all.iter().enumerate() {
                    axpy(counts * value, &joint.d[at.clone()], &mut sums.d[k]);
                    axpy(counts * value, &joint.z[at.clone()], &mut sums.z[k]);
                }
                for (own, a) in sums.own.iter_mut().zip(all) {
                    own.iter_mut().zip(all).for_each(|(sum, b)| *sum += counts * a * b);
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
    let rates_of = |[_, r, b, _]: &[Vec<f64>; 4]| -> Vec<f64> { r.iter().zip(b).map(|(r, b)| r + late * b).collect() };
    let torques_of = |[t, r, b, _]: &[Vec<f64>; 4], added: f64| -> Vec<f64> {
        let model_products = t.iter().zip(r).zip(b).map(|((t, r), b)| t + late * r + square * b);
        model_products.chain([-added]).collect()
    };
    let bordered = |m: &[f64], right: &[f64], below: &[f64], corner: f64| -> Vec<f64> {
        let row = |i: usize| m[i * n..(i + 1) * n].iter().copied().chain([-right[i]]);
        (0..n).flat_map(row).chain(below.iter().map(|x| -x)).chain([corner]).collect()
    };
    let widened = |(sums, rates): (&Stretch, &Rates)| {
        let (dr, zr) = (rates_of(&rates.d), rates_of(&rates.z));
        let [by_torque, by_rate, by_bend, by_expected] = &rates.own;
        Stretch {
            dd: bordered(&sums.dd, &dr, &dr, rate(by_rate) + late * rate(by_bend)),
            zd: bordered(&sums.zd, &zr, &rates.d[3], rate(by_expected)),
            zz: bordered(&sums.zz, &rates.z[3], &rates.z[3], by_expected[3]),
            dt: torques_of(&rates.d, torque(by_rate) + late * torque(by_bend)),
            zt: torques_of(&rates.z, torque(by_expected)),
            tt: torque(by_torque) + late * torque(by_rate) + square * torque(by_bend),
            count: sums.count,
        }
    };
    let columns = joint.columns.iter().copied().chain([place]).collect();
    JointSums { columns, stretches: joint.stretches.iter().zip(rates).map(widened).collect() }
}

/// Rate of the model's torque, from the rows before and after where both are there, else zero: an instrument need not be
/// exact.
fn expected_rates(rows: &JointRows, torque: &[f64], row_period_s: f64) -> Vec<f64> {
    let rate = |k: usize| {
        let whole = k > 0 && k + 1 < torque.len() && rows.place[k + 1] - rows.place[k - 1] == 2;
        if whole { (torque[k + 1] - torque[k - 1]) / (2.0 * row_period_s) } else { 0.0 }
    };
    (0..torque.len()).map(rate).collect()
}
