//! Readings of a log that no arm gives: taken back where they are whole turns, else left out, and said.

use std::borrow::Cow;
use std::ops::Range;

use anyhow::Result;
use rayon::prelude::*;
use rivet_config::Robot;
use rivet_dynamics::JointKind;
use rivet_estimation::offline::{Jumps, MOST_LEFT_OUT, Reach, beyond, dropouts, unwrap};
use rivet_logs::Log;

use crate::evidence::Distrust;
use crate::fault::Fault;
use crate::frozen;
use crate::runs;
use crate::sound::{Sound, reason};
use crate::stairs;
use crate::table::number;

/// Rows of a log that may be left out where a torque stood, as a share.
const MOST_STOOD: f64 = 0.5;
/// Positions that jump.
pub(crate) const JUMP_NAME: &str = "position_jump";
/// Angles that wrap.
pub(crate) const WRAPPED_NAME: &str = "position_wrapped";

/// # Errors
/// Where more than half of the rows would be left out, for what was `found`.
pub(crate) fn refuse_most(log: &Log, left_out: &[usize], found: &[Distrust]) -> Result<()> {
    if left_out.len() as f64 <= MOST_STOOD * log.len() as f64 {
        return Ok(());
    }
    let (file, rows) = (log.path.display(), share(left_out.len(), log.len()));
    Err(Fault::Data(format!(
        "{file}: {rows} would be excluded, more than half: {}; correct the log or use the part that is right",
        reason(found)
    ))
    .into())
}

/// A glitch is bridged where it takes no more rows than this: over more a joint may have turned.
const MOST_BRIDGED: usize = 5;

/// A log whose angles are unwrapped and whose glitches are bridged by a curve, so that every row stays; for commands that use
/// whole runs. Torque is as logged.
///
/// # Errors
/// Where more than a tenth of the rows would be bridged.
pub(crate) fn bridged(robot: &Robot, mut log: Log) -> Result<(Log, Vec<Distrust>)> {
    let (mut found, mut all) = (Vec::new(), Vec::new());
    for (j, joint) in robot.model.arm.joints.iter().enumerate() {
        let (Jumps { wraps, rows, farthest }, whole) = unwrap(&log.t, &log.q[j], reach(robot, j));
        let short = rows.chunk_by(|a, b| b - a == 1).all(|run| run.len() <= MOST_BRIDGED);
        if wraps.is_empty() && (rows.is_empty() || !short) {
            continue;
        }
        let mut q = whole.into_owned();
        let mut repairs = Vec::new();
        if let Some(first) = wraps.first() {
            let at = number(log.t[*first], 5);
            repairs.push((
                WRAPPED_NAME,
                format!("position wraps by a whole turn {} (first at {at} s) and is unwrapped", times(wraps.len())),
            ));
        }
        if let (Some(first), true) = (rows.first(), short) {
            bridge_positions(&log.t, &mut q, &rows);
            let at = number(log.t[*first], 5);
            let rows = share(rows.len(), log.len());
            repairs.push((
                JUMP_NAME,
                format!("position jumps by up to {} rad: {rows} (first at {at} s) bridged", number(farthest.abs(), 3)),
            ));
        }
        let (log_name, name) = (Some(runs::short_name(&log.path)), Some(joint.name.clone()));
        found.extend(repairs.into_iter().map(|(fault, text)| Distrust {
            log: log_name.clone(),
            joint: name.clone(),
            name: fault,
            text,
        }));
        log.q[j] = q;
        all.extend(rows);
    }
    all.sort_unstable();
    all.dedup();
    if all.len() as f64 > MOST_LEFT_OUT * log.len() as f64 {
        let (file, rows) = (log.path.display(), share(all.len(), log.len()));
        return Err(Fault::Data(format!(
            "{file}: {rows} cannot be true, more than a tenth: {}; mend the log or give the part that is sound",
            reason(&found)
        ))
        .into());
    }
    Ok((log, found))
}

/// Rows (ascending) at which a position of some joint cannot be true.
pub(crate) fn jumps(robot: &Robot, log: &Log) -> Vec<usize> {
    let jump_rows = |j: usize| unwrap(&log.t, &log.q[j], reach(robot, j)).0.rows;
    let mut rows: Vec<usize> = (0..log.q.len()).flat_map(jump_rows).collect();
    rows.sort_unstable();
    rows.dedup();
    rows
}

