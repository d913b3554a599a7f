//! Closed-loop rollout: the simulator with and without what was found, driven by the log's own torque.
//!
//! From many instants of a run the simulated arm is put where the arm was and gets the torque that the log says, plus a
//! weak position loop to the logged motion: without it a small error of torque grows without bounds. How far its position
//! strays, and how much torque the loop has to add, are what the simulator gets wrong, by horizon.

use rivet_config::Robot;
use rivet_diagnosis::{Patch, Run};
use rivet_dynamics::{Joints, Model, Places};
use rivet_estimation::offline::{Trajectory, ZeroPhase};
use rivet_report::{Rollout, RolloutPoint};
use rivet_simulation::{Disturbances, Plant, PlantSettings, Sensors, Truth};

/// Horizons that are reported \[s\].
const HORIZONS_S: [f64; 5] = [0.05, 0.1, 0.2, 0.5, 1.0];
/// Most starts, and the run's ends that are left out \[s\].
const STARTS: usize = 12;
const EDGE_S: f64 = 0.3;
/// Bandwidth of the loop \[Hz\]: far below what an arm's own controller has.
const LOOP_HZ: f64 = 1.0;
/// Cut-off of the positions' smoothing \[Hz\].
const MOTION_HZ: f64 = 40.0;
/// An error must become smaller by this share to count as closer.
const CLOSER: f64 = 0.05;

/// Errors of one simulator: mean squares by horizon and joint, of position \[rad²\] and of the loop's torque \[N²·m²\].
struct Errors {
    position: Vec<Vec<f64>>,
    torque: Vec<Vec<f64>>,
}

/// Both simulators along a run; none where it is too short.
pub(crate) fn rollout(robot: &Robot, patch: &Patch, run: &Run) -> Option<Rollout> {
    let n = robot.dof();
    let horizon = (HORIZONS_S[HORIZONS_S.len() - 1] / run.period_s).round() as usize;
    let edge = (EDGE_S / run.period_s).round() as usize;
    let last = run.len().checked_sub(horizon + edge + 2).filter(|last| *last > edge)?;
    let starts: Vec<usize> = (0..STARTS).map(|i| edge + i * (last - edge) / STARTS.max(1)).collect();
    let smooth = ZeroPhase::new(MOTION_HZ.min(0.2 / run.period_s), 4, run.period_s);
    let mut q = run.q.clone();
    for q in &mut q {
        smooth.apply(q);
    }
    let motion = Trajectory::from_positions(&q, run.period_s);
    let mut arm = patch.model.arm.clone();
    for (link, body) in arm.links.iter_mut().enumerate() {
        body.copy_from_slice(&patch.written[Places::link(link)]);
    }
    let corrected = Model::new(arm, patch.model.structure)
        .with_load(patch.model.load().to_vec())
        .with_effects(patch.model.effects().clone());
    let corrected = Truth::new(&corrected, &patch.drives(&patch.written), &Disturbances::default());
    let given = Truth::new(&robot.model, &robot.config.nominal_joints(), &Disturbances::default());
    let gains = gains(&robot.model, &robot.config.nominal_joints());
    let limits = vec![f64::MAX; n];
    let errors = |truth: &Truth| {
        let settings = PlantSettings::new(run.period_s, &limits);
        let plant = Plant::new(truth, &Sensors::perfect(n), &settings, 1);
        errors(plant, run, &motion, &starts, horizon, &gains)
    };
    let (before, after) = (errors(&given), errors(&corrected));
    // Joints count alike: each by its own motion and its own torque.
    let rms = |x: &[f64]| (x.iter().map(|v| v * v).sum::<f64>() / x.len().max(1) as f64).sqrt().max(1e-9);
    let torque: Vec<f64> = run.tau.iter().map(|t| rms(t)).collect();
    let pooled = |squares: &[f64], scale: &dyn Fn(usize) -> f64| {
        (squares.iter().enumerate().map(|(j, s)| s / scale(j).powi(2)).sum::<f64>() / n as f64).sqrt()
    };
    let mut points: Vec<RolloutPoint> = HORIZONS_S
        .iter()
        .enumerate()
        .map(|(h, horizon_s)| RolloutPoint {
            horizon_s: *horizon_s,
            position_before_rad: pooled(&before.position[h], &|_| 1.0),
            position_after_rad: pooled(&after.position[h], &|_| 1.0),
            torque_before: pooled(&before.torque[h], &|j| torque[j]),
            torque_after: pooled(&after.torque[h], &|j| torque[j]),
        })
        .collect();
    let ran_away = end_where_one_ran_away(&mut points);
    let end = points.last()?;
    let not_simulated: Vec<String> = corrected.left_out().into_iter().chain(ran_away.clone()).collect();
    let less = |before: f64, after: f64| after < (1.0 - CLOSER) * before;
    let closer = less(end.position_before_rad, end.position_after_rad) && less(end.torque_before, end.torque_after);
    Some(Rollout { closer: closer && ran_away.is_none(), starts: starts.len(), not_simulated, points })
}

