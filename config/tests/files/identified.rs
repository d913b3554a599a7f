//! A robot file with identified parameters is written whole and reads back as what was written.

use std::fs;
use std::path::{Path, PathBuf};

use rivet_config::{ConfigErrors, Robot, load, write_identified};

fn project(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}

/// Values that differ from the nominal ones, with digits to lose.
fn values(robot: &Robot) -> (Vec<f64>, Vec<f64>) {
    let values = robot.nominal_base.iter().enumerate().map(|(i, x)| x * 1.1 + 1.0 / (3.0 + i as f64)).collect();
    let std = (0..robot.base.len()).map(|i| 1e-9 / (7.0 + i as f64)).collect();
    (values, std)
}

#[test]
fn written_model_reads_back_bit_for_bit() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for name in ["manutec-r3", "staubli-tx40", "kuka-kr300-r2500", "dd2"] {
        let robot = load(project("robots").join(name).join("robot.toml")).unwrap_or_else(|e| panic!("{e}"));
        let (values, std) = values(&robot);
        let path = folder.path().join(format!("{name}.toml"));
        write_identified(&robot, &values, &std, &path).expect("written");
        let back = load(&path).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(back.hash, robot.hash);
        assert_eq!(back.nominal, robot.nominal, "every digit of the contract part is kept");
        assert_eq!(back.base_parameters(), values);
        let identified = back.identified.as_ref().expect("written above");
        assert_eq!(identified.std, std);
        assert_eq!(
            (&back.config.drive, &back.config.friction, &back.config.coupling, &back.config.log),
            (&robot.config.drive, &robot.config.friction, &robot.config.coupling, &robot.config.log)
        );
        assert_eq!((&back.config.signal, &back.config.estimator), (&robot.config.signal, &robot.config.estimator));
        assert_eq!(back.config.controller, robot.config.controller);
        assert_eq!(back.config.simulation, robot.config.simulation);
        // A second generation replaces the first and nothing else lies about.
        write_identified(&back, &robot.nominal_base, &std, &path).expect("written again");
        assert_eq!(load(&path).unwrap_or_else(|e| panic!("{e}")).base_parameters(), robot.nominal_base);
        fs::remove_file(&path).expect("written above");
    }
    assert_eq!(fs::read_dir(folder.path()).expect("made above").count(), 0, "no temporary file is left");
}

#[test]
fn values_that_are_no_model_are_not_written() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let robot = load(project("robots/dd2/robot.toml")).unwrap_or_else(|e| panic!("{e}"));
    let (mut values, std) = values(&robot);
    let path = folder.path().join("model.toml");
    write_identified(&robot, &values[1..], &std, &path).expect_err("one value is missing");
    values[2] = f64::NAN;
    let error = write_identified(&robot, &values, &std, &path).expect_err("NaN");
    assert!(error.to_string().contains(&robot.base.name(&robot.model, 2)), "{error}");
    assert!(!path.exists());
}

/// Writes a model for dd2, changes its text, and returns the mistakes found.
fn mistakes(change: impl Fn(&str) -> String) -> ConfigErrors {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let robot = load(project("robots/dd2/robot.toml")).unwrap_or_else(|e| panic!("{e}"));
    let (values, std) = values(&robot);
    let path = folder.path().join("model.toml");
    write_identified(&robot, &values, &std, &path).expect("written");
    let text = fs::read_to_string(&path).expect("written");
    let changed = change(&text);
    assert_ne!(text, changed);
    fs::write(&path, changed).expect("written");
    load(&path).expect_err("the file is wrong now")
}

#[test]
fn identified_parameters_are_checked_against_the_model() {
    let one = |errors: &ConfigErrors| {
        assert_eq!(errors.errors().len(), 1, "{errors}");
        (errors.errors()[0].key.clone(), errors.errors()[0].to_string())
    };
    let (key, text) = one(&mistakes(|t| t.replace("\"j2.viscous\"", "\"j2.viscosity\"")));
    assert_eq!(key, "identified.parameters");
    assert!(text.contains("is no base parameter of this model; did you mean \"j2.viscous\"?"), "{text}");

    let (_, text) = one(&mistakes(|t| t.replace("\"j2.viscous\"", "\"j1.viscous\"")));
    assert!(text.contains("\"j1.viscous\" is given twice"), "{text}");

    let (_, text) = one(&mistakes(|t| t.lines().filter(|l| !l.contains("j1.coulomb")).collect::<Vec<_>>().join("\n")));
    assert!(text.contains("base parameters; \"j1.coulomb\" is missing"), "{text}");

    // Another gravity is another meaning of the same numbers.
    let (key, text) = one(&mistakes(|t| t.replace("[0.0, 0.0, -9.81]", "[0.0, 0.0, -1.62]")));
    assert_eq!(key, "identified.hash");
    assert!(text.contains("must be the hash of this model"), "{text}");
}
