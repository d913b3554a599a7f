//! Commanded motions: position, velocity and acceleration of every joint as analytic functions of time.
//!
//! All motions start at rest at the home pose at `t = 0`. Angles in rad (m for a prismatic joint), time in s.

mod fourier;
mod governor;
mod point_to_point;
mod recorded;

pub use fourier::{Fourier, FourierSettings};
pub use governor::Governor;
pub use point_to_point::{PointToPoint, PointToPointSettings};
pub use recorded::Recorded;

use rivet_dynamics::{Arm, MAX_JOINTS, Model, Workspace};

/// A motion of all joints.
pub trait Trajectory: Send {
    /// How many joints move.
    fn dof(&self) -> usize;

    /// Position \[rad\], velocity \[rad/s\] and acceleration \[rad/s²\] at `t_s` ≥ 0; each slice holds one value per joint.
    fn sample(&self, t_s: f64, q: &mut [f64], qd: &mut [f64], qdd: &mut [f64]);

    /// When it comes to its end \[s\]; none for one that goes on for ever.
    fn ends_s(&self) -> Option<f64> {
        None
    }
}

impl<T: Trajectory + ?Sized> Trajectory for Box<T> {
    fn dof(&self) -> usize {
        (**self).dof()
    }
    fn sample(&self, t_s: f64, q: &mut [f64], qd: &mut [f64], qdd: &mut [f64]) {
        (**self).sample(t_s, q, qd, qdd);
    }
    fn ends_s(&self) -> Option<f64> {
        (**self).ends_s()
    }
}

/// The room a motion may use.
#[derive(Clone, Debug)]
pub struct MotionLimits {
    /// Where motions start and what they move about \[rad\].
    pub home: Vec<f64>,
    /// How far each joint may go to either side of home \[rad\].
    pub reach: Vec<f64>,
    /// Speed no joint exceeds \[rad/s\].
    pub velocity: Vec<f64>,
}

/// Furthest excursion from home \[rad\] whatever the joint's range: no arm here knows its own collisions.
const LARGEST_REACH: f64 = 1.6;
/// Share of a joint's range kept free at either end.
const RANGE_MARGIN: f64 = 0.08;

impl MotionLimits {
    /// From the arm's joint limits, with a margin in position and `speed` (0..1] of the rated velocity.
    ///
    /// Home is the zero pose, or for a joint whose zero lies in the outer quarters of its range the nearest angle that does not.
    pub fn of(arm: &Arm, speed: f64) -> Self {
        let mut limits = Self { home: Vec::new(), reach: Vec::new(), velocity: Vec::new() };
        for joint in &arm.joints {
            let range = joint.upper - joint.lower;
            let bounded = range.is_finite() && range > 0.0;
            let home =
                if bounded { 0.0_f64.clamp(joint.lower + 0.25 * range, joint.upper - 0.25 * range) } else { 0.0 };
            let room = if bounded {
                (home - joint.lower).min(joint.upper - home) - RANGE_MARGIN * range
            } else {
                LARGEST_REACH
            };
            limits.home.push(home);
            limits.reach.push(room.clamp(0.0, LARGEST_REACH));
            // An arm file without a speed limit gets a walking pace rather than a division by zero.
            let rated = if joint.velocity > 0.0 && joint.velocity.is_finite() { joint.velocity } else { 1.0 };
            limits.velocity.push(speed * rated);
        }
        limits
    }
}

/// Worst ratio of needed to permitted torque over the joints, for one state `(q, qd, qdd)` of the nominal arm.
pub type LoadRatio<'a> = dyn FnMut(&[f64], &[f64], &[f64]) -> f64 + 'a;

/// The torque ratio of `model` with standard parameters `x` and drives of the given limits \[N·m\].
pub fn load_ratio<'a>(
    model: &'a Model,
    x: &'a [f64],
    torque_limit: &'a [f64],
) -> impl FnMut(&[f64], &[f64], &[f64]) -> f64 + 'a {
    let (mut workspace, width) = (Workspace::new(&model.arm), model.len());
    let mut y = vec![0.0; model.arm.dof() * width];
    move |q, qd, qdd| {
        model.regressor(&mut workspace, q, qd, qdd, &mut y);
        let torque = |row: &[f64]| row.iter().zip(x).map(|(y, x)| y * x).sum::<f64>();
        y.chunks_exact(width).zip(torque_limit).map(|(row, limit)| torque(row).abs() / limit).fold(0.0, f64::max)
    }
}

/// Torque reserve every motion keeps on the nominal arm: what a wrong model and feedback need on top.
pub const LARGEST_LOAD: f64 = 0.75;

/// Quintic rest-to-rest profile: `s(x)`, `ds/dx`, `d²s/dx²` for `x` in 0..1, constant outside.
pub(crate) fn quintic(x: f64) -> (f64, f64, f64) {
    if x <= 0.0 {
        return (0.0, 0.0, 0.0);
    }
    if x >= 1.0 {
        return (1.0, 0.0, 0.0);
    }
    let (x2, x3) = (x * x, x * x * x);
    (x3 * (10.0 - 15.0 * x + 6.0 * x2), 30.0 * x2 * (1.0 - 2.0 * x + x2), 60.0 * x - 180.0 * x2 + 120.0 * x3)
}

/// Peak of `ds/dx` of the quintic.
pub(crate) const QUINTIC_PEAK_VELOCITY: f64 = 1.875;

