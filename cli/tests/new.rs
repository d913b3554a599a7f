//! `rivet new`: from a URDF as people have them and a log to a robot file that loads.

use std::fmt::Write as _;
use std::fs;
use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Output};

/// Sample period of the log \[s\] and step of its positions \[rad\].
const PERIOD_S: f64 = 0.004;
const STEP: f64 = 5e-4;

fn rivet(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_rivet")).current_dir(folder).args(arguments).output().expect("the program starts")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Three joints and a gripper of two fingers; the second link has no inertial, the third an impossible one.
fn urdf() -> String {
    let inertial = |izz: &str| {
        format!(
            "<inertial><origin xyz=\"0.1 0 0\"/><mass value=\"2\"/><inertia ixx=\"0.01\" ixy=\"0\" ixz=\"0\" iyy=\"0.02\" iyz=\"0\" izz=\"{izz}\"/></inertial>"
        )
    };
    let mut text = "<robot name=\"Stranger 7\">\n<link name=\"base\"/>\n".to_owned();
    for (k, body) in [inertial("0.02"), String::new(), inertial("0.5")].iter().enumerate() {
        let parent = if k == 0 { "base".to_owned() } else { format!("l{k}") };
        let (xyz, rpy) =
            if k == 2 { ("0.4 0 0", "0 0 0") } else { ("0 0 0.3", if k == 1 { "1.5708 0 0" } else { "0 0 0" }) };
        let _ = writeln!(
            text,
            "<link name=\"l{n}\">{body}</link><joint name=\"j{n}\" type=\"revolute\"><parent link=\"{parent}\"/><child link=\"l{n}\"/>\
             <origin xyz=\"{xyz}\" rpy=\"{rpy}\"/><axis xyz=\"0 0 1\"/><limit lower=\"-3\" upper=\"3\" effort=\"{effort}\" velocity=\"2\"/>\
             <dynamics damping=\"1.5\" friction=\"0.5\"/></joint>",
            n = k + 1,
            effort = [80, 60, 0][k],
        );
    }
    for finger in ["left", "right"] {
        let _ = writeln!(
            text,
            "<link name=\"{finger}_finger\"/><joint name=\"{finger}\" type=\"prismatic\"><parent link=\"l3\"/><child link=\"{finger}_finger\"/>\
             <limit lower=\"0.01\" upper=\"0.04\" effort=\"5\" velocity=\"1\"/></joint>"
        );
    }
    text + "</robot>\n"
}

fn log() -> String {
    let mut text = "t,q1,q2,q3,tau1,tau2,tau3\n".to_owned();
    for k in 0..2000 {
        let t = f64::from(k) * PERIOD_S;
        let q = |w: f64| ((0.8 * (w * t).sin()) / STEP).round() * STEP;
        let _ = writeln!(
            text,
            "{t:.3},{:.4},{:.4},{:.4},{:.3},{:.3},{:.3}",
            q(1.1),
            q(1.7),
            q(2.3),
            (1.1 * t).cos(),
            20.0 * (1.7 * t).cos(),
            4.0 * (2.3 * t).cos()
        );
    }
    text
}

/// Each value is that of the URDF or of the log, the rest is marked, and the file loads.
#[test]
fn writes_a_file_that_loads_and_marks_unknown_values() {
    let folder = tempfile::tempdir().expect("a folder");
    fs::write(folder.path().join("arm.urdf"), urdf()).expect("written");
    fs::write(folder.path().join("log.csv"), log()).expect("written");
    let output = rivet(folder.path(), &["new", "arm.urdf", "log.csv"]);
    assert!(output.status.success(), "{}{}", text(&output.stdout), text(&output.stderr));
    let said = text(&output.stdout);
    for words in ["unknown:", "rotor_inertia", "bodies of l2", "can be used"] {
        assert!(said.contains(words), "{words}: {said}");
    }
    let file = fs::read_to_string(folder.path().join("robot.toml")).expect("written");
    let line = |key: &str| {
        let start = format!("{key} = ");
        file.lines().find(|line| line.starts_with(&start)).unwrap_or_else(|| panic!("{key}: {file}")).to_owned()
    };
    for (key, start) in [
        ("name", "name = \"stranger-7\""),
        ("sample_period_s", "sample_period_s = 0.004  #"),
        ("torque_limit", "torque_limit = [80.0, 60.0, 12.0]  # N m, UNKNOWN of j3"),
        ("encoder_resolution", "encoder_resolution = [0.0005, 0.0005, 0.0005]"),
        ("coulomb", "coulomb = [0.5, 0.5, 0.5]"),
        ("viscous", "viscous = [1.5, 1.5, 1.5]"),
        ("tip", "tip = \"l3\""),
        ("fixed", "fixed = { left = 0.01, right = 0.01 }"),
        ("impossible_inertia", "impossible_inertia = \"project\""),
    ] {
        assert!(line(key).starts_with(start), "{key}: {}", line(key));
    }
    for key in ["gear_ratio", "rotor_inertia", "offset"] {
        assert!(line(key).contains("UNKNOWN"), "{}", line(key));
    }

    let check = rivet(folder.path(), &["check", "robot.toml"]);
    let said = text(&check.stdout);
    assert!(check.status.success() && said.contains("no <inertial> of l2"), "{said}");
    assert!(said.trim_end().ends_with("can be used, with 1 warning."), "the projected inertia: {said}");
}

/// A file that is there stays, and a URDF that no option mends is refused with its line.
#[test]
fn keeps_files_and_names_lines() {
    let folder = tempfile::tempdir().expect("a folder");
    fs::write(folder.path().join("arm.urdf"), urdf().replace("mass value=\"2\"", "mass value=\"two\""))
        .expect("written");
    fs::write(folder.path().join("robot.toml"), "mine").expect("written");
    let output = rivet(folder.path(), &["new", "arm.urdf"]);
    assert_eq!(output.status.code(), Some(64), "{}", text(&output.stderr));
    let output = rivet(folder.path(), &["new", "arm.urdf", "--force"]);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(78), "{said}");
    for words in ["arm.urdf: line 3: link \"l1\": mass is \"two\"", "line 5: link \"l3\": mass is \"two\""] {
        assert!(said.contains(words), "{words}: {said}");
    }
    assert_eq!(fs::read_to_string(folder.path().join("robot.toml")).expect("kept"), "mine");
}

