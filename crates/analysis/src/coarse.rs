//! Positions too coarse for what is made of them: in steps or with noise, which are smoothed before differences are taken, or too far apart.

use std::path::PathBuf;

use rayon::prelude::*;
use rivet_config::Robot;
use rivet_estimation::offline::{Record, ZeroPhase, position_noise, position_step, told_up_to_hz};
use rivet_logs::Log;

use crate::evidence::{COARSE_NAME, Distrust, NOISY_NAME, TORQUE_STEPS_NAME};
use crate::runs;
use crate::table::number;

/// Positions keep what is slower than so many times the cut-off of the model filter, whatever their noise is: the model is told
/// apart in that band.
const LEAST_BAND: f64 = 2.0;
/// Positions are too coarse where a speed, by differences of theirs, is off by more than this share of the joint's dead zone (one
/// standard deviation): then rows that count have no direction.
const OF_DEAD_ZONE: f64 = 0.5;
/// Where friction goes by the load of the gear, they are too coarse where an acceleration, by second differences, is off by more than this
/// share of what the joint usually has: the load's size counts noise as load, which no filter takes out of the column later.
const OF_ACCELERATION: f64 = 0.1;
/// Rows come at so many times the cut-off of the model filter: a central difference then keeps sin(x)/x of a speed at the cut-off, 0.64 of it.
const LEAST_RATE: f64 = 4.0;
/// Readings are noisy where they are off by more than so many times what the joint moves in the jitter of the stamps.
const BEYOND_JITTER: f64 = 2.0;
/// ... and more than so many times what their steps make of a reading.
const BEYOND_STEPS: f64 = 2.0;
/// A low-pass beyond this share of the sample rate takes nothing away.
const ALL: f64 = 0.4;

/// What positions of a joint are off by.
enum Off {
    /// Steps \[rad\].
    Steps(f64),
    /// White noise \[rad\], one standard deviation.
    Noise(f64),
}

/// What they are too coarse for.
enum For {
    /// The direction of friction near standstill.
    Direction,
    /// The load that friction goes by.
    Load,
}

/// What is to be done about the steps and the noise of a log.
pub(crate) struct Coarse {
    /// Joints (from 0) that are too coarse.
    joints: Vec<(usize, Off, For)>,
    /// Motion and torque are kept up to this \[Hz\].
    hz: f64,
    /// Up to where speeds are good enough, which may be less \[Hz\].
    told_hz: f64,
    log: String,
}

/// Looks at the positions of a log, row by row as logged. None where they are fine enough.
pub(crate) fn coarse(robot: &Robot, log: &Log) -> Option<Coarse> {
    let (period_s, signal) = (log.median_step_s(), &robot.config.signal);
    let velocity = robot.model.structure.sign_velocity;
    let least_hz = LEAST_BAND * signal.model_filter_hz;
    let coarse_joint = |(j, q): (usize, &Vec<f64>)| {
        let noise = position_noise(q);
        // A row that comes early or late is no noise: its stamp says so.
        let noise = if noise > BEYOND_JITTER * between_rows(&log.t, q, period_s) { noise } else { 0.0 };
        // Digits of a log are steps as well, most of them finer than its noise.
        let (off, noise) = match position_step(q).map(|step| (step, step / 12.0_f64.sqrt())) {
            Some((step, rounding)) if noise < BEYOND_STEPS * rounding => (Off::Steps(step), rounding),
            _ => (Off::Noise(noise), noise),
        };
        // Of a central difference, and of a second one.
        let speed = noise / (2.0_f64.sqrt() * period_s);
        let acceleration = 6.0_f64.sqrt() * noise / (period_s * period_s);
        if velocity > 0.0 && speed > OF_DEAD_ZONE * signal.dead_zone[j] {
            return Some((j, off, For::Direction, told_up_to_hz(noise, period_s, velocity)));
        }
        let by_load = robot.model.structure.load_friction && acceleration > 0.0;
        (by_load && acceleration > OF_ACCELERATION * usual_acceleration(q, period_s, signal.model_filter_hz))
            .then_some((j, off, For::Load, least_hz))
    };
    let found: Vec<(usize, Off, For, f64)> = log.q.par_iter().enumerate().filter_map(coarse_joint).collect();
    let told_hz = found.iter().map(|(.., hz)| *hz).reduce(f64::min)?;
    let hz = told_hz.max(least_hz);
    let joints = found.into_iter().map(|(j, off, what_for, _)| (j, off, what_for)).collect();
    (hz < ALL / period_s).then(|| Coarse { joints, hz, told_hz, log: runs::short_name(&log.path) })
}

