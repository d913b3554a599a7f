//! Equations of motion and their integration.

use super::{Joint, Outside, Physics, ROOM, TURNS};
use crate::mechanics::Vector;
use rivet_dynamics::{Arm, MAX_JOINTS, Workspace, inverse_dynamics, mass_matrix};
use std::collections::VecDeque;

/// Steps of the integrator in a second (midpoint rule): the steepest friction here, the coupled wrist of a light arm, turns
/// over in about one of them.
const RATE: f64 = 20_000.0;
/// Damping of bristles in parts of their stiffness \[s\].
const BRISTLE_DAMPING_S: f64 = 1e-3;
/// Time constant with which motors warm up and cool down \[s\].
const WARMING_S: f64 = 15.0;
/// Distance from the flange at which a push acts \[m\].
const REACH: f64 = 0.1;

#[derive(Clone, Copy, Debug, Default)]
struct State {
    /// Links.
    q: Vector,
    qd: Vector,
    /// Motors; those of rigid joints turn with their links.
    motor: Vector,
    speed: Vector,
    /// Deflection of the bristles in parts of the one at which they slide.
    bristle: Vector,
    /// Current of the drives, as torque \[N·m\].
    current: Vector,
    /// Motor temperatures \[°C\].
    temperature: Vector,
}

/// The arm in motion. Deterministic.
#[derive(Clone, Debug)]
pub struct TwoMassArm {
    physics: Physics,
    n: usize,
    state: State,
    rate: State,
    workspace: Workspace,
    /// The arm without mass but for a kilogram beyond the flange, in a gravity that pushes set.
    kilogram: Arm,
    mass: Vec<f64>,
    /// Torque that each gear carried at the last step.
    carried: Vector,
    /// Commands under way to the current loops, the newest last.
    under_way: VecDeque<Vector>,
    step: u64,
    /// Steps in a second.
    rate_hz: f64,
}

impl TwoMassArm {
    /// At rest, motors at `q` \[rad\], warm as the room. A motor of a joint with an encoder that deceives is where the
    /// encoder says `q`.
    pub fn new(physics: &Physics, q: &[f64]) -> TwoMassArm {
        TwoMassArm::with_rate(physics, q, RATE)
    }

    /// The same with so many steps a second.
    pub fn with_rate(physics: &Physics, q: &[f64], rate_hz: f64) -> TwoMassArm {
        let n = physics.arm.dof();
        let mut state = State { temperature: [ROOM; MAX_JOINTS], ..State::default() };
        for j in 0..n {
            state.motor[j] = q[j] - physics.joints[j].encoder_offset;
        }
        state.q = state.motor;
        let mut kilogram = physics.arm.clone();
        kilogram.links.fill([0.0; 10]);
        if let Some(last) = kilogram.links.last_mut() {
            (last[0], last[3]) = (1.0, REACH);
        }
        let late = (physics.delay_s * rate_hz).round() as usize;
        TwoMassArm {
            n,
            state,
            rate: State::default(),
            workspace: Workspace::new(&physics.arm),
            kilogram,
            mass: vec![0.0; n * n],
            carried: [0.0; MAX_JOINTS],
            under_way: VecDeque::from(vec![[0.0; MAX_JOINTS]; late]),
            step: 0,
            rate_hz,
            physics: physics.clone(),
        }
    }

    /// Simulated time \[s\].
    pub fn time_s(&self) -> f64 {
        self.step as f64 / self.rate_hz
    }

    /// What ideal encoders on the motors say \[rad\].
    pub fn encoders(&self) -> Vector {
        let mut out = [0.0; MAX_JOINTS];
        for j in 0..self.n {
            let joint = &self.physics.joints[j];
            let [amplitude, phase] = joint.eccentricity;
            let angle = self.state.motor[j];
            out[j] = angle + joint.encoder_offset + amplitude * (angle + phase).sin();
        }
        out
    }

    /// Positions \[rad\] and velocities \[rad/s\] of the links.
    pub fn links(&self) -> [Vector; 2] {
        [self.state.q, self.state.qd]
    }

    /// From now on the drive of joint `j` gives `1 + gain` of the torque that it reports.
    pub fn set_drive_gain(&mut self, j: usize, gain: f64) {
        self.physics.joints[j].gain = gain;
    }

    /// From now on motor `j` has this viscous friction \[N·m·s/rad\]: brakes that drag, for instance.
    pub fn set_viscous(&mut self, j: usize, viscous: f64) {
        self.physics.joints[j].viscous = viscous;
    }

    /// Motor temperatures \[°C\].
    pub fn temperatures(&self) -> &[f64] {
        &self.state.temperature[..self.n]
    }

