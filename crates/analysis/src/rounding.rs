//! What the steps of a torque signal may do to identified values, where no noise blurs them.
//!
//! Errors of rounding then follow the motion and come again with it: no residual tells them from the arm, and stretches of a log that
//! repeat agree with each other. How large they are is known all the same. Torques that differ by less than a step along the motion, the
//! one that the values found make among them, are rounded, and what their errors do to the values is what those of the log may have done.

use std::f64::consts::PI;
use std::path::PathBuf;

use anyhow::Result;
use rayon::prelude::*;
use rivet_config::{Identified, Robot};
use rivet_dynamics::Parameter;
use rivet_logs::Log;

use crate::coarse::TorqueSteps;
use crate::fit::values_of;
use crate::rows::rows_of;
use crate::{predict, runs};

/// Torques that are tried.
const TRIES: usize = 12;
/// In what they differ, beside a constant: a drive has each of these on every joint. What they make is of the size of a step whatever the
/// values found, which have taken up errors already: friction of three steps exactly may be one of two and a half.
const SHAPES: [fn(&Parameter) -> bool; 3] = [
    |p| matches!(p, Parameter::Coulomb(_)),
    |p| matches!(p, Parameter::Viscous(_)),
    |p| matches!(p, Parameter::RotorInertia(_)),
];
/// Powers of one over the root of x⁵ = x + 1: multiples of them, without their whole parts, fill four dimensions evenly (Roberts).
const EVENLY: [f64; 4] = [0.856_674_883_854_502_9, 0.733_891_856_627_126, 0.628_706_721_037_808, 0.538_597_256_966_679];
/// The same for joints, of which no two round alike.
const JOINTS: f64 = 0.754_877_666_246_693;

/// How far values (those found, base order) move with torque that is rounded once more: one vector for each try; none without steps.
///
/// # Errors
/// A log that cannot be read again.
pub(crate) fn moved(robot: &Robot, paths: &[PathBuf], steps: &[&TorqueSteps], values: &[f64]) -> Result<Vec<Vec<f64>>> {
    if steps.is_empty() {
        return Ok(Vec::new());
    }
    let mut logs: Vec<Rounded> = Vec::new();
    for path in paths {
        logs.push(Rounded::new(robot, runs::read_log(robot, path)?, steps, values)?);
    }
    let of_try = |k: usize| {
        let mut rows = Vec::new();
        for log in &logs {
            rows.extend(rows_of(robot, &log.rounded(k))?.rows);
        }
        let other = values_of(robot, &mut rows)?;
        Ok(other.iter().zip(values).map(|(other, value)| other - value).collect())
    };
    (0..TRIES).into_par_iter().map(of_try).collect()
}

/// A log, and the torques that are rounded.
struct Rounded {
    log: Log,
    joints: Vec<Joint>,
}

/// One joint whose torque comes in steps.
struct Joint {
    steps: TorqueSteps,
    /// What the values found make \[N·m\].
    torque: Vec<f64>,
    /// What a drive may make beside, each scaled to rms 1.
    shapes: Vec<Vec<f64>>,
}

impl Rounded {
    fn new(robot: &Robot, log: Log, steps: &[&TorqueSteps], values: &[f64]) -> Result<Rounded> {
        let along = |values: Vec<f64>| {
            let std = vec![0.0; values.len()];
            predict::along(&Robot { identified: Some(Identified { values, std }), ..robot.clone() }, &log)
        };
        let torque = along(values.to_vec())?;
        let torque_with = |has: &fn(&Parameter) -> bool| {
            let more = robot.base.independent.iter().map(|c| if has(&robot.model.parameters[*c]) { 1.0 } else { 0.0 });
            along(values.iter().zip(more).map(|(value, more)| value + more).collect())
        };
        let more: Vec<Vec<Vec<f64>>> = SHAPES.iter().map(torque_with).collect::<Result<_>>()?;
        let joint = |steps: &&TorqueSteps| {
            let shape = |more: &Vec<Vec<f64>>| scaled(more[steps.joint].iter().zip(&torque[steps.joint]));
            let (shapes, torque) = (more.iter().map(shape).collect(), torque[steps.joint].clone());
            Joint { steps: (*steps).clone(), torque, shapes }
        };
        let joints = steps.iter().filter(|s| s.path == log.path).map(joint).collect();
        Ok(Rounded { log, joints })
    }

