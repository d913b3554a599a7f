//! A window of constant trace (Sripada & Fisher 1987): the average variance of the parameters is kept, whatever the
//! excitation.

use crate::common::{Random, known_noise};
use rivet_estimation::ud::UdFilter;
use rivet_estimation::{Estimator, EstimatorKind, EstimatorSettings, Instrument, Prior, Scales, Supervision};

const N: usize = 6;
const DEVIATION: f64 = 0.1;
/// Shortest window \[rows\].
const SHORTEST: f64 = 20.0;

fn estimator() -> Estimator {
    Estimator::new(
        &[1.0; N],
        &Scales::unit(1, N),
        &EstimatorSettings {
            forgetting: (-1.0 / SHORTEST).exp(),
            deviation: Some(DEVIATION),
            prior: Prior { relative_std: 10.0 },
            noise_memory: 1000.0,
            residual_memory: 1000.0,
            ..known_noise(EstimatorKind::Rls, Supervision::Off)
        },
    )
}

/// Feeds `count` rows whose entry `i` has the rms `rms[i]`; returns the shortest and the longest window there was.
fn feed(
    estimator: &mut Estimator,
    random: &mut Random,
    rms: [f64; N],
    truth: [f64; N],
    count: usize,
    mut each: impl FnMut(f64, &[f64]),
) {
    for _ in 0..count {
        let row = rms.map(|rms| rms * random.normal());
        let tau: f64 = row.iter().zip(truth).map(|(d, x)| d * x).sum::<f64>() + random.normal();
        estimator.update(&row, Some((&row, Instrument::Regressor)), &[tau], &[1.0]).expect("a usable row");
        estimator.work();
        each(estimator.estimate().window_rows, &row);
    }
}

/// The trace of P, by a filter that is told the same rows and the windows that the estimator reports.
#[test]
fn the_trace_is_constant_to_5_percent_while_identifiable() {
    let (mut estimator, mut random) = (estimator(), Random(1));
    let mut beside = UdFilter::new(&[1.0; N], &[100.0; N]);
    let kept = N as f64 * DEVIATION * DEVIATION;
    let mut windows = Vec::new();
    // Strong, weak and uneven excitation, ten thousand rows each; the first thousand get there.
    for rms in [[1.0; N], [0.4; N], [2.0, 2.0, 2.0, 0.5, 0.5, 0.5]] {
        let (mut k, mut sum) = (0, 0.0);
        feed(&mut estimator, &mut random, rms, [2.0; N], 10_000, |window, row| {
            beside.forget((-1.0 / window).exp());
            beside.update(row, 0.0);
            k += 1;
            if k > 2000 {
                let trace = beside.trace();
                assert!((trace / kept - 1.0).abs() < 0.05, "{rms:?}: trace {trace} of {kept}");
                sum += window.recip();
            }
        });
        windows.push(8000.0 / sum);
    }
    println!("windows {windows:?}");
    // The variance of a parameter is 1/(window·rms²): what is weakly excited has the longer window.
    for (window, rms) in windows.iter().zip([1.0_f64, 0.4]) {
        let expected = 1.0 / (rms * DEVIATION).powi(2);
        assert!((window / expected - 1.0).abs() < 0.15, "window of {window} rows, not {expected}");
    }
}

/// A direction without excitation: nothing winds up, and what is known of it is not lost; it costs the others their memory
/// for what is new, which is what a scalar window cannot help.
#[test]
fn nothing_winds_up_without_excitation() {
    let (mut estimator, mut random) = (estimator(), Random(2));
    feed(&mut estimator, &mut random, [1.0; N], [2.0; N], 3000, |_, _| ());
    let before = estimator.estimate().rls_values[N - 1];
    let mut poor = [1.0; N];
    poor[N - 1] = 0.0;
    let mut longest = 0.0_f64;
    feed(&mut estimator, &mut random, poor, [2.0; N], 100_000, |window, _| longest = longest.max(window));
    let after = estimator.estimate().rls_values[N - 1];
    assert!(longest > 10.0 / DEVIATION.powi(2), "the window became no longer than {longest} rows");
    assert!((after - before).abs() < 0.3, "{before} became {after}");
    // Back at work it follows a change within a few windows.
    feed(&mut estimator, &mut random, [1.0; N], [3.0; N], 2000, |_, _| ());
    for x in estimator.estimate().rls_values {
        assert!((x - 3.0).abs() < 5.0 * DEVIATION, "{x} instead of 3");
    }
}
