//! Torque that was computed along the desired motion and logged as if it had been measured.
//!
//! Bodies alone explain such a torque along the desired motion but for rounding: no friction, no noise. Along the measured motion, which
//! lags behind, they do not. Whatever is then fitted (elasticity, delay, friction) is the tracking error, and says nothing of the arm.

use std::fmt;

use nalgebra::{DMatrix, DVector, Matrix4, Vector4};
use rivet_dynamics::{Arm, LINK_PARAMETERS, Workspace, regressor};
use rivet_estimation::offline::Trajectory;

use crate::effects::physical_bounds;
use crate::model::run::{Motion, Run};
use crate::policy::POLICY;
use crate::screen::rigid_torque::range;

/// Both sides are averaged over stretches of this length \[s\], which keeps what is linear exact and takes noise away.
const AVERAGING_STRETCH_S: f64 = 0.05;
/// Stretches that are looked at, spread over the run.
const STRETCHES: usize = 200;
/// Stretches below which nothing is said.
const MIN_STRETCHES: usize = 30;
/// Directions weaker than this share of the strongest are rounding.
const BODY_DIRECTION_ROUNDING: f64 = 1e-7;

/// What bodies alone miss of a joint's torque, as a share of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Misses {
    /// Joint, from 0.
    pub(crate) joint: usize,
    /// Along the desired motion.
    pub(crate) desired: f64,
    /// Along the measured one.
    pub(crate) measured: f64,
}

/// Joints that move and whose torque was computed; empty unless bodies explain all of them, and where there is no desired motion.
pub(crate) fn joints(arm: &Arm, run: &Run) -> Vec<Misses> {
    let Some(desired) = &run.desired else { return Vec::new() };
    let stretch = (AVERAGING_STRETCH_S / run.period_s).round().max(1.0) as usize;
    let starts = starts(run.len(), stretch);
    if starts.len() < MIN_STRETCHES {
        return Vec::new();
    }
    let Trajectory { q, qd, qdd } = desired.clone();
    let motions = [Motion { period_s: run.period_s, q, qd, qdd }, Motion::from_run(run)];
    let moves = |j: &usize| {
        motions.iter().all(|m| m.qd[*j].iter().any(|v| v.abs() > POLICY.signal_faults.max_still_speed_rad_s))
    };
    let moving: Vec<usize> = (0..run.joints()).filter(moves).collect();
    let tau =
        |j: usize| DVector::from_iterator(starts.len(), starts.iter().map(|s| mean(&run.tau[j][*s..*s + stretch])));
    let rows = motions.map(|motion| averaged(arm, &motion, &starts, stretch));
    let found: Vec<Misses> = moving
        .into_iter()
        .map(|joint| {
            let [desired, measured] = [0, 1].map(|which| missed(&rows[which][joint], &tau(joint)));
            Misses { joint, desired, measured }
        })
        .collect();
    let late = |m: &Misses| {
        m.measured > POLICY.screening.min_measured_residual_share
            && is_late(&desired.q[m.joint], &run.q[m.joint], &starts, stretch)
    };
    if found.iter().all(|m| m.desired < POLICY.screening.max_computed_residual_share) && found.iter().any(late) {
        found
    } else {
        Vec::new()
    }
}

/// A body at the flange that the arm's file lacks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct FlangeBody {
    /// \[kg\]
    pub(crate) mass: f64,
    /// Centre of mass in the last link's frame \[m\].
    pub(crate) centre: [f64; 3],
    /// Share of the squares that the file's bodies miss which it takes.
    pub(crate) takes: f64,
}

impl fmt::Display for FlangeBody {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let FlangeBody { mass, centre: [x, y, z], takes } = self;
        write!(
            f,
            "carries {mass:.2} kg at the flange that the file lacks, centre at ({x:.3}, {y:.3}, {z:.3}) m in the last link's frame: \
             {:.0} % of the squared difference between the two",
            100.0 * takes
        )
    }
}

