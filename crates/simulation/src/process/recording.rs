//! A simulated arm under computed torque of its nominal model, as a recording: no process, no bus, no clock.

use super::SimError;
use super::options::{Options, nominal_joints};
use super::output::TruthFile;
use crate::closed_loop::closed_loop;
use crate::plant::Plant;
use crate::truth::Truth;
use rivet_config::Robot;
use rivet_dynamics::{MAX_JOINTS, Workspace};

/// Bandwidth of the position loop \[Hz\], critically damped.
const LOOP_HZ: f64 = 4.0;
/// Samples over which the velocity is a difference of positions.
const VELOCITY_SAMPLES: usize = 5;

/// What a robot controller would have recorded, and the true parameters. Signals are `[joint][sample]`, in the model's zero.
#[derive(Clone, Debug)]
pub struct Recording {
    /// Time \[s\].
    pub t: Vec<f64>,
    /// Measured positions \[rad\].
    pub q: Vec<Vec<f64>>,
    /// Measured torque \[N m\], joint side of the gear.
    pub tau: Vec<Vec<f64>>,
    /// Planned positions \[rad\], velocities \[rad/s\] and accelerations \[rad/s²\].
    pub planned: [Vec<Vec<f64>>; 3],
    /// True and nominal parameters.
    pub truth: TruthFile,
}

impl Recording {
    /// Simulates `options.duration` seconds of motion of `robot` (10 s without it). Options of the bus and of files have no part in it.
    ///
    /// # Errors
    /// A file of setpoints that cannot be read.
    pub fn new(robot: &Robot, options: &Options) -> Result<Recording, SimError> {
        let (n, period_s) = (robot.dof(), robot.config.sample_period_s);
        let disturbances = options.disturbances(robot);
        let truth = Truth::new(&robot.model, &nominal_joints(robot), &disturbances);
        let mut plant = Plant::new(&truth, &options.sensors(robot), &options.plant(robot), options.seed(robot));
        let trajectory = options.trajectory(robot)?;
        let (mut home, mut zero) = ([0.0; MAX_JOINTS], [[0.0; MAX_JOINTS]; 2]);
        let [qd, qdd] = &mut zero;
        trajectory.sample(0.0, &mut home[..n], &mut qd[..n], &mut qdd[..n]);
        plant.place(&home[..n], &[0.0; MAX_JOINTS][..n]);
        let samples = (options.duration.unwrap_or(10.0) / period_s).round() as usize;
        let signals = || vec![Vec::with_capacity(samples); n];
        let (mut t, mut q, mut tau) = (Vec::with_capacity(samples), signals(), signals());
        let mut planned = [signals(), signals(), signals()];
        let (mut workspace, mut rows) = (Workspace::new(&robot.model.arm), vec![0.0; n * robot.model.len()]);
        let mut past = vec![vec![0.0; n]; VELOCITY_SAMPLES];
        let (mut count, w) = (0_usize, core::f64::consts::TAU * LOOP_HZ);
        let control = |measured: &crate::Measurement, setpoint: &crate::SetpointRef<'_>, command: &mut [f64]| {
            let before = &mut past[count % VELOCITY_SAMPLES];
            let mut acceleration = [0.0; MAX_JOINTS];
            for j in 0..n {
                let moved = (measured.q()[j] - before[j]) / (VELOCITY_SAMPLES as f64 * period_s);
                let speed = if count < VELOCITY_SAMPLES { setpoint.qd[j] } else { moved };
                let (error, rate) = (setpoint.q[j] - measured.q()[j], setpoint.qd[j] - speed);
                acceleration[j] = setpoint.qdd[j] + w * w * error + 2.0 * w * rate;
            }
            before.copy_from_slice(measured.q());
            count += 1;
            robot.model.regressor(&mut workspace, measured.q(), setpoint.qd, &acceleration[..n], &mut rows);
            for (command, row) in command.iter_mut().zip(rows.chunks_exact(robot.model.len())) {
                *command = row.iter().zip(&robot.nominal).map(|(y, x)| y * x).sum();
            }
        };
        closed_loop(&mut plant, trajectory.as_ref(), control, samples, |record| {
            t.push(record.measured.t_s);
            let setpoint = record.setpoint;
            for j in 0..n {
                q[j].push(record.measured.q()[j]);
                tau[j].push(record.measured.tau()[j]);
                for (planned, value) in planned.iter_mut().zip([setpoint.q, setpoint.qd, setpoint.qdd]) {
                    planned[j].push(value[j]);
                }
            }
        });
        Ok(Recording { t, q, tau, planned, truth: TruthFile::new(robot, &truth, &disturbances) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    /// Mean torque of a joint \[N m\].
    fn mean(signal: &[f64]) -> f64 {
        signal.iter().sum::<f64>() / signal.len() as f64
    }

    #[test]
    fn records_the_same_bits_and_the_true_payload() {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../robots/ur10e/robot.toml");
        let robot = rivet_config::load(&file).expect("a robot file");
        let record = |payload| {
            let options = Options { duration: Some(2.0), seed: Some(3), payload, ..Options::new(&file) };
            Recording::new(&robot, &options).expect("a recording")
        };
        let (unloaded, loaded) = (record(None), record(Some(4.0)));
        assert_eq!((unloaded.t.len(), unloaded.q.len()), (2000, 6));
        assert_eq!(record(Some(4.0)).tau, loaded.tau);
        let last = loaded.truth.standard.iter().find(|p| p.name == "l6.m").expect("the mass of the last link");
        assert!((last.value - last.nominal - 4.0).abs() < 1e-12, "{last:?}");
        // The shoulder carries 4 kg more, by whatever lever this motion has.
        assert!((mean(&loaded.tau[1]) - mean(&unloaded.tau[1])).abs() > 5.0);
    }
}
