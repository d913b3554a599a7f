//! Whether the log's time is the one that its speeds are of, and by how much it runs off.

use rayon::prelude::*;

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

/// A clock that is nearly the one of the speeds is off it by more than this, and by so many deviations. On the measured runs whose
/// speeds tell it to 0.1 % and better (20 of UR10, UR10e, KR 300 and Gen3) the factor is within 0.04 % of one. Further off than `FAR`
/// speeds are in another unit, or of another motion.
const NEARLY: f64 = 2e-3;
const FAR: f64 = 0.1;
const SURE: f64 = 8.0;
/// A column of which the others leave less than this share of its squares is one of them.
const FREE: f64 = 1e-6;
/// Halves of a motion differ by no more than this share of what the clock is off.
const ALIKE: f64 = 0.25;
/// Speeds and a common lag leave no more than this share of the squares of what a joint runs through. What they leave may be noise of
/// the speeds, which makes the factor larger by as large a share.
const UNEXPLAINED: f64 = 3e-4;

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

/// What positions and speeds of a log say of its time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClockRate {
    /// Speed of the positions by the log's time, over that in its columns, and its deviation, which holds what joints differ by.
    pub factor: f64,
    /// One standard deviation.
    pub std: f64,
    /// The same of either half of the motion.
    halves: [f64; 2],
    /// Joints that move.
    pub joints: usize,
    /// Columns of positions and of speeds, without the joint's number.
    pub columns: [&'static str; 2],
}

impl ClockRate {
    /// Whether the log's time is not that of its speeds.
    pub fn is_off(&self) -> bool {
        let off = (self.factor - 1.0).abs();
        (NEARLY..FAR).contains(&off)
            && off > SURE * self.std
            && self.halves.iter().all(|half| (half - self.factor).abs() < ALIKE * off)
    }

    /// Whether it is.
    pub fn is_right(&self) -> bool {
        (self.factor - 1.0).abs() <= NEARLY && self.std <= NEARLY
    }
}

/// What one joint says of the clock: factor and deviation over all of its motion, and the factor of either half.
struct Told {
    factor: f64,
    std: f64,
    halves: [f64; 2],
}

impl Log {
    /// How fast the column `t` runs, by speeds that explain nearly all of the motion of every joint that moves: planned ones, or else
    /// measured ones, of two joints at the least, since a drive may have a scale or a low-pass of its own in them. Measured speeds that
    /// are those of the positions overrule planned ones that are not. None where nothing tells it.
    pub fn clock_rate(&self) -> Option<ClockRate> {
        let planned = self.q_des.as_ref().zip(self.qd_des.as_ref());
        let planned = planned.and_then(|(q, qd)| self.rate(q, qd, ["q_des", "qd_des"]));
        let measured = self.qd.as_ref().and_then(|qd| self.rate(&self.q, qd, ["q", "qd"]));
        let measured = measured.filter(|measured| measured.joints >= JOINTS);
        match (planned, measured) {
            (Some(planned), Some(measured)) if measured.is_right() && !planned.is_right() => Some(measured),
            (planned, measured) => planned.or(measured),
        }
    }

