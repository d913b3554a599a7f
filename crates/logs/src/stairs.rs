//! Stair-case positions: a source slower than the log, whose sample stands in several rows until the next one comes.
//!
//! Differences of a stair-case are nothing for some rows and all of the motion in the next. What the model filter leaves of that in a
//! column that is linear in speed is a delay by half of a stair; in friction, which has the direction of speed, it is no motion at all.
//! So positions are drawn through the rows at which a new sample came, before anything is differentiated.

use std::ops::Range;

use rayon::prelude::*;

use crate::log::Log;
use crate::resample::repeated_share;

/// Share of the rows in motion that repeat beyond which a joint has a stair-case: of noisy readings in coarse steps some are equal.
const LEAST_SHARE: f64 = 0.08;
/// A reading that is the one before, while the joint moves by more than this many of its smallest steps a row, was held.
const STEPS_A_ROW: f64 = 4.0;
/// What sums of numbers of its size leave is no step.
const ROUNDING: f64 = 16.0 * f64::EPSILON;
/// Stairs as long as the longest but one of so many are a property of the source.
const RARE: usize = 100;
/// A signal is held with the positions if it repeats in so many of the rows in which they do.
const TOGETHER: f64 = 0.9;
/// A plan that comes less often than this \[s\] is one that stands between moves.
const SLOWEST_PLAN_S: f64 = 0.1;
/// Samples further apart than so many times those in the middle say nothing of the curve between those.
const UNEVEN: f64 = 4.0;

/// The stair-case of one joint's positions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stairs {
    /// Share of the rows in motion that repeat the one before.
    pub share: f64,
    /// Rows of a usual (median) stair, in fast motion.
    pub rows: usize,
    /// Whether torque is held in the same rows.
    pub with_torque: bool,
}

impl Log {
    /// The log with positions drawn through the rows at which a new sample came, where stairs are as long as `least_s` \[s\] and
    /// more than 8 % of the rows in motion repeat; none where no joint has such stairs. Every signal of the joint that is held in the
    /// same rows is drawn likewise. `left_out` (ascending): rows that are not to be used.
    ///
    /// Between samples it is the cubic through the two before and the two after, and a straight line where these are uneven. Rows
    /// beside an end, a hole (`hole_s` \[s\]) or a row that is not to be used, that have no sample on one side, are added to `left_out`.
    pub fn without_stairs(
        &self,
        left_out: &mut Vec<usize>,
        least_s: f64,
        hole_s: f64,
    ) -> Option<(Log, Vec<Option<Stairs>>)> {
        let step = self.median_step_s();
        let found: Vec<Option<(Stairs, Vec<Range<usize>>)>> = self
            .q
            .par_iter()
            .map(|q| {
                stairs(q).filter(|(_, longest)| *longest as f64 * step > least_s).map(|(stairs, longest)| {
                    let runs = parted(runs(q, 2 * longest), stairs.rows, longest);
                    (stairs, runs)
                })
            })
            .collect();
        if found.iter().all(Option::is_none) {
            return None;
        }
        let given = left_out.clone();
        let mut log = self.clone();
        let mut said = Vec::with_capacity(found.len());
        for (j, found) in found.into_iter().enumerate() {
            let Some((mut stairs, held)) = found else {
                said.push(None);
                continue;
            };
            left_out.extend(self.without_neighbour(&held, &given, hole_s));
            stairs.with_torque = log.draw(j, &held, &given);
            said.push(Some(stairs));
        }
        left_out.sort_unstable();
        left_out.dedup();
        Some((log, said))
    }

