//! What `rivet figures` shows must hold: the same functions, every number.

use rivet_studies::figures::{FIGURES, REPETITIONS, figure, page};

fn holds(number: u32) {
    let figure = figure(number, REPETITIONS).expect("there is such a figure");
    for check in &figure.checks {
        println!("figure {number}: {} {} ({}): {}", check.what, check.measured, check.limit, check.pass);
    }
    assert!(!figure.checks.is_empty() && !figure.panels.is_empty());
    assert!(figure.panels.iter().all(|p| p.series.iter().any(|s| s.points.len() > 1)), "an empty chart");
    assert!(figure.checks.iter().all(|c| c.pass), "figure {number} does not hold");
    let page = page(&[figure]);
    assert!(page.contains("<svg") && !page.contains("NaN") && !page.contains("http://") && !page.contains("https://"));
}

macro_rules! figures {
    ($($name:ident $number:literal)*) => {
        $(#[test] fn $name() { holds($number); })*
        #[test]
        fn every_figure_is_tested() {
            assert_eq!(FIGURES, [$($number),*]);
            assert!(figure(4, 1).is_none());
        }
    };
}

figures! {
    figure_3 3
    figure_5 5
    figure_6 6
    figure_7 7
    figure_8 8
    figure_9 9
    figure_12 12
    figure_13 13
    figure_15 15
    figure_16 16
    figure_18 18
    figure_19 19
}
