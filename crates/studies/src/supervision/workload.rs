//! The staged workload: an arm that is moved whole, joint by joint, not at all, and with a load, made from seeds.
//!
//! A light generator, not the plant: motion is planned, the closed loop follows it with a lag that the instruments know,
//! torque is the model's with noise. What is measured passes the same differentiation and filter as in the daemon's loop.

use rivet_config::Robot;
use rivet_dynamics::{Places, Workspace};
use rivet_estimation::filter::{Bank, Butterworth, correlation_factor, neighbour_correlation};
use rivet_estimation::{Correlation, Scales};

/// Sample period \[s\]: a tick.
const PERIOD: f64 = 1e-3;
/// Samples from row to row in the daemon, unless its robot file says otherwise.
pub const DECIMATION: usize = 10;
/// Bandwidth with which the arm follows \[rad/s\].
const LOOP: f64 = 60.0;
/// Step of the encoders, and noise beside it \[rad\].
const QUANTUM: f64 = 5e-5;
/// Cut-off of the model filter \[Hz\].
const CUTOFF: f64 = 20.0;
/// Noise of the torque before the filter, in first guesses of `Scales`.
const NOISE: f64 = 2.5;
/// Time in which joints start and stop \[s\], and step of numerical derivatives of the plan \[s\].
const RAMP: f64 = 1.0;
const STEP: f64 = 1e-4;
/// Load of the last phase: kg, m from the last link's frame, kg m² about it.
const LOAD: [f64; 3] = [1.5, 0.1, 0.02];

/// One part of the workload.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// All joints.
    Full,
    /// Joint 1 alone.
    First,
    /// The last three joints.
    Wrist,
    /// Nothing moves.
    Still,
    /// Slowly to and fro between two poses.
    PickPlace,
    /// All joints, with a load.
    Loaded,
}

/// Phases in their order, with names for tables and durations \[s\].
pub const PHASES: [(Phase, &str, f64); 6] = [
    (Phase::Full, "full", 25.0),
    (Phase::First, "j1", 30.0),
    (Phase::Wrist, "wrist", 30.0),
    (Phase::Still, "still", 30.0),
    (Phase::PickPlace, "pick-place", 40.0),
    (Phase::Loaded, "full+load", 25.0),
];

/// SplitMix64 (Steele, Lea & Flood 2014).
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.unit()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.unit()).cos()
    }
}

/// Rows of one instant after the filter.
#[derive(Clone, Debug, Default)]
pub struct Rows {
    /// Measured regressor, dof x n row-major.
    pub d: Vec<f64>,
    /// Instruments, likewise.
    pub z: Vec<f64>,
    /// Torque \[N·m\].
    pub tau: Vec<f64>,
    /// True parameters of this instant.
    pub truth: Vec<f64>,
    /// Index into [`PHASES`].
    pub phase: usize,
    /// Time from the start \[s\].
    pub time: f64,
}

/// What the generator knows of an arm and of its noise.
pub struct Workload {
    /// Scales that every scheme is given.
    pub scales: Scales,
    /// Standard deviation of the torque after the filter \[N·m\].
    pub noise: Vec<f64>,
    /// Correlation of filtered white noise.
    pub correlation: Correlation,
    /// Parameters to start from: up to 30 % off.
    pub nominal: Vec<f64>,
    /// Time between rows \[s\].
    pub row: f64,
    decimation: usize,
    filter: Butterworth,
}

impl Workload {
    /// Of one arm, with a row at every `decimation`-th sample.
    #[must_use]
    pub fn new(robot: &Robot, decimation: usize) -> Workload {
        let scales = Scales::of_model(&robot.model, &robot.base, &robot.nominal_base, None);
        let filter = Butterworth::low_pass(4, CUTOFF, 1.0 / PERIOD);
        let response = filter.impulse_response(4000);
        let gain = response.iter().map(|h| h * h).sum::<f64>().sqrt();
        let noise = scales.torque_noise.iter().map(|s| NOISE * s * gain).collect();
        let nominal = robot.nominal_base.iter().enumerate().map(|(i, x)| x * [0.7, 1.3, 0.85, 1.1][i % 4]).collect();
        let correlation = Correlation {
            factor: correlation_factor(&response, decimation),
            neighbour: neighbour_correlation(&response, decimation),
        };
        Workload { scales, noise, correlation, nominal, row: PERIOD * decimation as f64, decimation, filter }
    }