    /// The log with desired motion drawn through the rows at which a new one came, and the rows of a usual stair of each joint, where it is
    /// held by a slower source than the log for as long as `least_s` \[s\]; none where that of no joint is. `left_out` (ascending): rows
    /// that are not to be used.
    pub fn without_plan_stairs(&self, left_out: &[usize], least_s: f64) -> Option<(Log, Vec<Option<usize>>)> {
        let step = self.median_step_s();
        let found = |q: &Vec<f64>| {
            let held = |longest: usize| longest as f64 * step > least_s && longest as f64 * step <= SLOWEST_PLAN_S;
            let (stairs, longest) = stairs(q).filter(|(_, longest)| held(*longest))?;
            Some((stairs.rows, parted(runs(q, 2 * longest), stairs.rows, longest)))
        };
        let found: Vec<_> = self.q_des.as_ref()?.par_iter().map(found).collect();
        if found.iter().all(Option::is_none) {
            return None;
        }
        let mut log = self.clone();
        for (j, (_, held)) in found.iter().enumerate().filter_map(|(j, found)| Some((j, found.as_ref()?))) {
            for signals in [&mut log.qd_des, &mut log.qdd_des, &mut log.q_des].into_iter().flatten() {
                if is_held(&signals[j], held) {
                    signals[j] = drawn(&self.t, &signals[j], held, left_out);
                }
            }
        }
        Some((log, found.into_iter().map(|found| found.map(|(rows, _)| rows)).collect()))
    }

    /// Draws the positions of joint `j` through the rows beside those that were held, and every signal of the joint that was held with
    /// them; whether torque was. `left_out`: as for [`Self::without_stairs`].
    pub(crate) fn draw(&mut self, j: usize, held: &[Range<usize>], left_out: &[usize]) -> bool {
        let t = &self.t;
        let draw = |signal: &mut Vec<f64>| *signal = drawn(t, signal, held, left_out);
        let together =
            |signal: Option<&mut Vec<f64>>| signal.filter(|signal| is_held(signal, held)).map(draw).is_some();
        let with_torque = together(self.tau.as_mut().map(|(_, tau)| &mut tau[j]));
        for signals in [&mut self.qd, &mut self.q_des, &mut self.qd_des, &mut self.qdd_des] {
            together(signals.as_mut().map(|signals| &mut signals[j]));
        }
        together(self.q_link[j].as_mut());
        together(Some(&mut self.q[j]));
        with_torque
    }

    /// Rows of stairs at which a piece of the log begins or ends: when their samples came is not known, or what came next.
    fn without_neighbour(&self, held: &[Range<usize>], left_out: &[usize], hole_s: f64) -> Vec<usize> {
        let apart = |k: usize| {
            let used = |k: &usize| left_out.binary_search(k).is_err();
            k == 0 || k >= self.len() || !used(&k) || !used(&(k - 1)) || self.t[k] - self.t[k - 1] > hole_s
        };
        let begins = held.iter().filter(|run| apart(run.start)).flat_map(Range::clone);
        let ends = held.iter().filter(|run| apart(run.end)).flat_map(|run| run.clone().skip(1));
        begins.chain(ends).collect()
    }
}

/// Runs of equal readings, of two rows or more and of no more than `longest`.
pub(crate) fn runs(q: &[f64], longest: usize) -> Vec<Range<usize>> {
    let (mut found, mut from) = (Vec::new(), 0);
    for k in 1..=q.len() {
        if k == q.len() || q[k].to_bits() != q[from].to_bits() {
            if (2..=longest).contains(&(k - from)) {
                found.push(from..k);
            }
            from = k;
        }
    }
    found
}

/// The runs, those of two stairs or more that happen to be equal, as where a joint turns back, in their parts.
fn parted(runs: Vec<Range<usize>>, usual: usize, longest: usize) -> Vec<Range<usize>> {
    let parts = |run: Range<usize>| -> Vec<Range<usize>> {
        if run.len() > longest && run.len().is_multiple_of(usual) {
            run.step_by(usual).map(|from| from..from + usual).collect()
        } else {
            vec![run]
        }
    };
    runs.into_iter().flat_map(parts).collect()
}

