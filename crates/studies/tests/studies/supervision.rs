//! The staged workload of the supervision study, one seed of it: a fifth as long, or whole where that is too short to tell. That the
//! tracked scheme takes an eighth of the oracle's time is for `rivet study supervision` to show: the oracle is other code (nalgebra),
//! whose operations nobody counts.

use rivet_studies::supervision::{Options, Outcome, study, table};

fn outcomes(arm: &str, length: f64) -> Vec<Outcome> {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../robots");
    let robot = rivet_config::load(root.join(arm).join("robot.toml")).expect("a sound robot file");
    let outcomes = study(&robot, &Options { seeds: 1, length, ..Options::default() }, None);
    println!("{arm}\n{}", table(&outcomes));
    outcomes
}

fn of<'a>(outcomes: &'a [Outcome], name: &str) -> &'a Outcome {
    outcomes.iter().find(|o| o.name.starts_with(name)).expect("a row of the table")
}

fn assert_as_good_as_the_oracle(outcomes: &[Outcome]) {
    for name in ["eigen in slices", "tracked"] {
        let scheme = of(outcomes, name);
        assert!(scheme.efficiency[0] >= 0.85 && scheme.efficiency[1] >= 0.95, "{scheme:?}");
        assert!(scheme.agreement >= 0.95 && scheme.held <= 1e-9, "{scheme:?}");
        assert!(of(outcomes, "plain RIV").efficiency[0] < 0.1 * scheme.efficiency[0], "unsupervised RIV bursts");
    }
}

/// The eigen-decomposition in slices, as in the daemon, and the tracked scheme decide and estimate like an oracle of other
/// code that does all of it with every row; they hold what they hold, and supervision is worth having.
#[test]
fn at_recursive_cost_as_good_as_the_oracle() {
    let outcomes = outcomes("manutec-r3", 0.2);
    assert_as_good_as_the_oracle(&outcomes);
    // The same rule by other code; what is left is that the estimator decides 300 times in a window, here with every second row
    // (with every row: 0.996, 1.000 and 100.0 %).
    let whole = of(&outcomes, "eigen, whole");
    assert!(whole.efficiency.iter().all(|e| (e - 1.0).abs() <= 0.05) && whole.agreement >= 0.99, "{whole:?}");
}

/// The same on an arm with a coupled wrist, at whole length: in a fifth of it the start of motion, where fewer decisions than the
/// oracle's cost something, weighs so much that local efficiency is a matter of seeds (`docs/supervision.md`).
#[test]
fn at_recursive_cost_as_good_as_the_oracle_with_a_coupled_wrist() {
    assert_as_good_as_the_oracle(&outcomes("staubli-tx40", 1.0));
}