    /// Torque error of `x` on the reference workload \[noise sigma, rms a row\].
    #[must_use]
    pub fn global_error(&self, x: &[f64], truth: &[f64]) -> f64 {
        let n = x.len();
        let scaled: Vec<f64> = (0..n).map(|i| (x[i] - truth[i]) * self.scales.column[i]).collect();
        let square: f64 =
            (0..n).map(|i| scaled[i] * (0..n).map(|j| self.scales.workload[i * n + j] * scaled[j]).sum::<f64>()).sum();
        // The scales count in first guesses of the noise.
        let unit = self.noise[0] / self.scales.torque_noise[0];
        (square.max(0.0) / self.noise.len() as f64).sqrt() / unit
    }

    /// Torque error on the motion of now \[noise sigma, rms a row\].
    #[must_use]
    pub fn local_error(&self, x: &[f64], rows: &Rows) -> f64 {
        let n = x.len();
        let square: f64 = rows
            .z
            .chunks_exact(n)
            .zip(&self.noise)
            .map(|(row, noise)| {
                let error: f64 = row.iter().zip(x).zip(&rows.truth).map(|((z, x), t)| z * (x - t)).sum();
                (error / noise).powi(2)
            })
            .sum();
        (square / self.noise.len() as f64).sqrt()
    }

    /// Calls `take` with every row of the whole workload; durations are multiplied by `length`.
    pub fn run(&self, robot: &Robot, seed: u64, length: f64, mut take: impl FnMut(&Rows)) {
        let (dof, n, full) = (robot.dof(), robot.base.len(), robot.model.len());
        let mut random = Random(seed.wrapping_mul(0x2545_f491_4f6c_dd1d) ^ 0x5eed);
        let phases: Vec<[f64; 3]> =
            (0..dof).map(|_| std::array::from_fn(|_| std::f64::consts::TAU * random.unit())).collect();
        let total: f64 = PHASES.iter().map(|(_, _, s)| s * length).sum();
        let mut ws = Workspace::new(&robot.model.arm);
        let (mut measured, mut exact) =
            (Bank::new(self.filter.clone(), dof * n + dof), Bank::new(self.filter.clone(), dof * n));
        let mut y = vec![0.0; dof * full];
        let (mut d, mut z) = (vec![0.0; dof * n + dof], vec![0.0; dof * n]);
        let (mut d_out, mut z_out) = (d.clone(), z.clone());
        // Three samples of motion: older, middle, newest.
        let mut encoder = [vec![0.0; dof], vec![0.0; dof], vec![0.0; dof]];
        let (mut q, mut qd, mut qdd) = (vec![0.0; dof], vec![0.0; dof], vec![0.0; dof]);
        let mut now = [vec![0.0; dof], vec![0.0; dof], vec![0.0; dof]];
        let (mut phase, mut phase_start) = (0, 0.0);
        let mut rows = Rows::default();
        for sample in 0..(total / PERIOD) as usize {
            let t = sample as f64 * PERIOD;
            while phase + 1 < PHASES.len() && t >= phase_start + PHASES[phase].2 * length {
                phase_start += PHASES[phase].2 * length;
                phase += 1;
            }
            let kind = PHASES[phase].0;
            // Of the sample before: what the differences of this one are centred at.
            now[0].copy_from_slice(&q);
            now[1].copy_from_slice(&qd);
            now[2].copy_from_slice(&qdd);
            let ends = [phase_start, phase_start + PHASES[phase].2 * length];
            for j in 0..dof {
                let target = |t: f64| {
                    let moves = match kind {
                        Phase::Full | Phase::Loaded | Phase::PickPlace => true,
                        Phase::First => j == 0,
                        Phase::Wrist => j >= dof / 2,
                        Phase::Still => false,
                    };
                    let shape = if moves { desired(kind == Phase::PickPlace, &phases[j], j, t) } else { 0.0 };
                    shape * rise((t - ends[0]) / RAMP) * rise((ends[1] - t) / RAMP)
                };
                let rate = |t: f64| (target(t + STEP) - target(t - STEP)) / (2.0 * STEP);
                let speed = LOOP * (target(t) - q[j]);
                let acceleration = LOOP * (rate(t) - speed);
                // The lag is followed to third order in the period; what is left is far below the encoder's step.
                let jerk = LOOP * ((rate(t + STEP) - rate(t - STEP)) / (2.0 * STEP) - acceleration);
                q[j] += PERIOD * (speed + 0.5 * PERIOD * (acceleration + PERIOD / 3.0 * jerk));
                qd[j] = LOOP * (target(t + PERIOD) - q[j]);
                qdd[j] = LOOP * (rate(t + PERIOD) - qd[j]);
                encoder[0][j] = encoder[1][j];
                encoder[1][j] = encoder[2][j];
                encoder[2][j] = ((q[j] + QUANTUM * random.normal()) / QUANTUM).round() * QUANTUM;
            }
            Self::truth(robot, kind, t / total, &mut rows.truth);
            if sample < 3 {
                continue;
            }
            robot.model.regressor(&mut ws, &now[0], &now[1], &now[2], &mut y);
            robot.base.select(&y, full, &mut z);
            for j in 0..dof {
                let torque: f64 = z[j * n..(j + 1) * n].iter().zip(&rows.truth).map(|(z, x)| z * x).sum();
                d[dof * n + j] = torque + NOISE * self.scales.torque_noise[j] * random.normal();
            }
            let speed: Vec<f64> = (0..dof).map(|j| (encoder[2][j] - encoder[0][j]) / (2.0 * PERIOD)).collect();
            let bend: Vec<f64> =
                (0..dof).map(|j| (encoder[2][j] - 2.0 * encoder[1][j] + encoder[0][j]) / (PERIOD * PERIOD)).collect();
            robot.model.regressor(&mut ws, &encoder[1], &speed, &bend, &mut y);
            robot.base.select(&y, full, &mut d[..dof * n]);
            d_out.copy_from_slice(&d);
            z_out.copy_from_slice(&z);
            measured.step(&mut d_out);
            exact.step(&mut z_out);
            if sample > 100 && sample.is_multiple_of(self.decimation) {
                let (regressor, tau) = d_out.split_at(dof * n);
                rows.d.clear();
                rows.d.extend_from_slice(regressor);
                rows.z.clear();
                rows.z.extend_from_slice(&z_out);
                rows.tau.clear();
                rows.tau.extend_from_slice(tau);
                (rows.phase, rows.time) = (phase, t);
                take(&rows);
            }
        }
    }

