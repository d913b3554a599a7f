//! Torque that stands bit for bit while its joint moves: a channel that died, or whose last value was repeated.
//!
//! Torque in coarse steps stands as well, and so does dry friction at an even speed. So the joint has to change its speed, torque has to begin
//! or to end standing with a jump, and the log has to show that it hardly ever stands while the joint moves.

use std::ops::Range;

use rayon::prelude::*;

use crate::log::Log;
use crate::stairs::{quantum, runs};

/// Shorter stands are not looked at \[s\], nor those of fewer rows.
const LEAST_S: f64 = 0.25;
const LEAST_ROWS: usize = 8;
/// A stand is so many times as long as torque stands otherwise, which is no more than this \[s\], in all but a few stretches of motion.
const LONGER: f64 = 8.0;
const USUAL_S: f64 = 0.1;
const FEW: f64 = 0.05;
/// Otherwise: in so many stretches of `LEAST_S` in which the joint moves, at the least.
const STRETCHES: usize = 8;
/// Where it moves in fewer, a stand of this length is one that needs no other to be held against \[s\].
const LONG_S: f64 = 2.0;
/// A joint moves that runs through so much \[rad\] and so many steps of its readings.
const MOVES: f64 = 5e-3;
const STEPS: f64 = 20.0;
/// Torque in steps stands where it turns, and where it lingers. What is dead or frozen begins or ends with a jump of more than so many
/// steps, or at an even speed of the joint with one of so many times its usual change from row to row; at the end of a log it stands for longer than this \[s\].
const JUMPS: f64 = 4.0;
const CUT_OFF_S: f64 = 1.0;
/// Its speed changes by this share of the largest, over so many parts of a stand.
const CHANGES: f64 = 0.25;
const PARTS: usize = 8;

/// Stands of one joint's torque.
#[derive(Clone, Debug, PartialEq)]
pub struct Frozen {
    /// Rows of each.
    pub rows: Vec<Range<usize>>,
    /// For how long torque stands otherwise at most, but for a few stretches \[s\]; none where the joint hardly moves beside them.
    pub usual_s: Option<f64>,
}

impl Log {
    /// Stretches in which the torque of a joint is one number while the joint moves, per joint; none where there are none. Torque at its
    /// largest or smallest value is at a limit, and not meant.
    pub fn frozen_torque(&self) -> Vec<Option<Frozen>> {
        let Some((_, tau)) = &self.tau else { return vec![None; self.joints()] };
        tau.par_iter().zip(&self.q).map(|(tau, q)| frozen(&self.t, q, tau)).collect()
    }
}

fn frozen(t: &[f64], q: &[f64], tau: &[f64]) -> Option<Frozen> {
    let held = runs(tau, tau.len());
    let seconds = |run: &Range<usize>| t[run.end.min(t.len() - 1)] - t[run.start];
    let long = |run: &Range<usize>| run.len() >= LEAST_ROWS && seconds(run) >= LEAST_S;
    if !held.iter().any(long) {
        return None;
    }
    let way = MOVES.max(STEPS * quantum(q));
    let ends = tau.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(*x), h.max(*x)));
    let at_limit = |x: f64| x != 0.0 && (x <= ends.0 || x >= ends.1);
    let mut changes: Vec<f64> = tau.windows(2).map(|w| (w[1] - w[0]).abs()).filter(|by| *by > 0.0).collect();
    if changes.is_empty() {
        return None;
    }
    let middle = changes.len() / 2;
    let usual = *changes.select_nth_unstable_by(middle, f64::total_cmp).1;
    let step = quantum(tau);
    // What comes behind the end of the log is not known.
    let cut_off = |run: &Range<usize>| run.end == tau.len() && seconds(run) > CUT_OFF_S;
    let mut stands: Vec<Range<usize>> = held.iter().filter(|run| long(run)).cloned().collect();
    let usual_s = usual_s(t, q, way, &held, &stands);
    let least_s = match usual_s {
        Usual::Known(usual_s) => LONGER * usual_s,
        Usual::HardlyMoves => LONG_S,
        Usual::Coarse => return None,
    };
    // Where a joint hardly moves elsewhere and its torque changes by single steps it may well stand until the end.
    let lingers = matches!(usual_s, Usual::HardlyMoves) && usual < 1.5 * step;
    let jump = |run: &Range<usize>| {
        let from = |k: usize| tau.get(k).map_or(0.0, |beside| (beside - tau[run.start]).abs());
        if cut_off(run) && !lingers { f64::INFINITY } else { from(run.start.wrapping_sub(1)).max(from(run.end)) }
    };
    stands.retain(|run| seconds(run) > least_s && !at_limit(tau[run.start]) && span(&q[run.clone()]) > way);
    let (surely, perhaps): (Vec<_>, Vec<_>) =
        stands.into_iter().partition(|run| changes_speed(t, q, run) && jump(run) > JUMPS * step);
    let mut rows = surely;
    if rows.is_empty() {
        return None;
    }
    rows.extend(perhaps.into_iter().filter(|run| jump(run) > JUMPS * usual));
    rows.sort_unstable_by_key(|run| run.start);
    let usual_s = if let Usual::Known(usual_s) = usual_s { Some(usual_s) } else { None };
    Some(Frozen { rows, usual_s })
}

