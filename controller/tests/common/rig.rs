//! The controller in closed loop with a true arm: motors, gears and links with friction, that nothing but torque stops.

use super::robot_with;
use rivet_config::Robot;
use rivet_controller::Core;
use rivet_controller::law::{ControlLaw, Desired, Gains};
use rivet_dynamics::{MAX_JOINTS, Workspace, mass_matrix};
use rivet_ipc_schema::{JointState, Setpoint, StopCause};
use rivet_simulation::Random;
use rivet_simulation::two_mass::{DryFriction, Gear, Joint, Physics, Push, TwoMassArm};
use std::f64::consts::TAU;
use std::sync::Arc;

/// One value a joint.
pub(crate) type Values = [f64; MAX_JOINTS];

/// Frequency at which motors and links of a geared arm swing against each other \[Hz\], and damping ratio.
const GEAR_HZ: f64 = 80.0;
const DAMPING: f64 = 0.08;
/// A reading that is wrong by less shows in nothing that the arm does \[rad\].
const VISIBLE: f64 = 0.004;
/// Brakes drag for so long after the start, while the torque builds up \[s\], at this speed with all of the drive's torque \[rad/s\].
const BRAKED_S: f64 = 1.0;
const DRAG: f64 = 0.2;
/// Time after a stop from which on the arm is to be at rest \[s\].
const LATER_S: f64 = 1.0;
/// Time in which the planned motion grows to its full size \[s\].
const GROWTH_S: f64 = 1.0;

/// Positions, velocities and accelerations of a smooth plan that starts at rest.
#[derive(Clone, Debug)]
pub(crate) struct Swing {
    pub(crate) centre: Vec<f64>,
    pub(crate) amplitude: Vec<f64>,
    /// \[rad/s\].
    pub(crate) omega: Vec<f64>,
}

impl Swing {
    /// Swings of every joint with `share` of its speed limit at the most.
    pub(crate) fn new(robot: &Robot, share: f64) -> Swing {
        let joints = &robot.model.arm.joints;
        let (centre, amplitude) = match robot.dof() {
            2 => (vec![-0.4, 0.5], vec![0.8, 0.5]),
            _ => (vec![0.3, -1.2, 1.1, -0.9, -1.4, 0.4], vec![0.6, 0.4, 0.5, 0.5, 0.6, 0.7]),
        };
        let omega = joints.iter().zip(&amplitude).enumerate();
        // Incommensurate, so that no pose repeats.
        let omega = omega.map(|(j, (joint, a))| share * joint.velocity / a * (1.0 - 0.07 * j as f64)).collect();
        Swing { centre, amplitude, omega }
    }

    /// Deviations from the centre of joint `j`, with two derivatives.
    fn deviation(&self, j: usize, t: f64) -> [f64; 3] {
        let (a, w) = (self.amplitude[j], self.omega[j]);
        [a * (w * t).sin(), a * w * (w * t).cos(), -a * w * w * (w * t).sin()]
    }
}

/// A motion that was recorded: positions of each joint, one every `period_s`.
#[derive(Clone, Debug)]
pub(crate) struct Recorded {
    pub(crate) q: Vec<Vec<f64>>,
    pub(crate) period_s: f64,
}

impl Recorded {
    /// Deviations from the first position of joint `j`, with two derivatives by differences. Ends where the record does.
    fn deviation(&self, j: usize, t: f64) -> [f64; 3] {
        let (q, h) = (&self.q[j], self.period_s);
        let at = (t / h).clamp(1.0, (q.len() - 3) as f64);
        let (k, part) = (at as usize, at.fract());
        let value = |k: usize| q[k] + part * (q[k + 1] - q[k]);
        let (before, now, after) = (value(k - 1), value(k), value(k + 1));
        [now - q[0], (after - before) / (2.0 * h), (after - 2.0 * now + before) / (h * h)]
    }
}

/// A planned motion. It grows from rest.
#[derive(Clone, Debug)]
pub(crate) enum Motion {
    Swing(Swing),
    Recorded(Recorded),
}

impl Motion {
    /// Where the arm starts \[rad\].
    pub(crate) fn centre(&self) -> Vec<f64> {
        match self {
            Motion::Swing(swing) => swing.centre.clone(),
            Motion::Recorded(recorded) => recorded.q.iter().map(|q| q[0]).collect(),
        }
    }