    /// Lets `command` \[N·m\] act on the drives for `span_s`.
    pub fn run(&mut self, command: &[f64], span_s: f64) {
        let mut wanted = [0.0; MAX_JOINTS];
        wanted[..self.n].copy_from_slice(&command[..self.n]);
        for _ in 0..(span_s * self.rate_hz).round() as usize {
            self.under_way.push_back(wanted);
            let arrives = self.under_way.pop_front().unwrap_or(wanted);
            self.advance(&arrives);
            self.step += 1;
        }
    }

    /// One step of the midpoint rule.
    fn advance(&mut self, wanted: &Vector) {
        let h = 1.0 / self.rate_hz;
        let before = self.state;
        self.derive(wanted);
        self.state = before;
        self.add(0.5 * h);
        self.derive(wanted);
        self.state = before;
        self.add(h);
        for j in 0..self.n {
            if self.physics.joints[j].gear.is_none() {
                self.state.motor[j] = self.state.q[j];
                self.state.speed[j] = self.state.qd[j];
            }
        }
    }

    fn add(&mut self, h: f64) {
        let (state, rate) = (&mut self.state, &self.rate);
        let parts = [
            (&mut state.q, &rate.q),
            (&mut state.qd, &rate.qd),
            (&mut state.motor, &rate.motor),
            (&mut state.speed, &rate.speed),
            (&mut state.bristle, &rate.bristle),
            (&mut state.current, &rate.current),
            (&mut state.temperature, &rate.temperature),
        ];
        for (x, r) in parts {
            for (x, r) in x.iter_mut().zip(r) {
                *x += h * r;
            }
        }
        // Bristles that slide are stiff: they never bend further than their level allows.
        state.bristle.iter_mut().for_each(|z| *z = z.clamp(-1.0, 1.0));
    }

    /// Rates of the present state.
    fn derive(&mut self, wanted: &Vector) {
        let n = self.n;
        let State { q, qd, motor, speed, bristle, current, temperature } = self.state;
        let (mut motors, mut links) = ([0.0; MAX_JOINTS], [0.0; MAX_JOINTS]);
        let mut rate = State { q: qd, motor: speed, ..State::default() };
        for j in 0..n {
            let joint = &self.physics.joints[j];
            let lag = self.physics.lag_s;
            rate.current[j] = if lag > 0.0 { (wanted[j] - current[j]) / lag } else { 0.0 };
            let reached = if lag > 0.0 { current[j] } else { wanted[j] };
            let given = reached.clamp(-joint.saturation, joint.saturation) * (1.0 + joint.gain);
            let other = |with: usize| q[with];
            let (friction, bending) =
                friction(joint, motor[j], speed[j], bristle[j], temperature[j], self.carried[j], other);
            rate.bristle[j] = bending;
            let [_, per_watt] = joint.warming;
            rate.temperature[j] = ((friction * speed[j]).max(0.0) * per_watt - (temperature[j] - ROOM)) / WARMING_S;
            let [amplitude, order, phase] = joint.ripple;
            motors[j] = given + amplitude * (order * motor[j] + phase).sin() - friction - joint.offset;
            let [stiffness, rest] = joint.spring;
            let [weight, at] = joint.counterbalance;
            links[j] = -stiffness * (q[j] - rest) - weight * (q[j] + at).sin() + outside(joint, q[j]);
        }
        for pair in &self.physics.coupled {
            let [a, b] = pair.joints;
            let dry = pair.coulomb * ((speed[a] + speed[b]) / TURNS).tanh() + pair.viscous * (speed[a] + speed[b]);
            motors[a] -= dry;
            motors[b] -= dry;
        }
        self.lean(&q, &mut links);
        let zero = [0.0; MAX_JOINTS];
        let mut bias = [0.0; MAX_JOINTS];
        let Physics { arm, joints, coupled, .. } = &self.physics;
        inverse_dynamics(arm, &arm.links, &mut self.workspace, &q[..n], &qd[..n], &zero[..n], &mut bias[..n]);
        mass_matrix(arm, &arm.links, &mut self.workspace, &q[..n], &mut self.mass);
        let mut pull = [0.0; MAX_JOINTS];
        for j in 0..n {
            let turned = match &joints[j].gear {
                None => {
                    self.mass[j * n + j] += joints[j].rotor_inertia;
                    motors[j]
                }
                Some(gear) => {
                    let [amplitude, order, phase] = gear.error;
                    let (sin, cos) = (order * motor[j] + phase).sin_cos();
                    let ahead = motor[j] + amplitude * sin - q[j];
                    let ahead_rate = speed[j] * (1.0 + amplitude * order * cos) - qd[j];
                    let half = 0.5 * gear.play;
                    let stretch = ahead - ahead.clamp(-half, half);
                    let pushed = gear.stiffness * stretch + gear.damping * ahead_rate;
                    // Flanks with play between them push; they do not pull.
                    let carried = if half > 0.0 && pushed * stretch <= 0.0 { 0.0 } else { pushed };
                    self.carried[j] = carried;
                    // A gear error turns torque into torque of the motor by the same lever.
                    rate.speed[j] = (motors[j] - carried * (1.0 + amplitude * order * cos)) / joints[j].rotor_inertia;
                    carried
                }
            };
            pull[j] = turned + links[j] - bias[j];
        }
        for pair in coupled {
            let [a, b] = pair.joints;
            self.mass[a * n + b] += pair.inertia;
            self.mass[b * n + a] += pair.inertia;
        }
        solve(&mut self.mass, n, &mut pull);
        rate.qd = pull;
        for j in 0..n {
            if joints[j].gear.is_none() {
                self.carried[j] = motors[j] - joints[j].rotor_inertia * pull[j];
                rate.motor[j] = qd[j];
                rate.speed[j] = pull[j];
            }
        }
        self.rate = rate;
    }