/// How a torque stands in motion where it is neither dead nor frozen.
enum Usual {
    /// For so long at most, but for a few stretches \[s\].
    Known(f64),
    /// The joint moves in too few stretches beside.
    HardlyMoves,
    /// So long that a stand says nothing.
    Coarse,
}

/// How long a torque stands in motion, beside the long stands `but`: the longest in each stretch, and the longest of those but a few.
fn usual_s(t: &[f64], q: &[f64], way: f64, held: &[Range<usize>], but: &[Range<usize>]) -> Usual {
    let (mut longest, mut from) = (Vec::new(), 0);
    let (mut held, mut but) = (held.iter().peekable(), but.iter().peekable());
    while from < t.len() {
        let end = from + t[from..].partition_point(|at| *at < t[from] + LEAST_S);
        while but.next_if(|run| run.end <= from).is_some() {}
        while held.next_if(|run| run.end <= from).is_some() {}
        if but.peek().is_none_or(|run| run.start >= end) && end < t.len() && span(&q[from..end]) > way {
            let own = held.clone().take_while(|run| run.start < end);
            let within = own.map(|run| t[run.end.min(t.len() - 1)] - t[run.start]);
            longest.push(within.fold((t[end] - t[from]) / (end - from) as f64, f64::max));
        }
        from = end;
    }
    longest.sort_unstable_by(f64::total_cmp);
    let few = (FEW * longest.len() as f64) as usize;
    match longest.len().checked_sub(1 + few).map(|at| longest[at]) {
        Some(usual_s) if usual_s > USUAL_S => Usual::Coarse,
        Some(usual_s) if longest.len() >= STRETCHES => Usual::Known(usual_s),
        _ => Usual::HardlyMoves,
    }
}

fn span(q: &[f64]) -> f64 {
    let (low, high) = q.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), q| (l.min(*q), h.max(*q)));
    high - low
}

