//! Readings that no arm gives: positions that jump, angles that wrap, torques beyond the drive. Looked for in the rows as
//! they were logged, before splines and low-passes smear them over their neighbours.
//!
//! The rule of jumps is the daemon's (`docs/realtime.md`, encoder jump); the whole log being known, both sides of a step say
//! what was to be expected of it, and what is usual needs no memory.

use std::borrow::Cow;
use std::f64::consts::TAU;

use crate::dropout::LONGEST;
use crate::identifier::{DEFAULT_SPEED_LIMIT_RAD_S, LARGEST_EFFORT};

/// No drive accelerates a joint faster than this, even in a collision \[rad/s²\].
const LARGEST_ACCELERATION: f64 = 500.0;
/// Nor is a step off by more than this many times what steps usually are: encoders of any noise.
const LARGEST_CHANGE: f64 = 12.0;
/// And by this \[rad\], as in `rivet diagnose`: at the rate of a fast log the noise of sound positions is 500 rad/s², and the
/// model filter deals with it.
const LEAST_JUMP: f64 = 5e-3;
/// And by so many steps of the encoder.
const ENCODER_STEPS: f64 = 4.0;
/// Nor does it go faster than this many times its speed limit.
const FASTER: f64 = 4.0;
/// A position that was held for longer than this many times the usual stood still; how long it stood is no time for a way.
const MAX_HOLD_OVER_MEDIAN: f64 = 2.0;
/// Up to this many times as long the joint may also have gone on behind it.
const WENT_ON: f64 = 10.0;
/// A joint that went on while its position was held is not more than so many times as far as at the speed before.
const WENT_ON_AT: f64 = 2.0;
/// Steps to either side that say what a step was to be.
const AROUND: usize = 3;
/// A log of which a larger share is wrong is not made sound by leaving that out; what the rest has is usual.
pub const MOST_LEFT_OUT: f64 = 0.1;
/// Share of a normal distribution within its standard deviation times this is 1 - [`MOST_LEFT_OUT`].
const SIGMAS: f64 = 1.645;
/// Torque beyond this many times the drive's limit was not made by it, peaks and ripple included ...
const BEYOND_LIMIT: f64 = 2.0;
/// ... unless the channel is in another unit: then it is as large in most rows, which is told elsewhere.
const BEYOND_USUAL: f64 = 5.0;

/// What limits a joint's positions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reach {
    /// Speed limit \[rad/s\]; infinite where none is stated.
    pub speed: f64,
    /// Step of the encoder \[rad\].
    pub resolution: f64,
    /// Whether a whole turn is the same place.
    pub revolute: bool,
}

/// What was found in the positions of one joint.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Jumps {
    /// Rows before which the angle wrapped.
    pub wraps: Vec<usize>,
    /// Rows whose position is that of no arm, ascending.
    pub rows: Vec<usize>,
    /// Farthest jump \[rad\].
    pub farthest: f64,
}

/// One step between positions that differ.
#[derive(Clone, Copy)]
struct Step {
    /// First row with the new position.
    row: usize,
    /// Time that there was for it, less what the position was held for beyond the usual, and with it \[s\].
    seconds: f64,
    longest: f64,
    /// \[rad\]
    way: f64,
}

/// The changes of a position. One that is held says nothing about when it came: all of that time was there for the way.
fn steps(t: &[f64], q: &[f64]) -> Vec<Step> {
    let (mut steps, mut before) = (Vec::new(), 0);
    for row in 1..q.len() {
        if q[row] != q[row - 1] {
            let seconds = t[row] - t[before];
            steps.push(Step { row, seconds, longest: seconds, way: q[row] - q[row - 1] });
            before = row;
        }
    }
    let mut spans: Vec<f64> = steps.iter().map(|s| s.seconds).collect();
    let middle = spans.len() / 2;
    let usual = if spans.is_empty() {
        0.0
    } else {
        MAX_HOLD_OVER_MEDIAN * *spans.select_nth_unstable_by(middle, f64::total_cmp).1
    };
    for step in &mut steps {
        let most = usual.max(t[step.row] - t[step.row - 1]);
        step.longest = step.seconds.min(WENT_ON * most);
        step.seconds = step.seconds.min(most);
    }
    steps
}

