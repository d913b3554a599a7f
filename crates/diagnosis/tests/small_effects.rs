//! An effect of about the size of the noise: both logs have to support it, each with coefficients of the other.

mod common;

use std::f64::consts::TAU;

use common::Noise;
use rivet_diagnosis::{Diagnosis, Effect, Run, Verdict, diagnose};
use rivet_dynamics::{Model, Structure, Workspace};

const PERIOD_S: f64 = 0.002;
const SECONDS: f64 = 24.0;
/// Standard deviation of the torque signal \[N·m\]; about a third of it is left by the model filter.
const NOISE: f64 = 0.1;
/// Amplitude \[N·m\] and order of the ripple: its RMS is about the noise floor.
const RIPPLE: f64 = 0.05;
const ORDER: f64 = 12.0;

/// A log of the model, with a ripple of `amplitude` \[N·m\] on joint 2.
fn log(model: &Model, x: &[f64], amplitude: f64, seed: u64) -> Run {
    let n = model.arm.dof();
    let (mut ws, mut noise) = (Workspace::new(&model.arm), Noise(seed));
    let (mut q, mut tau) = (vec![Vec::new(); n], vec![Vec::new(); n]);
    let (mut at, mut qd, mut qdd) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    let mut y = vec![0.0; n * model.len()];
    for k in 0..(SECONDS / PERIOD_S) as usize {
        let t = k as f64 * PERIOD_S + 2.0 * seed as f64;
        for j in 0..n {
            let waves = [(0.6, 0.25 + 0.07 * j as f64), (0.2, 0.61 - 0.09 * j as f64)].map(|(a, f)| (a, TAU * f));
            at[j] = waves.iter().map(|(a, w)| a * (w * t).sin()).sum();
            qd[j] = waves.iter().map(|(a, w)| a * w * (w * t).cos()).sum();
            qdd[j] = waves.iter().map(|(a, w)| -a * w * w * (w * t).sin()).sum();
        }
        model.regressor(&mut ws, &at, &qd, &qdd, &mut y);
        for j in 0..n {
            let whole: f64 = y[j * model.len()..][..model.len()].iter().zip(x).map(|(y, x)| y * x).sum();
            let ripple = if j == 1 { amplitude * (ORDER * at[j]).sin() } else { 0.0 };
            q[j].push(at[j]);
            tau[j].push(whole + ripple + NOISE * noise.draw());
        }
    }
    Run { name: format!("log {seed}"), period_s: PERIOD_S, q, tau, ..Run::default() }
}

/// The diagnosis of two logs with ripples of these amplitudes \[N·m\]; the second one is held out.
fn found(amplitudes: [f64; 2]) -> Diagnosis {
    let arm = common::arm();
    let n = arm.dof();
    let model = Model::new(arm, Structure { offset: true, sign_velocity: 0.004, ..Structure::default() });
    let mut x = model.arm.links.concat();
    for size in [0.4, 3.0, 12.0, 0.0] {
        x.extend((0..n).map(|_| size));
    }
    let runs = vec![log(&model, &x, amplitudes[0], 1), log(&model, &x, amplitudes[1], 2)];
    let found = diagnose(&model, &x, runs, &mut |line| println!("{line}")).expect("sound logs");
    let given = found.per_joint.iter().filter_map(|gap| Some(gap.in_motion?[0]));
    assert!(given.into_iter().all(|times| times < 2.0), "no joint exceeds twice its noise");
    found
}

fn names(found: &Diagnosis) -> Vec<(Effect, &[String])> {
    found.causes.iter().map(|cause| (cause.effect, cause.joints.as_slice())).collect()
}

#[test]
fn names_ripple_of_the_size_of_the_noise() {
    let found = found([RIPPLE; 2]);
    assert_eq!(names(&found), [(Effect::TorqueRipple, &["2".to_owned()][..])]);
    assert_eq!(found.verdict, Verdict::Effect);
}

#[test]
fn rejects_ripple_that_the_held_out_log_lacks() {
    assert_eq!(names(&found([RIPPLE, 0.0])), []);
}

#[test]
fn names_nothing_on_a_sound_arm() {
    let found = found([0.0; 2]);
    assert_eq!((names(&found), found.verdict), (Vec::new(), Verdict::NoGap));
}
