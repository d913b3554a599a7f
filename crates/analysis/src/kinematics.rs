//! Whether a log's joints are those of the robot file: another zero, sign or order may explain its torque far better.

use std::borrow::Cow;
use std::f64::consts::{FRAC_PI_2, PI};
use std::path::PathBuf;

use anyhow::Result;
use rayon::prelude::*;
use rivet_config::Robot;
use rivet_dynamics::JointKind;
use rivet_estimation::offline::{Rows, residual_squares};
use rivet_logs::Log;

use crate::evidence::Distrust;
use crate::fit::values_of;
use crate::rows::rows_of;
use crate::runs;
use crate::table::number;

/// Rows of all logs that are looked at, and how far they are apart at the least \[s\]: two score readings are tried, and what joints are read
/// for is no fast matter.
const MOST_ROWS: usize = 8_000;
const APART_S: f64 = 4e-3;
/// A reading is the right one where the fit leaves so many times as much, mean over joints ...
const FAR_LESS: f64 = 0.78;
/// ... of two joints at the least less than this, as what follows a joint is elsewhere as well, and of no joint more than that ...
const LESS: f64 = 0.85;
const NO_MORE: f64 = 1.05;
/// ... and the values of the robot file no more either ...
const OF_FILE: f64 = 0.97;
/// ... which is not asked where the fit leaves so little: the file may be as wrong as that ...
const SURELY: f64 = 0.5;
/// ... or where those leave so many times as much, and the fit no more. Of 500 measured and simulated logs, with loads, rough bodies and
/// effects that the model lacks, other readings left 0.82 times by both and 0.68 times by the file; wrong readings are at 0.05 to 0.6.
const FAR_LESS_OF_FILE: f64 = 0.62;
/// Readings that leave about as much are all said, but for more than so many.
const ALIKE: f64 = 1.05;
const MOST_SAID: usize = 3;

/// How the joints of a log may have to be read to be those of the robot file.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Reading {
    /// The zero of a joint is elsewhere by this angle \[rad\].
    Zero(usize, f64),
    /// A joint counts the other way round.
    Reversed(usize),
    /// Two joints are in each other's columns.
    Swapped(usize, usize),
    /// Joints are counted from the flange to the base.
    BackToFront,
    /// Positions are in the zero of the URDF already: what the file adds to those of logs is not to be added.
    WithoutZeros,
}

impl Reading {
    /// All that are tried.
    fn all(robot: &Robot) -> Vec<Reading> {
        let joints = &robot.model.arm.joints;
        let turns = |j: &usize| joints[*j].kind == JointKind::Revolute;
        let zeros = (0..joints.len())
            .filter(turns)
            .flat_map(|j| [FRAC_PI_2, -FRAC_PI_2, PI].map(|angle| Reading::Zero(j, angle)));
        let reversed = (0..joints.len()).map(Reading::Reversed);
        let pairs = (0..joints.len()).flat_map(|a| (a + 1..joints.len()).map(move |b| (a, b)));
        let swapped = pairs.filter(|(a, b)| joints[*a].kind == joints[*b].kind).map(|(a, b)| Reading::Swapped(a, b));
        // Of two joints that is the exchange.
        let order =
            (joints.len() > 2 && joints.iter().all(|j| j.kind == joints[0].kind)).then_some(Reading::BackToFront);
        // Of one joint that is another zero.
        let without = robot.config.log.joint_zero.iter().filter(|zero| **zero != 0.0).count() > 1;
        let without = without.then_some(Reading::WithoutZeros);
        zeros.chain(reversed).chain(swapped).chain(order).chain(without).collect()
    }

