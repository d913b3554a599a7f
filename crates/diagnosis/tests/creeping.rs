//! A joint that creeps: how softly friction turns over is most of what is missed then, and is neither a gap nor evidence against one.

mod common;

use std::f64::consts::{FRAC_PI_2, TAU};

use common::Noise;
use rivet_diagnosis::{Effect, Run, Silent, Verdict, diagnose};
use rivet_dynamics::{Model, Structure, Workspace};

const PERIOD_S: f64 = 0.002;
const SECONDS: f64 = 24.0;
/// The model's friction turns over at this speed, the arm's at the other \[rad/s\].
const MODEL: f64 = 0.004;
const REAL: f64 = 0.01;
/// Time at which motion is slowest, how long that takes, and the share of its speed that is left.
const SLOW: [f64; 3] = [12.0, 6.0, 0.015];

/// A time that runs slower for a while, with its rate and the rate of that.
fn warped(t: f64) -> [f64; 3] {
    let [middle, length, left] = SLOW;
    let phase = ((t - middle) / length).clamp(-0.5, 0.5);
    // Flat in the middle third, so that the joint creeps there.
    let edge = (phase.abs() * 3.0 - 0.5).clamp(0.0, 1.0);
    let depth = (1.0 - left) * (edge * FRAC_PI_2).cos().powi(2);
    let inside = edge > 0.0 && edge < 1.0;
    let slope = if inside { -(1.0 - left) * FRAC_PI_2 * (2.0 * edge * FRAC_PI_2).sin() * 3.0 / length } else { 0.0 };
    [0.0, 1.0 - depth, -slope * phase.signum()]
}

/// Torques of an arm as the model but for how friction turns over, and for Stribeck friction of `excess` \[N m\] on joint 2.
fn log(model: &Model, x: &[f64], creeps: bool, excess: f64, seed: u64) -> Run {
    let n = model.arm.dof();
    let real = Model::new(model.arm.clone(), Structure { sign_velocity: REAL, ..model.structure });
    let (mut ws, mut noise) = (Workspace::new(&real.arm), Noise(seed));
    let (mut q, mut tau) = (vec![Vec::new(); n], vec![Vec::new(); n]);
    let (mut at, mut qd, mut qdd) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    let mut y = vec![0.0; n * real.len()];
    let mut own = 0.3 * seed as f64;
    for k in 0..(SECONDS / PERIOD_S) as usize {
        let [_, rate, change] = if creeps { warped(k as f64 * PERIOD_S) } else { [0.0, 1.0, 0.0] };
        own += rate * PERIOD_S;
        for j in 0..n {
            let waves = [(0.6, 0.25 + 0.07 * j as f64), (0.2, 0.61 - 0.09 * j as f64)].map(|(a, f)| (a, TAU * f));
            let of = |f: &dyn Fn(f64, f64) -> f64| waves.iter().map(|(a, w)| f(*a, *w)).sum::<f64>();
            let [speed, turn] = [of(&|a, w| a * w * (w * own).cos()), of(&|a, w| -a * w * w * (w * own).sin())];
            at[j] = of(&|a, w| a * (w * own).sin());
            (qd[j], qdd[j]) = (speed * rate, turn * rate * rate + speed * change);
        }
        real.regressor(&mut ws, &at, &qd, &qdd, &mut y);
        for j in 0..n {
            let whole: f64 = y[j * real.len()..][..real.len()].iter().zip(x).map(|(y, x)| y * x).sum();
            let more = if j == 1 { excess * (-(qd[j] / 0.1).powi(2)).exp() * (qd[j] / REAL).tanh() } else { 0.0 };
            q[j].push(at[j]);
            tau[j].push(whole + more + 0.1 * noise.draw());
        }
    }
    let temperature = Some(vec![vec![30.0; q[0].len()]; n]);
    Run { name: format!("log {seed}"), period_s: PERIOD_S, q, tau, temperature, ..Run::default() }
}

fn told(excess: f64) -> rivet_diagnosis::Diagnosis {
    let arm = common::arm();
    let n = arm.dof();
    let model = Model::new(arm, Structure { offset: true, sign_velocity: MODEL, ..Structure::default() });
    let mut x = model.arm.links.concat();
    for size in [0.4, 3.0, 12.0, 0.0] {
        x.extend((0..n).map(|_| size));
    }
    let runs = vec![log(&model, &x, false, excess, 1), log(&model, &x, true, excess, 2)];
    let found = diagnose(&model, &x, runs, &mut Silent).expect("sound logs");
    for gap in &found.per_joint {
        println!("{}: {:?} times the noise in motion", gap.joint, gap.in_motion);
    }
    println!("{:?}, of what is left creeping {:.2}", found.verdict, found.creeping_share);
    found
}

/// It was "something changed between the runs".
#[test]
fn a_sealed_run_that_creeps_is_no_gap() {
    let found = told(0.0);
    assert_eq!(found.verdict, Verdict::NoGap);
    assert!(found.per_joint.iter().all(|gap| gap.in_motion.is_some_and(|[before, _]| before < 2.0)));
    assert!(found.creeping_share > 0.5, "{}", found.creeping_share);
}

/// With the model's own turn more friction is the worse the longer a joint creeps: the effect was refuted.
#[test]
fn nor_does_creeping_refute_an_effect() {
    let found = told(5.0);
    let names: Vec<(Effect, &[String])> = found.causes.iter().map(|c| (c.effect, c.joints.as_slice())).collect();
    assert_eq!(names, [(Effect::StribeckFriction, &["2".to_owned()][..])]);
}
