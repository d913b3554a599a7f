//! Rows of a log that readings are compared on: filtered once, at places that no reading changes.

use rivet_estimation::offline::{ZeroPhase, white_noise};

use crate::priors::{
    AWAY_OVER_RMS, BAND_HZ, BAND_OVER_RATE, DELAY_MARGIN_S, MAX_BELOW_OVER_RMS, MAX_ROWS, MAX_TOUCHES, MIN_ROWS,
    MIN_SPEED_OVER_RMS, MIN_TRAVEL, ROWS_PER_BAND_PERIOD, TOUCH_OVER_RMS,
};

/// Order of the low-pass.
const ORDER: usize = 4;

/// Differences that leave nothing of a motion but its noise.
const NOISE_ORDER: usize = 6;

/// One evenly sampled stretch of a log, `[joint][sample]`.
#[derive(Clone, Copy, Debug)]
pub struct Stretch<'a> {
    /// Time between samples \[s\].
    pub period_s: f64,
    /// When it begins, by the log's clock \[s\].
    pub start_s: f64,
    /// Positions \[rad\] as logged.
    pub q: &'a [Vec<f64>],
    /// Torques \[N m\] as logged.
    pub tau: &'a [Vec<f64>],
}

/// Motion and torque of a log at the rows that are compared. `[row][joint]`.
#[derive(Clone, Debug, Default)]
pub(crate) struct Samples {
    pub(crate) q: Vec<Vec<f64>>,
    pub(crate) qd: Vec<Vec<f64>>,
    pub(crate) qdd: Vec<Vec<f64>>,
    /// Share of the log's time that has passed, 0 to 1.
    pub(crate) elapsed: Vec<f64>,
    /// `[delay][row][joint]`: torque as logged, and as logged later by each delay asked for.
    pub(crate) tau: Vec<Vec<Vec<f64>>>,
    /// `[row][joint]`: whether the joint moves there.
    pub(crate) moves: Vec<Vec<bool>>,
    /// Whether a torque is never negative, or never positive, in the rows as logged.
    pub(crate) one_signed: Vec<bool>,
    /// How often a torque of one sign touches zero.
    pub(crate) touches: Vec<usize>,
    /// White noise of the torque as logged over its rms, of the noisiest joint.
    pub(crate) noise: f64,
}

impl Samples {
    /// Filters the stretches and picks rows; `delays_s` are those at which torque is also taken, the first being 0.
    /// None where too few rows have motion.
    pub(crate) fn new(stretches: &[Stretch<'_>], delays_s: &[f64]) -> Option<Samples> {
        let joints = stretches.first()?.q.len();
        let filtered: Vec<Filtered> = stretches.iter().filter_map(Filtered::new).collect();
        let rows: usize = filtered.iter().map(|f| f.places().count()).sum();
        let every = rows.div_ceil(MAX_ROWS).max(1);
        let (begin, end) = filtered.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(begin, end), f| {
            (begin.min(f.start_s), end.max(f.start_s + f.period_s * f.len() as f64))
        });
        let mut samples = Samples { tau: vec![Vec::new(); delays_s.len()], ..Samples::default() };
        for (count, (f, k)) in filtered.iter().flat_map(|f| f.places().map(move |k| (f, k))).enumerate() {
            if count % every != 0 {
                continue;
            }
            samples.elapsed.push(((f.start_s - begin + k as f64 * f.period_s) / (end - begin)).clamp(0.0, 1.0));
            samples.q.push(f.q.iter().map(|q| q[k]).collect());
            samples.qd.push(f.qd.iter().map(|v| v[k]).collect());
            samples.qdd.push(f.qdd.iter().map(|a| a[k]).collect());
            for (tau, delay_s) in samples.tau.iter_mut().zip(delays_s) {
                tau.push(f.tau.iter().map(|signal| later(signal, k as f64 + delay_s / f.period_s)).collect());
            }
        }
        samples.one_signed = (0..joints).map(|j| one_signed(stretches, j)).collect();
        let touches = |j: usize| stretches.iter().map(|s| touches(&s.tau[j])).sum::<usize>().min(MAX_TOUCHES);
        samples.touches = (0..joints).map(|j| if samples.one_signed[j] { touches(j) } else { 0 }).collect();
        samples.noise = stretches.iter().flat_map(|s| s.tau).map(|tau| noise_share(tau)).fold(0.0, f64::max);
        samples.mark_motion(joints);
        let moving = samples.moves.iter().filter(|row| row.iter().any(|m| *m)).count();
        (moving >= MIN_ROWS).then_some(samples)
    }

    pub(crate) fn rows(&self) -> usize {
        self.q.len()
    }

