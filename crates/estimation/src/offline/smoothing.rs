//! Cut-off of predicted torque: as high as noise of positions permits.
//!
//! Dry friction changes sign within milliseconds, so its torque has harmonics far above the motion and the model filter. A low-pass takes
//! them out together with the noise of accelerations. Positions have white noise of standard deviation σ_j, samples T apart. With the mass
//! matrix M, the torque of joint i has below the frequency f noise of the variance
//!
//! ```text
//! σ_τi² = Σ_j M_ij²·σ_j² · 2·T·(2π)⁴·f⁵/5
//! ```
//!
//! The cut-off of a joint is where this is a share of its torque. The sign of dry friction needs speeds that are good to a share of the speed
//! over which it changes, which bounds the cut-off as well ([`told_up_to_hz`]).

use std::f64::consts::TAU;

use rayon::prelude::*;
use rivet_dynamics::{BaseSet, Model};

use super::record::{OfflineError, Trajectory, unfiltered_torque};
use super::steps::told_up_to_hz;
use super::zero_phase::ZeroPhase;

/// Noise of predicted torque over the torque of the joint, both root mean square. Squares add: with this share an error of 4 % of the torque
/// becomes 4.1 %.
const MAX_NOISE_OVER_TORQUE: f64 = 0.01;
/// Poses of a record at which the mass matrix is evaluated.
const POSES: usize = 20;

/// How a prediction is smoothed.
#[derive(Clone, Debug, PartialEq)]
pub struct Smoothing {
    /// Lowest cut-off \[Hz\], whatever the noise is.
    pub lowest_hz: f64,
    /// Order of one pass of the filter, even.
    pub order: usize,
    /// Time between samples \[s\].
    pub period_s: f64,
    /// Standard deviation of white noise of positions \[rad\], per joint.
    pub position_noise: Vec<f64>,
}

/// Torque of the model with base parameters `x` along a motion \[N m\], `[joint][sample]`, instant effects included. Each joint's torque is
/// low-passed at the highest frequency below which noise of positions makes at most a hundredth of it.
///
/// # Errors
/// [`OfflineError::Shape`] where `motion`, `x` or the noise are not of the model's size.
pub fn predict_smoothed(
    model: &Model,
    base: &BaseSet,
    x: &[f64],
    motion: &Trajectory,
    smoothing: &Smoothing,
) -> Result<Vec<Vec<f64>>, OfflineError> {
    let (n, known) = (model.arm.dof(), smoothing.position_noise.len());
    if known != n {
        return Err(OfflineError::Shape { what: "noise of positions", found: known, expected: n });
    }
    let tau = unfiltered_torque(model, base, x, motion)?;
    let lowest = smoothing.filter(smoothing.lowest_hz);
    let noise = inertia_noise(model, base, x, motion, &smoothing.position_noise)?;
    let smooth = |(j, unfiltered): (usize, Vec<f64>)| {
        let mut tau = unfiltered.clone();
        lowest.apply(&mut tau);
        let rms = (tau.iter().map(|tau| tau * tau).sum::<f64>() / tau.len().max(1) as f64).sqrt();
        let cutoff_hz = smoothing.cutoff_hz(j, rms, noise[j], model.structure.sign_velocity);
        if cutoff_hz > smoothing.lowest_hz {
            tau = unfiltered;
            smoothing.filter(cutoff_hz).apply(&mut tau);
        }
        tau
    };
    Ok(tau.into_par_iter().enumerate().map(smooth).collect())
}

impl Smoothing {
    fn filter(&self, cutoff_hz: f64) -> ZeroPhase {
        ZeroPhase::new(cutoff_hz, self.order, self.period_s)
    }

    /// Cut-off of joint `joint` \[Hz\]; infinite without noise.
    ///
    /// * `torque`: root mean square of its torque \[N m\]
    /// * `noise`: of the same \[kg m²·rad\], as [`inertia_noise`] returns it
    /// * `sign_velocity`: speed over which dry friction changes sign \[rad/s\]
    fn cutoff_hz(&self, joint: usize, torque: f64, noise: f64, sign_velocity: f64) -> f64 {
        let most = (MAX_NOISE_OVER_TORQUE * torque).powi(2);
        let by_acceleration = (5.0 * most / (2.0 * self.period_s * noise.powi(2) * TAU.powi(4))).powf(0.2);
        let by_sign = if sign_velocity > 0.0 {
            told_up_to_hz(self.position_noise[joint], self.period_s, sign_velocity)
        } else {
            f64::INFINITY
        };
        // No noise and no torque: NaN, which min and max leave out.
        by_acceleration.min(by_sign).max(self.lowest_hz)
    }
}

/// `sqrt(Σ_j M_ij²·σ_j²)` of each joint i, root mean square over poses of the motion.
///
/// * `noise`: σ_j \[rad\]
fn inertia_noise(
    model: &Model,
    base: &BaseSet,
    x: &[f64],
    motion: &Trajectory,
    noise: &[f64],
) -> Result<Vec<f64>, OfflineError> {
    let (n, rows) = (model.arm.dof(), motion.len());
    // Each pose at rest: without acceleration, and with one of each joint alone. The difference is a column of the mass matrix.
    let poses: Vec<usize> = (0..POSES.min(rows)).map(|k| k * rows / POSES.min(rows)).collect();
    let samples = poses.len() * (n + 1);
    let q = motion.q.iter().map(|q| poses.iter().flat_map(|k| vec![q[*k]; n + 1]).collect()).collect();
    let unit = |j: usize| (0..samples).map(|s| f64::from(u8::from(s % (n + 1) == j + 1))).collect();
    let at_rest = Trajectory { q, qd: vec![vec![0.0; samples]; n], qdd: (0..n).map(unit).collect() };
    let of_joint = |tau: Vec<f64>| {
        let square = |pose: &[f64]| -> f64 {
            pose[1..].iter().zip(noise).map(|(tau, noise)| ((tau - pose[0]) * noise).powi(2)).sum()
        };
        (tau.chunks_exact(n + 1).map(square).sum::<f64>() / poses.len().max(1) as f64).sqrt()
    };
    Ok(unfiltered_torque(model, base, x, &at_rest)?.into_iter().map(of_joint).collect())
}
