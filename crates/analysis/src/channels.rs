//! Torque channels that say the same whatever the arm does.

use anyhow::Result;
use rivet_config::Robot;
use rivet_estimation::offline::{position_noise, position_step};
use rivet_logs::{Log, TorqueSource};

use crate::coarse::BLURS;
use crate::evidence::Distrust;
use crate::fault::Fault;
use crate::runs;
use crate::table::number;

/// A signal that varies by less than this share of its size is constant.
const CONSTANT: f64 = 1e-9;
/// Torque stands at its limit if so large a share of the rows has the largest value there is ...
const CLIPPED: f64 = 0.005;
/// ... and so many times as many as have each of the next values ...
const HEAP: f64 = 10.0;
/// ... and so many rows.
const CLIPPED_ROWS: usize = 20;
/// How many next values are looked at.
const NEXT: usize = 3;

/// The column a joint's torque comes from.
fn column(log: &Log, j: usize) -> String {
    let name = if matches!(log.tau, Some((TorqueSource::Current, _))) { "current" } else { "tau" };
    format!("{name}{}", j + 1)
}

/// Refuses torque that is one number in all rows although the joint moves. (Zero is a channel that was not recorded: the fit says so.)
pub(crate) fn varies(robot: &Robot, log: &Log) -> Result<()> {
    match constant(robot, log)?.first() {
        Some((_, why)) => Err(Fault::Data(format!("{}: {why}", log.path.display())).into()),
        None => Ok(()),
    }
}

/// Joints whose torque is one number in all rows, but not 0, although they move, and what to say of each.
pub(crate) fn constant(robot: &Robot, log: &Log) -> Result<Vec<(usize, String)>> {
    let span = |x: &[f64]| {
        let [low, high] = [f64::min, f64::max].map(|of| x.iter().copied().reduce(of).unwrap_or(0.0));
        (high - low, low.abs().max(high.abs()))
    };
    let constant_in = |(j, (tau, q)): (usize, (&Vec<f64>, &Vec<f64>))| {
        let ((varies, size), (moves, _)) = (span(tau), span(q));
        // As far as the dead zone is passed in a tenth of a second: less is no motion.
        let still = 0.1 * robot.config.signal.dead_zone[j];
        let joint = &robot.model.arm.joints[j].name;
        (size > 0.0 && varies <= CONSTANT * size && moves > still).then(|| {
            let why = format!(
                "column {} is {} in every row although {joint} moves by {} rad: the channel carries no information; \
                 log its torque, or use logs that have it",
                column(log, j),
                tau[0],
                number(moves, 3)
            );
            (j, why)
        })
    };
    Ok(log.torque()?.iter().zip(&log.q).enumerate().filter_map(constant_in).collect())
}

/// Torque that comes in fewer steps says nothing by where it stands.
const FEW_STEPS: f64 = 60.0;

/// Torques that stand at their largest or smallest value for many rows: the drive, or what recorded it, can give no more.
pub(crate) fn clipped(robot: &Robot, log: &Log) -> Result<Vec<Distrust>> {
    let mut found = Vec::new();
    for (j, tau) in log.torque()?.iter().enumerate() {
        // Counting costs less than sorting, and most torques have but one row at their top.
        let outermost = [f64::min, f64::max].map(|of| tau.iter().copied().reduce(of).unwrap_or(0.0));
        let at = |value: f64| tau.iter().filter(|tau| is_same(value, **tau)).count();
        if !outermost.iter().any(|value| are_many(at(*value), tau.len())) {
            continue;
        }
        // Of few steps that noise does not blur the outermost is as full as any.
        let few = |step: f64| outermost[1] - outermost[0] < FEW_STEPS * step && position_noise(tau) < BLURS * step;
        if position_step(tau).is_some_and(few) {
            continue;
        }
        let mut sorted = tau.clone();
        sorted.sort_unstable_by(f64::total_cmp);
        let low = heap(sorted.iter());
        let high = heap(sorted.iter().rev());
        // Of a joint that is braked, or whose channel is off, there is no torque: no drive is limited to that.
        for (value, rows) in [low, high].into_iter().flatten().filter(|(value, _)| *value != 0.0) {
            let text = format!(
                "column {} stands at {} N m, the {} value there is, in {rows} of {} rows: the drive or the recording gives no more, and the \
                 joint may have had another torque; move slower, or leave that part out",
                column(log, j),
                number(value, 4),
                if value < sorted[sorted.len() / 2] { "smallest" } else { "largest" },
                log.len()
            );
            let (log, joint) = (Some(runs::short_name(&log.path)), Some(robot.model.arm.joints[j].name.clone()));
            found.push(Distrust { log, joint, name: "torque_clipped", text });
        }
    }
    Ok(found)
}

fn is_same(value: f64, x: f64) -> bool {
    (value - x).abs() <= CONSTANT * value.abs()
}

/// Whether so many rows of all may be a heap.
fn are_many(rows: usize, all: usize) -> bool {
    rows >= CLIPPED_ROWS && rows as f64 >= CLIPPED * all as f64
}

/// The outermost value of a sorted signal and how many rows have it, if it is a heap: torque in steps has a few rows at its top, and
/// as many a step below.
fn heap<'a>(sorted: impl ExactSizeIterator<Item = &'a f64>) -> Option<(f64, usize)> {
    let all = sorted.len();
    let mut counts: Vec<(f64, usize)> = Vec::new();
    for x in sorted {
        let again = counts.last().is_some_and(|(value, _)| is_same(*value, *x));
        if let (true, Some((_, count))) = (again, counts.last_mut()) {
            *count += 1;
        } else if counts.len() > NEXT {
            break;
        } else {
            counts.push((*x, 1));
        }
    }
    let (value, rows) = *counts.first()?;
    let next = counts[1..].iter().map(|(_, rows)| *rows).max()?;
    (are_many(rows, all) && rows as f64 >= HEAP * next as f64).then_some((value, rows))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn top(tau: &[f64]) -> Option<(f64, usize)> {
        let mut sorted = tau.to_vec();
        sorted.sort_unstable_by(f64::total_cmp);
        heap(sorted.iter().rev())
    }

    #[test]
    fn a_clipped_torque_is_told_from_one_in_steps() {
        let wave: Vec<f64> =
            (0..20_000).map(|k| 40.0 * (1e-2 * f64::from(k)).sin() + 3.0 * f64::from(k).sin()).collect();
        assert_eq!(top(&wave), None);
        let clipped: Vec<f64> = wave.iter().map(|tau| tau.min(35.0)).collect();
        let (value, rows) = top(&clipped).expect("clipped");
        assert!(value == 35.0 && rows > 1000, "{rows}");
        for step in [0.01, 0.1, 1.0, 5.0] {
            for phase in 0..20 {
                let pure = (0..20_000).map(|k| (40.0 + 0.05 * f64::from(phase) * step) * (1e-2 * f64::from(k)).sin());
                let steps: Vec<f64> = pure.map(|tau| (tau / step).round() * step).collect();
                assert_eq!(top(&steps), None, "step {step} {phase}");
            }
        }
        assert_eq!(top(&[]), None);
        assert_eq!(top(&[1.0; 100]), None, "constant is another fault");
    }
}
