//! Single readings that stand while the joint moves: samples that a source or a bus lost and the logger repeated.
//!
//! A stair-case repeats as a rule ([`crate::Stairs`]); these are rare, so most differences are sound and the few that are not are worth
//! as much as an acceleration of some hundred rad/s².

use std::ops::Range;

use rayon::prelude::*;

use crate::log::Log;
use crate::stairs::{quantum, runs};

/// Rows to either side that say how fast the joint moves.
const AROUND: usize = 3;
/// It moves by more than this many steps of its readings, and deviations of their noise, a row.
const STEPS_A_ROW: f64 = 4.0;
/// The way over a reading that was held is that of its rows at the speed around, within this factor.
const ALIKE: f64 = 2.0;
/// Held for longer than this \[s\], a curve through the readings around says little of the motion between: the rows are left out.
const LONGEST_DRAWN_S: f64 = 0.021;
/// Fewer rows than this in a log are not worth a word.
const FEW: usize = 3;

/// Readings of one joint's position that stood while it moved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Holds {
    /// Rows that repeat the one before.
    pub rows: usize,
    /// How many times.
    pub times: usize,
    /// Rows of the longest.
    pub longest: usize,
    /// The first.
    pub first: usize,
    /// Rows of those that are too long to be drawn anew.
    pub left_out: usize,
}

impl Log {
    /// The log with positions that stood for some rows while the joint moved drawn through the rows beside, and every signal of the joint
    /// that is held in the same rows with them; none where no position did for as long as `least_s` \[s\]. Rows that stood for too long are added to `left_out`
    /// (ascending: rows that are not to be used).
    pub fn without_holds(&self, left_out: &mut Vec<usize>, least_s: f64) -> Option<(Log, Vec<Option<Holds>>)> {
        let least = (least_s / self.median_step_s()).floor() as usize + 1;
        let found: Vec<Vec<Range<usize>>> = self.q.par_iter().map(|q| holds(q, least)).collect();
        if found.iter().all(Vec::is_empty) {
            return None;
        }
        let given = left_out.clone();
        let mut log = self.clone();
        let mut said = Vec::with_capacity(found.len());
        for (j, held) in found.into_iter().enumerate() {
            let Some(first) = held.first().map(|run| run.start) else {
                said.push(None);
                continue;
            };
            let (short, long): (Vec<_>, Vec<_>) =
                held.iter().cloned().partition(|run| self.t[run.end] - self.t[run.start] <= LONGEST_DRAWN_S);
            let gone: Vec<usize> = long.iter().flat_map(|run| run.start + 1..run.end).collect();
            let repeats = |run: &Range<usize>| run.len() - 1;
            said.push(Some(Holds {
                rows: held.iter().map(repeats).sum(),
                times: held.len(),
                longest: held.iter().map(repeats).max().unwrap_or(0),
                first,
                left_out: gone.len(),
            }));
            left_out.extend(gone);
            log.draw(j, &short, &given);
        }
        left_out.sort_unstable();
        left_out.dedup();
        Some((log, said))
    }
}

/// Runs of equal readings that the joint passed through: it moves before and behind, and the way over them is theirs.
fn holds(q: &[f64], rows: usize) -> Vec<Range<usize>> {
    let found: Vec<Range<usize>> = runs(q, q.len()).into_iter().filter(|run| run.len() >= rows).collect();
    if found.is_empty() {
        return found;
    }
    let least = STEPS_A_ROW * quantum(q).max(noise(q));
    let held = |run: &Range<usize>| {
        if run.start < AROUND || run.end + AROUND >= q.len() {
            return false;
        }
        let per_row = |from: usize| (q[from + AROUND] - q[from]) / AROUND as f64;
        let (before, behind) = (per_row(run.start - AROUND), per_row(run.end));
        let way = (q[run.end] - q[run.start]) / run.len() as f64;
        let usual = 0.5 * (before + behind);
        before * behind > 0.0
            && before.abs().min(behind.abs()) > least
            && way / usual > 1.0 / ALIKE
            && way / usual < ALIKE
    };
    let held: Vec<Range<usize>> = found.into_iter().filter(held).collect();
    if held.iter().map(|run| run.len() - 1).sum::<usize>() < FEW { Vec::new() } else { held }
}

