//! What live parameters are worth to the controller: rms tracking error with wrong nominal parameters, with live ones and
//! with the true ones, at equal gains, on the same motion.
//!
//! The loop is closed in one thread by the pure cores that the processes run: plant, `rivetd`'s core, the controller's
//! core. Equal inputs give equal bits.

use rivet_config::Robot;
use rivet_controller::Core as Controller;
use rivet_controller::gate::{Refusal, refusal_text};
use rivet_daemon::Core as Daemon;
use rivet_dynamics::{Arm, Joints, MAX_JOINTS, Model};
use rivet_estimation::SettingsError;
use rivet_ipc_schema::{ControllerHealth, JointState, ParameterSource, Parameters, Setpoint, faults};
use rivet_simulation::motion::{Fourier, FourierSettings, LARGEST_LOAD, MotionLimits, Trajectory, load_ratio};
use rivet_simulation::process::nominal_joints;
use rivet_simulation::{BUILD_UP_S, Disturbances, FrictionLaw, Payload, Plant, PlantSettings, Random, Sensors, Truth};
use serde_json::{Value, json};
use std::fmt;
use std::sync::Arc;

/// Arms of the table with 60 % of their rated payload \[kg\] (15, 2.3 and 12.5 kg).
pub const ARMS: [(&str, f64); 3] = [("manutec-r3", 9.0), ("staubli-tx40", 1.38), ("ur10e", 7.5)];

/// Centre of the payload in the last joint's frame \[m\].
const PAYLOAD_COM: [f64; 3] = [0.0, 0.0, 0.1];

/// Base frequency of the motion \[Hz\]; errors are taken over one period of it.
const BASE_HZ: f64 = 0.15;

/// Share of the arm's speed limits that the motion uses.
const SPEED: f64 = 0.8;

/// Windows of the estimator until the error with live parameters is taken, after the start and after the change.
const WINDOWS: [f64; 2] = [3.0, 2.0];

/// Share of the torque limits that the motion needs at most with the payload.
const LOADED: f64 = 0.95;

/// Factor by which each body of the nominal arm is too heavy or too light.
const BODIES: f64 = 0.2;

/// Which parameters the controller has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Knowledge {
    /// The wrong ones of its robot file.
    Nominal,
    /// The wrong ones until the daemon publishes better ones.
    Live,
    /// The plant's own.
    True,
}

/// Rms tracking error of each joint \[rad\] with each kind of parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct Errors {
    /// What the arm carries \[kg\].
    pub payload: f64,
    /// With the robot file's wrong parameters.
    pub nominal: Vec<f64>,
    /// With live ones.
    pub live: Vec<f64>,
    /// With the true ones.
    pub truth: Vec<f64>,
    /// Largest distance of a joint from the plan \[rad\] with the robot file's parameters: from standstill, over one period.
    pub farthest: f64,
}

impl Errors {
    /// Error with live parameters over that with nominal and with true ones, root mean square over the joints.
    pub fn ratios(&self) -> (f64, f64) {
        (total(&self.live) / total(&self.nominal), total(&self.live) / total(&self.truth))
    }
}

/// The same over all joints.
fn total(joints: &[f64]) -> f64 {
    (joints.iter().map(|x| x * x).sum::<f64>() / joints.len() as f64).sqrt()
}

/// The table of one arm.
#[derive(Clone, Debug, PartialEq)]
pub struct Tracking {
    /// The arm.
    pub robot: String,
    /// Window of the estimator \[s\].
    pub window_s: f64,
    /// With the unknown payload from the start, and two windows after it was let go of in motion.
    pub phases: [Errors; 2],
    /// Sets that passed the controller's gate, and sets that did not.
    pub sets: (u64, u64),
    /// How many of those were refused for which reason.
    pub refusals: Vec<(Refusal, u64)>,
    /// How often the daemon saw the arm change.
    pub changes: u64,
    /// Motion until live parameters were first in use \[s\].
    pub adopted_s: Option<f64>,
    /// Largest distance of a joint from the plan \[rad\] with live parameters, from the first sample on: while they are learnt
    /// and when the payload goes as well.
    pub farthest: f64,
}

