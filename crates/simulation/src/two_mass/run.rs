//! A run in closed loop: a controller that knows the nominal arm moves the one at hand, and what is logged of it.

use super::{Physics, TwoMassArm};
use crate::mechanics::Vector;
use crate::motion::Trajectory;
use crate::random::Random;
use rivet_dynamics::{Arm, Joints, MAX_JOINTS, Workspace, WristCoupling, friction_sign, inverse_dynamics, mass_matrix};

/// Bandwidth of the controller \[rad/s\], and the share of its cube with which errors are integrated.
const BANDWIDTH: f64 = 2.0 * core::f64::consts::PI * 5.0;
const INTEGRAL: f64 = 0.1;
/// Speed within which the controller's own friction turns over \[rad/s\].
const TURNS: f64 = 0.02;
/// Cut-off of its speed \[1/s\].
const SPEED_CUT: f64 = 2.0 * core::f64::consts::PI * 50.0;
/// The arm comes to rest under its controller for so long before anything is logged \[s\].
const SETTLE_S: f64 = 1.0;
/// Steps of a motor's thermometer \[K\].
const THERMOMETER: f64 = 0.1;

/// What the controller knows and what the sensors are like.
#[derive(Clone, Debug)]
pub struct Tracking<'a> {
    /// The nominal arm.
    pub arm: &'a Arm,
    /// Its nominal drives and friction.
    pub joints: &'a Joints,
    /// Its coupled wrist.
    pub coupling: Option<WristCoupling>,
    /// Most torque of each drive \[N·m\].
    pub torque_limit: &'a [f64],
    /// Step of the encoders \[rad\].
    pub resolution: &'a [f64],
    /// Noise of positions before they are rounded, and of torques: standard deviations \[rad, N·m\].
    pub position_noise: &'a [f64],
    /// \[N·m\].
    pub torque_noise: &'a [f64],
    /// Control period \[s\].
    pub period_s: f64,
}

/// What was logged, `[joint][sample]`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recording {
    /// \[s\].
    pub t: Vec<f64>,
    /// Encoders \[rad\].
    pub q: Vec<Vec<f64>>,
    /// Torque in force as the controller knows it, with noise \[N·m\].
    pub tau: Vec<Vec<f64>>,
    /// The same without noise.
    pub tau_clean: Vec<Vec<f64>>,
    /// Commanded motion: positions, velocities, accelerations.
    pub desired: [Vec<Vec<f64>>; 3],
    /// Motor temperatures \[°C\].
    pub temperature: Vec<Vec<f64>>,
    /// Whether the arm followed: no position ever was further than 0.5 rad off.
    pub followed: bool,
}

/// Moves `physics` along `motion` for `seconds`; noise by `seed`.
///
/// Torque changes half a period after the encoders were read, so position and torque of one sample belong to one instant.
pub fn record(physics: &Physics, knows: &Tracking<'_>, motion: &dyn Trajectory, seconds: f64, seed: u64) -> Recording {
    let n = physics.arm.dof();
    let (mut q, mut qd, mut qdd): (Vector, Vector, Vector) = ([0.0; MAX_JOINTS], [0.0; MAX_JOINTS], [0.0; MAX_JOINTS]);
    motion.sample(0.0, &mut q[..n], &mut qd[..n], &mut qdd[..n]);
    let mut arm = TwoMassArm::new(physics, &q[..n]);
    let mut controller = Controller::new(knows, &q[..n]);
    let mut random = Random::stream(seed, 0x2a);
    let empty = || vec![Vec::new(); n];
    let mut log = Recording {
        q: empty(),
        tau: empty(),
        tau_clean: empty(),
        desired: [empty(), empty(), empty()],
        temperature: empty(),
        followed: true,
        ..Recording::default()
    };
    let settle = (SETTLE_S / knows.period_s).round() as usize;
    let mut acting = [0.0; MAX_JOINTS];
    for k in 0..settle + (seconds / knows.period_s).round() as usize {
        let t = k.saturating_sub(settle) as f64 * knows.period_s;
        motion.sample(t, &mut q[..n], &mut qd[..n], &mut qdd[..n]);
        let encoders = arm.encoders();
        let mut seen = [0.0; MAX_JOINTS];
        for j in 0..n {
            let step = knows.resolution[j];
            seen[j] = ((encoders[j] + knows.position_noise[j] * random.normal()) / step).round() * step;
        }
        let noise: Vec<f64> = (0..n).map(|j| knows.torque_noise[j] * random.normal()).collect();
        if k >= settle {
            log.t.push(t);
            for j in 0..n {
                log.q[j].push(seen[j]);
                log.tau_clean[j].push(acting[j]);
                log.tau[j].push(acting[j] + noise[j]);
                log.desired[0][j].push(q[j]);
                log.desired[1][j].push(qd[j]);
                log.desired[2][j].push(qdd[j]);
                log.temperature[j].push((arm.temperatures()[j] / THERMOMETER).round() * THERMOMETER);
                log.followed &= (seen[j] - q[j]).abs() < 0.5;
            }
        }
        let next = controller.torque(&seen, [&q, &qd, &qdd]);
        arm.run(&acting[..n], 0.5 * knows.period_s);
        arm.run(&next[..n], 0.5 * knows.period_s);
        acting = next;
    }
    log
}

