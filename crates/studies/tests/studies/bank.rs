//! A bank of models on the staged workload, shortened, on one arm.

use rivet_studies::supervision::bank::{Options, Outcome, study, table};

/// Over seeds the bank's parameters vary no more than the full model's, and err less; with supervision within the members and
/// without. Its members do not take turns: less than once a second, by construction and as measured.
#[test]
fn the_bank_varies_no_more_than_the_full_model() {
    let file = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../robots/manutec-r3/robot.toml");
    let robot = rivet_config::load(file).expect("a sound robot file");
    // Seeds that no setting was chosen by.
    let options = Options { seeds: 3, first: 100, length: 0.7, ..Options::default() };
    let outcomes = study(&robot, &options);
    println!("{}", table(&outcomes));
    let of = |name: &str| outcomes.iter().find(|o| o.name == name).expect("a row of the table");
    for (full, bank) in [("full", "bank"), ("full, supervised", "bank, supervised")] {
        let (full, bank) = (of(full), of(bank));
        let (more, error) = difference(bank, full);
        println!(
            "{}: variance {:.3} of the full model's, {more:.3} +- {error:.3} more",
            bank.name,
            bank.all[0] / full.all[0]
        );
        // Paired seed by seed; two standard errors are what so few seeds can tell.
        assert!(more <= 2.0 * error, "{bank:?} beside {full:?}");
        assert!(bank.all[1] < 0.5 * full.all[1], "{bank:?} beside {full:?}");
        assert!(bank.switches > 0.0 && bank.switches < 1.0 && bank.soonest > 1.0, "{bank:?}");
    }
}

/// Mean over seeds of what `a` varies more than `b`, and its standard error.
fn difference(a: &Outcome, b: &Outcome) -> (f64, f64) {
    let more: Vec<f64> = a.seeds.iter().zip(&b.seeds).map(|(a, b)| a - b).collect();
    let count = more.len() as f64;
    let mean = more.iter().sum::<f64>() / count;
    let square = more.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (count - 1.0);
    (mean, (square / count).sqrt())
}
