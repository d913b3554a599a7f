//! What stated standard deviations are worth between independent runs of a measured arm.

use rivet_tests::{rivet, robot, shared, succeed};
use serde_json::Value;

/// Parameters of independent runs of a measured arm differ as their standard deviations say.
#[test]
fn disjoint_runs_of_the_ur10e_agree() {
    let Some(data) = shared("data/real/ur10e_innopolis") else { return };
    let runs = ["20_02_10-30sec_12harm", "20_02_12-50sec_12harm", "20_02_19_14harm50sec"];
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("compared.json");
    let mut compare = rivet();
    compare.arg("identify").arg(robot("ur10e")).arg("--compare").arg("--json").arg(&out);
    let printed = succeed(compare.args(runs.map(|run| data.join(format!("{run}.parquet")))));
    println!("{}", String::from_utf8_lossy(&printed.stdout));
    let json: Value = serde_json::from_slice(&std::fs::read(&out).expect("a result")).expect("JSON");
    let pairs = json["pairs"].as_array().expect("pairs");
    assert_eq!(pairs.len(), 3);
    for pair in pairs {
        let (within, of) = (pair["within"].as_u64().expect("a count"), pair["of"].as_u64().expect("a count"));
        assert!(of >= 55, "{of} parameters are decided by the data in both runs");
        assert!(within as f64 >= 0.85 * of as f64, "{within} of {of}");
    }
    // Not by being huge: the median standard deviation makes less than a hundredth of a joint's torque.
    for run in json["runs"].as_array().expect("runs") {
        let percent = run["median_std_torque_percent"].as_f64().expect("a number");
        assert!(percent < 1.0, "{percent}");
    }
}
