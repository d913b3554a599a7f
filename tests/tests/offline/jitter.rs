//! Logs whose rows are off their time stamps: what is mended, and what is said where nothing mends it.

use std::path::{Path, PathBuf};

use rivet_logs::{Log, ReadOptions, TorqueSource, interpolate, read, read_columns, write_columns};
use rivet_tests::altered::{said, sound, written};
use rivet_tests::{rivet, robot, shared};
use serde_json::Value;

/// Numbers of a mean square of one, no row like the one before it.
fn random(row: usize, kind: u64) -> f64 {
    let mut x = (row as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ (kind + 1).wrapping_mul(0xD1B5_4A32_D192_ED03);
    for _ in 0..3 {
        x ^= x >> 29;
        x = x.wrapping_mul(0xBF58_476D_1CE4_E5B9);
    }
    3.0_f64.sqrt() * ((x >> 11) as f64 / (1_u64 << 52) as f64 - 1.0)
}

/// A simulated arm's log at a lower rate, sampled at uneven instants and stamped off those (shares of a step), as a file.
fn sampled(log: &Log, every: usize, [uneven, wrong]: [f64; 2], folder: &Path) -> PathBuf {
    let step_s = log.t[every] - log.t[0];
    let inside = (20..log.len() - 20).step_by(every);
    let at: Vec<f64> = inside.enumerate().map(|(row, k)| log.t[k] + uneven * step_s * random(row, 0)).collect();
    let of =
        |signals: &Vec<Vec<f64>>| -> Vec<Vec<f64>> { signals.iter().map(|x| interpolate(&log.t, x, &at)).collect() };
    let tau = of(log.torque().expect("torque"));
    let t = at.iter().enumerate().map(|(row, t)| t + wrong * step_s * random(row, 1)).collect();
    written(&Log { t, q: of(&log.q), q_des: log.q_des.as_ref().map(of), ..log.clone() }, &tau, folder)
}

/// What `identify` found (JSON) and said (text on one line).
fn identified(file: &Path, log: &Path) -> (Value, String) {
    let json = log.with_extension("json");
    let (code, text) = said(rivet().arg("identify").arg(file).arg(log).arg("--json").arg(&json));
    assert_eq!(code, Some(0), "{text}");
    (serde_json::from_str(&std::fs::read_to_string(json).expect("written")).expect("JSON"), text)
}

/// Half a minute of the arm of two joints at 1 kHz, its encoders with steps, its torque the model's with a little noise.
fn simulated(folder: &Path) -> Log {
    let t: Vec<f64> = (0..30_000).map(|k| 1e-3 * f64::from(k)).collect();
    let along = |terms: &[(f64, f64)]| -> Vec<f64> {
        t.iter().map(|t| terms.iter().map(|(size, rate)| size * (1.0 - (rate * t).cos())).sum()).collect()
    };
    let desired = [along(&[(0.5, 2.1), (0.12, 5.7)]), along(&[(0.4, 2.9), (0.1, 7.3)])];
    let [motion, torque] = ["motion.parquet", "torque.parquet"].map(|name| folder.join(name));
    write_columns(&motion, &[("t", &t), ("q1", &desired[0]), ("q2", &desired[1])]).expect("written");
    let (code, text) = said(rivet().arg("predict").arg(robot("dd2")).arg(&motion).arg("--out").arg(&torque));
    assert_eq!(code, Some(0), "{text}");
    let mut tau = read_columns(&torque, &["tau_pred1", "tau_pred2"]).expect("columns");
    for (joint, tau) in tau.iter_mut().enumerate() {
        let size = (tau.iter().map(|tau| tau * tau).sum::<f64>() / tau.len() as f64).sqrt();
        tau.iter_mut().enumerate().for_each(|(row, tau)| *tau += 0.02 * size * random(row, 7 + joint as u64));
    }
    let q = desired.iter().map(|q| q.iter().map(|q| (q / 5e-6).round() * 5e-6).collect()).collect();
    let log = read(&motion, &ReadOptions::new(2)).expect("a log");
    Log { q, tau: Some((TorqueSource::Logged, tau)), q_des: Some(desired.to_vec()), ..log }
}

fn faults(found: &Value) -> Vec<&str> {
    found["warnings"].as_array().expect("warnings").iter().filter_map(|w| w["fault"].as_str()).collect()
}

fn worst_residual(found: &Value) -> f64 {
    let of = |joint: &Value| joint["residual_percent"]["instrumental"].as_f64().expect("a number");
    found["joints"].as_array().expect("joints").iter().map(of).fold(0.0, f64::max)
}

#[test]
fn stamps_that_jitter_about_even_positions_cost_nothing_and_are_said() {
    let folder = tempfile::tempdir().expect("a folder");
    let log = simulated(folder.path());
    for (every, wrong) in [(10, 0.09), (1, 0.1)] {
        let exact = worst_residual(&identified(&robot("dd2"), &sampled(&log, every, [0.0; 2], folder.path())).0);
        let path = sampled(&log, every, [0.0, wrong], folder.path());
        let (found, text) = identified(&robot("dd2"), &path);
        assert!(worst_residual(&found) < 1.05 * exact, "{} of {exact}", worst_residual(&found));
        assert_eq!(found["logs"][0]["taken_as_even"], true, "{found:#}");
        let jitter_s = found["logs"][0]["stamps_jitter_s"].as_f64().expect("told");
        assert!((jitter_s / (wrong * 1e-3 * every as f64) - 1.0).abs() < 0.1, "{jitter_s}");
        assert!(text.contains("positions are even: taken as even"), "{text}");
        assert!(!faults(&found).contains(&"time_stamps_jitter"), "{found:#}");
        // A prediction has the log's own rows and stamps.
        let out = folder.path().join("predicted.parquet");
        let (code, text) = said(rivet().arg("predict").arg(robot("dd2")).arg(&path).arg("--out").arg(&out));
        assert!(code == Some(0) && text.contains("taken as even"), "{text}");
        let [logged, predicted] = [&path, &out].map(|file| read_columns(file, &["t"]).expect("columns"));
        assert_eq!(logged, predicted);
    }
}

/// Samples at uneven instants with stamps that are off these: no clock mends it. With right stamps, nothing is to be said.
#[test]
fn jitter_that_cannot_be_undone_is_warned_of_in_terms_of_torque() {
    let folder = tempfile::tempdir().expect("a folder");
    let log = simulated(folder.path());
    for every in [10, 1] {
        let (found, text) = identified(&robot("dd2"), &sampled(&log, every, [0.15, 0.1], folder.path()));
        assert!(faults(&found).contains(&"time_stamps_jitter"), "{every}: {found:#}");
        assert!(text.contains("rows differ from their time stamps by"), "{text}");
        let (found, text) = identified(&robot("dd2"), &sampled(&log, every, [0.15, 0.0], folder.path()));
        assert!(
            !faults(&found).contains(&"time_stamps_jitter") && !text.contains("differ from their time stamps"),
            "{text}"
        );
        assert_eq!(found["logs"][0]["taken_as_even"], false);
    }
}

/// Measured: the rows of the UR10e come unevenly, and its stamps are right.
#[test]
fn no_measured_log_is_taken_as_even() {
    let Some(real) = shared("data/real") else { return };
    for (arm, log) in [
        ("ur10e", "ur10e_innopolis/20_02_10-30sec_12harm"),
        ("ur10e", "ur10e_innopolis/20_02_06-20sec_10harm"),
        ("ur10e", "ur10e_innopolis/20_02_19_14harm50sec"),
        ("kuka-kr300-r2500", "kuka_kr300/traj_A_10s"),
        ("staubli-tx40", "staubli_tx40/exciting_0.0-5.5s"),
    ] {
        let log = sound(arm, &real.join(format!("{log}.parquet")));
        let clocked = log.clone().by_its_positions();
        assert!(clocked.stamps.is_none() && clocked.t == log.t, "{arm}");
    }
}