    pub(crate) fn at(&self, t: f64) -> [Values; 3] {
        let mut out = [[0.0; MAX_JOINTS]; 3];
        let s = (t / GROWTH_S).min(1.0);
        let (g, gd, gdd) = (
            s * s * s * (10.0 - 15.0 * s + 6.0 * s * s),
            30.0 * s * s * (1.0 - s) * (1.0 - s) / GROWTH_S,
            60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / (GROWTH_S * GROWTH_S),
        );
        for (j, c) in self.centre().into_iter().enumerate() {
            let [x, xd, xdd] = match self {
                Motion::Swing(swing) => swing.deviation(j, t),
                Motion::Recorded(recorded) => recorded.deviation(j, t),
            };
            out[0][j] = c + g * x;
            out[1][j] = g * xd + gd * x;
            out[2][j] = g * xdd + 2.0 * gd * xd + gdd * x;
        }
        out
    }
}

/// The arm of a robot file with gears that are not stiff, where it has gears.
pub(crate) fn physics(robot: &Robot, q: &[f64]) -> Physics {
    let n = robot.dof();
    let mut mass = vec![0.0; n * n];
    let mut workspace = Workspace::new(&robot.model.arm);
    mass_matrix(&robot.model.arm, &robot.model.arm.links, &mut workspace, q, &mut mass);
    let (arm, drive, friction) = (&robot.model.arm, &robot.config.drive, &robot.config.friction);
    let joint = |j: usize| {
        let rotor = drive.rotor_inertia[j];
        // Motor and link that swing against each other: the mass of both in series.
        let (link, omega) = (mass[j * n + j], TAU * GEAR_HZ);
        let series = rotor * link / (rotor + link);
        let (stiffness, damping) = (series * omega.powi(2), 2.0 * DAMPING * series * omega);
        let gear = Gear { stiffness, damping, ..Gear::default() };
        Joint {
            rotor_inertia: rotor,
            viscous: friction.viscous[j],
            dry: DryFriction { coulomb: friction.coulomb[j], bristle: 2e-4, ..DryFriction::default() },
            gear: (rotor > 0.0).then_some(gear),
            saturation: drive.torque_limit[j],
            ..Joint::default()
        }
    };
    let joints = (0..arm.dof()).map(joint).collect();
    Physics { arm: arm.clone(), joints, coupled: Vec::new(), delay_s: 0.0, lag_s: 0.001, pushes: Vec::new() }
}

/// A load of so many kilograms 0.1 m from the last joint along each axis.
pub(crate) fn load(physics: &mut Physics, mass: f64) {
    let (c, flange) = (0.1, physics.arm.links.last_mut().expect("links"));
    let (along, across) = (2.0 * c * c, -c * c);
    for (entry, part) in flange.iter_mut().zip([1.0, c, c, c, along, across, along, across, across, along]) {
        *entry += mass * part;
    }
}

/// Friction times `factor`, and a quarter more before a joint breaks away.
pub(crate) fn friction(physics: &mut Physics, factor: f64) {
    for joint in &mut physics.joints {
        joint.dry.coulomb *= factor;
        joint.viscous *= factor;
        joint.dry.stribeck = [0.25 * joint.dry.coulomb, 0.02];
    }
}

/// What is wrong, from some moment on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Wrong {
    Nothing,
    /// No plan comes any more.
    Planless,
    /// No sample comes any more.
    Silence,
    /// The last sample comes again and again.
    Repeated,
    /// All positions and torques of the first wrong sample, with numbers and stamps that run on.
    AllFrozen,
    /// One position.
    Frozen(usize),
    /// One position, which flickers by an encoder step.
    Flickers(usize),
    /// One position, with noise of this standard deviation \[rad\].
    NoisyFrozen(usize, f64),
    /// One position is counted backwards from where it is.
    Backwards(usize),
    /// One position has the other sign.
    Negative(usize),
    /// All positions and torques are those of so many seconds ago.
    Late(f64),
    /// The delay of all positions grows by so many seconds a second, up to so many seconds.
    LaterAndLater(f64, f64),
    /// The way of one position from where it is is multiplied by a factor.
    Scaled(usize, f64),
    /// One position drifts by so many rad/s.
    Drift(usize, f64),
    /// One position drifts, faster by so many rad/s a second.
    DriftGrows(usize, f64),
    /// One position is so far off.
    Jump(usize, f64),
    /// A position is not a number.
    NotFinite(usize),
    /// A position that no arm has.
    Implausible(usize),
    /// One joint fewer.
    Shape,
    /// The robot controller reports a fault of its own.
    FaultBits,
    /// A measured torque has the other sign.
    TorqueSign(usize),
    /// A measured torque stays as it is.
    TorqueStuck(usize),
    /// A measured torque is that of its drive's limit.
    TorqueAtLimit(usize),
    /// A drive gives this share of the commanded torque.
    Drive(usize, f64),
    /// The stamps say that samples come at another rate.
    Rate(f64),
}