/// Positions over rows (ascending) by the cubic through the two rows before and the two behind.
fn bridge_positions(t: &[f64], q: &mut [f64], rows: &[usize]) {
    for run in rows.chunk_by(|a, b| b - a == 1) {
        let (first, last) = (run[0], run[run.len() - 1]);
        let is_sound = |k: &usize| rows.binary_search(k).is_err();
        let before: Vec<usize> = (0..first).rev().filter(is_sound).take(2).collect();
        let behind: Vec<usize> = (last + 1..q.len()).filter(is_sound).take(2).collect();
        let nodes: Vec<usize> = before.into_iter().chain(behind).collect();
        let values: Vec<f64> = nodes.iter().map(|k| q[*k]).collect();
        for k in run {
            // Lagrange's form; at an end of the log fewer rows make a polynomial of less degree.
            let weight = |a: usize| {
                let others = (0..nodes.len()).filter(|b| *b != a);
                others.map(|b| (t[*k] - t[nodes[b]]) / (t[nodes[a]] - t[nodes[b]])).product::<f64>()
            };
            q[*k] = (0..nodes.len()).map(|a| weight(a) * values[a]).sum();
        }
    }
}

fn reach(robot: &Robot, j: usize) -> Reach {
    let joint = &robot.model.arm.joints[j];
    Reach {
        speed: joint.velocity,
        resolution: robot.config.drive.encoder_resolution[j],
        revolute: joint.kind == JointKind::Revolute,
    }
}

/// Looks through the positions and torques of a log, row by row as logged.
pub(crate) fn screen<'a>(robot: &Robot, log: &'a Log) -> Result<Sound<'a>> {
    let joints = &robot.model.arm.joints;
    let mut sound = Sound { log: Cow::Borrowed(log), left_out: Vec::new(), repeated: None, found: Vec::new() };
    let mut say = |j: usize, name: &'static str, text: String| {
        let (log, joint) = (Some(runs::short_name(&log.path)), Some(joints[j].name.clone()));
        sound.found.push(Distrust { log, joint, name, text });
    };
    let mut left_out = Vec::new();
    let mut position = |j: usize, what: &str, (jumps, whole): Unwrapped<'_>| -> Option<Vec<f64>> {
        let Jumps { wraps, rows, farthest } = jumps;
        if let Some(first) = wraps.first() {
            let text = format!(
                "{what} wraps by a whole turn {} (first at {} s) and is unwrapped",
                times(wraps.len()),
                number(log.t[*first], 5)
            );
            say(j, WRAPPED_NAME, text);
        }
        if let Some(first) = rows.first() {
            let text = format!(
                "{what} jumps by up to {} rad: {} (first at {} s) excluded, and the log is cut there; a jump differs \
                 from the steps around it by more than 500 rad/s2, 12 times the usual, 4 encoder steps and 5 mrad",
                number(farthest.abs(), 3),
                share(rows.len(), log.len()),
                number(log.t[*first], 5)
            );
            say(j, JUMP_NAME, text);
        }
        left_out.extend(rows);
        (!wraps.is_empty()).then(|| whole.into_owned())
    };
    let looked_through: Vec<Looked<'_>> =
        (0..joints.len()).into_par_iter().map(|j| Looked::through(log, j, reach(robot, j), joints[j].effort)).collect();
    let mut torques = Vec::new();
    for (j, Looked { measured, second, desired, torque }) in looked_through.into_iter().enumerate() {
        torques.push(torque);
        if let Some(q) = position(j, "position", measured) {
            sound.log.to_mut().q[j] = q;
        }
        if let Some(q) = second.and_then(|link| position(j, "position of the second encoder", link)) {
            sound.log.to_mut().q_link[j] = Some(q);
        }
        // A command may jump, and an arm that cannot follow it does not; but it turns no further than the arm.
        if let Some(q) = desired
            && let Some(desired) = &mut sound.log.to_mut().q_des
        {
            desired[j] = q;
        }
    }
    if let Some((_, tau)) = &log.tau {
        for (j, (tau, rows)) in tau.iter().zip(torques).enumerate() {
            let Some(first) = rows.first() else { continue };
            let farthest = rows.iter().map(|k| tau[*k].abs()).fold(0.0, f64::max);
            let text = format!(
                "torque of up to {} N m: {} (first at {} s) excluded, and the log is cut there; the drive's limit is \
                 {} N m, and no torque of the arm exceeds both twice that and five times the value of nine in ten \
                 rows",
                number(farthest, 3),
                share(rows.len(), log.len()),
                number(log.t[*first], 5),
                number(joints[j].effort, 4)
            );
            say(j, "torque_beyond_limit", text);
            left_out.extend(rows);
        }
    }
    if let Some((_, tau)) = &log.tau {
        // Rows beside one that no drive gives have nothing to be drawn from.
        let (lost, between): (Vec<_>, Vec<_>) = dropouts(tau)
            .into_iter()
            .partition(|rows| [rows.start - 1, rows.end].iter().all(|beside| !left_out.contains(beside)));
        left_out.extend(between.into_iter().flatten());
        if let Some(first) = lost.first()
            && let Some((_, tau)) = &mut sound.log.to_mut().tau
        {
            let text = format!(
                "torque of every joint is exactly 0 for up to five rows between others: {} (first at {} s), lost samples, bridged by \
                 straight lines",
                share(lost.iter().map(ExactSizeIterator::len).sum(), log.len()),
                number(log.t[first.start], 5)
            );
            sound.found.push(Distrust {
                log: Some(runs::short_name(&log.path)),
                joint: None,
                name: "torque_lost",
                text,
            });
            for tau in tau {
                for rows in &lost {
                    bridge(tau, rows);
                }
            }
        }
    }
    left_out.sort_unstable();
    left_out.dedup();
    sound.left_out = left_out;
    if sound.left_out.len() as f64 > MOST_LEFT_OUT * log.len() as f64 {
        let (file, rows) = (log.path.display(), share(sound.left_out.len(), log.len()));
        return Err(Fault::Data(format!(
            "{file}: {rows} cannot be true, more than a tenth: {}; correct the log or use the part that is right",
            sound.reason().unwrap_or_default()
        ))
        .into());
    }
    frozen::take_out(robot, &mut sound);
    refuse_most(log, &sound.left_out, &sound.found)?;
    stairs::take_out(robot, &mut sound);
    Ok(sound)
}

