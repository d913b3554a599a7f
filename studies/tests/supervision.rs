//! The staged workload of the supervision study, a fifth as long, on one arm.

use rivet_studies::supervision::{Options, study, table};

/// The tracked scheme decides and estimates like the reference, holds what it holds, and supervision is worth having.
#[test]
fn tracked_is_as_good_as_the_reference() {
    let file = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../robots/manutec-r3/robot.toml");
    let robot = rivet_config::load(file).expect("a sound robot file");
    let outcomes = study(&robot, &Options { seeds: 1, length: 0.2, ..Options::default() }, None);
    println!("{}", table(&outcomes));
    let of = |name: &str| outcomes.iter().find(|o| o.name.starts_with(name)).expect("a row of the table");
    let tracked = of("tracked");
    assert!(tracked.efficiency[0] >= 0.85 && tracked.efficiency[1] >= 0.95, "{tracked:?}");
    assert!(tracked.agreement >= 0.95 && tracked.held <= 1e-9, "{tracked:?}");
    assert!(of("plain RIV").efficiency[0] < 0.1 * tracked.efficiency[0], "unsupervised RIV bursts");
}