/// How a run went.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Outcome {
    /// Why the arm was stopped, on which joints, and how long after the first wrong sample \[s\].
    pub(crate) stop: Option<(StopCause, u32, f64)>,
    /// Highest speed of a link from the first wrong sample on, in parts of the joint's limit.
    pub(crate) speed: f64,
    /// Farthest from the plan before the stop, and from where the plan was at the stop after it \[rad\].
    pub(crate) away: f64,
    /// Highest speed in the last tenth of a second \[rad/s\].
    pub(crate) rest: f64,
    /// The highest speed from a second after the stop on, in parts of the joint's limit, and the way since then \[rad\].
    pub(crate) later_speed: f64,
    pub(crate) later_way: f64,
    /// Stops.
    pub(crate) stops: u64,
    /// From the first wrong sample until a position is wrong by more than 4 mrad \[s\].
    pub(crate) visible_s: f64,
}

/// One run.
pub(crate) struct Rig {
    pub(crate) robot: Robot,
    pub(crate) core: Core,
    motion: Motion,
    /// Every so many samples one is lost.
    pub(crate) lossy: Option<u64>,
    /// Each sample comes twice.
    pub(crate) doubled: bool,
    /// Encoders are read every so many samples.
    pub(crate) refresh: u64,
    /// Added to the numbers of setpoints from the first wrong one on.
    pub(crate) leap: u64,
    leaping: u64,
    /// Distances are those from the plan that `bend` has changed, not from the one before.
    pub(crate) bend_is_planned: bool,
    /// Positions and velocities of the plan are those of the arm from the first wrong setpoint on.
    pub(crate) from_measured: bool,
    largest_step: f64,
    law: Option<LawAlone>,
    planless: bool,
    physics: Physics,
    arm: TwoMassArm,
    random: Random,
    fault_noise: Random,
    seq: u64,
    acting: Values,
    states: Vec<JointState>,
}

impl Rig {
    /// `arm` with samples every `period_s`, and `words` in its `[controller]` section.
    pub(crate) fn new(arm: &str, period_s: f64, words: &str, share: f64) -> Rig {
        let period = format!("sample_period_s = {period_s}");
        let controller = format!("[controller]\n{words}");
        let mut changes = vec![("sample_period_s = 0.001", period.as_str()), ("[controller]\n", &controller)];
        if period_s > 0.001 {
            changes.extend([("decimation = 20", "decimation = 5")]);
            if arm == "ur10e" {
                changes.push(("half_width = 25", "half_width = 6"));
            }
        }
        let robot = robot_with(arm, &changes);
        let motion = Motion::Swing(Swing::new(&robot, share));
        Rig::of(robot, motion)
    }

    /// The arm of a robot file with a motion.
    pub(crate) fn of(robot: Robot, motion: Motion) -> Rig {
        let physics = physics(&robot, &motion.centre());
        Rig {
            core: Core::new(&robot, 0).expect("sound settings"),
            arm: TwoMassArm::new(&physics, &motion.centre()),
            random: Random::stream(1, 7),
            fault_noise: Random::stream(2, 7),
            seq: 0,
            acting: [0.0; MAX_JOINTS],
            states: Vec::new(),
            lossy: None,
            doubled: false,
            refresh: 1,
            leap: 0,
            leaping: 0,
            bend_is_planned: false,
            from_measured: false,
            largest_step: 0.0,
            law: None,
            planless: false,
            physics,
            robot,
            motion,
        }
    }

    /// The same with a force on the flange.
    pub(crate) fn pushed(self, push: Push) -> Rig {
        self.differing(|physics| physics.pushes.push(push))
    }

    /// The same with an arm that is not the one of the robot file.
    pub(crate) fn differing(mut self, change: impl FnOnce(&mut Physics)) -> Rig {
        change(&mut self.physics);
        self.arm = TwoMassArm::new(&self.physics, &self.motion.centre());
        self
    }