/// The arm stands at one pose.
#[derive(Clone, Debug)]
pub struct Standstill {
    /// Where \[rad\].
    pub pose: Vec<f64>,
}

impl Trajectory for Standstill {
    fn dof(&self) -> usize {
        self.pose.len()
    }
    fn sample(&self, _t_s: f64, q: &mut [f64], qd: &mut [f64], qdd: &mut [f64]) {
        q.copy_from_slice(&self.pose);
        qd.fill(0.0);
        qdd.fill(0.0);
    }
}

/// The motion of the paper's experiments: joint 1 swings at 0.8 Hz and joint 2 at 1.1 Hz, further joints stand still.
#[derive(Clone, Debug)]
pub struct PaperMotion {
    home: Vec<f64>,
    amplitude: [f64; 2],
    /// Time over which the swing grows from rest \[s\].
    ramp_s: f64,
}

impl PaperMotion {
    /// Frequencies of joints 1 and 2 \[Hz\] (footnote 1 of the paper).
    pub const FREQUENCY_HZ: [f64; 2] = [0.8, 1.1];

    /// Amplitudes of 0.5 and 0.8 rad, less where speed, reach or the nominal arm's torque (`load` is its torque ratio) demand
    /// it: the paper does not print its own.
    pub fn new(limits: &MotionLimits, load: &mut LoadRatio<'_>) -> Self {
        let mut amplitude = [0.5, 0.8];
        for j in 0..limits.home.len().min(2) {
            // While it grows, the swing is faster than its steady state by at most amplitude * 1.875 / ramp (ramp 2 s below).
            let fastest =
                limits.velocity[j] / (core::f64::consts::TAU * Self::FREQUENCY_HZ[j] + QUINTIC_PEAK_VELOCITY / 2.0);
            amplitude[j] = f64::min(amplitude[j], fastest).min(limits.reach[j]);
        }
        let mut motion = Self { home: limits.home.clone(), amplitude, ramp_s: 2.0 };
        for _ in 0..30 {
            let mut worst = 0.0_f64;
            // The two frequencies come round together after 10 s.
            scan(&motion, motion.ramp_s + 10.0, 2400, |q, qd, qdd| worst = worst.max(load(q, qd, qdd)));
            if worst <= LARGEST_LOAD {
                break;
            }
            motion.amplitude = motion.amplitude.map(|a| 0.88 * a);
        }
        motion
    }
}

impl Trajectory for PaperMotion {
    fn dof(&self) -> usize {
        self.home.len()
    }
    fn sample(&self, t_s: f64, q: &mut [f64], qd: &mut [f64], qdd: &mut [f64]) {
        let window = Window::rising(t_s, self.ramp_s);
        for j in 0..self.home.len() {
            let (f, df, ddf) = if j < 2 {
                let w = core::f64::consts::TAU * Self::FREQUENCY_HZ[j];
                let (sin, cos) = (w * t_s).sin_cos();
                let a = self.amplitude[j];
                (a * sin, a * w * cos, -a * w * w * sin)
            } else {
                (0.0, 0.0, 0.0)
            };
            let (p, v, a) = window.apply(f, df, ddf);
            (q[j], qd[j], qdd[j]) = (self.home[j] + p, v, a);
        }
    }
}

/// A factor `w(t)` with its derivatives, laid over a motion so that it starts (and ends) at rest.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Window {
    w: f64,
    dw: f64,
    ddw: f64,
}

impl Window {
    /// Grows from 0 to 1 during the first `ramp_s` seconds.
    pub(crate) fn rising(t_s: f64, ramp_s: f64) -> Self {
        if ramp_s <= 0.0 {
            return Self { w: 1.0, dw: 0.0, ddw: 0.0 };
        }
        let (w, dw, ddw) = quintic(t_s / ramp_s);
        Self { w, dw: dw / ramp_s, ddw: ddw / (ramp_s * ramp_s) }
    }

    /// Shrinks from 1 to 0 during the last `ramp_s` seconds before `end_s`.
    pub(crate) fn falling(t_s: f64, end_s: f64, ramp_s: f64) -> Self {
        let rise = Self::rising(end_s - t_s, ramp_s);
        Self { w: rise.w, dw: -rise.dw, ddw: rise.ddw }
    }

    /// `w f` and its first two derivatives.
    pub(crate) fn apply(self, f: f64, df: f64, ddf: f64) -> (f64, f64, f64) {
        (self.w * f, self.dw * f + self.w * df, self.ddw * f + 2.0 * self.dw * df + self.w * ddf)
    }
}

/// Calls `visit` with the states of `trajectory` at `count` evenly spaced times of `[0, span_s]`.
pub(crate) fn scan(
    trajectory: &dyn Trajectory,
    span_s: f64,
    count: usize,
    mut visit: impl FnMut(&[f64], &[f64], &[f64]),
) {
    let n = trajectory.dof();
    let (mut q, mut qd, mut qdd) = ([0.0; MAX_JOINTS], [0.0; MAX_JOINTS], [0.0; MAX_JOINTS]);
    for k in 0..count {
        let t_s = span_s * k as f64 / count as f64;
        trajectory.sample(t_s, &mut q[..n], &mut qd[..n], &mut qdd[..n]);
        visit(&q[..n], &qd[..n], &qdd[..n]);
    }
}