    fn rate(&self, q: &Signals, qd: &Signals, columns: [&'static str; 2]) -> Option<ClockRate> {
        let usual_s = self.median_step_s();
        let moving: Vec<Vec<[f64; 4]>> = q.par_iter().zip(qd).map(|(q, qd)| moving(&self.t, q, qd, usual_s)).collect();
        let told: Vec<Told> =
            moving.iter().filter(|moving| moving.len() >= LEAST).map(|moving| told(moving)).collect::<Option<_>>()?;
        if told.is_empty() {
            return None;
        }
        let middle = |of: &dyn Fn(&Told) -> f64| {
            let mut all: Vec<f64> = told.iter().map(of).collect();
            all.sort_unstable_by(f64::total_cmp);
            all[all.len() / 2]
        };
        let factors = || told.iter().map(|t| t.factor);
        let apart = factors().fold(f64::NEG_INFINITY, f64::max) - factors().fold(f64::INFINITY, f64::min);
        Some(ClockRate {
            factor: middle(&|t| t.factor),
            std: middle(&|t| t.std).max(0.5 * apart),
            halves: [middle(&|t| t.halves[0]), middle(&|t| t.halves[1])],
            joints: told.len(),
            columns,
        })
    }

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

/// Stretches in which a joint moves: by how much its position changes, by how much it does by its speeds, and by how
/// much these and their slopes do.
fn moving(t: &[f64], q: &[f64], qd: &[f64], usual_s: f64) -> Vec<[f64; 4]> {
    let step = ((STRETCH_S / usual_s).round() as usize).max(2);
    let hole_s = HOLE * STRETCH_S.max(step as f64 * usual_s);
    // By parts (Euler-Maclaurin): straight lines between rows are wrong by h²q⃛/12, 0.5 % of 4 Hz at 100 Hz.
    let slope = |k: usize| {
        let (a, b) = (k.saturating_sub(1), (k + 1).min(t.len() - 1));
        (qd[b] - qd[a]) / (t[b] - t[a])
    };
    let between = |k: usize| {
        let h = t[k + 1] - t[k];
        0.5 * h * (qd[k] + qd[k + 1]) - h * h / 12.0 * (slope(k + 1) - slope(k))
    };
    let of = |k: usize| {
        let ran: f64 = (k..k + step).map(between).sum();
        [q[k + step] - q[k], ran, qd[k + step] - qd[k], slope(k + step) - slope(k)]
    };
    (0..t.len().saturating_sub(step))
        .step_by(step)
        .filter(|k| t[k + step] - t[*k] < hole_s)
        .map(of)
        .filter(|[by, ran, ..]| ran.abs().max(by.abs()) > MOVES)
        .collect()
}

/// Of a joint's stretches; none where its speeds are not those of its positions, or not nearly.
///
/// `Δq = f ∫q̇ dt − d Δq̇ + e Δq̈`: a lag d of the speeds, such as half a sample, is none of the factor f, nor is what a low-pass of second
/// order takes. Motion of one frequency does not tell the last from a clock.
fn told(moving: &[[f64; 4]]) -> Option<Told> {
    let (first, second) = moving.split_at(moving.len() / 2);
    let (factor, std, left) = regressed(moving)?;
    let halves = [regressed(first)?.0, regressed(second)?.0];
    (left < UNEXPLAINED).then(|| Told { factor, std: std.hypot(left), halves })
}

/// Factor of the second column and its deviation, beside the third and the fourth, and the share of the squares of the first that all leave.
fn regressed(rows: &[[f64; 4]]) -> Option<(f64, f64, f64)> {
    let mut columns: [Vec<f64>; 4] = std::array::from_fn(|c| rows.iter().map(|row| row[c]).collect());
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let sizes = [0, 1, 2, 3].map(|c| dot(&columns[c], &columns[c]));
    // What is beside the factor is taken out of the rest, as far as there is anything of it: at constant speed there is no lag to be told.
    for beside in [2, 3] {
        let own = columns[beside].clone();
        let square = dot(&own, &own);
        if square > FREE * sizes[beside] && square > FREE * FREE * sizes[1] {
            for column in &mut columns {
                let share = dot(column, &own) / square;
                column.iter_mut().zip(&own).for_each(|(x, own)| *x -= share * own);
            }
        }
    }
    let [by, ran, ..] = &columns;
    let square = dot(ran, ran);
    if square <= FREE * sizes[1] || sizes[0] <= 0.0 {
        return None;
    }
    let factor = dot(by, ran) / square;
    let left: f64 = by.iter().zip(ran).map(|(by, ran)| (by - factor * ran).powi(2)).sum();
    let spare = rows.len().saturating_sub(3).max(1) as f64;
    (factor > 0.0).then(|| (factor, (left / spare / square).sqrt(), left / sizes[0]))
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
        let q = vec![
            of(&|t| t.sin() + 0.3 * (3.1 * t).sin() + noise(t)),
            of(&|t| 0.3 * (2.0 * t).sin() + 0.1 * (4.7 * t).cos() + noise(t)),
        ];
        let qd = vec![
            of(&|t| t.cos() + 0.93 * (3.1 * t).cos()),
            of(&|t| second * (0.6 * (2.0 * t).cos() - 0.47 * (4.7 * t).sin())),
        ];
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
            crowded: 0,
            damaged_t: Vec::new(),
            notes: Vec::new(),
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

    /// From half a percent to three, by plans that are exact, noisy, late by a sample, or held.
    #[test]
    fn a_clock_that_runs_a_little_off_is_told_with_its_rate() {
        let held = |log: Log| {
            let hold = |x: &Vec<f64>| (0..x.len()).map(|k| x[k / 2 * 2]).collect::<Vec<f64>>();
            Log { q_des: log.q_des.map(|q| q.iter().map(hold).collect()), ..log }
        };
        let late = |log: Log| {
            let shift = |x: &Vec<f64>| (0..x.len()).map(|k| x[k.saturating_sub(1)]).collect::<Vec<f64>>();
            Log { qd_des: log.qd_des.map(|v| v.iter().map(shift).collect()), ..log }
        };
        for clock in [0.97, 0.99, 0.995, 1.005, 1.01, 1.02] {
            // Where a plan is held how far off its speeds are depends on where stretches end: told, but less surely.
            for (log, sure) in [(log(clock, 1.0), true), (late(log(clock, 1.0)), true), (held(log(clock, 1.0)), false)]
            {
                let rate = log.clock_rate().expect("told");
                // Noise of the positions is a tenth of a milliradian.
                let error = (rate.factor - 1.0 / clock).abs();
                assert!(error < 4.0 * rate.std && !rate.is_right(), "{clock}: {rate:?}");
                assert!(!sure || error < 4e-4 && rate.joints == 2 && rate.is_off(), "{clock}: {rate:?}");
            }
        }
        for log in [log(1.0, 1.0), late(log(1.0, 1.0)), held(log(1.0, 1.0))] {
            let rate = log.clock_rate().expect("told");
            assert!(rate.is_right() && !rate.is_off(), "{rate:?}");
        }
    }

    #[test]
    fn speeds_that_do_not_agree_tell_no_clock() {
        let off = |log: Log| log.clock_rate().is_some_and(|rate| rate.is_off());
        assert!(!off(log(1.0, 1.01)), "one joint's speed has a scale of its own");
        let fast = log(1.01, 1.0);
        assert!(off(fast.clone()));
        // Speeds with a slow error of their own, which leaves a hundredth of the way.
        let odd = |x: &Vec<f64>| fast.t.iter().zip(x).map(|(t, x)| x + 0.05 * (3.3 * t).sin()).collect::<Vec<f64>>();
        let rough = fast.qd_des.iter().flatten().map(odd).collect();
        assert_eq!(Log { qd_des: Some(rough), ..fast.clone() }.clock_rate(), None);
        // A plan before an override beside speeds that are those of the positions.
        let sound = log(1.0, 1.0);
        let less = sound.qd_des.iter().flatten().map(|v| v.iter().map(|v| 0.98 * v).collect()).collect();
        assert!(off(Log { qd_des: Some(less), ..sound.clone() }));
        let less = sound.qd_des.iter().flatten().map(|v| v.iter().map(|v| 0.98 * v).collect()).collect();
        assert!(!off(Log { qd: sound.qd_des.clone(), qd_des: Some(less), ..sound.clone() }));
        // The clock changes in mid motion: it is no rate.
        let middle = sound.t[2000];
        let bent = sound.t.iter().map(|t| if *t < middle { *t } else { middle + 1.02 * (t - middle) }).collect();
        assert!(!off(Log { t: bent, ..sound.clone() }));
        let degrees = sound.qd_des.iter().flatten().map(|v| v.iter().map(|v| v.to_degrees()).collect()).collect();
        assert!(!off(Log { qd_des: Some(degrees), ..sound.clone() }), "another unit");
        // One joint's measured speed may have a low-pass of its own; two are a clock.
        let measured = Log { q_des: None, qd_des: None, qd: fast.qd_des.clone(), ..fast.clone() };
        assert!(off(measured.clone()));
        let alone = |of: &Option<Signals>| of.as_ref().map(|of| vec![of[0].clone()]);
        assert!(!off(Log { q: vec![measured.q[0].clone()], qd: alone(&measured.qd), ..measured.clone() }));
    }

    /// What a low-pass of second order takes of speeds is 1 % of 1 Hz at 10 Hz, on all joints alike: of motion of one frequency it is none of a
    /// clock, and beside another frequency it is told from one.
    #[test]
    fn speeds_behind_a_low_pass_are_no_clock() {
        let behind = |frequencies: &[f64]| {
            let mut log = log(1.0, 1.0);
            let swing = |of: &dyn Fn(f64, f64) -> f64| -> Vec<f64> {
                log.t.iter().map(|t| frequencies.iter().map(|hz| of(std::f64::consts::TAU * hz, *t)).sum()).collect()
            };
            let q = swing(&|w, t| 0.3 * (w * t).sin());
            // Of 1/(1 + √2 jx - x²) at x = f/10 Hz.
            let qd = swing(&|w, t| {
                let x = w / (std::f64::consts::TAU * 10.0);
                let (re, im) = (1.0 - x * x, std::f64::consts::SQRT_2 * x);
                let square = re * re + im * im;
                0.3 * w * (re / square * (w * t).cos() + im / square * (w * t).sin())
            });
            (log.q, log.qd) = (vec![q.clone(), q], Some(vec![qd.clone(), qd]));
            (log.q_des, log.qd_des) = (None, None);
            log.clock_rate()
        };
        for frequencies in [&[1.0][..], &[0.5], &[0.4, 1.0], &[0.2, 0.4, 0.6, 0.8, 1.0]] {
            let rate = behind(frequencies);
            assert!(rate.is_none_or(|rate| !rate.is_off()), "{frequencies:?}: {rate:?}");
        }
    }
}
