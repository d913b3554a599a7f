//! Whether the time of a log is that of the arm: by its own speeds, or else by the robot file's period.

use std::ops::RangeInclusive;

use rivet_config::Robot;
use rivet_logs::{ClockRate, Log};

use crate::evidence::Distrust;
use crate::runs;
use crate::table::number;

/// What the log's own speeds say.
pub(crate) const OFF_NAME: &str = "clock_off";
/// Rows that come nearly, but not quite, as often as the robot file's samples.
const NEARLY: RangeInclusive<f64> = 2e-3..=0.1;
/// Rows of a counted clock are as far apart as the usual ones, within this share; what was read from a clock jitters.
const EVEN: f64 = 1e-4;
/// But for so large a share of them: rows that are missing.
const ODD: f64 = 0.02;

/// That the time of a log runs fast or slow.
pub(crate) fn off(robot: &Robot, log: &Log) -> Option<Distrust> {
    let (name, text) = match log.clock_rate() {
        Some(rate) if rate.is_off() => (OFF_NAME, by_speeds(&rate)),
        Some(rate) if rate.is_right() => return None,
        _ => ("period_off", by_period(log, robot.config.sample_period_s)?),
    };
    Some(Distrust { log: Some(runs::short_name(&log.path)), joint: None, name, text })
}

fn by_speeds(rate: &ClockRate) -> String {
    let ClockRate { factor, std, joints, columns: [q, qd], .. } = rate;
    let digits = |x: f64| format!("{x:.4}");
    format!(
        "the clock is off: by column t {q} changes {factor:.5} (+- {}) times as fast as {qd}, on {}: t runs {} % {}, \
         unless the speeds are wrong. {} Nothing is corrected: scale t by {}, or log the arm's own clock",
        number(std.max(1e-6), 1),
        if *joints == 1 { "the joint that moves".to_owned() } else { format!("all {joints} joints that move") },
        number(100.0 * (1.0 / factor - 1.0).abs(), 2),
        if *factor < 1.0 { "fast" } else { "slow" },
        meaning(*factor),
        digits(*factor)
    )
}

/// What a clock that makes speeds `factor` times as large does to what is identified.
fn meaning(factor: f64) -> String {
    format!(
        "Velocities are {:.4} and accelerations {:.4} times the true ones, so inertias are estimated {:.4} and \
         viscous friction {:.4} times as large; standard deviations do not include that.",
        factor,
        factor.powi(2),
        factor.powi(-2),
        factor.recip()
    )
}

/// Of a log without speeds that tell it, whose rows come evenly and nearly as often as the robot file's samples.
fn by_period(log: &Log, period_s: f64) -> Option<String> {
    let step_s = log.median_step_s();
    let factor = period_s / step_s;
    let t = log.logged_t();
    let odd = t.windows(2).filter(|t| (t[1] - t[0] - step_s).abs() > EVEN * step_s).count();
    let nearly = NEARLY.contains(&(factor - 1.0).abs()) && odd as f64 <= ODD * t.len() as f64;
    nearly.then(|| {
        format!(
            "rows come evenly every {} ms, the samples of the robot file every {} ms, and the log has no speeds to \
             decide which is right: if the arm kept the period of the file, the clock of column t is off. {} If the \
             rows do come at that rate, nothing is wrong",
            number(1e3 * step_s, 5),
            number(1e3 * period_s, 5),
            meaning(factor)
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ten seconds of rows so far apart \[s\].
    fn log(step_s: f64, jitter_s: f64) -> Log {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("log.csv");
        let row = |k: u32| {
            let t = step_s * f64::from(k) + jitter_s * f64::from(k).sin();
            format!("{t},{},{}\n", t.sin(), t.cos())
        };
        std::fs::write(&path, (0..1000).map(row).fold("t,q1,tau1\n".to_owned(), |text, row| text + &row))
            .expect("written");
        rivet_logs::read(&path, &rivet_logs::ReadOptions::new(1)).expect("a log")
    }

    #[test]
    fn a_period_that_is_nearly_the_one_of_the_file_is_told() {
        for step_s in [0.0099, 0.01005, 0.0101, 0.0105] {
            let text = by_period(&log(step_s, 0.0), 0.01).expect("nearly");
            assert!(text.contains(&format!("every {} ms", number(1e3 * step_s, 5))), "{text}");
        }
        for step_s in [0.01, 0.010_001, 0.005, 0.02, 0.012] {
            assert_eq!(by_period(&log(step_s, 0.0), 0.01), None, "{step_s}");
        }
        assert_eq!(by_period(&log(0.0101, 1e-5), 0.01), None, "a clock that was read");
    }
}
