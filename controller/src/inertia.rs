//! Accelerations that base parameters imply, and whether their inertia matrix is one.

use crate::law::ControlLaw;
use crate::matrix::{cholesky_succeeds, solve_factored};
use rivet_dynamics::MAX_JOINTS;

/// Acceleration \[rad/s²\] of an arm with base parameters `x` under `tau`: `M(q)⁻¹·(τ − h(q, q̇))`. `mass` is scratch of dof²
/// numbers. Zeros where the inertia matrix is that of no arm. Real-time safe.
pub(crate) fn acceleration_of(
    law: &mut ControlLaw,
    [q, qd]: [&[f64]; 2],
    tau: &[f64],
    x: &[f64],
    mass: &mut [f64],
) -> [f64; MAX_JOINTS] {
    let n = law.dof();
    let (zero, mut bias) = ([0.0; MAX_JOINTS], [0.0; MAX_JOINTS]);
    law.model_torque(q, qd, &zero[..n], x, &mut bias[..n]);
    let mut net = zero;
    for i in 0..n {
        net[i] = tau[i] - bias[i];
    }
    acceleration_by(law, q, &net, x, mass)
}

/// Acceleration \[rad/s²\] by which a torque `tau` moves an arm with base parameters `x` at `q` beyond what it does without: `M(q)⁻¹·τ`. `mass`
/// is scratch of dof² numbers. Zeros without a torque, and where the inertia matrix is that of no arm. Real-time safe.
pub(crate) fn acceleration_by(
    law: &mut ControlLaw,
    q: &[f64],
    tau: &[f64; MAX_JOINTS],
    x: &[f64],
    mass: &mut [f64],
) -> [f64; MAX_JOINTS] {
    let [a] = accelerations_by(law, q, [tau], x, mass);
    a
}

/// The same for several torques at one pose.
pub(crate) fn accelerations_by<const K: usize>(
    law: &mut ControlLaw,
    q: &[f64],
    tau: [&[f64; MAX_JOINTS]; K],
    x: &[f64],
    mass: &mut [f64],
) -> [[f64; MAX_JOINTS]; K] {
    let n = law.dof();
    let none = [[0.0; MAX_JOINTS]; K];
    if tau.iter().all(|tau| tau[..n].iter().all(|tau| *tau == 0.0)) {
        return none;
    }
    law.inertia(q, x, mass);
    if !cholesky_succeeds(mass, n) {
        return none;
    }
    tau.map(|tau| {
        let mut a = *tau;
        solve_factored(mass, n, &mut a);
        a
    })
}

/// Inertia matrices at fixed poses as linear functions of the base parameters: checking them costs no kinematics.
pub(crate) struct StoredPoses {
    dof: usize,
    count: usize,
    /// Pose by pose, the lower triangle row by row, `count` factors an entry.
    entries: Vec<f64>,
    /// Rows of the regressor at rest, pose by pose.
    gravity: Vec<f64>,
    mass: Vec<f64>,
}

impl StoredPoses {
    pub(crate) fn new(law: &mut ControlLaw, count: usize, poses: &[Vec<f64>]) -> StoredPoses {
        let dof = law.dof();
        let zero = vec![0.0; dof];
        let mut entries = Vec::with_capacity(poses.len() * dof * (dof + 1) / 2 * count);
        let mut gravity = Vec::with_capacity(poses.len() * dof * count);
        for q in poses {
            let flat = |rows: std::slice::ChunksExact<'_, f64>| rows.flatten().copied().collect::<Vec<f64>>();
            let bias = flat(law.regressor(q, &zero, &zero));
            gravity.extend_from_slice(&bias);
            let columns: Vec<Vec<f64>> = (0..dof)
                .map(|j| {
                    let mut unit = zero.clone();
                    unit[j] = 1.0;
                    flat(law.regressor(q, &zero, &unit))
                })
                .collect();
            for i in 0..dof {
                for column in &columns[..=i] {
                    let of = |rows: &[f64], k: usize| rows[i * count + k];
                    entries.extend((0..count).map(|k| of(column, k) - of(&bias, k)));
                }
            }
        }
        StoredPoses { dof, count, entries, gravity, mass: vec![0.0; dof * dof] }
    }

    /// Largest torque \[N·m\] of each joint over the poses with `x`: at rest, plus that of 1 rad/s² of this joint alone. NaN where `x` is
    /// not finite or too large. Real-time safe.
    pub(crate) fn largest_torque(&self, x: &[f64]) -> [f64; MAX_JOINTS] {
        let (n, count) = (self.dof, self.count);
        let mut most = [0.0; MAX_JOINTS];
        let entries = self.entries.chunks_exact(n * (n + 1) / 2 * count);
        for (rest, entries) in self.gravity.chunks_exact(n * count).zip(entries) {
            let dot = |row: &[f64], k: usize| -> f64 {
                row[k * count..(k + 1) * count].iter().zip(x).map(|(y, x)| y * x).sum()
            };
            for (j, most) in most.iter_mut().enumerate().take(n) {
                // The diagonal's place in the lower triangle.
                let torque = dot(rest, j).abs() + dot(entries, j * (j + 3) / 2).abs();
                // A maximum that keeps what is not a number.
                *most = if torque <= *most { *most } else { torque };
            }
        }
        most
    }

    /// Whether `x` gives a positive definite inertia matrix at every pose. Real-time safe.
    pub(crate) fn all_positive(&mut self, x: &[f64]) -> bool {
        let n = self.dof;
        for pose in self.entries.chunks_exact(n * (n + 1) / 2 * self.count) {
            let mut entry = pose.chunks_exact(self.count);
            for i in 0..n {
                for j in 0..=i {
                    let factors = entry.next().unwrap_or(&[]);
                    self.mass[i * n + j] = factors.iter().zip(x).map(|(y, x)| y * x).sum();
                }
            }
            if !cholesky_succeeds(&mut self.mass, n) {
                return false;
            }
        }
        true
    }
}
