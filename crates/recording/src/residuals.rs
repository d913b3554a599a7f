//! Measured torque against the torque that the published parameters predict.

use std::sync::Arc;

use rivet_config::Robot;
use rivet_estimation::{SettingsError, TorqueRows};
use rivet_ipc_schema::{JointState, Parameters, parameter_flags};
use schemars::JsonSchema;
use serde::Serialize;

/// Time between two residuals at least \[ns\].
const LEAST_BETWEEN_NS: u64 = 10_000_000;

/// Measured and predicted torque of each joint, through the estimator's model filter.
///
/// A joint at rest has no residual, since its friction has no direction. Known effects of the robot file are taken from the
/// measured torque.
#[derive(Clone, Debug, Default, PartialEq, Serialize, JsonSchema)]
pub struct Residual {
    /// Sequence number of the newest joint state in the filter.
    pub seq: u64,
    /// Its stamp, `CLOCK_MONOTONIC` [ns]. The torques are older by the delay of differentiation and filter.
    pub stamp_ns: u64,
    /// Epoch of the parameters, the last set that was not provisional; 0 before the first.
    pub epoch: u64,
    /// Filtered measured torque of each joint [N m, or N].
    pub torque: Vec<f64>,
    /// Torque by these parameters [N m, or N]; null before the first set.
    pub predicted: Vec<f64>,
    /// Measured minus predicted torque [N m, or N]; null at rest and before the first set.
    pub residual: Vec<f64>,
    /// Measured torque minus that by the robot file's parameters [N m, or N]; null at rest.
    pub nominal_residual: Vec<f64>,
}

/// Follows the joint states and the parameters of one robot.
#[derive(Debug)]
pub(crate) struct Residuals {
    chain: TorqueRows,
    dof: usize,
    count: usize,
    nominal: Vec<f64>,
    latest: Option<(u64, Vec<f64>)>,
    /// Sequence number that continues the stream.
    next_seq: Option<u64>,
    /// Stamp of the last residual \[ns\].
    last_ns: Option<u64>,
}

impl Residuals {
    pub(crate) fn new(robot: &Robot) -> Result<Residuals, SettingsError> {
        let settings = robot.config.estimation_settings();
        Ok(Residuals {
            chain: TorqueRows::new(Arc::clone(&robot.model), &robot.base, &settings)?,
            dof: robot.dof(),
            count: robot.base.len(),
            nominal: robot.nominal_base.clone(),
            latest: None,
            next_seq: None,
            last_ns: None,
        })
    }

    /// Takes in a parameter set of this robot's model. One that has too little data behind it for a controller is left out:
    /// the set before it stays in use.
    pub(crate) fn use_parameters(&mut self, set: &Parameters) {
        if set.flags & parameter_flags::PROVISIONAL != 0 {
            return;
        }
        self.latest = Some((set.epoch, set.values[..self.count].to_vec()));
    }

    /// Takes in a joint state; a residual at most every 10 ms.
    pub(crate) fn take(&mut self, state: &JointState) -> Option<Residual> {
        if self.next_seq != Some(state.seq) {
            self.chain.restart();
            self.last_ns = None;
        }
        self.next_seq = Some(state.seq.wrapping_add(1));
        if state.faults != 0 || state.count() != self.dof {
            self.chain.restart();
            return None;
        }
        if !self.chain.push(&state.q[..self.dof], &state.tau[..self.dof]) {
            return None;
        }
        // Stamps that jump back begin a time of their own.
        if self.last_ns.is_some_and(|last| (last..last.saturating_add(LEAST_BETWEEN_NS)).contains(&state.stamp_ns)) {
            return None;
        }
        self.last_ns = Some(state.stamp_ns);
        let by = |values: &[f64]| -> Vec<f64> {
            let rows = self.chain.rows().chunks_exact(self.count);
            rows.map(|row| row.iter().zip(values).map(|(y, x)| y * x).sum()).collect()
        };
        let torque = self.chain.tau().to_vec();
        let unknown = || vec![f64::NAN; self.dof];
        let (epoch, predicted) = self.latest.as_ref().map_or_else(|| (0, unknown()), |(epoch, x)| (*epoch, by(x)));
        let moving = self.chain.used();
        let gap = |predicted: &[f64]| -> Vec<f64> {
            let each = torque.iter().zip(predicted).zip(moving);
            each.map(|((torque, predicted), moves)| if *moves { torque - predicted } else { f64::NAN }).collect()
        };
        let (residual, nominal_residual) = (gap(&predicted), gap(&by(&self.nominal)));
        Some(Residual {
            seq: state.seq,
            stamp_ns: state.stamp_ns,
            epoch,
            torque,
            predicted,
            residual,
            nominal_residual,
        })
    }
}