/// What a joint's acceleration usually is \[rad/s²\], root mean square, by second differences so far apart that they have next to no noise: a
/// quarter of a period at the cut-off of the model filter.
fn usual_acceleration(q: &[f64], period_s: f64, filter_hz: f64) -> f64 {
    let lag = ((0.25 / (filter_hz * period_s)).round() as usize).max(1);
    let square = |w: &[f64]| (w[0] - 2.0 * w[lag] + w[2 * lag]).powi(2);
    let squares: f64 = q.windows(2 * lag + 1).map(square).sum();
    (squares / q.len().saturating_sub(2 * lag).max(1) as f64).sqrt() / (lag as f64 * period_s).powi(2)
}

/// By how much a joint moves in what the log's steps differ from the usual one: root mean square \[rad\].
fn between_rows(t: &[f64], q: &[f64], period_s: f64) -> f64 {
    let squares = t.windows(2).zip(q.windows(2)).map(|(t, q)| {
        let step = t[1] - t[0];
        ((q[1] - q[0]) * (step - period_s) / step).powi(2)
    });
    (squares.sum::<f64>() / q.len().max(1) as f64).sqrt()
}

/// Of a log whose rows are too far apart for the band of the model filter, that they are.
pub(crate) fn slow(robot: &Robot, log: &Log) -> Option<Distrust> {
    let (rate_hz, filter_hz) = (1.0 / log.median_step_s(), robot.config.signal.model_filter_hz);
    (rate_hz < LEAST_RATE * filter_hz).then(|| Distrust {
        log: Some(runs::short_name(&log.path)),
        joint: None,
        name: "rows_far_apart",
        text: format!(
            "rows come at {} Hz, and differences of theirs are wrong by a third and more up to the {filter_hz} Hz of the model filter: log faster, or \
             set signal.model_filter_hz to {} at most",
            number(rate_hz, 3),
            number(rate_hz / LEAST_RATE, 2)
        ),
    })
}

/// Torque of a joint of a log that comes in steps which noise does not blur.
#[derive(Clone, Debug)]
pub struct TorqueSteps {
    /// The log.
    pub path: PathBuf,
    /// The joint (from 0).
    pub joint: usize,
    /// \[N·m\]
    pub step: f64,
    /// White noise beside the steps, one standard deviation \[N·m\].
    pub noise: f64,
}

/// Noise of less than this share of a step leaves its errors what the motion makes of them. With a third they pass for white.
pub(crate) const BLURS: f64 = 0.35;
/// ... and they are much of what a fit leaves where that is less than this share of a step (rounding is off by 0.29 of one).
const OF_STEP: f64 = 0.5;

/// Looks at the torques of a log, row by row as logged. A torque that hardly ever changes, as slow friction alone, has the step of another
/// joint where all of its values are multiples of that: they come by one channel.
pub fn torque_steps(log: &Log) -> Vec<TorqueSteps> {
    let Some((_, tau)) = &log.tau else { return Vec::new() };
    let own_steps: Vec<Option<f64>> = tau.par_iter().map(|tau| position_step(tau)).collect();
    let of_another = |tau: &[f64]| {
        // Nothing is a multiple of anything.
        let says = tau.iter().any(|x| *x != 0.0);
        let steps = own_steps.iter().flatten().filter(|step| says && tau.iter().all(|x| is_multiple(*x, **step)));
        steps.copied().reduce(f64::max)
    };
    let steps_of = |(joint, tau): (usize, &Vec<f64>)| {
        let step = own_steps[joint].or_else(|| of_another(tau))?;
        // Of rounding itself, where that is white, nothing is left.
        let noise = (position_noise(tau).powi(2) - step * step / 12.0).max(0.0).sqrt();
        (noise < BLURS * step).then(|| TorqueSteps { path: log.path.clone(), joint, step, noise })
    };
    tau.par_iter().enumerate().filter_map(steps_of).collect()
}

