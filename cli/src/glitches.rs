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
use crate::exit::Fault;
use crate::frozen;
use crate::runs;
use crate::stairs;
use crate::table::number;

/// Rows of a log that may be left out where a torque stood, as a share.
const MOST_STOOD: f64 = 0.5;
/// Positions that jump.
pub(crate) const JUMP_NAME: &str = "position_jump";

/// A log without what no arm gives.
pub(crate) struct Sound<'a> {
    /// The log, angles unwrapped.
    pub(crate) log: Cow<'a, Log>,
    /// Rows that are not to be used, ascending.
    pub(crate) left_out: Vec<usize>,
    /// Share of the rows in motion at which positions repeated, per joint, where they were drawn anew for it.
    pub(crate) repeated: Option<Vec<f64>>,
    /// What was found.
    pub(crate) found: Vec<Distrust>,
}

impl Sound<'_> {
    /// What was found, as the reason why nothing is left.
    pub(crate) fn reason(&self) -> Option<String> {
        (!self.left_out.is_empty()).then(|| reason(&self.found))
    }
}

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

fn reason(found: &[Distrust]) -> String {
    let of = |d: &Distrust| format!("{}: {}", d.joint.as_deref().unwrap_or_default(), d.text);
    found.iter().map(of).collect::<Vec<_>>().join("; ")
}

/// Looks through the positions and torques of a log, row by row as logged.
pub(crate) fn screen<'a>(robot: &Robot, log: &'a Log) -> Result<Sound<'a>> {
    let joints = &robot.model.arm.joints;
    let reach = |j: usize| Reach {
        speed: joints[j].velocity,
        resolution: robot.config.drive.encoder_resolution[j],
        revolute: joints[j].kind == JointKind::Revolute,
    };
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
            say(j, "position_wrapped", text);
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
        (0..joints.len()).into_par_iter().map(|j| Looked::through(log, j, reach(j), joints[j].effort)).collect();
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
