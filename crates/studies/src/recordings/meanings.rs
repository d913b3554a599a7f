//! What the channels of a drawn recording mean: one line a meaning.

use std::f64::consts::TAU;

use rivet_config::Robot;
use rivet_dynamics::{Parameter, Workspace};
use rivet_logs::{Log, Signals, TorqueSource};
use rivet_simulation::Random;

/// Changes a log; returns the joints (from 0) whose channels are changed, none where it is all.
type Change = fn(&mut Draw<'_>) -> Vec<usize>;

/// A meaning: its name as of a reading, and the change that makes it.
pub(super) struct Meaning {
    pub(super) name: &'static str,
    pub(super) change: Change,
}

/// A recording that is drawn.
pub(super) struct Draw<'a> {
    pub(super) robot: &'a Robot,
    pub(super) random: &'a mut Random,
    pub(super) log: &'a mut Log,
}

/// Time over which motion is smoothed before a commanded torque is computed from it \[s\].
const SMOOTH_S: f64 = 0.05;
/// Shares of the recordings that are as the contract says, by how often the line stands in the table.
const AS_IT_IS: Meaning = Meaning { name: "as_it_is", change: |_| Vec::new() };

/// Every meaning, equally probable.
pub(super) const MEANINGS: [Meaning; 24] = [
    AS_IT_IS,
    AS_IT_IS,
    AS_IT_IS,
    AS_IT_IS,
    Meaning { name: "torque_sign", change: |draw| one(draw, |_, _, tau| scale(tau, -1.0)) },
    Meaning { name: "torque_sign", change: |draw| all(draw, |_, tau| scale(tau, -1.0)) },
    Meaning {
        name: "joint_reversed",
        change: |draw| {
            one(draw, |_, q, tau| {
                scale(q, -1.0);
                scale(tau, -1.0);
            })
        },
    },
    Meaning { name: "position_unit", change: |draw| all(draw, |q, _| scale(q, 1.0 / TAU)) },
    Meaning { name: "position_unit", change: |draw| all(draw, |q, _| scale(q, 360.0 / TAU)) },
    Meaning { name: "position_unit", change: |draw| all(draw, |q, _| scale(q, 1e3)) },
    Meaning { name: "position_unit", change: |draw| one(draw, |_, q, _| scale(q, 360.0 / TAU)) },
    Meaning { name: "torque_unit", change: |draw| all(draw, |_, tau| scale(tau, 1e3)) },
    Meaning { name: "torque_unit", change: |draw| all(draw, |_, tau| scale(tau, 1.0 / 9.80665)) },
    Meaning {
        name: "torque_unit",
        change: |draw| {
            let factor = [0.1, 0.4, 3.0, 30.0][below(draw.random, 4)];
            one_by(draw, factor)
        },
    },
    Meaning { name: "torque_unit_per_joint", change: currents },
    Meaning { name: "torque_exchanged", change: |draw| exchange(draw, false) },
    Meaning { name: "joints_exchanged", change: |draw| exchange(draw, true) },
    Meaning { name: "joints_back_to_front", change: back_to_front },
    Meaning { name: "torque_late", change: |draw| late(draw, true) },
    Meaning { name: "torque_late", change: |draw| late(draw, false) },
    Meaning { name: "torque_unsigned", change: |draw| all(draw, |_, tau| tau.iter_mut().for_each(|x| *x = x.abs())) },
    Meaning { name: "torque_without_gravity", change: without_gravity },
    Meaning { name: "torque_computed", change: |draw| computed(draw, false) },
    Meaning { name: "external_torque", change: |draw| computed(draw, true) },
];

pub(super) fn below(random: &mut Random, count: usize) -> usize {
    ((random.unit() * count as f64) as usize).min(count - 1)
}

fn scale(signal: &mut [f64], factor: f64) {
    for x in signal {
        *x *= factor;
    }
}

fn torques(log: &mut Log) -> &mut Signals {
    &mut log.tau.get_or_insert_with(|| (TorqueSource::Logged, vec![Vec::new(); log.q.len()])).1
}

/// Changes every joint.
fn all(draw: &mut Draw<'_>, change: fn(&mut [f64], &mut [f64])) -> Vec<usize> {
    let Log { q, tau, .. } = &mut *draw.log;
    let tau = tau.iter_mut().flat_map(|(_, tau)| tau);
    q.iter_mut().zip(tau).for_each(|(q, tau)| change(q, tau));
    Vec::new()
}

/// Changes a drawn joint that moves.
fn one(draw: &mut Draw<'_>, change: fn(&mut Random, &mut [f64], &mut [f64])) -> Vec<usize> {
    let j = moving(draw);
    let Log { q, tau, .. } = &mut *draw.log;
    if let Some((_, tau)) = tau {
        change(draw.random, &mut q[j], &mut tau[j]);
    }
    vec![j]
}

fn one_by(draw: &mut Draw<'_>, factor: f64) -> Vec<usize> {
    let j = moving(draw);
    scale(&mut torques(draw.log)[j], factor);
    vec![j]
}

/// A joint that moves by a tenth of a radian or more.
fn moving(draw: &mut Draw<'_>) -> usize {
    const LEAST_RAD: f64 = 0.1;
    let span = |q: &[f64]| q.iter().copied().fold(f64::MIN, f64::max) - q.iter().copied().fold(f64::MAX, f64::min);
    let joints: Vec<usize> = (0..draw.log.joints()).filter(|j| span(&draw.log.q[*j]) >= LEAST_RAD).collect();
    if joints.is_empty() { 0 } else { joints[below(draw.random, joints.len())] }
}

