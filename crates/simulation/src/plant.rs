//! The simulated arm with its drives, brakes and sensors, one control period at a time.

use crate::friction::{Element, Friction, FrictionLaw};
use crate::integrator::{State, acceleration, advance};
use crate::mechanics::{Mechanics, Vector};
use crate::sensors::{Measurement, Readout, Sensors};
use crate::truth::Truth;
use rivet_dynamics::{EffectKind, KnownEffect, MAX_JOINTS, WristCoupling};
use std::collections::VecDeque;

/// How the plant is simulated.
#[derive(Clone, Debug, PartialEq)]
pub struct PlantSettings {
    /// Control period \[s\].
    pub period_s: f64,
    /// Most that each drive gives, at the joint \[N·m\]; commands beyond are cut.
    pub torque_limit: Vec<f64>,
    /// Dry friction.
    pub friction: FrictionLaw,
    /// Runge-Kutta steps in a period; more are taken where a smooth friction law is stiff.
    pub steps: usize,
    /// Time from latching the encoders until the torque computed from them acts, as a share of the period, in [0, 1).
    pub latency: f64,
}

impl PlantSettings {
    /// Exact dry friction, steps of half a millisecond, and torque that changes half a period after the encoders were
    /// latched.
    ///
    /// That half period is what a controller needs to compute and a field bus to carry the command. It also puts each
    /// sample into the middle of the time for which its torque acts, so that position differences and torque of one sample
    /// belong to the same instant.
    pub fn new(period_s: f64, torque_limit: &[f64]) -> Self {
        let steps = ((period_s / 0.0005).round() as usize).max(1);
        Self { period_s, torque_limit: torque_limit.to_vec(), friction: FrictionLaw::Stick, steps, latency: 0.5 }
    }
}

/// Torque of a closed brake as a multiple of the drive's limit.
const BRAKE: f64 = 2.0;

/// The plant. Deterministic: the same truth, settings, seed and torques give the same bits.
#[derive(Clone, Debug)]
pub struct Plant {
    mechanics: Mechanics,
    friction: Friction,
    readout: Readout,
    sensors: Sensors,
    truth: Truth,
    settings: PlantSettings,
    state: State,
    /// Torque in force at the joints \[N·m\].
    applied: Vector,
    /// What the drives report: the command, after their limits.
    drive: Drive,
    braked: bool,
    seq: u64,
    steps: usize,
    saturated: [u64; MAX_JOINTS],
}

impl Plant {
    /// The arm `truth` at rest at zero, brakes open, with no torque.
    pub fn new(truth: &Truth, sensors: &Sensors, settings: &PlantSettings, seed: u64) -> Self {
        let n = truth.arm.dof();
        let mut elements: Vec<Element> = (0..n).map(|j| Element::new(j, None, truth.joints.coulomb[j])).collect();
        if let Some(WristCoupling { driving, driven }) = truth.structure.coupling {
            elements.push(Element::new(driving, Some(driven), truth.joints.coupling[2]));
        }
        let mut mechanics = Mechanics::new(truth);
        for element in elements.iter_mut().filter(|e| e.b.is_none()) {
            element.varies = mechanics.has_dry(element.a);
        }
        let steps = settings.steps.max(stable_steps(truth, &mut mechanics, &elements, settings));
        let mut plant = Self {
            friction: Friction::new(elements, settings.friction),
            mechanics,
            readout: Readout::new(sensors, truth, seed),
            sensors: sensors.clone(),
            truth: truth.clone(),
            settings: settings.clone(),
            state: State { q: [0.0; MAX_JOINTS], qd: [0.0; MAX_JOINTS] },
            applied: [0.0; MAX_JOINTS],
            drive: Drive::new(truth, settings),
            braked: false,
            seq: 0,
            steps,
            saturated: [0; MAX_JOINTS],
        };
        plant.set_brake(false);
        plant
    }

