//! Rigid-body torque of the nominal model with a turned joint or another gravity, and its part that free drives cannot explain.
//!
//! Values and effects share a wrong angle or a wrong gravity out among themselves, so neither is fitted here: bodies are the file's, and
//! each joint's rotor, friction and offset are whatever explains most. What is left then is in units of what is known of a torque.

use nalgebra::{DMatrix, DVector};
use rivet_dynamics::{Arm, Places, Workspace, inverse_dynamics};

use crate::effects::physics::bodies;
use crate::model::nominal::Nominal;
use crate::model::rows::Column;
use crate::policy::POLICY;
use crate::screen::prepared::Prepared;

/// Rows that are looked at, spread over each run.
pub(crate) const ROWS: usize = 400;
/// Directions that the motion hardly tells are rounding.
const MOTION_DIRECTION_ROUNDING: f64 = 1e-6;
/// Columns that are this much smaller than the largest are rounding.
const COLUMN_ROUNDING: f64 = 1e-13;

/// Positions, speeds or accelerations, `[joint][sample]`.
type Signals = Vec<Vec<f64>>;

/// One run's bodies along its motion, at the rate at which rows are filtered.
pub(crate) struct Bodies<'a> {
    run: &'a Prepared,
    arm: &'a Arm,
    links: Vec<[f64; 10]>,
    motion: [Signals; 3],
}

impl<'a> Bodies<'a> {
    pub(crate) fn from_run(run: &'a Prepared, nominal: &'a Nominal) -> Bodies<'a> {
        let averaged = |signals: &Signals| signals.iter().map(|s| run.chain.averaged(s)).collect();
        let motion = [&run.motion.q, &run.motion.qd, &run.motion.qdd].map(averaged);
        Bodies { run, arm: &nominal.model.arm, links: bodies(&nominal.x, run.tau.len()), motion }
    }

    /// Their torque along the motion as it was logged.
    pub(crate) fn as_given(&self) -> Column {
        self.turned(0, 0.0)
    }

    /// Their torque where joint `j` stands so much farther than was logged \[rad\].
    pub(crate) fn turned(&self, j: usize, by: f64) -> Column {
        self.torque(self.arm, [0, 0], (j, by), true)
    }

    /// Their torque where two joints stand in each other's place, in the places of the log.
    pub(crate) fn exchanged(&self, a: usize, b: usize) -> Column {
        self.torque(self.arm, [a, b], (0, 0.0), true)
    }

    /// Their torque at rest per m/s² of gravity along an axis of the base.
    pub(crate) fn weight(&self, axis: [f64; 3]) -> Column {
        let mut arm = self.arm.clone();
        arm.gravity = axis;
        self.torque(&arm, [0, 0], (0, 0.0), false)
    }

    fn torque(&self, arm: &Arm, exchanged: [usize; 2], (turned, by): (usize, f64), moves: bool) -> Column {
        let n = self.links.len();
        let mut ws = Workspace::new(arm);
        let [mut now, mut tau] = [vec![vec![0.0; n]; 3], vec![vec![0.0; n]]];
        let mut rows: Signals = vec![Vec::new(); n];
        for k in 0..self.motion[0].first().map_or(0, Vec::len) {
            for (signals, now) in self.motion.iter().zip(&mut now).take(if moves { 3 } else { 1 }) {
                signals.iter().zip(now.iter_mut()).for_each(|(signal, now)| *now = signal[k]);
            }
            for now in &mut now {
                now.swap(exchanged[0], exchanged[1]);
            }
            now[0][turned] += by;
            inverse_dynamics(arm, &self.links, &mut ws, &now[0], &now[1], &now[2], &mut tau[0]);
            tau[0].swap(exchanged[0], exchanged[1]);
            rows.iter_mut().zip(&tau[0]).for_each(|(rows, tau)| rows.push(*tau));
        }
        rows.into_iter().map(|rows| Some(self.run.chain.filtered(rows))).collect()
    }
}

