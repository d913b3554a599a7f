//! The energy model against the regressor: d/dt e + p = q̇ᵀY(q, q̇, q̈), column by column, for random arms and drives.

use crate::common::Random;
use rivet_dynamics::{Model, Structure, Workspace, WristCoupling};

#[test]
fn energy_and_dissipation_add_up_to_power() {
    for seed in 0..200 {
        let mut random = Random::new(seed);
        let dof = 2 + seed as usize % 6;
        let arm = random.arm(dof);
        let coupling = (seed % 2 == 0).then_some(WristCoupling { driving: dof - 2, driven: dof - 1 });
        let model =
            Model::new(arm, Structure { offset: seed % 3 == 0, coupling, sign_velocity: 0.05, ..Structure::default() });
        let ws = &mut Workspace::new(&model.arm);
        let [q, qd, qdd] = [3.0, 2.0, 5.0].map(|reach| random.vector(dof, reach));
        let width = model.len();
        let (mut y, mut p) = (vec![f64::NAN; dof * width], vec![f64::NAN; width]);
        model.regressor(ws, &q, &qd, &qdd, &mut y);
        model.dissipation(&qd, &mut p);
        // Energies a little before and after, on the motion of constant acceleration through this state.
        let at = |t: f64| {
            let moved: Vec<f64> = (0..dof).map(|j| q[j] + t * qd[j] + 0.5 * t * t * qdd[j]).collect();
            let faster: Vec<f64> = (0..dof).map(|j| qd[j] + t * qdd[j]).collect();
            let mut e = vec![f64::NAN; width];
            model.energy(ws, &moved, &faster, &mut e);
            e
        };
        let h = 1e-4;
        let energies = [at(-2.0 * h), at(-h), at(h), at(2.0 * h)];
        for c in 0..width {
            let e = |k: usize| energies[k][c];
            let rate = (8.0 * (e(2) - e(1)) - (e(3) - e(0))) / (12.0 * h);
            let power: f64 = (0..dof).map(|j| qd[j] * y[j * width + c]).sum();
            // Differences of fourth order leave h⁴ and rounding over h of the largest energies.
            let size = 1.0 + power.abs() + e(2).abs();
            assert!(
                (rate + p[c] - power).abs() < 1e-9 * size,
                "seed {seed} {:?}: {rate} + {} vs {power}",
                model.parameters[c],
                p[c]
            );
        }
    }
}
