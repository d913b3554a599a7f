//! Sound logs that say little: joints that move one after the other. Where the model as given misses nothing in motion, what a fit
//! makes of a joint that stands is no gap.

use std::path::{Path, PathBuf};

use rivet_config::Robot;
use rivet_dynamics::{Parameter, Workspace};
use rivet_logs::write_columns;
use rivet_tests::altered::{Random, answer};
use rivet_tests::sines::Sines;
use rivet_tests::{rivet, robot};

const SECONDS: f64 = 30.0;
const PERIOD_S: f64 = 0.004;
/// Moves of one joint before the next has its turn.
const MOVES: usize = 4;
/// Share of the range that a move may end in, the longest range \[rad\], top speed of a move \[rad/s\].
const RANGE: f64 = 0.9;
const WIDEST: f64 = 3.2;
const SPEED: f64 = 0.8;
/// What a standing joint holds of its friction, in the direction it came from.
const HELD: f64 = 0.4;

/// A log of an arm with these standard parameters: minimum-jerk moves of one of some joints at a time, with noise of the torque alone.
fn log(robot: &Robot, x: &[f64], joints: &[usize], seed: u64, folder: &Path) -> PathBuf {
    let (n, rows) = (robot.dof(), (SECONDS / PERIOD_S) as usize);
    let mut random = Random(seed);
    let middle = |j: usize| 0.5 * (robot.model.arm.joints[j].lower + robot.model.arm.joints[j].upper);
    let mut q: Vec<f64> = (0..n).map(middle).collect();
    let (mut ws, mut y) = (Workspace::new(&robot.model.arm), vec![0.0; n * robot.model.len()]);
    let mut columns = vec![Vec::new(); 1 + 2 * n];
    let mut held = vec![0.0; n];
    let mut moves = 0;
    while columns[0].len() < rows {
        let j = joints[(moves / MOVES) % joints.len()];
        moves += 1;
        let joint = &robot.model.arm.joints[j];
        let range = RANGE * (joint.upper - joint.lower).min(WIDEST);
        let (from, to) = (q[j], middle(j) + range * random.uniform());
        let time = (1.875 * (to - from).abs() / SPEED).max(0.3);
        let rest = 0.5 + 0.3 * random.uniform();
        for k in 0..((time + rest) / PERIOD_S) as usize {
            let s = (k as f64 * PERIOD_S / time).min(1.0);
            let (mut qd, mut qdd) = (vec![0.0; n], vec![0.0; n]);
            q[j] = from + (to - from) * s.powi(3) * (10.0 - 15.0 * s + 6.0 * s * s);
            qd[j] = (to - from) / time * 30.0 * (s * (1.0 - s)).powi(2);
            qdd[j] = (to - from) / (time * time) * 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s);
            robot.model.regressor(&mut ws, &q, &qd, &qdd, &mut y);
            let t = PERIOD_S * columns[0].len() as f64;
            columns[0].push(t);
            for i in 0..n {
                let row = &y[i * robot.model.len()..(i + 1) * robot.model.len()];
                if qd[i] != 0.0 {
                    held[i] = HELD * qd[i].signum();
                }
                let stuck = if qd[i] == 0.0 { held[i] * robot.config.friction.coulomb[i] } else { 0.0 };
                let noise = 0.5 * robot.config.simulation.torque_noise[i] * random.normal();
                columns[1 + i].push(q[i] + 1e-6 * random.normal());
                columns[1 + n + i].push(row.iter().zip(x).map(|(y, x)| y * x).sum::<f64>() + stuck + noise);
            }
        }
        q[j] = to;
    }
    let name = |k: usize| match k {
        0 => "t".to_owned(),
        k if k <= n => format!("q{k}"),
        k => format!("tau{}", k - n),
    };
    let named: Vec<(String, &[f64])> = columns.iter().enumerate().map(|(k, c)| (name(k), &c[..rows])).collect();
    let path = folder.join(format!("{seed}.parquet"));
    write_columns(&path, &named).expect("written");
    path
}

