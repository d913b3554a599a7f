//! Whether a desired motion is one that the arm followed: a channel that was not recorded is no instrument.

use rayon::prelude::*;

use super::lag::lag;
use super::record::Trajectory;
use crate::plan::is_broken;

/// A joint moves from this standard deviation of its position on \[rad\]: less is sag and noise of a joint that stands.
const MIN_MOVING_STD_RAD: f64 = 0.01;
/// The arm does not follow where the tracking error, less its mean and the tracking lag, is beyond this share of the motion,
/// both as standard deviations. Without a plan it is 1; a loop that follows leaves some percent.
const FOLLOWS: f64 = 0.5;

/// The joints (from 0) that move and do not follow the desired motion: it was not recorded, or is that of something else.
#[must_use]
pub fn unfollowed(measured: &Trajectory, desired: &Trajectory, period_s: f64) -> Vec<usize> {
    let joints = measured.q.len().min(desired.q.len());
    let strays = |j: &usize| {
        let (q, plan) = (&measured.q[*j], &desired.q[*j]);
        if q.len() != plan.len() || deviation(q.iter().copied()) < MIN_MOVING_STD_RAD {
            return false;
        }
        let late = (lag(&measured.qd[*j], &desired.qd[*j], period_s).seconds / period_s).round() as isize;
        let beyond = |samples: isize| samples.max(0).cast_unsigned().min(q.len());
        let (q, plan) = (&q[beyond(late)..], &plan[beyond(-late)..]);
        let error = deviation(q.iter().zip(plan).map(|(q, plan)| q - plan));
        error > FOLLOWS * deviation(q.iter().copied())
    };
    (0..joints).into_par_iter().filter(strays).collect()
}

/// The joints (from 0) whose desired velocities or accelerations are not those of their desired positions: a planner left them 0, say.
/// Positions, velocities and accelerations are `[joint][sample]` \[rad, rad/s, rad/s²\].
#[must_use]
pub fn underived([q, qd, qdd]: [&[Vec<f64>]; 3], period_s: f64) -> Vec<usize> {
    let joints = q.len().min(qd.len()).min(qdd.len());
    (0..joints).into_par_iter().filter(|j| is_broken([&q[*j], &qd[*j], &qdd[*j]], period_s)).collect()
}

fn deviation(x: impl Iterator<Item = f64> + Clone) -> f64 {
    let count = x.clone().count().max(1) as f64;
    let mean = x.clone().sum::<f64>() / count;
    (x.map(|x| (x - mean).powi(2)).sum::<f64>() / count).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: f64 = 0.01;

    /// A joint that moves, one that sags under it, one that moves with a constant lag of 0.2 s and an offset.
    fn motion() -> (Vec<Vec<f64>>, Vec<Vec<f64>>) {
        let wave = |t: f64| 0.5 * (1.3 * t).sin() + 0.3 * (3.1 * t).cos();
        let sampled = |f: &dyn Fn(f64) -> f64| -> Vec<f64> { (0..3000).map(|k| f(f64::from(k) * PERIOD)).collect() };
        let q = vec![sampled(&wave), sampled(&|t| 0.004 * wave(t)), sampled(&|t| wave(t - 0.2))];
        let plan = vec![sampled(&wave), sampled(&|_| 0.0), sampled(&|t| 0.1 + wave(t))];
        (q, plan)
    }

    fn found(q: &[Vec<f64>], plan: &[Vec<f64>]) -> Vec<usize> {
        unfollowed(&Trajectory::from_positions(q, PERIOD), &Trajectory::from_positions(plan, PERIOD), PERIOD)
    }

    #[test]
    fn sag_lag_and_offset_are_no_reason() {
        let (q, plan) = motion();
        assert_eq!(found(&q, &plan), []);
    }

    #[test]
    fn a_plan_that_was_not_recorded_is_found() {
        let (q, mut plan) = motion();
        plan[0].fill(0.0);
        // Of another joint.
        plan[2] = (0..3000).map(|k| (2.2 * f64::from(k) * PERIOD).sin()).collect();
        assert_eq!(found(&q, &plan), [0, 2]);
    }
}