/// The stairs of positions and the rows of the longest that is not rare.
fn stairs(q: &[f64]) -> Option<(Stairs, usize)> {
    let share = repeated_share(q);
    if share <= LEAST_SHARE {
        return None;
    }
    let quantum = quantum(q);
    let fast = |run: &Range<usize>| {
        run.end < q.len() && (q[run.end] - q[run.start]).abs() > STEPS_A_ROW * quantum * run.len() as f64
    };
    let mut rows: Vec<usize> = runs(q, usize::MAX).iter().filter(|run| fast(run)).map(ExactSizeIterator::len).collect();
    rows.sort_unstable();
    let longest = *rows.get(rows.len().checked_sub(1 + rows.len() / RARE)?)?;
    Some((Stairs { share, rows: rows[rows.len() / 2], with_torque: false }, longest))
}

/// Smallest step of the readings that is one; infinite where none is.
pub(crate) fn quantum(q: &[f64]) -> f64 {
    let size = q.iter().fold(0.0_f64, |m, q| m.max(q.abs()));
    let steps = q.windows(2).map(|w| (w[1] - w[0]).abs()).filter(|step| *step > ROUNDING * size);
    steps.fold(f64::INFINITY, f64::min)
}

/// Whether a signal repeats where positions do.
fn is_held(signal: &[f64], held: &[Range<usize>]) -> bool {
    let (mut all, mut same) = (0_usize, 0_usize);
    for run in held {
        all += run.len() - 1;
        same += run.clone().skip(1).filter(|k| signal[*k].to_bits() == signal[run.start].to_bits()).count();
    }
    same as f64 >= TOGETHER * all as f64
}

/// The signal with the rows after the first of every run drawn through the others.
fn drawn(t: &[f64], signal: &[f64], held: &[Range<usize>], left_out: &[usize]) -> Vec<f64> {
    let mut fresh = vec![true; signal.len()];
    for run in held {
        fresh[run.start + 1..run.end].fill(false);
    }
    for k in left_out {
        fresh[*k] = false;
    }
    let nodes: Vec<usize> = (0..signal.len()).filter(|k| fresh[*k]).collect();
    let mut result = signal.to_vec();
    for run in held {
        let after = nodes.partition_point(|k| *k <= run.start);
        // A sample that is not to be used has nothing to be drawn from.
        if after == 0 || after == nodes.len() || nodes[after - 1] != run.start || nodes[after] != run.end {
            continue;
        }
        let all = after.saturating_sub(2)..(after + 2).min(nodes.len());
        let (from, to) = (t[run.start], t[run.end]);
        let near = |k: &usize| (t[*k] - to).max(from - t[*k]) <= UNEVEN * (to - from);
        let through: Vec<usize> = nodes[all].iter().copied().filter(near).collect();
        for k in run.start + 1..run.end {
            result[k] = polynomial(t, signal, &through, t[k]);
        }
    }
    result
}