    /// Joint count.
    pub fn dof(&self) -> usize {
        self.mechanics.dof()
    }

    /// Runge-Kutta steps taken in a period.
    pub fn steps(&self) -> usize {
        self.steps
    }

    /// Puts the arm to `q` \[rad\] with velocity `qd` \[rad/s\]; no torque acts.
    pub fn place(&mut self, q: &[f64], qd: &[f64]) {
        let n = self.dof();
        self.state.q[..n].copy_from_slice(&q[..n]);
        self.state.qd[..n].copy_from_slice(&qd[..n]);
        self.applied.fill(0.0);
        self.drive.clear();
        self.set_brake(self.braked);
    }

    /// Starts the noise anew from `seed`.
    pub fn reseed(&mut self, seed: u64) {
        self.readout = Readout::new(&self.sensors, &self.truth, seed);
    }

    /// The arm becomes `truth` where it stands or moves: it has grasped or let go of a payload. Position and velocity stay,
    /// as if the payload had moved along already; dry friction keeps the levels the plant was made with.
    pub fn become_loaded(&mut self, truth: &Truth) {
        self.mechanics = Mechanics::new(truth);
    }

    /// Closes or opens the brakes of all joints. A closed brake is dry friction of twice the drive's limit; the drives of a
    /// braked arm are off.
    pub fn set_brake(&mut self, closed: bool) {
        let mut brake = [0.0; MAX_JOINTS];
        if closed {
            for (torque, limit) in brake.iter_mut().zip(&self.settings.torque_limit) {
                *torque = BRAKE * limit;
            }
        }
        self.braked = closed;
        self.friction.set_brake(&brake, &self.state.qd);
    }

    /// Whether the brakes are closed.
    pub fn braked(&self) -> bool {
        self.braked
    }

    /// True positions \[rad\].
    pub fn q(&self) -> &[f64] {
        &self.state.q[..self.dof()]
    }

    /// True velocities \[rad/s\].
    pub fn qd(&self) -> &[f64] {
        &self.state.qd[..self.dof()]
    }

    /// Torque in force at the joints \[N·m\].
    pub fn applied(&self) -> &[f64] {
        &self.applied[..self.dof()]
    }

    /// In how many periods each drive was at its limit.
    pub fn saturated(&self) -> &[u64] {
        &self.saturated[..self.dof()]
    }

    /// True accelerations under the torque in force \[rad/s²\].
    pub fn qdd(&mut self) -> Vector {
        acceleration(&mut self.mechanics, &self.friction, &self.state, &self.applied)
    }

    /// Kinetic and potential energy \[J\].
    pub fn energy(&mut self) -> (f64, f64) {
        self.mechanics.energy(&self.state.q, &self.state.qd)
    }

    /// Simulated time \[s\].
    pub fn time_s(&self) -> f64 {
        self.seq as f64 * self.settings.period_s
    }

    /// Latches the sensors. Draws noise: once a period.
    pub fn measure(&mut self) -> Measurement {
        self.readout.read(self.seq, self.time_s(), self.mechanics.dof(), &self.state.q, &self.drive.reported)
    }

    /// Goes on by one period: the torque in force acts until the latency is over, then `command` \[N·m\] does.
    pub fn step(&mut self, command: &[f64]) {
        let n = self.dof();
        let before = self.drive.share * self.settings.period_s;
        self.run(before);
        for j in 0..n {
            let limit = self.settings.torque_limit[j];
            let wanted = if self.braked || !command[j].is_finite() { 0.0 } else { command[j] };
            self.drive.reported[j] = wanted.clamp(-limit, limit);
            self.saturated[j] += u64::from(wanted.abs() > limit);
        }
        self.applied = self.drive.deliver();
        self.run(self.settings.period_s - before);
        self.seq += 1;
    }

    fn run(&mut self, span_s: f64) {
        let steps = (span_s / self.settings.period_s * self.steps as f64).ceil();
        for _ in 0..steps as usize {
            advance(&mut self.mechanics, &mut self.friction, &mut self.state, &self.applied, span_s / steps);
        }
    }
}

