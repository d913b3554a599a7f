//! Robot descriptions as people have them: what is refused says which line mends it, and loads with that line.

use std::fmt::Write as _;
use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use rivet_config::{ConfigErrors, Robot};

/// A robot file as a new user writes it, without `[friction]`.
fn minimal(urdf: &Path, joints: usize) -> String {
    let list = |value: &str| format!("[{}]", vec![value; joints].join(", "));
    format!(
        "name = \"arm\"\nurdf = {:?}\nsample_period_s = 0.001\ngravity = [0.0, 0.0, -9.81]\n[drive]\ngear_ratio = {}\nrotor_inertia = {}\n\
         torque_limit = {}\nencoder_resolution = {}\n",
        urdf.display().to_string(),
        list("1"),
        list("0"),
        list("100"),
        list("0")
    )
}

fn parse(urdf: &Path, joints: usize, more: &str) -> Result<Robot, ConfigErrors> {
    rivet_config::parse(Path::new("robot.toml"), &(minimal(urdf, joints) + more))
}

/// Whether any mistake is about the number of joints, and how many there are.
fn joints_by(errors: &ConfigErrors) -> Option<usize> {
    let rule =
        errors.errors().iter().find_map(|e| e.rule.split_once("the URDF has ").map(|(_, rest)| rest.to_owned()))?;
    rule.split(' ').next()?.parse().ok()
}

/// The line of robot.toml or of the URDF that the mistakes ask for.
enum Mend {
    Robot(String),
    Urdf(String),
}

fn mend(errors: &ConfigErrors) -> Option<Mend> {
    let hints: Vec<&str> = errors.errors().iter().map(|e| e.hint.as_str()).collect();
    if let Some(lines) = hints.iter().find_map(|hint| hint.split_once("at the end of the robot file:\n")) {
        return Some(Mend::Robot(lines.1.to_owned()));
    }
    let quoted = |hint: &str| hint.split('`').nth(1).map(str::to_owned);
    if let Some(hint) = hints.iter().find(|hint| hint.contains("below `[model]`")) {
        return Some(Mend::Robot(format!("[model]\n{}", quoted(hint)?)));
    }
    let hint = hints.iter().find(|hint| hint.starts_with("add the line `<link"))?;
    Some(Mend::Urdf(quoted(hint)?))
}

/// How a URDF came to load.
#[derive(Debug, PartialEq)]
struct Outcome {
    robot_lines: String,
    urdf_lines: String,
}

/// Loads a URDF with the lines that its refusals name, at most three of them.
fn load(urdf: &Path, folder: &Path) -> Result<(Robot, Outcome), String> {
    let (mut path, mut text) = (urdf.to_path_buf(), fs::read_to_string(urdf).map_err(|e| e.to_string())?);
    let mut outcome = Outcome { robot_lines: String::new(), urdf_lines: String::new() };
    let mut joints = 6;
    for _ in 0..6 {
        let errors = match parse(&path, joints, &outcome.robot_lines) {
            Ok(robot) => return Ok((robot, outcome)),
            Err(errors) => errors,
        };
        if let Some(found) = joints_by(&errors).filter(|found| *found != joints) {
            joints = found;
            continue;
        }
        match mend(&errors) {
            Some(Mend::Robot(lines)) if outcome.robot_lines.is_empty() => {
                outcome.robot_lines = format!("\n{}\n", lines.trim_end());
            }
            Some(Mend::Robot(lines)) => {
                let more = lines.trim_start_matches("[model]\n");
                let _ = writeln!(outcome.robot_lines, "{more}");
            }
            Some(Mend::Urdf(line)) => {
                text = text.replace("</robot>", &format!("{line}\n</robot>"));
                path = folder.join("mended.urdf");
                fs::write(&path, &text).map_err(|e| e.to_string())?;
                outcome.urdf_lines += &line;
            }
            None => return Err(errors.to_string()),
        }
    }
    Err("more than six steps".to_owned())
}

