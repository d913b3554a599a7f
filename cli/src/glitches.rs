//! Readings of a log that no arm gives: taken back where they are whole turns, else left out, and said.

use std::borrow::Cow;

use anyhow::Result;
use rivet_config::Robot;
use rivet_dynamics::JointKind;
use rivet_estimation::offline::{Jumps, MOST_LEFT_OUT, Reach, beyond, unwrap};
use rivet_logs::{Log, Signals};

use crate::evidence::Distrust;
use crate::exit::Fault;
use crate::runs;
use crate::stairs;
use crate::table::number;

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
        let of = |d: &Distrust| format!("{}: {}", d.joint.as_deref().unwrap_or_default(), d.text);
        (!self.left_out.is_empty()).then(|| self.found.iter().map(of).collect::<Vec<_>>().join("; "))
    }
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
    let mut position = |j: usize, what: &str, q: &[f64]| -> Option<Vec<f64>> {
        let (Jumps { wraps, rows, farthest }, whole) = unwrap(&log.t, q, reach(j));
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
                "{what} jumps by up to {} rad: {} (first at {} s) left out, and the log is cut there; a step jumps that is off \
                 from those around it by more than 500 rad/s2, 12 times the usual, 4 encoder steps and 5 mrad",
                number(farthest.abs(), 3),
                share(rows.len(), log.len()),
                number(log.t[*first], 5)
            );
            say(j, JUMP_NAME, text);
        }
        left_out.extend(rows);
        (!wraps.is_empty()).then(|| whole.into_owned())
    };
    for j in 0..joints.len() {
        if let Some(q) = position(j, "position", &log.q[j]) {
            sound.log.to_mut().q[j] = q;
        }
        if let Some(link) = &log.q_link[j]
            && let Some(q) = position(j, "position of the second encoder", link)
        {
            sound.log.to_mut().q_link[j] = Some(q);
        }
        // A command may jump, and an arm that cannot follow it does not; but it turns no further than the arm.
        if let Some(q) = log.q_des.as_ref().and_then(|desired| desired_unwrapped(&log.t, desired, j, reach(j)))
            && let Some(desired) = &mut sound.log.to_mut().q_des
        {
            desired[j] = q;
        }
    }
    if let Some((_, tau)) = &log.tau {
        for (j, tau) in tau.iter().enumerate() {
            let rows = beyond(tau, joints[j].effort);
            let Some(first) = rows.first() else { continue };
            let farthest = rows.iter().map(|k| tau[*k].abs()).fold(0.0, f64::max);
            let text = format!(
                "torque of up to {} N m: {} (first at {} s) left out, and the log is cut there; the drive's limit is {} N m, and \
                 beyond twice that and five times what nine of ten rows have is no torque of the arm",
                number(farthest, 3),
                share(rows.len(), log.len()),
                number(log.t[*first], 5),
                number(joints[j].effort, 4)
            );
            say(j, "torque_beyond_limit", text);
            left_out.extend(rows);
        }
    }
    left_out.sort_unstable();
    left_out.dedup();
    sound.left_out = left_out;
    if sound.left_out.len() as f64 > MOST_LEFT_OUT * log.len() as f64 {
        let (file, rows) = (log.path.display(), share(sound.left_out.len(), log.len()));
        return Err(Fault::Data(format!(
            "{file}: {rows} cannot be true, more than a tenth: {}; mend the log or give the part that is sound",
            sound.reason().unwrap_or_default()
        ))
        .into());
    }
    stairs::take_out(robot, &mut sound);
    Ok(sound)
}

/// The desired positions of a joint without whole turns, if there were any.
fn desired_unwrapped(t: &[f64], desired: &Signals, j: usize, reach: Reach) -> Option<Vec<f64>> {
    let (Jumps { wraps, .. }, whole) = unwrap(t, &desired[j], reach);
    (!wraps.is_empty()).then(|| whole.into_owned())
}

fn times(count: usize) -> String {
    if count == 1 { "once".to_owned() } else { format!("{count} times") }
}

fn share(rows: usize, of: usize) -> String {
    format!("{rows} of {of} rows")
}
