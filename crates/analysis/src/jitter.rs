//! What is left of jitter in the time of a log's rows, as torque: speed times what a row is off is noise of its position, second
//! differences of which are torque of what the joint moves.

use std::ops::RangeInclusive;

use anyhow::{Context, Result};
use rivet_config::Robot;
use rivet_estimation::offline::{Trajectory, predict};
use rivet_logs::{Log, interpolate};

use crate::evidence::Distrust;
use crate::runs::{self, Piece};
use crate::table::number;

/// Worth a warning is what makes so much of a joint's torque, ...
const OF_TORQUE: f64 = 0.02;
/// ... and so large a part of what the fit leaves of it. What is many times as large is not in the data: the stamps are right.
const OF_RESIDUAL: RangeInclusive<f64> = 0.15..=10.0;
/// Rows are dropped behind a low-pass if the grid is so many times as coarse as the log.
const LOW_PASS: f64 = 1.1;

const NAME: &str = "time_stamps_jitter";

/// Logs whose rows are off their time by so much that it counts beside what the fit leaves; `residuals`: per joint, in percent of torque.
pub(crate) fn warnings(robot: &Robot, values: &[f64], residuals: &[f64], pieces: &[&Piece]) -> Result<Vec<Distrust>> {
    let mut found: Vec<Distrust> = Vec::new();
    for piece in pieces.iter().filter(|piece| piece.report.off_s > 0.0) {
        let log = runs::short_name(&piece.grid.path);
        // Once for the pieces of a log.
        if found.iter().any(|d| d.log.as_ref() == Some(&log)) {
            continue;
        }
        let shares = shares(robot, values, piece).with_context(|| piece.grid.path.display().to_string())?;
        let counts = |(share, residual): &(&f64, &f64)| {
            **share > OF_TORQUE && OF_RESIDUAL.contains(&(100.0 * **share / **residual))
        };
        let names = runs::joint_names(robot);
        let each: Vec<String> = shares
            .iter()
            .zip(residuals)
            .zip(&names)
            .filter(|(pair, _)| counts(pair))
            .map(|((share, left), name)| format!("{name} {} of {}", number(100.0 * share, 2), number(*left, 2)))
            .collect();
        if each.is_empty() {
            continue;
        }
        let text = format!(
            "by their positions, rows differ from their time stamps by {} ms, and an even clock would not correct \
             it: speed and acceleration are wrong. The torque error, as a part of the residual in %, is {}; IV and \
             LS are less certain than their standard deviations. Take t from the robot's own clock, not from the \
             arrival of a row",
            number(1e3 * piece.report.off_s, 2),
            each.join(", ")
        );
        found.push(Distrust { log: Some(log), joint: None, name: NAME, text });
    }
    Ok(found)
}

/// What jumps of positions may come from in a log whose stamps jitter and were not taken.
pub(crate) fn out_of_order(log: &Log, jumps: bool) -> Option<Distrust> {
    let jitter_s = log.stamps_jitter_s().filter(|_| jumps)?;
    let text = format!(
        "time stamps jitter by {} ms, {:.0} % of a step; positions are even and taken as even, but rows in the order of such stamps are not \
         in that in which they were sampled, and where positions jump it may be no more than that: log rows in the order in which they \
         came, or a counter of samples",
        number(1e3 * jitter_s, 2),
        100.0 * jitter_s / log.median_step_s()
    );
    Some(Distrust { log: Some(runs::short_name(&log.path)), joint: None, name: NAME, text })
}

/// Torque by what the rows of a piece are off, over all torque, per joint: the model along the motion with such noise, and without.
fn shares(robot: &Robot, values: &[f64], piece: &Piece) -> Result<Vec<f64>> {
    let (period_s, signal) = (piece.report.period_s, &robot.config.signal);
    let filter = runs::model_filter(robot, period_s);
    let motion = Trajectory::from_positions(&piece.grid.q, period_s);
    let (step_s, off_s, grid) = (piece.report.median_step_s, piece.report.off_s, &piece.grid.t);
    let shifted = |(q, qd): (&Vec<f64>, &Vec<f64>)| -> Vec<f64> {
        let shift = if period_s > LOW_PASS * step_s {
            // Where rows are dropped behind a low-pass, noise goes with them.
            let kept = (step_s / period_s).sqrt();
            white(grid.len()).iter().zip(qd).map(|(random, qd)| kept * off_s * qd * random).collect()
        } else {
            // Two rows at nearly the same time make much of little: the curve through them is taken.
            let speed = interpolate(grid, qd, &piece.logged_t);
            let off: Vec<f64> = white(speed.len()).iter().zip(&speed).map(|(random, qd)| off_s * qd * random).collect();
            interpolate(&piece.logged_t, &off, grid)
        };
        q.iter().zip(&shift).map(|(q, shift)| q + shift).collect()
    };
    let positions: Vec<Vec<f64>> = motion.q.iter().zip(&motion.qd).map(shifted).collect();
    let along = |motion: &Trajectory| predict(&robot.model, &robot.base, values, motion, &filter);
    let (exact, off) = (along(&motion)?, along(&Trajectory::from_positions(&positions, period_s))?);
    let mut speed = motion.qd;
    for speed in &mut speed {
        filter.apply(speed);
    }
    let range = rivet_estimation::offline::moving_range(&speed, &signal.dead_zone, filter.edge())
        .unwrap_or(0..piece.grid.len());
    let square = |x: &mut dyn Iterator<Item = f64>| x.map(|x| x * x).sum::<f64>();
    let error_share = |(j, tau): (usize, &Vec<f64>)| {
        let mut tau = tau.clone();
        filter.apply(&mut tau);
        let all = square(&mut tau[range.clone()].iter().copied());
        let wrong = square(&mut range.clone().map(|k| off[j][k] - exact[j][k]));
        (wrong / all.max(f64::MIN_POSITIVE)).sqrt()
    };
    Ok(piece.grid.torque()?.iter().enumerate().map(error_share).collect())
}

/// White noise of a mean square of one, the same in every run.
fn white(rows: usize) -> Vec<f64> {
    let mut state = 1_u64;
    let mut next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        3.0_f64.sqrt() * ((state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0)
    };
    (0..rows).map(|_| next()).collect()
}
