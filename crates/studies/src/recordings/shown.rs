//! Whether a recording shows a change of its channels: by the arm that made it, known from the recording before the change.
//!
//! It shares nothing with what it judges: plain batch least squares of the unchanged recording stands for full knowledge of the arm.

use nalgebra::DVector;
use rivet_config::Robot;
use rivet_dynamics::Model;
use rivet_logs::Log;

use crate::batch::{Grid, LowPass, Rows, least_squares, rows};

/// Cut-off of the comparison \[Hz\].
const CUTOFF_HZ: f64 = 5.0;
/// Shortest time between samples of the comparison \[s\].
const MIN_PERIOD_S: f64 = 0.01;
/// Time between rows that are compared \[s\].
const ROW_S: f64 = 0.05;
/// A recording shows a change where the residual rms of some joint rises by this factor. On 40 independent rows a factor of 1.25 is a
/// likelihood ratio of 40 ln 1.25 = 9 nats.
const MIN_RISE: f64 = 1.25;
/// Residual below which nothing is seen, as a share of the torque: digits of the file.
const MIN_RESIDUAL: f64 = 1e-4;
/// A joint moves by this at least, so that the arm is known at all \[rad\].
const MIN_TRAVEL_RAD: f64 = 1e-3;

/// An arm as one of its recordings shows it.
pub(super) struct Arm {
    model: Model,
    values: DVector<f64>,
    /// Rms of residual and torque of each joint \[N m\].
    residual: Vec<f64>,
}

impl Arm {
    /// From a recording whose channels are right; none where nothing moves.
    pub(super) fn of(robot: &Robot, log: &Log) -> Option<Arm> {
        let model = robot.with_offsets().ok()?.model.as_ref().clone();
        let rows = rows_of(&model, log)?;
        let values = least_squares(std::slice::from_ref(&rows));
        let rms = |x: &DVector<f64>| x.norm() / (x.len().max(1) as f64).sqrt();
        let residual = residuals(&rows, &values);
        let residual = residual.iter().zip(&rows.tau).map(|(r, tau)| r.max(MIN_RESIDUAL * rms(tau))).collect();
        Some(Arm { model, values, residual })
    }

    /// Whether a recording, read as it is, is not one of this arm.
    pub(super) fn contradicts(&self, log: &Log) -> bool {
        let Some(rows) = rows_of(&self.model, log) else { return false };
        residuals(&rows, &self.values).iter().zip(&self.residual).any(|(after, before)| *after > MIN_RISE * before)
    }
}

fn rows_of(model: &Model, log: &Log) -> Option<Rows> {
    let span = |q: &[f64]| q.iter().copied().fold(f64::MIN, f64::max) - q.iter().copied().fold(f64::MAX, f64::min);
    if log.q.iter().all(|q| span(q) < MIN_TRAVEL_RAD) {
        return None;
    }
    let period_s = log.median_step_s().max(MIN_PERIOD_S);
    let grid = Grid::new(log, period_s);
    let filter = LowPass::new(CUTOFF_HZ, period_s);
    if grid.t.len() < 4 * filter.half() {
        return None;
    }
    let every = (ROW_S / period_s).round().max(1.0) as usize;
    Some(rows(model, &grid, &filter, &vec![0.0; model.arm.dof()], every))
}

/// Residual rms of each joint \[N m\].
fn residuals(rows: &Rows, values: &DVector<f64>) -> Vec<f64> {
    let of = |(d, tau): (&nalgebra::DMatrix<f64>, &DVector<f64>)| {
        (tau - d * values).norm() / (tau.len().max(1) as f64).sqrt()
    };
    rows.d.iter().zip(&rows.tau).map(of).collect()
}
