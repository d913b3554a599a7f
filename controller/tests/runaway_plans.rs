//! Plans that run away from the arm: their stop makes no joint fast that another one drags along.
//!
//! `SEED=7001 COUNT=200` draws others.

mod common;

use common::rig::{Motion, Rig, Swing, Values, Wrong};
use rivet_simulation::Random;
use std::f64::consts::TAU;

/// First seed and count of the draws, where the environment says nothing.
const FIRST_SEED: u64 = 300;
const COUNT: u64 = 60;
/// Seconds of the wrong plan.
const PLANNED_S: f64 = 2.0;
/// Largest speed, in parts of the joint's limit.
const MAX_SPEED: f64 = 1.2;

/// How a plan runs away, on one joint.
#[derive(Clone, Copy, Debug)]
enum Runaway {
    /// This acceleration, whatever positions and velocities do \[rad/s²\].
    Acceleration(f64),
    /// This acceleration on top of the planned one, with so many Hz.
    Swing(f64, f64),
    /// This acceleration from the present position and velocity on, and positions and velocities that follow from it.
    Consistent(f64),
    /// The same accelerations and velocities with the positions of the plan.
    Velocity(f64),
}

impl Runaway {
    fn draw(random: &mut Random, largest: f64) -> Runaway {
        let by = largest * random.uniform(0.15, 1.0) * if random.uniform(0.0, 1.0) < 0.5 { -1.0 } else { 1.0 };
        match random.uniform(0.0, 4.0) as usize {
            0 => Runaway::Acceleration(by),
            1 => Runaway::Swing(by, 2.0 * 10f64.powf(random.uniform(0.0, 1.0))),
            2 => Runaway::Consistent(by),
            _ => Runaway::Velocity(by),
        }
    }

    fn apply(self, j: usize, begin: &[Values; 3], t: f64, plan: &mut [Values; 3]) {
        match self {
            Runaway::Acceleration(a) => plan[2][j] = a,
            Runaway::Swing(a, hz) => plan[2][j] += a * (TAU * hz * t).sin(),
            Runaway::Consistent(a) | Runaway::Velocity(a) => {
                if let Runaway::Consistent(_) = self {
                    plan[0][j] = begin[0][j] + begin[1][j] * t + 0.5 * a * t * t;
                }
                plan[1][j] = begin[1][j] + a * t;
                plan[2][j] = a;
            }
        }
    }
}

#[test]
fn plans_that_run_away_make_no_joint_fast() {
    let number = |key: &str, default| std::env::var(key).ok().and_then(|s| s.parse().ok()).unwrap_or(default);
    let (first, count) = (number("SEED", FIRST_SEED), number("COUNT", COUNT));
    let (mut fast, mut speeds, mut ways) = (Vec::new(), Vec::new(), Vec::new());
    for seed in first..first + count {
        let mut random = Random::stream(seed, 51);
        let (arm, dof) = if random.uniform(0.0, 1.0) < 0.75 { ("dd2", 2) } else { ("ur10e", 6) };
        let period_s = if random.uniform(0.0, 1.0) < 0.5 { 0.004 } else { 0.001 };
        let share = random.uniform(0.3, 0.8);
        let sound_s = random.uniform(1.2, 3.5);
        let joint = (random.uniform(0.0, dof as f64) as usize).min(dof - 1);
        let mut rig = Rig::new(arm, period_s, "resume_after = 0\n", share);
        let speed = rig.robot.model.arm.joints[joint].velocity;
        let runaway = Runaway::draw(&mut random, 12.0 * speed);
        let begin = Motion::Swing(Swing::new(&rig.robot, share)).at(sound_s);
        let o = rig.run(sound_s, Wrong::Nothing, PLANNED_S, |t, plan| runaway.apply(joint, &begin, t, plan));
        let name = format!(
            "seed {seed}: {arm} {period_s} s, {share:.2} of the speed, {sound_s:.2} s, joint {joint}, {runaway:?}"
        );
        println!("{name}: {:?}, speed {:.2}, away {:.3} rad, rest {:.3} rad/s", o.stop, o.speed, o.away, o.rest);
        speeds.push(o.speed);
        ways.push(o.away);
        if o.speed > MAX_SPEED {
            fast.push(format!("{name}: {o:?}"));
        }
    }
    let most = |values: &[f64]| values.iter().copied().fold(0.0, f64::max);
    println!("{} of {count} fast, at most {:.2}, {:.2} rad", fast.len(), most(&speeds), most(&ways));
    assert!(fast.is_empty(), "{fast:#?}");
}

/// Joint 2 of dd2 at ±40 rad/s², at moments 0.2 s apart: the hardest plans for a joint that joint 1 drags along.
#[test]
fn constant_accelerations_make_no_joint_fast() {
    let mut fastest = 0.0_f64;
    for share in [0.4, 0.6, 0.8] {
        for period_s in [0.004, 0.001] {
            for kind in [Runaway::Acceleration, Runaway::Consistent, Runaway::Velocity] {
                let mut most = (0.0_f64, 0.0_f64);
                for (by, k) in [-40.0, 40.0].into_iter().flat_map(|by| (12..32).step_by(2).map(move |k| (by, k))) {
                    let (runaway, sound_s) = (kind(by), 0.1 * f64::from(k));
                    let mut rig = Rig::new("dd2", period_s, "resume_after = 0\n", share);
                    let begin = Motion::Swing(Swing::new(&rig.robot, share)).at(sound_s);
                    let bend = |t: f64, plan: &mut [Values; 3]| runaway.apply(1, &begin, t, plan);
                    let o = rig.run(sound_s, Wrong::Nothing, PLANNED_S, bend);
                    most = (most.0.max(o.speed), most.1.max(o.away));
                }
                println!(
                    "{share} of the speed, {period_s} s, {:?}: at most {:.2}, {:.2} rad",
                    kind(40.0),
                    most.0,
                    most.1
                );
                fastest = fastest.max(most.0);
            }
        }
    }
    assert!(fastest <= MAX_SPEED, "{fastest}");
}