/// Whether the speeds over parts of a stand are not one.
fn changes_speed(t: &[f64], q: &[f64], run: &Range<usize>) -> bool {
    let at = |part: usize| run.start + part * (run.len() - 1) / PARTS;
    let speed = |part: usize| {
        let (a, b) = (at(part), at(part + 1));
        if b > a { (q[b] - q[a]) / (t[b] - t[a]) } else { 0.0 }
    };
    let speeds: Vec<f64> = (0..PARTS).map(speed).collect();
    span(&speeds) > CHANGES * speeds.iter().fold(0.0_f64, |m, v| m.max(v.abs()))
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP: f64 = 1e-3;

    fn times() -> Vec<f64> {
        (0..20_000).map(|k| STEP * f64::from(k)).collect()
    }

    fn positions() -> Vec<f64> {
        times().iter().map(|t| ((0.8 * (1.7 * t).sin() + 0.2 * (5.3 * t).cos()) / 1e-5).round() * 1e-5).collect()
    }

    /// Torque in steps of `step`, with noise of two milli-newton-metres.
    fn torque(step: f64) -> Vec<f64> {
        let noise = |k: usize| 4e-3 * ((k as f64 * 0.754_877_666).fract() - 0.5);
        let of = |(k, t): (usize, &f64)| ((10.0 * (1.7 * t).sin() + noise(k)) / step).round() * step;
        times().iter().enumerate().map(of).collect()
    }

    #[test]
    fn torque_that_died_or_was_repeated_is_told() {
        for (from, to) in [(4000, 7000), (9000, 9400), (12_000, 20_000)] {
            for zero in [false, true] {
                let mut tau = torque(1e-3);
                let value = if zero { 0.0 } else { tau[from] };
                tau[from..to].fill(value);
                let found = frozen(&times(), &positions(), &tau).expect("frozen");
                assert_eq!(found.rows.len(), 1, "{found:?}");
                let rows = &found.rows[0];
                assert!(rows.start.abs_diff(from) <= 3 && rows.end.abs_diff(to) <= 3, "{found:?}");
            }
        }
    }

    /// As soon as the log begins, so that next to nothing is left to hold it against.
    #[test]
    fn torque_that_dies_early_is_told() {
        for from in [300, 800, 1500] {
            let mut tau = torque(1e-3);
            tau[from..].fill(0.0);
            let found = frozen(&times(), &positions(), &tau).expect("frozen");
            assert!(found.rows.len() == 1 && found.rows[0].start.abs_diff(from) <= 3, "{found:?}");
        }
    }

    #[test]
    fn many_short_stands_are_told_those_at_an_even_speed_included() {
        let mut tau = torque(1e-3);
        for from in (700..19_000).step_by(1500) {
            let value = tau[from];
            tau[from..from + 400].fill(value);
        }
        let found = frozen(&times(), &positions(), &tau).expect("frozen");
        assert!(found.rows.len() >= 11, "{found:?}");
    }

    /// A joint that hardly moves but at the end, whose torque changes by single steps: that it lingers there is no fault. Of a torque of fine
    /// steps it would be.
    #[test]
    fn coarse_torque_may_linger_until_the_end() {
        let t = times();
        let q: Vec<f64> = t.iter().map(|t| if *t < 16.0 { 0.0 } else { 0.1 * (t - 16.0).powi(2) }).collect();
        let torque = |step: f64| -> Vec<f64> {
            t.iter().map(|t| if *t < 16.0 { step * (3.0 * (0.5 * t).sin() / step).round() } else { 1.0 }).collect()
        };
        assert_eq!(frozen(&t, &q, &torque(1.0)), None);
        let mut fine = torque(1e-3);
        fine[..16_000].iter_mut().enumerate().for_each(|(k, tau)| *tau += 0.005 * (k % 7) as f64);
        assert!(frozen(&t, &q, &fine).is_some());
    }

    /// Coarse steps, dry friction at an even speed, standstill, a torque at its limit, and one that was never there.
    #[test]
    fn torque_that_may_stand_is_not() {
        let (t, q) = (times(), positions());
        for step in [1e-4, 1e-3, 1e-2, 0.1, 1.0, 5.0, 20.0] {
            assert_eq!(frozen(&t, &q, &torque(step)), None, "{step}");
        }
        // Turning points of a slow torque, at several heights.
        for step in [0.02, 0.1, 0.3, 1.0, 3.0] {
            let slow = t.iter().map(|t| 30.0 * (0.9 * t).sin() + 17.0 * (2.3 * t).cos() + 8.0 * (0.31 * t).sin());
            let coarse: Vec<f64> = slow.map(|tau| (tau / step).round() * step + 0.0).collect();
            assert_eq!(frozen(&t, &q, &coarse), None, "{step}");
        }
        // Torque that lingers in passing.
        for step in [0.01, 0.03, 0.1, 0.3] {
            let coarse: Vec<f64> =
                t.iter().map(|t| (50.0 * (0.9 * t).sin().powi(5) / step).round() * step + 0.0).collect();
            assert_eq!(frozen(&t, &q, &coarse), None, "{step}");
        }
        let lively = |t: &f64| 3.0 * (20.0 * t).sin() * ((t - 10.0) / 0.3).powi(6).min(1.0);
        let coarse: Vec<f64> = t.iter().map(|t| 0.1 * (lively(t) / 0.1).round() + 0.0).collect();
        assert_eq!(frozen(&t, &q, &coarse), None);
        // There and back at an even speed: friction alone.
        let even: Vec<f64> = t.iter().map(|t| 0.3 * ((t % 8.0) - 4.0).abs()).collect();
        let friction: Vec<f64> = t.iter().map(|t| if t % 8.0 < 4.0 { -3.0 } else { 3.0 }).collect();
        assert_eq!(frozen(&t, &even, &friction), None);
        let mut still = (q.clone(), torque(1e-3));
        for signal in [&mut still.0, &mut still.1] {
            let stands = signal[5000];
            signal[5000..9000].fill(stands);
        }
        assert_eq!(frozen(&t, &still.0, &still.1), None);
        let limited: Vec<f64> = torque(1e-3).iter().map(|tau| tau.clamp(-9.0, 9.0)).collect();
        assert_eq!(frozen(&t, &q, &limited), None);
        assert_eq!(frozen(&t, &q, &vec![0.0; t.len()]), None);
        // A gear that carries nothing but for three values, as of a joint that gravity does not load.
        let three: Vec<f64> = t
            .iter()
            .map(|t| {
                if *t < 2.0 {
                    0.01
                } else if *t < 18.0 {
                    0.0
                } else {
                    -0.01
                }
            })
            .collect();
        assert_eq!(frozen(&t, &q, &three), None);
    }
}
