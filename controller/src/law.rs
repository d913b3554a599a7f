//! The control law: computed torque from published base parameters, and nothing else.

use rivet_dynamics::{BaseSet, MAX_JOINTS, Model, Workspace};
use std::sync::Arc;

/// A desired state: positions \[rad\], velocities \[rad/s\] and accelerations \[rad/s²\], one entry a joint.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Desired {
    /// Desired positions.
    pub q: [f64; MAX_JOINTS],
    /// Desired velocities.
    pub qd: [f64; MAX_JOINTS],
    /// Desired accelerations.
    pub qdd: [f64; MAX_JOINTS],
}

/// Error feedback, joint by joint, in units of acceleration.
#[derive(Clone, Debug, PartialEq)]
pub struct Gains {
    /// \[1/s²\].
    pub position: Vec<f64>,
    /// \[1/s\].
    pub velocity: Vec<f64>,
}

impl Gains {
    /// Gains that give every linearised joint the error dynamics `ë + 2ζω·ė + ω²·e = 0`.
    ///
    /// `bandwidth_hz` is ω/2π of each joint, `damping` is ζ.
    pub fn from_bandwidth(bandwidth_hz: &[f64], damping: f64) -> Gains {
        let omega = |f: &f64| std::f64::consts::TAU * f;
        Gains {
            position: bandwidth_hz.iter().map(|f| omega(f).powi(2)).collect(),
            velocity: bandwidth_hz.iter().map(|f| 2.0 * damping * omega(f)).collect(),
        }
    }
}

/// Feedback linearisation with the identified model: `τ = Y(q, q̇_d, v)·x`, `v = q̈_d + Kd·(q̇_d − q̇) + Kp·(q_d − q)`.
///
/// Friction and velocity products are taken at the DESIRED velocity: the measured one is differentiated from an encoder
/// and would chatter through `sign(q̇)`. Everything is linear in the base parameters `x`, so only published numbers act.
pub struct ComputedTorque {
    model: Arc<Model>,
    base: Arc<BaseSet>,
    gains: Gains,
    workspace: Workspace,
    full: Vec<f64>,
    rows: Vec<f64>,
    zero: [f64; MAX_JOINTS],
    unit: [f64; MAX_JOINTS],
    mass: Vec<f64>,
}

impl ComputedTorque {
    /// Allocates all scratch; nothing allocates later.
    pub fn new(model: Arc<Model>, base: Arc<BaseSet>, gains: Gains) -> ComputedTorque {
        let dof = model.arm.dof();
        ComputedTorque {
            workspace: Workspace::new(&model.arm),
            full: vec![0.0; dof * model.len()],
            rows: vec![0.0; dof * base.len()],
            zero: [0.0; MAX_JOINTS],
            unit: [0.0; MAX_JOINTS],
            mass: vec![0.0; dof * dof],
            model,
            base,
            gains,
        }
    }

    /// Torque \[N·m\] that makes the arm follow `desired` from the measured `q`, `qd`, with base parameters `x`.
    ///
    /// Real-time safe. Not yet saturated.
    pub fn torque(&mut self, q: &[f64], qd: &[f64], desired: &Desired, x: &[f64], tau: &mut [f64]) {
        let dof = self.model.arm.dof();
        let mut v = [0.0; MAX_JOINTS];
        for j in 0..dof {
            v[j] = desired.qdd[j]
                + self.gains.velocity[j] * (desired.qd[j] - qd[j])
                + self.gains.position[j] * (desired.q[j] - q[j]);
        }
        self.multiply(q, &desired.qd[..dof], &v[..dof], x, tau);
    }

    /// Whether the inertia matrix that `x` implies at `q` is positive definite: a model without that must not act.
    ///
    /// Column j of M is `Y(q, 0, e_j)·x − Y(q, 0, 0)·x`; then Cholesky. Real-time safe.
    pub fn inertia_is_positive(&mut self, q: &[f64], x: &[f64]) -> bool {
        let dof = self.model.arm.dof();
        let zero = self.zero;
        let mut bias = [0.0; MAX_JOINTS];
        self.multiply(q, &zero[..dof], &zero[..dof], x, &mut bias);
        for j in 0..dof {
            let mut column = [0.0; MAX_JOINTS];
            let mut unit = self.unit;
            unit[j] = 1.0;
            self.multiply(q, &zero[..dof], &unit[..dof], x, &mut column);
            for i in 0..dof {
                self.mass[i * dof + j] = column[i] - bias[i];
            }
        }
        cholesky_succeeds(&mut self.mass, dof)
    }

    fn multiply(&mut self, q: &[f64], qd: &[f64], qdd: &[f64], x: &[f64], tau: &mut [f64]) {
        self.model.regressor(&mut self.workspace, q, qd, qdd, &mut self.full);
        self.base.select(&self.full, self.model.len(), &mut self.rows);
        for (row, out) in self.rows.chunks_exact(self.base.len()).zip(tau.iter_mut()) {
            *out = row.iter().zip(x).map(|(y, x)| y * x).sum();
        }
    }
}

/// In-place Cholesky of a symmetric `n` x `n` row-major matrix; false when a pivot is not positive (or not a number).
fn cholesky_succeeds(a: &mut [f64], n: usize) -> bool {
    for j in 0..n {
        let mut pivot = a[j * n + j];
        for k in 0..j {
            pivot -= a[j * n + k] * a[j * n + k];
        }
        if pivot.is_nan() || pivot <= 0.0 {
            return false;
        }
        let root = pivot.sqrt();
        a[j * n + j] = root;
        for i in j + 1..n {
            let mut sum = a[i * n + j];
            for k in 0..j {
                sum -= a[i * n + k] * a[j * n + k];
            }
            a[i * n + j] = sum / root;
        }
    }
    true
}
