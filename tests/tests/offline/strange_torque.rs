//! Torques of which the list of effects knows nothing, added to logs of sound arms: none of them is called by the name of an
//! effect that looks like it.

use std::path::Path;
use std::process::Command;

use rivet_dynamics::{Workspace, flange_pose, inverse_dynamics};
use rivet_logs::{ReadOptions, read};
use rivet_tests::altered::{answer, written};
use rivet_tests::{rivet, shared};
use serde_json::Value;

/// What is said of a sound case when `more`, by joint of its positions in radians, is added to the torque of both logs.
fn with(case: &Path, more: impl Fn(&[Vec<f64>]) -> Vec<(usize, Vec<f64>)>) -> Value {
    let folder = tempfile::tempdir().expect("a folder");
    let mut command: Command = rivet();
    command.arg("diagnose").arg(case.join("robot.toml"));
    for name in ["log-a", "log-b"] {
        let log = read(case.join(name).with_extension("parquet"), &ReadOptions::new(6)).expect("a sound log");
        let mut tau = log.torque().expect("torque").clone();
        for (j, torque) in more(&log.q) {
            tau[j].iter_mut().zip(torque).for_each(|(tau, more)| *tau += more);
        }
        let own = folder.path().join(name);
        std::fs::create_dir(&own).expect("a folder");
        command.arg(written(&log, &tau, &own));
    }
    answer(&mut command, folder.path()).2
}

/// Effects that are named with some confidence, values apart.
fn named(found: &Value) -> Vec<(String, f64)> {
    let values = ["payload", "link_inertia", "rotor_inertia", "coulomb_friction", "viscous_friction"];
    let cause =
        |c: &Value| (c["effect"].as_str().expect("a name").to_owned(), c["confidence"].as_f64().expect("a number"));
    let causes = found["causes"].as_array().expect("causes").iter().map(cause);
    causes.filter(|(name, _)| !values.contains(&name.as_str())).collect()
}

/// A hose along two links, or the spring of a parallelogram: each joint by itself bends as no spring does. It was a spring of joint
/// 2 (0.88), or contact, or an asymmetric friction.
#[test]
fn a_spring_over_two_joints_is_no_effect_of_one() {
    let Some(practice) = shared("data/practice") else { return };
    let found = with(&practice.join("case-18"), |q| {
        let torque: Vec<f64> = q[1].iter().zip(&q[2]).map(|(a, b)| 72.0 * (a + b)).collect();
        vec![(1, torque.clone()), (2, torque)]
    });
    assert_eq!((&found["verdict"], named(&found)), (&Value::from("unexplained"), Vec::new()), "{found:#}");
}

/// It was a counterbalance (0.96) and a ripple (0.96).
#[test]
fn a_spring_that_hardens_is_no_counterbalance() {
    let Some(practice) = shared("data/practice") else { return };
    let found = with(&practice.join("case-18"), |q| {
        let mean = q[2].iter().sum::<f64>() / q[2].len() as f64;
        vec![(2, q[2].iter().map(|q| 240.0 * (q - mean).powi(3)).collect())]
    });
    assert_eq!((&found["verdict"], named(&found)), (&Value::from("unexplained"), Vec::new()), "{found:#}");
}

/// A cable that follows the joint and slips, softer than friction's bristles: it was an asymmetric friction (0.89) beside a counterbalance
/// (0.76), with which the sealed run was worse than as given.
#[test]
fn what_hardly_helps_on_a_joint_that_stays_open_is_not_named() {
    let Some(practice) = shared("data/practice") else { return };
    let found = with(&practice.join("case-24"), |q| {
        let (stiffness, most) = (20.0, 4.0);
        let mut held = 0.0_f64;
        let step = |pair: &[f64]| {
            let by = pair[1] - pair[0];
            held = (held + stiffness * by * (1.0 - by.signum() * held / most)).clamp(-most, most);
            held
        };
        let first = std::iter::once(0.0);
        vec![(2, first.chain(q[2].windows(2).map(step).collect::<Vec<f64>>()).collect())]
    });
    let sure: Vec<(String, f64)> = named(&found).into_iter().filter(|(_, confidence)| *confidence > 0.6).collect();
    assert!(sure.is_empty(), "{sure:?}: {found:#}");
}

/// Torque of a force at the flange of a case's arm, by time \[s\] and velocity of the flange \[m/s\], which the joints must bring up.
fn against(case: &Path, q: &[Vec<f64>], force: impl Fn(f64, [f64; 3]) -> [f64; 3]) -> Vec<(usize, Vec<f64>)> {
    const PERIOD_S: f64 = 1e-3;
    // Samples to both sides over which the speed is taken.
    const BESIDE: usize = 10;
    let mut arm = rivet_config::load(case.join("robot.toml")).expect("a sound robot file").model.arm.clone();
    let (n, rows) = (arm.dof(), q[0].len());
    let at = |row: usize| q.iter().map(|q| q[row]).collect::<Vec<f64>>();
    let places: Vec<[f64; 3]> = (0..rows).map(|row| flange_pose(&arm, &at(row)).1).collect();
    let mut unit = vec![[0.0; 10]; n];
    unit[n - 1][0] = 1.0;
    let (mut ws, still, mut now) = (Workspace::new(&arm), vec![0.0; n], vec![0.0; n]);
    let mut torque = vec![vec![0.0; rows]; n];
    for row in BESIDE..rows - BESIDE {
        let (before, after) = (places[row - BESIDE], places[row + BESIDE]);
        let v = std::array::from_fn(|i| (after[i] - before[i]) / (2.0 * BESIDE as f64 * PERIOD_S));
        // A unit mass at the flange in this field is held as the arm holds against the force.
        arm.gravity = force(row as f64 * PERIOD_S, v);
        inverse_dynamics(&arm, &unit, &mut ws, &at(row), &still, &still, &mut now);
        torque.iter_mut().zip(&now).for_each(|(torque, now)| torque[row] = *now);
    }
    torque.into_iter().enumerate().collect()
}

fn size(v: [f64; 3]) -> f64 {
    v.iter().map(|v| v * v).sum::<f64>().sqrt()
}

/// Air or water that holds the tool back, 25 N s²/m², pushes in bursts, whenever it is fast: it was contact (0.97).
#[test]
fn drag_at_the_tool_is_no_contact() {
    let Some(practice) = shared("data/practice") else { return };
    let case = practice.join("case-24");
    let found = with(&case, |q| against(&case, q, |_, v| v.map(|along| -25.0 * size(v) * along)));
    assert!(!named(&found).iter().any(|(name, _)| name == "external_force"), "{:?}", named(&found));
    assert!(found["hints"].to_string().contains("against the motion of the flange"), "{:#}", found["hints"]);
}

/// A hand that resists takes power whichever way the arm goes, as drag does, but not all the time.
#[test]
fn a_hand_that_resists_is_contact() {
    let Some(practice) = shared("data/practice") else { return };
    let case = practice.join("case-24");
    let hand = |t: f64, v: [f64; 3]| {
        let phase = (t % 5.0) - 2.5;
        let held = if (0.0..1.5).contains(&phase) { (std::f64::consts::PI * phase / 1.5).sin() } else { 0.0 };
        v.map(|along| -60.0 * held * along / size(v).max(0.02))
    };
    let found = with(&case, |q| against(&case, q, hand));
    let contact = |(name, confidence): &(String, f64)| name == "external_force" && *confidence > 0.8;
    assert!(named(&found).iter().any(contact), "{:?} {:#}", named(&found), found["hints"]);
}