/// What a fit made of the three joints that hardly moved did not hold on the sealed log of the first: `unexplained`, though the model as
/// given misses 1.2 times the noise on either.
#[test]
fn a_sound_arm_whose_joints_move_one_by_one_has_no_gap() {
    for (arm, seeds) in [("manutec-r3", [7, 8]), ("ur5e", [5, 6])] {
        let folder = tempfile::tempdir().expect("a folder");
        let loaded = rivet_config::load(robot(arm)).expect("a sound robot file");
        let all: Vec<usize> = (0..loaded.dof()).collect();
        let logs = seeds.map(|seed| log(&loaded, &loaded.nominal, &all, seed, folder.path()));
        let (code, text, found) = answer(rivet().arg("diagnose").arg(robot(arm)).args(logs), folder.path());
        assert_eq!((code, found["verdict"].as_str()), (Some(0), Some("no_gap")), "{arm}: {text}");
        assert!(found["causes"].as_array().is_some_and(Vec::is_empty), "{arm}: {text}");
    }
}

/// Most joints stand, and hold what their friction lets them: friction of one that moves, 1.6 times the file's, was next to nothing of that gap
/// and not named (`unexplained`).
#[test]
fn friction_is_named_where_most_joints_stand() {
    let folder = tempfile::tempdir().expect("a folder");
    let loaded = rivet_config::load(robot("ur10e")).expect("a sound robot file");
    let mut x = loaded.nominal.clone();
    for (parameter, x) in loaded.model.parameters.iter().zip(&mut x) {
        if matches!(parameter, Parameter::Coulomb(1) | Parameter::Viscous(1)) {
            *x *= 1.6;
        }
    }
    let logs = [7, 8].map(|seed| log(&loaded, &x, &[1, 2], seed, folder.path()));
    let (code, text, found) = answer(rivet().arg("diagnose").arg(robot("ur10e")).args(logs), folder.path());
    assert_eq!((code, found["verdict"].as_str()), (Some(1), Some("parameter")), "{text}");
    let causes = found["causes"].as_array().expect("causes");
    let friction = ["coulomb_friction", "viscous_friction"];
    assert!(causes.iter().any(|c| c["effect"] == friction[0]), "{text}");
    for cause in causes.iter().filter(|c| friction.iter().any(|name| c["effect"] == *name)) {
        assert_eq!(cause["joints"], serde_json::json!(["shoulder_lift_joint"]), "{text}");
    }
}

/// What friction may hold of joints that stand throughout the sealed run counts nowhere on it: they were the gap (352 %) and the promise beside
/// the one joint that moves.
#[test]
fn a_sealed_motion_of_one_joint_is_judged_by_that_joint() {
    let folder = tempfile::tempdir().expect("a folder");
    let loaded = rivet_config::load(robot("manutec-r3")).expect("a sound robot file");
    let mut x = loaded.nominal.clone();
    for (parameter, x) in loaded.model.parameters.iter().zip(&mut x) {
        if matches!(parameter, Parameter::Coulomb(2) | Parameter::Viscous(2)) {
            *x *= 1.6;
        }
    }
    let all: Vec<usize> = (0..loaded.dof()).collect();
    let mut random = Random(3);
    let logs = [("all", &all[..], 0.0), ("one", &[2], 3.0)].map(|(name, joints, shift)| {
        let path = folder.path().join(format!("{name}.parquet"));
        let motion = Sines { hz: 0.11, harmonics: 4, size: 0.6, shift };
        motion.log(&loaded, &x, joints, &mut random, &path);
        path
    });
    let (_, text, found) = answer(rivet().arg("diagnose").arg(robot("manutec-r3")).args(logs), folder.path());
    let of = |joint: usize, key: &str| found["gap"]["per_joint"][joint][key].as_f64();
    let counts: Vec<usize> = all.iter().copied().filter(|joint| of(*joint, "before").is_some()).collect();
    assert_eq!(counts, [2], "{text}");
    assert_eq!((of(2, "before"), of(2, "after")), (found["gap"]["before"].as_f64(), found["gap"]["after"].as_f64()));
    let causes = found["causes"].as_array().expect("causes");
    assert!(!causes.is_empty() && causes.iter().all(|c| c["joints"] == serde_json::json!(["joint_3"])), "{text}");
    for cause in causes {
        let shrink = |key: &str| cause["shrink"][key].as_f64().expect("a share");
        assert!((shrink("predicted") - shrink("measured")).abs() < 0.05, "{text}");
    }
}
