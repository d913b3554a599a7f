//! What a robot file leaves open and the logs decide: torque offsets, cut-off of the model filter and decimation.
//!
//! The cut-off follows motion, encoder and rate. Positions carry white noise of variance σ² (encoder steps, jitter), samples T
//! apart. Speeds and accelerations then have below the frequency f the variances
//!
//! ```text
//! σ_v² = 2·T·σ²·(2π)²·f³/3        σ_a² = 2·T·σ²·(2π)⁴·f⁵/5
//! ```
//!
//! A band belongs to the motion where the speed has twice the variance of its noise. The motion's bandwidth holds `MOTION_SHARE` of
//! the squared speed in these bands. Accelerations do not decide it: vibration and jitter dominate them. The cut-off is a multiple
//! of the bandwidth, at most where noise of accelerations is a share of the motion's, and at most a share of the log's rate, because
//! central differences attenuate what is faster.

use std::f64::consts::TAU;

use anyhow::Result;
use rayon::prelude::*;
use rivet_config::Robot;
use rivet_estimation::offline::{Trajectory, ZeroPhase, beyond, position_noise, position_step};
use rivet_logs::Log;
use serde_json::{Value, json};

use crate::glitches::jumps;
use crate::runs;
use crate::table::{number, paragraph};

/// Share of a joint's squared speed that lies below the bandwidth of its motion.
const MOTION_SHARE: f64 = 0.95;
/// A band of speed is motion from so many times the variance of noise on.
const MOTION_OVER_NOISE: f64 = 2.0;
/// Cut-off over the bandwidth of the motion.
const CUTOFF_OVER_MOTION: f64 = 2.0;
/// Cut-off over the log's rate: central differences then keep 0.98 of a speed at the cut-off.
const MAX_CUTOFF_OVER_RATE: f64 = 0.06;
/// Noise of accelerations below the cut-off over accelerations of the motion, root mean square.
const MAX_NOISE_OVER_ACCELERATION: f64 = 1.0;
/// Lowest and highest cut-off \[Hz\]. Friction at reversals has harmonics far above the motion; the highest is the default of a robot
/// file.
const CUTOFFS_HZ: [f64; 2] = [5.0, 20.0];
/// Lowest frequency at which the speed is divided into bands \[Hz\].
const LOWEST_BAND_HZ: f64 = 0.25;
/// Bands an octave.
const BANDS_PER_OCTAVE: f64 = 4.0;
/// Highest frequency of the bands \[Hz\], and the same over the log's rate.
const HIGHEST_BAND_HZ: f64 = 20.0;
const MAX_BAND_OVER_RATE: f64 = 0.2;
/// Order of the filters that separate the bands.
const BAND_ORDER: usize = 4;
/// Independent equations per parameter, two a period of the cut-off and joint, that a short log keeps.
const EQUATIONS_PER_PARAMETER: f64 = 10.0;
/// The transients at both ends of a stretch are a fifth of it where the cut-off has so many periods in it.
const LENGTHS_PER_STRETCH: f64 = 5.0;
/// Shortest record of a band: so many periods of its lower end.
const PERIODS_PER_RECORD: f64 = 2.0;
/// Rows of the estimator per period of the cut-off.
const ROWS_PER_CUTOFF: f64 = 5.0;
/// Most samples of the robot file per row of the estimator.
const MAX_DECIMATION: f64 = 1000.0;
/// A joint that moves less than this is no evidence of the motion's bandwidth \[rad\].
const MIN_MOTION_RAD: f64 = 0.01;

/// A robot with what its file leaves to the logs.
#[derive(Clone, Debug)]
pub struct OpenKeys {
    /// The robot with all keys.
    pub robot: Robot,
    /// The model filter, where the file has none.
    filter: Option<FilterChoice>,
    /// Whether offsets are identified although the file does not ask for them.
    offsets: bool,
}

/// The model filter that the logs ask for.
#[derive(Clone, Debug)]
struct FilterChoice {
    cutoff_hz: f64,
    /// Bandwidth of the motion \[Hz\].
    motion_hz: f64,
    /// Rate of the slowest log \[Hz\].
    rate_hz: f64,
    limit: Limit,
}

