//! Logs whose torque has no gravity in it, as some drivers publish it (Universal Robots' ROS 2 driver since 2026).
//!
//! Such a torque is that of the arm without gravity, as long as the driver's own model of gravity is right. The analysis therefore
//! works with an arm without gravity. What gravity alone would show then keeps the robot file's values, and is reported as not excited.

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::Result;
use rivet_config::{Robot, TorqueMeaning};
use rivet_diagnosis::Diagnosis;
use rivet_dynamics::Workspace;
use rivet_logs::Log;
use rivet_screening::{Fault as LogReading, Reading, Screening};

use crate::evidence::Distrust;
use crate::fault::Fault;
use crate::reading;
use crate::runs;

/// Name of the finding in JSON.
pub const GRAVITY_FREE_NAME: &str = "gravity_free_torque";
/// Rows at which the torque is compared with the file's gravity.
const ROWS: usize = 300;
/// Share of the file's gravity in a torque from which on readings need not be compared: without gravity it is about 0, else about 1.
const PRESENT: f64 = 0.5;
/// Effects whose torque depends on the pose alone.
const OF_POSE: [&str; 4] = ["counterbalance", "joint_spring", "gravity_direction", "encoder_offset"];
/// Probability from which on a log is read so.
const SURE: f64 = 0.95;

/// Logs without the torque of gravity, and the robot with which they are analysed.
pub(crate) struct GravityFree {
    /// The arm without gravity.
    pub(crate) robot: Robot,
    /// Gravity of the robot file \[m/s²\], base axes.
    gravity: [f64; 3],
    /// What is reported.
    pub(crate) finding: Distrust,
}

impl GravityFree {
    /// Whether the torque of the logs is without gravity: as the robot file states, else as physics decides with a probability of 0.95.
    ///
    /// # Errors
    /// A log cannot be read, or some logs are surely without gravity in their torque and others are not.
    pub(crate) fn find<'a>(robot: &Robot, logs: impl IntoIterator<Item = &'a PathBuf>) -> Result<Option<GravityFree>> {
        let gravity = robot.model.arm.gravity;
        if gravity == [0.0; 3] {
            return Ok(None);
        }
        let why = match robot.config.log.torque_is {
            TorqueMeaning::Torque => return Ok(None),
            TorqueMeaning::GravityFree => "as [log] torque_is states".to_owned(),
            TorqueMeaning::Auto => match by_physics(robot, logs)? {
                Some(probability) => format!("probability {probability:.2}"),
                None => return Ok(None),
            },
        };
        let text = format!(
            "torque is without that of gravity ({why}); it is compared with the arm without gravity. The log does not show masses and \
             centers of mass where gravity alone would: they keep the robot file's values. [log] torque_is overrides"
        );
        let finding = Distrust { log: None, joint: None, name: GRAVITY_FREE_NAME, text };
        Ok(Some(GravityFree { robot: with_gravity(robot, [0.0; 3]), gravity, finding }))
    }

    /// The robot as others use it: with its gravity.
    pub(crate) fn restore(&self, robot: &Robot) -> Robot {
        with_gravity(robot, self.gravity)
    }

    /// Gravity of the robot file \[m/s²\], base axes.
    pub(crate) fn gravity(&self) -> [f64; 3] {
        self.gravity
    }
}

/// Why the causes are not reported: the torque of one of them depends on the pose alone, as does that of a driver whose model of
/// gravity is wrong.
pub(crate) fn confused_with_gravity(found: &Diagnosis) -> Option<String> {
    let names = found.causes.iter().map(|cause| cause.effect.name()).filter(|name| OF_POSE.contains(name));
    let names: Vec<&str> = names.collect();
    (!names.is_empty()).then(|| {
        format!(
            "torque is without that of gravity, and what is left of it depends on the pose ({}): the driver compensates another \
             arm's gravity than this one's, as with a load that it does not know, or there is such an effect. Log the whole torque, \
             or motor currents, to separate them",
            names.join(", ").replace('_', " ")
        )
    })
}

fn with_gravity(robot: &Robot, gravity: [f64; 3]) -> Robot {
    let mut robot = robot.clone();
    Arc::make_mut(&mut robot.model).arm.gravity = gravity;
    robot
}

/// Least probability of the logs that are surely without gravity; none where no log is.
fn by_physics<'a>(robot: &Robot, logs: impl IntoIterator<Item = &'a PathBuf>) -> Result<Option<f64>> {
    let (mut least, mut other): (Option<f64>, Option<String>) = (None, None);
    for path in logs {
        let log = runs::read_log(robot, path)?;
        let Some(share) = gravity_share(robot, &log) else { continue };
        let found = if share < PRESENT { reading::compare(robot, &log) } else { None };
        match found.as_ref().and_then(probability) {
            Some(probability) => least = Some(least.map_or(probability, |least| least.min(probability))),
            None => drop(other.get_or_insert_with(|| runs::short_name(path))),
        }
    }
    match (least, other) {
        (Some(_), Some(log)) => Err(Fault::Data(format!(
            "{log}: its torque is not surely without that of gravity, and that of another log is; analyse them apart, or state \
             [log] torque_is"
        ))
        .into()),
        (least, _) => Ok(least),
    }
}

/// Probability that a log's torque is without gravity, summed over all readings that say so; none below 0.95, or where the most probable one
/// has another fault than analyses deal with by themselves (what a drive's limit cuts off, a delay of about a sample). The log is read
/// again with the arm without gravity, which finds other faults.
pub(crate) fn probability(found: &Screening) -> Option<f64> {
    let is_it = |reading: &&Reading| reading.faults.contains(&LogReading::WithoutGravity);
    let is_known = |fault: &LogReading| {
        matches!(fault, LogReading::WithoutGravity | LogReading::BeyondLimit(..)) || fault.is_slight()
    };
    found.readings.first().filter(|best| best.faults.iter().all(is_known))?;
    let sum: f64 = found.readings.iter().filter(is_it).map(|reading| reading.probability).sum();
    (sum >= SURE).then_some(sum.min(1.0))
}

/// How much of the file's gravity is in a log's torque: 1 where all of it is, 0 where none. None of a log without torque, and of an arm
/// on which gravity does not act.
fn gravity_share(robot: &Robot, log: &Log) -> Option<f64> {
    let tau = log.torque().ok()?;
    let (joints, model) = (robot.dof(), &robot.model);
    let mut workspace = Workspace::new(&model.arm);
    let (still, mut regressor) = (vec![0.0; joints], vec![0.0; joints * model.len()]);
    let (mut product, mut square) = (0.0, 0.0);
    for row in (0..log.len()).step_by((log.len() / ROWS).max(1)) {
        let q: Vec<f64> = log.q.iter().map(|q| q[row]).collect();
        model.regressor(&mut workspace, &q, &still, &still, &mut regressor);
        for (of_joint, tau) in regressor.chunks_exact(model.len()).zip(tau) {
            let gravity: f64 = of_joint.iter().zip(&robot.nominal).map(|(y, x)| y * x).sum();
            product += gravity * tau[row];
            square += gravity * gravity;
        }
    }
    (square > 0.0).then(|| product / square)
}
