//! Samples that two logs have in common: a run that was looked at is not kept sealed.

use std::collections::HashMap;
use std::hash::{DefaultHasher, Hash, Hasher};

use crate::log::Log;

/// Rows in motion, one after the other in both logs, that no two recordings have in common by accident: counts of coarse encoders
/// may meet now and then.
const LEAST_ROWS: usize = 20;
/// So long at least \[s\]: simulators that begin with the same random numbers at the same place write a few equal samples.
const LEAST_S: f64 = 0.25;
/// Rows that may be left out between two of them, as in a copy at a lower rate.
const SKIPPED: usize = 20;

impl Log {
    /// How long \[s\] this log holds the very samples of another one: the same positions and torque in motion, wherever they stand in it.
    pub fn shared_s(&self, other: &Log) -> f64 {
        let mut places: HashMap<u64, usize> = HashMap::new();
        for (row, print) in other.prints() {
            places.entry(print).or_insert(row);
        }
        let (mut shared, mut stretch) = (0.0, Stretch::default());
        for (row, print) in self.prints() {
            let place = places.get(&print).copied();
            if let Some(place) = place.filter(|place| stretch.goes_on(row, *place)) {
                stretch = Stretch { rows: stretch.rows + 1, last: [row, place], missed: 0, ..stretch };
                continue;
            }
            if place.is_none() && stretch.rows > 0 && stretch.missed < SKIPPED {
                stretch.missed += 1;
                continue;
            }
            shared += stretch.seconds(self);
            stretch = place.map_or_else(Stretch::default, |place| Stretch {
                rows: 1,
                first: row,
                last: [row, place],
                missed: 0,
            });
        }
        shared + stretch.seconds(self)
    }

    /// Rows in motion and a number that stands for their positions and torque, to single precision: a copy may have no more.
    fn prints(&self) -> impl Iterator<Item = (usize, u64)> {
        let torque = self.tau.as_ref().map(|(_, tau)| tau).or(self.current.as_ref());
        let moves = |k: &usize| self.q.iter().any(|q| q[*k] as f32 != q[*k - 1] as f32);
        (1..self.len()).filter(moves).map(move |k| {
            let mut hasher = DefaultHasher::new();
            for signal in self.q.iter().chain(torque.into_iter().flatten()) {
                (signal[k] as f32).to_bits().hash(&mut hasher);
            }
            (k, hasher.finish())
        })
    }
}

/// Rows that follow each other in both logs.
#[derive(Clone, Copy, Default)]
struct Stretch {
    rows: usize,
    first: usize,
    /// The last row here and there.
    last: [usize; 2],
    /// Rows here since then that are not there.
    missed: usize,
}

impl Stretch {
    /// Rows at which nothing moves stand between those that are looked at, in both logs as many.
    fn goes_on(&self, row: usize, place: usize) -> bool {
        let [here, there] = self.last;
        self.rows > 0 && place > there && (place - there).abs_diff(row - here) <= SKIPPED
    }

    fn seconds(&self, log: &Log) -> f64 {
        if self.rows < LEAST_ROWS {
            return 0.0;
        }
        let seconds = log.t[self.last[0]] - log.t[self.first - 1];
        if seconds < LEAST_S { 0.0 } else { seconds }
    }
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;
    use crate::log::TorqueSource;

    /// Rows of a motion with a noisy torque; `seed`: of its noise.
    fn log(rows: std::ops::Range<u32>, every: usize, seed: f64) -> Log {
        let of =
            |f: &dyn Fn(f64) -> f64| rows.clone().step_by(every).map(|k| f(1e-3 * f64::from(k))).collect::<Vec<f64>>();
        // A second of rest at 2 s.
        let q = |t: f64| if (2.0..3.0).contains(&t) { 2.0_f64.sin() } else { t.sin() };
        Log {
            path: PathBuf::from("log"),
            t: of(&|t| 7.0 + t),
            q: vec![of(&q)],
            tau: Some((TorqueSource::Logged, vec![of(&|t| t.cos() + (seed * t).sin())])),
            qd: None,
            q_des: None,
            qd_des: None,
            qdd_des: None,
            temperature: None,
            current: None,
            q_link: Vec::new(),
            unused: Vec::new(),
            stamps: None,
            off_s: 0.0,
            crowded: 0,
            damaged_t: Vec::new(),
            notes: Vec::new(),
        }
    }

    #[test]
    fn cuts_of_one_recording_share_what_they_share() {
        let (first, second) = (log(0..6000, 1, 7919.0), log(4000..9000, 1, 7919.0));
        assert!((first.shared_s(&second) - 2.0).abs() < 0.01, "{}", first.shared_s(&second));
        assert!((second.shared_s(&first) - 2.0).abs() < 0.01);
        assert!((first.shared_s(&first) - 6.0).abs() < 0.01, "with its rest");
        let copy = log(0..6000, 5, 7919.0);
        // The rest has other rows there.
        assert!((copy.shared_s(&first) - 5.0).abs() < 0.05, "a copy at a lower rate: {}", copy.shared_s(&first));
        assert!((first.shared_s(&copy) - 5.0).abs() < 0.05, "the same the other way round: {}", first.shared_s(&copy));
        assert!(first.shared_s(&log(6000..9000, 1, 7919.0)) == 0.0, "parts that follow each other");
        assert!(first.shared_s(&log(0..6000, 1, 7907.0)) == 0.0, "the same motion, driven twice");
        assert!(first.shared_s(&log(5900..9000, 1, 7919.0)) == 0.0, "a tenth of a second is no recording");
    }
}
