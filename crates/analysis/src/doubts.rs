//! What a fit cannot have told, by the rows it was made of and what it leaves of them: too little motion, a constant, another arm
//! half-way, torque that no value explains.

use anyhow::Result;
use rivet_config::Robot;
use rivet_estimation::consistency::{FAR_PERCENT, Projection};
use rivet_estimation::offline::{self, Constant, Equations, Fit, OfflineError, Parts, Rows, constant_torque, one_way};
use rivet_logs::Log;

use crate::channels;
use crate::evidence::{self, BRIEF_NAME, Distrust, STILL_NAME, UNEXPLAINED_NAME};
use crate::rows;
use crate::runs;
use crate::table::number;

/// Of a joint's torque, what the fit may leave \[%\] and still be said to explain some of it, and to explain it.
const EXPLAINS_NOTHING: f64 = 90.0;
const EXPLAINS: f64 = 70.0;

/// Torque channels of a log that are implausible by themselves or by the nominal model.
pub fn doubted(robot: &Robot, log: &Log) -> Result<Vec<Distrust>> {
    let distrust_of = |(j, text): (usize, String)| {
        let joint = Some(robot.model.arm.joints[j].name.clone());
        Distrust { log: None, joint, name: "torque_constant", text }
    };
    let mut found: Vec<Distrust> = channels::constant(robot, log)?.into_iter().map(distrust_of).collect();
    if !found.is_empty() {
        return Ok(found);
    }
    found = channels::clipped(robot, log)?;
    // A log without rows, as where nothing moves, says nothing here; what learns from it says why.
    if let Ok(taken) = rows::rows_without_plan(robot, log) {
        found.extend(evidence::of_torque(robot, taken.rows.iter().map(|rows| (runs::short_name(&log.path), rows))));
    }
    Ok(found)
}

/// Joints of whose torque the fit leaves most, given what it leaves of each \[%\].
pub fn unexplained(names: &[String], left: &[f64]) -> Vec<Distrust> {
    let is_it = "is it the torque of this joint, and of this motion?";
    let distrust_of = |(name, left): (&String, &f64)| Distrust {
        log: None,
        joint: Some(name.clone()),
        name: UNEXPLAINED_NAME,
        text: if *left > EXPLAINS_NOTHING {
            format!(
                "the model explains hardly anything of this torque (residual above {EXPLAINS_NOTHING:.0} %): its \
                 parameters mean nothing, whatever their standard deviations; {is_it}"
            )
        } else {
            format!(
                "the model explains little of this torque (residual above {EXPLAINS:.0} %): its parameters include \
                 the effect of something else; {is_it}"
            )
        },
    };
    names.iter().zip(left).filter(|(_, left)| **left > EXPLAINS).map(distrust_of).collect()
}

/// Of a joint's torque, instruments leave this many times what least squares leave where they do not stand for its motion.
const MISLEADS: f64 = 1.5;
/// ... and this much more \[%\]: below it is noise.
const MISLEADS_BY: f64 = 2.0;

/// Joints of whose torque the fit by instruments leaves more than the robot file's values, and far more than least squares; `left` \[%\]:
/// nominal, least squares, instruments.
pub(crate) fn misled(names: &[String], [nominal, least_squares, instruments]: &[Vec<f64>; 3]) -> Option<Distrust> {
    let more = |than: f64, j: &usize| instruments[*j] > (MISLEADS * than).max(than + MISLEADS_BY);
    let is = |j: &usize| instruments[*j] > nominal[*j] && more(least_squares[*j], j);
    let joints: Vec<&str> = (0..names.len()).filter(is).map(|j| names[j].as_str()).collect();
    (!joints.is_empty()).then(|| Distrust {
        log: None,
        joint: None,
        name: "instruments_mislead",
        text: format!(
            "on {} the values found by instruments miss more torque than those of the robot file, and far more than least squares: the \
             instruments do not stand for this motion. Record the desired motion, choose others (instruments, delay_s), or kind = \"rls\"",
            joints.join(", ")
        ),
    })
}

/// Independent equations for each value below which deviations are told too small: of a UR10e's motion cut to 0.5, 1, 2 s (0.6, 1.2, 2.5 of
/// them) 66, 81 and 98 % of the values lay within two.
const INDEPENDENT: f64 = 2.0;

/// Whether the motion is so short that the fit follows whatever it holds: below f a second has 2·f independent equations a joint.
pub(crate) fn short(robot: &Robot, rows: &[Rows]) -> Option<Distrust> {
    let seconds: f64 = rows.iter().map(|r| (0..robot.dof()).map(|j| r.seconds_of(j)).sum::<f64>()).sum();
    let (hz, values) = (robot.config.signal.model_filter_hz, robot.base.len() as f64);
    let equations = 2.0 * hz * seconds;
    (equations < INDEPENDENT * values).then(|| Distrust {
        log: None,
        joint: None,
        name: "little_motion",
        text: format!(
            "{} s of motion below {hz} Hz are {equations:.0} independent equations for {values} values: the fit \
             follows their noise, and standard deviations are too small",
            number(seconds / robot.dof() as f64, 2)
        ),
    })
}

/// Two fits that leave so much of the squares of one, on some joint, are of two arms. Of measured runs in which nothing changed they leave 0.48
/// and more; a load picked up, a gain or a temperature left 0.001 to 0.24.
const OF_TWO: f64 = 0.3;
/// Values of one side leave so many times as much of the other as the fit of both where that side tells them; more where it does not, and
/// then two fits leave little because they are free. Of a change in the middle it is 4.
const TELLS_OTHER: f64 = 10.0;

