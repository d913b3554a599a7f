//! A motion in closed form, and a log of it.

use std::f64::consts::TAU;
use std::path::Path;

use rivet_config::Robot;
use rivet_dynamics::Workspace;
use rivet_logs::write_columns;

use crate::altered::Random;

/// Sines on every joint: harmonics of one frequency, each of a size that falls with its number.
pub struct Sines {
    /// \[Hz\]
    pub hz: f64,
    /// How many.
    pub harmonics: u32,
    /// Of the first \[rad\].
    pub size: f64,
    /// Tells one motion from another: of the phases.
    pub shift: f64,
}

impl Sines {
    /// Position \[rad\], velocity \[rad/s\] and acceleration \[rad/s²\] of `joints` joints at `t` \[s\].
    pub fn at(&self, t: f64, joints: usize) -> [Vec<f64>; 3] {
        let mut state = [vec![0.0; joints], vec![0.0; joints], vec![0.0; joints]];
        for j in 0..joints {
            for harmonic in (1..=self.harmonics).map(f64::from) {
                let rate = TAU * self.hz * harmonic;
                let phase = rate * t + (2.0 + j as f64 + self.shift) * harmonic * 1.7;
                let size = self.size / harmonic;
                state[0][j] += size * phase.sin();
                state[1][j] += size * rate * phase.cos();
                state[2][j] -= size * rate * rate * phase.sin();
            }
        }
        state
    }

    /// Half a minute at 250 Hz of an arm with the standard parameters `x`: `joints` move, the others stand at 0 without friction. Noise of the
    /// torque is a two-hundredth of what each joint can.
    ///
    /// # Panics
    /// If the file cannot be written.
    pub fn log(&self, arm: &Robot, x: &[f64], joints: &[usize], random: &mut Random, path: &Path) {
        let (model, n) = (&arm.model, arm.dof());
        let t: Vec<f64> = (0..7500).map(|k| 4e-3 * f64::from(k)).collect();
        let mut columns = vec![vec![0.0; t.len()]; 2 * n];
        let (mut y, mut ws) = (vec![0.0; n * model.len()], Workspace::new(&model.arm));
        for (k, t) in t.iter().enumerate() {
            let mut state = self.at(*t, n);
            for j in (0..n).filter(|j| !joints.contains(j)) {
                for of in &mut state {
                    of[j] = 0.0;
                }
            }
            let [q, qd, qdd] = state;
            model.regressor(&mut ws, &q, &qd, &qdd, &mut y);
            for j in 0..n {
                let torque: f64 = y[j * model.len()..][..model.len()].iter().zip(x).map(|(y, x)| y * x).sum();
                columns[j][k] = q[j];
                columns[n + j][k] = torque + 0.005 * arm.config.drive.torque_limit[j] * random.normal();
            }
        }
        let names = (1..=n).map(|j| format!("q{j}")).chain((1..=n).map(|j| format!("tau{j}")));
        let signals = names.zip(columns.iter().map(Vec::as_slice));
        let columns: Vec<(String, &[f64])> = [("t".to_owned(), t.as_slice())].into_iter().chain(signals).collect();
        write_columns(path, &columns).expect("the log is written");
    }
}