/// Rounding of numbers, in parts of a step.
const OFF: f64 = 1e-3;

fn is_multiple(x: f64, step: f64) -> bool {
    let steps = x / step;
    (steps - steps.round()).abs() < OFF
}

/// Those of which a fit that leaves so much of each joint's torque \[N·m\] is no surer than its rounding.
pub fn that_matter<'a>(steps: &'a [TorqueSteps], left: &[f64]) -> Vec<&'a TorqueSteps> {
    steps.iter().filter(|s| left[s.joint] < OF_STEP * s.step).collect()
}

/// What is known of the errors of rounding: off line, off line where they cannot be made again, and on line.
pub(crate) const ROUNDED_AGAIN: &str = "Standard deviations include the effect of this rounding, where the model fits";
pub(crate) const NOT_ROUNDED_AGAIN: &str = "Standard deviations do not include that and may be too small";
/// What standard deviations include of coarse torque on line.
pub const ROUNDED_ON_LINE: &str =
    "On line, standard deviations do not include that and may be too small (off line they include it)";

/// The same for people, with what standard deviations `know` of it.
pub fn coarse_torque(robot: &Robot, steps: &[&TorqueSteps], know: &str) -> Vec<Distrust> {
    let distrust_of = |TorqueSteps { path, joint, step, noise }: &&TorqueSteps| Distrust {
        log: Some(runs::short_name(path)),
        joint: Some(robot.model.arm.joints[*joint].name.clone()),
        name: TORQUE_STEPS_NAME,
        text: format!(
            "torque is quantised in steps of {} N m, with noise of {} N m (one std): rounding errors are then \
             correlated with the motion. {know}",
            number(*step, 2),
            number(*noise, 1)
        ),
    };
    steps.iter().map(distrust_of).collect()
}

impl Coarse {
    /// Smooths a record of the log: motion and torque alike, so that neither comes after the other.
    pub(crate) fn smooth(&self, robot: &Robot, record: &mut Record) {
        if let Some(filter) = self.filter(robot, record.period_s) {
            record.smooth(&filter);
        }
    }

    /// Smooths positions alone, where torque is looked at in a narrower band anyway.
    pub(crate) fn smooth_positions(&self, robot: &Robot, q: &mut [Vec<f64>], period_s: f64) {
        if let Some(filter) = self.filter(robot, period_s) {
            for q in q {
                filter.apply(q);
            }
        }
    }

    fn filter(&self, robot: &Robot, period_s: f64) -> Option<ZeroPhase> {
        (self.hz < ALL / period_s).then(|| ZeroPhase::new(self.hz, robot.config.signal.model_filter_order, period_s))
    }

    /// Joint by joint, for people and as JSON.
    pub(crate) fn distrusts(&self, robot: &Robot) -> Vec<Distrust> {
        // Speeds are off by as much as goes with the power 3/2 of the band.
        let over = (self.hz / self.told_hz).powf(1.5);
        let still = if over > 1.5 {
            format!(
                "; that leaves {} times as much noise in speeds as its direction needs, and bias in friction",
                number(over, 2)
            )
        } else {
            String::new()
        };
        let distrust_of = |(j, off, what_for): &(usize, Off, For)| {
            let (name, what) = match off {
                Off::Steps(step) => (COARSE_NAME, format!("positions come in steps of {} rad", number(*step, 2))),
                Off::Noise(noise) => {
                    (NOISY_NAME, format!("positions are noisy by {} rad (one std)", number(*noise, 1)))
                }
            };
            Distrust {
                log: Some(self.log.clone()),
                joint: Some(robot.model.arm.joints[*j].name.clone()),
                name,
                text: format!(
                    "{what}: what is faster than {} Hz is smoothed away before differences are taken, or {}",
                    number(self.hz, 2),
                    match what_for {
                        For::Direction => format!("near standstill speed would have no direction{still}"),
                        For::Load => "the load that its friction goes by would be noise".to_owned(),
                    }
                ),
            }
        };
        self.joints.iter().map(distrust_of).collect()
    }
}
