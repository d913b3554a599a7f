//! Logs of measured arms and of another simulator, which are sound: how many are reported as something else, by which reading.

use std::path::{Path, PathBuf};

use rivet_logs::{Log, ReadOptions, read};
use rivet_screening::{RobotFile, Screening, Stretch, screen};

/// A hole is a step of more than this \[s\], and of so many usual steps.
const HOLE_S: f64 = 0.1;
const HOLE_STEPS: f64 = 10.0;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// `../shared/data/...`; none, with a word, where it is absent.
fn shared(path: &str) -> Option<PathBuf> {
    let found = root().join("../shared/data").join(path);
    if !found.exists() {
        println!("SKIPPED: {} is not there", found.display());
    }
    found.exists().then_some(found)
}

fn screened(robot_file: &Path, path: &Path) -> Option<(Screening, Vec<String>)> {
    let robot = rivet_config::load(robot_file).expect("a sound robot file");
    let config = &robot.config;
    let options = ReadOptions {
        joints: robot.dof(),
        drive_gain: config.drive.drive_gain.as_deref(),
        torque_from_current: config.log.torque_from_current,
        joint_zero: Some(&config.log.joint_zero),
    };
    let log = read(path, &options).expect("a sound log").by_its_positions().without_crowds();
    log.torque().ok()?;
    let usual = log.median_step_s();
    let grids: Vec<Log> = log
        .split_at_gaps(HOLE_S.max(HOLE_STEPS * usual))
        .into_iter()
        .filter_map(|piece| piece.resample(usual).ok().map(|(grid, _)| grid))
        .collect();
    let of = |grid| {
        let grid: &Log = grid;
        Some(Stretch { period_s: usual, start_s: grid.t[0], q: &grid.q, tau: grid.torque().ok()? })
    };
    let stretches: Vec<Stretch<'_>> = grids.iter().filter_map(of).collect();
    let file =
        RobotFile { model: &robot.model, nominal: &robot.nominal, torque_limit: &robot.config.drive.torque_limit };
    let names = robot.model.arm.joints.iter().map(|j| j.name.clone()).collect();
    Some((screen(&file, &stretches)?, names))
}

/// Logs of a folder, in order.
fn logs(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).expect("a folder").filter_map(|e| Some(e.ok()?.path()));
    let mut logs: Vec<PathBuf> = entries.filter(|p| p.extension().is_some_and(|e| e == "parquet")).collect();
    logs.sort();
    logs
}

/// Prints what is reported of logs, and returns how many are: `(reported, looked at)`.
fn reported(pairs: &[(PathBuf, PathBuf)]) -> (usize, usize) {
    let (mut said, mut all) = (0, 0);
    for (robot, log) in pairs {
        let Some((found, names)) = screened(robot, log) else { continue };
        all += 1;
        let Some(reading) = found.finding() else { continue };
        said += 1;
        let [left, before] =
            [&reading.residual, &found.residual].map(|of| of.iter().map(|r| format!("{r:.2}")).collect::<Vec<_>>());
        println!("{}: {} ({:.3}), {left:?} of {before:?}", log.display(), reading.text(&names), reading.probability);
    }
    println!("{said} of {all} logs are reported");
    (said, all)
}

#[test]
fn hardly_any_measured_log_is_read_as_something_else() {
    let sets = [
        ("staubli_tx40", "robots/staubli-tx40"),
        ("airbot_play", "tests/robots/airbot-play"),
        ("shanghai_electric_6dof", "tests/robots/shanghai"),
        ("kinova_gen3", "tests/robots/kinova-gen3"),
        ("kuka_kr300", "robots/kuka-kr300-r2500"),
        ("ur10_salerno", "robots/ur10"),
        ("ur10e_innopolis", "robots/ur10e"),
        ("bam_xl330", "tests/robots/bam-xl330"),
    ];
    let mut pairs = Vec::new();
    for (set, robot) in sets {
        let Some(folder) = shared(&format!("real/{set}")) else { return };
        pairs.extend(logs(&folder).into_iter().map(|log| (root().join(robot).join("robot.toml"), log)));
    }
    let (said, all) = reported(&pairs);
    assert!(all > 25 && said * 20 <= all, "{said} of {all}");
}

#[test]
fn no_case_of_another_simulator_is_read_as_something_else() {
    let mut pairs = Vec::new();
    for set in ["practice", "practice-wrong-nominal", "sealed", "sealed-wrong-nominal"] {
        let Some(folder) = shared(set) else { return };
        let mut cases: Vec<PathBuf> = std::fs::read_dir(&folder)
            .expect("a folder")
            .filter_map(|e| Some(e.ok()?.path()))
            .filter(|p| p.is_dir())
            .collect();
        cases.sort();
        for case in cases {
            pairs.extend(logs(&case).into_iter().map(|log| (case.join("robot.toml"), log)));
        }
    }
    let (said, all) = reported(&pairs);
    assert!(all > 100 && said * 20 <= all, "{said} of {all}");
}

/// Inputs that failed in the field: the reading that their README asks for.
#[test]
fn inputs_of_the_field_have_the_reading_of_their_readme() {
    let cases = [
        ("07-positions-in-turns", "position_unit"),
        ("09-warming-false-saturation", "friction_drifts"),
        ("11-link-side-sensor", "link_side_sensor"),
        ("12-inertia-g-mm2", "file_unit"),
    ];
    for (case, name) in cases {
        let Some(folder) = shared(&format!("field/{case}")) else { return };
        // Friction that warms up changes less in the second log.
        let mut names_found = Vec::new();
        for log in logs(&folder) {
            let (found, names) = screened(&folder.join("robot.toml"), &log).expect("motion");
            let texts: Vec<String> =
                found.readings.iter().map(|r| format!("{} ({:.3})", r.text(&names), r.probability)).collect();
            println!("{case} {}: {texts:?}", log.file_name().unwrap_or_default().to_string_lossy());
            names_found.extend(found.finding().map(rivet_screening::Reading::name));
        }
        assert!(!names_found.is_empty() && names_found.iter().all(|found| *found == name), "{case}: {names_found:?}");
    }
}
