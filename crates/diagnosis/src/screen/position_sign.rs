//! Positions with the wrong sign: then the torque of every other joint fits another motion.

use nalgebra::{Cholesky, DMatrix, DVector};

use crate::model::log_fault::LogFault;
use crate::model::nominal::{Nominal, standard_columns};
use crate::model::rows::Column;
use crate::model::run::Motion;
use crate::model::standstill::is_still;
use crate::policy::POLICY;
use crate::screen::prepared::Prepared;
use crate::screen::rigid_torque;

/// Columns weaker than this share of their size beside the others are rounding.
const PROJECTED_COLUMN_ROUNDING: f64 = 1e-8;

/// Joints whose position has the wrong sign.
pub(crate) fn of_positions(run: &Prepared, nominal: &Nominal) -> Vec<(usize, LogFault)> {
    let arm = Turned { run, nominal };
    let as_logged = arm.missed(None, None);
    let signs = |j: usize| matches!(run.silent[j], Some(LogFault::Sign(_) | LogFault::Opposite(_)));
    let sound = |j: usize| run.silent[j].is_none() && !is_still(&run.motion, j);
    let joints: Vec<usize> = (0..run.silent.len())
        .filter(|j| signs(*j) || as_logged > POLICY.screening.max_fitting_residual && sound(*j))
        .collect();
    let found = |j: &usize| {
        let turned = arm.missed(Some(*j), None);
        let [than_logged, than_torque] = if signs(*j) {
            [POLICY.screening.max_flipped_residual_share; 2]
        } else {
            [POLICY.screening.max_turned_residual_share, POLICY.screening.max_turned_over_torque]
        };
        let better = turned < POLICY.screening.max_flipped_residual
            && turned < than_logged * as_logged
            && turned < than_torque * arm.missed(None, Some(*j));
        better.then_some((*j, LogFault::PositionSign { as_logged, turned }))
    };
    let mut found: Vec<(usize, LogFault)> = joints.iter().filter_map(found).collect();
    // Turned together with a wrong one, a joint beside it may look better too.
    if found.iter().any(|(j, _)| signs(*j)) {
        found.retain(|(j, _)| signs(*j));
    }
    found
}

/// Marks the joints of runs whose position has the wrong sign, and names them in a sentence; empty where there is none.
pub(crate) fn check<'a>(runs: impl Iterator<Item = &'a mut Prepared>, nominal: &Nominal) -> String {
    let mut names: Vec<&str> = Vec::new();
    for run in runs {
        for (j, fault) in of_positions(run, nominal) {
            run.silent[j] = Some(fault);
            let name = nominal.model.arm.joints[j].name.as_str();
            if !names.contains(&name) {
                names.push(name);
            }
        }
    }
    if names.is_empty() { String::new() } else { format!("of {}", names.join(", ")) }
}

/// A run with a sign turned.
struct Turned<'a> {
    run: &'a Prepared,
    nominal: &'a Nominal,
}

impl Turned<'_> {
    /// What a rigid arm with friction misses of the torque of all joints at best, in units of what is known of it.
    fn missed(&self, position: Option<usize>, torque: Option<usize>) -> f64 {
        let trusted: Vec<usize> =
            (0..self.run.tau.len()).filter(|j| !matches!(self.run.silent[*j], Some(LogFault::Silent { .. }))).collect();
        let flipped_columns;
        let columns = match position {
            Some(j) => {
                let mut motion = self.run.motion.clone();
                flip(&mut motion, j);
                flipped_columns = standard_columns(&self.nominal.model, &motion, &self.run.chain);
                &flipped_columns
            }
            None => &self.run.standard,
        };
        let own_angle = self.of_angle();
        let columns: Vec<&Column> = columns.iter().chain(&own_angle).collect();
        let rows = self.run.rows();
        let used: Vec<usize> = (0..rows).step_by((rows / rigid_torque::ROWS).max(1)).collect();
        let mut y = DMatrix::zeros(used.len() * trusted.len(), columns.len());
        let mut b = DVector::zeros(used.len() * trusted.len());
        for (block, j) in trusted.iter().enumerate() {
            let tau = &self.run.tau[*j];
            let rms = (tau.iter().map(|t| t * t).sum::<f64>() / rows.max(1) as f64).sqrt();
            let known = self.run.floor[*j].hypot(POLICY.screening.rigid_model_error * rms);
            let sign = if torque == Some(*j) { -1.0 } else { 1.0 };
            for (row, k) in used.iter().enumerate() {
                let at = block * used.len() + row;
                // What a joint that stands holds by friction nobody knows.
                let weight = 1.0 / known.hypot(self.run.doubt[*j][*k]).max(f64::MIN_POSITIVE);
                b[at] = sign * weight * tau[*k];
                for (c, column) in columns.iter().enumerate() {
                    if let Some(values) = &column[*j] {
                        y[(at, c)] = weight * values[*k];
                    }
                }
            }
        }
        let count = b.len().max(1) as f64;
        residual_norm(y, &b) / count.sqrt()
    }

    /// Springs and counterbalances, which many arms have: the same whatever the sign.
    fn of_angle(&self) -> Vec<Column> {
        let laws: [fn(f64) -> f64; 3] = [|q| q, f64::sin, f64::cos];
        let joints = self.run.motion.q.len();
        let column = |j: usize, law: fn(f64) -> f64| {
            let full: Vec<f64> = self.run.motion.q[j].iter().map(|q| law(*q)).collect();
            let rows = self.run.chain.apply(&full);
            (0..joints).map(|i| (i == j).then(|| rows.clone())).collect()
        };
        (0..joints).flat_map(|j| laws.map(|law| column(j, law))).collect()
    }
}

fn flip(motion: &mut Motion, j: usize) {
    for signal in [&mut motion.q[j], &mut motion.qd[j], &mut motion.qdd[j]] {
        for v in signal.iter_mut() {
            *v = -*v;
        }
    }
}

/// Norm of what is left of `b` by the columns of `y`.
fn residual_norm(mut y: DMatrix<f64>, b: &DVector<f64>) -> f64 {
    for mut column in y.column_iter_mut() {
        let size = column.norm();
        if size > 0.0 {
            column /= size;
        }
    }
    let mut normal = y.tr_mul(&y);
    for c in 0..normal.ncols() {
        normal[(c, c)] += PROJECTED_COLUMN_ROUNDING;
    }
    let x = Cholesky::new(normal).map(|root| root.solve(&y.tr_mul(b)));
    x.map_or(b.norm(), |x| (b - y * x).norm())
}