    /// Adds what pushes at the flange do to the joints: the weight of a kilogram there, were gravity the force.
    fn lean(&mut self, q: &Vector, links: &mut Vector) {
        // The middle of the step, for both of its derivatives.
        let t = self.time_s() + 0.5 / self.rate_hz;
        let n = self.n;
        for push in &self.physics.pushes {
            let into = (t - push.from_s) / push.length_s;
            if !(0.0..1.0).contains(&into) {
                continue;
            }
            let grown = (core::f64::consts::PI * into).sin();
            let kilogram = &mut self.kilogram;
            kilogram.gravity = push.force.map(|f| f * grown);
            let (zero, mut holding) = ([0.0; MAX_JOINTS], [0.0; MAX_JOINTS]);
            let (still, holds) = (&zero[..n], &mut holding[..n]);
            inverse_dynamics(kilogram, &kilogram.links, &mut self.workspace, &q[..n], still, still, holds);
            for (link, holding) in links.iter_mut().zip(holding) {
                *link -= holding;
            }
        }
    }
}

/// Friction torque against the motion \[N·m\], and the rate of the bristles \[1/s\].
fn friction(
    joint: &Joint,
    angle: f64,
    speed: f64,
    bristle: f64,
    temperature: f64,
    carried: f64,
    other: impl Fn(usize) -> f64,
) -> (f64, f64) {
    let dry = &joint.dry;
    let [excess, velocity] = dry.stribeck;
    let [amplitude, phase] = dry.position;
    let curve = if excess == 0.0 { 0.0 } else { excess * (-(speed / velocity).powi(2)).exp() };
    let entangled = match joint.outside {
        Some(Outside::Entangled { with, torque }) => torque * other(with).sin(),
        _ => 0.0,
    };
    let forwards = if speed > 0.0 { dry.forwards } else { 0.0 };
    let more = forwards + curve + dry.load * carried.abs() + amplitude * (angle + phase).sin() + entangled;
    let level = (dry.coulomb + more).max(0.0);
    let [per_kelvin, _] = joint.warming;
    let warm = 1.0 + per_kelvin * (temperature - ROOM);
    let smooth = joint.viscous * speed + joint.cubic * speed.powi(3);
    if dry.bristle > 0.0 {
        let bending = (speed - speed.abs() * bristle) / dry.bristle;
        return (warm * (level * (bristle + BRISTLE_DAMPING_S * bending) + smooth), bending);
    }
    (warm * (level * (speed / TURNS).tanh() + smooth), 0.0)
}

fn outside(joint: &Joint, q: f64) -> f64 {
    match joint.outside {
        Some(Outside::Magnet { centre, width, torque }) => {
            let x = (q - centre) / width;
            // Largest at x = 1.
            -torque * x * (0.5 - 0.5 * x * x).exp()
        }
        Some(Outside::Cable { from, stiffness }) => -stiffness * (q - from).max(0.0).powi(2),
        Some(Outside::Entangled { .. }) | None => 0.0,
    }
}

/// Solves `m x = b` in place by Cholesky's factors; `m` is symmetric, positive definite, and destroyed.
fn solve(m: &mut [f64], n: usize, b: &mut Vector) {
    for j in 0..n {
        for k in 0..j {
            let l = m[j * n + k];
            for i in j..n {
                m[i * n + j] -= m[i * n + k] * l;
            }
        }
        let root = m[j * n + j].sqrt();
        for i in j..n {
            m[i * n + j] /= root;
        }
    }
    for i in 0..n {
        for k in 0..i {
            b[i] -= m[i * n + k] * b[k];
        }
        b[i] /= m[i * n + i];
    }
    for i in (0..n).rev() {
        for k in i + 1..n {
            b[i] -= m[k * n + i] * b[k];
        }
        b[i] /= m[i * n + i];
    }
}
