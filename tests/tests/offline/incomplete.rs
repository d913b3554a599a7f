//! Logs in which something is not there: the motion of a joint, derivatives of the plan, single samples.

use std::path::Path;

use rivet_logs::{Log, ReadOptions, read, read_columns, write_columns};
use rivet_tests::altered::{result, sound, written};
use rivet_tests::{rivet, robot, shared};
use serde_json::Value;

fn faults<'a>(found: &'a Value, name: &str) -> Vec<&'a Value> {
    found["warnings"].as_array().expect("a list").iter().filter(|w| w["fault"] == name).collect()
}

/// Largest difference of two results in standard deviations of the first.
fn apart(a: &Value, b: &Value) -> f64 {
    let number = |p: &Value, key: &str| p[key].as_f64();
    let pairs = a["parameters"].as_array().expect("a list").iter().zip(b["parameters"].as_array().expect("a list"));
    pairs
        .filter_map(|(a, b)| Some((number(a, "value")? - number(b, "value")?).abs() / number(a, "std")?))
        .fold(0.0, f64::max)
}

/// Two rows of the elbow beside half a minute of the shoulder would be fitted exactly, and count as if they had no noise.
#[test]
fn a_joint_that_hardly_moves_is_not_learnt_from() {
    let Some(log) = shared("data/real/ur10e_innopolis/20_01_22-joint_2.parquet") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("model");
    let mut command = rivet();
    let (_, found) =
        result(command.arg("identify").arg(robot("ur10e")).arg(log).arg("--export").arg(&out), folder.path());
    assert_eq!(faults(&found, "joint_hardly_moves").len(), 1, "{}", found["warnings"]);
    assert!(found["joints"][1]["residual_percent"]["instrumental"].as_f64().expect("it moves") < 5.0);
    assert!(found["joints"][2]["residual_percent"]["instrumental"].is_null(), "{}", found["joints"][2]);
    assert!(found["consistent"]["torque_percent"].as_f64().expect("a number") < 5.0, "{}", found["consistent"]);
    for p in found["parameters"].as_array().expect("a list") {
        let (value, nominal) = (p["value"].as_f64().expect("a number"), p["nominal"].as_f64().expect("a number"));
        if p["name"].as_str().is_some_and(|name| name.starts_with("j3.")) {
            assert!((value - nominal).abs() < 1e-6, "stays as given: {p}");
        }
    }
    let exported = rivet_config::load(out.join("model.toml")).expect("a robot file").config.friction.coulomb;
    let given = rivet_config::load(robot("ur10e")).expect("a robot file").config.friction.coulomb;
    for j in [0, 2, 3, 4, 5] {
        assert!((exported[j] - given[j]).abs() < 0.02 * given[j], "{exported:?} for {given:?}");
    }
}

/// Accelerations, or velocities too, that a planner left at 0: both are made of its positions, off line and on line.
#[test]
fn setpoints_without_derivatives_get_those_of_their_positions() {
    let Some(case) = shared("data/practice/case-24") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let log = read(case.join("log-a.parquet"), &ReadOptions::new(6)).expect("a log");
    let tau = log.torque().expect("torque").clone();
    let found = |log: &Log, online: bool| {
        let path = folder.path().join("planned.parquet");
        let signals = [
            ("q", Some(&log.q)),
            ("tau", Some(&tau)),
            ("q_des", log.q_des.as_ref()),
            ("qd_des", log.qd_des.as_ref()),
            ("qdd_des", log.qdd_des.as_ref()),
        ];
        let mut columns = vec![("t".to_owned(), &log.t[..])];
        for (name, signals) in signals {
            let signals = signals.into_iter().flatten().enumerate();
            columns.extend(signals.map(|(j, signal)| (format!("{name}{}", j + 1), &signal[..])));
        }
        write_columns(&path, &columns).expect("written");
        let mut command = rivet();
        command.arg("identify").arg(case.join("robot.toml")).arg(path);
        result(if online { command.arg("--online") } else { &mut command }, folder.path())
    };
    let none =
        |signals: &Option<Vec<Vec<f64>>>| signals.as_ref().map(|s| s.iter().map(|x| vec![0.0; x.len()]).collect());
    let no_acceleration = Log { qdd_des: none(&log.qdd_des), ..log.clone() };
    let positions_alone = Log { qd_des: none(&log.qd_des), ..no_acceleration.clone() };
    let sound = [false, true].map(|online| found(&log, online).1);
    for log in [&no_acceleration, &positions_alone] {
        let (_, off) = found(log, false);
        assert_eq!(faults(&off, "setpoint_not_derived").len(), 6, "{}", off["warnings"]);
        assert!(apart(&sound[0], &off) < 0.5, "{}", apart(&sound[0], &off));
        let (text, on) = found(log, true);
        assert!(text.contains("is not the derivative of q_des"), "{text}");
        assert!(apart(&sound[1], &on) < 1.0, "{}", apart(&sound[1], &on));
    }
    // Columns that are not there are made as well, and nothing is wrong with that.
    for log in [Log { qdd_des: None, ..log.clone() }, Log { qd_des: None, qdd_des: None, ..log.clone() }] {
        for (online, sound) in [false, true].into_iter().zip(&sound) {
            let (text, found) = found(&log, online);
            assert!(!text.contains("is not the derivative of q_des") && !text.contains("delayed (no"), "{text}");
            assert!(apart(sound, &found) < 1.0, "{}", apart(sound, &found));
        }
    }
}

