//! Torque of coupled joints where the drives cannot give what is wanted.
//!
//! A joint whose torque is cut at its limit is dragged along by what the other joints do. So those give way: of all torques within the limits
//! the one is chosen whose accelerations are closest to the wanted ones, each joint's in parts of its speed limit.
//!
//! ```text
//! minimise  Σⱼ (aⱼ − a*ⱼ)² / v²ⱼ   with   a − a* = M⁻¹·(τ − τ*),   low ≤ τ ≤ high
//! ```

use crate::matrix::{cholesky_succeeds, solve_factored};
use rivet_dynamics::MAX_JOINTS;

/// Most sweeps of coordinate descent: within 1 % of the least value on 1000 drawn inertia matrices of up to seven joints, where 30 are not.
const SWEEPS: usize = 200;

/// Replaces `wanted` \[N·m\] by the torque within `low` and `high` whose accelerations are closest. `mass` is the inertia matrix, row-major,
/// and is overwritten. `speed` are speed limits \[rad/s\]; a joint without one counts as one of 1 rad/s. Where `mass` is that of no arm each
/// torque is limited alone. Real-time safe: bounded work.
pub(crate) fn allocate(
    wanted: &mut [f64],
    low: &[f64; MAX_JOINTS],
    high: &[f64; MAX_JOINTS],
    mass: &mut [f64],
    speed: &[f64; MAX_JOINTS],
) {
    let n = wanted.len().min(MAX_JOINTS);
    let is_within = (0..n).all(|j| wanted[j] >= low[j] && wanted[j] <= high[j]);
    if is_within || wanted.iter().any(|tau| !tau.is_finite()) {
        return;
    }
    let mut change = [0.0; MAX_JOINTS];
    for j in 0..n {
        change[j] = wanted[j].clamp(low[j], high[j]) - wanted[j];
    }
    if cholesky_succeeds(mass, n) {
        // Rows of the inverse in parts of the speed limits, and their squares: H = M⁻¹·W·M⁻¹.
        let (mut rows, mut squares) = ([[0.0; MAX_JOINTS]; MAX_JOINTS], [[0.0; MAX_JOINTS]; MAX_JOINTS]);
        for (j, row) in rows.iter_mut().enumerate().take(n) {
            row[j] = if speed[j].is_finite() && speed[j] > 0.0 { speed[j].recip() } else { 1.0 };
            solve_factored(mass, n, row);
        }
        for i in 0..n {
            for k in 0..n {
                squares[i][k] = rows[..n].iter().map(|row| row[i] * row[k]).sum();
            }
        }
        for _ in 0..SWEEPS {
            let before = change;
            for i in 0..n {
                let others: f64 = (0..n).filter(|k| *k != i).map(|k| squares[i][k] * change[k]).sum();
                let free = -others / squares[i][i];
                if free.is_finite() {
                    change[i] = free.clamp(low[i] - wanted[i], high[i] - wanted[i]);
                }
            }
            if change == before {
                break;
            }
        }
    }
    for j in 0..n {
        wanted[j] += change[j];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rivet_simulation::Random;

    /// An inertia matrix of `n` joints, bounds of each torque around zero, and wanted torques beyond some of them.
    fn drawn(random: &mut Random, n: usize) -> (Vec<f64>, [[f64; MAX_JOINTS]; 2], Vec<f64>, [f64; MAX_JOINTS]) {
        let factor: Vec<f64> = (0..n * n).map(|_| random.normal()).collect();
        let mut mass = vec![0.0; n * n];
        for i in 0..n {
            for j in 0..n {
                mass[i * n + j] = (0..n).map(|k| factor[i * n + k] * factor[j * n + k]).sum();
            }
            mass[i * n + i] += 0.3;
        }
        let [mut low, mut high, mut speed] = [[0.0; MAX_JOINTS]; 3];
        for j in 0..n {
            (low[j], high[j], speed[j]) =
                (-random.uniform(0.1, 2.0), random.uniform(0.1, 2.0), random.uniform(1.0, 6.0));
        }
        (mass, [low, high], (0..n).map(|_| 3.0 * random.normal()).collect(), speed)
    }

    /// What is minimised, for a change of torque.
    fn value(mass: &[f64], change: &[f64], speed: &[f64; MAX_JOINTS]) -> f64 {
        let (n, mut mass, mut a) = (change.len(), mass.to_vec(), change.to_vec());
        assert!(cholesky_succeeds(&mut mass, n));
        solve_factored(&mass, n, &mut a);
        a.iter().zip(speed).map(|(a, v)| (a / v).powi(2)).sum()
    }

    /// No torque within the bounds comes closer: neither the one that limits each joint alone, nor one a little off.
    #[test]
    fn accelerations_are_as_close_as_the_limits_permit() {
        let mut random = Random::stream(49, 1);
        for n in [1, 2, 3, 6, 7] {
            for _ in 0..200 {
                let (mass, [low, high], wanted, speed) = drawn(&mut random, n);
                let mut tau = wanted.clone();
                allocate(&mut tau, &low, &high, &mut mass.clone(), &speed);
                assert!((0..n).all(|j| tau[j] >= low[j] - 1e-9 && tau[j] <= high[j] + 1e-9), "{tau:?}");
                let objective = |tau: &[f64]| {
                    let change: Vec<f64> = tau.iter().zip(&wanted).map(|(a, b)| a - b).collect();
                    value(&mass, &change, &speed)
                };
                let found = objective(&tau);
                let alone: Vec<f64> = (0..n).map(|j| wanted[j].clamp(low[j], high[j])).collect();
                assert!(found <= objective(&alone) + 1e-9, "{found} and {}", objective(&alone));
                for _ in 0..50 {
                    let near: Vec<f64> =
                        (0..n).map(|j| (tau[j] + 0.05 * random.normal()).clamp(low[j], high[j])).collect();
                    assert!(found <= 1.01 * objective(&near) + 1e-9, "{n} joints: {found} and {}", objective(&near));
                }
            }
        }
    }

    #[test]
    fn torque_within_the_limits_and_what_is_no_number_stay() {
        let (mut mass, [low, high], _, speed) = drawn(&mut Random::stream(49, 2), 2);
        let mut tau = [0.05, -0.05];
        allocate(&mut tau, &low, &high, &mut mass, &speed);
        assert_eq!(tau, [0.05, -0.05]);
        let mut tau = [f64::NAN, 9.0];
        allocate(&mut tau, &low, &high, &mut mass, &speed);
        assert!(tau[0].is_nan() && tau[1] == 9.0);
    }
}
