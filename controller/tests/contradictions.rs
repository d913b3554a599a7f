//! Plans whose positions, velocities and accelerations do not belong together: followed, or refused by name, and never faster than the
//! joints may be.

mod common;

use common::rig::{Motion, Rig, Swing, Values, Wrong};
use rivet_dynamics::MAX_JOINTS;
use rivet_simulation::Random;
use std::f64::consts::TAU;

/// Sample periods \[s\].
const PERIODS: [f64; 2] = [0.004, 0.001];
/// Largest speed of the plan, in parts of the joints' limits.
const SHARES: [f64; 4] = [0.2, 0.45, 0.6, 0.8];
/// Above this share dd2 needs the accelerations of its plan, since its default rate limit takes 0.1 s to the full torque.
const FOLLOWED_SHARE: f64 = 0.6;
/// Seconds of a sound plan, and of the planner's after it.
const SOUND_S: f64 = 1.7;
const PLANNED_S: f64 = 2.0;
const MAX_SPEED: f64 = 1.2;
/// Farthest from the plan without a stop \[rad\]: the default `tracking_error`, and the way of a sample.
const MAX_AWAY: f64 = 0.27;

/// Positions, velocities and accelerations of the true plan after so many seconds.
type Plan<'a> = &'a dyn Fn(f64) -> [Values; 3];
/// What a planner makes of the true plan at a time \[s\], one setpoint every so many seconds.
type Planner = fn(Plan<'_>, f64, f64) -> [Values; 3];

/// The plan with velocities and accelerations times so much.
fn scaled(plan: [Values; 3], velocity: f64, acceleration: f64) -> [Values; 3] {
    [plan[0], plan[1].map(|x| velocity * x), plan[2].map(|x| acceleration * x)]
}

/// Velocities and accelerations that are `late_s` old.
fn late(plan: Plan<'_>, t: f64, late_s: f64) -> [Values; 3] {
    let before = plan(t - late_s);
    [plan(t)[0], before[1], before[2]]
}

/// Velocities and accelerations that change `hz` times a second.
fn sampled(plan: Plan<'_>, t: f64, hz: f64) -> [Values; 3] {
    late(plan, t, t - (t * hz).floor() / hz)
}

/// Velocities of 0 in the first `zeros` of every `of` setpoints.
fn gaps(plan: Plan<'_>, t: f64, period_s: f64, [zeros, of]: [u64; 2]) -> [Values; 3] {
    let k = (t / period_s).round() as u64;
    if k % of < zeros { scaled(plan(t), 0.0, 0.0) } else { plan(t) }
}

/// Accelerations of the first joint that swing on top of those of the plan, by so many rad/s² with so many Hz.
fn swinging(plan: Plan<'_>, t: f64, [by, hz]: [f64; 2]) -> [Values; 3] {
    let mut out = plan(t);
    out[2][0] += by * (TAU * hz * t).sin();
    out
}

/// Rounded positions, and their differences.
fn rounded(plan: Plan<'_>, t: f64, period_s: f64, step: f64) -> [Values; 3] {
    let at = |t: f64| plan(t)[0].map(|q| (q / step).round() * step);
    let (now, before) = (at(t), at(t - period_s));
    [now, std::array::from_fn(|j| (now[j] - before[j]) / period_s), [0.0; MAX_JOINTS]]
}

/// Planners as they are found: what they plan is followed.
const SOUND: [(&str, Planner); 7] = [
    ("true", |plan, t, _| plan(t)),
    ("no accelerations", |plan, t, _| scaled(plan(t), 1.0, 0.0)),
    ("velocities 10 ms late", |plan, t, _| late(plan, t, 0.01)),
    ("velocities 20 ms late", |plan, t, _| late(plan, t, 0.02)),
    ("velocities that change at 50 Hz", |plan, t, _| sampled(plan, t, 50.0)),
    ("velocities of 0.9", |plan, t, _| scaled(plan(t), 0.9, 1.0)),
    ("differences of positions of 0.1 mrad", |plan, t, period_s| rounded(plan, t, period_s, 1e-4)),
];

/// Planners that are wrong.
const WRONG: [(&str, Planner); 16] = [
    ("positions only", |plan, t, _| scaled(plan(t), 0.0, 0.0)),
    ("no velocity in every second", |plan, t, period_s| gaps(plan, t, period_s, [1, 2])),
    ("no velocity in every third", |plan, t, period_s| gaps(plan, t, period_s, [1, 3])),
    ("no velocity in two of four", |plan, t, period_s| gaps(plan, t, period_s, [2, 4])),
    ("no velocity in four of eight", |plan, t, period_s| gaps(plan, t, period_s, [4, 8])),
    ("no velocity for 0.2 of 0.6 s", |plan, t, period_s| {
        gaps(plan, t, period_s, [0.2, 0.6].map(|s| (s / period_s) as u64))
    }),
    ("no velocity for 0.1 of 0.5 s", |plan, t, period_s| {
        gaps(plan, t, period_s, [0.1, 0.5].map(|s| (s / period_s) as u64))
    }),
    ("no velocity for 0.3 of 0.55 s", |plan, t, period_s| {
        gaps(plan, t, period_s, [0.3, 0.55].map(|s| (s / period_s) as u64))
    }),
    ("velocities that change at 20 Hz", |plan, t, _| sampled(plan, t, 20.0)),
    ("velocities that change at 10 Hz", |plan, t, _| sampled(plan, t, 10.0)),
    ("velocities that change at 8 Hz", |plan, t, _| sampled(plan, t, 8.0)),
    ("velocities of 1.5", |plan, t, _| scaled(plan(t), 1.5, 1.0)),
    ("accelerations that swing by 35 rad/s² at 8 Hz", |plan, t, _| swinging(plan, t, [35.0, 8.0])),
    ("accelerations that swing by 40 rad/s² at 10 Hz", |plan, t, _| swinging(plan, t, [40.0, 10.0])),
    ("accelerations that swing by 40 rad/s² at 13 Hz", |plan, t, _| swinging(plan, t, [40.0, 13.0])),
    ("velocities of the other sign", |plan, t, _| scaled(plan(t), -1.0, -1.0)),
];

/// Runs planners on an arm; those that have to be followed must not be stopped up to [`FOLLOWED_SHARE`].
fn check(arm: &str, planners: &[(&str, Planner)], are_followed: bool) {
    let (mut wrong, mut fastest, mut furthest) = (Vec::new(), 0.0_f64, 0.0_f64);
    for period_s in PERIODS {
        for share in SHARES {
            for (name, planner) in planners {
                // The first stop is to last: a plan that is sound again would be followed again.
                let mut rig = Rig::new(arm, period_s, "resume_after = 0\n", share);
                let motion = Motion::Swing(Swing::new(&rig.robot, share));
                let plan = |t: f64| motion.at(SOUND_S + t);
                let o = rig.run(SOUND_S, Wrong::Nothing, PLANNED_S, |t, out| *out = planner(&plan, t, period_s));
                let name = format!("{arm} {period_s} s, {share} of the speed, {name}");
                println!("{name}: {:?}, speed {:.2}, away {:.3} rad", o.stop, o.speed, o.away);
                (fastest, furthest) = (fastest.max(o.speed), furthest.max(o.away));
                let is_lost = o.stop.is_none() && o.away > MAX_AWAY;
                let is_refused = are_followed && share <= FOLLOWED_SHARE && o.stop.is_some();
                if o.speed > MAX_SPEED || is_lost || is_refused {
                    wrong.push(format!("{name}: {o:?}"));
                }
            }
        }
    }
    println!("{arm}: at most {fastest:.2} times the speed limit, {furthest:.2} rad");
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn plans_of_imperfect_planners_are_followed() {
    check("dd2", &SOUND, true);
    check("ur10e", &SOUND, true);
}

#[test]
fn plans_that_contradict_themselves_make_no_arm_fast() {
    check("dd2", &WRONG, false);
    check("ur10e", &WRONG, false);
}

/// One setpoint that is far off is left out, and the plan is followed.
#[test]
fn one_wrong_setpoint_is_left_out() {
    for (arm, period_s) in [("dd2", 0.004), ("dd2", 0.001), ("ur10e", 0.004)] {
        let mut rig = Rig::new(arm, period_s, "", 0.4);
        let wrong =
            |t: f64, plan: &mut [Values; 3]| plan[0][0] += if (t / period_s).round() == 20.0 { 0.3 } else { 0.0 };
        let o = rig.run(SOUND_S, Wrong::Nothing, 1.0, wrong);
        assert!(o.stop.is_none() && o.away < 0.05, "{arm} {period_s} s: {o:?}");
        assert_eq!(rig.core.counts().setpoints_refused, 1, "{arm} {period_s} s");
    }
}

/// A fault of a planner: what it does to positions, velocities or accelerations of one joint.
#[derive(Clone, Copy, Debug)]
enum Fault {
    Scaled(f64),
    /// By so much, so many times a second.
    Swinging(f64, f64),
    Late(f64),
    /// New values so many times a second.
    Held(f64),
    /// 0 for the first so many seconds of every so many.
    Missing(f64, f64),
    Rounded(f64),
}

/// A fault of a part (0: positions, 1: velocities, 2: accelerations) of a joint's plan.
#[derive(Clone, Copy, Debug)]
struct DrawnFault {
    part: usize,
    joint: usize,
    fault: Fault,
}

impl DrawnFault {
    /// `scale` are speed limit \[rad/s\] and acceleration \[rad/s²\] of each joint.
    fn draw(random: &mut Random, dof: usize, scale: &dyn Fn(usize) -> [f64; 2]) -> DrawnFault {
        let log = |random: &mut Random, low: f64, high: f64| low * (high / low).powf(random.uniform(0.0, 1.0));
        let part = (random.uniform(0.0, 3.0) as usize).min(2);
        let joint = (random.uniform(0.0, dof as f64) as usize).min(dof - 1);
        let [speed, acceleration] = scale(joint);
        let hz = log(random, 0.5, 25.0);
        let largest = [0.2 * speed / (TAU * hz), 0.3 * speed, acceleration][part];
        let fault = match random.uniform(0.0, 6.0) as usize {
            0 => Fault::Scaled(random.uniform(-2.0, 2.0)),
            1 => Fault::Swinging(largest * random.uniform(0.1, 1.0), hz),
            2 => Fault::Late(log(random, 0.004, 0.2)),
            3 => Fault::Held(log(random, 5.0, 200.0)),
            4 => {
                let every = log(random, 0.02, 1.0);
                Fault::Missing(every * random.uniform(0.1, 0.9), every)
            }
            _ => Fault::Rounded(largest * log(random, 0.01, 1.0)),
        };
        DrawnFault { part, joint, fault }
    }

    fn apply(&self, plan: Plan<'_>, t: f64, out: &mut [Values; 3]) {
        let (part, j) = (self.part, self.joint);
        let value = &mut out[part][j];
        *value = match self.fault {
            Fault::Scaled(by) if part > 0 => by * *value,
            Fault::Swinging(by, hz) => *value + by * (TAU * hz * t).sin(),
            Fault::Late(by) => plan(t - by)[part][j],
            Fault::Held(hz) => plan((t * hz).floor() / hz)[part][j],
            Fault::Missing(missing, every) if part > 0 && t % every < missing => 0.0,
            // A position that is scaled, or 0, is refused at once.
            Fault::Scaled(_) | Fault::Missing(..) => *value,
            Fault::Rounded(step) => (*value / step).round() * step,
        };
    }
}

/// Planners with one to three drawn faults.
#[test]
fn drawn_faults_of_planners_make_no_arm_fast() {
    let number = |key: &str, default: u64| std::env::var(key).ok().and_then(|s| s.parse().ok()).unwrap_or(default);
    let (first, count) = (number("SEED", 100), number("COUNT", 40));
    let mut wrong = Vec::new();
    let mut speeds = Vec::new();
    for seed in first..first + count {
        let mut random = Random::stream(seed, 11);
        let arm = if random.uniform(0.0, 1.0) < 0.6 { "dd2" } else { "ur10e" };
        let period_s = if random.uniform(0.0, 1.0) < 0.6 { 0.004 } else { 0.001 };
        let share = random.uniform(0.2, 0.8);
        let mut rig = Rig::new(arm, period_s, "resume_after = 0\n", share);
        rig.bend_is_planned = true;
        let swing = Swing::new(&rig.robot, share);
        let scale = |j: usize| {
            let speed = rig.robot.model.arm.joints[j].velocity;
            [speed, 10.0 * speed]
        };
        let faults: Vec<DrawnFault> = (0..=(random.uniform(0.0, 3.0) as usize).min(2))
            .map(|_| DrawnFault::draw(&mut random, rig.robot.dof(), &scale))
            .collect();
        let motion = Motion::Swing(swing);
        let plan = |t: f64| motion.at(SOUND_S + t);
        let o = rig.run(SOUND_S, Wrong::Nothing, PLANNED_S, |t, out| {
            *out = plan(t);
            for fault in &faults {
                fault.apply(&plan, t, out);
            }
        });
        let name = format!("seed {seed}: {arm} {period_s} s, {share:.2} of the speed, {faults:?}");
        println!("{name}: {:?}, speed {:.2}, away {:.3} rad", o.stop, o.speed, o.away);
        speeds.push(o.speed);
        if o.speed > MAX_SPEED || o.stop.is_none() && o.away > MAX_AWAY {
            wrong.push(format!("{name}: {o:?}"));
        }
    }
    let fastest = speeds.iter().copied().fold(0.0, f64::max);
    println!("at most {fastest:.2} times the speed limit");
    assert!(wrong.is_empty(), "{wrong:#?}");
}