    /// Speed and travel as shares of the joint's own, so that a unit or a sign changes no row.
    fn mark_motion(&mut self, joints: usize) {
        let column = |rows: &[Vec<f64>], j: usize| rows.iter().map(|row| row[j]).collect::<Vec<f64>>();
        let limits: Vec<f64> = (0..joints)
            .map(|j| {
                let q = column(&self.q, j);
                let travel =
                    q.iter().fold(f64::NEG_INFINITY, |m, q| m.max(*q)) - q.iter().fold(f64::INFINITY, |m, q| m.min(*q));
                if travel < MIN_TRAVEL { f64::INFINITY } else { MIN_SPEED_OVER_RMS * rms(&column(&self.qd, j)) }
            })
            .collect();
        let row = |qd: &Vec<f64>| qd.iter().zip(&limits).map(|(v, limit)| v.abs() > *limit).collect();
        self.moves = self.qd.iter().map(row).collect();
    }
}

/// A stretch behind the low-pass.
struct Filtered {
    period_s: f64,
    start_s: f64,
    step: usize,
    margin: usize,
    q: Vec<Vec<f64>>,
    qd: Vec<Vec<f64>>,
    qdd: Vec<Vec<f64>>,
    tau: Vec<Vec<f64>>,
}

impl Filtered {
    fn new(stretch: &Stretch<'_>) -> Option<Filtered> {
        let period_s = stretch.period_s;
        let band = BAND_HZ.min(BAND_OVER_RATE / period_s);
        let filter = ZeroPhase::new(band, ORDER, period_s);
        let margin = filter.edge().max((DELAY_MARGIN_S / period_s).ceil() as usize) + 2;
        let samples = stretch.q.first().map_or(0, Vec::len);
        if samples < 3 * margin {
            return None;
        }
        let smooth = |signals: &[Vec<f64>]| -> Vec<Vec<f64>> {
            let one = |x: &Vec<f64>| {
                let mut x = x.clone();
                filter.apply(&mut x);
                x
            };
            signals.iter().map(one).collect()
        };
        let (q, tau) = (smooth(stretch.q), smooth(stretch.tau));
        let difference = |signals: &[Vec<f64>]| -> Vec<Vec<f64>> {
            let one = |x: &Vec<f64>| {
                let at = |k: usize| (x[(k + 1).min(x.len() - 1)] - x[k.saturating_sub(1)]) / (2.0 * period_s);
                (0..x.len()).map(at).collect()
            };
            signals.iter().map(one).collect()
        };
        let qd = difference(&q);
        let qdd = difference(&qd);
        let step = ((1.0 / (ROWS_PER_BAND_PERIOD * band * period_s)).round() as usize).max(1);
        Some(Filtered { period_s, start_s: stretch.start_s, step, margin, q, qd, qdd, tau })
    }

    fn len(&self) -> usize {
        self.q.first().map_or(0, Vec::len)
    }

    fn places(&self) -> impl Iterator<Item = usize> + use<> {
        (self.margin..self.len().saturating_sub(self.margin)).step_by(self.step)
    }
}

/// Between samples of an uneven log a curve may swing over zero.
fn one_signed(stretches: &[Stretch<'_>], j: usize) -> bool {
    let of = |sign: f64| {
        stretches.iter().all(|s| {
            let below: Vec<f64> = s.tau[j].iter().map(|t| (sign * t).min(0.0)).collect();
            rms(&below) <= MAX_BELOW_OVER_RMS * rms(&s.tau[j])
        })
    };
    of(1.0) || of(-1.0)
}

/// How often a signal comes down to zero and goes away again.
fn touches(tau: &[f64]) -> usize {
    let size = rms(tau);
    let (mut count, mut is_near) = (0, false);
    for value in tau.iter().map(|tau| tau.abs()) {
        if !is_near && value <= TOUCH_OVER_RMS * size {
            (count, is_near) = (count + 1, true);
        } else if value > AWAY_OVER_RMS * size {
            is_near = false;
        }
    }
    count
}

fn noise_share(tau: &[f64]) -> f64 {
    let size = rms(tau);
    if size > 0.0 { white_noise(tau, NOISE_ORDER) / size } else { 0.0 }
}

/// A signal between its samples.
fn later(signal: &[f64], at: f64) -> f64 {
    let k = (at.floor().max(0.0) as usize).min(signal.len().saturating_sub(2));
    let share = at - k as f64;
    signal[k] * (1.0 - share) + signal[k + 1] * share
}

pub(crate) fn rms(x: &[f64]) -> f64 {
    (x.iter().map(|x| x * x).sum::<f64>() / x.len().max(1) as f64).sqrt()
}
