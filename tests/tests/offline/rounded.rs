//! Torque in steps that no noise blurs, on slow motion: errors of rounding come again with the motion, and residuals say nothing of them.

use std::f64::consts::TAU;

use rivet_config::Robot;
use rivet_dynamics::Workspace;
use rivet_logs::write_columns;
use rivet_tests::altered::{Random, result};
use rivet_tests::{rivet, robot};
use serde_json::Value;

const PERIOD_S: f64 = 1e-3;
const SECONDS: f64 = 40.0;
/// Waves of a joint, each so many in ten seconds.
const WAVES: usize = 5;
/// Largest speed of a joint \[rad/s\].
const SLOW: f64 = 0.1;

/// A motion that comes again every ten seconds: positions, velocities and accelerations by joint.
fn motion(joints: usize, seed: u64) -> [Vec<Vec<f64>>; 3] {
    let mut random = Random(seed);
    let rows = (SECONDS / PERIOD_S) as usize;
    let mut motion = [0; 3].map(|_| vec![vec![0.0; rows]; joints]);
    for j in 0..joints {
        let waves: Vec<[f64; 3]> = (1..=WAVES)
            .map(|k| [0.1 * TAU * k as f64, SLOW / WAVES as f64 * (1.0 + random.uniform()), TAU * random.uniform()])
            .collect();
        for row in 0..rows {
            let t = row as f64 * PERIOD_S;
            for [w, speed, phase] in &waves {
                motion[0][j][row] += speed / w * (w * t + phase).sin();
                motion[1][j][row] += speed * (w * t + phase).cos();
                motion[2][j][row] -= speed * w * (w * t + phase).sin();
            }
        }
    }
    motion
}

/// Standard parameters of a UR10e whose friction and rotors are a sixth more than its file says.
fn truth(robot: &Robot) -> Vec<f64> {
    let links = 10 * robot.dof();
    let more = |(c, value): (usize, &f64)| if c < links { *value } else { value * 7.0 / 6.0 };
    robot.nominal.iter().enumerate().map(more).collect()
}

/// What `rivet identify` says of that arm's log, its torque in steps; `kept`: whether a row is in it.
fn told(robot: &Robot, step: f64, seed: u64, kept: impl Fn(usize) -> bool) -> (String, Value) {
    let (model, n) = (&robot.model, robot.dof());
    let truth = truth(robot);
    let [q, qd, qdd] = motion(n, seed);
    let mut ws = Workspace::new(&model.arm);
    let mut y = vec![0.0; n * model.len()];
    let mut tau = vec![Vec::new(); n];
    let at = |signals: &[Vec<f64>], row: usize| signals.iter().map(|s| s[row]).collect::<Vec<f64>>();
    for row in 0..q[0].len() {
        model.regressor(&mut ws, &at(&q, row), &at(&qd, row), &at(&qdd, row), &mut y);
        for (tau, y) in tau.iter_mut().zip(y.chunks_exact(model.len())) {
            let torque: f64 = y.iter().zip(&truth).map(|(y, x)| y * x).sum();
            tau.push(step * (torque / step).round());
        }
    }
    let rows = || (0..q[0].len()).filter(|row| kept(*row));
    let t: Vec<f64> = rows().map(|row| row as f64 * PERIOD_S).collect();
    let mut columns = vec![("t".to_owned(), t)];
    for (name, group) in [("q", &q), ("tau", &tau), ("q_des", &q), ("qd_des", &qd), ("qdd_des", &qdd)] {
        let of =
            |(j, signal): (usize, &Vec<f64>)| (format!("{name}{}", j + 1), rows().map(|row| signal[row]).collect());
        columns.extend(group.iter().enumerate().map(of));
    }
    let columns: Vec<(&str, &[f64])> = columns.iter().map(|(name, values)| (name.as_str(), &values[..])).collect();
    let folder = tempfile::tempdir().expect("a folder");
    let log = folder.path().join("log.parquet");
    write_columns(&log, &columns).expect("written");
    result(rivet().arg("identify").arg(rivet_tests::robot("ur10e")).arg(log), folder.path())
}

/// Errors of the values found, in standard deviations.
fn errors(robot: &Robot, step: f64, seed: u64) -> Vec<f64> {
    let (_, found) = told(robot, step, seed, |_| true);
    let base = robot.base.from_standard(&truth(robot));
    let of = found["parameters"].as_array().expect("parameters").iter().zip(base);
    of.map(|(p, truth)| {
        let number = |key: &str| p[key].as_f64().expect("a number");
        (number("value") - truth) / number("std")
    })
    .collect()
}

/// Torque that stands within a step for seconds, and often at its outermost one, is neither dead nor cut.
#[test]
fn coarse_torque_is_no_channel_at_fault() {
    let robot = rivet_config::load(robot("ur10e")).expect("a sound robot file");
    for (step, seed) in [(1.0, 2), (2.0, 2)] {
        let (text, found) = told(&robot, step, seed, |_| true);
        let faults = found["warnings"].as_array().expect("a list").iter().filter_map(|w| w["fault"].as_str());
        let wrong: Vec<&str> =
            faults.filter(|f| ["torque_stood", "torque_clipped", "arm_changes"].contains(f)).collect();
        assert!(wrong.is_empty(), "{wrong:?}: {text}");
    }
}

/// 53 to 88 % lay within two deviations, the worst was 50 of them off. Friction of whole steps is the hard part: what the values found make
/// is rounded to itself.
#[test]
fn standard_deviations_hold_what_rounding_does() {
    let robot = rivet_config::load(robot("ur10e")).expect("a sound robot file");
    let (mut all, mut worst) = (Vec::new(), 0.0_f64);
    for (step, seed) in [(0.5, 1), (1.0, 2), (2.0, 3)] {
        let found = errors(&robot, step, seed);
        let inside = found.iter().filter(|e| e.abs() <= 2.0).count();
        worst = found.iter().fold(worst, |worst, e| worst.max(e.abs()));
        println!("steps of {step} N m: {inside} of {} within two deviations, worst so far {worst:.1}", found.len());
        all.extend(found);
    }
    let inside = all.iter().filter(|e| e.abs() <= 2.0).count();
    assert!(inside as f64 >= 0.9 * all.len() as f64, "{inside} of {}", all.len());
    assert!(worst < 6.0, "{worst}");
    // Not by being huge: half of the errors are a fifth of a deviation and more.
    let mut sizes: Vec<f64> = all.iter().map(|e| e.abs()).collect();
    sizes.sort_unstable_by(f64::total_cmp);
    assert!(sizes[sizes.len() / 2] > 0.2, "{}", sizes[sizes.len() / 2]);
}

/// A row alone between holes has no motion along which torque could be rounded again: the log was refused for it.
#[test]
fn a_row_alone_between_holes_ends_nothing() {
    let robot = rivet_config::load(robot("ur10e")).expect("a sound robot file");
    let (text, found) = told(&robot, 1.0, 2, |row| !(10_000..10_600).contains(&row) || row == 10_300);
    assert_eq!(found["parameters"].as_array().map(Vec::len), Some(58), "{text}");
    let words: Vec<&str> = text.split_whitespace().collect();
    assert!(words.join(" ").contains("Standard deviations include the effect of this rounding"), "{text}");
}
