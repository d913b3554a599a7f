//! Setpoints whose velocities or accelerations are not those of their positions.
//!
//! A robot controller that plans positions alone leaves the rest 0, or a planner forgets the accelerations. Instruments of such a plan
//! say that nothing accelerates, and what is found with them is wrong by far more than its deviations. Positions are what the arm is
//! told to follow, so they are believed: a joint whose Δq̇ or Δq over most windows is not the integral of what is given has its derivatives
//! made of its positions, as those of the measured motion are.

use crate::report::Setpoint;

/// Lengths of the windows \[s\]: long beside the rows for which a slow planner holds its setpoint; two, for a motion may repeat with one.
const WINDOWS_S: [f64; 2] = [0.2, 0.13];
/// Share of the squared way that may be missed: a plan that is held misses a part, one of zeros all of it.
const MISSED: f64 = 0.5;
/// Squared way from which on a window says anything: 2 mrad, 20 mrad/s.
const LEAST: [f64; 2] = [4e-6, 4e-4];
/// What a window keeps of the counts before it.
const KEEPS: f64 = 0.95;
/// Windows that must have said something, and the share of them that missed the way: a jump is one window.
const MIN_SIGNIFICANT_WINDOWS: f64 = 1.9;
const BROKEN: f64 = 0.5;

/// Two integrals of one joint beside what they should give over a window: velocity beside position, acceleration beside velocity.
#[derive(Clone, Copy, Debug, Default)]
struct Track {
    /// At the start of the window, and of the last sample: position, velocity, acceleration.
    first: [f64; 3],
    last: [f64; 3],
    integral: [f64; 2],
}

impl Track {
    fn begin(&mut self, now: [f64; 3]) {
        (self.first, self.last, self.integral) = (now, now, [0.0; 2]);
    }

    fn step(&mut self, now: [f64; 3], period: f64) {
        for k in 0..2 {
            self.integral[k] += 0.5 * period * (self.last[k + 1] + now[k + 1]);
        }
        self.last = now;
    }

    /// Ends a window; of position and velocity, whether it said anything and whether the way was missed.
    fn close(&mut self) -> [[bool; 2]; 2] {
        let judge_order = |k: usize| {
            let way = self.last[k] - self.first[k];
            let off = (way - self.integral[k]).powi(2);
            let is_significant = off.max(way * way) > LEAST[k];
            [is_significant, is_significant && off > MISSED * way * way]
        };
        let orders = [judge_order(0), judge_order(1)];
        self.begin(self.last);
        orders
    }
}

/// What the windows of one joint said: how many said anything of position and velocity, and how many of these missed the way.
#[derive(Clone, Copy, Debug, Default)]
struct Counts {
    told: [f64; 2],
    missed: [f64; 2],
}

impl Counts {
    /// Takes in a window, keeping a share of those before it.
    fn add(&mut self, said: [[bool; 2]; 2], keeps: f64) {
        for (k, [told, missed]) in said.into_iter().enumerate() {
            // What says nothing leaves things as they are.
            if told {
                self.told[k] = keeps * self.told[k] + 1.0;
                self.missed[k] = keeps * self.missed[k] + f64::from(u8::from(missed));
            }
        }
    }

    fn is_broken(&self) -> bool {
        (0..2).any(|k| self.told[k] >= MIN_SIGNIFICANT_WINDOWS && self.missed[k] > BROKEN * self.told[k])
    }
}

/// Whether the velocities or accelerations of a joint's whole plan are not those of its positions.
pub(crate) fn is_broken([q, qd, qdd]: [&[f64]; 3], period: f64) -> bool {
    let now = |k: usize| [q[k], qd[k], qdd[k]];
    let mut counts = Counts::default();
    for window in windows(period) {
        let mut track = Track::default();
        for k in 0..q.len() {
            if k == 0 {
                track.begin(now(k));
            } else {
                track.step(now(k), period);
            }
            if k > 0 && k % window == 0 {
                counts.add(track.close(), 1.0);
            }
        }
    }
    counts.is_broken()
}

fn windows(period: f64) -> [usize; 2] {
    WINDOWS_S.map(|seconds| (seconds / period).round().max(2.0) as usize)
}

/// Looks at the setpoints of all joints.
#[derive(Clone, Debug)]
pub(crate) struct Plan {
    period: f64,
    windows: [usize; 2],
    /// Samples of either window so far.
    samples: [usize; 2],
    tracks: [Vec<Track>; 2],
    counts: Vec<Counts>,
    broken: Vec<bool>,
    /// Whether there was a setpoint at the last sample.
    begun: bool,
}

