//! What the robot controller measures: quantised motor-side encoders and noisy drive torques.

use crate::mechanics::Vector;
use crate::random::Random;
use crate::truth::Truth;
use rivet_dynamics::{KnownEffect, MAX_JOINTS, WristCoupling};

/// Quality of the measurements, one value a joint.
#[derive(Clone, Debug, PartialEq)]
pub struct Sensors {
    /// Step of the motor's encoder seen at the joint \[rad\]; 0 is a perfect one.
    pub resolution: Vec<f64>,
    /// Standard deviation of the white noise before quantisation \[rad\].
    pub position_noise: Vec<f64>,
    /// Standard deviation of the white noise on the measured torque \[N·m\].
    pub torque_noise: Vec<f64>,
}

impl Sensors {
    /// The same encoders with all noise multiplied by `factor`.
    #[must_use]
    pub fn with_noise(mut self, factor: f64) -> Self {
        for noise in self.position_noise.iter_mut().chain(&mut self.torque_noise) {
            *noise *= factor;
        }
        self
    }

    /// Measures everything exactly.
    pub fn perfect(dof: usize) -> Self {
        Self { resolution: vec![0.0; dof], position_noise: vec![0.0; dof], torque_noise: vec![0.0; dof] }
    }
}

/// One sample as the robot controller has it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measurement {
    /// Counts the periods since the plant was made.
    pub seq: u64,
    /// Simulated time of the latch \[s\].
    pub t_s: f64,
    /// Joint count.
    pub dof: usize,
    q: Vector,
    tau: Vector,
}

impl Measurement {
    /// Joint positions \[rad\] from the motor encoders.
    pub fn q(&self) -> &[f64] {
        &self.q[..self.dof]
    }

    /// Drive torques at the joints \[N·m\] in force when the encoders were latched.
    pub fn tau(&self) -> &[f64] {
        &self.tau[..self.dof]
    }
}

/// The sensors of one plant with their noise.
#[derive(Clone, Debug)]
pub(crate) struct Readout {
    sensors: Sensors,
    coupling: Option<WristCoupling>,
    /// Angles by which encoders misread.
    errors: Vec<KnownEffect>,
    position: Random,
    torque: Random,
}

impl Readout {
    pub(crate) fn new(sensors: &Sensors, truth: &Truth, seed: u64) -> Self {
        // Two streams: a change of one kind of noise leaves the other as it was.
        let (position, torque) = (Random::stream(seed, 1), Random::stream(seed, 2));
        let errors = truth.effects.iter().filter(|e| e.angle_error(0.0).is_some()).copied().collect();
        Self { sensors: sensors.clone(), coupling: truth.structure.coupling, errors, position, torque }
    }

    /// Reads true positions `q` and torques `tau`.
    pub(crate) fn read(&mut self, seq: u64, t_s: f64, dof: usize, q: &Vector, tau: &Vector) -> Measurement {
        let mut out = Measurement { seq, t_s, dof, q: *q, tau: [0.0; MAX_JOINTS] };
        for error in &self.errors {
            // The link is at q + error(q): what the encoder says is found by going there a few times, the error being small.
            let truth = q[error.joint];
            for _ in 0..4 {
                out.q[error.joint] = truth - error.angle_error(out.q[error.joint]).unwrap_or(0.0);
            }
        }
        // The encoder counts the motor's turns, and a coupled motor turns with both joints.
        if let Some(WristCoupling { driving, driven }) = self.coupling {
            out.q[driven] += q[driving];
        }
        for j in 0..dof {
            let noisy = out.q[j] + self.sensors.position_noise[j] * self.position.normal();
            let step = self.sensors.resolution[j];
            out.q[j] = if step > 0.0 { (noisy / step).round() * step } else { noisy };
            out.tau[j] = tau[j] + self.sensors.torque_noise[j] * self.torque.normal();
        }
        if let Some(WristCoupling { driving, driven }) = self.coupling {
            out.q[driven] -= out.q[driving];
        }
        out
    }
}