/// Torques as currents: a factor a joint, such as amperes of motors of the joints' sizes.
fn currents(draw: &mut Draw<'_>) -> Vec<usize> {
    let limits = draw.robot.config.drive.torque_limit.clone();
    for (tau, limit) in torques(draw.log).iter_mut().zip(limits) {
        // A motor's largest current is 5 to 20 A, whatever its torque.
        scale(tau, draw.random.uniform(5.0, 20.0) / limit);
    }
    Vec::new()
}

fn exchange(draw: &mut Draw<'_>, with_positions: bool) -> Vec<usize> {
    let a = below(draw.random, draw.log.joints() - 1);
    torques(draw.log).swap(a, a + 1);
    if with_positions {
        draw.log.q.swap(a, a + 1);
    }
    vec![a, a + 1]
}

fn back_to_front(draw: &mut Draw<'_>) -> Vec<usize> {
    torques(draw.log).reverse();
    draw.log.q.reverse();
    Vec::new()
}

fn late(draw: &mut Draw<'_>, is_all: bool) -> Vec<usize> {
    let seconds = draw.random.uniform(0.025, 0.16);
    let rows = ((seconds / draw.log.median_step_s()).round() as usize).max(1);
    let joints = if is_all { (0..draw.log.joints()).collect() } else { vec![moving(draw)] };
    for j in &joints {
        let tau = &mut torques(draw.log)[*j];
        let (first, rows) = (tau[0], rows.min(tau.len()));
        tau.rotate_right(rows);
        tau[..rows].fill(first);
    }
    if is_all { Vec::new() } else { joints }
}

/// Takes the gravity of the robot file's bodies out of the torque.
fn without_gravity(draw: &mut Draw<'_>) -> Vec<usize> {
    let still = vec![vec![0.0; draw.log.len()]; draw.log.joints()];
    let gravity = model(draw.robot, &draw.log.q, &still, &still, false);
    subtract(torques(draw.log), &gravity);
    Vec::new()
}

/// The torque of the robot file's model along the smoothed motion: as a controller commands it; or what a driver reports as
/// external, the measured torque without it.
fn computed(draw: &mut Draw<'_>, is_external: bool) -> Vec<usize> {
    let step = draw.log.median_step_s();
    let half = ((0.5 * SMOOTH_S / step).round() as usize).max(1);
    let [mut q, mut qd, mut qdd] = [Vec::new(), Vec::new(), Vec::new()];
    for signal in &draw.log.q {
        let smooth = smoothed(&smoothed(signal, half), half);
        let rate = smoothed(&differences(&smooth, step), half);
        qdd.push(smoothed(&differences(&rate, step), half));
        qd.push(rate);
        q.push(smooth);
    }
    let command = model(draw.robot, &q, &qd, &qdd, true);
    if is_external {
        subtract(torques(draw.log), &command);
    } else {
        *torques(draw.log) = command;
    }
    Vec::new()
}

fn subtract(tau: &mut Signals, of: &Signals) {
    for (tau, of) in tau.iter_mut().zip(of) {
        tau.iter_mut().zip(of).for_each(|(tau, of)| *tau -= of);
    }
}

/// Torque of the robot file's model without constant torques, `[joint][row]`; `has_effects`: with the effects that the file states.
fn model(robot: &Robot, q: &Signals, qd: &Signals, qdd: &Signals, has_effects: bool) -> Signals {
    let joints = q.len();
    let size = robot.model.len();
    let is_offset = |p: &Parameter| matches!(p, Parameter::Offset(_));
    let parameters = robot.model.parameters.iter().zip(&robot.nominal);
    let values: Vec<f64> = parameters.map(|(p, value)| if is_offset(p) { 0.0 } else { *value }).collect();
    let mut workspace = Workspace::new(&robot.model.arm);
    let mut y = vec![0.0; joints * size];
    let mut tau = vec![Vec::with_capacity(q[0].len()); joints];
    let at = |signals: &Signals, row: usize| signals.iter().map(|signal| signal[row]).collect::<Vec<f64>>();
    for row in 0..q[0].len() {
        let (q, qd, qdd) = (at(q, row), at(qd, row), at(qdd, row));
        robot.model.regressor(&mut workspace, &q, &qd, &qdd, &mut y);
        let mut effects = vec![0.0; joints];
        if has_effects {
            robot.model.add_effects(&mut workspace, &q, &qd, &qdd, &mut effects);
        }
        for (j, y) in y.chunks_exact(size).enumerate() {
            tau[j].push(effects[j] + y.iter().zip(&values).map(|(y, x)| y * x).sum::<f64>());
        }
    }
    tau
}

/// The mean over `half` rows before and after each row.
fn smoothed(signal: &[f64], half: usize) -> Vec<f64> {
    let mut sums = vec![0.0];
    for x in signal {
        sums.push(sums[sums.len() - 1] + x);
    }
    let mean = |k: usize| {
        let reach = half.min(k).min(signal.len() - 1 - k);
        (sums[k + reach + 1] - sums[k - reach]) / (2 * reach + 1) as f64
    };
    (0..signal.len()).map(mean).collect()
}

fn differences(signal: &[f64], step: f64) -> Vec<f64> {
    let last = signal.len() - 1;
    let rate = |k: usize| {
        let (from, to) = (k.saturating_sub(1), (k + 1).min(last));
        (signal[to] - signal[from]) / ((to - from).max(1) as f64 * step)
    };
    (0..signal.len()).map(rate).collect()
}