/// The polynomial through the samples `nodes` at a time (Lagrange).
fn polynomial(t: &[f64], signal: &[f64], nodes: &[usize], at: f64) -> f64 {
    let term = |i: &usize| {
        let others = nodes.iter().filter(|k| *k != i);
        signal[*i] * others.map(|k| (at - t[*k]) / (t[*i] - t[*k])).product::<f64>()
    };
    nodes.iter().map(term).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP: f64 = 1e-3;

    fn motion(k: usize) -> f64 {
        let t = STEP * k as f64;
        0.8 * (1.7 * t).sin() + 0.2 * (5.3 * t).cos()
    }

    /// A log of one joint with an encoder step, its positions and, where asked, its torque held for rows told by `held`.
    fn log(encoder: f64, with_torque: bool, held: impl Fn(usize) -> bool) -> Log {
        let t: Vec<f64> = (0..20_000).map(|k| STEP * f64::from(k)).collect();
        let mut q: Vec<f64> = (0..t.len()).map(|k| (motion(k) / encoder).round() * encoder).collect();
        let mut tau: Vec<f64> = t.iter().map(|t| (3.0 * t).sin()).collect();
        for k in 1..t.len() {
            if held(k) {
                q[k] = q[k - 1];
                tau[k] = if with_torque { tau[k - 1] } else { tau[k] };
            }
        }
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("log.parquet");
        let columns = [("t", &t[..]), ("q1", &q[..]), ("tau1", &tau[..])];
        crate::write_columns(&path, &columns).expect("written");
        crate::read(&path, &crate::ReadOptions::new(1)).expect("a log")
    }

    /// Every fourth row, every other, and one in eight by chance.
    #[test]
    fn positions_are_drawn_through_their_renewals() {
        let chance = |k: usize| (k as f64 * 0.618_033_988_75).fract() < 0.125;
        for (rows, held) in [
            (4, &(|k: usize| !k.is_multiple_of(4)) as &dyn Fn(usize) -> bool),
            (2, &|k| !k.is_multiple_of(2)),
            (2, &chance),
        ] {
            let stairs = log(1e-6, false, held);
            let mut left_out = vec![9_001];
            let (drawn, said) = stairs.without_stairs(&mut left_out, STEP, 0.1).expect("stairs");
            assert!(left_out.contains(&9_001) && left_out.len() <= 1 + 4 * rows, "{left_out:?}");
            let said = said[0].expect("of the joint");
            assert_eq!((said.rows, said.with_torque), (rows, false));
            let used = |k: &usize| left_out.binary_search(k).is_err();
            let worst =
                |log: &Log| (0..20_000).filter(used).map(|k| (log.q[0][k] - motion(k)).abs()).fold(0.0, f64::max);
            assert!(worst(&drawn) < 2e-6, "{} of {}", worst(&drawn), worst(&stairs));
            assert!(worst(&stairs) > 1e-3, "{}", worst(&stairs));
            assert_eq!(drawn.tau, stairs.tau);
        }
    }

    #[test]
    fn what_is_held_with_them_is_drawn_as_well() {
        let (drawn, said) = log(1e-6, true, |k| k % 8 != 0).without_stairs(&mut Vec::new(), STEP, 0.1).expect("stairs");
        assert!(said[0].expect("of the joint").with_torque);
        let tau = &drawn.tau.expect("torque").1[0];
        let worst = (0..19_980).map(|k| (tau[k] - (3.0 * STEP * k as f64).sin()).abs()).fold(0.0, f64::max);
        assert!(worst < 1e-6, "{worst}");
    }

    /// A plan that comes every ten rows, and one that comes with every row.
    #[test]
    fn a_plan_that_is_held_is_drawn_through_its_renewals() {
        let mut log = log(1e-6, false, |_| false);
        let exact: Vec<f64> = (0..log.t.len()).map(motion).collect();
        log.q_des = Some(vec![exact.clone()]);
        assert_eq!(log.without_plan_stairs(&[], STEP), None);
        log.q_des = Some(vec![(0..exact.len()).map(|k| exact[k / 10 * 10]).collect()]);
        let (drawn, rows) = log.without_plan_stairs(&[], STEP).expect("stairs");
        assert_eq!(rows, [Some(10)]);
        let plan = &drawn.q_des.as_ref().expect("a plan")[0];
        let worst = (0..exact.len() - 20).map(|k| (plan[k] - exact[k]).abs()).fold(0.0, f64::max);
        assert!(worst < 1e-6, "{worst}");
        assert_eq!((&drawn.q, &drawn.tau), (&log.q, &log.tau));
    }

    /// A coarse encoder stands between its steps in slow motion, an arm stands still, and a fast log is low-passed.
    #[test]
    fn steps_and_standstill_are_no_stairs() {
        for encoder in [1e-7, 1e-4, 1e-3, 5e-3] {
            assert_eq!(log(encoder, false, |_| false).without_stairs(&mut Vec::new(), STEP, 0.1), None, "{encoder}");
        }
        assert_eq!(log(1e-6, false, |k| k % 4000 > 2000).without_stairs(&mut Vec::new(), STEP, 0.1), None);
        assert_eq!(log(1e-6, false, |k| k % 2 != 0).without_stairs(&mut Vec::new(), 4.0 * STEP, 0.1), None);
    }
}
