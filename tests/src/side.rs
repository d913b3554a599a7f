//! The robot's side of the bus, and the daemon as a process beside it.

use crate::process;
use rivet_config::Robot;
use rivet_dynamics::Workspace;
use rivet_ipc_schema::{BusConfig, JointState};
use std::fs::File;
use std::path::Path;
use std::process::Command;

/// `rivet daemon` for the robot file, what it says in the file `said`.
pub fn daemon(robot: &Path, config: &BusConfig, said: &Path) -> Command {
    let mut command = process::daemon(robot, config);
    command.stderr(File::options().create(true).append(true).open(said).expect("a file"));
    command
}

/// A sound arm on sums of sines, its torques those of other parameters than the robot file's: sample `seq` is always the same.
#[derive(Debug)]
pub struct Arm {
    robot: Robot,
    workspace: Workspace,
    rows: Vec<f64>,
    truth: Vec<f64>,
}

impl Arm {
    /// The arm of `robot`.
    pub fn new(robot: &Robot) -> Arm {
        let truth = robot.nominal.iter().enumerate().map(|(i, x)| x * (1.0 + 0.1 * (i as f64).sin())).collect();
        let (n, p) = (robot.dof(), robot.model.len());
        Arm { robot: robot.clone(), workspace: Workspace::new(&robot.model.arm), rows: vec![0.0; n * p], truth }
    }

    /// Sample `seq`, with a little noise on the torques.
    pub fn at(&mut self, seq: u64) -> JointState {
        let n = self.robot.dof();
        let (t, period) = (seq as f64 * self.robot.config.sample_period_s, self.robot.config.sample_period_s);
        let mut state = JointState { seq, joints: n as u32, ..JointState::default() };
        state.stamp_ns = (seq as f64 * period * 1e9).round() as u64;
        let (mut q, mut qd, mut qdd) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
        for j in 0..n {
            for (a, f) in [(0.4, 0.31 + 0.13 * j as f64), (0.3, 0.83 + 0.21 * j as f64)] {
                let w = std::f64::consts::TAU * f;
                q[j] += a * (w * t).sin();
                qd[j] += a * w * (w * t).cos();
                qdd[j] -= a * w * w * (w * t).sin();
            }
        }
        self.robot.model.regressor(&mut self.workspace, &q, &qd, &qdd, &mut self.rows);
        for (j, row) in self.rows.chunks_exact(self.robot.model.len()).enumerate() {
            // A hash of the number: noise that every process agrees on.
            let hash = (seq * 8 + j as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 11;
            let noise = 0.05 * (hash as f64 / (1_u64 << 52) as f64 - 1.0);
            state.q[j] = q[j];
            state.tau[j] = row.iter().zip(&self.truth).map(|(y, x)| y * x).sum::<f64>() + noise;
        }
        state
    }
}