/// What decides the cut-off.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Limit {
    Motion,
    Lowest,
    Equations,
    Stretches,
    Highest,
    Noise,
    Rate,
}

impl FilterChoice {
    /// * `motion`: of the fastest joint of all logs
    /// * `equations_hz`: cut-off that leaves `EQUATIONS_PER_PARAMETER` \[Hz\]
    /// * `rate_hz`: of the slowest log \[Hz\]
    fn new(motion: Band, equations_hz: f64, rate_hz: f64) -> FilterChoice {
        let Band { motion_hz, noise_hz, stretches_hz } = motion;
        let [lowest, highest] = CUTOFFS_HZ;
        let (mut cutoff_hz, mut limit) = (CUTOFF_OVER_MOTION * motion_hz, Limit::Motion);
        let bounds = [(lowest, Limit::Lowest), (equations_hz, Limit::Equations), (stretches_hz, Limit::Stretches)];
        for (bound, by) in bounds {
            if bound > cutoff_hz {
                (cutoff_hz, limit) = (bound, by);
            }
        }
        for (bound, by) in
            [(highest, Limit::Highest), (noise_hz, Limit::Noise), (MAX_CUTOFF_OVER_RATE * rate_hz, Limit::Rate)]
        {
            if bound < cutoff_hz {
                (cutoff_hz, limit) = (bound, by);
            }
        }
        FilterChoice { cutoff_hz: two_digits(cutoff_hz), motion_hz, rate_hz, limit }
    }

    fn reason(&self) -> String {
        match self.limit {
            Limit::Motion => format!("{CUTOFF_OVER_MOTION} times the bandwidth of the motion"),
            Limit::Lowest => "the lowest that keeps friction at reversals".to_owned(),
            Limit::Equations => {
                format!("the lowest with {EQUATIONS_PER_PARAMETER} rows per parameter in so short a log")
            }
            Limit::Stretches => "the lowest that leaves rows between holes and damaged rows".to_owned(),
            Limit::Highest => "the highest without the key".to_owned(),
            Limit::Noise => "where accelerations have as much noise as motion".to_owned(),
            Limit::Rate => format!("{MAX_CUTOFF_OVER_RATE} of the log's rate of {} Hz", number(self.rate_hz, 3)),
        }
    }
}

impl OpenKeys {
    /// Chooses what the robot file leaves open. Keys of the file win.
    ///
    /// * `logs`: one after the other; none is kept
    pub fn choose(robot: &Robot, logs: impl Iterator<Item = Result<Log>>) -> Result<OpenKeys> {
        let offsets = !robot.has_key("estimator.offsets") && !robot.config.estimator.offsets;
        let mut robot = if offsets { robot.with_offsets()? } else { robot.clone() };
        if robot.has_key("signal.model_filter_hz") || robot.has_key("signal.decimation") {
            return Ok(OpenKeys { robot, filter: None, offsets });
        }
        let (mut motion, mut rate_hz, mut seconds) = (None::<Band>, f64::INFINITY, 0.0);
        for log in logs {
            let log = log?;
            rate_hz = rate_hz.min(1.0 / log.median_step_s().max(robot.config.sample_period_s));
            seconds += log.duration_s();
            motion = motion.into_iter().chain(motion_band(&robot, &log)).reduce(Band::fastest);
        }
        let Some(motion) = motion.filter(|_| rate_hz.is_finite()) else {
            return Ok(OpenKeys { robot, filter: None, offsets });
        };
        let equations = EQUATIONS_PER_PARAMETER * robot.base.len() as f64;
        let filter = FilterChoice::new(motion, equations / (2.0 * seconds * robot.dof() as f64), rate_hz);
        let decimation = 1.0 / (ROWS_PER_CUTOFF * robot.config.sample_period_s * filter.cutoff_hz);
        robot = robot.with_model_filter(filter.cutoff_hz, decimation.round().clamp(1.0, MAX_DECIMATION) as usize);
        Ok(OpenKeys { robot, filter: Some(filter), offsets })
    }