fn collection() -> Option<Vec<PathBuf>> {
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data/urdf"));
    let Ok(entries) = fs::read_dir(folder) else {
        let _ = writeln!(std::io::stderr(), "SKIPPED: {} is not there, no public URDF was read", folder.display());
        return None;
    };
    let mut files: Vec<PathBuf> =
        entries.flatten().map(|e| e.path()).filter(|p| p.extension().is_some_and(|e| e == "urdf")).collect();
    files.sort();
    Some(files)
}

/// Every public file loads, or its refusal names the line with which it does.
#[test]
fn public_files_load_or_name_the_line_that_mends_them() {
    let Some(files) = collection() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let mut failures = Vec::new();
    let mut table = String::new();
    for file in &files {
        let name = file.file_name().and_then(|n| n.to_str()).unwrap_or_default();
        match load(file, folder.path()) {
            Ok((robot, outcome)) => {
                let lines = (outcome.robot_lines + &outcome.urdf_lines).trim().replace('\n', " ");
                let how = if lines.is_empty() { "as it is".to_owned() } else { lines };
                let unknown = robot.description.unknown_bodies.len();
                let _ = writeln!(
                    table,
                    "{name}: {} joints, {unknown} unknown bodies, {} warnings: {how}",
                    robot.dof(),
                    robot.warnings().len()
                );
                for warning in robot.warnings() {
                    let _ = writeln!(table, "    {warning}");
                }
                assert!(robot.nominal.iter().chain(&robot.nominal_base).all(|x| x.is_finite()), "{name}");
            }
            Err(why) => failures.push(format!("{name}: {why}")),
        }
    }
    println!("{table}");
    assert!(failures.is_empty(), "{} of {}:\n{}", failures.len(), files.len(), failures.join("\n"));
}

/// Field files with URDFs load as they are, those of the base link without a warning about it; inertias in g mm^2 are named with their unit.
#[test]
fn field_files_load_with_their_warnings() {
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data/field"));
    let Ok(entries) = fs::read_dir(folder) else {
        let _ = writeln!(std::io::stderr(), "SKIPPED: {} is not there, no field file was read", folder.display());
        return;
    };
    let mut files: Vec<PathBuf> =
        entries.flatten().map(|e| e.path().join("robot.toml")).filter(|p| p.is_file()).collect();
    files.sort();
    assert!(files.len() >= 7, "{files:?}");
    for file in &files {
        let name = file.display().to_string();
        let robot = rivet_config::load(file).unwrap_or_else(|e| panic!("{e}"));
        let warnings = robot.warnings();
        let links = robot.dof();
        let units = warnings.iter().filter(|warning| warning.contains("g mm^2")).count();
        assert_eq!(units, if name.contains("g-mm2") { links } else { 0 }, "{name}: {warnings:?}");
        println!("{name}: {} warnings", warnings.len());
        if name.contains("base-link") {
            assert!(!warnings.iter().any(|warning| warning.contains("base")), "{name}: {warnings:?}");
            let text = fs::read_to_string(file).expect("a robot file").replace("robot.urdf", "triangle.urdf");
            let other = rivet_config::parse(file, &text).unwrap_or_else(|e| panic!("{e}"));
            assert_eq!(other.dof(), links, "its base breaks the triangle inequality and never moves");
        }
    }
}

const BODY: &str = r#"<inertial><origin xyz="0.1 0 0"/><mass value="2"/><inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial>"#;

/// An upright arm of three joints in turned planes, bodies and more as given.
fn three_joints(bodies: [&str; 3], more: &str) -> String {
    let mut text = "<robot name=\"three\">\n<link name=\"base\"/>\n".to_owned();
    for (k, body) in bodies.iter().enumerate() {
        let parent = if k == 0 { "base".to_owned() } else { format!("l{k}") };
        let rpy = if k == 1 { "1.5708 0 0" } else { "0 0 0" };
        let xyz = if k == 2 { "0.5 0 0" } else { "0 0 0.3" };
        let _ = writeln!(
            text,
            "<link name=\"l{n}\">{body}</link>\n<joint name=\"j{n}\" type=\"revolute\"><parent link=\"{parent}\"/><child link=\"l{n}\"/>\
             <origin xyz=\"{xyz}\" rpy=\"{rpy}\"/><axis xyz=\"0 0 1\"/><limit lower=\"-2\" upper=\"2\" effort=\"100\" velocity=\"2\"/>{more}</joint>",
            n = k + 1
        );
    }
    text + "</robot>\n"
}

