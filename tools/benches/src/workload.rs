//! The work that all benchmarks share: one arm, one periodic motion, torques with noise.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use rivet_config::Robot;
use rivet_dynamics::Workspace;
use rivet_estimation::{Motion, Settings};
use rivet_simulation::Random;
use rivet_simulation::motion::{Fourier, FourierSettings, MotionLimits, Trajectory, load_ratio};

/// The arm of the benchmarks: six axes and a coupled wrist, 61 base parameters.
pub const ROBOT: &str = "robots/staubli-tx40/robot.toml";
/// The motion repeats after so many seconds.
const PERIOD_S: f64 = 5.0;
/// It has grown to its full size after these.
const GROWN_S: f64 = 10.0;
/// Torque noise, as a share of each joint's torque limit.
const TORQUE_NOISE: f64 = 0.002;

/// Samples of all joints, row-major: joint after joint in each row.
#[derive(Clone, Debug, Default)]
pub struct Samples {
    /// Measured positions \[rad\], rounded to the encoder.
    pub q: Vec<f64>,
    /// Measured torques \[N m\].
    pub tau: Vec<f64>,
    /// The motion as planned and as followed.
    pub q_des: Vec<f64>,
    /// Its velocity \[rad/s\].
    pub qd_des: Vec<f64>,
    /// Its acceleration \[rad/s^2\].
    pub qdd_des: Vec<f64>,
}

/// An arm and a stretch of its motion.
#[derive(Clone, Debug)]
pub struct Workload {
    /// The arm with its drives.
    pub robot: Robot,
    /// One period of the motion or, for [`Workload::long`], as much as was asked for.
    pub samples: Samples,
    /// Number of samples.
    pub len: usize,
}

/// The project's folder.
pub fn project() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

impl Workload {
    /// One whole period of the motion: its end joins its beginning.
    pub fn new() -> Result<Workload> {
        Workload::long(PERIOD_S)
    }

    /// So many seconds of the motion.
    pub fn long(seconds: f64) -> Result<Workload> {
        let path = project().join(ROBOT);
        let robot = rivet_config::load(&path).with_context(|| path.display().to_string())?;
        let (n, width, period) = (robot.dof(), robot.model.len(), robot.config.sample_period_s);
        let len = (seconds / period).round() as usize;
        let limits = MotionLimits::of(&robot.model.arm, 0.6);
        let motion = FourierSettings { base_hz: 1.0 / PERIOD_S, ..FourierSettings::default() };
        let limit = &robot.config.drive.torque_limit;
        let motion = Fourier::new(&limits, &motion, &mut load_ratio(&robot.model, &robot.nominal, limit));
        let mut random = Random::new(1);
        let mut ws = Workspace::new(&robot.model.arm);
        let mut y = vec![0.0; n * width];
        let (mut q, mut qd, mut qdd) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
        let mut samples = Samples::default();
        for k in 0..len {
            motion.sample(GROWN_S + k as f64 * period, &mut q, &mut qd, &mut qdd);
            robot.model.regressor(&mut ws, &q, &qd, &qdd, &mut y);
            for j in 0..n {
                let step = robot.config.drive.encoder_resolution[j];
                samples.q.push(if step > 0.0 { (q[j] / step).round() * step } else { q[j] });
                let torque: f64 = y[j * width..(j + 1) * width].iter().zip(&robot.nominal).map(|(y, x)| y * x).sum();
                samples.tau.push(torque + TORQUE_NOISE * limit[j] * random.normal());
            }
            samples.q_des.extend(&q);
            samples.qd_des.extend(&qd);
            samples.qdd_des.extend(&qdd);
        }
        Ok(Workload { robot, samples, len })
    }

    /// The robot file's settings with a row of equations every `decimation`-th sample.
    pub fn settings(&self, decimation: usize) -> Settings {
        Settings { decimation, ..self.robot.config.estimation_settings() }
    }

    /// Row `k` of one of the [`Samples`].
    pub fn row<'a>(&self, signal: &'a [f64], k: usize) -> &'a [f64] {
        let n = self.robot.dof();
        &signal[k * n..(k + 1) * n]
    }

    /// The planned motion at sample `k`.
    pub fn planned(&self, k: usize) -> Motion<'_> {
        let s = &self.samples;
        Motion { q: self.row(&s.q_des, k), qd: self.row(&s.qd_des, k), qdd: self.row(&s.qdd_des, k) }
    }
}