/// A straight line over some rows, between the medians of the three before and of the three behind: a glitch beside them does not go on.
fn bridge(x: &mut [f64], rows: &Range<usize>) {
    let median = |some: &[f64]| {
        let mut some = some.to_vec();
        some.sort_unstable_by(f64::total_cmp);
        some[some.len() / 2]
    };
    let from = median(&x[rows.start.saturating_sub(3)..rows.start]);
    let to = median(&x[rows.end..x.len().min(rows.end + 3)]);
    let steps = (rows.len() + 1) as f64;
    x[rows.clone()].iter_mut().enumerate().for_each(|(k, x)| *x = from + (to - from) * (k + 1) as f64 / steps);
}

/// Jumps of a position, and what it is without whole turns.
type Unwrapped<'a> = (Jumps, Cow<'a, [f64]>);

/// What was found of one joint.
struct Looked<'a> {
    measured: Unwrapped<'a>,
    second: Option<Unwrapped<'a>>,
    /// Desired positions without whole turns, if there were any.
    desired: Option<Vec<f64>>,
    /// Rows whose torque no drive gives.
    torque: Vec<usize>,
}

impl Looked<'_> {
    fn through(log: &Log, j: usize, reach: Reach, effort: f64) -> Looked<'_> {
        let unwrapped = |q| unwrap(&log.t, q, reach);
        let desired = log.q_des.as_ref().map(|desired| unwrapped(&desired[j]));
        Looked {
            measured: unwrapped(&log.q[j]),
            second: log.q_link[j].as_ref().map(|q| unwrapped(q)),
            desired: desired.filter(|(jumps, _)| !jumps.wraps.is_empty()).map(|(_, whole)| whole.into_owned()),
            torque: log.tau.as_ref().map(|(_, tau)| beyond(&tau[j], effort)).unwrap_or_default(),
        }
    }
}

fn times(count: usize) -> String {
    if count == 1 { "once".to_owned() } else { format!("{count} times") }
}

fn share(rows: usize, of: usize) -> String {
    format!("{rows} of {of} rows")
}
