//! Torque that stands while its joint moves: left out, and said.

use rivet_config::Robot;
use rivet_logs::{Frozen, Log};

use crate::evidence::{Distrust, TORQUE_STOOD_NAME};
use crate::runs;
use crate::sound::Sound;
use crate::table::number;

/// So many spans are told one by one.
const TOLD: usize = 4;

/// Leaves out the rows in which the torque of a joint is dead or frozen. Of all joints: each row of a log is one of the arm.
pub(crate) fn take_out(robot: &Robot, sound: &mut Sound<'_>) {
    let stood = Stood::find(robot, &sound.log);
    sound.found.extend(stood.found);
    sound.left_out.extend(stood.rows);
    sound.left_out.sort_unstable();
    sound.left_out.dedup();
}

/// What stands in a log.
pub(crate) struct Stood {
    /// Joint by joint.
    pub(crate) found: Vec<Distrust>,
    /// Rows of any of them, in order.
    pub(crate) rows: Vec<usize>,
}

impl Stood {
    pub(crate) fn find(robot: &Robot, log: &Log) -> Stood {
        let (mut found, mut rows) = (Vec::new(), Vec::new());
        for (j, (joint, frozen)) in robot.model.arm.joints.iter().zip(log.frozen_torque()).enumerate() {
            let Some(frozen) = frozen else { continue };
            found.push(Distrust {
                log: Some(runs::short_name(&log.path)),
                joint: Some(joint.name.clone()),
                name: TORQUE_STOOD_NAME,
                text: text(log, j, &frozen),
            });
            rows.extend(frozen.rows.into_iter().flatten());
        }
        rows.sort_unstable();
        rows.dedup();
        Stood { found, rows }
    }
}

fn text(log: &Log, j: usize, frozen: &Frozen) -> String {
    let Frozen { rows, usual_s } = frozen;
    let at = |k: usize| number(log.t[k], 5);
    let span = |run: &std::ops::Range<usize>| {
        let value = log.tau.as_ref().map_or(0.0, |(_, tau)| tau[j][run.start]);
        format!("{} to {} s at {} N m", at(run.start), at(run.end - 1), number(value, 3))
    };
    let mut spans: Vec<String> = rows.iter().take(TOLD).map(span).collect();
    if rows.len() > TOLD {
        spans.push(format!("and {} more", rows.len() - TOLD));
    }
    let elsewhere = usual_s.map_or_else(String::new, |usual_s| {
        format!(". Elsewhere in motion it is hardly ever constant for more than {} ms", number(1e3 * usual_s, 2))
    });
    let count: usize = rows.iter().map(ExactSizeIterator::len).sum();
    format!(
        "torque is constant to the bit while the joint moves: {}{elsewhere}. The channel was dead, frozen or at a \
         limit: {count} of {} rows excluded, for all joints, and the log is cut there",
        spans.join(", "),
        log.len()
    )
}