impl Plan {
    pub(crate) fn new(dof: usize, period: f64) -> Plan {
        let tracks = vec![Track::default(); dof];
        Plan {
            period,
            windows: windows(period),
            samples: [0; 2],
            tracks: [tracks.clone(), tracks],
            counts: vec![Counts::default(); dof],
            broken: vec![false; dof],
            begun: false,
        }
    }

    /// Takes in the setpoint of a sample; without one the windows begin anew.
    pub(crate) fn take(&mut self, setpoint: Option<Setpoint<'_>>) {
        let begun = std::mem::replace(&mut self.begun, setpoint.is_some());
        let Some(s) = setpoint else { return };
        let now = |j: usize| [s.q[j], s.qd[j], s.qdd[j]];
        for ((samples, window), tracks) in self.samples.iter_mut().zip(self.windows).zip(&mut self.tracks) {
            if !begun {
                *samples = 0;
                tracks.iter_mut().enumerate().for_each(|(j, track)| track.begin(now(j)));
                continue;
            }
            let period = self.period;
            tracks.iter_mut().enumerate().for_each(|(j, track)| track.step(now(j), period));
            *samples += 1;
            if *samples == window {
                *samples = 0;
                let joints = tracks.iter_mut().zip(&mut self.counts).zip(&mut self.broken);
                for ((track, counts), broken) in joints {
                    counts.add(track.close(), KEEPS);
                    *broken = counts.is_broken();
                }
            }
        }
    }

    /// Joints whose derivatives are made of their positions.
    pub(crate) fn broken(&self) -> &[bool] {
        &self.broken
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use crate::report::Motion;

    /// Joints that are told: all, held for 16 ms as a slow planner does, no acceleration, position alone, and one that stands.
    #[test]
    fn what_is_no_derivative_is_told_at_once_and_forgotten_when_it_is_one() {
        let mut plan = Plan::new(5, 1e-3);
        let mut sample = |k: usize, whole: bool| {
            let at = |t: f64| [0.5 * (3.0 * t).sin(), 1.5 * (3.0 * t).cos(), -4.5 * (3.0 * t).sin()];
            let (now, held) = (at(k as f64 * 1e-3), at((k / 16 * 16) as f64 * 1e-3));
            let some = |k: usize| if whole { now[k] } else { 0.0 };
            let rows = [0, 1, 2].map(|k| match k {
                0 => [now[0], held[0], now[0], now[0], 0.3],
                1 => [now[1], held[1], now[1], some(1), 0.0],
                _ => [now[2], held[2], some(2), some(2), 0.0],
            });
            plan.take(Some(Motion { q: &rows[0], qd: &rows[1], qdd: &rows[2] }));
            plan.broken().to_vec()
        };
        let first: Vec<Vec<bool>> = (0..4000).map(|k| sample(k, false)).collect();
        assert!(first[500..].iter().all(|b| *b == [false, false, true, true, false]), "{:?}", first.last());
        assert!(first.iter().all(|b| !b[0] && !b[1] && !b[4]));
        let later = (4000..12_000).map(|k| sample(k, true)).last();
        assert_eq!(later, Some(vec![false; 5]), "told so, it is believed again");
    }

    /// A plan that repeats with the longer window, one that jumps, and one of which single rows were lost.
    #[test]
    fn a_repeating_plan_hides_nothing_and_a_jump_breaks_nothing() {
        let plan = |k: usize| {
            let t = k as f64 * 1e-3;
            [0.1 * (10.0 * TAU * t).sin(), TAU * (10.0 * TAU * t).cos(), -10.0 * TAU * TAU * (10.0 * TAU * t).sin()]
        };
        let rows = |part: usize| (0..6000).map(|k| plan(k)[part]).collect::<Vec<f64>>();
        let (q, qd, qdd) = (rows(0), rows(1), rows(2));
        let none = vec![0.0; q.len()];
        assert!(!is_broken([&q, &qd, &qdd], 1e-3) && is_broken([&q, &qd, &none], 1e-3));
        let slow = |part: usize| -> Vec<f64> {
            let at = |t: f64| [0.5 * (2.0 * t).sin(), (2.0 * t).cos(), -2.0 * (2.0 * t).sin()][part];
            (0..6000).map(|k| at(f64::from(k) * 1e-3)).collect()
        };
        let (mut jumps, mut lost) = (slow(0), slow(0));
        jumps.iter_mut().skip(3000).for_each(|q| *q += 1.0);
        lost.iter_mut().step_by(400).for_each(|q| *q = 0.0);
        for q in [jumps, lost] {
            assert!(!is_broken([&q, &slow(1), &slow(2)], 1e-3));
        }
    }
}