impl Tracking {
    /// Whether live parameters track with at most a quarter of the error of nominal ones and 1.15 of that of true ones, in both
    /// phases, and never lead the arm further from its plan than nominal ones do, but for a quarter.
    pub fn keeps_bounds(&self) -> bool {
        self.phases.iter().map(Errors::ratios).all(|(nominal, truth)| nominal <= 0.25 && truth <= 1.15)
            && self.farther() <= 1.25
    }

    /// The table as JSON. Tracking errors are root mean squares of each joint \[rad\].
    pub fn to_json(&self) -> Value {
        let phase = |errors: &Errors| {
            let (over_nominal, over_true) = errors.ratios();
            json!({
                "payload_kg": errors.payload, "nominal_rad": errors.nominal, "live_rad": errors.live, "true_rad": errors.truth,
                "live_over_nominal": over_nominal, "live_over_true": over_true, "farthest_nominal_rad": errors.farthest,
            })
        };
        let refusals = self.refusals.iter().map(|(why, count)| (format!("{why:?}"), json!(count)));
        json!({
            "robot": self.robot, "window_s": self.window_s, "phases": self.phases.iter().map(phase).collect::<Vec<_>>(),
            "sets_accepted": self.sets.0, "sets_refused": self.sets.1,
            "refusals": refusals.collect::<serde_json::Map<_, _>>(), "changes": self.changes, "adopted_s": self.adopted_s,
            "farthest_live_rad": self.farthest, "keeps_bounds": self.keeps_bounds(),
        })
    }

    /// Largest distance from the plan with live parameters over that with nominal ones.
    pub fn farther(&self) -> f64 {
        self.farthest / self.phases.iter().fold(0.0, |most: f64, errors| most.max(errors.farthest))
    }
}

/// Runs the three controllers on `robot` with an unknown payload \[kg\] at its flange, which it lets go of in mid motion.
///
/// # Errors
/// Settings of the robot file that the estimator cannot work with.
pub fn tracking(robot: &Robot, payload: f64, seed: u64) -> Result<Tracking, SettingsError> {
    let window_s = robot.config.estimator.window_s.unwrap_or(10.0);
    let study = Study::new(robot, payload, seed);
    let period = 1.0 / BASE_HZ;
    let begin = WINDOWS[0] * window_s;
    let change = begin + period;
    let again = change + WINDOWS[1] * window_s;
    let live = study.run(Knowledge::Live, 0, Some(change), &[begin, again])?;
    // The motion repeats: one period is as good as another, and these controllers do not learn.
    let steady = |knowledge, phase| study.run(knowledge, phase, None, &[period]);
    let phase = |phase: usize| -> Result<Errors, SettingsError> {
        let nominal = steady(Knowledge::Nominal, phase)?;
        Ok(Errors {
            payload: study.payloads[phase],
            nominal: nominal.errors[0].clone(),
            live: live.errors[phase].clone(),
            truth: steady(Knowledge::True, phase)?.errors[0].clone(),
            farthest: nominal.farthest,
        })
    };
    Ok(Tracking {
        robot: robot.config.name.clone(),
        window_s,
        phases: [phase(0)?, phase(1)?],
        sets: live.sets,
        refusals: live.refusals,
        changes: live.changes,
        adopted_s: live.adopted_s,
        farthest: live.farthest,
    })
}

struct Study<'a> {
    robot: &'a Robot,
    /// What a badly informed user's robot file says.
    mistaken: Robot,
    payloads: [f64; 2],
    truths: [Truth; 2],
    joints: Joints,
    motion: Fourier,
    limits: MotionLimits,
    seed: u64,
}

struct Run {
    errors: Vec<Vec<f64>>,
    sets: (u64, u64),
    refusals: Vec<(Refusal, u64)>,
    changes: u64,
    adopted_s: Option<f64>,
    farthest: f64,
}

