//! Resampling: known sinusoids come out where they belong, without lag, alike on every signal.

use std::f64::consts::PI;

use rivet_logs::{Log, Method, ReadOptions, read, write_columns};

/// A log of one joint with position sin and torque cos at `hz`, at the times `t`.
fn log(t: &[f64], hz: f64) -> Log {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("run.parquet");
    let q: Vec<f64> = t.iter().map(|t| (2.0 * PI * hz * t).sin()).collect();
    let tau: Vec<f64> = t.iter().map(|t| 3.0 * (2.0 * PI * hz * t).cos()).collect();
    write_columns(&path, &[("t", t), ("q1", &q), ("tau1", &tau), ("temperature1", &q)]).expect("written");
    read(&path, &ReadOptions::new(1)).expect("sound")
}

/// Largest distance of position and torque to the true sinusoids.
fn error(log: &Log, hz: f64) -> f64 {
    let tau = &log.torque().expect("torque")[0];
    let far = |k: usize| {
        let phase = 2.0 * PI * hz * log.t[k];
        (log.q[0][k] - phase.sin()).abs().max((tau[k] / 3.0 - phase.cos()).abs())
    };
    (0..log.len()).map(far).fold(0.0, f64::max)
}

fn uniform(count: usize, step: f64) -> Vec<f64> {
    (0..count).map(|k| 100.0 + k as f64 * step).collect()
}

#[test]
fn a_log_on_the_grid_is_left_alone() {
    let log = log(&uniform(500, 0.001), 2.0);
    let (same, report) = log.resample(0.001).expect("resampled");
    assert_eq!((report.method, report.rows_out), (Method::AsLogged, 500));
    assert_eq!((&same.q, &same.tau), (&log.q, &log.tau));
}

/// 5 kHz to 1 kHz: within the pass-band (a quarter of the new rate) amplitude and phase stay.
#[test]
fn decimation_keeps_slow_sinusoids_and_removes_what_would_fold() {
    for hz in [1.0, 20.0, 100.0] {
        let (slow, report) = log(&uniform(20_000, 0.0002), hz).resample(0.001).expect("resampled");
        assert_eq!(report.method, Method::Decimated { factor: 5 });
        assert!(error(&slow, hz) < 1e-3, "{hz} Hz: {}", error(&slow, hz));
    }
    // 800 Hz would appear at 200 Hz.
    let (folded, _) = log(&uniform(20_000, 0.0002), 800.0).resample(0.001).expect("resampled");
    let loudest = folded.q[0].iter().fold(0.0_f64, |m, q| m.max(q.abs()));
    assert!(loudest < 2e-4, "{loudest}");
}

/// Jitter of a tenth of a step, 94 Hz to 1 kHz: the spline's error at 3 Hz is of order (w h)^4/384.
#[test]
fn uneven_logs_are_interpolated_without_lag() {
    let jitter = |k: usize| 0.001 * (12.9898 * k as f64).sin();
    let t: Vec<f64> = (0..1000).map(|k| k as f64 / 94.0 + jitter(k)).collect();
    let (even, report) = log(&t, 3.0).resample(0.001).expect("resampled");
    assert_eq!(report.method, Method::Interpolated);
    assert!((report.mean_rate_hz - 94.0).abs() < 0.1 && report.jitter_s > 1e-4, "{report}");
    let n = even.len();
    let inner = even.slice(50..n - 50);
    assert!(error(&inner, 3.0) < 1e-4, "{}", error(&inner, 3.0));
    assert!(error(&even, 3.0) < 5e-3, "ends: {}", error(&even, 3.0));
    assert!(even.t.windows(2).all(|w| (w[1] - w[0] - 0.001).abs() < 1e-9));
}