    /// Where the plan is after so many seconds of a run \[rad\].
    pub(crate) fn planned(&self, sound_s: f64) -> Values {
        self.motion.at(sound_s)[0]
    }

    /// Where the arm is \[rad\].
    pub(crate) fn position(&self) -> Values {
        self.arm.links()[0]
    }

    /// Largest step of a command, in parts of the largest that is permitted.
    pub(crate) fn largest_step(&self) -> f64 {
        self.largest_step
    }

    pub(crate) fn period_s(&self) -> f64 {
        self.robot.config.sample_period_s
    }

    fn sample(&mut self) -> JointState {
        let (n, seq) = (self.robot.dof(), self.seq);
        let mut sample = JointState { seq, joints: n as u32, ..JointState::default() };
        sample.stamp_ns = (seq as f64 * self.period_s() * 1e9) as u64;
        let config = &self.robot.config;
        let encoders = self.arm.encoders();
        for j in 0..n {
            let (step, noise) = (config.drive.encoder_resolution[j], config.simulation.position_noise[j]);
            sample.q[j] = ((encoders[j] + noise * self.random.normal()) / step).round() * step;
            if let Some(last) = self.states.last().filter(|_| !seq.is_multiple_of(self.refresh)) {
                sample.q[j] = last.q[j];
            }
            sample.tau[j] = self.acting[j] + config.simulation.torque_noise[j] * self.random.normal();
        }
        sample
    }

    /// The sample with its fault, `k` periods after the first wrong one; `None` where none comes.
    fn spoilt(&mut self, sample: &JointState, wrong: Wrong, k: usize) -> Option<JointState> {
        let mut seen = *sample;
        let (noise, since_s) = (self.fault_noise.normal(), (k + 1) as f64 * self.period_s());
        let ago = |samples: usize| self.states.get(self.states.len().saturating_sub(samples + 1)).unwrap_or(sample);
        // The last sound sample: the present one is not among them yet.
        let before = ago(k);
        match wrong {
            Wrong::Nothing | Wrong::Planless | Wrong::Drive(..) => {}
            Wrong::Silence => return None,
            Wrong::Repeated => seen = *before,
            Wrong::AllFrozen => (seen.q, seen.tau) = (before.q, before.tau),
            Wrong::Frozen(j) => seen.q[j] = before.q[j],
            Wrong::NoisyFrozen(j, deviation) => {
                let step = self.robot.config.drive.encoder_resolution[j];
                seen.q[j] = ((before.q[j] + deviation * noise) / step).round() * step;
            }
            Wrong::Flickers(j) => {
                seen.q[j] = before.q[j] + f64::from(k as u32 % 2) * self.robot.config.drive.encoder_resolution[j];
            }
            Wrong::Backwards(j) => seen.q[j] = 2.0 * before.q[j] - sample.q[j],
            Wrong::Negative(j) => seen.q[j] = -sample.q[j],
            Wrong::Scaled(j, factor) => seen.q[j] = before.q[j] + factor * (sample.q[j] - before.q[j]),
            Wrong::Drift(j, by) => seen.q[j] += by * since_s,
            Wrong::DriftGrows(j, by) => seen.q[j] += 0.5 * by * since_s * since_s,
            Wrong::Late(by) => {
                let old = ago((by / self.period_s()).round() as usize - 1);
                (seen.q, seen.tau) = (old.q, old.tau);
            }
            Wrong::LaterAndLater(rate, most_s) => {
                let ago_samples = (rate * since_s).min(most_s) / self.period_s();
                let (whole, part) = (ago_samples as usize, ago_samples.fract());
                // The present sample is not among them yet.
                let at = |k: usize| if k == 0 { sample } else { ago(k - 1) };
                let (late, later) = (at(whole), at(whole + 1));
                seen.tau = late.tau;
                for j in 0..self.robot.dof() {
                    seen.q[j] = late.q[j] + part * (later.q[j] - late.q[j]);
                }
            }
            Wrong::Jump(j, by) => seen.q[j] += by,
            Wrong::NotFinite(j) => seen.q[j] = f64::NAN,
            Wrong::Implausible(j) => seen.q[j] = 1e300,
            Wrong::Shape => seen.joints -= 1,
            Wrong::FaultBits => seen.faults = rivet_ipc_schema::faults::ENCODER,
            Wrong::TorqueSign(j) => seen.tau[j] = -sample.tau[j],
            Wrong::TorqueStuck(j) => seen.tau[j] = before.tau[j],
            Wrong::TorqueAtLimit(j) => seen.tau[j] = self.robot.config.drive.torque_limit[j],
            Wrong::Rate(factor) => {
                let since = (k + 1) as f64 * self.period_s() * 1e9 * factor;
                seen.stamp_ns = before.stamp_ns + since as u64;
            }
        }
        Some(seen)
    }

