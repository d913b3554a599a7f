//! The control laws: torque from published base parameters, and nothing else.

use crate::limits::middle;
use rivet_config::Law;
use rivet_dynamics::{BaseSet, MAX_JOINTS, Model, Parameter, Workspace};
use std::sync::Arc;

pub use crate::desired::Desired;

/// Error feedback, joint by joint, in units of acceleration.
#[derive(Clone, Debug, PartialEq)]
pub struct Gains {
    /// \[1/s²\].
    pub position: Vec<f64>,
    /// \[1/s\].
    pub velocity: Vec<f64>,
    /// \[1/s³\]; zero is no integral action.
    pub integral: Vec<f64>,
}

impl Gains {
    /// Gains that give every linearised joint the error dynamics `ë + 2ζω·ė + ω²·(e + 2π·fᵢ·∫e) = 0`.
    ///
    /// `bandwidth_hz` is ω/2π of each joint, `damping` is ζ, `integral_hz` is fᵢ.
    pub fn from_bandwidth(bandwidth_hz: &[f64], damping: f64, integral_hz: f64) -> Gains {
        let omega = |f: &f64| std::f64::consts::TAU * f;
        Gains {
            position: bandwidth_hz.iter().map(|f| omega(f).powi(2)).collect(),
            velocity: bandwidth_hz.iter().map(|f| 2.0 * damping * omega(f)).collect(),
            integral: bandwidth_hz.iter().map(|f| omega(f).powi(2) * omega(&integral_hz)).collect(),
        }
    }
}

/// Torque from the model that the base parameters `x` make, in one of two ways:
///
/// ```text
/// computed torque       τ = Y(q, q̇_d, v)·x,         v = q̈_d + a
/// feed-forward and PD   τ = Y(q_d, q̇_d, q̈_d)·x + m∘a
/// a = Kd·(q̇_d − q̇) + Kp·(q_d − q) + Ki·∫(q_d − q)dt
/// ```
///
/// Friction and velocity products are taken at the DESIRED velocity: the measured one is differentiated from an encoder
/// and would chatter through `sign(q̇)`. Everything is linear in `x`, so only published numbers act. `m` is the diagonal of
/// the nominal inertia matrix at the middle of the joint ranges: a constant gain, whatever is published.
pub struct ControlLaw {
    kind: Law,
    model: Arc<Model>,
    base: Arc<BaseSet>,
    gains: Gains,
    period_s: f64,
    workspace: Workspace,
    full: Vec<f64>,
    rows: Vec<f64>,
    inertia: [f64; MAX_JOINTS],
    integral: [f64; MAX_JOINTS],
    /// Error that the integral would take in, once the output has said that it was not at a limit.
    pending: [f64; MAX_JOINTS],
    /// Which base parameters are friction.
    is_friction: Vec<bool>,
}

/// Whether a parameter is one of friction.
fn is_friction(parameter: Parameter) -> bool {
    matches!(
        parameter,
        Parameter::Viscous(_)
            | Parameter::Coulomb(_)
            | Parameter::LoadFriction(_)
            | Parameter::ViscousQuadratic(_)
            | Parameter::CouplingViscous
            | Parameter::CouplingCoulomb
    )
}

/// The integral is bounded to the acceleration that an error of this size makes \[rad\].
const INTEGRAL_REACH: f64 = 0.1;

impl ControlLaw {
    /// Allocates all scratch; nothing allocates later. `nominal` are base parameters, `period_s` the time between samples.
    pub fn new(
        kind: Law,
        model: Arc<Model>,
        base: Arc<BaseSet>,
        nominal: &[f64],
        gains: Gains,
        period_s: f64,
    ) -> ControlLaw {
        let dof = model.arm.dof();
        let is_friction = (0..base.len()).map(|i| is_friction(base.parameter(&model, i))).collect();
        let mut law = ControlLaw {
            kind,
            workspace: Workspace::new(&model.arm),
            full: vec![0.0; dof * model.len()],
            rows: vec![0.0; dof * base.len()],
            inertia: [0.0; MAX_JOINTS],
            integral: [0.0; MAX_JOINTS],
            pending: [0.0; MAX_JOINTS],
            is_friction,
            model,
            base,
            gains,
            period_s,
        };
        let middle: Vec<f64> = law.model.arm.joints.iter().map(|j| middle(j.lower, j.upper)).collect();
        let mut mass = vec![0.0; dof * dof];
        law.inertia(&middle, nominal, &mut mass);
        for j in 0..dof {
            law.inertia[j] = mass[j * dof + j].max(0.0);
        }
        law
    }

