//! Whether the log's time is the one that its speeds are of.

use crate::log::{Log, Signals};

/// Positions are compared with the integral of speeds over stretches of this length \[s\]: what is linear stays exact, noise goes.
const STRETCH_S: f64 = 0.2;
/// A stretch of this many times that length has a hole in it.
const HOLE: f64 = 3.0;
/// Stretches below which nothing is said.
const LEAST: usize = 10;
/// A joint moves that by its speeds runs through so much in a stretch \[rad\], root mean square.
const MOVES: f64 = 3e-3;
/// Correlation from which on two signals are the same motion. Measured speeds have 0.99 and more but for noise.
const SAME: f64 = 0.98;
/// Factors of the joints that move are one by so much, and off by more. On 78 measured runs of nine machines the factor is within 1 %
/// but for servos that estimate their speed, whose factors are not common.
const COMMON: f64 = 0.03;
const OFF: f64 = 0.03;
/// A factor that is of degrees and not of a clock, by so much.
const DEGREES: f64 = 0.05;
/// Joints that have to agree: one alone may have its own unit.
const JOINTS: usize = 2;

/// A clock that is not the one of the speeds.
#[derive(Clone, Debug, PartialEq)]
pub struct OtherClock {
    /// Speed of the positions by the log's time, over that in its columns.
    pub factor: f64,
    /// Joints that move.
    pub joints: usize,
    /// Columns of positions and of speeds, without the joint's number.
    pub columns: Vec<[&'static str; 2]>,
}

impl Log {
    /// The factor by which positions change faster by the column `t` than the log's own speeds say, if it is the same on all joints
    /// that move and by all columns of speeds there are.
    pub fn other_clock(&self) -> Option<OtherClock> {
        let measured = self.qd.as_ref().map(|qd| (["q", "qd"], &self.q, qd));
        let desired = self.q_des.as_ref().zip(self.qd_des.as_ref()).map(|(q, qd)| (["q_des", "qd_des"], q, qd));
        let mut clock = OtherClock { factor: 1.0, joints: 0, columns: Vec::new() };
        let mut factors = Vec::new();
        for (names, q, qd) in [measured, desired].into_iter().flatten() {
            let own = self.factors(q, qd)?;
            if own.is_empty() {
                continue;
            }
            clock.joints = clock.joints.max(own.len());
            clock.columns.push(names);
            factors.extend(own);
        }
        let (low, high) = factors.iter().fold((f64::INFINITY, 0.0_f64), |(l, h), f| (l.min(*f), h.max(*f)));
        clock.factor = (low * high).sqrt();
        let off = !(1.0 / (1.0 + OFF)..=1.0 + OFF).contains(&clock.factor);
        let degrees = (clock.factor.to_degrees() - 1.0).abs() < DEGREES;
        (clock.joints >= JOINTS && high <= low * (1.0 + COMMON) && off && !degrees).then_some(clock)
    }

    /// Of the joints that move; none where a speed is not that of its position at all.
    fn factors(&self, q: &Signals, qd: &Signals) -> Option<Vec<f64>> {
        let t = &self.t;
        let usual_s = self.median_step_s();
        let step = ((STRETCH_S / usual_s).round() as usize).max(2);
        let hole_s = HOLE * STRETCH_S.max(step as f64 * usual_s);
        let starts: Vec<usize> =
            (0..t.len().saturating_sub(step)).step_by(step).filter(|k| t[k + step] - t[*k] < hole_s).collect();
        if starts.len() < LEAST {
            return Some(Vec::new());
        }
        let of = |q: &Vec<f64>, qd: &Vec<f64>| {
            let (mut qq, mut qi, mut ii) = (0.0, 0.0, 0.0);
            for start in &starts {
                let by = q[start + step] - q[*start];
                let rows = *start..start + step;
                let ran: f64 = rows.map(|k| 0.5 * (qd[k] + qd[k + 1]) * (t[k + 1] - t[k])).sum();
                qq += by * by;
                qi += by * ran;
                ii += ran * ran;
            }
            let moves = ii > MOVES.powi(2) * starts.len() as f64;
            moves.then(|| (qi > SAME * (qq * ii).sqrt()).then(|| (qq / ii).sqrt()))
        };
        q.iter().zip(qd).filter_map(|(q, qd)| of(q, qd)).collect()
    }
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;

    /// Two joints that swing for 8 s, with noise on the positions; time, and the speeds of joint 2, times something.
    fn log(clock: f64, second: f64) -> Log {
        let t: Vec<f64> = (0..4000).map(|k| 2e-3 * f64::from(k)).collect();
        let of = |f: &dyn Fn(f64) -> f64| t.iter().map(|t| f(*t)).collect::<Vec<f64>>();
        let noise = |t: f64| 1e-4 * (7919.0 * t).sin();
        let q = vec![of(&|t| t.sin() + noise(t)), of(&|t| 0.3 * (2.0 * t).sin() + noise(t))];
        let qd = vec![of(&|t| t.cos()), of(&|t| second * 0.6 * (2.0 * t).cos())];
        let desired = q.clone();
        Log {
            path: PathBuf::from("log"),
            t: t.iter().map(|t| clock * t).collect(),
            q,
            tau: None,
            qd: None,
            q_des: Some(desired),
            qd_des: Some(qd),
            qdd_des: None,
            temperature: None,
            current: None,
            q_link: Vec::new(),
            unused: Vec::new(),
            stamps: None,
            off_s: 0.0,
        }
    }

    #[test]
    fn a_clock_that_is_off_is_told_by_the_speeds() {
        let clock = log(1.25, 1.0).other_clock().expect("a quarter too slow");
        assert!((clock.factor - 0.8).abs() < 1e-3 && clock.joints == 2, "{clock:?}");
        assert_eq!(clock.columns, [["q_des", "qd_des"]]);
        assert_eq!(log(1.0, 1.0).other_clock(), None);
        assert_eq!(log(1.02, 1.0).other_clock(), None, "a planner's sample too late");
        assert_eq!(log(1.0, 1.3).other_clock(), None, "the speed of one joint in its own unit");
        assert_eq!(Log { qd_des: None, ..log(1.25, 1.0) }.other_clock(), None, "nothing to tell it by");
    }

    #[test]
    fn speeds_of_another_kind_beside_sound_ones_are_no_clock() {
        let sound = log(1.0, 1.0);
        let half: Signals = sound.qd_des.iter().flatten().map(|v| v.iter().map(|v| 0.5 * v).collect()).collect();
        let odd = Log { qd: sound.qd_des.clone(), qd_des: Some(half), ..sound.clone() };
        assert_eq!(odd.other_clock(), None, "desired speeds before an override");
        let degrees = sound.qd_des.iter().flatten().map(|v| v.iter().map(|v| v.to_degrees()).collect()).collect();
        assert_eq!(Log { qd_des: Some(degrees), ..sound }.other_clock(), None, "degrees");
    }
}