    /// True base parameters at a share of the whole time: friction of joints 1 and 4 falls; the load is there or not.
    fn truth(robot: &Robot, phase: Phase, share: f64, out: &mut Vec<f64>) {
        let dof = robot.dof();
        let mut x = robot.nominal.clone();
        let places = robot.model.places();
        for (joint, fall) in [(0, 0.35), (3, 0.3)] {
            if joint < dof {
                x[places.viscous(joint)] *= 1.0 - fall * share;
                x[places.coulomb(joint)] *= 1.0 - fall * share;
            }
        }
        if phase == Phase::Loaded {
            let [mass, distance, inertia] = LOAD;
            for (entry, value) in [
                (0, mass),
                (3, mass * distance),
                (4, inertia + mass * distance.powi(2)),
                (6, inertia + mass * distance.powi(2)),
                (9, inertia),
            ] {
                x[Places::link(dof - 1).start + entry] += value;
            }
        }
        *out = robot.base.from_standard(&x);
    }
}

/// Position that one joint is to have, but for the ramps.
fn desired(slow: bool, phase: &[f64; 3], joint: usize, t: f64) -> f64 {
    if slow {
        // Between two poses, with a rest at each.
        let s = (std::f64::consts::TAU * 0.1 * t).sin();
        return 0.4 * (1.5 * s - 0.5 * s.powi(3));
    }
    let part = |(i, hz): (usize, &f64)| {
        let w = std::f64::consts::TAU * hz * (1.0 + 0.071 * joint as f64);
        [0.5, 0.3, 0.12][i] * (w * t + phase[i]).sin()
    };
    [0.23, 0.61, 1.13].iter().enumerate().map(part).sum()
}

/// From 0 to 1 without a jump of the acceleration.
fn rise(u: f64) -> f64 {
    let u = u.clamp(0.0, 1.0);
    u * u * u * (10.0 - u * (15.0 - 6.0 * u))
}
