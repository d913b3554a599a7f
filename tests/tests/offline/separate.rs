//! The motion that `rivet diagnose --export` writes for a class tells its members apart.

use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

use rivet_config::{Robot, load};
use rivet_dynamics::{EffectKind, KnownEffect, KnownEffects, Model, Workspace, mass_matrix};
use rivet_logs::{ReadOptions, read, write_columns};
use rivet_simulation::motion::Recorded;
use rivet_simulation::{Disturbances, FrictionLaw, Plant, PlantSettings, Sensors, Truth, closed_loop};
use rivet_tests::{rivet, robot};
use serde_json::Value;

/// The elbow, from 0.
const JOINT: usize = 2;

fn diagnose(robot: &Path, logs: &[&Path], export: Option<&Path>, json: &Path) -> Value {
    let mut command = rivet();
    command.arg("diagnose").arg(robot).args(logs).arg("--json").arg(json);
    if let Some(folder) = export {
        command.arg("--export").arg(folder);
    }
    let output = command.output().expect("the program starts");
    let text = std::fs::read_to_string(json)
        .unwrap_or_else(|why| panic!("{why}\n{}", String::from_utf8_lossy(&output.stderr)));
    serde_json::from_str(&text).expect("JSON")
}

/// Sines on all joints; the elbow goes two degrees only, over which a spring and a counterbalance look alike.
fn small(robot: &Robot, seconds: f64, shift: f64) -> Recorded {
    let period_s = robot.config.sample_period_s;
    let home = [0.3, -1.2, 0.3, -0.8, 0.6, 0.2];
    let samples = (seconds / period_s) as usize;
    let of = |derivative: i32| -> Vec<Vec<f64>> {
        let joint = |j: usize| {
            let amplitude = if j == JOINT { 0.03 } else { 0.25 };
            let at = |k: usize| {
                let t = k as f64 * period_s;
                let wave = |hz: f64, phase: f64| {
                    let omega = TAU * hz;
                    amplitude * omega.powi(derivative) * (omega * t + phase + f64::from(derivative) * TAU / 4.0).sin()
                };
                let level = if derivative == 0 { home[j] } else { 0.0 };
                level + wave(0.17 + 0.02 * j as f64, shift * j as f64) + 0.5 * wave(0.41 + 0.03 * j as f64, shift)
            };
            (0..samples).map(at).collect()
        };
        (0..robot.dof()).map(joint).collect()
    };
    Recorded { period_s, q: of(0), qd: of(1), qdd: of(2) }
}

/// The planned motion of a file of setpoints, which must stay within the joints' ranges.
fn planned(robot: &Robot, path: &Path) -> Recorded {
    let options = ReadOptions { joint_zero: Some(&robot.config.log.joint_zero), ..ReadOptions::new(robot.dof()) };
    let log = read(path, &options).expect("the motion reads as a log");
    for (q, joint) in log.q.iter().zip(&robot.model.arm.joints) {
        assert!(q.iter().all(|q| (joint.lower..=joint.upper).contains(q)), "{} leaves its range", joint.name);
    }
    Recorded {
        period_s: robot.config.sample_period_s,
        q: log.q_des.clone().expect("q_des"),
        qd: log.qd_des.clone().expect("qd_des"),
        qdd: log.qdd_des.clone().expect("qdd_des"),
    }
}

