//! Blind cases: an arm that differs from its robot file in ways that are drawn, moved and logged.
//!
//! The arm is `rivet_simulation::two_mass`, whose laws are not those that a diagnosis fits. Base flexibility is the one effect
//! of the list that is not drawn: this plant stands on rock.

mod draw;

pub use draw::{Drawn, True};

use rivet_config::Robot;
use rivet_simulation::Random;
use rivet_simulation::motion::{
    Fourier, FourierSettings, MotionLimits, PointToPoint, PointToPointSettings, Trajectory, load_ratio,
};
use rivet_simulation::two_mass::{Physics, Recording, Tracking, record};

/// Control and log period of every case \[s\].
pub const PERIOD_S: f64 = 0.001;
/// Length of the two halves of a run \[s\]: Fourier motion, then moves from pose to pose.
const FOURIER_S: f64 = 9.0;
const MOVES_S: f64 = 9.0;
/// Share of the arm's speed that motions use at most.
const SPEED: f64 = 0.8;

/// A case: two runs of one arm, and what is wrong with it.
#[derive(Clone, Debug)]
pub struct Case {
    /// Different motions; the second is for the proof.
    pub runs: [Recording; 2],
    /// What the arm has that its robot file has not.
    pub effects: Vec<True>,
    /// Root mean square change of each joint's torque by the effects, over its noise.
    pub torque_change_over_noise: Vec<f64>,
    /// The same of each effect alone, `[effect][joint]`.
    pub change_of_each: Vec<Vec<f64>>,
    /// Standard deviation of the logarithm of nominal values, where all of them are wrong.
    pub nominal_error: Option<f64>,
}

/// The motion of one run: as an arm is excited on purpose, then as it works.
struct Both {
    first: Fourier,
    then: PointToPoint,
}

impl Trajectory for Both {
    fn dof(&self) -> usize {
        self.first.dof()
    }

    fn sample(&self, t_s: f64, q: &mut [f64], qd: &mut [f64], qdd: &mut [f64]) {
        if t_s < FOURIER_S {
            self.first.sample(t_s, q, qd, qdd);
        } else {
            self.then.sample(t_s - FOURIER_S, q, qd, qdd);
        }
    }
}

fn motion(robot: &Robot, seed: u64) -> Both {
    let limits = MotionLimits::of(&robot.model.arm, SPEED);
    let mut load = load_ratio(&robot.model, &robot.nominal, &robot.config.drive.torque_limit);
    let fourier =
        FourierSettings { base_hz: 0.13, ramp_s: 1.0, length_s: FOURIER_S, seed, ..FourierSettings::default() };
    let moves = PointToPointSettings { seed, longest_s: 2.0, ..PointToPointSettings::default() };
    Both { first: Fourier::new(&limits, &fourier, &mut load), then: PointToPoint::new(&limits, &moves, &mut load) }
}

/// Draws of one case before it counts as one that cannot be made.
const TRIES: usize = 50;

/// Makes the case of `seed` with an arm like `robot`. Draws again, with the next number of the same stream, until the arm
/// follows its motion: a case in which it falls over is of no use to anyone. None when it never does.
pub fn case(robot: &Robot, seed: u64) -> Option<Case> {
    let mut random = Random::stream(seed, 0xb1);
    for _ in 0..TRIES {
        let runs = [random.bits(), random.bits()].map(|seed| (motion(robot, seed), seed));
        let draw = draw::Draw::new(robot, &runs[0].0);
        let drawn = draw.case(&mut random);
        let noise = Noise::of(robot, &mut random);
        let knows = noise.tracking(robot);
        let run = |physics: &Physics| {
            runs.each_ref().map(|(motion, seed)| record(physics, &knows, motion, FOURIER_S + MOVES_S, *seed))
        };
        let with = run(&drawn.physics);
        if !with.iter().all(|run| run.followed) {
            continue;
        }
        let noise_of = |a: &[Recording; 2], b: &[Recording; 2]| -> Vec<f64> {
            (0..robot.dof()).map(|j| rms_apart(a, b, j) / noise.torque[j]).collect()
        };
        // What an effect adds is counted where it came in, after those drawn before it.
        let mut stages: Vec<[Recording; 2]> = Vec::new();
        if !drawn.effects.is_empty() {
            stages.extend(drawn.before.iter().map(run));
        }
        stages.push(with.clone());
        let change = noise_of(&with, &stages[0]);
        let of_each = stages.windows(2).map(|pair| noise_of(&pair[1], &pair[0])).collect();
        return Some(Case {
            torque_change_over_noise: change,
            change_of_each: of_each,
            runs: with,
            effects: drawn.effects,
            nominal_error: drawn.nominal_error,
        });
    }
    None
}

/// Root mean square of what sets the torque of joint `j` apart in two versions of the same runs \[N·m\].
fn rms_apart(a: &[Recording; 2], b: &[Recording; 2], j: usize) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for (a, b) in a.iter().zip(b) {
        for (a, b) in a.tau_clean[j].iter().zip(&b.tau_clean[j]) {
            sum += (a - b).powi(2);
            count += 1.0;
        }
    }
    (sum / f64::max(count, 1.0)).sqrt()
}

/// Sensors of a case.
struct Noise {
    position: Vec<f64>,
    torque: Vec<f64>,
    joints: rivet_dynamics::Joints,
}

impl Noise {
    /// The robot's own noise or less, down to a third of it.
    fn of(robot: &Robot, random: &mut Random) -> Noise {
        let simulation = &robot.config.simulation;
        let share = random.uniform(0.33, 1.0);
        Noise {
            position: simulation.position_noise.clone(),
            torque: simulation.torque_noise.iter().map(|noise| share * noise).collect(),
            joints: robot.config.nominal_joints(),
        }
    }

    fn tracking<'a>(&'a self, robot: &'a Robot) -> Tracking<'a> {
        Tracking {
            arm: &robot.model.arm,
            joints: &self.joints,
            coupling: robot.model.structure.coupling,
            torque_limit: &robot.config.drive.torque_limit,
            resolution: &robot.config.drive.encoder_resolution,
            position_noise: &self.position,
            torque_noise: &self.torque,
            period_s: PERIOD_S,
        }
    }
}
