//! Measured arms whose robot files know as little as a new user's: what is left open is chosen from the logs.

use rivet_logs::{ReadOptions, read};
use rivet_tests::altered::{Random, changed, result, robot_with, said, sound, written};
use rivet_tests::sines::Sines;
use rivet_tests::{rivet, robot, root, shared, succeed};
use serde_json::Value;

const UR10E_LOG: &str = "data/real/ur10e_innopolis/20_02_10-20sec_7harm.parquet";

/// Splits on which plain least squares is still better by default (`docs/real-data.md`).
const OPEN: [&str; 2] = ["DFKI A0, four runs to 75 s", "Shanghai, 1 to 2, joints 1-3"];

fn number(value: &Value) -> f64 {
    value.as_f64().expect("a number")
}

#[test]
fn strangers_are_predicted_no_worse_than_by_plain_least_squares() {
    let Some(data) = shared("data/real") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("strangers.json");
    let mut run = rivet();
    run.args(["study", "strangers", "--root"]).arg(root()).arg("--data").arg(data).arg("--json").arg(&file);
    succeed(&mut run);
    let found: Value = serde_json::from_str(&std::fs::read_to_string(&file).expect("written")).expect("JSON");
    let splits = found["splits"].as_array().expect("splits");
    for split in splits {
        let [default, refined] = ["default", "refined"].map(|way| &split[way]);
        let [by_default, by_refine] = [default, refined].map(|way| number(&way["mean_ratio"]));
        println!("{}: {by_default:.3}, --refine {by_refine:.3}", split["split"]);
        let name = split["split"].as_str().expect("a name");
        let open = OPEN.contains(&name);
        assert!(by_default < if open { 1.1 } else { 1.005 }, "{name}: {by_default}");
        assert!(by_refine <= by_default + 0.005, "{name}: {by_refine} against {by_default}");
        // A torque at the motor side exceeds the limits that this URDF has for the joint side.
        let measured = number(&split["measured_over_limit"]).max(1.0);
        let most = if measured > 2.0 { 1.5 * measured } else { measured };
        for way in [default, refined] {
            assert!(number(&way["torque_over_limit"]) <= most, "{split}");
        }
    }
    assert_eq!(splits.len(), 12);
}

/// Friction of these arms changes sign within milliseconds. A prediction low-passed at twice the model filter's 5 Hz had 1.43 times the error
/// of plain least squares on the second arm.
#[test]
fn drawn_arms_are_predicted_no_worse_than_by_plain_least_squares() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("drawn.json");
    let mut run = rivet();
    run.args(["study", "strangers", "--drawn", "2", "--seed", "901", "--root"]).arg(root()).arg("--json").arg(&file);
    succeed(&mut run);
    let found: Value = serde_json::from_str(&std::fs::read_to_string(&file).expect("written")).expect("JSON");
    let splits = found["splits"].as_array().expect("splits");
    assert_eq!(splits.len(), 2);
    for split in splits {
        let [by_default, by_refine] = ["default", "refined"].map(|way| number(&split[way]["mean_ratio"]));
        println!("{}: {by_default:.3}, --refine {by_refine:.3}", split["split"]);
        assert!(by_default < 1.05, "{split}");
        assert!(by_refine <= by_default + 0.005, "{split}");
    }
}

#[test]
fn an_offset_that_the_file_gives_as_zero_is_identified() {
    let Some(path) = shared(UR10E_LOG) else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let log = sound("ur10e", &path);
    let mut tau = log.torque().expect("torque").clone();
    let file = robot_with("ur10e", folder.path(), "offsets = true\n", "");
    let offset = |tau: &[Vec<f64>]| {
        let log = written(&log, tau, folder.path());
        let (_, found) = result(rivet().arg("identify").arg(&file).arg(log), folder.path());
        let all = found["parameters"].as_array().expect("a list").clone();
        let it = all.iter().find(|p| p["name"] == "j5.offset").expect("offsets are parameters");
        number(&it["value"])
    };
    let before = offset(&tau);
    tau[4].iter_mut().for_each(|tau| *tau += 2.0);
    let moved = offset(&tau) - before;
    assert!((moved - 2.0).abs() < 0.1, "{moved}");
    // A file that says so leaves them out.
    let without = robot_with("ur10e", folder.path(), "offsets = true", "offsets = false");
    let log = written(&log, &tau, folder.path());
    let (_, found) = result(rivet().arg("identify").arg(without).arg(log), folder.path());
    let names: Vec<&Value> = found["parameters"].as_array().expect("a list").iter().map(|p| &p["name"]).collect();
    assert!(names.iter().all(|name| !name.to_string().contains("offset")), "{names:?}");
}

#[test]
fn the_model_filter_follows_the_log_unless_the_file_has_one() {
    let Some(path) = shared(UR10E_LOG) else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let open = robot_with("ur10e", folder.path(), "model_filter_hz = 6.0           # Hz\ndecimation = 20", "");
    let (text, found) = result(rivet().arg("identify").arg(open).arg(&path), folder.path());
    let filter = &found["chosen_from_logs"]["filter"];
    // The motion of this log stays below 0.5 Hz; its rate is 94 Hz.
    let (cutoff, motion) = (number(&filter["model_filter_hz"]), number(&filter["motion_bandwidth_hz"]));
    assert!(cutoff < 10.0 && motion < 2.0, "{filter}");
    assert!(text.contains("from the logs") && text.contains("bandwidth"), "{text}");
    let (_, found) = result(rivet().arg("identify").arg(robot("ur10e")).arg(&path), folder.path());
    assert_eq!(found["chosen_from_logs"]["filter"], Value::Null);
}

