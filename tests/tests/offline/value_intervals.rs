//! Values of the model lie in the intervals that a diagnosis tells of them as often as it says.

use rivet_config::Robot;
use rivet_dynamics::Parameter;
use rivet_tests::altered::Random;
use rivet_tests::sines::Sines;
use rivet_tests::{rivet, robot};
use serde_json::Value;

/// Usual errors of a file: of bodies, each as a whole, rotors and friction.
const ERRORS: [f64; 3] = [0.06, 0.09, 0.18];

/// An arm as a file gives it, but for errors of the usual size.
fn drawn(arm: &Robot, random: &mut Random) -> Vec<f64> {
    let bodies: Vec<f64> = (0..arm.dof()).map(|_| (ERRORS[0] * random.normal()).exp()).collect();
    let parameters = arm.model.parameters.iter().zip(&arm.nominal);
    let of = |(parameter, given): (&Parameter, &f64)| match *parameter {
        Parameter::Link { link, .. } => given * bodies[link],
        Parameter::RotorInertia(_) => given * (ERRORS[1] * random.normal()).exp(),
        Parameter::Coulomb(_) | Parameter::Viscous(_) => given * (ERRORS[2] * random.normal()).exp(),
        _ => *given,
    };
    parameters.map(of).collect()
}

/// Of twelve arms 574 of 612. Intervals of resampled blocks alone held 6 of 10: they know nothing of what is believed as given.
#[test]
fn values_lie_in_their_intervals() {
    let file = robot("manutec-r3");
    let arm = rivet_config::load(&file).expect("a sound robot file");
    let all_joints: Vec<usize> = (0..arm.dof()).collect();
    let (mut inside, mut all, mut told_wrong) = (0_usize, 0_usize, 0);
    for seed in 1..=6 {
        let mut random = Random(seed);
        let x = drawn(&arm, &mut random);
        let folder = tempfile::tempdir().expect("a folder");
        let logs = ["a.parquet", "b.parquet"].map(|name| folder.path().join(name));
        for (log_path, shift) in logs.iter().zip([0.0, 3.0]) {
            let motion = Sines { hz: 0.11, harmonics: 4, size: 0.6, shift };
            motion.log(&arm, &x, &all_joints, &mut random, log_path);
        }
        let json = folder.path().join("verdict.json");
        let output = rivet().arg("diagnose").arg(&file).args(&logs).arg("--json").arg(&json).output();
        let text = std::fs::read_to_string(&json);
        let text = text.unwrap_or_else(|why| panic!("{why}: {output:?}"));
        let found: Value = serde_json::from_str(&text).expect("JSON");
        assert_eq!(found["verdict"], "parameter", "{found:#}");
        for value in found["figures"]["parameters"].as_array().expect("values") {
            let of = |key: &str| value[key].as_f64().expect("a number");
            told_wrong += usize::from(value["wrong"] == true && of("given") == of("found"));
            let Some(at) = arm.model.parameters.iter().position(|p| value["name"] == p.name(&arm.model.arm)) else {
                continue;
            };
            // What is nothing in the file is nothing in the arm.
            if x[at] == arm.nominal[at] {
                continue;
            }
            all += 1;
            inside += usize::from((of("low")..=of("high")).contains(&x[at]));
        }
    }
    assert_eq!(told_wrong, 0, "values that nothing changed are told to be wrong");
    let share = inside as f64 / all as f64;
    assert!(all > 300 && (0.85..0.98).contains(&share), "{inside} of {all} in their 90 % intervals");
}