/// An arm with one effect more than its file follows a motion, by its own model fed forward and a loop of 3 Hz; what drives
/// and encoders say is written as a log.
fn run(robot: &Robot, effect: KnownEffect, motion: &Recorded, seed: u64, path: &Path) {
    let (n, joints) = (robot.dof(), robot.config.nominal_joints());
    let model: Model = (*robot.model).clone().with_effects(KnownEffects::new(vec![effect], &joints));
    let truth = Truth::new(&model, &joints, &Disturbances::default());
    assert!(truth.left_out().is_empty());
    let sensors = Sensors {
        resolution: robot.config.drive.encoder_resolution.clone(),
        position_noise: vec![0.0; n],
        torque_noise: robot.config.drive.torque_limit.iter().map(|t| 0.003 * t).collect(),
    };
    let period_s = robot.config.sample_period_s;
    let start: Vec<f64> = motion.q.iter().map(|q| q[0]).collect();
    let speed: Vec<f64> = motion.qd.iter().map(|q| q[0]).collect();
    let mut settings = PlantSettings::new(period_s, &robot.config.drive.torque_limit);
    settings.friction = FrictionLaw::Smooth { velocity: robot.config.signal.friction_velocity };
    let mut plant = Plant::new(&truth, &sensors, &settings, seed);
    plant.place(&start, &speed);
    let x = model.nominal(&joints);
    let (mut ws, mut y) = (Workspace::new(&model.arm), vec![0.0; n * model.len()]);
    let mut mass = vec![0.0; n * n];
    mass_matrix(&model.arm, &model.arm.links, &mut ws, &start, &mut mass);
    let omega = TAU * 3.0;
    let mut last = start.clone();
    let mut columns = vec![Vec::new(); 1 + 2 * n];
    closed_loop(
        &mut plant,
        motion,
        |measured, plan, command| {
            model.regressor(&mut ws, plan.q, plan.qd, plan.qdd, &mut y);
            for (tau, row) in command.iter_mut().zip(y.chunks_exact(model.len())) {
                *tau = row.iter().zip(&x).map(|(y, x)| y * x).sum();
            }
            model.add_effects(&mut ws, plan.q, plan.qd, plan.qdd, command);
            for j in 0..n {
                let inertia = mass[j * n + j] + joints.rotor_inertia[j];
                let before = std::mem::replace(&mut last[j], measured.q()[j]);
                let speed = (measured.q()[j] - before) / period_s;
                command[j] +=
                    inertia * (omega * omega * (plan.q[j] - measured.q()[j]) + 1.4 * omega * (plan.qd[j] - speed));
            }
        },
        motion.q[0].len(),
        |record| {
            let t = columns[0].len() as f64 * period_s;
            columns[0].push(t);
            for j in 0..n {
                columns[1 + j].push(record.measured.q()[j] - robot.config.log.joint_zero[j]);
                columns[1 + n + j].push(record.measured.tau()[j]);
            }
        },
    );
    let names: Vec<String> = std::iter::once("t".to_owned())
        .chain(["q", "tau"].iter().flat_map(|kind| (1..=n).map(move |j| format!("{kind}{j}"))))
        .collect();
    let named: Vec<(&str, &[f64])> = names.iter().map(String::as_str).zip(columns.iter().map(Vec::as_slice)).collect();
    write_columns(path, &named).expect("a log");
}

/// Effects that a cause may be, itself first.
fn class(cause: &Value) -> Vec<&str> {
    let others = cause["indistinguishable_from"].as_array().expect("a list").iter();
    std::iter::once(&cause["effect"]).chain(others).filter_map(Value::as_str).collect()
}

fn of_either(found: &Value) -> Vec<Vec<&str>> {
    let all = found["causes"].as_array().expect("causes").iter().map(class);
    all.filter(|c| c.iter().any(|e| ["joint_spring", "counterbalance"].contains(e))).collect()
}

/// Over two degrees a spring and a counterbalance are the same to a log, so both are said. With the log of the motion
/// that was planned for this class, made by the arm as it is, only what the arm has is said.
fn separated(effect: KnownEffect) {
    let file = robot("ur10e");
    let robot = load(&file).unwrap_or_else(|e| panic!("{e}"));
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| -> PathBuf { folder.path().join(name) };
    for (k, name) in ["first.parquet", "last.parquet"].iter().enumerate() {
        run(&robot, effect, &small(&robot, 14.0, 1.0 + k as f64), 7 + k as u64, &at(name));
    }
    let (first, last) = (at("first.parquet"), at("last.parquet"));
    let found = diagnose(&file, &[&first, &last], Some(&at("out")), &at("first.json"));
    let both = of_either(&found);
    assert_eq!(both.len(), 1, "{found:#}");
    assert!(["joint_spring", "counterbalance"].iter().all(|e| both[0].contains(e)), "{:?}", both[0]);

    let told = found["causes"].as_array().expect("causes").iter().find_map(|c| c["separating_motion"].as_str());
    assert!(told.is_some_and(|text| text.contains("of joint 3, the others still")), "what was exported: {told:?}");

    let motion = planned(&robot, &at("out/separating-1.csv"));
    run(&robot, effect, &motion, 9, &at("motion.parquet"));
    let again = diagnose(&file, &[&first, &at("motion.parquet"), &last], None, &at("again.json"));
    assert_eq!(of_either(&again), [[effect.kind.name()]], "{again:#}");
}

#[test]
fn the_motion_that_is_planned_shows_a_spring() {
    separated(KnownEffect::new(EffectKind::JointSpring, JOINT, &[100.0]));
}

/// The other way round: a weight on a lever, which over two degrees is a spring as well.
#[test]
fn the_motion_that_is_planned_shows_a_counterbalance() {
    separated(KnownEffect::new(EffectKind::Counterbalance, JOINT, &[150.0, 0.0, 0.5, 0.4]));
}