/// Stretches of a few rows in which the torque of all joints, two at least, is exactly 0 between rows in which some joint carries torque
/// of one sign: samples that were lost and filled with zeros. `tau` is `[joint][row]` \[N m\].
#[must_use]
pub fn dropouts(tau: &[Vec<f64>]) -> Vec<std::ops::Range<usize>> {
    let rows = tau.iter().map(Vec::len).min().unwrap_or(0);
    let none = |k: usize| tau.iter().all(|tau| tau[k] == 0.0);
    let mut found = Vec::new();
    let mut k = 1;
    while tau.len() > 1 && k + 1 < rows {
        if !none(k) {
            k += 1;
            continue;
        }
        let end = (k..rows).find(|k| !none(*k)).unwrap_or(rows);
        let carried = end < rows && tau.iter().any(|tau| tau[k - 1] * tau[end] > 0.0);
        if carried && end - k <= LONGEST {
            found.push(k..end);
        }
        k = end + 1;
    }
    found
}

/// Tells the rows of `q` that jumped, and gives it without whole turns. Where a position does not come back the longer side
/// is believed.
pub fn unwrap<'a>(t: &[f64], q: &'a [f64], reach: Reach) -> (Jumps, Cow<'a, [f64]>) {
    let speed = if reach.speed.is_finite() && reach.speed > 0.0 { reach.speed } else { DEFAULT_SPEED_LIMIT_RAD_S };
    let steps = steps(t, q);
    let off = unexpected(&steps, speed);
    let least = |step: &Step| {
        let way = (LARGEST_ACCELERATION * step.seconds.powi(2)).min(FASTER * speed * step.seconds);
        way.max(ENCODER_STEPS * reach.resolution).max(LEAST_JUMP)
    };
    // What is usual only widens the limits, and most positions are sound without it.
    if steps.iter().zip(&off).all(|(step, off)| off.abs() <= least(step)) {
        return (Jumps::default(), Cow::Borrowed(q));
    }
    let usual = LARGEST_CHANGE / SIGMAS * usual(&off);
    let limit = |step: &Step| least(step).max(usual);
    let (mut found, mut jumps, mut turned) = (Jumps::default(), Vec::new(), 0.0);
    let (mut at, mut turns) = (0, Vec::new());
    for (step, off) in steps.iter().zip(&off) {
        if off.abs() <= limit(step) {
            continue;
        }
        let whole = (off / TAU).round();
        if reach.revolute && whole != 0.0 && (off - whole * TAU).abs() <= limit(step) {
            turns.push((at..step.row, turned));
            (at, turned) = (step.row, turned + whole * TAU);
            found.wraps.push(step.row);
        } else {
            jumps.push((step.row, limit(step)));
            if off.abs() > found.farthest.abs() {
                found.farthest = *off;
            }
        }
    }
    turns.push((at..q.len(), turned));
    let mut whole = q.to_vec();
    for (rows, turned) in turns {
        whole[rows].iter_mut().for_each(|q| *q -= turned);
    }
    found.rows = departed(t, &whole, &jumps, speed);
    (found, Cow::Owned(whole))
}

/// What the way of every step has beyond the one that was to be expected, by the median speed of the steps around it.
fn unexpected(steps: &[Step], speed: f64) -> Vec<f64> {
    let speeds: Vec<f64> = steps.iter().map(|s| s.way / s.seconds).collect();
    let beyond = |(step, middle): (&Step, f64)| {
        // Where jumps outnumber steps they are not what was expected.
        let middle = middle.clamp(-FASTER * speed, FASTER * speed);
        let (least, most) = (middle * step.seconds, middle * step.longest);
        step.way - step.way.clamp(least.min(most), least.max(most))
    };
    steps.iter().zip(middles(&speeds)).map(beyond).collect()
}

