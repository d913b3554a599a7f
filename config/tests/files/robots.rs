//! Every robot of the project loads, and so do files with only the contract part.

use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};

fn below(folder: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(folder)
}

/// `<folder>/<any>/robot.toml`
fn robot_files(folder: &Path) -> Vec<PathBuf> {
    let Ok(entries) = fs::read_dir(folder) else { return Vec::new() };
    let mut files: Vec<_> =
        entries.filter_map(|e| Some(e.ok()?.path().join("robot.toml"))).filter(|p| p.is_file()).collect();
    files.sort();
    files
}

#[test]
fn all_robots_of_the_project_load() {
    let files = robot_files(&below("robots"));
    let names: Vec<_> = files
        .iter()
        .map(|file| {
            let robot = rivet_config::load(file).unwrap_or_else(|e| panic!("{e}"));
            let folder = file.parent().and_then(Path::file_name).and_then(|n| n.to_str());
            assert_eq!(robot.config.estimation_settings().check(robot.dof()), Ok(()));
            assert_eq!(Some(robot.config.name.as_str()), folder, "a robot is named as its folder");
            assert!(file.with_file_name("README.md").is_file(), "{} has no README with its sources", robot.config.name);
            let between_s = robot.config.publish.health_every as f64 * robot.config.sample_period_s;
            assert!((between_s - 1.0).abs() < 0.05, "{}: {between_s} s between health messages", robot.config.name);
            robot.config.name
        })
        .collect();
    assert_eq!(names, ["dd2", "kuka-kr300-r2500", "manutec-r3", "staubli-tx40", "ur10", "ur10e", "ur5e"]);
}

#[test]
fn contract_only_files_load() {
    for folder in ["../shared/data/practice", "../shared/data/practice-wrong-nominal"] {
        let files = robot_files(&below(folder));
        if files.is_empty() {
            // Past the test harness, which keeps what a passing test says through the macros to itself.
            let _ = writeln!(std::io::stderr(), "SKIPPED: {folder} is not here");
        }
        for file in files {
            let robot = rivet_config::load(&file).unwrap_or_else(|e| panic!("{e}"));
            assert_eq!(robot.dof(), 6);
            assert!(robot.identified.is_none());
        }
    }
}

/// `velocity="0"` in a URDF sets no limit: the warning names the joint, and the robot file may give one.
#[test]
fn a_joint_without_a_speed_limit_is_named() {
    let from = Path::new(env!("CARGO_MANIFEST_DIR")).join("../robots/dd2");
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let urdf = fs::read_to_string(from.join("robot.urdf")).expect("read");
    let text = fs::read_to_string(from.join("robot.toml")).expect("read");
    let (begin, rest) = urdf.split_once("velocity=\"").expect("a speed limit");
    let (_, rest) = rest.split_once('"').expect("closed");
    let warned = |urdf: &str, text: &str| {
        fs::write(at("robot.urdf"), urdf).expect("written");
        let robot = rivet_config::parse(&at("robot.toml"), text).unwrap_or_else(|e| panic!("{e}"));
        let warnings = robot.warnings().into_iter().filter(|warning| warning.contains("speed limit")).count();
        (warnings, robot.model.arm.joints[0].velocity)
    };
    assert_eq!(warned(&urdf, &text).0, 0);
    for unset in [format!("{begin}velocity=\"0\"{rest}"), format!("{begin}{rest}")] {
        assert_eq!(warned(&unset, &text), (1, f64::INFINITY));
        let given = text.replace("[drive]\n", "[drive]\nvelocity_limit = [3.0, 4.0]\n");
        assert_eq!(warned(&unset, &given), (0, 3.0));
    }
    let zero = text.replace("[drive]\n", "[drive]\nvelocity_limit = [0, 4.0]\n");
    rivet_config::parse(&at("robot.toml"), &zero).expect_err("0 is no limit");
}

/// What a joint can do is the drive's to say: a URDF that says nothing of effort changes nothing.
#[test]
fn effort_is_the_drives() {
    let from = Path::new(env!("CARGO_MANIFEST_DIR")).join("../robots/staubli-tx40");
    let folder = tempfile::tempdir().expect("a folder");
    fs::copy(from.join("robot.toml"), folder.path().join("robot.toml")).expect("copied");
    let urdf = fs::read_to_string(from.join("robot.urdf")).expect("read");
    let mut parts = urdf.split("effort=\"");
    let mut silent = parts.next().expect("a beginning").to_owned();
    for part in parts {
        silent += "effort=\"0";
        silent += &part[part.find('"').expect("closed")..];
    }
    fs::write(folder.path().join("robot.urdf"), silent).expect("written");
    let robot = rivet_config::load(folder.path().join("robot.toml")).unwrap_or_else(|e| panic!("{e}"));
    let effort: Vec<f64> = robot.model.arm.joints.iter().map(|joint| joint.effort).collect();
    assert_eq!(effort, robot.config.drive.torque_limit);
}