    /// The log read so.
    fn read(self, robot: &Robot, log: &Log) -> Log {
        let mut log = log.clone();
        let Log { q, tau, qd, q_des, qd_des, qdd_des, q_link, .. } = &mut log;
        let tau = tau.as_mut().map(|(_, tau)| tau);
        let mut turned = |j: usize, angle: f64| {
            let columns = [Some(&mut *q), q_des.as_mut()].into_iter().flatten().map(|signals| &mut signals[j]);
            columns.chain(&mut q_link[j]).flatten().for_each(|q| *q += angle);
        };
        match self {
            Reading::Zero(j, angle) => turned(j, angle),
            Reading::WithoutZeros => {
                robot.config.log.joint_zero.iter().enumerate().for_each(|(j, zero)| turned(j, -zero));
            }
            Reading::Reversed(j) => {
                let groups = [Some(q), tau, qd.as_mut(), q_des.as_mut(), qd_des.as_mut(), qdd_des.as_mut()];
                let columns = groups.into_iter().flatten().map(|signals| &mut signals[j]);
                columns.chain(&mut q_link[j]).flatten().for_each(|x| *x = -*x);
            }
            Reading::Swapped(a, b) => {
                let groups = [Some(q), tau, qd.as_mut(), q_des.as_mut(), qd_des.as_mut(), qdd_des.as_mut()];
                groups.into_iter().flatten().for_each(|signals| signals.swap(a, b));
                q_link.swap(a, b);
            }
            Reading::BackToFront => {
                let groups = [Some(q), tau, qd.as_mut(), q_des.as_mut(), qd_des.as_mut(), qdd_des.as_mut()];
                groups.into_iter().flatten().for_each(|signals| signals.reverse());
                q_link.reverse();
            }
        }
        log
    }

    /// The joint that it is about, if that is one.
    fn joint(self) -> Option<usize> {
        match self {
            Reading::Zero(j, _) | Reading::Reversed(j) => Some(j),
            Reading::Swapped(..) | Reading::BackToFront | Reading::WithoutZeros => None,
        }
    }

    fn text(self, robot: &Robot) -> String {
        let name = |j: usize| &robot.model.arm.joints[j].name;
        match self {
            Reading::Zero(j, angle) => format!("{:+.0} deg added to the positions of {}", angle.to_degrees(), name(j)),
            Reading::Reversed(j) => format!("{} counted the other way round", name(j)),
            Reading::Swapped(a, b) => format!("{} and {} in each other's columns", name(a), name(b)),
            Reading::BackToFront => "the joints counted from the flange to the base".to_owned(),
            Reading::WithoutZeros => "positions taken as logged, without the file's joint_zero".to_owned(),
        }
    }
}

/// The values of the robot file leave more than this of a joint's torque \[%\]: else nothing is asked.
const NOMINAL: f64 = 2.0;

/// Whether joints of the logs have to be read otherwise; `nominal`: what the values of the robot file leave of each joint's torque \[%\].
///
/// # Errors
/// A log that cannot be read (again).
pub fn misread(robot: &Robot, paths: &[PathBuf], nominal: &[f64]) -> Result<Option<Distrust>> {
    if nominal.iter().all(|percent| *percent <= NOMINAL || percent.is_nan()) {
        return Ok(None);
    }
    let mut logs: Vec<Log> = paths.iter().map(|path| runs::read_log(robot, path)).collect::<Result<_>>()?;
    let most = MOST_ROWS / logs.len().max(1);
    for log in &mut logs {
        let thinned = log.every((APART_S / log.median_step_s()).round() as usize);
        *log = thinned.slice(0..thinned.len().min(most));
    }
    Ok(better(robot, &logs).and_then(|found| distrust(robot, &found)))
}

/// What is left of the torque of each joint, as the root of squares.
struct Residuals {
    /// By the fit.
    fit: Vec<f64>,
    /// By the values of the robot file.
    nominal: Vec<f64>,
}

/// How many times as much is left of each joint as otherwise, and the mean of that.
fn times(left: &[f64], otherwise: &[f64]) -> (Vec<f64>, f64) {
    let each: Vec<f64> = left.iter().zip(otherwise).map(|(l, o)| l / o).collect();
    let mean = (each.iter().map(|ratio| ratio.ln()).sum::<f64>() / each.len().max(1) as f64).exp();
    (each, mean)
}

/// A reading with which far less is left.
struct Better {
    reading: Reading,
    /// What the fit and the values of the robot file leave, in parts of what they leave otherwise.
    fit: f64,
    nominal: f64,
}

impl Better {
    fn both(&self) -> f64 {
        self.fit * self.nominal
    }
}

