//! Signals along one run that the columns of effects are made of, at the rate of the log.

use std::sync::OnceLock;

use rivet_dynamics::{Places, Workspace, friction_sign, inverse_dynamics, mass_matrix};

use crate::model::nominal::Nominal;
use crate::model::run::{Motion, Run};
use crate::numerics::parallel::{self, chunks, joined};

use base_mode::Mounting;

pub(crate) mod base_mode;

/// The smoothing of positions smears a stop over this time \[s\]: an arm whose friction truly sticks stands before its speed is
/// seen to reach zero. Sound arms that stick need 2 ms; 3 ms hid two effects of another program's cases.
pub(crate) const SMEARED_S: f64 = 2e-3;
/// Step of the numeric derivative with respect to a position \[rad\].
const STEP: f64 = 1e-4;

/// What the best values so far say along one run, `[joint][sample]`.
pub(crate) struct Physics<'a> {
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
    inertial: OnceLock<Inertial>,
    mounting: OnceLock<Option<Mounting>>,
}

/// What a displaced joint changes, `[moved joint][joint][sample]`.
struct Inertial {
    gradient: Vec<Vec<Vec<f64>>>,
    mass: Vec<Vec<Vec<f64>>>,
}

impl<'a> Physics<'a> {
    pub(crate) fn new(run: &'a Run, motion: &'a Motion, nominal: &'a Nominal, x: &[f64]) -> Physics<'a> {
        let model = &nominal.model;
        let n = motion.joints();
        let links = bodies(x, n);
        // Rigid torque, whole torque and direction of friction of each joint beside each other.
        let chunk = |(from, to): &(usize, usize)| {
            let mut ws = Workspace::new(&model.arm);
            let (mut q, mut qd, mut qdd) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
            let mut tau = vec![0.0; n];
            let mut y = vec![0.0; n * model.len()];
            let mut signals = vec![Vec::with_capacity(to - from); 3 * n];
            for k in *from..*to {
                motion.state(k, &mut q, &mut qd, &mut qdd);
                inverse_dynamics(&model.arm, &links, &mut ws, &q, &qd, &qdd, &mut tau);
                model.regressor(&mut ws, &q, &qd, &qdd, &mut y);
                for i in 0..n {
                    let whole = y[i * model.len()..][..model.len()].iter().zip(x).map(|(y, x)| y * x).sum();
                    signals[i].push(tau[i]);
                    signals[n + i].push(whole);
                    signals[2 * n + i].push(friction_sign(qd[i], model.structure.sign_velocity));
                }
            }
            signals
        };
        let mut rigid = joined(parallel::map(&chunks(motion.len()), chunk), 3 * n);
        let sign = rigid.split_off(2 * n);
        let torque = rigid.split_off(n);
        let (inertial, mounting) = (OnceLock::new(), OnceLock::new());
        Physics { run, motion, nominal, x: x.to_vec(), rigid, torque, sign, inertial, mounting }
    }

    /// `gradient()[j][i]`: change of joint i's rigid torque per change of position j.
    pub(crate) fn gradient(&self) -> &[Vec<Vec<f64>>] {
        &self.inertial().gradient
    }

    /// `mass()[j][i]`: entry of the mass matrix of the rigid links.
    pub(crate) fn mass(&self) -> &[Vec<Vec<f64>>] {
        &self.inertial().mass
    }

    /// Made when first asked for: most of the work, and not every form needs it.
    fn inertial(&self) -> &Inertial {
        self.inertial.get_or_init(|| {
            let (arm, n) = (&self.nominal.model.arm, self.joints());
            let links = bodies(&self.x, n);
            let chunk = |(from, to): &(usize, usize)| {
                let mut ws = Workspace::new(arm);
                let (mut q, mut qd, mut qdd) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
                let (mut up, mut down, mut m) = (vec![0.0; n], vec![0.0; n], vec![0.0; n * n]);
                let mut signals = vec![Vec::with_capacity(to - from); 2 * n * n];
                for k in *from..*to {
                    self.motion.state(k, &mut q, &mut qd, &mut qdd);
                    mass_matrix(arm, &links, &mut ws, &q, &mut m);
                    for j in 0..n {
                        let at = q[j];
                        q[j] = at + STEP;
                        inverse_dynamics(arm, &links, &mut ws, &q, &qd, &qdd, &mut up);
                        q[j] = at - STEP;
                        inverse_dynamics(arm, &links, &mut ws, &q, &qd, &qdd, &mut down);
                        q[j] = at;
                        for i in 0..n {
                            signals[j * n + i].push((up[i] - down[i]) / (2.0 * STEP));
                            signals[n * n + j * n + i].push(m[i * n + j]);
                        }
                    }
                }
                signals
            };
            let mut signals = joined(parallel::map(&chunks(self.samples()), chunk), 2 * n * n).into_iter();
            let mut square = || (0..n).map(|_| signals.by_ref().take(n).collect()).collect();
            Inertial { gradient: square(), mass: square() }
        })
    }

    /// What moves a base that gives way, and what each joint feels of it; made when first asked for.
    pub(crate) fn mounting(&self) -> Option<&Mounting> {
        self.mounting.get_or_init(|| Mounting::new(self)).as_ref()
    }

    /// The torque of known effects joins that of the model.
    pub(crate) fn with_known_torque(mut self, known: &[Vec<f64>]) -> Self {
        for (torque, known) in self.torque.iter_mut().zip(known) {
            torque.iter_mut().zip(known).for_each(|(t, k)| *t += k);
        }
        self
    }

    pub(crate) fn joints(&self) -> usize {
        self.motion.joints()
    }

    /// Place of a joint's Coulomb friction in the standard vector.
    pub(crate) fn coulomb(&self, joint: usize) -> usize {
        Places::new(self.joints()).coulomb(joint)
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
    (0..joints).map(|link| std::array::from_fn(|e| x[Places::link(link).start + e])).collect()
}

/// Change of the rigid torques when joint `joint` is really at `q + δ`: `M δ̈ + ∂τ/∂q δ`, Coriolis terms of δ̇ left out.
/// Full-rate column.
pub(crate) fn displaced(physics: &Physics<'_>, joint: usize, delta: &[f64], accel: &[f64]) -> Vec<Option<Vec<f64>>> {
    (0..physics.joints())
        .map(|i| {
            let (mass, gradient) = (&physics.mass()[joint][i], &physics.gradient()[joint][i]);
            let at = |k: usize| mass[k] * accel[k] + gradient[k] * delta[k];
            Some((0..delta.len()).map(at).collect())
        })
        .collect()
}
