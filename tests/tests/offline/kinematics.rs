//! Logs whose joints are not those of the robot file: another zero, sign or order, or another arm.

use std::f64::consts::FRAC_PI_2;
use std::path::{Path, PathBuf};

use rivet_logs::{Log, ReadOptions, read, write_columns};
use rivet_tests::altered::{result, said};
use rivet_tests::{rivet, robot, shared};

/// What `rivet identify` says of the joints of a sound log that was changed: fault, joint and words. All its signals are written.
fn told(file: &Path, change: impl Fn(&mut Log)) -> Vec<[String; 3]> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = changed(folder.path(), change);
    let (text, found) = result(rivet().arg("identify").arg(file).arg(path), folder.path());
    let warnings = found["warnings"].as_array().expect("a list").iter();
    let of = warnings.filter(|w| ["joints_misread", "another_arm"].iter().any(|name| w["fault"] == *name));
    let said: Vec<[String; 3]> =
        of.map(|w| ["fault", "joint", "text"].map(|key| w[key].as_str().unwrap_or("").to_owned())).collect();
    assert!(said.is_empty() || text.contains("warning: "), "{text}");
    println!("{said:?}");
    said
}

/// A sound log that was changed, with all its signals.
fn changed(folder: &Path, change: impl Fn(&mut Log)) -> PathBuf {
    let case = shared("data/practice/case-24").expect("it is there");
    let mut log = read(case.join("log-a.parquet"), &ReadOptions::new(6)).expect("a log");
    change(&mut log);
    let [q, tau, q_des, qd_des, qdd_des] = groups(&mut log).map(|signals| signals.map(|s| s.clone()));
    let mut columns = vec![("t".to_owned(), &log.t[..])];
    for (name, group) in [("q", &q), ("tau", &tau), ("q_des", &q_des), ("qd_des", &qd_des), ("qdd_des", &qdd_des)] {
        let named = group.iter().flatten().enumerate().map(|(j, signal)| (format!("{name}{}", j + 1), &signal[..]));
        columns.extend(named);
    }
    let path = folder.join("log.parquet");
    write_columns(&path, &columns).expect("written");
    path
}

type Signals = Vec<Vec<f64>>;

/// Position, torque and plan of a log.
fn groups(log: &mut Log) -> [Option<&mut Signals>; 5] {
    let tau = log.tau.as_mut().map(|(_, tau)| tau);
    [Some(&mut log.q), tau, log.q_des.as_mut(), log.qd_des.as_mut(), log.qdd_des.as_mut()]
}

/// What follows a joint is elsewhere with it, so the torque of several joints tells; read as it is meant, the same fit leaves far less.
#[test]
fn another_zero_sign_or_order_of_joints_is_told() {
    let Some(case) = shared("data/practice/case-24") else { return };
    let file = case.join("robot.toml");
    assert_eq!(told(&file, |_| ()), Vec::<[String; 3]>::new());
    let said = told(&file, |log| {
        for group in [Some(&mut log.q), log.q_des.as_mut()].into_iter().flatten() {
            group[2].iter_mut().for_each(|q| *q += FRAC_PI_2);
        }
    });
    assert!(said[0][..2] == ["joints_misread", "elbow_joint"] && said[0][2].contains("-90 deg added"), "{said:?}");
    let said = told(&file, |log| groups(log).into_iter().flatten().for_each(|group| group.swap(0, 1)));
    assert!(said[0][2].contains("shoulder_pan_joint and shoulder_lift_joint in each other's columns"), "{said:?}");
    let said = told(&file, |log| {
        groups(log).into_iter().flatten().for_each(|group| group[0].iter_mut().for_each(|x| *x = -*x));
    });
    assert!(said[0][2].contains("shoulder_pan_joint counted the other way round"), "{said:?}");
    // Torque of two joints has another scale then, which is told as well.
    let said = told(&file, |log| groups(log).into_iter().flatten().for_each(|group| group.reverse()));
    assert!(said[0][2].contains("the joints counted from the flange to the base"), "{said:?}");
}

/// A log in the zero of the URDF, as a bus or a simulator has it, read with the file's `joint_zero`.
#[test]
fn a_log_that_needs_no_zero_is_told() {
    let Some(case) = shared("data/practice/case-24") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let given = std::fs::read_to_string(case.join("robot.toml")).expect("a robot file");
    let file = folder.path().join("robot.toml");
    std::fs::write(&file, given + "\n[log]\njoint_zero = [0, -1.570796, 1.570796, 0, 0, 0]\n").expect("written");
    std::fs::copy(case.join("robot.urdf"), folder.path().join("robot.urdf")).expect("copied");
    let said = told(&file, |_| ());
    assert!(said[0][2].contains("positions taken as logged, without the file's joint_zero"), "{said:?}");
}

/// Half of every joint's torque is not this arm's; the file of an arm whose links are a few centimetres longer cannot be told.
#[test]
fn the_file_of_another_arm_is_told_where_it_can_be() {
    if shared("data/practice/case-24").is_none() {
        return;
    }
    let said = told(&robot("ur5e"), |_| ());
    assert!(said.len() == 1 && said[0][0] == "another_arm", "{said:?}");
    assert_eq!(told(&robot("ur10e"), |_| ()), Vec::<[String; 3]>::new());
    // Of an arm that has friction, a file without any leaves as much.
    let folder = tempfile::tempdir().expect("a folder");
    let given = std::fs::read_to_string(robot("ur5e")).expect("a robot file");
    let without = |line: &str| match line.split(' ').next() {
        Some(key @ ("coulomb" | "viscous")) => format!("{key} = [0, 0, 0, 0, 0, 0]"),
        _ => line.to_owned(),
    };
    let file = folder.path().join("robot.toml");
    std::fs::write(&file, given.lines().map(without).collect::<Vec<_>>().join("\n")).expect("written");
    std::fs::copy(robot("ur5e").with_file_name("robot.urdf"), folder.path().join("robot.urdf")).expect("copied");
    assert_eq!(told(&file, |_| ()), Vec::<[String; 3]>::new());
}

/// The daemon's estimator reads what it gets; who replays a log is told.
#[test]
fn joints_in_each_others_columns_are_told_on_line() {
    let Some(case) = shared("data/practice/case-24") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let log = changed(folder.path(), |log| groups(log).into_iter().flatten().for_each(|group| group.swap(1, 2)));
    let (_, text) = said(rivet().arg("identify").arg("--online").arg(case.join("robot.toml")).arg(log));
    assert!(text.contains("shoulder_lift_joint and elbow_joint in each other's columns"), "{text}");
}
