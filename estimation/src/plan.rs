//! Setpoints whose velocities or accelerations are not those of their positions.
//!
//! A robot controller that plans positions alone leaves the rest 0, or a planner forgets the accelerations. Instruments of such a plan
//! say that nothing accelerates, and what is found with them is wrong by far more than its deviations. Positions are what the arm is
//! told to follow, so they are believed: a joint whose Δq̇ or Δq over a window is not the integral of what is given has its derivatives
//! made of its positions, as those of the measured motion are.

use crate::report::Setpoint;

/// Length of a window \[s\]: long beside the rows for which a slow planner holds its setpoint.
const WINDOW_S: f64 = 0.2;
/// Share of the squared way that may be missed: a plan that is held misses a part, one of zeros all of it.
const MISSED: f64 = 0.25;
/// Squared way that a joint must have gone before anything is said: 2 mrad, 20 mrad/s.
const LEAST: [f64; 2] = [4e-6, 4e-4];
/// What a window keeps of the sums before it.
const KEEPS: f64 = 0.9;

/// Two integrals of one joint beside what they should give: velocity beside position, acceleration beside velocity.
#[derive(Clone, Copy, Debug, Default)]
struct Track {
    /// At the start of the window, and of the last sample: position, velocity, acceleration.
    first: [f64; 3],
    last: [f64; 3],
    integral: [f64; 2],
    /// Squares of the way by positions or velocities, and of what the integral misses of it.
    way: [f64; 2],
    off: [f64; 2],
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

    /// Ends a window, keeping a share of the sums before it; whether the derivatives are not those of the positions.
    fn close(&mut self, keeps: f64) -> bool {
        for k in 0..2 {
            let way = self.last[k] - self.first[k];
            self.way[k] = keeps * self.way[k] + way * way;
            self.off[k] = keeps * self.off[k] + (way - self.integral[k]).powi(2);
        }
        self.begin(self.last);
        (0..2).any(|k| self.off[k].max(self.way[k]) > LEAST[k] && self.off[k] > MISSED * self.way[k])
    }
}

/// Whether the velocities or accelerations of a joint's whole plan are not those of its positions.
pub(crate) fn is_broken([q, qd, qdd]: [&[f64]; 3], period: f64) -> bool {
    let now = |k: usize| [q[k], qd[k], qdd[k]];
    let (mut track, mut broken) = (Track::default(), false);
    for k in 0..q.len() {
        if k == 0 {
            track.begin(now(k));
        } else {
            track.step(now(k), period);
        }
        if k > 0 && k % window(period) == 0 {
            broken = track.close(1.0);
        }
    }
    broken
}

fn window(period: f64) -> usize {
    (WINDOW_S / period).round().max(2.0) as usize
}

/// Looks at the setpoints of all joints.
#[derive(Clone, Debug)]
pub(crate) struct Plan {
    period: f64,
    window: usize,
    /// Samples of the window so far; 0 before the first one.
    samples: usize,
    tracks: Vec<Track>,
    broken: Vec<bool>,
}

impl Plan {
    pub(crate) fn new(dof: usize, period: f64) -> Plan {
        Plan {
            period,
            window: window(period),
            samples: 0,
            tracks: vec![Track::default(); dof],
            broken: vec![false; dof],
        }
    }

    /// Takes in the setpoint of a sample; without one the window begins anew.
    pub(crate) fn take(&mut self, setpoint: Option<Setpoint<'_>>) {
        let Some(s) = setpoint else {
            self.samples = 0;
            return;
        };
        let now = |j: usize| [s.q[j], s.qd[j], s.qdd[j]];
        if self.samples == 0 {
            self.tracks.iter_mut().enumerate().for_each(|(j, track)| track.begin(now(j)));
        } else {
            let period = self.period;
            self.tracks.iter_mut().enumerate().for_each(|(j, track)| track.step(now(j), period));
        }
        self.samples += 1;
        if self.samples > self.window {
            self.samples = 1;
            self.tracks.iter_mut().zip(&mut self.broken).for_each(|(track, broken)| *broken = track.close(KEEPS));
        }
    }

    /// Joints whose derivatives are made of their positions.
    pub(crate) fn broken(&self) -> &[bool] {
        &self.broken
    }
}

#[cfg(test)]
mod tests {
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
        assert!(first[700..].iter().all(|b| *b == [false, false, true, true, false]), "{:?}", first.last());
        assert!(first.iter().all(|b| !b[0] && !b[1] && !b[4]));
        let later = (4000..9000).map(|k| sample(k, true)).last();
        assert_eq!(later, Some(vec![false; 5]), "told so, it is believed again");
    }
}
