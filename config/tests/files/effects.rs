//! `[effects.<name>]`: what is written is what is read, and the model knows it.

use std::path::Path;

use rivet_config::{Changes, FrictionLaw, load, write_changed};
use rivet_dynamics::{EffectKind, KnownEffect, smallest_eigenvalue};

#[test]
fn every_effect_reads_back_with_all_digits() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../robots/ur10e/robot.toml");
    let robot = load(path).unwrap_or_else(|e| panic!("{e}"));
    let effects: Vec<KnownEffect> = EffectKind::ALL
        .iter()
        .enumerate()
        .map(|(i, kind)| {
            let joint = if kind.is_global() { 0 } else { 1 + i % 5 };
            let values: Vec<f64> =
                (0..kind.keys().len()).map(|k| 0.001 * (1.0 + i as f64) / (3.0 + k as f64)).collect();
            KnownEffect::new(*kind, joint, &values)
        })
        .collect();
    let mut drives = robot.config.nominal_joints();
    drives.offset[2] = 0.3;
    let changes = Changes { drives: drives.clone(), gravity: [0.1, -0.2, -9.8], effects: effects.clone() };
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("model.toml");
    let read = write_changed(&robot, &changes, &file).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(read.config.effects, effects);
    assert_eq!(read.model.effects().list(), effects);
    assert_eq!(read.config.gravity, changes.gravity);
    assert_eq!(read.config.nominal_joints().offset, drives.offset);
    assert!(read.model.structure.offset, "an offset that is not 0 is part of the model");
    assert_ne!(read.hash, robot.hash, "parameters beside other effects mean something else");
    assert!(read.model.arm.links.iter().all(|body| smallest_eigenvalue(body) > -1e-9));
    // Another law of friction is another law of the same arm.
    let law = FrictionLaw { viscous_quadratic: true, ..read.friction_law() };
    let refined = read.with_friction_law(law).expect("base parameters");
    assert_eq!(refined.model.effects().list(), effects);
    assert_eq!(refined.with_friction_law(read.friction_law()).expect("base parameters").hash, read.hash);
    // And once more from what was read.
    let again = write_changed(&read, &Changes { effects: Vec::new(), ..changes }, &file).expect("written");
    assert!(again.config.effects.is_empty());
    let text = std::fs::read_to_string(&file).expect("a file");
    assert!(!text.contains("[effects."), "{text}");
}