    /// The choices and their reasons, for people; empty where the file leaves nothing open.
    pub fn text(&self) -> String {
        let mut out = String::new();
        if let Some(filter) = &self.filter {
            let text = format!(
                "cut-off {} Hz from the logs: {}. The motion's bandwidth is {} Hz, without noise of positions. \
                 signal.model_filter_hz in the robot file overrides it",
                filter.cutoff_hz,
                filter.reason(),
                number(filter.motion_hz, 2)
            );
            out += &paragraph("  filter      ", &text);
        }
        if self.offsets {
            let text = "torque offsets are identified: friction.offset = 0 counts as unknown. estimator.offsets = false \
                        in the robot file leaves them out";
            out += &paragraph("  offsets     ", text);
        }
        out
    }

    /// The same as JSON.
    pub fn json(&self) -> Value {
        let filter = self.filter.as_ref().map(|filter| {
            json!({
                "model_filter_hz": filter.cutoff_hz,
                "decimation": self.robot.config.signal.decimation,
                "motion_bandwidth_hz": filter.motion_hz,
                "rate_hz": filter.rate_hz,
                "decided_by": format!("{:?}", filter.limit).to_lowercase(),
                "reason": filter.reason(),
            })
        });
        json!({"filter": filter, "offsets": self.offsets})
    }
}

/// A frequency \[Hz\] of two digits.
fn two_digits(hz: f64) -> f64 {
    if hz < 10.0 { (10.0 * hz).round() / 10.0 } else { hz.round() }
}

/// Frequencies of a motion \[Hz\].
#[derive(Clone, Copy, Debug)]
#[expect(clippy::struct_field_names, reason = "the unit belongs to the name")]
struct Band {
    /// Below this lies `MOTION_SHARE` of the squared speed.
    motion_hz: f64,
    /// Noise of accelerations below this is `MAX_NOISE_OVER_ACCELERATION` of the motion's; infinite without noise.
    noise_hz: f64,
    /// A filter of this cut-off leaves most rows of the stretches between holes and damaged rows.
    stretches_hz: f64,
}

impl Band {
    /// The wider motion, the narrower band without noise and the shorter stretches.
    fn fastest(self, other: Band) -> Band {
        Band {
            motion_hz: self.motion_hz.max(other.motion_hz),
            noise_hz: self.noise_hz.min(other.noise_hz),
            stretches_hz: self.stretches_hz.max(other.stretches_hz),
        }
    }
}

/// The fastest joint's motion and the least noise-free band; none where no joint moves.
fn motion_band(robot: &Robot, log: &Log) -> Option<Band> {
    let usual_s = log.median_step_s();
    let mut damaged = jumps(robot, log);
    if let Ok(tau) = log.torque() {
        damaged.extend(tau.iter().zip(&robot.config.drive.torque_limit).flat_map(|(tau, limit)| beyond(tau, *limit)));
    }
    damaged.sort_unstable();
    damaged.dedup();
    let stretches = log.split_without(&damaged, runs::hole_s(usual_s));
    // Too short a stretch is left out.
    let pieces: Vec<Log> = stretches.iter().filter_map(|stretch| Some(stretch.resample(usual_s).ok()?.0)).collect();
    let stretches_hz = LENGTHS_PER_STRETCH / median_length_s(&pieces)?;
    let of_joint = |j: usize| {
        let q = &log.q[j];
        let (low, high) = q.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), q| (l.min(*q), h.max(*q)));
        if high - low < MIN_MOTION_RAD {
            return None;
        }
        let rounding = position_step(q).map_or(0.0, |step| step / 12.0_f64.sqrt());
        let signals: Vec<&[f64]> = pieces.iter().map(|piece| piece.q[j].as_slice()).collect();
        let found = band(&signals, usual_s, position_noise(q).max(rounding))?;
        Some(Band { stretches_hz, ..found })
    };
    (0..log.q.len()).into_par_iter().filter_map(of_joint).collect::<Vec<_>>().into_iter().reduce(Band::fastest)
}

/// Half of the time is in stretches at least this long \[s\]; none without stretches.
fn median_length_s(pieces: &[Log]) -> Option<f64> {
    let mut lengths: Vec<f64> = pieces.iter().map(Log::duration_s).collect();
    lengths.sort_by(f64::total_cmp);
    let half = 0.5 * lengths.iter().sum::<f64>();
    let mut sum = 0.0;
    lengths.into_iter().find(|length| {
        sum += length;
        sum >= half
    })
}