#[test]
fn a_training_log_without_motion_is_left_out() {
    let Some(path) = shared(UR10E_LOG) else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let still = changed("ur10e", &path, folder.path(), |_, _, q| q.fill(0.1));
    let (code, text) = said(rivet().arg("identify").arg(robot("ur10e")).arg(&path).arg(&still));
    let says = "changed.parquet: no joint moves faster than its dead zone";
    assert!(code == Some(0) && text.contains(says), "{code:?} {text}");
}

#[test]
fn a_row_of_nan_ends_neither_identify_nor_predict() {
    let Some(path) = shared(UR10E_LOG) else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let damaged = changed("ur10e", &path, folder.path(), |row, _, q| {
        if row == 500 || row == 501 {
            q.fill(f64::NAN);
        }
    });
    let values = |log: &std::path::Path| -> Vec<f64> {
        let (text, found) = result(rivet().arg("identify").arg(robot("ur10e")).arg(log), folder.path());
        assert_eq!(text.contains("rows have a cell that is empty or not a finite number"), log == damaged, "{text}");
        found["parameters"]
            .as_array()
            .expect("a list")
            .iter()
            .map(|p| number(&p["value"]) / number(&p["std"]))
            .collect()
    };
    for (sound, damaged) in values(&path).into_iter().zip(values(&damaged)) {
        assert!((sound - damaged).abs() < 1.0, "{sound} and {damaged} standard deviations");
    }
    let out = folder.path().join("predicted.parquet");
    succeed(rivet().arg("predict").arg(robot("ur10e")).arg(&damaged).arg("--out").arg(&out));
    let tau = rivet_logs::read_columns(&out, &["t", "tau_pred1"]).expect("finite");
    assert_eq!(tau[0].len(), sound("ur10e", &path).len(), "a row per row of the log");
}

/// Differences of the last positions have noise that no later row averages: it made torques of many times the limit.
#[test]
fn the_ends_of_a_log_are_predicted_within_the_torque_limits() {
    let Some(path) = shared(UR10E_LOG) else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let log = sound("ur10e", &path);
    let rows = log.len();
    let rough = changed("ur10e", &path, folder.path(), |row, _, q| {
        if row + 1 == rows || row == 0 {
            for q in q.iter_mut() {
                *q += 0.01;
            }
        }
    });
    let out = folder.path().join("predicted.parquet");
    succeed(rivet().arg("predict").arg(robot("ur10e")).arg(rough).arg("--out").arg(&out));
    let names: Vec<String> = (1..=6).map(|j| format!("tau_pred{j}")).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let tau = rivet_logs::read_columns(&out, &names).expect("a prediction");
    let measured = read(&path, &ReadOptions { drive_gain: None, ..ReadOptions::new(6) }).map(|log| log.len());
    assert!(measured.is_ok_and(|rows| rows == tau[0].len()));
    for (tau, limit) in tau.iter().zip([330.0, 330.0, 150.0, 54.0, 54.0, 54.0]) {
        let largest = tau.iter().fold(0.0_f64, |most, tau| most.max(tau.abs()));
        assert!(largest <= limit, "{largest} N m of {limit}");
    }
}

/// What only a joint at rest could show keeps its nominal value.
#[test]
fn torque_of_a_joint_that_stood_in_training_stays_near_the_nominal_one() {
    let file = robot("manutec-r3");
    let arm = rivet_config::load(&file).expect("a sound robot file");
    let folder = tempfile::tempdir().expect("a folder");
    let [train, test] = ["train.parquet", "test.parquet"].map(|name| folder.path().join(name));
    let mut truth = arm.nominal.clone();
    let drives = truth.len() - 10 * arm.dof();
    let bodies = truth.len() - drives;
    truth[..bodies].iter_mut().for_each(|value| *value *= 1.1);
    truth[bodies..].iter_mut().for_each(|value| *value *= 1.2);
    let motion = Sines { hz: 0.13, harmonics: 4, size: 0.5, shift: 0.0 };
    motion.log(&arm, &truth, &[1, 2, 3, 4, 5], &mut Random(3), &train);
    Sines { shift: 2.0, ..motion }.log(&arm, &truth, &[0, 1, 2, 3, 4, 5], &mut Random(4), &test);
    let mut command = rivet();
    command.arg("identify").arg(&file).arg(&train).arg("--hold-out").arg(&test);
    let (text, found) = result(&mut command, folder.path());
    assert!(text.contains("its torque in motion is not determined"), "{text}");
    let held = &found["held_out"][0];
    let which = if found["exported"] == "consistent" { "consistent_percent" } else { "identified_percent" };
    for j in 0..6 {
        let [nominal, exported] = ["nominal_percent", which].map(|of| number(&held[of][j]));
        println!("joint {}: nominal {nominal:.1} %, exported {exported:.1} %", j + 1);
        assert!(exported <= nominal + 2.0, "joint {}: {exported} of {nominal}", j + 1);
    }
}
