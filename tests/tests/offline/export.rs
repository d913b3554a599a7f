//! `rivet identify --export`: the URDF holds bodies that can be built, the model the set that predicts left-out rows better.

use std::f64::consts::TAU;

use rivet_config::{Robot, load};
use rivet_dynamics::{Parameter, Workspace, smallest_eigenvalue};
use rivet_logs::write_columns;
use rivet_tests::{rivet, robot, succeed};
use serde_json::Value;

/// Positions, speeds and accelerations of `n` joints at a time.
fn motion(n: usize, t: f64) -> [Vec<f64>; 3] {
    let mut all = [(); 3].map(|()| vec![0.0; n]);
    let [q, qd, qdd] = &mut all;
    for j in 0..n {
        for (i, hz) in [0.21, 0.47, 0.93].into_iter().enumerate() {
            let w = TAU * hz * (1.0 + 0.07 * j as f64);
            let (at, a) = (w * t + (3 * i + 2 * j) as f64, [0.5, 0.3, 0.15][i]);
            q[j] += a * at.sin();
            qd[j] += a * w * at.cos();
            qdd[j] -= a * w * w * at.sin();
        }
    }
    all
}

/// Twelve seconds of all joints at 500 Hz, torque of the nominal arm with drives a fifth stronger, and its noise.
fn log(robot: &Robot, path: &std::path::Path) {
    let (n, full) = (robot.dof(), robot.model.len());
    let mut truth = robot.nominal.clone();
    truth[10 * n..].iter_mut().for_each(|v| *v *= 1.2);
    let mut ws = Workspace::new(&robot.model.arm);
    let mut y = vec![0.0; n * full];
    let mut columns = vec![Vec::new(); 1 + 3 * n];
    let mut state = 7_u64;
    let mut noise = || {
        let mut unit = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1_u64 << 53) as f64
        };
        (0..12).map(|_| unit()).sum::<f64>() - 6.0
    };
    for k in 0..6000 {
        let t = f64::from(k) / 500.0;
        let [q, qd, qdd] = motion(n, t);
        robot.model.regressor(&mut ws, &q, &qd, &qdd, &mut y);
        columns[0].push(t);
        for j in 0..n {
            let tau: f64 = y[j * full..(j + 1) * full].iter().zip(&truth).map(|(y, x)| y * x).sum();
            columns[1 + j].push(q[j] - robot.config.log.joint_zero[j]);
            columns[1 + n + j].push(tau + 0.02 * robot.config.drive.torque_limit[j] * noise());
            columns[1 + 2 * n + j].push(q[j] - robot.config.log.joint_zero[j]);
        }
    }
    let mut names = vec!["t".to_owned()];
    for kind in ["q", "tau", "q_des"] {
        names.extend((1..=n).map(|j| format!("{kind}{j}")));
    }
    let named: Vec<(&str, &[f64])> = names.iter().map(String::as_str).zip(columns.iter().map(Vec::as_slice)).collect();
    write_columns(path, &named).expect("a log");
}

#[test]
fn exported_urdf_is_the_consistent_set_and_the_model_the_identified_one() {
    for arm in ["manutec-r3", "staubli-tx40", "ur10e"] {
        let known = load(robot(arm)).expect("a sound robot file");
        let folder = tempfile::tempdir().expect("a folder");
        let (path, json, out) =
            (folder.path().join("log.parquet"), folder.path().join("found.json"), folder.path().join("model"));
        log(&known, &path);
        let mut identify = rivet();
        identify.arg("identify").arg(robot(arm)).arg(&path).arg("--json").arg(&json).arg("--export").arg(&out);
        let printed = String::from_utf8(succeed(&mut identify).stdout).expect("text");
        for said in ["bias of LS", "bias of IV", "physical consistency"] {
            assert!(printed.contains(said), "{said} in\n{printed}");
        }
        let found: Value = serde_json::from_slice(&std::fs::read(&json).expect("a result")).expect("JSON");
        let numbers = |list: &Value| -> Vec<f64> {
            let list = list.as_array().expect("a list").iter();
            list.map(|entry| entry["value"].as_f64().expect("a number")).collect()
        };
        let (identified, consistent) = (numbers(&found["parameters"]), numbers(&found["consistent"]["base"]));
        println!("{arm}: {} % torque", found["consistent"]["torque_percent"]);
        assert!(found["consistent"]["torque_percent"].as_f64().expect("a number") < 2.0);
        assert!((0.0..=1.0).contains(&found["bias"]["p_value"].as_f64().expect("a number")));

        let exported = load(out.join("model.toml")).expect("the model reads back");
        // The reader of JSON rounds the last digit.
        let wanted = if found["exported"] == "consistent" { &consistent } else { &identified };
        let close = |(read, wanted): (&f64, &f64)| (read - wanted).abs() <= 1e-9 * wanted.abs().max(1e-3);
        assert!(exported.base_parameters().iter().zip(wanted).all(close), "{arm}: model.toml has the exported set");
        // Offsets that the file leaves open are parameters of another model.
        assert_eq!(exported.hash == known.hash, known.config.estimator.offsets, "{arm}");
        let largest = consistent.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        for (i, (read, wanted)) in exported.nominal_base.iter().zip(&consistent).enumerate() {
            let name = exported.base.name(&exported.model, i);
            assert!((read - wanted).abs() <= 1e-9 * (wanted.abs() + 1e-3 * largest), "{arm} {name}: {read} {wanted}");
        }
        assert!(exported.model.arm.links.iter().all(|body| smallest_eigenvalue(body) > 0.0));
        let notes = std::fs::read_to_string(out.join("not-expressible.md")).expect("notes");
        assert!(notes.contains("rotor inertia") && notes.contains("N m"), "{notes}");
        assert_eq!(notes.contains("coupled wrist"), arm == "staubli-tx40");
        let urdf = std::fs::read_to_string(out.join("robot.urdf")).expect("a URDF");
        assert!(urdf.contains("<dynamics damping="));
    }
}

