//! Positions that come more slowly than the rows of a log: drawn through those at which they came, and said.

use std::borrow::Cow;

use rivet_config::Robot;
use rivet_logs::{Holds, Stairs};

use crate::evidence::{Distrust, HELD_NAME, PLAN_HELD_NAME, STOOD_NAME};
use crate::runs;
use crate::sound::Sound;
use crate::table::number;

/// Draws held positions and a held desired motion of a log anew. Stairs shorter than a sample of the robot file fall to the low-pass before rows are dropped.
pub(crate) fn take_out(robot: &Robot, sound: &mut Sound<'_>) {
    let least_s = robot.config.sample_period_s;
    take_out_of_positions(robot, sound, least_s);
    take_out_holds(robot, sound, least_s);
    let Some((log, stairs)) = sound.log.without_plan_stairs(&sound.left_out, least_s) else { return };
    let name = runs::short_name(&log.path);
    for (joint, rows) in robot.model.arm.joints.iter().zip(&stairs) {
        let Some(rows) = rows else { continue };
        let text = format!(
            "the desired motion is held, {rows} rows as a rule: it is drawn through the rows at which a new one came (cubic). Logged at \
             its own rate, or with its speeds, it determines the tracking lag better"
        );
        sound.found.push(Distrust {
            log: Some(name.clone()),
            joint: Some(joint.name.clone()),
            name: PLAN_HELD_NAME,
            text,
        });
    }
    sound.log = Cow::Owned(log);
}

fn take_out_of_positions(robot: &Robot, sound: &mut Sound<'_>, least_s: f64) {
    let hole_s = runs::hole_s(sound.log.median_step_s());
    let Some((log, stairs)) = sound.log.without_stairs(&mut sound.left_out, least_s, hole_s) else { return };
    let name = runs::short_name(&log.path);
    for (joint, stairs) in robot.model.arm.joints.iter().zip(&stairs) {
        let Some(stairs) = stairs else { continue };
        let (log, joint) = (Some(name.clone()), Some(joint.name.clone()));
        sound.found.push(Distrust { log, joint, name: HELD_NAME, text: text(stairs) });
    }
    sound.repeated = Some(stairs.iter().map(|stairs| stairs.map_or(0.0, |stairs| stairs.share)).collect());
    sound.log = Cow::Owned(log);
}

fn take_out_holds(robot: &Robot, sound: &mut Sound<'_>, least_s: f64) {
    let Some((log, holds)) = sound.log.without_holds(&mut sound.left_out, least_s) else { return };
    let name = runs::short_name(&log.path);
    for (joint, holds) in robot.model.arm.joints.iter().zip(&holds) {
        let Some(holds) = holds else { continue };
        let (joint, text) = (Some(joint.name.clone()), text_of_holds(holds, log.t[holds.first]));
        sound.found.push(Distrust { log: Some(name.clone()), joint, name: STOOD_NAME, text });
    }
    sound.log = Cow::Owned(log);
}

fn text_of_holds(holds: &Holds, first_s: f64) -> String {
    let Holds { rows, times, longest, left_out, .. } = holds;
    let what = match left_out {
        0 => "interpolated from the neighbouring rows".to_owned(),
        all if all == rows => "excluded".to_owned(),
        some => format!("interpolated from the neighbouring rows, or excluded ({some}, in gaps too long for that)"),
    };
    format!(
        "position stands while the joint moves, {times} times for up to {longest} rows (first at {} s): samples that were lost and repeated; \
         {rows} rows are {what}. On line the daemon refuses such samples as frozen from the fifth",
        number(first_s, 5)
    )
}

/// Rounded, so that joints of one source share a paragraph.
fn text(stairs: &Stairs) -> String {
    let torque = if stairs.with_torque { "positions and torque" } else { "positions" };
    let late = if stairs.with_torque {
        "both are"
    } else {
        "torque was not held with them, so look at how late it is; positions are"
    };
    format!(
        "{torque} are held: {:.0} % of the rows in motion repeat the one before, stairs are {} rows long as a rule. Differences of stairs \
         are no speed: {late} drawn through the rows at which a new sample came (cubic), as far as off-line work goes. A log at the rate \
         of its source is better; on line nothing is interpolated",
        100.0 * stairs.share,
        stairs.rows,
    )
}