/// Of a run whose torque cannot drive a simulator: these joints' is not believed.
pub(crate) fn undriven(joints: &[&str]) -> Rollout {
    let why = format!("the log cannot drive a simulator, since the torque of {} is not believed", joints.join(", "));
    Rollout { closer: false, starts: 0, not_simulated: vec![why], points: Vec::new() }
}

/// Leaves out the horizons that a simulated arm did not reach in finite numbers, and says so: a law that was found at the speeds
/// of a log may drive an arm beyond them, as friction does that falls with speed.
fn end_where_one_ran_away(points: &mut Vec<RolloutPoint>) -> Option<String> {
    let reached = |p: &&RolloutPoint| {
        [p.position_before_rad, p.position_after_rad, p.torque_before, p.torque_after].iter().all(|e| e.is_finite())
    };
    let kept = points.iter().take_while(reached).count();
    let lost = points.get(kept)?.horizon_s;
    points.truncate(kept);
    let from = points.last().map_or(0.0, |last| last.horizon_s);
    Some(format!("between {from} and {lost} s a simulated arm diverged: the figures end before that"))
}

/// Position gain \[N·m/rad\] and velocity gain \[N·m·s/rad\] of each joint: a critically damped loop on its mean inertia.
fn gains(model: &Model, joints: &Joints) -> Vec<(f64, f64)> {
    let n = model.arm.dof();
    let mut ws = rivet_dynamics::Workspace::new(&model.arm);
    let mut mass = vec![0.0; n * n];
    rivet_dynamics::mass_matrix(&model.arm, &model.arm.links, &mut ws, &vec![0.5; n], &mut mass);
    let omega = std::f64::consts::TAU * LOOP_HZ;
    (0..n)
        .map(|j| {
            let inertia = mass[j * n + j] + joints.rotor_inertia[j];
            (omega * omega * inertia, 2.0 * omega * inertia)
        })
        .collect()
}

fn errors(
    mut plant: Plant,
    run: &Run,
    motion: &Trajectory,
    starts: &[usize],
    horizon: usize,
    gains: &[(f64, f64)],
) -> Errors {
    let n = gains.len();
    let zeros = vec![vec![0.0; n]; HORIZONS_S.len()];
    let mut sums = Errors { position: zeros.clone(), torque: zeros };
    let mut command = vec![0.0; n];
    for start in starts {
        let at_row = |s: &[Vec<f64>], k: usize| -> Vec<f64> { s.iter().map(|s| s[k]).collect() };
        plant.place(&at_row(&motion.q, *start), &at_row(&motion.qd, *start));
        let mut added = vec![0.0; n];
        for step in 0..=horizon {
            let k = start + step;
            for (h, horizon_s) in HORIZONS_S.iter().enumerate() {
                if step == (horizon_s / run.period_s).round() as usize {
                    for j in 0..n {
                        sums.position[h][j] += (plant.q()[j] - motion.q[j][k]).powi(2) / starts.len() as f64;
                        sums.torque[h][j] += added[j] / (step as f64 * starts.len() as f64);
                    }
                }
            }
            for j in 0..n {
                let (p, d) = gains[j];
                let more = p * (motion.q[j][k] - plant.q()[j]) + d * (motion.qd[j][k] - plant.qd()[j]);
                added[j] += more * more;
                // The torque of the next sample is what acts between this one and that.
                command[j] = run.tau[j][k + 1] + more;
            }
            plant.step(&command);
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn horizons_that_an_arm_did_not_reach_are_left_out_and_that_is_said() {
        let point = |horizon_s: f64, after: f64| RolloutPoint {
            horizon_s,
            position_before_rad: 0.1,
            position_after_rad: after,
            torque_before: 0.1,
            torque_after: 0.1,
        };
        let mut points = vec![point(0.1, 0.01), point(0.5, f64::INFINITY), point(1.0, f64::NAN)];
        let said = end_where_one_ran_away(&mut points).expect("said");
        assert!(said.contains("between 0.1 and 0.5 s"), "{said}");
        assert_eq!(points, [point(0.1, 0.01)]);
        assert_eq!(end_where_one_ran_away(&mut points), None);
        // None is left: there is nothing to tell.
        let mut points = vec![point(0.1, f64::NAN)];
        assert!(end_where_one_ran_away(&mut points).is_some() && points.is_empty());
    }
}
