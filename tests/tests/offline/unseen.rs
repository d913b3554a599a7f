//! Values that the motion looked at does not show are no missing effect, and no change between the runs.

use std::path::Path;

use rivet_dynamics::Parameter;
use rivet_tests::altered::{Random, answer};
use rivet_tests::rivet;
use rivet_tests::robot;
use rivet_tests::sines::Sines;
use serde_json::Value;

fn diagnosed(logs: &[&Path], folder: &Path) -> (Option<i32>, String, Value) {
    let mut command = rivet();
    command.args(["diagnose", "--details"]).arg(robot("manutec-r3")).args(logs);
    answer(&mut command, folder)
}

/// A Manutec with viscous friction that is half as much again as its file says. Slow motion hardly shows that; fast motion does.
#[test]
fn what_slow_motion_does_not_show_of_values_is_asked_for() {
    let arm = rivet_config::load(robot("manutec-r3")).expect("a sound robot file");
    let joints: Vec<usize> = (0..arm.dof()).collect();
    let with = |coulomb: f64| -> Vec<f64> {
        let times = |parameter: &Parameter| match parameter {
            Parameter::Viscous(_) => 1.5,
            Parameter::Coulomb(_) => coulomb,
            _ => 1.0,
        };
        arm.model.parameters.iter().zip(&arm.nominal).map(|(parameter, given)| times(parameter) * given).collect()
    };
    let folder = tempfile::tempdir().expect("a folder");
    let names = ["slow.parquet", "fast.parquet", "again.parquet", "worn.parquet"];
    let [slow, fast, again, worn] = names.map(|name| folder.path().join(name));
    let mut random = Random(5);
    Sines { hz: 0.04, harmonics: 1, size: 0.2, shift: 0.0 }.log(&arm, &with(1.0), &joints, &mut random, &slow);
    Sines { hz: 0.11, harmonics: 4, size: 0.6, shift: 1.0 }.log(&arm, &with(1.0), &joints, &mut random, &again);
    let motion = Sines { hz: 0.11, harmonics: 4, size: 0.6, shift: 3.0 };
    motion.log(&arm, &with(1.0), &joints, &mut random, &fast);
    motion.log(&arm, &with(1.6), &joints, &mut random, &worn);

    let (code, text, found) = diagnosed(&[&slow, &fast], folder.path());
    assert_eq!((code, &found["verdict"]), (Some(3), &Value::from("not_evaluated")), "{text}");
    assert_eq!(found["between_runs"], "values_unseen", "{text}");
    assert_eq!(found["causes"], Value::Array(Vec::new()), "{text}");
    let words = text.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(words.contains("give it before the others") && words.contains("gap by joint"), "{text}");

    let (_, text, found) = diagnosed(&[&again, &slow, &fast], folder.path());
    assert_eq!(found["verdict"], "parameter", "as it says: {text}");

    let (_, text, found) = diagnosed(&[&slow, &worn], folder.path());
    assert_eq!(
        (&found["verdict"], &found["between_runs"]),
        (&"unexplained".into(), &"sealed_differs".into()),
        "{text}"
    );
}