/// Standard deviation of white noise of most readings: the median of third differences knows nothing of those that are rare.
fn noise(q: &[f64]) -> f64 {
    /// Of |x| over its standard deviation, for a normal x; and of a third difference over that of the noise.
    const MEDIAN: f64 = 0.6745;
    const THIRD: f64 = 4.472;
    let mut sizes: Vec<f64> =
        q.windows(4).map(|w| (w[3] - 3.0 * w[2] + 3.0 * w[1] - w[0]).abs()).filter(|size| *size > 0.0).collect();
    let middle = sizes.len() / 2;
    if sizes.is_empty() { 0.0 } else { *sizes.select_nth_unstable_by(middle, f64::total_cmp).1 / MEDIAN / THIRD }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP: f64 = 1e-3;

    fn motion(k: usize) -> f64 {
        let t = STEP * k as f64;
        0.8 * (1.7 * t).sin() + 0.2 * (5.3 * t).cos()
    }

    /// A log of one joint in steps of `encoder`, with positions off by `noise` and the rows of `held` as the one before.
    fn log(encoder: f64, noise: f64, held: impl Fn(usize) -> bool) -> Log {
        let t: Vec<f64> = (0..20_000).map(|k| STEP * f64::from(k)).collect();
        let shake = |k: usize| noise * ((k as f64 * 0.754_877_666).fract() - 0.5) * 12.0_f64.sqrt();
        let mut q: Vec<f64> = (0..t.len()).map(|k| ((motion(k) + shake(k)) / encoder).round() * encoder).collect();
        let tau: Vec<f64> = t.iter().map(|t| (3.0 * t).sin()).collect();
        for k in 1..t.len() {
            if held(k) {
                q[k] = q[k - 1];
            }
        }
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("log.parquet");
        crate::write_columns(&path, &[("t", &t[..]), ("q1", &q[..]), ("tau1", &tau[..])]).expect("written");
        crate::read(&path, &crate::ReadOptions::new(1)).expect("a log")
    }

    #[test]
    fn readings_that_stand_are_drawn_and_long_ones_left_out() {
        for rows in [2, 5, 14, 20] {
            let stood = log(1e-7, 0.0, |k| k > 1000 && k % 1000 > 0 && k % 1000 < rows);
            let mut left_out = Vec::new();
            let (drawn, said) = stood.without_holds(&mut left_out, STEP).expect("holds");
            let said = said[0].expect("of the joint");
            assert!(said.longest == rows - 1 && said.left_out == 0 && left_out.is_empty(), "{said:?}");
            // But where it turns back, of which nothing is known.
            let moves = |k: &usize| {
                (motion(k + 30) - motion(*k)).abs() > 0.01 && (motion(*k) - motion(k.saturating_sub(30))).abs() > 0.01
            };
            let worst =
                |log: &Log| (0..20_000).filter(moves).map(|k| (log.q[0][k] - motion(k)).abs()).fold(0.0, f64::max);
            assert!(worst(&drawn) < 0.02 * worst(&stood), "{rows}: {} of {}", worst(&drawn), worst(&stood));
            assert_eq!(drawn.tau, stood.tau);
        }
        let stood = log(1e-7, 0.0, |k| (4001..4100).contains(&k));
        let mut left_out = vec![17];
        let (drawn, said) = stood.without_holds(&mut left_out, STEP).expect("holds");
        let rows: Vec<usize> = [17].into_iter().chain(4001..4100).collect();
        assert_eq!((left_out, said[0].expect("of the joint").left_out), (rows, 99));
        assert_eq!(drawn.q, stood.q);
    }

    /// A coarse encoder, noise in steps, standstill, and two readings in twenty seconds.
    #[test]
    fn steps_noise_and_standstill_are_no_holds() {
        for encoder in [1e-7, 1e-4, 1e-3, 5e-3] {
            for noise in [0.0, 0.3 * encoder, 3.0 * encoder, 30.0 * encoder] {
                let found = log(encoder, noise, |_| false).without_holds(&mut Vec::new(), STEP);
                assert_eq!(found.map(|(_, said)| said), None, "{encoder} {noise}");
            }
        }
        // Shorter than a sample of the robot file: what falls to the low-pass before rows are dropped.
        assert_eq!(log(1e-7, 0.0, |k| k % 100 < 3).without_holds(&mut Vec::new(), 5.0 * STEP), None);
        assert_eq!(log(1e-7, 0.0, |k| k == 500 || k == 900).without_holds(&mut Vec::new(), STEP), None);
        let mut still = log(1e-7, 0.0, |_| false);
        for q in &mut still.q {
            let stood = q[1847];
            q[1847..4000].fill(stood);
            let by = q[4000] - stood;
            q[4000..].iter_mut().for_each(|q| *q -= by);
        }
        assert_eq!(still.without_holds(&mut Vec::new(), STEP), None);
    }
}
