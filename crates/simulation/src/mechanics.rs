//! Equations of motion of the true arm: rigid links, drive inertia, viscous friction, offsets. Dry friction is `friction.rs`.

use crate::truth::Truth;
use rivet_dynamics::{
    Arm, EffectKind, JointKind, KnownEffect, MAX_JOINTS, Workspace, WristCoupling, inverse_dynamics, mass_matrix,
    own_torque,
};

/// One value a joint; entries from the arm's joint count on are zero.
pub type Vector = [f64; MAX_JOINTS];

/// `M(q) qdd + b(q, qd) + D qd + o = tau + friction`.
#[derive(Clone, Debug)]
pub(crate) struct Mechanics {
    arm: Arm,
    n: usize,
    rotor_inertia: Vector,
    /// Viscous friction D, row-major; off the diagonal only with a coupled wrist.
    viscous: [Vector; MAX_JOINTS],
    offset: Vector,
    /// Coupled joints and the inertia they share \[kg·m²\].
    coupling: Option<(WristCoupling, f64)>,
    workspace: Workspace,
    mass: [f64; MAX_JOINTS * MAX_JOINTS],
    /// Lower Cholesky factor of M, of the state last given to `factor`.
    factor: [Vector; MAX_JOINTS],
    /// Bias b of the same state.
    bias: Vector,
    /// Acceleration last found, for the load on gears: friction that hangs on it decides the next one, a stage of the integrator later.
    qdd: Vector,
    /// Further effects, and the state that they are asked for.
    effects: Vec<KnownEffect>,
    at: (Vector, Vector),
}

impl Mechanics {
    pub(crate) fn new(truth: &Truth) -> Self {
        let n = truth.arm.dof();
        let take = |values: &[f64]| {
            let mut all = [0.0; MAX_JOINTS];
            all[..n].copy_from_slice(&values[..n]);
            all
        };
        let mut viscous = [[0.0; MAX_JOINTS]; MAX_JOINTS];
        for j in 0..n {
            viscous[j][j] = truth.joints.viscous[j];
        }
        let coupling = truth.structure.coupling.map(|pair| (pair, truth.joints.coupling[0]));
        if let Some((WristCoupling { driving, driven }, _)) = coupling {
            viscous[driving][driven] = truth.joints.coupling[1];
            viscous[driven][driving] = truth.joints.coupling[1];
        }
        Self {
            n,
            rotor_inertia: take(&truth.joints.rotor_inertia),
            viscous,
            offset: take(&truth.joints.offset),
            coupling,
            workspace: Workspace::new(&truth.arm),
            arm: truth.arm.clone(),
            mass: [0.0; MAX_JOINTS * MAX_JOINTS],
            factor: [[0.0; MAX_JOINTS]; MAX_JOINTS],
            bias: [0.0; MAX_JOINTS],
            qdd: [0.0; MAX_JOINTS],
            effects: truth.effects.clone(),
            at: ([0.0; MAX_JOINTS], [0.0; MAX_JOINTS]),
        }
    }

    pub(crate) fn dof(&self) -> usize {
        self.n
    }

    /// M(q), rotor and coupling inertia included, into `self.mass`.
    fn fill_mass(&mut self, q: &Vector) {
        let n = self.n;
        mass_matrix(&self.arm, &self.arm.links, &mut self.workspace, &q[..n], &mut self.mass[..n * n]);
        for j in 0..n {
            self.mass[j * n + j] += self.rotor_inertia[j];
        }
        if let Some((WristCoupling { driving, driven }, inertia)) = self.coupling {
            self.mass[driving * n + driven] += inertia;
            self.mass[driven * n + driving] += inertia;
        }
    }

    /// Prepares `solve` and `free_force` for the state `(q, qd)`.
    pub(crate) fn factor(&mut self, q: &Vector, qd: &Vector) {
        let n = self.n;
        self.at = (*q, *qd);
        self.fill_mass(q);
        let zero = [0.0; MAX_JOINTS];
        inverse_dynamics(
            &self.arm,
            &self.arm.links,
            &mut self.workspace,
            &q[..n],
            &qd[..n],
            &zero[..n],
            &mut self.bias[..n],
        );
        let (m, l) = (&self.mass, &mut self.factor);
        for i in 0..n {
            for k in 0..=i {
                let mut sum = m[i * n + k];
                for p in 0..k {
                    sum -= l[i][p] * l[k][p];
                }
                // A true arm's M is positive definite; the floor keeps a massless link from making NaN out of rounding.
                l[i][k] = if i == k { sum.max(1e-12).sqrt() } else { sum / l[k][k] };
            }
        }
    }

    /// `M⁻¹ x` in place, M of the state last given to `factor`.
    pub(crate) fn solve(&self, x: &mut Vector) {
        let (n, l) = (self.n, &self.factor);
        for i in 0..n {
            for p in 0..i {
                x[i] -= l[i][p] * x[p];
            }
            x[i] /= l[i][i];
        }
        for i in (0..n).rev() {
            for p in i + 1..n {
                x[i] -= l[p][i] * x[p];
            }
            x[i] /= l[i][i];
        }
    }