/// Whether the arm of the first rows is that of the last; `said`: of joints, already.
pub(crate) fn changed(names: &[String], parts: &Parts, said: &[Distrust]) -> Option<Distrust> {
    let cut = parts.cut.as_ref()?;
    // Of a torque that is not believed anyway it is no news.
    let news = |j: usize| !said.iter().any(|d| d.joint.as_ref() == Some(&names[j]));
    let is = |j: &usize| cut.left[*j] < OF_TWO && cut.across[*j] < TELLS_OTHER && news(*j);
    let two: Vec<usize> = (0..names.len()).filter(is).collect();
    let joints: Vec<&str> = two.iter().map(|j| names[*j].as_str()).collect();
    let least = two.iter().map(|j| cut.left[*j]).fold(f64::INFINITY, f64::min);
    (!joints.is_empty()).then(|| Distrust {
        log: None,
        joint: None,
        name: "arm_changes",
        text: format!(
            "on {} the first {:.0} % of the motion and the rest are not of one arm: found apart, values leave {} of the squares that these \
             leave. Was a load picked up, did it warm up, did a gain change? What is found here is of neither",
            joints.join(", "),
            100.0 * cut.at,
            number(least, 1),
        ),
    })
}

/// Values that miss other motion so many times as much as those of the file are not worth having ...
const WORSE: f64 = 1.5;
/// ... by more than this \[%\].
const WORSE_BY: f64 = 2.0;

/// Joints of whose torque values miss more than those of the robot file do, with both \[%\].
pub fn missing_more(names: &[String], nominal: &[f64], found: &[f64]) -> Vec<String> {
    let is = |j: &usize| found[*j] > (WORSE * nominal[*j]).max(nominal[*j] + WORSE_BY);
    (0..names.len()).filter(is).map(|j| format!("{} {:.0} for {:.0} %", names[j], found[j], nominal[j])).collect()
}

/// That values from some of the rows miss the others by more than the file's do; `nominal`, `left_out` \[%\].
pub(crate) fn carries_not_over(names: &[String], nominal: &[f64], left_out: &[f64]) -> Option<Distrust> {
    let joints = missing_more(names, nominal, left_out);
    (!joints.is_empty()).then(|| Distrust {
        log: None,
        joint: None,
        name: "carries_not_over",
        text: format!(
            "values found from three quarters of the motion miss the fourth by more than those of the robot file ({}): too little motion, or \
             effects that the model lacks. Do not use them on another motion",
            joints.join(", ")
        ),
    })
}

/// A constant torque that the model leaves out is worth a word from this many of its deviations on...
const CONSTANT_DEVIATIONS: f64 = 5.0;
/// ... where it is this share of the noise that the fit leaves: below it bodies hardly take any of it up.
const CONSTANT_NOISE: f64 = 0.5;

/// Joints whose torque has a constant part while the robot file gives the model none.
pub(crate) fn constant(
    robot: &Robot,
    (rows, equations): (&[Rows], &Equations<'_>),
    nominal: &[f64],
    prior: f64,
    fit: &Fit,
) -> Result<Vec<Distrust>, OfflineError> {
    if robot.model.structure.offset {
        return Ok(Vec::new());
    }
    let constants = constant_torque(equations, nominal, prior, fit)?;
    let turns = one_way(&robot.model, &robot.base, rows);
    let matters = |(j, found): (usize, Option<Constant>)| {
        // Of a joint that turns one way it is Coulomb friction as well.
        let Constant { torque, std } = found.filter(|_| !turns[j])?;
        let least = (CONSTANT_DEVIATIONS * std).max(CONSTANT_NOISE * fit.noise[j]);
        (torque.abs() > least).then(|| Distrust {
            log: None,
            joint: Some(robot.model.arm.joints[j].name.clone()),
            name: "constant_torque",
            text: format!(
                "torque has a constant part that the model has not, or what the model lacks looks like one ({} +- {} N m, one std): \
                 values of bodies take it up; offsets = true in [estimator] finds it as such",
                number(torque, 2),
                number(std, 1)
            ),
        })
    };
    Ok(constants.into_iter().enumerate().filter_map(matters).collect())
}

/// Joints (from 0) that move too briefly beside others to be learnt from.
pub(crate) fn brief(robot: &Robot, rows: &[Rows]) -> Vec<Distrust> {
    let distrust_of = |j: usize| Distrust {
        log: None,
        joint: Some(robot.model.arm.joints[j].name.clone()),
        name: BRIEF_NAME,
        text: format!(
            "moves for {} s only, too short compared with the others to determine its noise: its rows are not used, \
             rotor inertia and friction stay nominal",
            number(rows.iter().map(|r| r.seconds_of(j)).sum(), 2)
        ),
    };
    offline::brief(rows).into_iter().map(distrust_of).collect()
}

/// Consistent parameters whose torque is another one.
pub(crate) fn far(consistent: Option<&Projection>) -> Option<Distrust> {
    let percent = consistent?.torque_percent;
    (percent > FAR_PERCENT).then(|| Distrust {
        log: None,
        joint: None,
        name: "consistent_far",
        text: format!(
            "no arm that can be built has this torque: the nearest misses it by {} %. What --export writes as bodies and drives is that one; \
             the values found are under [identified]",
            number(percent, 2)
        ),
    })
}

/// Joints that do not move in any log.
pub(crate) fn still(robot: &Robot, joints: &[usize]) -> impl Iterator<Item = Distrust> {
    let distrust_of = |j: &usize| {
        Distrust {
        log: None,
        joint: Some(robot.model.arm.joints[*j].name.clone()),
        name: STILL_NAME,
        text: "no motion in these logs beyond the dead zone: rotor inertia and friction stay nominal, and its torque in motion is not \
               determined".to_owned(),
    }
    };
    joints.iter().map(distrust_of)
}