/// A row that comes a moment after another one is worth nothing, and spoils nothing; a prediction has it all the same.
#[test]
fn rows_right_after_another_cost_nothing() {
    let Some(case) = shared("data/practice/case-24") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let log = read(case.join("log-a.parquet"), &ReadOptions::new(6)).expect("a log");
    let crowd = [300, 700, 701, 1100, 1500];
    let doubled = |x: &[f64], apart: f64| -> Vec<f64> {
        let each = |(k, x): (usize, &f64)| std::iter::once(*x).chain(crowd.contains(&k).then_some(x + apart));
        x.iter().enumerate().flat_map(each).collect()
    };
    let of = |signals: &Vec<Vec<f64>>| signals.iter().map(|x| doubled(x, 0.0)).collect::<Vec<_>>();
    let tau = log.torque().expect("torque");
    let crowded = Log { t: doubled(&log.t, 1e-5), q: of(&log.q), q_des: log.q_des.as_ref().map(of), ..log.clone() };
    let found = |log: &Log, tau: &[Vec<f64>]| {
        let path = written(log, tau, folder.path());
        result(rivet().arg("identify").arg(case.join("robot.toml")).arg(path), folder.path())
    };
    let (_, sound) = found(&log, tau);
    let (text, mended) = found(&crowded, &of(tau));
    assert!(text.contains("5 rows right after another"), "{text}");
    assert!(apart(&sound, &mended) < 0.5, "{}", apart(&sound, &mended));
    let out = folder.path().join("predicted.parquet");
    let path = written(&crowded, &of(tau), folder.path());
    let mut predict = rivet();
    assert!(
        predict
            .arg("predict")
            .arg(case.join("robot.toml"))
            .arg(path)
            .arg("--out")
            .arg(&out)
            .status()
            .is_ok_and(|s| s.success())
    );
    let columns = read_columns(&out, &["t", "tau_pred1"]).expect("a prediction");
    assert!(columns[0] == crowded.t && columns[1].len() == crowded.t.len());
}

/// A row of zeros now and then, on all joints at once, is no torque.
#[test]
fn torque_that_drops_out_is_bridged() {
    let Some(path) = shared("data/real/staubli_tx40/exciting_0.0-5.5s.parquet") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let log = sound("staubli-tx40", &path);
    let tau = log.torque().expect("torque").clone();
    let mut lost = tau.clone();
    for tau in lost.iter_mut().flat_map(|tau| tau.iter_mut().skip(1000).step_by(400)) {
        *tau = 0.0;
    }
    let found = |tau: &[Vec<f64>], folder: &Path| {
        let path = written(&log, tau, folder);
        result(rivet().arg("identify").arg(robot("staubli-tx40")).arg(path), folder).1
    };
    let [whole, bridged] = [&tau, &lost].map(|tau| found(tau, folder.path()));
    assert_eq!(faults(&bridged, "torque_lost").len(), 1, "{}", bridged["warnings"]);
    assert!(faults(&whole, "torque_lost").is_empty());
    assert!(apart(&whole, &bridged) < 0.2, "{}", apart(&whole, &bridged));
}
