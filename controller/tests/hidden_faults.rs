//! Faults that hide for a while: a frozen encoder with noise, positions that come later and later, encoders that drift or whose scale
//! changes.
//!
//! `SEED=7001 COUNT=200` draws others, `WORDS='unmodelled_torque = 0.2'` puts lines into `[controller]`.

mod common;

use common::rig::{Outcome, Rig, Values, Wrong};
use rivet_simulation::Random;

/// First seed and count of the draws, where the environment says nothing.
const FIRST_SEED: u64 = 300;
const COUNT: u64 = 40;
/// Time for which the arm is observed after a fault \[s\].
const AFTER_S: f64 = 3.0;

fn number(key: &str, default: u64) -> u64 {
    std::env::var(key).ok().and_then(|s| s.parse().ok()).unwrap_or(default)
}

/// Draws runs of one kind of fault on an arm and prints how they went.
fn draws(kind: &str, arms: &[&'static str], mut wrong: impl FnMut(&mut Random, usize) -> Wrong) -> Vec<(String, Outcome)> {
    let words = std::env::var("WORDS").unwrap_or_default() + "\nresume_after = 0\n";
    let (first, count) = (number("SEED", FIRST_SEED), number("COUNT", COUNT));
    let mut outcomes = Vec::new();
    for seed in first..first + count {
        let mut random = Random::stream(seed, 77);
        let arm = arms[(random.uniform(0.0, arms.len() as f64) as usize).min(arms.len() - 1)];
        let dof = if arm == "dd2" { 2 } else { 6 };
        let period_s = if random.uniform(0.0, 1.0) < 0.5 { 0.004 } else { 0.001 };
        let (share, sound_s) = (random.uniform(0.2, 0.7), random.uniform(1.2, 4.5));
        let joint = (random.uniform(0.0, dof as f64) as usize).min(dof - 1);
        let wrong = wrong(&mut random, joint);
        let o = Rig::new(arm, period_s, &words, share).run(sound_s, wrong, AFTER_S, |_, _| ());
        let name = format!("seed {seed}: {arm} {period_s} s, {share:.2} of the speed, {sound_s:.2} s, {wrong:?}");
        println!(
            "{name}: {:?}, speed {:.2}, away {:.3} rad, rest {:.3} rad/s, later {:.3} rad",
            o.stop, o.speed, o.away, o.rest, o.later_way
        );
        outcomes.push((name, o));
    }
    let most = |value: fn(&Outcome) -> f64| outcomes.iter().map(|(_, o)| value(o)).fold(0.0, f64::max);
    let count_of = |is: fn(&Outcome) -> bool| outcomes.iter().filter(|(_, o)| is(o)).count();
    println!(
        "{kind}: {count} drawn, {} above 1.2 times the speed limit, at most {:.2}; {} beyond 0.3 rad, at most {:.2} rad; {} not stopped",
        count_of(|o| o.speed > 1.2),
        most(|o| o.speed),
        count_of(|o| o.away > 0.3),
        most(|o| o.away),
        count_of(|o| o.stop.is_none()),
    );
    outcomes
}

#[test]
fn frozen_with_noise() {
    draws("frozen with noise", &["dd2", "dd2", "ur10e"], |random, joint| {
        Wrong::NoisyFrozen(joint, 1e-5 * 20f64.powf(random.uniform(0.0, 1.0)))
    });
}

#[test]
fn later_and_later() {
    draws("later and later", &["dd2"], |random, _| {
        Wrong::LaterAndLater(random.uniform(0.05, 0.3), random.uniform(0.05, 0.1))
    });
}

#[test]
fn drifts() {
    draws("drifts", &["dd2", "ur10e"], |random, joint| Wrong::Drift(joint, random.uniform(0.1, 1.5)));
}

#[test]
fn drifts_grow() {
    draws("drifts grow", &["dd2", "ur10e"], |random, joint| Wrong::DriftGrows(joint, random.uniform(0.2, 2.0)));
}

#[test]
fn scales() {
    draws("scales of 0.6", &["dd2", "ur10e"], |_, joint| Wrong::Scaled(joint, 0.6));
}

/// A plan that starts anew from the measured state in each period.
#[test]
fn starts_anew() {
    let mut fastest = 0.0_f64;
    for period_s in [0.004, 0.001] {
        for a in [-80.0, -60.0, -50.0, -40.0, -30.0, -20.0, 20.0, 30.0, 40.0, 50.0, 60.0, 80.0] {
            for k in 0..6 {
                let sound_s = 1.5 + 0.2 * f64::from(k);
                let mut rig = Rig::new("dd2", period_s, "resume_after = 0\n", 0.4);
                rig.from_measured = true;
                rig.bend_is_planned = true;
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
}