/// Of each number the median of those around it, [`AROUND`] to either side as far as there are so many; 0 where there is none.
fn middles(x: &[f64]) -> Vec<f64> {
    let few = |k: usize| {
        let mut around = [&x[k.saturating_sub(AROUND)..k], &x[k + 1..(k + 1 + AROUND).min(x.len())]].concat();
        around.sort_unstable_by(f64::total_cmp);
        let (upper, lower) = (around.len() / 2, around.len().saturating_sub(1) / 2);
        around.get(upper).zip(around.get(lower)).map_or(0.0, |(a, b)| 0.5 * (a + b))
    };
    let begin = (0..x.len()).take(AROUND).map(few);
    let inner = x.windows(2 * AROUND + 1).map(|w| middle_of_six([w[0], w[1], w[2]], [w[4], w[5], w[6]]));
    let end = (x.len().saturating_sub(AROUND).max(AROUND)..x.len()).map(few);
    begin.chain(inner).chain(end).collect()
}

/// Median of two triples together, without branches: the k-th of both is the least of what is at least the i-th of one and the
/// (k − i)-th of the other, over all i.
fn middle_of_six(a: [f64; 3], b: [f64; 3]) -> f64 {
    let min = |x: f64, y: f64| if x < y { x } else { y };
    let max = |x: f64, y: f64| if x < y { y } else { x };
    let sorted = |[x, y, z]: [f64; 3]| {
        let (x, y) = (min(x, y), max(x, y));
        let (y, z) = (min(y, z), max(y, z));
        [min(x, y), max(x, y), z]
    };
    let ([a, b, c], [d, e, f]) = (sorted(a), sorted(b));
    let third = min(min(c, f), min(max(b, d), max(a, e)));
    let fourth = min(max(b, e), min(max(c, d), max(a, f)));
    0.5 * (fourth + third)
}

/// What nine of ten are smaller than, in size.
fn usual(x: &[f64]) -> f64 {
    let mut sizes: Vec<f64> = x.iter().map(|x| x.abs()).collect();
    let place = ((1.0 - MOST_LEFT_OUT) * sizes.len() as f64) as usize;
    if place >= sizes.len() {
        return 0.0;
    }
    *sizes.select_nth_unstable_by(place, f64::total_cmp).1
}

/// Rows between jumps (row, limit) from which the joint could not have come to where it is believed to have been: the
/// longest stretch, and from there on either way whatever can be reached in time.
fn departed(t: &[f64], q: &[f64], jumps: &[(usize, f64)], speed: f64) -> Vec<usize> {
    let ends = jumps.iter().map(|(row, _)| *row).chain([q.len()]);
    let stretches: Vec<_> = [0].into_iter().chain(jumps.iter().map(|(row, _)| *row)).zip(ends).collect();
    let longest = (0..stretches.len()).max_by_key(|k| stretches[*k].1 - stretches[*k].0).unwrap_or(0);
    // A reading that was held while the joint went on came when it began to be: all of that time was there for the way.
    let came = |k: usize| (0..k).rev().take_while(|i| q[*i] == q[k]).last().unwrap_or(k);
    let held_before = |k: usize, limit: f64| -> Option<usize> {
        let from = came(k - 1);
        let before = (q[from] - q[from.checked_sub(AROUND)?]) / (t[from] - t[from - AROUND]);
        let way = q[k] - q[from];
        let passed = way * before > 0.0 && way.abs() <= WENT_ON_AT * before.abs() * (t[k] - t[from]) + limit;
        (from + 1 < k && passed).then_some(from)
    };
    let reached = |k: usize, other: usize, limit: f64| {
        (q[k] - q[other]).abs() <= speed * (t[k] - t[other]).abs() + limit
            || k.abs_diff(other) == 1 && held_before(k.max(other), limit).is_some()
    };
    let mut sound = vec![false; stretches.len()];
    sound[longest] = true;
    let mut last = stretches[longest].1;
    for k in longest + 1..stretches.len() {
        sound[k] = reached(stretches[k].0, last - 1, jumps[k - 1].1);
        last = if sound[k] { stretches[k].1 } else { last };
    }
    let mut first = stretches[longest].0;
    for k in (0..longest).rev() {
        sound[k] = reached(stretches[k].1 - 1, first, jumps[k].1);
        first = if sound[k] { stretches[k].0 } else { first };
    }
    let mut rows = Vec::new();
    for (k, (from, until)) in stretches.into_iter().enumerate() {
        if !sound[k] {
            rows.extend(from..until);
        } else if k > 0 && sound[k - 1] {
            // A jump between places that are both in reach: nothing may be differentiated across it, and where the first was
            // held, the joint had left it.
            rows.extend(held_before(from, jumps[k - 1].1).map_or(from, |came| came + 1)..=from);
        }
    }
    rows
}