/// Readings with which far less is left, best first.
fn better(robot: &Robot, logs: &[Log]) -> Option<Vec<Better>> {
    let given = residuals(robot, logs, None)?;
    let judge = |reading: Reading| {
        let read = residuals(robot, logs, Some(reading))?;
        let ((each, fit), (_, nominal)) = (times(&read.fit, &given.fit), times(&read.nominal, &given.nominal));
        let several = each.iter().filter(|ratio| **ratio < LESS).count() > 1;
        let by_fit = fit < FAR_LESS && (fit < SURELY || nominal < OF_FILE);
        let by_fit = by_fit && several && each.iter().all(|ratio| *ratio < NO_MORE);
        let by_file = nominal < FAR_LESS_OF_FILE && fit < NO_MORE;
        (by_fit || by_file).then_some(Better { reading, fit, nominal })
    };
    let mut found: Vec<Better> = Reading::all(robot).into_par_iter().filter_map(judge).collect();
    found.sort_by(|a, b| a.both().total_cmp(&b.both()));
    Some(found)
}

/// What is left of the logs read as given or otherwise. None where a joint does not move.
fn residuals(robot: &Robot, logs: &[Log], reading: Option<Reading>) -> Option<Residuals> {
    let mut rows: Vec<Rows> = Vec::new();
    for log in logs {
        let read = reading.map_or_else(|| Cow::Borrowed(log), |reading| Cow::Owned(reading.read(robot, log)));
        rows.extend(rows_of(robot, &read).ok()?.rows);
    }
    let rms_residuals = |rows: &[Rows], values: &[f64]| -> Option<Vec<f64>> {
        let squares = residual_squares(rows, values).into_iter();
        squares.map(|[error, torque]| (error > 0.0 && torque > 0.0).then(|| error.sqrt())).collect()
    };
    let nominal = rms_residuals(&rows, &robot.nominal_base)?;
    let values = values_of(robot, &mut rows).ok()?;
    Some(Residuals { fit: rms_residuals(&rows, &values)?, nominal })
}

fn distrust(robot: &Robot, found: &[Better]) -> Option<Distrust> {
    let first = found.first()?;
    let alike = found.iter().take_while(|other| other.both() < ALIKE * first.both()).take(MOST_SAID);
    let readings: Vec<String> = alike.map(|other| other.reading.text(robot)).collect();
    let several = readings.len() > 1;
    Some(Distrust {
        log: None,
        joint: first.reading.joint().filter(|_| !several).map(|j| robot.model.arm.joints[j].name.clone()),
        name: "joints_misread",
        text: format!(
            "with {}, the fit leaves {} times and the values of the robot file {} times as much of the torque (mean over joints): look at the \
             zero ([log] joint_zero), the sign and the order of the joints{}. What is found here means nothing, whatever its standard \
             deviation",
            readings.join(", or "),
            number(first.fit, 2),
            number(first.nominal, 2),
            if several { "; this motion does not separate these" } else { "" }
        ),
    })
}

/// The values of the robot file leave more than this of a joint's torque \[%\] ...
const ANOTHER: f64 = 40.0;
/// ... of every one of so many joints at the least. Of measured arms, with a load, rough bodies or no friction in the file, some joint
/// always has less: 39 where torque is in another unit (which is told as such), else 26.
const ANOTHER_JOINTS: usize = 4;

/// Whether the robot file may be that of another arm; `nominal`: what its values leave of each joint's torque \[%\]. Of a geared arm
/// friction is as much as that by itself: a file without any says nothing.
pub fn another_arm(robot: &Robot, nominal: &[f64]) -> Option<Distrust> {
    let friction = &robot.config.friction;
    if friction.coulomb.iter().chain(&friction.viscous).all(|value| *value == 0.0) {
        return None;
    }
    let known: Vec<f64> = nominal.iter().copied().filter(|percent| percent.is_finite()).collect();
    let least = known.iter().copied().fold(f64::INFINITY, f64::min);
    (known.len() >= ANOTHER_JOINTS && least > ANOTHER).then(|| Distrust {
        log: None,
        joint: None,
        name: "another_arm",
        text: format!(
            "the values of the robot file leave {least:.0} % and more of the torque of every joint: is it the file of another arm, or torque \
             in another unit? If its values are only rough, nothing is wrong"
        ),
    })
}
