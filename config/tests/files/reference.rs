//! The documentation of the keys is the table that the reader uses, and `describe` fits the page.

use std::fs;
use std::path::Path;

use rivet_config::Origin;
use rivet_estimation::Settings;

#[test]
fn documentation_is_the_table() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/robot-toml.md");
    let written = fs::read_to_string(&path).expect("docs/robot-toml.md is part of the project");
    assert!(
        written == rivet_config::keys::reference(),
        "docs/robot-toml.md is old: cargo run -p rivet-config --example reference > docs/robot-toml.md"
    );
}

#[test]
fn description_names_every_key_and_fits_the_page() {
    for arm in ["staubli-tx40", "dd2", "kuka-kr300-r2500"] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../robots").join(arm).join("robot.toml");
        let robot = rivet_config::load(path).unwrap_or_else(|e| panic!("{e}"));
        let text = robot.describe();
        for line in text.lines() {
            assert!(line.chars().count() <= 80, "{line}");
        }
        let optional = |s: &str| matches!(s, "coupling" | "identified") || s.starts_with("effects.");
        for key in rivet_config::keys::KEYS.iter().filter(|k| !optional(k.section)) {
            let resolved = robot.config.resolved.iter().find(|r| r.key.path() == key.path());
            assert!(resolved.is_some(), "{} is not read", key.path());
            assert!(text.contains(&format!("\n  {} ", key.name)), "{} is not described", key.path());
        }
        // Numbers of joints are whole: the last column ends with the torque limit.
        let mut rows = text.lines().skip_while(|line| !line.starts_with(" joint ")).skip(1);
        for limit in &robot.config.drive.torque_limit {
            let row = rows.next().unwrap_or_default();
            let shown: f64 = row.split_whitespace().next_back().unwrap_or_default().parse().expect("a number");
            assert!((shown - limit).abs() <= 5e-4 * limit, "{row}: {limit}");
        }
        let name = robot.config.resolved.iter().find(|r| r.key.name == "name").expect("read");
        assert_eq!(name.origin, Origin::Line(3));
        assert!(text.contains(&format!("{:016x}", robot.hash)));
    }
}

/// A window in which friction is rounded off is said, whole; the arms' own are none.
#[test]
fn a_long_window_is_doubted() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../robots/ur5e/robot.toml");
    let text = fs::read_to_string(&path).expect("a robot file");
    let warnings = |text: &str| rivet_config::parse(&path, text).unwrap_or_else(|e| panic!("{e}")).warnings();
    let long = warnings(&text.replacen("[signal]", "[signal]\nhalf_width = 100", 1));
    assert_eq!(long, ["half_width = 100 is a window of 0.20 s: it bends friction where joints reverse"]);
    assert_eq!(warnings(&text), Vec::<String>::new());
}

/// A default that depends on other values still makes a file of the contract part alone work at any rate.
#[test]
fn contract_only_file_works_at_any_rate() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../robots/dd2");
    for period in ["1e-4", "0.0002", "0.001", "0.002", "0.004", "0.0106", "0.05", "0.1"] {
        let text = format!(
            "name = \"dd2\"\nurdf = \"robot.urdf\"\nsample_period_s = {period}\ngravity = [0, 0, -9.81]\n[drive]\n\
             gear_ratio = [1, 1]\nrotor_inertia = [0, 0]\ntorque_limit = [150, 15]\nencoder_resolution = [0, 0]\n\
             [friction]\ncoulomb = [7, 2]\nviscous = [2, 0.2]\noffset = [0, 0]\n"
        );
        let robot = rivet_config::parse(&folder.join("robot.toml"), &text).unwrap_or_else(|e| panic!("{period}: {e}"));
        // The defaults of the file are those of the estimator, and it takes them.
        let settings = robot.config.estimation_settings();
        assert_eq!(settings.check(2), Ok(()), "{period}");
        let mut own = Settings::new(2, robot.config.sample_period_s);
        own.supervision = settings.supervision;
        assert_eq!(settings, own, "{period}");
    }
}

/// The report shows each mistake with its line and a caret below the place.
#[test]
fn report_points_at_each_mistake() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/bad/arm.toml");
    let text = "name = \"arm\"\nurdf = \"arm.urdf\"\nsample_period_s = 0.001\ngravity = [0, 0, \"down\"]\n[drive]\n\
                gear_ratio = [100, 0]\nrotor_inertia = [1, 1]\ntorque_limit = [9, 9]\nencoder_resolution = [0, 0]\n";
    let report = rivet_config::parse(&path, text).expect_err("wrong").to_string();
    let report = report.replace(&path.display().to_string(), "arm.toml");
    let expected = "\
arm.toml:4:18: gravity[3] = \"down\": must be a number [m/s^2], not text; write a plain number
 4 | gravity = [0, 0, \"down\"]
   |                  ^^^^^^
arm.toml:6:20: drive.gear_ratio[2] = 0: must keep 0 < |x| <= 1e5; a direct drive has ratio 1 (joint 2 is elbow)
 6 | gear_ratio = [100, 0]
   |                    ^
2 mistakes";
    assert_eq!(report, expected);
}
