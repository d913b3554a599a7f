//! Equality with an independent implementation (pinocchio 4.1.0, cross-checked with MuJoCo 4.0.0 where the data was
//! made) on the reference arms: torques, gravity, mass matrix and regressor, number by number.

use std::path::PathBuf;

use crate::common::{GRAVITY, robots};
use rivet_dynamics::{Arm, Workspace, inverse_dynamics, mass_matrix, regressor};
use serde_json::Value;

/// Every number of a nested list, in order.
fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(items) => items.iter().flat_map(numbers).collect(),
        Value::Number(n) => vec![n.as_f64().expect("a number")],
        other => panic!("{other} is not a number"),
    }
}

/// Each number to 1e-10 of itself; one that is a difference of larger ones, to 1e-13 of the largest beside it.
fn assert_same(ours: &[f64], golden: &Value, what: &str) {
    let golden = numbers(golden);
    let scale = crate::common::largest(&golden);
    assert_eq!(ours.len(), golden.len(), "{what}");
    for (k, (a, b)) in ours.iter().zip(&golden).enumerate() {
        assert!((a - b).abs() <= 1e-10 * b.abs() + 1e-13 * scale + 1e-14, "{what}[{k}]: {a} is not {b}");
    }
}

fn golden_files(robots: &PathBuf) -> Vec<PathBuf> {
    let list = |dir: &PathBuf| -> Vec<PathBuf> {
        std::fs::read_dir(dir).expect("folder").map(|entry| entry.expect("entry").path()).collect()
    };
    let is_golden = |path: &PathBuf| {
        let name = path.file_name().expect("a file").to_string_lossy().into_owned();
        name.starts_with("golden-dynamics") && name.ends_with(".json")
    };
    list(robots).iter().filter(|p| p.is_dir()).flat_map(list).filter(is_golden).collect()
}

#[test]
fn equals_the_independent_implementation() {
    let Some(robots) = robots() else { return };
    let files = golden_files(&robots);
    assert!(files.len() >= crate::common::REFERENCE_ARMS.len(), "only {} golden files", files.len());
    for file in files {
        let golden: Value = serde_json::from_str(&std::fs::read_to_string(&file).expect("text")).expect("json");
        let urdf = file.with_file_name(golden["urdf"].as_str().expect("urdf"));
        let arm = Arm::from_urdf(&std::fs::read_to_string(&urdf).expect("text"), GRAVITY).expect("an arm");
        let at = |what: &str, k: usize| format!("{} state {k}: {what}", urdf.display());
        let (dof, zero) = (arm.dof(), vec![0.0; arm.dof()]);

        for (k, placement) in golden["joint_placements"].as_array().expect("list").iter().enumerate() {
            assert_eq!(arm.joints[k].name, placement["joint"], "joint order");
            assert_same(arm.joints[k].rotation.as_flattened(), &placement["rotation"], &at("rotation", k));
            assert_same(&arm.joints[k].translation, &placement["translation"], &at("translation", k));
        }
        for (k, link) in golden["link_parameters"].as_array().expect("list").iter().enumerate() {
            assert_same(&arm.links[k], &link["parameters"], &at("link parameters", k));
        }

        let mut ws = Workspace::new(&arm);
        let (mut tau, mut m, mut y) = (vec![0.0; dof], vec![0.0; dof * dof], vec![0.0; 10 * dof * dof]);
        let states = golden["states"].as_array().expect("list");
        assert_eq!(states.len(), 100);
        let mut seen = [0; 3];
        for (k, state) in states.iter().enumerate() {
            let [q, qd, qdd] = ["q", "qd", "qdd"].map(|name| numbers(&state[name]));
            inverse_dynamics(&arm, &arm.links, &mut ws, &q, &qd, &qdd, &mut tau);
            assert_same(&tau, &state["tau"], &at("tau", k));
            if let Some(gravity) = state.get("gravity") {
                inverse_dynamics(&arm, &arm.links, &mut ws, &q, &zero, &zero, &mut tau);
                assert_same(&tau, gravity, &at("gravity", k));
                seen[0] += 1;
            }
            if let Some(golden_m) = state.get("mass_matrix") {
                mass_matrix(&arm, &arm.links, &mut ws, &q, &mut m);
                assert_same(&m, golden_m, &at("mass matrix", k));
                seen[1] += 1;
            }
            if let Some(golden_y) = state.get("regressor") {
                regressor(&arm, &mut ws, &q, &qd, &qdd, &mut y);
                assert_same(&y, golden_y, &at("regressor", k));
                seen[2] += 1;
            }
        }
        assert_eq!(seen, [10, 10, 5], "{}: states with gravity, mass matrix, regressor", file.display());
    }
}