/// Mean square of signals below a frequency, without the ends that a filter of `lowest_hz` colours: the same rows for every frequency.
///
/// A filter continues a record beyond its ends by its first and last samples. The noise of those two would enter all of that, so a cosine
/// takes the ends to 0 before.
fn power_below(hz: f64, lowest_hz: f64, signals: &[Vec<f64>], period_s: f64) -> f64 {
    let transient = ZeroPhase::new(lowest_hz, BAND_ORDER, period_s).edge();
    let filter = ZeroPhase::new(hz, BAND_ORDER, period_s);
    let squares = |signal: &Vec<f64>| {
        let mut signal = signal.clone();
        let edge = transient.min(signal.len() / 4);
        taper(&mut signal, edge);
        filter.apply(&mut signal);
        let inner = &signal[edge..signal.len() - edge];
        (inner.iter().map(|x| x * x).sum::<f64>(), inner.len())
    };
    let (sum, count) = signals.iter().map(squares).fold((0.0, 0), |all, one| (all.0 + one.0, all.1 + one.1));
    sum / count.max(1) as f64
}

/// Multiplies the first and last `edge` samples by half a period of a cosine, from 0 at the ends to 1.
fn taper(signal: &mut [f64], edge: usize) {
    let last = signal.len().saturating_sub(1);
    for k in 0..edge {
        let weight = 0.5 - 0.5 * (0.5 * TAU * k as f64 / edge as f64).cos();
        signal[k] *= weight;
        signal[last - k] *= weight;
    }
}

