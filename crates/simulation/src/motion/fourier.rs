//! Fourier excitation: per joint a seeded sum of harmonics of one base frequency.

use super::{LARGEST_LOAD, LoadRatio, MotionLimits, Trajectory, Window, scan};
use crate::random::Random;

/// What a Fourier excitation is made from.
#[derive(Clone, Debug)]
pub struct FourierSettings {
    /// Base frequency \[Hz\]; the motion repeats after its inverse.
    pub base_hz: f64,
    /// Harmonics 1..=this of the base frequency.
    pub harmonics: usize,
    /// Time over which the motion grows from rest, and shrinks before `length_s` \[s\].
    pub ramp_s: f64,
    /// When the motion has come back to rest at home \[s\]; infinite for one that goes on.
    pub length_s: f64,
    /// Decides the coefficients.
    pub seed: u64,
    /// Moves this joint (0-based) alone; `None` moves all.
    pub only: Option<usize>,
}

impl Default for FourierSettings {
    fn default() -> Self {
        Self { base_hz: 0.15, harmonics: 5, ramp_s: 1.5, length_s: f64::INFINITY, seed: 1, only: None }
    }
}

/// `q_j(t) = home_j + w(t) * sum_l (a_jl sin(l w_b t) + b_jl cos(l w_b t))` with a ramp `w` that starts and ends at rest.
#[derive(Clone, Debug)]
pub struct Fourier {
    home: Vec<f64>,
    /// Sine coefficients \[rad\], joint by joint.
    a: Vec<f64>,
    /// Cosine coefficients \[rad\], joint by joint.
    b: Vec<f64>,
    harmonics: usize,
    /// Base frequency \[rad/s\].
    base: f64,
    ramp_s: f64,
    length_s: f64,
}

/// States looked at in one period when the amplitude is fitted; the motion between two of them is covered by `GRID_MARGIN`.
const GRID: usize = 2000;
const GRID_MARGIN: f64 = 0.98;

impl Fourier {
    /// Draws the coefficients and scales each joint to the limits, then all joints until the nominal arm's torque keeps a
    /// reserve (`load` is its torque ratio).
    pub fn new(limits: &MotionLimits, settings: &FourierSettings, load: &mut LoadRatio<'_>) -> Self {
        let n = limits.home.len();
        let harmonics = settings.harmonics.max(1);
        let mut random = Random::stream(settings.seed, 0xf0);
        let mut motion = Self {
            home: limits.home.clone(),
            a: Vec::with_capacity(n * harmonics),
            b: Vec::with_capacity(n * harmonics),
            harmonics,
            base: core::f64::consts::TAU * settings.base_hz,
            ramp_s: settings.ramp_s,
            length_s: settings.length_s,
        };
        for j in 0..n {
            let moves = settings.only.is_none_or(|only| only == j);
            for l in 1..=harmonics {
                // 1/l: every harmonic has the same share of the speed, not of the position.
                let (a, b) = (random.normal() / l as f64, random.normal() / l as f64);
                motion.a.push(if moves { a } else { 0.0 });
                motion.b.push(if moves { b } else { 0.0 });
            }
        }
        motion.fit_joints(limits);
        motion.fit_load(load);
        motion
    }

    /// Time that holds every state of the motion up to the window at its end \[s\].
    fn span(&self) -> f64 {
        (self.ramp_s + core::f64::consts::TAU / self.base).min(self.length_s)
    }

    fn fit_joints(&mut self, limits: &MotionLimits) {
        let n = self.home.len();
        let (mut far, mut fast) = (vec![0.0_f64; n], vec![0.0_f64; n]);
        scan(self, self.span(), GRID, |q, qd, _| {
            for j in 0..n {
                far[j] = far[j].max((q[j] - limits.home[j]).abs());
                fast[j] = fast[j].max(qd[j].abs());
            }
        });
        for j in 0..n {
            if far[j] > 0.0 {
                let scale = GRID_MARGIN * (limits.reach[j] / far[j]).min(limits.velocity[j] / fast[j]);
                self.scale(j, scale);
            }
        }
    }

    fn fit_load(&mut self, load: &mut LoadRatio<'_>) {
        // Smaller motion needs less torque down to what gravity alone takes: a bounded number of tries, not a search.
        for _ in 0..20 {
            let mut worst = 0.0_f64;
            scan(self, self.span(), GRID / 4, |q, qd, qdd| worst = worst.max(load(q, qd, qdd)));
            if worst <= LARGEST_LOAD {
                return;
            }
            for j in 0..self.home.len() {
                self.scale(j, 0.88);
            }
        }
    }

    fn scale(&mut self, joint: usize, factor: f64) {
        for l in joint * self.harmonics..(joint + 1) * self.harmonics {
            self.a[l] *= factor;
            self.b[l] *= factor;
        }
    }
}

impl Trajectory for Fourier {
    fn dof(&self) -> usize {
        self.home.len()
    }

    fn sample(&self, t_s: f64, q: &mut [f64], qd: &mut [f64], qdd: &mut [f64]) {
        for j in 0..self.home.len() {
            let (mut f, mut df, mut ddf) = (0.0, 0.0, 0.0);
            for l in 0..self.harmonics {
                let w = self.base * (l + 1) as f64;
                let (sin, cos) = (w * t_s).sin_cos();
                let (a, b) = (self.a[j * self.harmonics + l], self.b[j * self.harmonics + l]);
                f += a * sin + b * cos;
                df += w * (a * cos - b * sin);
                ddf -= w * w * (a * sin + b * cos);
            }
            let (f, df, ddf) = Window::rising(t_s, self.ramp_s).apply(f, df, ddf);
            let (f, df, ddf) = Window::falling(t_s, self.length_s, self.ramp_s).apply(f, df, ddf);
            (q[j], qd[j], qdd[j]) = (self.home[j] + f, df, ddf);
        }
    }
}
