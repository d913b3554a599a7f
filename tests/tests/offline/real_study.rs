//! Measured arms: what `rivet identify --refine` learns on some motions predicts another at least as well as plain batch
//! least squares with the same training rows does. The friction it has was chosen on the training rows alone.

use rivet_tests::{rivet, root, shared, succeed};
use serde_json::Value;

fn rms(values: &Value) -> f64 {
    let values = values.as_array().expect("one figure a joint");
    (values.iter().map(|x| x.as_f64().expect("a number").powi(2)).sum::<f64>() / values.len() as f64).sqrt()
}

#[test]
fn unseen_motions_are_predicted_better_than_by_plain_least_squares() {
    let Some(data) = shared("data/real") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("real.json");
    let mut run = rivet();
    run.args(["study", "real", "--root"]).arg(root()).arg("--data").arg(data).arg("--json").arg(&file);
    succeed(&mut run);
    let found: Value = serde_json::from_str(&std::fs::read_to_string(&file).expect("written")).expect("JSON");
    let splits = found["splits"].as_array().expect("splits");
    let mut held = Vec::new();
    for split in splits {
        let name = split["split"].as_str().expect("a name");
        let errors = &split["error_percent"];
        let (plain, ours) = (rms(&errors["plain"]), rms(&errors["rivet"]));
        println!("{name}: plain least squares {plain:.2} %, rivet {ours:.2} %");
        assert!(ours <= plain, "{name}: {ours} % against {plain} %");
        held.push(name);
        // What the nearest arm that can be built costs on a motion that neither set was learnt from.
        let built = rms(&errors["consistent"]);
        // Kinova 2.3 points: its free set has 15.4 % since undetermined directions are held (16.2 before), its consistent one 17.7 % as before.
        assert!(built <= ours + 2.5, "{name}: the consistent set misses {built} %, the free one {ours} %");
        if name.starts_with("UR10e") {
            let cost = split["consistency_cost_percent"].as_f64().expect("a number");
            assert!(cost <= 2.0, "{name}: the consistent set is {cost} % of torque away");
        }
    }
    assert_eq!(held.len(), 8, "{held:?}");
}