impl<'a> Study<'a> {
    fn new(robot: &'a Robot, payload: f64, seed: u64) -> Study<'a> {
        let joints = nominal_joints(robot);
        let payloads = [payload, 0.0];
        let truths = payloads.map(|mass| {
            let payload = (mass > 0.0).then_some(Payload { mass, com: PAYLOAD_COM });
            Truth::new(&robot.model, &joints, &Disturbances { payload, ..Disturbances::default() })
        });
        let limits = MotionLimits::of(&robot.model.arm, SPEED);
        // With the payload, too, the drives keep a reserve: else saturation would be compared, not parameters.
        let limit = &robot.config.drive.torque_limit;
        let loaded = truths[0].standard(&robot.model);
        let (mut empty, mut full) =
            (load_ratio(&robot.model, &robot.nominal, limit), load_ratio(&robot.model, &loaded, limit));
        let mut load =
            |q: &[f64], qd: &[f64], qdd: &[f64]| empty(q, qd, qdd).max(full(q, qd, qdd) * LARGEST_LOAD / LOADED);
        let settings = FourierSettings { base_hz: BASE_HZ, seed, ..FourierSettings::default() };
        let motion = Fourier::new(&limits, &settings, &mut load);
        Study { mistaken: mistaken(robot, seed), robot, payloads, truths, joints, motion, limits, seed }
    }

    fn plant(&self, phase: usize) -> Plant {
        let config = &self.robot.config;
        let sensors = Sensors {
            resolution: config.drive.encoder_resolution.clone(),
            position_noise: config.simulation.position_noise.clone(),
            torque_noise: config.simulation.torque_noise.clone(),
        };
        let mut settings = PlantSettings::new(config.sample_period_s, &config.drive.torque_limit);
        if config.signal.friction_velocity > 0.0 {
            // This arm's friction was measured to turn over so smoothly.
            settings.friction = FrictionLaw::Smooth { velocity: config.signal.friction_velocity };
        }
        let mut plant = Plant::new(&self.truths[phase], &sensors, &settings, self.seed);
        plant.place(&self.limits.home, &vec![0.0; self.robot.dof()]);
        plant.set_brake(true);
        plant
    }

    /// Runs until one period of the motion after the last of `begins`; errors are taken over a period from each of them.
    fn run(
        &self,
        knowledge: Knowledge,
        phase: usize,
        change: Option<f64>,
        begins: &[f64],
    ) -> Result<Run, SettingsError> {
        let n = self.robot.dof();
        let period_s = self.robot.config.sample_period_s;
        let known = match knowledge {
            Knowledge::True => with_bodies(self.robot, self.truths[phase].arm.clone(), &self.joints),
            _ => self.mistaken.clone(),
        };
        let live = knowledge == Knowledge::Live;
        let mut plant = self.plant(phase);
        let mut daemon = Daemon::new(&known)?;
        let mut controller = Controller::new(&known, if live { 0 } else { u64::MAX })?;
        let mut set = Parameters::default();
        let mut sums = vec![vec![0.0; n]; begins.len()];
        let build_up = (BUILD_UP_S / period_s).round() as u64;
        let span = 1.0 / BASE_HZ;
        let end_s = begins.iter().copied().fold(0.0, f64::max) + span;
        let mut change = change;
        let (mut adopted_s, mut farthest) = (None, 0.0_f64);
        let (mut q, mut qd, mut qdd) = ([0.0; MAX_JOINTS], [0.0; MAX_JOINTS], [0.0; MAX_JOINTS]);
        for k in 0..build_up + (end_s / period_s).round() as u64 {
            let t_s = k.saturating_sub(build_up) as f64 * period_s;
            if k == build_up {
                plant.set_brake(false);
            }
            if change.is_some_and(|at| t_s >= at) {
                change = None;
                plant.become_loaded(&self.truths[1]);
            }
            self.motion.sample(t_s, &mut q[..n], &mut qd[..n], &mut qdd[..n]);
            let measured = plant.measure();
            let (seq, joints) = (k + 1, n as u32);
            let stamp_ns = (seq as f64 * period_s * 1e9) as u64;
            let faults = if plant.braked() { faults::STOPPED } else { 0 };
            let mut sample = JointState { seq, stamp_ns, joints, faults, ..JointState::default() };
            sample.q[..n].copy_from_slice(measured.q());
            sample.tau[..n].copy_from_slice(measured.tau());
            let setpoint = Setpoint { seq, stamp_ns, q, qd, qdd, joints, ..Setpoint::default() };
            controller.offer_setpoint(&setpoint);
            let command = controller.tick(&sample).map_or([0.0; MAX_JOINTS], |command| command.tau);
            if live && daemon.tick(&sample, Some(&setpoint)).publish {
                daemon.write_parameters(&mut set);
                controller.offer_parameters(&set, &sample);
                if adopted_s.is_none() && controller.source() == ParameterSource::Live {
                    adopted_s = Some(t_s);
                }
            }
            farthest = (0..n).map(|j| (q[j] - plant.q()[j]).abs()).fold(farthest, f64::max);
            for (sum, begin) in sums.iter_mut().zip(begins) {
                if (*begin..*begin + span).contains(&t_s) {
                    for j in 0..n {
                        sum[j] += (q[j] - plant.q()[j]).powi(2) * period_s / span;
                    }
                }
            }
            plant.step(&command[..n]);
        }
        for x in sums.iter_mut().flatten() {
            *x = x.sqrt();
        }
        let counts = controller.counts();
        let mut health = ControllerHealth::default();
        controller.write_health(&mut health);
        let reasons = (0_u32..).zip(health.refusals).filter(|(_, count)| *count > 0);
        let refusals = reasons.filter_map(|(why, count)| Some((Refusal::try_from(why).ok()?, count)));
        let refusals = refusals.filter(|(why, _)| *why != Refusal::None).collect();
        Ok(Run {
            errors: sums,
            sets: (counts.accepted, counts.refused),
            refusals,
            changes: daemon.changes(),
            adopted_s,
            farthest,
        })
    }
}

/// `robot` as a badly informed user would have written it: every body 20 % too heavy or too light, no friction.
fn mistaken(robot: &Robot, seed: u64) -> Robot {
    let mut random = Random::stream(seed, 0x5d);
    let mut arm = robot.model.arm.clone();
    for body in &mut arm.links {
        let factor = if random.uniform(-1.0, 1.0) < 0.0 { 1.0 - BODIES } else { 1.0 + BODIES };
        for entry in body {
            *entry *= factor;
        }
    }
    let mut joints = nominal_joints(robot);
    for values in [&mut joints.viscous, &mut joints.coulomb, &mut joints.offset] {
        values.fill(0.0);
    }
    (joints.coupling[1], joints.coupling[2]) = (0.0, 0.0);
    with_bodies(robot, arm, &joints)
}

fn with_bodies(robot: &Robot, arm: Arm, joints: &Joints) -> Robot {
    let model = Model::new(arm, robot.model.structure);
    let nominal = model.nominal(joints);
    let nominal_base = robot.base.from_standard(&nominal);
    Robot { model: Arc::new(model), nominal, nominal_base, identified: None, ..robot.clone() }
}

impl fmt::Display for Tracking {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{}: rms tracking error [1e-6 rad]; {} of {} sets passed the gate; {} change(s) seen; window {} s",
            self.robot,
            self.sets.0,
            self.sets.0 + self.sets.1,
            self.changes,
            self.window_s
        )?;
        match self.adopted_s {
            Some(adopted) => writeln!(f, "  live parameters in use after {adopted:.1} s of motion")?,
            None => writeln!(f, "  live parameters were never in use")?,
        }
        for (why, count) in &self.refusals {
            writeln!(f, "  {count:>5} refused: {}", refusal_text(*why))?;
        }
        let when = [
            format!("unknown payload, after {} windows", WINDOWS[0]),
            format!("payload gone, after {} windows", WINDOWS[1]),
        ];
        writeln!(
            f,
            "  furthest from the plan at any time {:.1}; {:.3} of what nominal parameters lead (at most 1.25)",
            1e6 * self.farthest,
            self.farther()
        )?;
        for (errors, when) in self.phases.iter().zip(when) {
            let (to_nominal, to_truth) = errors.ratios();
            writeln!(f, "  {when} ({} kg)", errors.payload)?;
            for (name, values) in [("nominal", &errors.nominal), ("live", &errors.live), ("true", &errors.truth)] {
                write!(f, "    {name:<8}")?;
                for value in values {
                    write!(f, " {:>8.1}", 1e6 * value)?;
                }
                writeln!(f, "   all {:>8.1}", 1e6 * total(values))?;
            }
            writeln!(f, "    live/nominal {to_nominal:.3} (at most 0.25)   live/true {to_truth:.3} (at most 1.15)")?;
        }
        Ok(())
    }
}