    /// What is left of `tau` for acceleration and dry friction: `tau - b - D qd - o`, b of the state last given to `factor`.
    pub(crate) fn free_force(&self, tau: &Vector, qd: &Vector) -> Vector {
        let mut f = [0.0; MAX_JOINTS];
        for j in 0..self.n {
            f[j] = tau[j] - self.bias[j] - self.offset[j];
            for k in 0..self.n {
                f[j] -= self.viscous[j][k] * qd[k];
            }
        }
        let q = &self.at.0;
        for effect in &self.effects {
            let j = effect.joint;
            f[j] -= match effect.kind {
                EffectKind::FrictionAsymmetry => effect.values[1] * qd[j].abs(),
                EffectKind::ViscousNonlinearity
                | EffectKind::TorqueRipple
                | EffectKind::JointSpring
                | EffectKind::Counterbalance => own_torque(effect, 0.0, 0.0, q[j], qd[j]),
                // The angle of the link is that of the encoder but for the error itself, which is small.
                EffectKind::TransmissionError => effect.ratio_error(q[j]) * self.carried(j),
                _ => 0.0,
            };
        }
        f
    }

    /// What effects add to the dry friction of joint `j` that slides, or is held from sliding, in the direction `sign`, in
    /// the state last given to `factor`. The load is the torque of the links, their acceleration included.
    pub(crate) fn dry(&self, j: usize, sign: f64) -> f64 {
        let (q, qd) = (self.at.0[j], self.at.1[j]);
        let level = |effect: &KnownEffect| match effect.kind {
            EffectKind::FrictionAsymmetry => effect.values[0] * sign,
            EffectKind::StribeckFriction
            | EffectKind::LoadDependentFriction
            | EffectKind::PositionDependentFriction => own_torque(effect, 1.0, self.carried(j), q, qd),
            _ => 0.0,
        };
        self.effects.iter().filter(|e| e.joint == j).map(level).sum()
    }

    /// Takes note of the acceleration of the state last given to `factor`.
    pub(crate) fn accelerated(&mut self, qdd: &Vector) {
        self.qdd = *qdd;
    }

    /// Torque of the links at joint `j`, what the gear carries: of the state last given to `factor` and the acceleration before it.
    fn carried(&self, j: usize) -> f64 {
        let row = &self.mass[j * self.n..(j + 1) * self.n];
        let with_drives: f64 = row.iter().zip(&self.qdd).map(|(m, a)| m * a).sum();
        let drives = self.rotor_inertia[j] * self.qdd[j]
            + match self.coupling {
                Some((WristCoupling { driving, driven }, inertia)) if j == driving => inertia * self.qdd[driven],
                Some((WristCoupling { driving, driven }, inertia)) if j == driven => inertia * self.qdd[driving],
                _ => 0.0,
            };
        self.bias[j] + with_drives - drives
    }

    /// Whether effects make dry friction on joint `j`.
    pub(crate) fn has_dry(&self, j: usize) -> bool {
        let dry = |kind: EffectKind| {
            matches!(
                kind,
                EffectKind::FrictionAsymmetry
                    | EffectKind::StribeckFriction
                    | EffectKind::LoadDependentFriction
                    | EffectKind::PositionDependentFriction
            )
        };
        self.effects.iter().any(|e| e.joint == j && dry(e.kind))
    }

    /// Kinetic energy, rotors included, plus potential energy in the field of gravity \[J\].
    pub(crate) fn energy(&mut self, q: &Vector, qd: &Vector) -> (f64, f64) {
        self.fill_mass(q);
        let n = self.n;
        let mut twice = 0.0;
        for i in 0..n {
            for k in 0..n {
                twice += qd[i] * self.mass[i * n + k] * qd[k];
            }
        }
        (0.5 * twice, potential(&self.arm, &q[..n]))
    }
}

/// Potential energy `-sum_i g . (m_i p_i + R_i h_i)` \[J\] by plain forward kinematics, apart from the recursions it checks.
fn potential(arm: &Arm, q: &[f64]) -> f64 {
    let mut rotation = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let mut origin = [0.0; 3];
    let mut energy = 0.0;
    for (j, joint) in arm.joints.iter().enumerate() {
        let fixed = product(&rotation, &joint.rotation);
        let mut step = joint.translation;
        let mut turn = 0.0;
        match joint.kind {
            JointKind::Revolute => turn = q[j],
            JointKind::Prismatic => {
                let along = turned(&joint.rotation, &joint.axis);
                for c in 0..3 {
                    step[c] += q[j] * along[c];
                }
            }
        }
        let moved = turned(&rotation, &step);
        for c in 0..3 {
            origin[c] += moved[c];
        }
        rotation = product(&fixed, &about(&joint.axis, turn));
        let body = &arm.links[j];
        let moment = turned(&rotation, &[body[1], body[2], body[3]]);
        for c in 0..3 {
            energy -= arm.gravity[c] * (body[0] * origin[c] + moment[c]);
        }
    }
    energy
}

type Matrix = [[f64; 3]; 3];

/// Rotation by `angle` about the unit vector `axis` (Rodrigues).
fn about(axis: &[f64; 3], angle: f64) -> Matrix {
    let (s, c) = angle.sin_cos();
    let [x, y, z] = *axis;
    let v = 1.0 - c;
    [
        [c + x * x * v, x * y * v - z * s, x * z * v + y * s],
        [y * x * v + z * s, c + y * y * v, y * z * v - x * s],
        [z * x * v - y * s, z * y * v + x * s, c + z * z * v],
    ]
}

fn product(a: &Matrix, b: &Matrix) -> Matrix {
    core::array::from_fn(|i| core::array::from_fn(|k| (0..3).map(|p| a[i][p] * b[p][k]).sum()))
}

fn turned(a: &Matrix, x: &[f64; 3]) -> [f64; 3] {
    core::array::from_fn(|i| (0..3).map(|p| a[i][p] * x[p]).sum())
}
