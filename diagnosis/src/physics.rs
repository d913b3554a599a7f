//! Signals along one run that the forms of effects are made of, at the rate of the log.

use rivet_dynamics::{Workspace, friction_sign, inverse_dynamics, mass_matrix};

use crate::background::Nominal;
use crate::run::{Motion, Run};

/// Step of the numeric derivative with respect to a position \[rad\].
const STEP: f64 = 1e-4;

/// What the best values so far say along one run, `[joint][sample]`.
pub(crate) struct Physics<'a> {
    /// Which of the runs looked at this is; none for one that is sealed.
    pub(crate) index: Option<usize>,
    pub(crate) run: &'a Run,
    pub(crate) motion: &'a Motion,
    pub(crate) nominal: &'a Nominal,
    /// Standard vector that the signals below were made with.
    pub(crate) x: Vec<f64>,
    /// Torque of the rigid links alone.
    pub(crate) rigid: Vec<Vec<f64>>,
    /// Torque of the whole model.
    pub(crate) torque: Vec<Vec<f64>>,
    /// Direction of friction.
    pub(crate) sign: Vec<Vec<f64>>,
    /// `gradient[j][i]`: change of joint i's rigid torque per change of position j.
    pub(crate) gradient: Vec<Vec<Vec<f64>>>,
    /// `mass[j][i]`: entry of the mass matrix of the rigid links.
    pub(crate) mass: Vec<Vec<Vec<f64>>>,
}

impl<'a> Physics<'a> {
    pub(crate) fn new(
        run: &'a Run,
        motion: &'a Motion,
        nominal: &'a Nominal,
        x: &[f64],
        index: Option<usize>,
    ) -> Physics<'a> {
        let model = &nominal.model;
        let (n, samples) = (motion.joints(), motion.len());
        let links = bodies(x, n);
        let mut ws = Workspace::new(&model.arm);
        let (mut q, mut qd, mut qdd) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
        let (mut up, mut down, mut m) = (vec![0.0; n], vec![0.0; n], vec![0.0; n * n]);
        let mut y = vec![0.0; n * model.len()];
        let signals = || vec![vec![0.0; samples]; n];
        let (mut rigid, mut torque, mut sign) = (signals(), signals(), signals());
        let mut gradient = vec![signals(); n];
        let mut mass = vec![signals(); n];
        for k in 0..samples {
            motion.state(k, &mut q, &mut qd, &mut qdd);
            inverse_dynamics(&model.arm, &links, &mut ws, &q, &qd, &qdd, &mut up);
            model.regressor(&mut ws, &q, &qd, &qdd, &mut y);
            for i in 0..n {
                rigid[i][k] = up[i];
                torque[i][k] = y[i * model.len()..][..model.len()].iter().zip(x).map(|(y, x)| y * x).sum();
                sign[i][k] = friction_sign(qd[i], model.structure.sign_velocity);
            }
            mass_matrix(&model.arm, &links, &mut ws, &q, &mut m);
            for j in 0..n {
                let at = q[j];
                q[j] = at + STEP;
                inverse_dynamics(&model.arm, &links, &mut ws, &q, &qd, &qdd, &mut up);
                q[j] = at - STEP;
                inverse_dynamics(&model.arm, &links, &mut ws, &q, &qd, &qdd, &mut down);
                q[j] = at;
                for i in 0..n {
                    gradient[j][i][k] = (up[i] - down[i]) / (2.0 * STEP);
                    mass[j][i][k] = m[i * n + j];
                }
            }
        }
        Physics { index, run, motion, nominal, x: x.to_vec(), rigid, torque, sign, gradient, mass }
    }

    /// The torque of known effects joins that of the model.
    pub(crate) fn beside(mut self, known: &[Vec<f64>]) -> Self {
        for (torque, known) in self.torque.iter_mut().zip(known) {
            torque.iter_mut().zip(known).for_each(|(t, k)| *t += k);
        }
        self
    }

    pub(crate) fn joints(&self) -> usize {
        self.motion.joints()
    }

    pub(crate) fn samples(&self) -> usize {
        self.motion.len()
    }

    pub(crate) fn period_s(&self) -> f64 {
        self.motion.period_s
    }
}

/// The bodies in a standard vector.
pub(crate) fn bodies(x: &[f64], joints: usize) -> Vec<[f64; 10]> {
    (0..joints).map(|link| std::array::from_fn(|e| x[10 * link + e])).collect()
}

/// Change of the rigid torques when joint `joint` is really at `q + δ`: `M δ̈ + ∂τ/∂q δ`, Coriolis terms of δ̇ left out.
/// Full-rate column.
pub(crate) fn displaced(physics: &Physics<'_>, joint: usize, delta: &[f64], accel: &[f64]) -> Vec<Option<Vec<f64>>> {
    (0..physics.joints())
        .map(|i| {
            let (mass, gradient) = (&physics.mass[joint][i], &physics.gradient[joint][i]);
            let at = |k: usize| mass[k] * accel[k] + gradient[k] * delta[k];
            Some((0..delta.len()).map(at).collect())
        })
        .collect()
}
