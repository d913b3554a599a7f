//! Positions in steps that are too coarse for the direction of friction: smoothed before differences are taken, and said.

use rivet_config::Robot;
use rivet_estimation::offline::{Record, ZeroPhase, position_step, told_up_to_hz};
use rivet_logs::Log;

use crate::evidence::{COARSE_NAME, Distrust};
use crate::runs;
use crate::table::number;

/// Positions keep what is slower than so many times the cut-off of the model filter, whatever their steps are: the model is told
/// apart in that band.
const LEAST_BAND: f64 = 2.0;
/// Positions are too coarse where a speed, by differences of theirs, is off by more than this share of the joint's dead zone (one
/// standard deviation): then rows that count have no direction.
const OF_DEAD_ZONE: f64 = 0.5;
/// A low-pass beyond this share of the sample rate takes nothing away.
const ALL: f64 = 0.4;

/// What is to be done about the steps of a log.
pub(crate) struct Coarse {
    /// Joint (from 0) and step \[rad\], of those that are too coarse.
    joints: Vec<(usize, f64)>,
    /// Motion and torque are kept up to this \[Hz\].
    hz: f64,
    log: String,
}

/// Looks at the steps of a log, row by row as logged. None where they are fine enough.
pub(crate) fn coarse(robot: &Robot, log: &Log) -> Option<Coarse> {
    let (period_s, signal) = (log.median_step_s(), &robot.config.signal);
    let velocity = robot.model.structure.sign_velocity;
    let of = |(j, q): (usize, &Vec<f64>)| {
        let step = position_step(q)?;
        // Of a central difference, readings being off by step/√12 each.
        let off = step / 12.0_f64.sqrt() / (2.0_f64.sqrt() * period_s);
        (velocity > 0.0 && off > OF_DEAD_ZONE * signal.dead_zone[j])
            .then(|| (j, step, told_up_to_hz(step, period_s, velocity)))
    };
    let found: Vec<(usize, f64, f64)> = log.q.iter().enumerate().filter_map(of).collect();
    let hz = found.iter().map(|(.., hz)| *hz).reduce(f64::min)?.max(LEAST_BAND * signal.model_filter_hz);
    let joints = found.into_iter().map(|(j, step, _)| (j, step)).collect();
    (hz < ALL / period_s).then(|| Coarse { joints, hz, log: runs::short_name(&log.path) })
}

impl Coarse {
    /// Smooths a record of the log: motion and torque alike, so that neither comes after the other.
    pub(crate) fn smooth(&self, robot: &Robot, record: &mut Record) {
        if self.hz < ALL / record.period_s {
            record.smooth(&ZeroPhase::new(self.hz, robot.config.signal.model_filter_order, record.period_s));
        }
    }

    /// Joint by joint, for people and as JSON.
    pub(crate) fn said(&self, robot: &Robot) -> Vec<Distrust> {
        let of = |(j, step): &(usize, f64)| Distrust {
            log: Some(self.log.clone()),
            joint: Some(robot.model.arm.joints[*j].name.clone()),
            name: COARSE_NAME,
            text: format!(
                "positions come in steps of {} rad: positions and torque are smoothed to {} Hz before differences are taken, or near \
                 standstill speed would have no direction",
                number(*step, 2),
                number(self.hz, 2)
            ),
        };
        self.joints.iter().map(of).collect()
    }
}