/// What a URDF has no word for costs its reader the torque that these terms make along the log.
#[test]
fn what_a_urdf_cannot_say_of_refined_friction_has_its_price() {
    let folder = tempfile::tempdir().expect("a folder");
    let source = robot("ur10e");
    std::fs::copy(source.with_file_name("robot.urdf"), folder.path().join("robot.urdf")).expect("copied");
    let text = std::fs::read_to_string(&source).expect("readable");
    let refined = "[friction]\nload_dependent = 0.06\nviscous_quadratic = [-3, -3, -2, -0.4, -0.3, -0.4]\npresliding_travel = 3e-4";
    let file = folder.path().join("robot.toml");
    std::fs::write(&file, text.replacen("[friction]", refined, 1)).expect("written");
    let known = load(&file).expect("a sound robot file");
    let (path, out) = (folder.path().join("log.parquet"), folder.path().join("model"));
    log(&known, &path);
    succeed(rivet().arg("identify").arg(&file).arg(&path).arg("--export").arg(&out));
    let notes = std::fs::read_to_string(out.join("not-expressible.md")).expect("notes");
    assert!(notes.contains("over a travel of 0.0003 rad after each reversal"), "{notes}");
    let cells = |row: &str| -> Vec<f64> {
        let line = notes.lines().find(|line| line.starts_with(&format!("| {row} |"))).expect(row);
        line.split('|').skip(3).filter_map(|cell| cell.trim().parse().ok()).collect()
    };
    // The same of the exported values, along the motion as it was made, unfiltered.
    let found = load(out.join("model.toml")).expect("the model reads back");
    let wanted = |of: &dyn Fn(&Parameter) -> bool| -> Vec<f64> {
        let (n, full) = (known.dof(), known.model.len());
        let values: Vec<f64> =
            known.model.parameters.iter().zip(&found.nominal).map(|(p, x)| if of(p) { *x } else { 0.0 }).collect();
        let (mut ws, mut y, mut squares) = (Workspace::new(&known.model.arm), vec![0.0; n * full], vec![0.0; n]);
        let samples = 3000;
        for k in 0..samples {
            let [q, qd, qdd] = motion(n, 12.0 * f64::from(k) / f64::from(samples));
            known.model.regressor(&mut ws, &q, &qd, &qdd, &mut y);
            for (square, y) in squares.iter_mut().zip(y.chunks_exact(full)) {
                *square += y.iter().zip(&values).map(|(y, x)| y * x).sum::<f64>().powi(2) / f64::from(samples);
            }
        }
        squares.iter().map(|square| square.sqrt()).collect()
    };
    type Of = fn(&Parameter) -> bool;
    let rows: [(&str, Of); 2] = [
        ("friction with load", |p| matches!(p, Parameter::LoadFriction(_))),
        ("friction with the square of speed", |p| matches!(p, Parameter::ViscousQuadratic(_))),
    ];
    for (row, of) in rows {
        let (told, wanted) = (cells(row), wanted(&of));
        println!("{row}: {told:.3?} {wanted:.3?}");
        assert_eq!(told.len(), wanted.len());
        for (told, wanted) in told.iter().zip(&wanted) {
            assert!((told - wanted).abs() <= 0.15 * wanted + 0.02, "{row}: {told} for {wanted} N m");
        }
    }
    let all = cells("all of these");
    let part = cells("friction with load");
    assert!(all.iter().zip(&part).any(|(all, part)| (all - part).abs() > 0.1), "{all:?}");
}