    /// Torque \[N·m\] that makes the arm follow `desired` from the measured `q`, `qd`, with base parameters `x`; returns what of it
    /// is friction.
    ///
    /// Real-time safe. Not yet limited.
    pub fn torque(
        &mut self,
        q: &[f64],
        qd: &[f64],
        desired: &Desired,
        x: &[f64],
        tau: &mut [f64],
    ) -> [f64; MAX_JOINTS] {
        let dof = self.model.arm.dof();
        let mut a = [0.0; MAX_JOINTS];
        for j in 0..dof {
            let error = desired.q[j] - q[j];
            self.pending[j] = error;
            a[j] = self.gains.velocity[j] * (desired.qd[j] - qd[j])
                + self.gains.position[j] * error
                + self.gains.integral[j] * self.integral[j];
        }
        let mut v = desired.qdd;
        let at = match self.kind {
            Law::ComputedTorque => {
                for j in 0..dof {
                    v[j] += a[j];
                }
                q
            }
            Law::FeedForwardPd => &desired.q[..dof],
        };
        let [friction, rest] = self.model_torque_apart(at, &desired.qd[..dof], &v[..dof], x);
        for (j, tau) in tau.iter_mut().enumerate() {
            let feedback = if self.kind == Law::FeedForwardPd { self.inertia[j] * a[j] } else { 0.0 };
            *tau = rest[j] + friction[j] + feedback;
        }
        friction
    }

    /// Takes the last error into the integral of every joint whose torque was not at a limit (no wind-up).
    pub fn integrate(&mut self, limited: &[bool]) {
        for (j, limited) in limited.iter().enumerate() {
            if *limited || self.gains.integral[j] == 0.0 {
                continue;
            }
            let most = INTEGRAL_REACH * self.gains.position[j] / self.gains.integral[j];
            self.integral[j] = (self.integral[j] + self.period_s * self.pending[j]).clamp(-most, most);
        }
    }

    /// Empties the integral.
    pub fn restart(&mut self) {
        self.integral = [0.0; MAX_JOINTS];
    }

    /// `Y(q, q̇, q̈)·x` \[N·m\] and the effects of known size: what the model with base parameters `x` needs for a motion.
    /// Real-time safe.
    pub fn model_torque(&mut self, q: &[f64], qd: &[f64], qdd: &[f64], x: &[f64], tau: &mut [f64]) {
        for (row, out) in self.regressor(q, qd, qdd).zip(tau.iter_mut()) {
            *out = row.iter().zip(x).map(|(y, x)| y * x).sum();
        }
        self.model.add_effects(&mut self.workspace, q, qd, qdd, tau);
    }

    /// The same in two parts \[N·m\]: friction, that of known effects included, and the rest. Real-time safe.
    pub(crate) fn model_torque_apart(
        &mut self,
        q: &[f64],
        qd: &[f64],
        qdd: &[f64],
        x: &[f64],
    ) -> [[f64; MAX_JOINTS]; 2] {
        let [mut friction, mut rest] = [[0.0; MAX_JOINTS]; 2];
        self.model.regressor(&mut self.workspace, q, qd, qdd, &mut self.full);
        self.base.select(&self.full, self.model.len(), &mut self.rows);
        for (j, row) in self.rows.chunks_exact(self.base.len()).enumerate() {
            for ((y, x), is_friction) in row.iter().zip(x).zip(&self.is_friction) {
                let part = if *is_friction { &mut friction[j] } else { &mut rest[j] };
                *part += y * x;
            }
        }
        let dof = self.model.arm.dof();
        let ws = &mut self.workspace;
        self.model.add_effects_apart(ws, [q, qd, qdd], &mut friction[..dof], &mut rest[..dof]);
        [friction, rest]
    }

    /// M(q), row-major, of base parameters `x`: column j is `Y(q, 0, e_j)·x − Y(q, 0, 0)·x`. Real-time safe.
    pub(crate) fn inertia(&mut self, q: &[f64], x: &[f64], mass: &mut [f64]) {
        let dof = self.dof();
        let zero = [0.0; MAX_JOINTS];
        let (mut bias, mut column) = ([0.0; MAX_JOINTS], [0.0; MAX_JOINTS]);
        self.model_torque(q, &zero[..dof], &zero[..dof], x, &mut bias[..dof]);
        for j in 0..dof {
            let mut unit = zero;
            unit[j] = 1.0;
            self.model_torque(q, &zero[..dof], &unit[..dof], x, &mut column[..dof]);
            for i in 0..dof {
                mass[i * dof + j] = column[i] - bias[i];
            }
        }
    }

    /// Rows of `Y(q, q̇, q̈)`, one a joint.
    pub(crate) fn regressor(&mut self, q: &[f64], qd: &[f64], qdd: &[f64]) -> std::slice::ChunksExact<'_, f64> {
        self.model.regressor(&mut self.workspace, q, qd, qdd, &mut self.full);
        self.base.select(&self.full, self.model.len(), &mut self.rows);
        self.rows.chunks_exact(self.base.len())
    }

    /// Feedback gains on position \[1/s²\] and velocity \[1/s\] of joint `j`.
    pub(crate) fn gains(&self, j: usize) -> (f64, f64) {
        (self.gains.position[j], self.gains.velocity[j])
    }

    /// Inertia of joint `j` in the middle of the joint ranges \[kg·m²\].
    pub(crate) fn nominal_inertia(&self, j: usize) -> f64 {
        self.inertia[j]
    }

    /// Joint count.
    pub(crate) fn dof(&self) -> usize {
        self.model.arm.dof()
    }
}
