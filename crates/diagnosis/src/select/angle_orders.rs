//! Orders of the joint's angle that stand out in the residual's spectrum.

use std::f64::consts::TAU;

use crate::effects::physics::Physics;
use crate::numerics::parallel;
use crate::policy::POLICY;

/// Orders kept for each joint: of all rows, and of those that are slow enough for the order.
const KEPT: [usize; 2] = [3, 2];
/// Faster than this \[rad/s\] the phase of what a gear does is no longer that of its order: it resonates.
const FASTEST: f64 = 2.0 * TAU * 10.0;
/// Samples whose phasors turn side by side.
const LANES: usize = 8;

/// For each joint the orders with the largest amplitude in the full-rate residual.
pub(crate) fn find(physics: &[Physics<'_>]) -> Vec<Vec<f64>> {
    let joints: Vec<usize> = (0..physics.first().map_or(0, Physics::joints)).collect();
    parallel::map(&joints, |j| on(physics, *j, None))
}

/// The same of one joint, with torque added to the measured one: `added[run][joint]`.
pub(crate) fn on(physics: &[Physics<'_>], j: usize, added: Option<&[Vec<Vec<f64>>]>) -> Vec<f64> {
    let range = physics.iter().map(|p| span(&p.motion.q[j])).fold(0.0, f64::max);
    if range < 0.05 {
        return Vec::new();
    }
    let step = 0.2 * TAU / range;
    let count = ((POLICY.plausibility.max_order - POLICY.plausibility.min_order) / step).ceil().max(1.0) as usize;
    let mut power = [vec![[0.0; 2]; count], vec![[0.0; 2]; count]];
    let mut total = [vec![0.0; count], vec![0.0; count]];
    for (i, p) in physics.iter().enumerate() {
        let (q, qd) = (&p.motion.q[j], &p.motion.qd[j]);
        for power in &mut power {
            power.fill([0.0; 2]);
        }
        let thin = (0.001 / p.period_s()).round().max(1.0) as usize;
        let moving: Vec<usize> = (0..p.samples()).step_by(thin).filter(|k| qd[*k].abs() >= 0.01).collect();
        for some in moving.chunks(LANES) {
            let mut r = [0.0; LANES];
            let (mut s, mut c) = ([0.0; LANES], [0.0; LANES]);
            let (mut ds, mut dc) = ([0.0; LANES], [0.0; LANES]);
            let mut speed = 0.01_f64;
            for (lane, k) in some.iter().enumerate() {
                r[lane] = p.run.tau[j][*k] - p.torque[j][*k] + added.map_or(0.0, |a| a[i][j][*k]);
                (s[lane], c[lane]) = (POLICY.plausibility.min_order * q[*k]).sin_cos();
                (ds[lane], dc[lane]) = (step * q[*k]).sin_cos();
                speed = speed.max(qd[*k].abs());
            }
            let slow = (((FASTEST / speed - POLICY.plausibility.min_order) / step).max(0.0) as usize).min(count);
            // Phasors turned by one step of the order each time.
            for i in 0..count {
                let (mut along, mut across) = (0.0, 0.0);
                for lane in 0..LANES {
                    along += r[lane] * c[lane];
                    across += r[lane] * s[lane];
                    let turned = s[lane] * dc[lane] + c[lane] * ds[lane];
                    c[lane] = c[lane] * dc[lane] - s[lane] * ds[lane];
                    s[lane] = turned;
                }
                for power in &mut power[..=usize::from(i < slow)] {
                    power[i][0] += along;
                    power[i][1] += across;
                }
            }
        }
        for (total, power) in total.iter_mut().zip(&power) {
            total.iter_mut().zip(power).for_each(|(t, p)| *t += p[0] * p[0] + p[1] * p[1]);
        }
    }
    let [all, slow] = [0, 1].map(|at| peaks(&total[at], KEPT[at], step));
    let more: Vec<f64> = slow.into_iter().filter(|order| all.iter().all(|o| (o - order).abs() > step)).collect();
    all.into_iter().chain(more).collect()
}

/// Orders of the highest peaks.
fn peaks(total: &[f64], kept: usize, step: f64) -> Vec<f64> {
    let count = total.len();
    let mut peaks: Vec<usize> =
        (1..count.saturating_sub(1)).filter(|i| total[*i] >= total[i - 1] && total[*i] > total[i + 1]).collect();
    // Against the spectrum around it: low orders are large in any residual.
    let local = |i: usize| {
        let around = &total[i.saturating_sub(20)..(i + 21).min(count)];
        let mut sorted = around.to_vec();
        sorted.sort_by(f64::total_cmp);
        total[i] / sorted[sorted.len() / 2].max(f64::MIN_POSITIVE)
    };
    peaks.sort_by(|a, b| local(*b).total_cmp(&local(*a)));
    peaks.truncate(kept);
    peaks
        .into_iter()
        .map(|i| {
            // Vertex of the parabola through the peak.
            let (a, b, c) = (total[i - 1], total[i], total[i + 1]);
            let bend = a - 2.0 * b + c;
            let shift = if bend < 0.0 { 0.5 * (a - c) / bend } else { 0.0 };
            POLICY.plausibility.min_order + step * (i as f64 + shift)
        })
        .collect()
}

fn span(x: &[f64]) -> f64 {
    let (low, high) = x.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
    (high - low).max(0.0)
}