/// The body at the flange that is in the model by which the torque of these runs was computed and not in the file: mass and first
/// moment of the last link beside the file's bodies, along the desired motion. None where that is not most of what sets the two apart.
pub(crate) fn flange_body<'a>(arm: &Arm, runs: impl IntoIterator<Item = &'a Run>) -> Option<FlangeBody> {
    let n = arm.dof();
    let file = DVector::from_iterator(LINK_PARAMETERS * n, arm.links.iter().flatten().copied());
    let last = LINK_PARAMETERS * n - LINK_PARAMETERS;
    let (mut normal, mut moment, mut missed) = (Matrix4::zeros(), Vector4::zeros(), 0.0);
    for run in runs {
        let Some(Trajectory { q, qd, qdd }) = run.desired.clone() else { continue };
        let stretch = (AVERAGING_STRETCH_S / run.period_s).round().max(1.0) as usize;
        let starts = starts(run.len(), stretch);
        let motion = Motion { period_s: run.period_s, q, qd, qdd };
        for (j, rows) in averaged(arm, &motion, &starts, stretch).iter().enumerate() {
            let tau = DVector::from_iterator(starts.len(), starts.iter().map(|s| mean(&run.tau[j][*s..*s + stretch])));
            let unmodelled = tau - rows * &file;
            let y = rows.fixed_columns::<4>(last);
            normal += y.tr_mul(&y);
            moment += y.tr_mul(&unmodelled);
            missed += unmodelled.norm_squared();
        }
    }
    let x = normal.cholesky()?.solve(&moment);
    let body = FlangeBody { mass: x[0], centre: [1, 2, 3].map(|k| x[k] / x[0]), takes: x.dot(&moment) / missed };
    let possible = physical_bounds::of_payload(x.as_slice(), arm).is_none();
    (possible && body.takes >= POLICY.screening.min_flange_body_share).then_some(body)
}

/// Whether the joint follows otherwise than by noise: its error averaged over stretches is no smaller than it is from sample
/// to sample.
fn is_late(desired: &[f64], measured: &[f64], starts: &[usize], stretch: usize) -> bool {
    let error = |k: usize| measured[k] - desired[k];
    let (mut slow, mut all) = (0.0, 0.0);
    for start in starts {
        let stretch_samples = || *start..*start + stretch;
        slow += (stretch_samples().map(error).sum::<f64>() / stretch as f64).powi(2) * stretch as f64;
        all += stretch_samples().map(|k| error(k).powi(2)).sum::<f64>();
    }
    slow > POLICY.screening.min_slow_error_share * all
}

/// First samples of the stretches, the ends of the run left out.
fn starts(samples: usize, stretch: usize) -> Vec<usize> {
    let fit = (samples / stretch).saturating_sub(2);
    let count = fit.min(STRETCHES);
    (0..count).map(|k| stretch * (1 + k * fit / count)).collect()
}

/// Regressor of the links, `[joint]` with a row a stretch.
fn averaged(arm: &Arm, motion: &Motion, starts: &[usize], stretch: usize) -> Vec<DMatrix<f64>> {
    let n = motion.joints();
    let columns = LINK_PARAMETERS * n;
    let mut rows = vec![DMatrix::zeros(starts.len(), columns); n];
    let mut ws = Workspace::new(arm);
    let (mut q, mut qd, mut qdd, mut y) = (vec![0.0; n], vec![0.0; n], vec![0.0; n], vec![0.0; n * columns]);
    for (row, start) in starts.iter().enumerate() {
        for k in *start..start + stretch {
            motion.state(k, &mut q, &mut qd, &mut qdd);
            regressor(arm, &mut ws, &q, &qd, &qdd, &mut y);
            for (rows, y) in rows.iter_mut().zip(y.chunks_exact(columns)) {
                rows.row_mut(row).iter_mut().zip(y).for_each(|(sum, y)| *sum += y / stretch as f64);
            }
        }
    }
    rows
}

fn mean(x: &[f64]) -> f64 {
    x.iter().sum::<f64>() / x.len() as f64
}