/// Rows whose torque no drive of limit `effort` \[N m\] makes, ascending.
pub fn beyond(tau: &[f64], effort: f64) -> Vec<usize> {
    let made = if effort.is_finite() { BEYOND_LIMIT * effort } else { LARGEST_EFFORT };
    let most = made.max(BEYOND_USUAL * usual(tau));
    (0..tau.len()).filter(|k| tau[*k].abs() > most).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zeros_of_all_joints_between_torques_are_lost_samples() {
        let mut tau = vec![vec![3.0; 40], vec![-1.0; 40]];
        for rows in [5..6, 10..14, 20..26] {
            for tau in &mut tau {
                tau[rows.clone()].fill(0.0);
            }
        }
        tau[1][30] = 0.0;
        assert_eq!(dropouts(&tau), [5..6, 10..14], "six are a drive that is off, one joint may carry nothing");
        tau[0][6..40].fill(-3.0);
        tau[1][6..40].fill(1.0);
        assert!(!dropouts(&tau).contains(&(5..6)), "torque that changes its sign passes through nothing");
        assert!(dropouts(&tau[..1]).is_empty(), "one joint that carries nothing is no news");
    }

    const REACH: Reach = Reach { speed: 2.0, resolution: 1e-5, revolute: true };

    /// A joint that swings with 1.5 rad/s at most, at 125 Hz with stamps that jitter, and rests between swings.
    fn swing() -> (Vec<f64>, Vec<f64>) {
        let jitter = |k: u32| 1e-3 * (f64::from(k) * 0.618).fract();
        let t: Vec<f64> = (0..4000).map(|k| 0.008 * f64::from(k) + jitter(k)).collect();
        let rests = |t: f64| if t.sin() > 0.0 { (1.5 * t.sin()).powi(2) / 1.5 } else { 0.0 };
        let q = (0..4000).map(|k| 0.4 + (rests(0.008 * f64::from(k)) / 1e-5).round() * 1e-5).collect();
        (t, q)
    }

    fn found(change: impl Fn(usize, f64) -> f64) -> (Jumps, Vec<f64>) {
        let (t, sound) = swing();
        let q: Vec<f64> = sound.iter().enumerate().map(|(k, q)| change(k, *q)).collect();
        let (found, whole) = unwrap(&t, &q, REACH);
        (found, whole.into_owned())
    }

    #[test]
    fn a_sound_position_stays_as_it_is_held_or_not() {
        for hold in [1, 4, 12] {
            let (_, q) = swing();
            let (jumps, after) = found(|k, _| q[k / hold * hold]);
            assert_eq!(jumps, Jumps::default(), "held for {hold}");
            assert_eq!(after[100], q[100 / hold * hold]);
        }
    }

    #[test]
    fn the_noise_of_a_fast_log_is_no_jump() {
        let t: Vec<f64> = (0..5000).map(|k| 2e-4 * f64::from(k)).collect();
        let rare = |k: u32| if k % 997 == 5 { 3e-4 } else { 0.0 };
        let q: Vec<f64> = (0..5000).map(|k| (2e-4 * f64::from(k)).sin() + rare(k)).collect();
        assert_eq!(unwrap(&t, &q, REACH), (Jumps::default(), Cow::Borrowed(&q[..])));
    }

    #[test]
    fn the_middle_of_neighbours_is_their_median() {
        let x: Vec<f64> = (0..200).map(|k| f64::from(k * 7919 % 31)).collect();
        for length in [0, 1, 2, 5, 6, 7, 8, 200] {
            let found = middles(&x[..length]);
            assert_eq!(found.len(), length);
            for (k, found) in found.into_iter().enumerate() {
                let around = k.saturating_sub(AROUND)..(k + AROUND + 1).min(length);
                let mut sorted: Vec<f64> = around.filter(|at| *at != k).map(|at| x[at]).collect();
                sorted.sort_by(f64::total_cmp);
                let (upper, lower) = (sorted.get(sorted.len() / 2), sorted.get(sorted.len().saturating_sub(1) / 2));
                assert_eq!(found, upper.zip(lower).map_or(0.0, |(a, b)| 0.5 * (a + b)), "{k} of {length}");
            }
        }
    }

    #[test]
    fn a_whole_turn_is_taken_back_and_nothing_left_out() {
        let (jumps, q) = found(|k, q| if k < 700 { q } else { q + TAU });
        assert_eq!((&jumps.wraps[..], &jumps.rows[..]), (&[700][..], &[][..]));
        assert!(q.iter().zip(swing().1).all(|(a, b)| (a - b).abs() < 1e-12));
        // A slide that goes by 2 pi m has jumped.
        let (t, mut q) = swing();
        q[700] += TAU;
        assert_eq!(unwrap(&t, &q, Reach { revolute: false, ..REACH }).0.rows, [700]);
    }

    #[test]
    fn rows_that_departed_are_told_moving_or_standing() {
        // 100: in motion; 600: at rest.
        for at in [0, 100, 600, 3999] {
            assert_eq!(found(|k, q| if k == at { q + 1.0 } else { q }).0.rows, [at]);
        }
        assert_eq!(found(|k, q| if [100, 102, 104].contains(&k) { q - 0.4 } else { q }).0.rows, [100, 102, 104]);
        // Dropped to zero for a while in which the joint goes on.
        let (jumps, _) = found(|k, q| if (900..1020).contains(&k) { 0.0 } else { q });
        assert_eq!(jumps.rows, (900..1020).collect::<Vec<_>>());
        // Held for a tenth of a second while the joint goes on: nothing behind it is wrong.
        let (_, q) = swing();
        assert_eq!(
            found(|k, at| if (100..200).contains(&k) { q[100] } else { at }).0.rows,
            (101..=200).collect::<Vec<_>>()
        );
        // Referenced anew: the longer side is believed.
        assert_eq!(found(|k, q| if k < 300 { q + 0.3 } else { q }).0.rows, (0..300).collect::<Vec<_>>());
        assert_eq!(found(|k, q| if k < 300 { q } else { q + 0.3 }).0.rows, (0..300).collect::<Vec<_>>());
    }

    #[test]
    fn a_torque_beyond_the_drive_is_told_from_another_unit() {
        let mut tau: Vec<f64> = (0..1000).map(|k| 30.0 * (0.01 * f64::from(k)).sin()).collect();
        assert_eq!(beyond(&tau, 50.0), [] as [usize; 0]);
        let large: Vec<f64> = tau.iter().map(|t| 1e3 * t).collect();
        assert_eq!(beyond(&large, 50.0), [] as [usize; 0]);
        tau[7] = -1e4;
        tau[400] = 400.0;
        assert_eq!(beyond(&tau, 50.0), [7, 400]);
        assert_eq!(beyond(&tau, f64::INFINITY), [] as [usize; 0]);
    }
}
