//! Faults that hide for a while: a frozen encoder with noise, positions that come later and later, encoders that drift or whose scale
//! changes, plans that start anew from the measured state.
//!
//! `SEED=7001 COUNT=200` draws others, `WORDS='unmodelled_torque = 0.2'` puts lines into `[controller]`. `--ignored` prints the figures of
//! `docs/realtime.md`.

mod common;

use common::rig::{Motion, Outcome, Rig, Swing, Values, Wrong, friction, load};
use rivet_ipc_schema::StopCause;
use rivet_simulation::Random;

/// First seed and count of the draws, where the environment says nothing.
const FIRST_SEED: u64 = 300;
const COUNT: u64 = 40;
/// Bounds of a fault that is found: speed in parts of the joint's limit, distance from the plan \[rad\], speed at the end \[rad/s\].
const MAX_SPEED: f64 = 1.2;
const MAX_AWAY: f64 = 0.3;
const MAX_REST: f64 = 0.01;
/// Way that noise may add to that of an encoder which is frozen without \[rad\].
const MAX_BEYOND: f64 = 0.15;
/// Fastest plan whose stop takes less than that way, in parts of the joints' limits: drives need 0.35 rad from 0.68.
const SHARE: f64 = 0.5;
/// The same for draws of which figures are printed.
const FAST_SHARE: f64 = 0.7;
/// Time for which the arm is observed after a fault \[s\].
const AFTER_S: f64 = 3.0;

fn number(key: &str, default: u64) -> u64 {
    std::env::var(key).ok().and_then(|s| s.parse().ok()).unwrap_or(default)
}