    /// Lets the controller answer, with a plan that `bend` may change.
    fn answer(&mut self, seen: Option<JointState>, plan: &[Values; 3], lost: u64) -> bool {
        if let Some(law) = &mut self.law {
            law.answer(seen.as_ref(), plan, &mut self.acting);
            self.arm.run(&self.acting[..self.robot.dof()], self.period_s());
            return seen.is_some();
        }
        let n = self.robot.dof();
        let mut setpoint = Setpoint { seq: self.seq + self.leaping, joints: n as u32, ..Setpoint::default() };
        [setpoint.q, setpoint.qd, setpoint.qdd] = *plan;
        if !self.planless {
            self.core.offer_setpoint(&setpoint);
        }
        if let Some(seen) = seen.filter(|_| self.doubled) {
            self.core.observe(&seen);
        }
        let answered = seen.and_then(|seen| self.core.tick(&seen).ok());
        let command = answered.or_else(|| self.core.missing(lost + 1));
        let before = self.acting;
        if let Some(command) = command {
            self.acting = command.tau;
        }
        for (j, limit) in self.robot.config.drive.torque_limit.iter().enumerate() {
            let most = 10.0 * limit * self.period_s();
            self.largest_step = self.largest_step.max((self.acting[j] - before[j]).abs() / most);
        }
        // A command acts half a period after its sample.
        let half_s = 0.5 * self.period_s();
        self.arm.run(&before[..n], half_s);
        self.arm.run(&self.acting[..n], half_s);
        answered.is_some()
    }

    /// Seconds since the brakes opened.
    fn time_s(&self) -> f64 {
        (self.seq as f64 * self.period_s() - BRAKED_S).max(0.0)
    }

    /// Builds up the torque while brakes drag, then opens them.
    fn release(&mut self) {
        let limits = self.robot.config.drive.torque_limit.clone();
        for (j, limit) in limits.iter().enumerate() {
            self.arm.set_viscous(j, limit / DRAG);
        }
        while (self.seq as f64) < BRAKED_S / self.period_s() {
            self.seq += 1;
            let mut sample = self.sample();
            sample.faults = rivet_ipc_schema::faults::STOPPED;
            let plan = self.motion.at(0.0);
            self.answer(Some(sample), &plan, 0);
        }
        for j in 0..self.robot.dof() {
            self.arm.set_viscous(j, self.physics.joints[j].viscous);
        }
    }

