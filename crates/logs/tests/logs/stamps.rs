//! Time stamps that jitter while positions are even, and stamps that are right although they are uneven.

use rivet_logs::{Log, ReadOptions, read, write_columns};

/// Numbers between -1 and 1 with a mean square of a third, the same in every run.
fn noise(k: usize, kind: u64) -> f64 {
    let mut x = (k as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ (kind + 1).wrapping_mul(0xD1B5_4A32_D192_ED03);
    for _ in 0..3 {
        x ^= x >> 29;
        x = x.wrapping_mul(0xBF58_476D_1CE4_E5B9);
    }
    (x >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
}

/// As far as a root mean square of one.
fn unit(k: usize, kind: u64) -> f64 {
    3.0_f64.sqrt() * noise(k, kind)
}

const ENCODER: f64 = 2e-5;

/// A log of two joints that were sampled at `at` and stamped `stamped`, by an encoder with steps.
fn log(at: &[f64], stamped: &[f64], encoder: f64) -> Log {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("log.parquet");
    let read_off = |q: f64| (q / encoder).round() * encoder;
    let of = |f: &dyn Fn(f64) -> f64| at.iter().map(|t| read_off(f(*t))).collect::<Vec<f64>>();
    let q1 = of(&|t| 0.8 * (1.7 * t).sin() + 0.2 * (5.3 * t).cos());
    let q2 = of(&|t| 0.5 * (3.1 * t).sin());
    let still = of(&|_| 0.3);
    let columns = [("t", stamped), ("q1", &q1), ("q2", &q2), ("q3", &still)];
    write_columns(&path, &columns).expect("written");
    read(&path, &ReadOptions::new(3)).expect("a log").by_its_positions()
}

/// Stamps off by so much, root mean square.
fn off(at: &[f64], by_s: f64, kind: u64) -> Vec<f64> {
    at.iter().enumerate().map(|(k, t)| t + by_s * unit(k, kind)).collect()
}

fn even(rows: usize, step_s: f64) -> Vec<f64> {
    (0..rows).map(|k| 0.2 + step_s * k as f64).collect()
}

/// What a log's time is off another, root mean square, but for what all rows are.
fn apart(log: &Log, at: &[f64]) -> f64 {
    let off: Vec<f64> = log.t.iter().zip(at).map(|(t, at)| t - at).collect();
    let mean = off.iter().sum::<f64>() / off.len() as f64;
    (off.iter().map(|off| (off - mean).powi(2)).sum::<f64>() / off.len() as f64).sqrt()
}

#[test]
fn stamps_that_jitter_about_an_even_clock_are_taken_as_even() {
    for (rows, step_s) in [(2000, 0.01), (10_000, 0.001)] {
        for share in [0.002, 0.03, 0.1, 0.25] {
            let at = even(rows, step_s);
            let jitter_s = share * step_s;
            let stamped = off(&at, jitter_s, 0);
            let log = log(&at, &stamped, if share > 0.01 { ENCODER } else { 1e-7 });
            assert_eq!(log.stamps.as_deref(), Some(&stamped[..]), "{step_s} {share}");
            assert_eq!(log.logged_t(), stamped);
            assert!(apart(&log, &at) < 0.05 * jitter_s && log.off_s == 0.0, "{step_s} {share}: {}", apart(&log, &at));
            let report = log.resample(step_s).expect("resampled").1;
            let told = report.stamps_jitter_s.expect("told");
            assert!((told / jitter_s - 1.0).abs() < 0.05, "{told} of {jitter_s}");
            assert!(report.to_string().contains("positions are even: taken as even"), "{report}");
        }
    }
}

#[test]
fn rows_that_were_sampled_when_they_are_stamped_keep_their_stamps() {
    for (rows, step_s) in [(2000, 0.01), (10_000, 0.001)] {
        let at = off(&even(rows, step_s), 0.1 * step_s, 0);
        let uneven = log(&at, &at, ENCODER);
        assert!(uneven.stamps.is_none() && uneven.t == at && uneven.off_s == 0.0, "{}", uneven.off_s);
    }
    let exact = even(2000, 0.01);
    assert!(log(&exact, &exact, ENCODER).stamps.is_none());
    // Too coarse to say.
    let coarse = log(&exact, &off(&exact, 1e-4, 0), 0.02);
    assert!(coarse.stamps.is_none());
}

/// Rows at uneven instants, and stamps that are off these as well: neither clock is right, and how far off is known.
#[test]
fn jitter_that_no_clock_mends_is_measured() {
    for (rows, step_s) in [(3000, 0.01), (20_000, 0.001)] {
        for (uneven, wrong) in [(0.1, 0.1), (0.15, 0.08)] {
            let at = off(&even(rows, step_s), uneven * step_s, 0);
            let log = log(&at, &off(&at, wrong * step_s, 1), ENCODER);
            assert!(log.stamps.is_none());
            assert!((log.off_s / (wrong * step_s) - 1.0).abs() < 0.15, "{step_s} {uneven}: {}", log.off_s / step_s);
        }
        // Nearly even: what is left is told.
        let at = off(&even(rows, step_s), 0.05 * step_s, 0);
        let log = log(&at, &off(&at, 0.12 * step_s, 1), ENCODER);
        assert!(log.stamps.is_some(), "{step_s}");
        assert!((log.off_s / (0.05 * step_s) - 1.0).abs() < 0.15, "{step_s}: {}", log.off_s / step_s);
    }
}

/// Rows missing here and there, a pause, and a clock that runs faster and slower.
#[test]
fn an_even_clock_has_missing_rows_holes_and_drifts() {
    let step_s = 0.002;
    let kept = |k: &usize| k % 397 != 5 && k % 1009 > 2;
    let rows: Vec<usize> = (0..20_000).filter(kept).collect();
    let clock = |k: usize| {
        let t = step_s * k as f64 + if k > 12_000 { 3.3 } else { 0.0 };
        t + 2e-4 * (0.3 * t).sin()
    };
    let at: Vec<f64> = rows.iter().map(|k| clock(*k)).collect();
    let log = log(&at, &off(&at, 2e-4, 0), ENCODER);
    assert!(log.stamps.is_some());
    assert!(apart(&log, &at) < 5e-5, "{}", apart(&log, &at));
    let later = log.slice(9_000..11_000);
    assert_eq!(later.logged_t(), &log.logged_t()[9_000..11_000]);
}

/// A third of the rows is missing; a source that is stamped when ten rows of it arrive.
#[test]
fn many_missing_rows_and_bursts_are_numbered() {
    let step_s = 0.001;
    let at: Vec<f64> =
        even(20_000, step_s).into_iter().enumerate().filter(|(k, _)| noise(*k, 3) > -0.4).map(|(_, t)| t).collect();
    let sparse = log(&at, &off(&at, 4e-5, 0), ENCODER);
    assert!(sparse.stamps.is_some() && apart(&sparse, &at) < 5e-6, "{}", apart(&sparse, &at));

    let at = even(20_000, step_s);
    let burst = |k: usize| at[k - k % 10] + 1e-7 * (k % 10) as f64;
    let bursts = log(&at, &(0..at.len()).map(burst).collect::<Vec<f64>>(), ENCODER);
    assert!(bursts.stamps.is_some() && apart(&bursts, &at) < 5e-5, "{}", apart(&bursts, &at));
}