/// Draws runs of one kind of fault on an arm, with up to `most` of the joints' speeds, and prints how they went.
fn draws(
    kind: &str,
    arms: &[&'static str],
    most: f64,
    mut wrong: impl FnMut(&mut Random, usize) -> Wrong,
) -> Vec<(String, Outcome)> {
    let words = std::env::var("WORDS").unwrap_or_default() + "\nresume_after = 0\n";
    let (first, count) = (number("SEED", FIRST_SEED), number("COUNT", COUNT));
    let mut outcomes = Vec::new();
    for seed in first..first + count {
        let mut random = Random::stream(seed, 77);
        let arm = arms[(random.uniform(0.0, arms.len() as f64) as usize).min(arms.len() - 1)];
        let dof = if arm == "dd2" { 2 } else { 6 };
        let period_s = if random.uniform(0.0, 1.0) < 0.5 { 0.004 } else { 0.001 };
        let (share, sound_s) = (random.uniform(0.2, most), random.uniform(1.2, 4.5));
        let joint = (random.uniform(0.0, dof as f64) as usize).min(dof - 1);
        let wrong = wrong(&mut random, joint);
        let o = Rig::new(arm, period_s, &words, share).run(sound_s, wrong, AFTER_S, |_, _| ());
        let name = format!("seed {seed}: {arm} {period_s} s, {share:.2} of the speed, {sound_s:.2} s, {wrong:?}");
        println!("{name}: {:?}, speed {:.2}, away {:.3} rad, rest {:.3} rad/s", o.stop, o.speed, o.away, o.rest);
        outcomes.push((name, o));
    }
    let most = |value: fn(&Outcome) -> f64| outcomes.iter().map(|(_, o)| value(o)).fold(0.0, f64::max);
    let count_of = |is: fn(&Outcome) -> bool| outcomes.iter().filter(|(_, o)| is(o)).count();
    println!(
        "{kind}: {count} drawn, {} above {MAX_SPEED} times the speed limit, at most {:.2}; {} beyond {MAX_AWAY} rad, at most {:.2} rad; {} not \
         stopped",
        count_of(|o| o.speed > MAX_SPEED),
        most(|o| o.speed),
        count_of(|o| o.away > MAX_AWAY),
        most(|o| o.away),
        count_of(|o| o.stop.is_none()),
    );
    outcomes
}

/// Noise of 5 to 25 µrad, evenly distributed by its logarithm: more hides whether a joint yields.
fn noise(random: &mut Random) -> f64 {
    5e-6 * 5f64.powf(random.uniform(0.0, 1.0))
}

#[test]
fn a_frozen_encoder_with_noise_is_stopped() {
    let arms = ["dd2", "dd2", "ur10e"];
    let noisy = draws("frozen with noise", &arms, SHARE, |random, joint| Wrong::NoisyFrozen(joint, noise(random)));
    let exact = draws("frozen", &arms, SHARE, |_, joint| Wrong::NoisyFrozen(joint, 0.0));
    for ((name, o), (_, exact)) in noisy.iter().zip(&exact) {
        // A joint that freezes near its turning point is found late, with noise and without.
        let is_near = o.away <= MAX_AWAY.max(exact.away + MAX_BEYOND);
        assert!(o.stop.is_some() && o.speed <= MAX_SPEED && is_near && o.rest <= MAX_REST, "{name}: {o:?}, {exact:?}");
    }
}

/// Sound arms with noisy encoders, friction and loads of no file, slow motion as well: joints that friction holds are not frozen.
#[test]
fn sound_arms_with_noisy_encoders_are_not_stopped() {
    let (first, count) = (number("SEED", FIRST_SEED), number("COUNT", COUNT));
    let mut stopped = Vec::new();
    for seed in first..first + count {
        let mut random = Random::stream(seed, 78);
        let arm = if random.uniform(0.0, 1.0) < 0.5 { "dd2" } else { "ur10e" };
        let period_s = if random.uniform(0.0, 1.0) < 0.5 { 0.004 } else { 0.001 };
        let share = 0.02 * 30f64.powf(random.uniform(0.0, 1.0));
        let deviation = noise(&mut random);
        let by = 0.5 * 5f64.powf(random.uniform(0.0, 1.0));
        let mass = random.uniform(0.0, if arm == "dd2" { 1.0 } else { 5.0 });
        let mut robot = Rig::new(arm, period_s, "", share).robot;
        robot.config.simulation.position_noise.fill(deviation);
        let motion = Motion::Swing(Swing::new(&robot, share));
        let mut rig = Rig::of(robot, motion).differing(|physics| {
            friction(physics, by);
            load(physics, mass);
        });
        let o = rig.run(0.0, Wrong::Nothing, 6.0, |_, _| ());
        let name = format!(
            "seed {seed}: {arm} {period_s} s, {share:.3} of the speed, noise {deviation:.1e} rad, friction times {by:.2}, {mass:.1} kg"
        );
        println!("{name}: {:?}", o.stop);
        if o.stops > 0 {
            stopped.push(format!("{name}: {o:?}"));
        }
    }
    assert!(stopped.is_empty(), "{} of {count}: {stopped:#?}", stopped.len());
}

fn later_and_later(random: &mut Random) -> Wrong {
    Wrong::LaterAndLater(random.uniform(0.05, 0.3), random.uniform(0.05, 0.1))
}

/// Feedback that answers positions of long ago swings the arm: that is stopped, and the plan is not to blame.
#[test]
fn positions_that_come_later_and_later_are_not_blamed_on_the_plan() {
    for (name, o) in draws("later and later", &["dd2"], FAST_SHARE, |random, _| later_and_later(random)) {
        let (cause, ..) = o.stop.unwrap_or_else(|| panic!("{name}: {o:?}"));
        let is_plan = [StopCause::PlanAcceleration, StopCause::PlanJump].contains(&cause);
        assert!(!is_plan && o.rest <= MAX_REST, "{name}: {o:?}");
    }
}

#[test]
#[ignore = "prints figures"]
fn figures_of_drifts_and_scales() {
    let arms = ["dd2", "ur10e"];
    draws("later and later", &["dd2"], FAST_SHARE, |random, _| later_and_later(random));
    draws("drifts", &arms, FAST_SHARE, |random, joint| Wrong::Drift(joint, random.uniform(0.1, 1.5)));
    draws("drifts that grow", &arms, FAST_SHARE, |random, joint| Wrong::DriftGrows(joint, random.uniform(0.2, 2.0)));
    draws("scales of 0.6", &arms, FAST_SHARE, |_, joint| Wrong::Scaled(joint, 0.6));
}

/// Accelerations \[rad/s²\] of joint 2 of dd2.
const ACCELERATIONS: [f64; 12] = [-80.0, -60.0, -50.0, -40.0, -30.0, -20.0, 20.0, 30.0, 40.0, 50.0, 60.0, 80.0];

/// A plan that starts anew from the measured state in each period, and accelerates: the stop begins early enough to take the torque back.
#[test]
fn plans_that_start_anew_make_no_joint_fast() {
    let mut fastest = 0.0_f64;
    for period_s in [0.004, 0.001] {
        for a in ACCELERATIONS {
            for k in 0..6 {
                let sound_s = 1.5 + 0.2 * f64::from(k);
                let mut rig = Rig::new("dd2", period_s, "resume_after = 0\n", 0.4);
                (rig.from_measured, rig.bend_is_planned) = (true, true);
                let o = rig.run(sound_s, Wrong::Nothing, 2.0, |_, plan: &mut [Values; 3]| {
                    plan[2] = Values::default();
                    plan[2][1] = a;
                });
                println!("{period_s} s, {a} rad/s², {sound_s} s: {o:?}");
                fastest = fastest.max(o.speed);
            }
        }
    }
    println!("starts anew: at most {fastest:.2}");
    assert!(fastest <= MAX_SPEED, "{fastest}");
}
