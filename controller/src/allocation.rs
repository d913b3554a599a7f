//! Torque of coupled joints where the drives cannot give what is wanted.
//!
//! A joint that is held back at its limit is dragged along by what the other joints do. So those give way: of all torques within the limits
//! the one is chosen whose accelerations are closest to the wanted ones, each joint's in parts of its speed limit.
//!
//! ```text
//! minimise  Σⱼ (aⱼ − a*ⱼ)² / v²ⱼ   with   a − a* = M⁻¹·(τ − τ*),   low ≤ τ ≤ high
//! ```

use crate::matrix::{cholesky_succeeds, solve_factored};
use rivet_dynamics::MAX_JOINTS;

/// Sweeps of coordinate descent. Of drawn arms with up to seven joints, 30 come within 1 % of the least value in all.
const SWEEPS: usize = 30;

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
            for i in 0..n {
                let others: f64 = (0..n).filter(|k| *k != i).map(|k| squares[i][k] * change[k]).sum();
                let free = -others / squares[i][i];
                if free.is_finite() {
                    change[i] = free.clamp(low[i] - wanted[i], high[i] - wanted[i]);
                }
            }
        }
    }
    for j in 0..n {
        wanted[j] += change[j];
    }
}
