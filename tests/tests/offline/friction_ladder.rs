//! `rivet study friction`: which law of friction predicts motion that it was not fitted to.

use std::path::{Path, PathBuf};
use std::process::Command;

use rivet_config::Robot;
use rivet_diagnosis::{Ladder, Run, Rung, friction_ladder};
use rivet_logs::{ReadOptions, read, read_columns, write_columns};
use rivet_simulation::{Injected, Injector, Recorded};
use rivet_tests::{rivet, robot, root, shared, succeed};
use serde_json::Value;

fn rung<'a>(ladder: &'a Ladder, name: &str) -> &'a Rung {
    ladder.rungs.iter().find(|rung| rung.name == name).unwrap_or_else(|| panic!("no {name}"))
}

/// A run of another program's arm in which nothing is wrong, its torque changed by `effects`.
fn run(robot: &Robot, log: &Path, effects: &[Injected]) -> Run {
    let log = read(log, &ReadOptions::new(robot.dof())).expect("a log");
    let (log, report) = log.resample(0.001).expect("an even clock");
    let measured = log.torque().expect("torque");
    let injector = Injector::new(Recorded::of(&robot.model, &robot.nominal, report.period_s, &log.q, measured));
    let mut tau = measured.clone();
    for effect in effects {
        for (tau, added) in tau.iter_mut().zip(injector.torque(*effect)) {
            tau.iter_mut().zip(added).for_each(|(t, a)| *t += a);
        }
    }
    Run { name: "run".to_owned(), period_s: report.period_s, q: log.q.clone(), tau, ..Run::default() }
}

/// Friction with load that the simulated plant makes is the law that is found, on the joint that has it; where friction is
/// what the file says, no law is better than that.
#[test]
fn the_law_that_made_the_torque_is_the_one_that_predicts_it() {
    let Some(case) = shared("data/practice/case-24") else { return };
    let robot = rivet_config::load(case.join("robot.toml")).expect("a sound robot file");
    let ladder = |effects: &[Injected]| {
        let folds: Vec<Vec<Run>> =
            ["log-a.parquet", "log-b.parquet"].iter().map(|log| vec![run(&robot, &case.join(log), effects)]).collect();
        friction_ladder(&robot.model, &robot.nominal, &folds, 5.0, &mut |_, _| ()).expect("sound runs")
    };
    let loaded = ladder(&[Injected::LoadFriction { joint: 1, ratio: 0.2 }]);
    let (plain, load) = (rung(&loaded, "coulomb + viscous"), rung(&loaded, "with load"));
    println!("{loaded:#?}");
    assert!(load.change.0 < -0.3 && load.change.0 < -3.0 * load.change.1, "{load:?}");
    assert!(load.joints[1] < 0.6 * plain.joints[1], "{load:?}, {plain:?}");
    let other = ["with stribeck", "by direction", "viscous nonlinear"].map(|name| rung(&loaded, name).error);
    assert!(other.into_iter().all(|error| error > load.error), "{loaded:#?}");

    let sound = ladder(&[]);
    println!("{sound:#?}");
    for rung in &sound.rungs {
        assert!(rung.change.0 > -0.1 || rung.change.0 > -2.0 * rung.change.1, "{rung:?}");
    }
}

fn study(robot: &Path, folds: &[Vec<PathBuf>], json: &Path) -> Value {
    let mut command: Command = rivet();
    command.args(["study", "friction"]).arg(robot).arg("--json").arg(json);
    for fold in folds {
        let logs: Vec<String> = fold.iter().map(|log| log.display().to_string()).collect();
        command.arg("--fold").arg(logs.join(","));
    }
    let text = String::from_utf8(succeed(&mut command).stdout).expect("text");
    assert!(text.lines().all(|line| line.chars().count() <= 100), "{text}");
    println!("{text}");
    serde_json::from_str(&std::fs::read_to_string(json).expect("written")).expect("JSON")
}

fn law<'a>(found: &'a Value, name: &str) -> (usize, &'a Value) {
    let laws = found["laws"].as_array().expect("laws");
    laws.iter().enumerate().find(|(_, law)| law["law"] == name).unwrap_or_else(|| panic!("no {name}"))
}

/// One servo with one load, each gain of its position loop left out once: friction with load predicts the others best.
/// By little, since the load is one and the same.
#[test]
fn a_servo_on_gains_that_were_left_out() {
    let Some(data) = shared("data/real/bam_xl330") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let converted = |gain: u32, motion: &str| {
        let name = format!("xl330_kp{gain}_{motion}.parquet");
        let columns = read_columns(data.join(&name), &["t", "q1", "load_raw1", "vin1"]).expect("the source's columns");
        // Duty of the bridge and supply make the voltage; N m/V as the source's own fits have it.
        let tau: Vec<f64> = columns[2].iter().zip(&columns[3]).map(|(duty, vin)| duty / 885.0 * vin * 0.11).collect();
        let path = folder.path().join(name);
        write_columns(&path, &[("t", &columns[0]), ("q1", &columns[1]), ("tau1", &tau)]).expect("written");
        path
    };
    let motions = ["sin_sin", "sin_time_square", "up_and_down"];
    let fold = |gain: u32| {
        let own = if gain == 800 { &motions[1..] } else { &motions[..] };
        own.iter().map(|motion| converted(gain, motion)).collect::<Vec<_>>()
    };
    let file = root().join("tests/robots/bam-xl330/robot.toml");
    let found = study(&file, &[100, 400, 800].map(fold), &folder.path().join("ladder.json"));
    let (plain, _) = law(&found, "coulomb + viscous");
    let (load, of) = law(&found, "with load");
    assert!(load < plain && load <= 1, "{found:#}");
    assert!(of["change"].as_f64() < Some(0.0) && of["verdict"] == "better", "{found:#}");
    assert_eq!(found["laws"].as_array().map(Vec::len), Some(7), "the whole ladder is reported");
}

/// Six joints on three motions, each left out once: Stribeck friction and friction with load are better for sure.
#[test]
fn a_ur10e_on_motions_that_were_left_out() {
    let Some(data) = shared("data/real/ur10e_innopolis") else { return };
    let folds = ["20_02_10-30sec_12harm", "20_02_06-20sec_10harm", "20_02_05-20sec_8harm"];
    let folds = folds.map(|run| vec![data.join(format!("{run}.parquet"))]);
    let folder = tempfile::tempdir().expect("a folder");
    let found = study(&robot("ur10e"), &folds, &folder.path().join("ladder.json"));
    let (_, both) = law(&found, "stribeck and load");
    assert_eq!(both["verdict"], "better", "{found:#}");
    assert!(both["change"].as_f64() < Some(-0.15), "{found:#}");
}

#[test]
fn one_fold_is_refused_with_the_reason() {
    let output =
        rivet().args(["study", "friction"]).arg(robot("dd2")).args(["--fold", "a.csv"]).output().expect("started");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() >= Some(64) && said.contains("two or more"), "{said}");
}
