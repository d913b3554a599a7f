//! Friction that remembers where it came from.
//!
//! Below breakaway a joint does not slide: its contacts are springs, and a reversal must first unwind them. As one
//! spring and one slider (Prandtl 1928, Iwan 1966), with travel d from full friction one way to none:
//!
//! ```text
//! z ← clamp(z + Δq/d, −1, 1)          τ = Fc·z
//! ```
//!
//! It depends on positions only, so speed noise at rest does not shake it, and a joint that stops keeps its friction.

use crate::arm::MAX_JOINTS;

/// A motor that turns with two joints (0-based), as in the TX40's wrist `{ driving: 4, driven: 5 }`: motor 6 turns
/// with q5 + q6, so its inertia and friction act on both.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WristCoupling {
    /// The joint whose motion also turns the other's motor.
    pub driving: usize,
    /// The joint that the motor is for.
    pub driven: usize,
}

/// Direction of friction of every joint along one motion, and of the coupled motor.
#[derive(Clone, Debug, PartialEq)]
pub struct Slip {
    dof: usize,
    travel: f64,
    pair: Option<WristCoupling>,
    /// Last positions, none before the first; the coupled motor's behind the joints'.
    last: Option<[f64; MAX_JOINTS + 1]>,
    z: [f64; MAX_JOINTS + 1],
}

impl Slip {
    pub(crate) fn undirected(dof: usize, travel: f64, pair: Option<WristCoupling>) -> Slip {
        Slip { dof, travel, pair, last: None, z: [0.0; MAX_JOINTS + 1] }
    }

    /// Another motion begins.
    pub fn restart(&mut self) {
        self.last = None;
        self.z = [0.0; MAX_JOINTS + 1];
    }

    /// The motion has come to `q` \[rad\], one entry a joint.
    pub fn advance(&mut self, q: &[f64]) {
        if self.travel <= 0.0 {
            return;
        }
        let mut now = [0.0; MAX_JOINTS + 1];
        now[..self.dof].copy_from_slice(&q[..self.dof]);
        if let Some(WristCoupling { driving, driven }) = self.pair {
            now[MAX_JOINTS] = q[driving] + q[driven];
        }
        if let Some(last) = &self.last {
            for ((z, now), last) in self.z.iter_mut().zip(&now).zip(last) {
                *z = (*z + (now - last) / self.travel).clamp(-1.0, 1.0);
            }
        }
        self.last = Some(now);
    }

    /// One entry a joint, −1 to 1, and last that of the coupled motor.
    pub(crate) fn directions(&self) -> [f64; MAX_JOINTS + 1] {
        self.z
    }
}
