//! Rows that come right after another one.

use crate::log::Log;

/// A row is right after another one where it is less than this share of the usual step away.
const CLOSE: f64 = 0.1;

impl Log {
    /// Rows that come right after another one are taken together with it: a curve through two positions a moment apart turns their noise
    /// into speeds and accelerations that no motion has. `crowded` says how many there were.
    #[must_use]
    pub fn without_crowds(self) -> Log {
        let least = CLOSE * self.median_step_s();
        // Where each group begins.
        let mut first = vec![0];
        for (k, t) in self.t.iter().enumerate().skip(1) {
            if first.last().is_none_or(|at| t - self.t[*at] >= least) {
                first.push(k);
            }
        }
        let crowded = self.len() - first.len();
        if crowded == 0 {
            return self;
        }
        let mean = |rows: &[f64]| rows.iter().sum::<f64>() / rows.len() as f64;
        let ends = || first.iter().skip(1).copied().chain([self.len()]);
        let means = |x: &[f64]| first.iter().zip(ends()).map(|(at, end)| mean(&x[*at..end])).collect::<Vec<f64>>();
        let stamps = self.stamps.as_deref().map(means);
        Log { stamps, crowded, ..self.map(means(&self.t), |_, signal| means(signal)) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::log::{ReadOptions, read};
    use crate::write_columns;

    /// Five rows of 4000, 10 microseconds after the one before, with noise of a microradian: accelerations stay those of the motion.
    #[test]
    fn rows_right_after_another_make_no_acceleration() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("log.parquet");
        let crowd = [500, 1200, 1201, 2500, 3999];
        let mut t: Vec<f64> = (0..4000).map(|k| 0.01 * f64::from(k)).collect();
        for k in crowd {
            t[k] = t[k - 1] + 1e-5;
        }
        let q: Vec<f64> = t.iter().enumerate().map(|(k, t)| t.sin() + if k % 2 == 0 { 1e-6 } else { -1e-6 }).collect();
        write_columns(&path, &[("t".to_owned(), &t[..]), ("q1".to_owned(), &q[..])]).expect("written");
        let log = read(&path, &ReadOptions::new(1)).expect("a log");
        let fastest = |log: &Log| {
            let (grid, _) = log.resample(0.01).expect("a grid");
            grid.q[0].windows(3).map(|w| (w[2] - 2.0 * w[1] + w[0]).abs() / 1e-4).fold(0.0, f64::max)
        };
        assert!(fastest(&log) > 3.0, "{}", fastest(&log));
        let log = log.without_crowds();
        assert_eq!((log.crowded, log.len()), (5, 3995));
        assert!(fastest(&log) < 1.1, "{}", fastest(&log));
        let t = log.t.clone();
        assert_eq!(log.without_crowds().t, t, "nothing more to do");
    }
}