/// What the columns miss of `tau` at best, as a share of it; 1 where that cannot be told.
fn missed(rows: &DMatrix<f64>, tau: &DVector<f64>) -> f64 {
    let torque = tau.norm();
    if torque == 0.0 || !torque.is_finite() || rows.iter().any(|y| !y.is_finite()) {
        return 1.0;
    }
    let Some(range) = range(rows, BODY_DIRECTION_ROUNDING) else { return 1.0 };
    let residual = tau - &range * range.tr_mul(tau);
    let rank = range.ncols();
    let free = tau.len().saturating_sub(rank);
    if 2 * free < tau.len() {
        return 1.0;
    }
    // Rows that the columns take up say nothing.
    residual.norm() / torque * (tau.len() as f64 / free as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use rivet_dynamics::inverse_dynamics;

    use super::*;

    const PERIOD_S: f64 = 2e-3;
    const SAMPLES: usize = 6000;

    /// Bodies of an arm along a motion that begins `late` seconds late, and their torque.
    fn along(late: f64) -> (Arm, Trajectory, Vec<Vec<f64>>) {
        let text = include_str!("../../../../robots/manutec-r3/robot.urdf");
        let arm = Arm::from_urdf(text, [0.0, 0.0, -9.81]).expect("a sound arm");
        let n = arm.dof();
        let wave = |order: usize| -> Vec<Vec<f64>> {
            let of = |j: usize, k: usize| {
                let t = PERIOD_S * k as f64 - late;
                let parts = [(0.6, 1.1 + 0.2 * j as f64), (0.3, 2.9 - 0.3 * j as f64), (0.1, 5.3 + 0.1 * j as f64)];
                let part = |(size, w): (f64, f64)| match order {
                    0 => size * (w * t + j as f64).sin(),
                    1 => size * w * (w * t + j as f64).cos(),
                    _ => -size * w * w * (w * t + j as f64).sin(),
                };
                parts.into_iter().map(part).sum::<f64>()
            };
            (0..n).map(|j| (0..SAMPLES).map(|k| of(j, k)).collect()).collect()
        };
        let (q, qd, qdd) = (wave(0), wave(1), wave(2));
        let mut ws = Workspace::new(&arm);
        let mut tau = vec![vec![0.0; SAMPLES]; n];
        for k in 0..SAMPLES {
            let at = |x: &Vec<Vec<f64>>| x.iter().map(|x| x[k]).collect::<Vec<f64>>();
            let mut now = vec![0.0; n];
            inverse_dynamics(&arm, &arm.links, &mut ws, &at(&q), &at(&qd), &at(&qdd), &mut now);
            tau.iter_mut().zip(now).for_each(|(tau, now)| tau[k] = now);
        }
        (arm, Trajectory { q, qd, qdd }, tau)
    }

    fn run(desired: &Trajectory, measured: &Trajectory, tau: Vec<Vec<f64>>) -> Run {
        Run {
            name: "r".into(),
            period_s: PERIOD_S,
            q: measured.q.clone(),
            tau,
            desired: Some(desired.clone()),
            ..Run::default()
        }
    }

    #[test]
    fn a_torque_of_the_desired_motion_is_told_from_one_of_the_measured() {
        let (arm, desired, computed) = along(0.0);
        let (_, measured, felt) = along(0.04);
        let found = joints(&arm, &run(&desired, &measured, computed.clone()));
        assert_eq!(found.len(), arm.dof());
        assert!(found.iter().all(|m| m.desired < 1e-6 && m.measured > m.desired), "{found:?}");
        assert!(joints(&arm, &run(&desired, &measured, felt)).is_empty(), "torque of the motion that there was");
        assert!(
            joints(&arm, &run(&desired, &desired, computed.clone())).is_empty(),
            "tracked without error: who can tell?"
        );
        let mut noisy = desired.clone();
        let mut shake = 1u32;
        for q in noisy.q.iter_mut().flatten() {
            shake = shake.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            *q += 3e-3 * (f64::from(shake) / f64::from(u32::MAX) - 0.5);
        }
        assert!(
            joints(&arm, &run(&desired, &noisy, computed.clone())).is_empty(),
            "what differs is noise of the encoders"
        );
        let mut with_friction = computed;
        for (tau, qd) in with_friction.iter_mut().zip(&measured.qd) {
            let size = 0.02 * tau.iter().fold(0.0_f64, |m, t| m.max(t.abs()));
            tau.iter_mut().zip(qd).for_each(|(t, v)| *t += size * v.signum());
        }
        assert!(joints(&arm, &run(&desired, &measured, with_friction)).is_empty(), "friction is measured");
    }

    #[test]
    fn a_body_in_the_model_that_computed_the_torque_is_weighed() {
        let (arm, desired, computed) = along(0.0);
        let mut lacking = arm.clone();
        let last = lacking.links.last_mut().expect("a link");
        let (mass, centre) = (0.3, [0.02, -0.01, 0.1]);
        last[0] -= mass;
        (0..3).for_each(|k| last[1 + k] -= mass * centre[k]);
        let run = run(&desired, &desired, computed);
        let found = flange_body(&lacking, [&run]).expect("a body");
        assert!((found.mass - mass).abs() < 1e-6 && found.takes > 0.999, "{found:?}");
        assert!((0..3).all(|k| (found.centre[k] - centre[k]).abs() < 1e-6), "{found:?}");
        // Another link that is heavier is no body at the flange.
        let mut other = arm.clone();
        other.links[1][1] -= 2.0;
        assert_eq!(flange_body(&other, [&run]), None);
    }

    #[test]
    fn a_short_run_and_one_without_desired_motion_say_nothing() {
        let (arm, desired, tau) = along(0.0);
        let (_, measured, _) = along(0.04);
        let cut = |x: &[Vec<f64>]| x.iter().map(|x| x[..700].to_vec()).collect::<Vec<_>>();
        let short = |t: &Trajectory| Trajectory { q: cut(&t.q), qd: cut(&t.qd), qdd: cut(&t.qdd) };
        assert!(joints(&arm, &run(&short(&desired), &short(&measured), cut(&tau))).is_empty());
        assert!(joints(&arm, &Run { desired: None, ..run(&desired, &measured, tau) }).is_empty());
    }
}