    /// The log with errors of rounding the `k`-th torque added to its own.
    fn rounded(&self, k: usize) -> Log {
        let mut log = self.log.clone();
        if let Some((_, tau)) = &mut log.tau {
            for joint in &self.joints {
                tau[joint.steps.joint].iter_mut().zip(joint.errors(k)).for_each(|(tau, more)| *tau += more);
            }
        }
        log
    }
}

/// Differences, of rms 1 unless they are none.
fn scaled<'a>(pairs: impl Iterator<Item = (&'a f64, &'a f64)>) -> Vec<f64> {
    let by: Vec<f64> = pairs.map(|(more, torque)| more - torque).collect();
    let rms = (by.iter().map(|x| x * x).sum::<f64>() / by.len().max(1) as f64).sqrt();
    by.into_iter().map(|x| if rms > 0.0 { x / rms } else { 0.0 }).collect()
}

impl Joint {
    /// Errors of rounding the `k`-th torque \[N·m\].
    fn errors(&self, k: usize) -> impl Iterator<Item = f64> + '_ {
        let TorqueSteps { joint, step, noise, .. } = self.steps;
        let part = move |d: usize| ((k as f64 + 1.0) * EVENLY[d] + joint as f64 * JOINTS).fract() - 0.5;
        // Noise takes so much of the mean error's first harmonic.
        let mean_error_share = (-2.0 * (PI * noise / step).powi(2)).exp();
        self.torque.iter().enumerate().map(move |(row, torque)| {
            let shapes: f64 = self.shapes.iter().enumerate().map(|(d, shape)| part(d + 1) * shape[row]).sum();
            let at = torque / step + part(0) + shapes;
            mean_error_share * step * (at.round() - at)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn joint(noise: f64, torque: Vec<f64>, shapes: Vec<Vec<f64>>) -> Joint {
        Joint { steps: TorqueSteps { path: PathBuf::new(), joint: 0, step: 2.0, noise }, torque, shapes }
    }

    fn rms(of: &[f64]) -> f64 {
        (of.iter().map(|e| e * e).sum::<f64>() / of.len() as f64).sqrt()
    }

    /// Uniform within half a step; noise of half a step leaves next to nothing of it.
    #[test]
    fn rounding_errs_by_half_a_step_at_most() {
        let torque: Vec<f64> = (0..4000).map(|k| 0.01 * f64::from(k)).collect();
        let of = |noise: f64, k: usize| joint(noise, torque.clone(), Vec::new()).errors(k).collect::<Vec<f64>>();
        for k in 0..TRIES {
            assert!(of(0.0, k).iter().all(|e| e.abs() <= 1.0 + 1e-12));
            assert!((rms(&of(0.0, k)) - 2.0 / 12.0_f64.sqrt()).abs() < 2e-3);
            assert!(rms(&of(1.0, k)) < 0.01);
        }
    }

    /// Friction that is three steps by what it was rounded to may be off to either side, by as much as rounding is.
    #[test]
    fn friction_of_whole_steps_is_no_surer_than_any() {
        let turns: Vec<f64> = (0..400).map(|k| if k % 40 < 20 { 1.0 } else { -1.0 }).collect();
        let torque: Vec<f64> = turns.iter().map(|t| 6.0 * t).collect();
        let found = joint(0.0, torque, vec![turns.clone()]);
        let coulomb = |k: usize| found.errors(k).zip(&turns).map(|(e, t)| e * t).sum::<f64>() / 400.0;
        let of: Vec<f64> = (0..TRIES).map(coulomb).collect();
        assert!(rms(&of) > 0.2 && of.iter().all(|c| c.abs() <= 1.0), "{of:?}");
        assert!(of.iter().any(|c| *c > 0.1) && of.iter().any(|c| *c < -0.1), "{of:?}");
    }
}