/// Bandwidth of one joint's motion, and up to where its accelerations stand out of the noise; none where noise is all there is.
///
/// * `stretches`: positions \[rad\], `period_s` apart \[s\]
/// * `noise`: standard deviation of a position \[rad\]
fn band(stretches: &[&[f64]], period_s: f64, noise: f64) -> Option<Band> {
    let highest = HIGHEST_BAND_HZ.min(MAX_BAND_OVER_RATE / period_s);
    let count = (BANDS_PER_OCTAVE * (highest / LOWEST_BAND_HZ).log2()).floor().max(0.0) as usize + 1;
    let longest_s = stretches.iter().map(|q| q.len()).max()? as f64 * period_s;
    // The first band holds everything below it.
    let edges: Vec<f64> = (0..count)
        .map(|k| LOWEST_BAND_HZ * 2.0_f64.powf(k as f64 / BANDS_PER_OCTAVE))
        .filter(|hz| hz * longest_s >= PERIODS_PER_RECORD)
        .collect();
    let motions: Vec<Trajectory> =
        stretches.iter().map(|q| Trajectory::from_positions(&[q.to_vec()], period_s)).collect();
    let speeds: Vec<Vec<f64>> = motions.iter().map(|motion| motion.qd[0].clone()).collect();
    let density = 2.0 * period_s * noise * noise;
    let (mut below, mut from, mut motion) = (0.0, 0.0_f64, Vec::new());
    for hz in &edges {
        let power = power_below(*hz, edges[0], &speeds, period_s);
        let (speed, noise) = ((power - below).max(0.0), density * TAU.powi(2) * (hz.powi(3) - from.powi(3)) / 3.0);
        motion.push(if speed > MOTION_OVER_NOISE * noise { speed - noise } else { 0.0 });
        (below, from) = (power, *hz);
    }
    let all: f64 = motion.iter().sum();
    let mut sum = 0.0;
    let reaches = |speed: &f64| {
        sum += speed;
        sum >= MOTION_SHARE * all
    };
    let motion_hz = *edges.get(motion.iter().position(reaches)?)?;
    if all <= 0.0 {
        return None;
    }
    let accelerations: Vec<Vec<f64>> = motions.into_iter().map(|mut motion| motion.qdd.remove(0)).collect();
    let acceleration = power_below(motion_hz, edges[0], &accelerations, period_s);
    let largest_noise = MAX_NOISE_OVER_ACCELERATION.powi(2) * acceleration;
    let noise_hz = (5.0 * largest_noise / (density * TAU.powi(4))).powf(0.2);
    let noise_hz = if density > 0.0 { noise_hz } else { f64::INFINITY };
    Some(Band { motion_hz, noise_hz, stretches_hz: 0.0 })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(hz: f64, period_s: f64, step: f64) -> Vec<f64> {
        let position = |k: usize| 0.5 * (TAU * hz * k as f64 * period_s).sin();
        let round = |q: f64| if step > 0.0 { (q / step).round() * step } else { q };
        (0..(20.0 / period_s) as usize).map(|k| round(position(k))).collect()
    }

    /// The band filter passes `MOTION_SHARE` of the power of a wave from 1.58 times its frequency on: `(1 + (f/fc)^8)^-2 = 0.95`. The next edge of a
    /// band is at most a quarter of an octave above that.
    #[test]
    fn bandwidth_follows_the_motion_not_the_encoder_steps() {
        let most = 1.58 * 2.0_f64.powf(1.0 / BANDS_PER_OCTAVE);
        for (period_s, step) in [(0.01, 0.0), (0.01, 4e-4), (0.002, 4e-4), (0.001, 1e-4)] {
            let noise = step / 12.0_f64.sqrt();
            for hz in [0.5, 1.5, 4.0] {
                let found = band(&[&wave(hz, period_s, step)], period_s, noise).expect("motion").motion_hz;
                assert!((hz..most * hz).contains(&found), "{hz} Hz, {period_s} s, {step} rad: {found}");
            }
        }
    }

    #[test]
    fn noise_alone_widens_no_bandwidth() {
        // A linear congruential generator: white enough for a band's variance.
        let mut state = 1_u64;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        let noise: Vec<f64> = (0..20_000).map(|_| 1e-3 * next()).collect();
        let found = band(&[&noise], 0.002, 1e-3 / 12.0_f64.sqrt());
        assert!(found.is_none_or(|found| found.motion_hz <= LOWEST_BAND_HZ), "{found:?}");
    }

    /// White noise of variance σ² has below f accelerations of variance 2·T·σ²·(2π)⁴·f⁵/5; that of the motion is known.
    #[test]
    fn coarse_positions_bound_the_band_of_accelerations() {
        for (hz, period_s, step) in [(0.3, 0.01, 0.05), (0.5, 0.01, 0.05), (0.3, 0.004, 0.02)] {
            let noise = step / 12.0_f64.sqrt();
            let acceleration: f64 = 0.5 * (TAU * hz).powi(2) / 2.0_f64.sqrt();
            let density = 2.0 * period_s * noise * noise * TAU.powi(4);
            let expected = (5.0 * acceleration.powi(2) / density).powf(0.2);
            let found = band(&[&wave(hz, period_s, step)], period_s, noise).expect("motion").noise_hz;
            assert!(
                (found / expected - 1.0).abs() < 0.15,
                "{hz} Hz, {period_s} s, {step} rad: {found} of {expected} Hz"
            );
        }
    }

    #[test]
    fn noisy_accelerations_and_slow_logs_lower_the_cutoff() {
        let motion = Band { motion_hz: 10.0, noise_hz: f64::INFINITY, stretches_hz: 0.0 };
        let choose = |band: Band, rate_hz: f64| FilterChoice::new(band, 0.0, rate_hz);
        let [fast, slow] = [500.0, 100.0].map(|rate_hz| choose(motion, rate_hz));
        assert_eq!((fast.cutoff_hz, fast.limit), (20.0, Limit::Motion));
        assert_eq!((slow.cutoff_hz, slow.limit), (6.0, Limit::Rate));
        let noisy = choose(Band { noise_hz: 7.0, ..motion }, 500.0);
        assert_eq!((noisy.cutoff_hz, noisy.limit), (7.0, Limit::Noise));
    }

    #[test]
    fn a_short_log_keeps_enough_equations() {
        let motion = Band { motion_hz: 1.0, noise_hz: f64::INFINITY, stretches_hz: 0.0 };
        let [long, short] = [1.0, 15.0].map(|equations_hz| FilterChoice::new(motion, equations_hz, 1000.0));
        assert_eq!((long.cutoff_hz, long.limit), (5.0, Limit::Lowest));
        assert_eq!((short.cutoff_hz, short.limit), (15.0, Limit::Equations));
        let cut = FilterChoice::new(Band { stretches_hz: 12.0, ..motion }, 1.0, 1000.0);
        assert_eq!((cut.cutoff_hz, cut.limit), (12.0, Limit::Stretches));
    }
}