/// Torque of the nominal arm on the commanded motion, and PID.
struct Controller<'a> {
    knows: &'a Tracking<'a>,
    workspace: Workspace,
    /// Inertia about each joint in the first pose \[kg·m²\].
    inertia: Vec<f64>,
    before: Option<Vector>,
    speed: Vector,
    sum: Vector,
}

impl<'a> Controller<'a> {
    fn new(knows: &'a Tracking<'a>, q: &[f64]) -> Controller<'a> {
        let n = q.len();
        let mut workspace = Workspace::new(knows.arm);
        let mut mass = vec![0.0; n * n];
        mass_matrix(knows.arm, &knows.arm.links, &mut workspace, q, &mut mass);
        let inertia = (0..n).map(|j| mass[j * n + j] + knows.joints.rotor_inertia[j]).collect();
        Controller { knows, workspace, inertia, before: None, speed: [0.0; MAX_JOINTS], sum: [0.0; MAX_JOINTS] }
    }

    fn torque(&mut self, seen: &Vector, [q, qd, qdd]: [&Vector; 3]) -> Vector {
        let (n, knows) = (self.inertia.len(), self.knows);
        let mut tau = [0.0; MAX_JOINTS];
        let (arm, joints) = (knows.arm, knows.joints);
        inverse_dynamics(arm, &arm.links, &mut self.workspace, &q[..n], &qd[..n], &qdd[..n], &mut tau[..n]);
        let before = self.before.unwrap_or(*seen);
        let pace = 1.0 - (-SPEED_CUT * knows.period_s).exp();
        for j in 0..n {
            self.speed[j] += pace * ((seen[j] - before[j]) / knows.period_s - self.speed[j]);
            let (error, lag) = (q[j] - seen[j], qd[j] - self.speed[j]);
            self.sum[j] += error * knows.period_s;
            let drive = joints.rotor_inertia[j] * qdd[j]
                + joints.viscous[j] * qd[j]
                + joints.coulomb[j] * friction_sign(qd[j], TURNS);
            let w = BANDWIDTH;
            let feedback = w * w * error + 2.0 * w * lag + INTEGRAL * w.powi(3) * self.sum[j];
            tau[j] += drive + self.inertia[j] * feedback;
        }
        if let Some(WristCoupling { driving, driven }) = knows.coupling {
            let [inertia, viscous, coulomb] = joints.coupling;
            let dry = coulomb * friction_sign(qd[driving] + qd[driven], TURNS);
            tau[driving] += inertia * qdd[driven] + viscous * qd[driven] + dry;
            tau[driven] += inertia * qdd[driving] + viscous * qd[driving] + dry;
        }
        for (tau, limit) in tau.iter_mut().zip(knows.torque_limit) {
            *tau = tau.clamp(-limit, *limit);
        }
        self.before = Some(*seen);
        tau
    }
}