/// A joint's rows of all runs: their weights, and what its drive can make of them.
struct Joint {
    at: usize,
    /// `[run][row looked at]`, 0 where the torque is not believed.
    weights: Vec<Vec<f64>>,
    drive: DMatrix<f64>,
}

/// Runs with each joint's drive free.
pub(crate) struct FreeDrives<'a> {
    runs: Vec<&'a Prepared>,
    joints: Vec<Joint>,
    rows: f64,
}

impl<'a> FreeDrives<'a> {
    pub(crate) fn new(runs: &'a [Prepared], nominal: &Nominal) -> FreeDrives<'a> {
        let runs: Vec<&Prepared> = runs.iter().collect();
        let n = nominal.model.arm.dof();
        let joint = |joint: usize| {
            let weights: Vec<Vec<f64>> = runs.iter().map(|run| weights(run, joint)).collect();
            let weighed_column = |c: usize| weighed(&runs, &weights, |run| run.standard[c][joint].as_deref());
            let columns: Vec<DVector<f64>> = (Places::new(n).bodies().end..nominal.model.len())
                .map(weighed_column)
                .filter(|c| c.norm() > 0.0)
                .collect();
            let columns: Vec<DVector<f64>> = columns.into_iter().map(|c| c.normalize()).collect();
            let rows = weights.iter().map(Vec::len).sum();
            let mut drive = DMatrix::zeros(rows, 0);
            if !columns.is_empty() {
                drive = range(&DMatrix::from_columns(&columns), MOTION_DIRECTION_ROUNDING).unwrap_or(drive);
            }
            Joint { at: joint, weights, drive }
        };
        let joints: Vec<Joint> = (0..n).map(joint).collect();
        let rows = joints.iter().flat_map(|j| j.weights.iter().flatten()).filter(|w| **w > 0.0).count() as f64;
        FreeDrives { runs, joints, rows: f64::max(rows, 1.0) }
    }

    /// What drives cannot make of a torque, weighed, joint by joint; `torque`: of each run.
    pub(crate) fn without_drives(&self, torque: &[Column]) -> Vec<DVector<f64>> {
        let without_drive = |joint: &Joint| {
            let at = |run: usize| torque[run][joint.at].as_deref();
            let mut runs = 0..;
            let rows = weighed(&self.runs, &joint.weights, |_| runs.next().and_then(at));
            &rows - &joint.drive * joint.drive.tr_mul(&rows)
        };
        self.joints.iter().map(without_drive).collect()
    }

    /// The measured torque less the effects that the file has.
    pub(crate) fn measured(&self) -> Vec<DVector<f64>> {
        let less = |run: &&Prepared| -> Column {
            let without_known = |(j, tau): (usize, &Vec<f64>)| {
                let known = run.known_rows.get(j);
                Some(tau.iter().enumerate().map(|(k, tau)| tau - known.map_or(0.0, |rows| rows[k])).collect())
            };
            run.tau.iter().enumerate().map(without_known).collect()
        };
        self.without_drives(&self.runs.iter().map(less).collect::<Vec<_>>())
    }

    /// Of what is left of all joints below each other, what a body of link `link` (from 0) of any mass, place and inertia cannot take, root mean
    /// square.
    pub(crate) fn with_body(&self, left: &DVector<f64>, link: usize) -> f64 {
        let body_column = |c: usize| {
            joined(&self.without_drives(&self.runs.iter().map(|run| run.standard[c].clone()).collect::<Vec<_>>()))
        };
        let columns: Vec<DVector<f64>> = Places::link(link).map(body_column).filter(|c| c.norm() > 0.0).collect();
        let columns: Vec<DVector<f64>> = columns.into_iter().map(|c| c.normalize()).collect();
        let taken =
            if columns.is_empty() { None } else { range(&DMatrix::from_columns(&columns), MOTION_DIRECTION_ROUNDING) };
        let rest = taken.map_or_else(|| left.clone(), |range| left - &range * range.tr_mul(left));
        self.size(std::slice::from_ref(&rest))
    }

    /// Root mean square of what is left of all joints.
    pub(crate) fn size(&self, left: &[DVector<f64>]) -> f64 {
        (left.iter().map(DVector::norm_squared).sum::<f64>() / self.rows).sqrt()
    }
}

/// An orthonormal basis of what columns reach, without the directions below `rounding` of the strongest; none where there is none, or where the
/// decomposition comes to no end (columns that are nothing but rounding, of a wrist that stands at zero, made it a number that is none).
pub(crate) fn range(columns: &DMatrix<f64>, rounding: f64) -> Option<DMatrix<f64>> {
    let size: Vec<f64> = columns.column_iter().map(|c| c.norm()).collect();
    let largest = size.iter().copied().fold(0.0, f64::max);
    let nonzero: Vec<usize> = (0..size.len()).filter(|k| size[*k] > COLUMN_ROUNDING * largest).collect();
    if nonzero.is_empty() || !largest.is_finite() {
        return None;
    }
    let mut scaled = columns.select_columns(&nonzero);
    for mut column in scaled.column_iter_mut() {
        column.normalize_mut();
    }
    let svd = scaled.svd_unordered(true, false);
    if svd.singular_values.iter().any(|value| !value.is_finite()) {
        return None;
    }
    let least = rounding * svd.singular_values.max();
    let identifiable: Vec<usize> = (0..svd.singular_values.len()).filter(|k| svd.singular_values[*k] > least).collect();
    svd.u.map(|u| u.select_columns(&identifiable))
}

/// All joints' rows below each other.
pub(crate) fn joined(joints: &[DVector<f64>]) -> DVector<f64> {
    DVector::from_iterator(joints.iter().map(DVector::len).sum(), joints.iter().flat_map(|rows| rows.iter().copied()))
}

/// One over what is known of the torque of joint `j` \[1/(N·m)\], at the rows looked at.
fn weights(run: &Prepared, j: usize) -> Vec<f64> {
    let (tau, rows) = (&run.tau[j], run.rows());
    let rms = (tau.iter().map(|t| t * t).sum::<f64>() / rows.max(1) as f64).sqrt();
    let known = run.floor[j].hypot(POLICY.screening.rigid_model_error * rms);
    // What a joint that stands holds by friction nobody knows.
    let weight = |k: usize| 1.0 / known.hypot(run.doubt[j][k]).max(f64::MIN_POSITIVE);
    looked_at(rows).map(|k| if run.silent[j].is_none() { weight(k) } else { 0.0 }).collect()
}

fn looked_at(rows: usize) -> impl Iterator<Item = usize> {
    (0..rows).step_by((rows / ROWS).max(1))
}

/// The rows looked at of all runs, each times its weight.
fn weighed<'a>(
    runs: &[&'a Prepared],
    weights: &[Vec<f64>],
    mut of: impl FnMut(&'a Prepared) -> Option<&'a [f64]>,
) -> DVector<f64> {
    let mut all = Vec::new();
    for (run, weights) in runs.iter().zip(weights) {
        match of(run) {
            Some(rows) => all.extend(looked_at(run.rows()).zip(weights).map(|(k, weight)| weight * rows[k])),
            None => all.extend(std::iter::repeat_n(0.0, weights.len())),
        }
    }
    DVector::from_vec(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The second is the first but for rounding, the third rounding alone, the fourth nothing.
    #[test]
    fn columns_that_are_rounding_are_no_direction() {
        let column = |k: usize| DVector::from_fn(40, |row, _| ((row * (k + 3)) as f64).sin());
        let columns =
            [column(0), column(0) + 1e-9 * column(1), 1e-17 * column(2), DVector::zeros(40), 1e-3 * column(3)];
        let basis = range(&DMatrix::from_columns(&columns), MOTION_DIRECTION_ROUNDING).expect("two directions");
        assert_eq!(basis.ncols(), 2);
        assert!((basis.tr_mul(&basis) - DMatrix::identity(2, 2)).norm() < 1e-12);
        assert_eq!(range(&DMatrix::zeros(40, 3), MOTION_DIRECTION_ROUNDING), None);
        assert_eq!(range(&DMatrix::repeat(40, 2, f64::NAN), MOTION_DIRECTION_ROUNDING), None);
    }
}