    /// Moves soundly for `sound_s`, then `wrong` acts for `wrong_s` and the plan is changed by `bend` of the seconds since.
    pub(crate) fn run(
        &mut self,
        sound_s: f64,
        wrong: Wrong,
        wrong_s: f64,
        bend: impl Fn(f64, &mut [Values; 3]),
    ) -> Outcome {
        let (n, period_s) = (self.robot.dof(), self.period_s());
        let sound = (sound_s / period_s).round() as usize;
        let all = sound + (wrong_s / period_s).round() as usize;
        let mut out = Outcome {
            stop: None,
            speed: 0.0,
            away: 0.0,
            rest: 0.0,
            later_speed: 0.0,
            later_way: 0.0,
            stops: 0,
            visible_s: f64::NAN,
        };
        self.release();
        let (mut lost, mut at_stop) = (0, None);
        let mut rested: Option<Values> = None;
        for k in 0..all {
            self.seq += 1;
            let t = self.time_s();
            let mut plan = self.motion.at(t);
            let sample = self.sample();
            if k >= sound
                && let Wrong::Drive(j, share) = wrong
            {
                self.arm.set_drive_gain(j, share - 1.0);
            }
            self.planless = k >= sound && wrong == Wrong::Planless;
            self.leaping = if k >= sound { self.leap } else { 0 };
            if k >= sound && self.from_measured {
                let [q, qd] = self.arm.links();
                (plan[0], plan[1]) = (q, qd);
            }
            if k >= sound {
                bend((k - sound) as f64 * period_s, &mut plan);
            }
            let seen = if k >= sound { self.spoilt(&sample, wrong, k - sound) } else { Some(sample) };
            self.states.push(sample);
            if let Some(seen) = seen.filter(|_| k >= sound && out.visible_s.is_nan()) {
                let off = (0..n).map(|j| (seen.q[j] - sample.q[j]).abs()).fold(0.0, f64::max);
                if off > VISIBLE {
                    out.visible_s = (k - sound) as f64 * period_s;
                }
            }
            let seen = seen.filter(|_| self.lossy.is_none_or(|every| !self.seq.is_multiple_of(every)));
            let answered = self.answer(seen, &plan, lost);
            lost = if answered { 0 } else { lost + 1 };
            let [links, speeds] = self.arm.links();
            if k < sound {
                assert!(
                    self.core.stop_cause().is_none(),
                    "stopped without a fault at {t} s: {:?}",
                    self.core.stop_cause()
                );
                continue;
            }
            let planned = if self.bend_is_planned { plan[0] } else { self.motion.at(t)[0] };
            if let (None, Some((cause, joints))) = (out.stop, self.core.stop_cause()) {
                out.stop = Some((cause, joints, (k - sound) as f64 * period_s));
                at_stop = Some(planned);
            }
            let target = at_stop.unwrap_or(planned);
            let since_s = out.stop.map_or(0.0, |(.., delay_s)| (k - sound) as f64 * period_s - delay_s);
            if since_s >= LATER_S && rested.is_none() {
                rested = Some(links);
            }
            for j in 0..n {
                let speed = speeds[j].abs();
                if let Some(rested) = &rested {
                    out.later_speed = out.later_speed.max(speed / self.robot.model.arm.joints[j].velocity);
                    out.later_way = out.later_way.max((links[j] - rested[j]).abs());
                }
                out.speed = out.speed.max(speed / self.robot.model.arm.joints[j].velocity);
                out.away = out.away.max((links[j] - target[j]).abs());
                if (all - k) as f64 * period_s <= 0.1 {
                    out.rest = out.rest.max(speed);
                }
            }
        }
        out.stops = self.core.counts().stops;
        out
    }
}

/// The control law of the robot file with its velocity filter and torque limits, and no checks.
struct LawAlone {
    law: ControlLaw,
    x: Vec<f64>,
    limits: Vec<f64>,
    weight: f64,
    period_s: f64,
    last: Option<Values>,
    speed: Values,
}

impl LawAlone {
    fn new(robot: &Robot) -> LawAlone {
        let (settings, period_s) = (&robot.config.controller, robot.config.sample_period_s);
        let gains = Gains::from_bandwidth(&settings.bandwidth_hz, settings.damping, settings.integral_hz);
        let x = robot.base_parameters().to_vec();
        let (model, base) = (Arc::clone(&robot.model), Arc::clone(&robot.base));
        LawAlone {
            law: ControlLaw::new(settings.law, model, base, &x, gains, period_s),
            x,
            limits: robot.config.drive.torque_limit.clone(),
            weight: 1.0 - (-TAU * settings.velocity_filter_hz * period_s).exp(),
            period_s,
            last: None,
            speed: [0.0; MAX_JOINTS],
        }
    }

    /// The last torque stays where there is no sample.
    fn answer(&mut self, seen: Option<&JointState>, plan: &[Values; 3], tau: &mut Values) {
        let (Some(seen), n) = (seen, self.limits.len()) else { return };
        let last = self.last.replace(seen.q).unwrap_or(seen.q);
        for j in 0..n {
            self.speed[j] += self.weight * ((seen.q[j] - last[j]) / self.period_s - self.speed[j]);
        }
        let desired = Desired { q: plan[0], qd: plan[1], qdd: plan[2] };
        self.law.torque(&seen.q[..n], &self.speed[..n], &desired, &self.x, &mut tau[..n]);
        for (tau, limit) in tau.iter_mut().zip(&self.limits) {
            *tau = tau.clamp(-limit, *limit);
        }
    }
}

/// A run of [`Rig::run`] under the law alone, with the distance from the plan as it goes on.
pub(crate) fn unchecked(rig: &mut Rig, sound_s: f64, wrong: Wrong, wrong_s: f64) -> Outcome {
    rig.law = Some(LawAlone::new(&rig.robot));
    rig.run(sound_s, wrong, wrong_s, |_, _| ())
}
