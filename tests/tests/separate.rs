//! The motion that `rivet diagnose --export` writes for a class tells its members apart, on either of two arms.

use std::path::Path;

use rivet_config::{Robot, load};
use rivet_dynamics::{EffectKind, KnownEffect, KnownEffects, Model, Workspace};
use rivet_logs::{ReadOptions, read, write_columns};
use rivet_simulation::motion::Recorded;
use rivet_simulation::{Disturbances, Plant, PlantSettings, Sensors, Truth, closed_loop};
use rivet_tests::{rivet, shared};
use serde_json::Value;

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

/// Follows the setpoints with the plant, feed-forward of its own model and a loop of 3 Hz; writes what drives and encoders
/// say.
fn run(robot: &Robot, effect: KnownEffect, setpoints: &Path, path: &Path) {
    let (n, joints) = (robot.dof(), robot.config.nominal_joints());
    let model: Model = (*robot.model).clone().with_effects(KnownEffects::new(vec![effect], &joints));
    let truth = Truth::new(&model, &joints, &Disturbances::default());
    assert!(truth.left_out().is_empty());
    let sensors = Sensors {
        resolution: robot.config.drive.encoder_resolution.clone(),
        position_noise: vec![0.0; n],
        torque_noise: robot.config.drive.torque_limit.iter().map(|t| 0.002 * t).collect(),
    };
    let period_s = robot.config.sample_period_s;
    let options = ReadOptions { joints: n, drive_gain: None, joint_zero: Some(&robot.config.log.joint_zero) };
    let log = read(setpoints, &options).expect("the motion reads as a log");
    for (q, joint) in log.q.iter().zip(&robot.model.arm.joints) {
        assert!(q.iter().all(|q| (joint.lower..=joint.upper).contains(q)), "{} leaves its range", joint.name);
    }
    let motion = Recorded {
        period_s,
        q: log.q_des.clone().expect("q_des"),
        qd: log.qd_des.clone().expect("qd_des"),
        qdd: log.qdd_des.clone().expect("qdd_des"),
    };
    let start: Vec<f64> = motion.q.iter().map(|q| q[0]).collect();
    let mut plant = Plant::new(&truth, &sensors, &PlantSettings::new(period_s, &robot.config.drive.torque_limit), 5);
    plant.place(&start, &vec![0.0; n]);
    let x = model.nominal(&joints);
    let (mut ws, mut y) = (Workspace::new(&model.arm), vec![0.0; n * model.len()]);
    let mut mass = vec![0.0; n * n];
    rivet_dynamics::mass_matrix(&model.arm, &model.arm.links, &mut ws, &start, &mut mass);
    let omega = std::f64::consts::TAU * 3.0;
    let mut last = start.clone();
    let mut columns = vec![Vec::new(); 1 + 2 * n];
    closed_loop(
        &mut plant,
        &motion,
        |measured, plan, command| {
            model.regressor(&mut ws, plan.q, plan.qd, plan.qdd, &mut y);
            for (tau, row) in command.iter_mut().zip(y.chunks_exact(model.len())) {
                *tau = row.iter().zip(&x).map(|(y, x)| y * x).sum();
            }
            model.add_effects(&mut ws, plan.q, plan.qd, plan.qdd, command);
            for j in 0..n {
                let inertia = mass[j * n + j] + joints.rotor_inertia[j];
                let speed = (measured.q()[j] - last[j]) / period_s;
                last[j] = measured.q()[j];
                command[j] +=
                    inertia * (omega * omega * (plan.q[j] - measured.q()[j]) + 1.4 * omega * (plan.qd[j] - speed));
            }
        },
        log.len(),
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

/// A spring and a counterbalance explain another program's log alike. With the log of the motion beside it, from an arm
/// that has one of the two, only that one is named.
#[test]
fn the_separating_motion_separates() {
    let Some(data) = shared("data/practice") else { return };
    let case = data.join("case-16");
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let (robot, first, last) = (case.join("robot.toml"), case.join("log-a.parquet"), case.join("log-b.parquet"));
    let found = diagnose(&robot, &[&first, &last], Some(&at("out")), &at("first.json"));
    let cause = &found["causes"][0];
    assert_eq!(cause["effect"], "joint_spring");
    assert_eq!(cause["indistinguishable_from"][0], "counterbalance", "{cause:#}");
    let model = load(at("out").join("model.toml")).unwrap_or_else(|e| panic!("{e}"));
    let spring = model.config.effects[0];
    assert_eq!(spring.kind, EffectKind::JointSpring);
    run(&model, spring, &at("out").join("separating-1.csv"), &at("motion.parquet"));
    let again = diagnose(&robot, &[&first, &at("motion.parquet"), &last], None, &at("again.json"));
    let spring: Vec<&Value> =
        again["causes"].as_array().expect("causes").iter().filter(|c| c["effect"] == "joint_spring").collect();
    assert_eq!(spring.len(), 1, "{again:#}");
    assert_eq!(spring[0]["indistinguishable_from"].as_array().map(Vec::len), Some(0), "{:#}", spring[0]);
    assert!(!again["causes"].as_array().expect("causes").iter().any(|c| c["effect"] == "counterbalance"));
}