fn written(text: &str) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("three.urdf");
    fs::write(&path, text).expect("written");
    (folder, path)
}

/// `<dynamics>` of the URDF are the nominal friction where the file has none, and that is said.
#[test]
fn friction_of_the_urdf_holds_where_the_file_has_none() {
    let (_folder, path) = written(&three_joints([BODY; 3], r#"<dynamics damping="1.5" friction="0.7"/>"#));
    let robot = parse(&path, 3, "").expect("loads");
    assert_eq!((&robot.config.friction.viscous, &robot.config.friction.coulomb), (&vec![1.5; 3], &vec![0.7; 3]));
    assert!(
        robot
            .notes()
            .iter()
            .any(|note| note.contains("friction.viscous and friction.coulomb are the <dynamics> of the URDF")
                || note.contains("friction.coulomb and friction.viscous are the <dynamics> of the URDF")),
        "{:?}",
        robot.notes()
    );
    assert!(robot.describe().contains("URDF\n"));
    let robot = parse(&path, 3, "[friction]\ncoulomb = [9, 9, 9]\n").expect("loads");
    assert_eq!((&robot.config.friction.viscous, &robot.config.friction.coulomb), (&vec![1.5; 3], &vec![9.0; 3]));
    let (_folder, path) = written(&three_joints([BODY; 3], r#"<dynamics damping="-1"/>"#));
    let refusal = parse(&path, 3, "").expect_err("no friction").to_string();
    assert!(refusal.contains("joint \"j1\" has damping -1"), "{refusal}");
    assert!(parse(&path, 3, "[friction]\nviscous = [1, 1, 1]\n").is_ok(), "what is not used is no mistake");
}

/// Bodies without `<inertial>` are unknown: the file loads, says so, and their prior is wide.
#[test]
fn missing_bodies_are_said() {
    let (_folder, path) = written(&three_joints([BODY, "", BODY], ""));
    let robot = parse(&path, 3, "").expect("loads");
    assert_eq!(robot.description.unknown_bodies, [1]);
    assert!(
        robot.notes().iter().any(|note| note.contains("no <inertial> of l2") && note.contains("nothing to compare"))
    );
    let std = robot.base.std_from_standard(robot.model.unknown_bodies());
    assert!(std.iter().any(|std| *std > 0.0) && robot.model.unknown_bodies()[..10].iter().all(|std| *std == 0.0));
    let (_folder, path) = written(&three_joints([BODY; 3], ""));
    assert!(parse(&path, 3, "").expect("loads").notes().is_empty());
}

/// All mistakes of a URDF come in one report, with their lines.
#[test]
fn all_mistakes_of_a_urdf_are_reported_at_once() {
    let bad = BODY.replace("ixx=\"0.01\"", "ixx=\"1\"");
    let none = BODY.replace("mass value=\"2\"", "mass value=\"two\"");
    let (_folder, path) = written(&three_joints([&bad, &none, &bad], ""));
    let refusal = parse(&path, 3, "").expect_err("impossible");
    let rules: Vec<&str> = refusal.errors().iter().map(|e| e.rule.as_str()).collect();
    assert_eq!(rules.len(), 3, "{rules:?}");
    for (rule, (line, link)) in rules.iter().zip([(3, "l1"), (5, "l2"), (7, "l3")]) {
        assert!(rule.starts_with(&format!("line {line}: link \"{link}\"")), "{rule}");
    }
    let (_folder, path) = written(&three_joints([&bad, BODY, &bad], ""));
    let robot = parse(&path, 3, "[model]\nimpossible_inertia = \"project\"\n").expect("projected");
    assert_eq!(
        robot.warnings().iter().filter(|w| w.contains("nearest feasible inertia")).count(),
        2,
        "{:?}",
        robot.warnings()
    );
}

/// The arms of this repository are sound. Each rule is broken once on each arm and sees it: the value changes side or unit, nothing else.
#[test]
fn rules_see_values_of_another_side_or_unit_and_nothing_else() {
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../robots"));
    let arms = ["dd2", "kuka-kr300-r2500", "manutec-r3", "staubli-tx40", "ur10", "ur10e", "ur5e"];
    for arm in arms {
        let file = folder.join(arm).join("robot.toml");
        let text = fs::read_to_string(&file).expect("a robot file");
        let robot = rivet_config::parse(&file, &text).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(robot.warnings(), Vec::<String>::new(), "{arm}");
        let warned = |text: &str, words: &str| {
            let robot = rivet_config::parse(&file, text).unwrap_or_else(|e| panic!("{e}"));
            let warnings = robot.warnings();
            assert!(!warnings.is_empty() && warnings.iter().all(|w| w.contains(words)), "{arm}, {words}: {warnings:?}");
        };
        warned(&text.replace("-9.81]", "9.81]"), "points up");
        warned(&text.replace("-9.81]", "-32.2]"), "m/s^2 long");
        let urdf = fs::read_to_string(folder.join(arm).join("robot.urdf")).expect("a URDF");
        let with_urdf = |changed: &str, words: &str| {
            let (_folder, path) = written(changed);
            warned(&text.replace("urdf = \"robot.urdf\"", &format!("urdf = {:?}", path.display().to_string())), words);
        };
        with_urdf(&scaled(&urdf, &["ixx", "ixy", "ixz", "iyy", "iyz", "izz"], 1e9), "g mm^2");
        let drives = |key: &str, change: &dyn Fn(usize, f64) -> f64| {
            let line = text.lines().find(|line| line.starts_with(&format!("{key} = ["))).expect("the key");
            let values = line.split_once('[').and_then(|(_, rest)| rest.split_once(']')).expect("a list").0;
            let new: Vec<String> = values
                .split(',')
                .enumerate()
                .map(|(j, v)| format!("{:?}", change(j, v.trim().parse().expect("a number"))))
                .collect();
            text.replace(line, &format!("{key} = [{}]", new.join(", ")))
        };
        let ratio = robot.config.drive.gear_ratio.clone();
        if arm != "dd2" {
            warned(&drives("rotor_inertia", &|j, x| x / (ratio[j] * ratio[j])), "is that of the motor");
            warned(&drives("coulomb", &|j, x| x / ratio[j].abs()), "is that of the motor");
        }
        if arm != "dd2" {
            let text = drives("torque_limit", &|j, x| x / ratio[j].abs());
            let robot = rivet_config::parse(&file, &text).unwrap_or_else(|e| panic!("{e}"));
            assert!(robot.warnings().iter().any(|w| w.contains("URDF's effort")), "{arm}: {:?}", robot.warnings());
        }
        with_urdf(&scaled(&urdf, &["lower", "upper"], 57.295_779_5), "degrees");
    }
}

/// A URDF with attributes multiplied.
fn scaled(text: &str, attributes: &[&str], factor: f64) -> String {
    let mut out = text.to_owned();
    for attribute in attributes {
        let (mut done, mut rest) = (String::new(), out.as_str());
        let key = format!(" {attribute}=\"");
        while let Some(at) = rest.find(&key) {
            let (start, end) = (at + key.len(), at + key.len() + rest[at + key.len()..].find('"').expect("closed"));
            let value: f64 = rest[start..end].parse().expect("a number");
            let _ = write!(done, "{}{:?}", &rest[..start], value * factor);
            rest = &rest[end..];
        }
        out = done + rest;
    }
    out
}
