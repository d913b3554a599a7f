//! Drawn faults of encoders on true arms that are not quite those of their files: the arm rests after the stop, and goes on resting.
//!
//! `SEED=5001 COUNT=150` draws others, `WORDS='unmodelled_torque = 0.2'` puts lines into `[controller]`.

mod common;

use common::rig::{Outcome, Rig, Wrong, friction, load};
use rivet_simulation::Random;
use rivet_simulation::two_mass::Push;

/// First seed and count of the draws, where the environment says nothing.
const FIRST_SEED: u64 = 9001;
const COUNT: u64 = 30;
/// Time for which the arm is observed after a fault \[s\].
const AFTER_S: f64 = 4.0;
/// Largest speed, in parts of the joint's limit.
const MOST_SPEED: f64 = 1.2;
/// Distance from the plan beyond which a stop is compared with one whose encoders are sound, and the way that it may go beyond that \[rad\].
const MOST_AWAY: f64 = 0.3;
const MOST_BEYOND: f64 = 0.15;
/// Time until a measured torque at its limit is named \[s\].
const NAMED_S: f64 = 0.012;
/// Way that an arm at rest may still go from a second after the stop on \[rad\].
const MOST_LATER: f64 = 0.05;

/// An arm in motion, and the joint whose encoder goes wrong.
#[derive(Clone, Copy, Debug)]
struct Case {
    arm: &'static str,
    period_s: f64,
    /// Largest planned speed, in parts of the joints' limits.
    share: f64,
    sound_s: f64,
    joint: usize,
}

impl Case {
    fn draw(random: &mut Random) -> Case {
        let (arm, dof) = if random.uniform(0.0, 1.0) < 0.4 { ("dd2", 2) } else { ("ur10e", 6) };
        let period_s = if random.uniform(0.0, 1.0) < 0.6 { 0.004 } else { 0.001 };
        let share = random.uniform(0.2, 0.7);
        let sound_s = random.uniform(1.0, 5.0);
        let joint = (random.uniform(0.0, dof as f64) as usize).min(dof - 1);
        Case { arm, period_s, share, sound_s, joint }
    }

    /// The arm with lines in its `[controller]` section, those of the environment where it has some.
    fn rig(&self, lines: &str) -> Rig {
        let lines = std::env::var("WORDS").unwrap_or_else(|_| lines.to_owned());
        Rig::new(self.arm, self.period_s, &format!("{lines}\n"), self.share)
    }
}

/// A factor between `low` and `high`, its logarithm evenly distributed.
fn factor(random: &mut Random, low: f64, high: f64) -> f64 {
    low * (high / low).powf(random.uniform(0.0, 1.0))
}

/// Draws cases and prints how they went: `run` gives a description, an outcome, and whether that is a bad one. Descriptions of the bad ones
/// and the count of all.
fn bad_ones(mut run: impl FnMut(&mut Random) -> (String, Outcome, bool)) -> (Vec<String>, u64) {
    let number = |key: &str, default| std::env::var(key).ok().and_then(|s| s.parse().ok()).unwrap_or(default);
    let (first, count) = (number("SEED", FIRST_SEED), number("COUNT", COUNT));
    let mut bad = Vec::new();
    for seed in first..first + count {
        let (name, o, is_bad) = run(&mut Random::stream(seed, 49));
        let name = format!("seed {seed}: {name}: {o:?}");
        println!("{name}");
        if is_bad {
            bad.push(name);
        }
    }
    println!("{} of {count} bad", bad.len());
    (bad, count)
}

/// Encoders that cannot be used in a stop, on arms with half to 1.7 times the friction of the file: joints that are not seen stay where they
/// came to rest.
#[test]
fn joints_that_are_not_seen_stay_at_rest() {
    let (bad, _) = bad_ones(|random| {
        let case = Case::draw(random);
        let (j, jump) = (case.joint, factor(random, 0.03, 0.9));
        let jump = if random.uniform(0.0, 1.0) < 0.5 { -jump } else { jump };
        let late_s = random.uniform(0.03, 0.1);
        let wrong = match random.uniform(0.0, 6.0) as usize {
            0 => Wrong::Frozen(j),
            1 | 2 => Wrong::Backwards(j),
            3 => Wrong::Negative(j),
            4 => Wrong::Jump(j, jump),
            _ => Wrong::Late(late_s),
        };
        let by = factor(random, 0.5, 1.7);
        let rig = || case.rig("").differing(|physics| friction(physics, by));
        let o = rig().run(case.sound_s, wrong, AFTER_S, |_, _| ());
        let is_bad = o.stop.is_none() || o.speed > MOST_SPEED || o.later_way > MOST_LATER;
        let mut name = format!("{case:?} {wrong:?}, friction times {by:.2}");
        let mut is_far = false;
        if let Some((.., delay_s)) = o.stop.filter(|_| o.away > MOST_AWAY) {
            // A stop at the same moment whose encoders are sound: a measured torque is at its limit, which is named 12 ms later.
            let sound_s = case.sound_s + (delay_s - NAMED_S).max(0.0);
            let floor = rig().run(sound_s, Wrong::TorqueAtLimit(j), AFTER_S, |_, _| ()).away;
            name = format!("{name}, {:.2} rad, and {floor:.2} rad with sound encoders", o.away);
            is_far = o.away > floor + MOST_BEYOND;
        }
        (name, o, is_bad || is_far)
    });
    assert!(bad.is_empty(), "{bad:#?}");
}