/// Rows that are not there are no jitter of those that are.
#[test]
fn missing_rows_are_called_so() {
    let t: Vec<f64> = (0..2000).filter(|k| k % 97 != 50 && k % 301 > 2).map(|k| 1e-3 * f64::from(k)).collect();
    let (_, report) = log(&t, 3.0).resample(0.001).expect("resampled");
    // The first row is not missing from within.
    let between = 2000 - t.len() - 3;
    assert!(report.missing == between && report.jitter_s < 1e-9, "{between}: {report}");
    assert!(report.to_string().contains(&format!(", {between} rows missing")), "{report}");
    assert_eq!(report.gaps.len(), 6, "{report}");
    let (_, even) = log(&uniform(2000, 0.001), 3.0).resample(0.001).expect("resampled");
    assert!(even.missing == 0 && !even.to_string().contains("missing"), "{even}");
}

/// 300 Hz to 125 Hz: neither a multiple of the other.
#[test]
fn foreign_rates_are_interpolated_then_decimated() {
    let (even, report) = log(&uniform(3000, 1.0 / 300.0), 4.0).resample(0.008).expect("resampled");
    assert_eq!(report.method, Method::InterpolatedAndDecimated { factor: 3 });
    assert!(error(&even, 4.0) < 1e-3, "{}", error(&even, 4.0));
}

#[test]
fn gaps_and_stairs_are_reported_and_gaps_cut_the_log() {
    let mut t = uniform(400, 0.01);
    t[200..].iter_mut().for_each(|t| *t += 0.49);
    let log = log(&t, 0.5);
    let (_, report) = log.resample(0.01).expect("resampled");
    assert_eq!(report.gaps.len(), 1);
    assert_eq!(report.gaps[0].row, 201);
    assert!((report.gaps[0].length_s - 0.5).abs() < 1e-9);
    assert!(report.to_string().contains("1 gap, the longest 500.0 ms before row 201"), "{report}");
    let pieces = log.split_at_gaps(0.1);
    assert_eq!(pieces.iter().map(|piece| piece.len()).collect::<Vec<_>>(), [200, 200]);

    let mut stairs = log.clone();
    for k in (5..400).step_by(5) {
        stairs.q[0][k] = stairs.q[0][k - 1];
    }
    let share = stairs.resample(0.01).expect("resampled").1.repeated[0];
    assert!((share - 0.2).abs() < 0.03, "{share}");
    assert!(log.resample(0.01).expect("resampled").1.repeated[0] < 0.01);
}

#[test]
fn senseless_periods_and_short_logs_are_refused() {
    let log = log(&uniform(50, 0.0002), 2.0);
    for period in [0.0, -1.0, f64::NAN] {
        assert!(log.resample(period).is_err());
    }
    let why = log.resample(0.001).expect_err("50 rows of 5 kHz").to_string();
    assert!(why.contains("50 rows; at least 91 are needed"), "{why}");
}

/// Time in another unit, by mistake or by malice: refused before the rows are made.
#[test]
fn rows_that_would_be_made_out_of_next_to_nothing_are_refused() {
    for (step, period) in [(1e9, 0.001), (1.5, 0.001), (1e-6, 10.0)] {
        let why = log(&uniform(50, step), 0.01 / step).resample(period).expect_err("refused").to_string();
        assert!(why.contains("50 rows") || why.contains("rows; at least"), "{why}");
    }
    let (slow, _) = log(&uniform(50, 0.9), 0.01).resample(0.001).expect("a slow log is one");
    assert_eq!(slow.len(), 44_101);
}

/// Numbers as large as are taken, as close together as they may be: what comes of them is finite.
#[test]
fn the_wildest_log_that_is_taken_stays_finite() {
    let mut t = uniform(60, 0.001);
    for t in &mut t {
        *t -= 100.0;
    }
    t[1] = t[0] + 1.1e-9;
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("run.parquet");
    let wild: Vec<f64> = (0..60).map(|k| if k % 2 == 0 { 1e12 } else { -1e12 }).collect();
    write_columns(&path, &[("t", &t), ("q1", &wild), ("current1", &wild)]).expect("written");
    let options = ReadOptions { drive_gain: Some(&[1e5]), ..ReadOptions::new(1) };
    let log = read(&path, &options).expect("taken");
    for period in [0.0003, 0.001, 0.002] {
        let (log, _) = log.resample(period).expect("resampled");
        assert!(log.q[0].iter().chain(&log.torque().expect("torque")[0]).all(|x| x.is_finite()), "{period}");
    }
}
