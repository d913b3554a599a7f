//! A joint with another zero than its URDF's, by any angle.
//!
//! In the angle δ by which one joint is off, the torque of bodies is a trigonometric polynomial of second degree: momentum is quadratic in
//! the joint's rotation, gravity linear. So five angles give all of them,
//!
//! ```text
//! τ(δ) = Σ_m τ(δ_m) D(δ − δ_m)    δ_m = 2πm/5    D(θ) = (1 + 2 cos θ + 2 cos 2θ)/5
//! ```
//!
//! and what is left of a torque at every δ is a quadratic form in products that are formed once.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use nalgebra::{DMatrix, DVector};

use crate::model::rows::Column;
use crate::numerics::parallel;
use crate::policy::POLICY;
use crate::screen::rigid_torque::{Bodies, FreeDrives};

/// Angles from which all others come.
const NODES: usize = 5;
/// Angles that are tried, over the circle.
const STEPS: usize = 720;

/// One joint's zero elsewhere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Zero {
    pub(crate) joint: usize,
    /// How far the joint stands from where it was logged \[rad\].
    pub(crate) angle: f64,
    /// What is left with it.
    pub(crate) missed: f64,
}

/// The best angle of every joint, the best joint first.
pub(crate) fn all(free: &FreeDrives<'_>, bodies: &[Bodies<'_>], measured: &[DVector<f64>]) -> Vec<Zero> {
    let joints: Vec<usize> = (0..measured.len()).collect();
    let mut found = parallel::map(&joints, |joint| best(free, bodies, measured, *joint));
    found.sort_by(|a, b| a.missed.total_cmp(&b.missed));
    found
}

fn best(free: &FreeDrives<'_>, bodies: &[Bodies<'_>], measured: &[DVector<f64>], joint: usize) -> Zero {
    let node = |m: usize| {
        let turned: Vec<Column> = bodies.iter().map(|run| run.turned(joint, TAU * m as f64 / NODES as f64)).collect();
        free.without_drives(&turned)
    };
    let signals: Vec<Vec<DVector<f64>>> = std::iter::once(measured.to_vec()).chain((0..NODES).map(node)).collect();
    let product = |a: usize, b: usize| signals[a].iter().zip(&signals[b]).map(|(a, b)| a.dot(b)).sum::<f64>();
    let products = DMatrix::from_fn(NODES + 1, NODES + 1, product);
    let unit = free.size(measured).powi(2) / products[(0, 0)].max(f64::MIN_POSITIVE);
    let missed = |angle: f64| {
        let weights = DVector::from_fn(NODES + 1, |k, _| if k == 0 { 1.0 } else { -share(angle, k - 1) });
        (unit * weights.dot(&(&products * &weights)).max(0.0)).sqrt()
    };
    let angles = (0..STEPS).map(|k| TAU * k as f64 / STEPS as f64 - PI);
    let angle = angles.min_by(|a, b| missed(*a).total_cmp(&missed(*b))).unwrap_or(0.0);
    let quarter = (angle / FRAC_PI_2).round() * FRAC_PI_2;
    let is_quarter = (angle - quarter).abs() < POLICY.screening.max_quarter_turn_error_rad
        && missed(quarter) <= POLICY.screening.max_quarter_turn_residual_ratio * missed(angle);
    let angle = if is_quarter { quarter } else { angle };
    // Half a turn back is half a turn on.
    let angle = if angle <= -PI { angle + TAU } else { angle };
    Zero { joint, angle, missed: missed(angle) }
}

/// What the torque at node `m` is of that at an angle.
fn share(angle: f64, m: usize) -> f64 {
    let off = angle - TAU * m as f64 / NODES as f64;
    (1.0 + 2.0 * off.cos() + 2.0 * (2.0 * off).cos()) / NODES as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn five_angles_give_a_polynomial_of_second_degree() {
        let torque = |d: f64| 0.3 - 2.0 * d.cos() + 0.7 * d.sin() + 0.4 * (2.0 * d).cos() - 1.1 * (2.0 * d).sin();
        for angle in [0.0, 0.3, FRAC_PI_2, -2.9, PI] {
            let from: f64 = (0..NODES).map(|m| torque(TAU * m as f64 / NODES as f64) * share(angle, m)).sum();
            // Rounding of sums of five.
            assert!((from - torque(angle)).abs() < 1e-13, "{angle}");
        }
    }
}