/// The elbow of the UR10e at neighbouring moments: gravity pulls it away from where it is thought to be.
#[test]
fn an_elbow_that_counts_backwards_does_not_sink() {
    for k in 0..12 {
        for wrong in [Wrong::Backwards(2), Wrong::Jump(2, 0.07)] {
            let mut rig = Rig::new("ur10e", 0.001, "", 0.6);
            let sound_s = 3.8 + 0.02 * f64::from(k);
            let o = rig.run(sound_s, wrong, AFTER_S, |_, _| ());
            println!("{wrong:?} after {sound_s:.2} s: {o:?}");
            assert!(
                o.stop.is_some() && o.away <= 0.3 && o.later_way <= MOST_LATER,
                "{wrong:?} after {sound_s} s: {o:?}"
            );
        }
    }
}

/// Encoders whose scale changes, on arms with light loads: few joints become fast before it is found (`docs/realtime.md` has the figures).
#[test]
fn encoders_of_another_scale_make_few_joints_fast() {
    let (bad, count) = bad_ones(|random| {
        let case = Case::draw(random);
        let scale = factor(random, 0.05, 0.8) * if random.uniform(0.0, 1.0) < 0.4 { -1.0 } else { 1.0 };
        let wrong = Wrong::Scaled(case.joint, scale);
        let o = case.rig("unmodelled_torque = 0.2").run(case.sound_s, wrong, 2.5, |_, _| ());
        (format!("{case:?} {wrong:?}"), o, o.speed > MOST_SPEED)
    });
    assert!(bad.len() as u64 <= count.div_ceil(10), "{bad:#?}");
}

/// Arms with half to 2.5 times the friction of the file, rotors of 0.7 to 1.3 times the inertia, loads that the model does not know, and a
/// weight that is hung on the flange in motion.
#[test]
fn arms_that_differ_from_their_files_are_not_stopped() {
    let (bad, _) = bad_ones(|random| {
        let case = Case::draw(random);
        let [most_mass, most_force] = if case.arm == "dd2" { [1.0, 8.0] } else { [5.0, 40.0] };
        let [by, rotor] = [factor(random, 0.5, 2.5), random.uniform(0.7, 1.3)];
        let [mass, force, from_s] =
            [random.uniform(0.0, most_mass), random.uniform(0.0, most_force), random.uniform(1.5, 4.0)];
        let force = if random.uniform(0.0, 1.0) < 0.4 { force } else { 0.0 };
        let mut rig = case.rig("").differing(|physics| {
            friction(physics, by);
            load(physics, mass);
            for joint in &mut physics.joints {
                joint.rotor_inertia *= rotor;
            }
            physics.pushes.push(Push { from_s, length_s: 100.0, force: [0.0, 0.0, -force] });
        });
        let o = rig.run(0.0, Wrong::Nothing, 6.0, |_, _| ());
        let name = format!("{case:?}, friction times {by:.2}, rotors {rotor:.2}, {mass:.1} kg, {force:.0} N");
        (name, o, o.stops > 0)
    });
    assert!(bad.is_empty(), "{bad:#?}");
}

/// Weights of up to the rated load of a UR10e, 12.5 kg, that are hung on the flange in motion and taken off again. The drives can hold them.
#[test]
fn rated_loads_that_are_grasped_and_released_stop_no_arm() {
    let (bad, _) = bad_ones(|random| {
        let case = Case { arm: "ur10e", share: random.uniform(0.05, 0.5), ..Case::draw(random) };
        let [by, force] = [factor(random, 0.5, 1.7), random.uniform(60.0, 12.5 * 9.81)];
        let [from_s, length_s] = [random.uniform(1.0, 3.0), random.uniform(0.5, 2.5)];
        let mut rig = case.rig("").differing(|physics| {
            friction(physics, by);
            physics.pushes.push(Push { from_s, length_s, force: [0.0, 0.0, -force] });
        });
        let o = rig.run(0.0, Wrong::Nothing, 6.0, |_, _| ());
        let name = format!("{case:?}, friction times {by:.2}, {force:.0} N from {from_s:.2} s on for {length_s:.2} s");
        (name, o, o.stops > 0)
    });
    assert!(bad.is_empty(), "{bad:#?}");
}