/// From what the drives report to what they give: late, lagging, cut, and with another torque constant, where the arm has
/// such effects.
#[derive(Clone, Debug)]
struct Drive {
    /// Commands of this period, after the drives' limits \[N·m\].
    reported: Vector,
    /// Share of a period after the latch at which torque changes.
    share: f64,
    /// Commands on their way, the newest last; as many as there are whole periods of delay.
    under_way: VecDeque<Vector>,
    /// What the current loop has come to, and how far it comes in a period.
    current: Vector,
    pace: f64,
    limit: Vector,
    /// Given torque per reported torque.
    gain: Vector,
}

impl Drive {
    fn new(truth: &Truth, settings: &PlantSettings) -> Drive {
        let (mut limit, mut gain) = ([f64::INFINITY; MAX_JOINTS], [1.0; MAX_JOINTS]);
        let (mut delay, mut lag) = (0.0, 0.0);
        for KnownEffect { kind, joint, values: [size, ..] } in &truth.effects {
            match kind {
                EffectKind::TorqueSaturation => limit[*joint] = *size,
                EffectKind::TorqueConstant => gain[*joint] = 1.0 / (1.0 + size),
                EffectKind::TransportDelay => delay = *size,
                EffectKind::CurrentLoopLag => lag = *size,
                _ => {}
            }
        }
        let late = settings.latency + delay / settings.period_s;
        let pace = if lag > 0.0 { 1.0 - (-settings.period_s / lag).exp() } else { 1.0 };
        Drive {
            reported: [0.0; MAX_JOINTS],
            share: late.fract(),
            under_way: VecDeque::from(vec![[0.0; MAX_JOINTS]; late as usize]),
            current: [0.0; MAX_JOINTS],
            pace,
            limit,
            gain,
        }
    }

    fn clear(&mut self) {
        self.reported.fill(0.0);
        self.current.fill(0.0);
        self.under_way.iter_mut().for_each(|v| v.fill(0.0));
    }

    /// Takes in what was reported and gives what acts from now on.
    fn deliver(&mut self) -> Vector {
        // As long before as after: a ring.
        self.under_way.push_back(self.reported);
        let arrives = self.under_way.pop_front().unwrap_or(self.reported);
        let mut given = [0.0; MAX_JOINTS];
        for j in 0..MAX_JOINTS {
            let gap = arrives[j] - self.current[j];
            self.current[j] = if self.pace < 1.0 { self.current[j] + self.pace * gap } else { arrives[j] };
            given[j] = self.gain[j] * self.current[j].clamp(-self.limit[j], self.limit[j]);
        }
        given
    }
}

/// Steps a period that keep Runge-Kutta stable under smooth friction, whose slope at rest is `level / velocity`.
///
/// The eigenvalues of `M⁻¹ F`, F the slopes, are at most its trace; the stability limit on the real axis is 2.78. M is
/// looked at in poses spread over the joint ranges.
fn stable_steps(truth: &Truth, mechanics: &mut Mechanics, elements: &[Element], settings: &PlantSettings) -> usize {
    let FrictionLaw::Smooth { velocity } = settings.friction else { return 1 };
    let mut random = crate::random::Random::new(0);
    let mut fastest = 0.0_f64;
    for _ in 0..64 {
        let mut q = [0.0; MAX_JOINTS];
        for (q, joint) in q.iter_mut().zip(&truth.arm.joints) {
            *q = random.uniform(joint.lower.max(-3.2), joint.upper.min(3.2));
        }
        mechanics.factor(&q, &[0.0; MAX_JOINTS]);
        let rate: f64 = elements.iter().map(|e| e.mobility(mechanics) * e.coulomb / velocity).sum();
        fastest = fastest.max(rate);
    }
    (1.1 * fastest * settings.period_s / 2.0).ceil() as usize
}