/// An arm without a single body: from its URDF and two logs to a diagnosis that names the contact, and that bodies cannot be compared.
#[test]
fn diagnoses_an_arm_without_bodies() {
    let case = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data/practice/case-01"));
    let Ok(urdf) = fs::read_to_string(case.join("robot.urdf")) else {
        let _ = writeln!(std::io::stderr(), "SKIPPED: {} is not there, no diagnosis without bodies", case.display());
        return;
    };
    let folder = tempfile::tempdir().expect("a folder");
    let mut bare = String::new();
    for (k, part) in urdf.split("<inertial>").enumerate() {
        bare += if k == 0 { part } else { part.split_once("</inertial>").expect("closed").1 };
    }
    fs::write(folder.path().join("bare.urdf"), bare).expect("written");
    let [a, b] = ["log-a.parquet", "log-b.parquet"].map(|log| case.join(log).display().to_string());
    let output = rivet(folder.path(), &["new", "bare.urdf", &a]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let output = rivet(folder.path(), &["diagnose", "robot.toml", &a, &b, "--json", "found.json"]);
    // Lines are broken at 100 columns.
    let said = text(&output.stdout).split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(said.contains("nothing to compare these bodies with"), "{said}{}", text(&output.stderr));
    let document = fs::read_to_string(folder.path().join("found.json")).expect("written");
    for words in ["\"bodies_unknown\"", "\"external_force\""] {
        assert!(document.contains(words), "{words}: {said}");
    }
    // Bodies that nobody knew are no wrong values.
    for words in ["link_inertia", "link_mass", "payload"] {
        assert!(!said.contains(words), "{words}: {said}");
    }
}
