//! Base flexibility: a lightly damped mode about a horizontal axis through the base's origin.
//!
//! The rigid arm with one more joint in front of it, which turns by θ about the axis:
//!
//! ```text
//! ((J + M_00(q)) θ̇)˙ + D θ̇ + K θ = −M_b         M_b: moment about the axis that moves the arm on a base that stands
//! joint j feels  M_0j θ̈ + ∂τ_j/∂θ̇ θ̇ + ∂τ_j/∂θ θ  more; the last is gravity as a tilted base has it
//! ```
//!
//! J is the inertia of what gives way, M_00 that of the arm about the axis with mean Ī. With C = 1/K, ω and ζ at the mean, and
//! the arm's share s = Ī/(J + Ī) = C·Ī·ω² of the inertia, θ = C·φ and
//!
//! ```text
//! (R φ̇)˙/ω² + 2ζ φ̇/ω + φ = −M_b,   R = 1 + s (M_00/Ī − 1)
//! ```

use std::f64::consts::{FRAC_1_SQRT_2, PI, TAU};

use rivet_dynamics::{Arm, Joint, JointKind, MAX_JOINTS, Workspace, inverse_dynamics, mass_matrix};

use crate::effects::physics::{Physics, bodies};
use crate::numerics::parallel::{self, chunks, joined};
use crate::policy::POLICY;

/// Lowest frequency of a mode \[Hz\]: platforms on tyres and tall pedestals have 2 to 4 Hz, soft tables 5 Hz.
pub(crate) const LOWEST_MODE_HZ: f64 = 2.0;
/// Bounds of the damping ratio for refinement.
pub(crate) const MODE_DAMPING_RANGE: (f64, f64) = (0.003, 0.2);
/// Bounds of the arm's share of the inertia: 1 is a base without inertia and an arm whose own is known within some tenths.
const ARM_SHARE_RANGE: (f64, f64) = (0.02, 1.4);
/// A share that is further from the coefficient is made anew.
const MAX_SHARE_CHANGE: f64 = 0.03;
/// Angle of the free oscillation that one step of the integration may cover \[rad\], and most steps in a sample.
const MAX_STEP_PHASE_RAD: f64 = 0.2;
const MAX_STEPS_PER_SAMPLE: f64 = 16.0;
/// Samples of what moves a base are at most this far apart where the log has more \[s\]: joined by lines they make the acceleration
/// of a base that follows too small by (ω·0.002)²/12, 1 % at the highest frequency.
const MAX_MOMENT_PERIOD_S: f64 = 0.002;
/// Steps of the numeric derivatives with respect to the base's angle \[rad\] and rate \[rad/s\].
const BASE_DERIVATIVE_STEP_RAD: f64 = 1e-4;

/// A mode of the base.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Mode {
    /// With the arm as it is on average \[Hz\].
    pub(crate) hz: f64,
    /// Damping ratio.
    pub(crate) damping: f64,
    /// Direction of the axis, from the base's x about the upward direction \[rad\].
    pub(crate) heading: f64,
    /// s.
    pub(crate) share: f64,
    /// Mean of the arm's inertia about the two horizontal axes: xx, xy, yy \[kg·m²\].
    pub(crate) inertia: [f64; 3],
    /// Highest frequency that the equations pass \[Hz\].
    pub(crate) highest_hz: f64,
}

/// Horizontal axes x and y of the base along one run, every `stride` samples.
pub(crate) struct Mounting {
    stride: usize,
    /// Time between them \[s\].
    pub(crate) period_s: f64,
    /// M_b \[N·m\].
    pub(crate) moment: [Vec<f64>; 2],
    /// M_00: xx, xy, yy \[kg·m²\].
    inertia: [Vec<f64>; 3],
    /// What each joint feels per angular acceleration, rate and angle of the base, `[axis][joint]`.
    accel: [Vec<Vec<f64>>; 2],
    rate: [Vec<Vec<f64>>; 2],
    tilt: [Vec<Vec<f64>>; 2],
}

impl Mounting {
    /// None where there is no room for one more joint.
    pub(crate) fn new(p: &Physics<'_>) -> Option<Mounting> {
        let n = p.joints();
        if n >= MAX_JOINTS {
            return None;
        }
        let arm = &p.nominal.model.arm;
        let [x, y] = horizontal(&arm.gravity);
        let between: [f64; 3] = std::array::from_fn(|i| FRAC_1_SQRT_2 * (x[i] + y[i]));
        let arms = [x, y, between].map(|axis| mounted(arm, axis));
        let stride = ((MAX_MOMENT_PERIOD_S / p.period_s() + 1e-6) as usize).max(1);
        let links: Vec<[f64; 10]> = std::iter::once([0.0; 10]).chain(bodies(&p.x, n)).collect();
        let chunk = |(from, to): &(usize, usize)| {
            let mut spaces = [0, 1, 2].map(|i: usize| Workspace::new(&arms[i]));
            let [mut q, mut qd, mut qdd, mut tau, mut other] = [(); 5].map(|()| vec![0.0; n + 1]);
            let mut m = vec![0.0; (n + 1) * (n + 1)];
            let mut signals = vec![Vec::with_capacity(to - from); 5 + 6 * n];
            for k in *from..*to {
                p.motion.state(k * stride, &mut q[1..], &mut qd[1..], &mut qdd[1..]);
                let mut axis_inertia = [0.0; 3];
                for (i, (arm, ws)) in arms.iter().zip(&mut spaces).enumerate() {
                    mass_matrix(arm, &links, ws, &q, &mut m);
                    axis_inertia[i] = m[0];
                    if i == 2 {
                        continue;
                    }
                    inverse_dynamics(arm, &links, ws, &q, &qd, &qdd, &mut tau);
                    signals[i].push(tau[0]);
                    let mut put = |place: usize, values: &mut dyn Iterator<Item = f64>| {
                        let to = &mut signals[5 + (3 * i + place) * n..][..n];
                        to.iter_mut().zip(values).for_each(|(to, v)| to.push(v));
                    };
                    put(0, &mut m[1..=n].iter().copied());
                    qd[0] = BASE_DERIVATIVE_STEP_RAD;
                    inverse_dynamics(arm, &links, ws, &q, &qd, &qdd, &mut other);
                    qd[0] = 0.0;
                    put(1, &mut other[1..].iter().zip(&tau[1..]).map(|(o, t)| (o - t) / BASE_DERIVATIVE_STEP_RAD));
                    q[0] = BASE_DERIVATIVE_STEP_RAD;
                    inverse_dynamics(arm, &links, ws, &q, &qd, &qdd, &mut other);
                    q[0] = 0.0;
                    put(2, &mut other[1..].iter().zip(&tau[1..]).map(|(o, t)| (o - t) / BASE_DERIVATIVE_STEP_RAD));
                }
                let [xx, yy, between] = axis_inertia;
                for (to, v) in signals[2..5].iter_mut().zip([xx, between - 0.5 * (xx + yy), yy]) {
                    to.push(v);
                }
            }
            signals
        };
        let mut signals = joined(parallel::map(&chunks(p.samples().div_ceil(stride)), chunk), 5 + 6 * n).into_iter();
        let mut next = |count: usize| -> Vec<Vec<f64>> { signals.by_ref().take(count).collect() };
        let mut one = || next(1).remove(0);
        let (moment, inertia) = ([one(), one()], [one(), one(), one()]);
        let [ax, rx, tx, ay, ry, ty] = [(); 6].map(|()| next(n));
        let period_s = p.period_s() * stride as f64;
        Some(Mounting { stride, period_s, moment, inertia, accel: [ax, ay], rate: [rx, ry], tilt: [tx, ty] })
    }

    /// A signal of these samples at the rate of the log.
    pub(crate) fn full(&self, signal: &[f64], samples: usize) -> Vec<f64> {
        let last = signal.len().saturating_sub(1);
        let mut full = Vec::with_capacity(samples + self.stride);
        for (at, value) in signal.iter().enumerate() {
            let rise = (signal[(at + 1).min(last)] - value) / self.stride as f64;
            full.extend((0..self.stride).map(|k| value + rise * k as f64));
        }
        full.truncate(samples);
        full
    }

    /// Base angle, rate and acceleration per compliance, from equilibrium.
    pub(crate) fn sway(&self, mode: &Mode) -> [Vec<f64>; 3] {
        let period_s = self.period_s;
        let (sin, cos) = mode.heading.sin_cos();
        let omega = TAU * mode.hz;
        let moment: Vec<f64> = self.moment[0].iter().zip(&self.moment[1]).map(|(x, y)| cos * x + sin * y).collect();
        let mean = mode.mean();
        let relative = |own: f64| f64::max(1.0 + mode.share * (own / mean - 1.0), 1e-6);
        let [xx, xy, yy] = &self.inertia;
        let inertia: Vec<f64> = (0..moment.len()).map(|k| relative(about(sin, cos, [xx[k], xy[k], yy[k]]))).collect();
        // By the least inertia, whatever the mean: the same steps for a mode that a file gives beside another mean.
        let fastest = omega / inertia.iter().copied().fold(f64::INFINITY, f64::min).sqrt();
        let steps = (period_s * fastest / MAX_STEP_PHASE_RAD).ceil().clamp(1.0, MAX_STEPS_PER_SAMPLE) as usize;
        let h = period_s / steps as f64;
        let mut angle = -moment.first().copied().unwrap_or(0.0);
        let (mut rate, mut accel) = (0.0, 0.0);
        let mut out = [(); 3].map(|()| Vec::with_capacity(moment.len()));
        for k in 0..moment.len() {
            for (to, value) in out.iter_mut().zip([angle, rate, accel]) {
                to.push(value);
            }
            let next = (k + 1).min(moment.len() - 1);
            let (rise, growth) = (moment[next] - moment[k], inertia[next] - inertia[k]);
            // An arm that draws itself in or stretches keeps its angular momentum: beside the little damping that is much.
            let braking = 2.0 * mode.damping * omega + growth / period_s;
            for step in 1..=steps {
                let share = step as f64 / steps as f64;
                let (moment, inertia) = (moment[k] + share * rise, inertia[k] + share * growth);
                // Mean of the accelerations at both ends of a step: a moment, an angle and an acceleration that were half a step
                // apart would leave ω²Ṁh/2, more than all of what a slow arm does to a stiff base.
                let (drift, speed) = (angle + h * rate + 0.25 * h * h * accel, rate + 0.5 * h * accel);
                let whole = inertia + 0.5 * h * braking + 0.25 * (h * omega).powi(2);
                accel = (-omega * omega * (moment + drift) - braking * speed) / whole;
                angle = drift + 0.25 * h * h * accel;
                rate = speed + 0.5 * h * accel;
            }
        }
        out
    }

    pub(crate) fn means(&self) -> [f64; 3] {
        [0, 1, 2].map(|i: usize| self.inertia[i].iter().sum::<f64>() / self.inertia[i].len().max(1) as f64)
    }
}

impl Mode {
    /// Ī \[kg·m²\].
    fn mean(&self) -> f64 {
        let (sin, cos) = self.heading.sin_cos();
        about(sin, cos, self.inertia).max(1e-9)
    }

    /// C \[rad/(N·m)\] of the coefficient, which is the arm's share of the inertia: torque per share is of the size of torques.
    pub(crate) fn compliance(&self, share: f64) -> f64 {
        share / (self.mean() * (TAU * self.hz).powi(2))
    }

    /// Whether a base can be so: it pushes back, and has an inertia.
    pub(crate) fn plausible(share: f64) -> bool {
        (ARM_SHARE_RANGE.0..ARM_SHARE_RANGE.1).contains(&share)
    }

    /// The mode with the arm's share that was found, where it is another.
    pub(crate) fn settled(&self, share: f64) -> Option<Mode> {
        let share = share.clamp(0.0, 1.0);
        ((share - self.share).abs() > MAX_SHARE_CHANGE).then_some(Mode { share, ..*self })
    }

    /// What a file says of it: compliance, the base's own inertia \[kg·m²\], its damping \[N·m·s/rad\], the heading.
    pub(crate) fn handed_on(&self, share: f64) -> [f64; 4] {
        let compliance = self.compliance(share);
        let inertia = self.mean() * (1.0 / share - 1.0).max(0.0);
        [compliance, inertia, 2.0 * self.damping / (TAU * self.hz * compliance), self.heading]
    }

    /// The mode of such a file, beside an arm of 1 kg m² as a reference: what the run's arm has is known there. Its share is the
    /// coefficient.
    pub(crate) fn given([compliance, inertia, damping, heading]: [f64; 4]) -> Mode {
        let omega = 1.0 / (compliance * (inertia + 1.0)).sqrt();
        Mode {
            hz: omega / TAU,
            damping: 0.5 * damping * compliance * omega,
            heading,
            share: 1.0 / (inertia + 1.0),
            inertia: [1.0, 0.0, 1.0],
            highest_hz: f64::INFINITY,
        }
    }

    /// Frequency and damping by factors, the axis turned.
    pub(crate) fn moved(self, frequency: f64, damping: f64, turn: f64) -> Mode {
        Mode {
            hz: (self.hz * frequency).clamp(LOWEST_MODE_HZ, self.highest_hz),
            damping: (self.damping * damping).clamp(MODE_DAMPING_RANGE.0, MODE_DAMPING_RANGE.1),
            heading: (self.heading + turn).rem_euclid(PI),
            ..self
        }
    }

    /// Whether two modes turn about axes far enough apart to be two.
    pub(crate) fn is_other(&self, other: &Mode) -> bool {
        let apart = (self.heading - other.heading).rem_euclid(PI);
        apart.min(PI - apart) >= POLICY.plausibility.min_mode_angle_rad
    }

    /// Full-rate column of the torque per share of the inertia.
    pub(crate) fn column(&self, p: &Physics<'_>) -> Vec<Option<Vec<f64>>> {
        let Some(m) = p.mounting() else { return vec![None; p.joints()] };
        let (sin, cos) = self.heading.sin_cos();
        let [angle, rate, accel] = m.sway(self);
        let unit = self.compliance(1.0);
        (0..p.joints())
            .map(|j| {
                let turned = |of: &[Vec<Vec<f64>>; 2], k: usize| cos * of[0][j][k] + sin * of[1][j][k];
                let at = |k: usize| {
                    unit * (turned(&m.accel, k) * accel[k]
                        + turned(&m.rate, k) * rate[k]
                        + turned(&m.tilt, k) * angle[k])
                };
                let coarse: Vec<f64> = (0..angle.len()).map(at).collect();
                Some(m.full(&coarse, p.samples()))
            })
            .collect()
    }
}

/// Inertia about an axis in a plane from xx, xy and yy.
fn about(sin: f64, cos: f64, [xx, xy, yy]: [f64; 3]) -> f64 {
    cos * cos * xx + 2.0 * sin * cos * xy + sin * sin * yy
}

/// Two axes across gravity, the first as near the base's x as may be (y where x is upright).
fn horizontal(gravity: &[f64; 3]) -> [[f64; 3]; 2] {
    let size = gravity.iter().map(|g| g * g).sum::<f64>().sqrt();
    let up = if size > 0.0 { gravity.map(|g| -g / size) } else { [0.0, 0.0, 1.0] };
    let near = if up[0].abs() < 0.9 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
    let along: f64 = near.iter().zip(&up).map(|(a, b)| a * b).sum();
    let across: [f64; 3] = std::array::from_fn(|i| near[i] - along * up[i]);
    let length = across.iter().map(|a| a * a).sum::<f64>().sqrt();
    let x = across.map(|a| a / length);
    let y = [up[1] * x[2] - up[2] * x[1], up[2] * x[0] - up[0] * x[2], up[0] * x[1] - up[1] * x[0]];
    [x, y]
}

/// The arm on a base that turns about an axis through its origin.
fn mounted(arm: &Arm, axis: [f64; 3]) -> Arm {
    let base = Joint {
        name: "base".into(),
        kind: JointKind::Revolute,
        axis,
        rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        translation: [0.0; 3],
        lower: f64::NEG_INFINITY,
        upper: f64::INFINITY,
        velocity: f64::INFINITY,
        effort: f64::INFINITY,
        link: "base".into(),
    };
    Arm {
        joints: std::iter::once(base).chain(arm.joints.iter().cloned()).collect(),
        links: std::iter::once([0.0; 10]).chain(arm.links.iter().copied()).collect(),
        ..arm.clone()
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::model::nominal::{Nominal, Typical};
    use crate::model::run::{Motion, Run};
    use rivet_dynamics::{Model, Structure};

    /// One link of inertia 2 kg m² that turns about a horizontal axis y through its centre and the base's origin.
    const URDF: &str = r#"<robot name="one"><link name="base"/><link name="arm"><inertial><origin xyz="0 0 0"/>
        <mass value="1"/><inertia ixx="2" iyy="2" izz="2" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="j" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
        <limit lower="-3" upper="3" velocity="5" effort="100"/></joint></robot>"#;

    /// What `f` makes of a run in which the joint swings.
    pub(crate) fn swinging<T>(hz: f64, period_s: f64, f: impl FnOnce(&Physics<'_>) -> T) -> T {
        swinging_under([0.0, 0.0, -9.81], hz, period_s, f)
    }

    pub(crate) fn swinging_under<T>(gravity: [f64; 3], hz: f64, period_s: f64, f: impl FnOnce(&Physics<'_>) -> T) -> T {
        let arm = Arm::from_urdf(URDF, gravity).expect("a sound arm");
        let model = Model::new(arm, Structure { sign_velocity: 0.01, ..Structure::default() });
        let mut x = vec![0.0; model.len()];
        x[..10].copy_from_slice(&model.arm.links[0]);
        let samples = (8.0 / period_s) as u32;
        let q: Vec<f64> = (0..samples).map(|k| 0.3 * (TAU * hz * f64::from(k) * period_s).sin()).collect();
        let tau = vec![vec![0.0; q.len()]];
        let run = Run { name: String::new(), period_s, tau, q: vec![q], ..Run::default() };
        let nominal = Nominal::new(&model, &x, &Typical::from_runs(std::slice::from_ref(&run), 1));
        let motion = Motion::from_run(&run);
        f(&Physics::new(&run, &motion, &nominal, &nominal.x))
    }

    /// A sine of frequency w is `Ī·(w/ω)²·q̈/(1 − (w/ω)²)` per share, since M_b = Ī q̈ and M_01 = Ī, and hardly anything out of phase
    /// with it; across the axis it is nothing.
    #[test]
    fn a_base_under_a_sine_sways_as_the_closed_form_says() {
        let (hz, period_s) = (3.0, 1e-3);
        let mode = |hz: f64, heading: f64| Mode {
            hz,
            damping: 0.02,
            heading,
            share: 0.7,
            inertia: [2.0, 0.0, 2.0],
            highest_hz: 27.0,
        };
        swinging(hz, period_s, |p| {
            for own_hz in [10.0, 25.0] {
                let column = mode(own_hz, 0.5 * PI).column(p).remove(0).expect("the joint feels it");
                let r = hz / own_hz;
                let gain = 2.0 * r * r / (1.0 - r * r);
                // What rang at the beginning is over.
                let late = 5000..7800;
                let accel = &p.motion.qdd[0];
                let sum = |f: &dyn Fn(usize) -> f64| late.clone().map(f).sum::<f64>();
                let square = sum(&|k| (gain * accel[k]).powi(2));
                let in_phase = sum(&|k| gain * accel[k] * column[k]) / square;
                assert!((in_phase - 1.0).abs() < 0.01, "{own_hz} Hz: {in_phase}");
                let rest = (sum(&|k| (gain * accel[k] - column[k]).powi(2)) / square).sqrt();
                // 2ζr/(1 − r²) by the damping.
                assert!(rest < 0.02, "{own_hz} Hz: {rest}");
                let across = mode(own_hz, 0.0).column(p).remove(0).expect("a column");
                assert!(late.clone().all(|k| across[k].abs() < 1e-6 * gain), "{}", across[6000]);
            }
        });
    }

    #[test]
    fn axes_lie_across_gravity_wherever_the_arm_hangs() {
        assert_eq!(horizontal(&[0.0, 0.0, -9.81]), [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        for gravity in [[9.81, 0.0, 0.0], [0.0, 6.0, 8.0], [3.0, -2.0, 9.0]] {
            let dot = |a: &[f64; 3], b: &[f64; 3]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            let [x, y] = horizontal(&gravity);
            for value in [dot(&x, &gravity), dot(&y, &gravity), dot(&x, &y), dot(&x, &x) - 1.0, dot(&y, &y) - 1.0] {
                assert!(value.abs() < 1e-12, "{gravity:?} {x:?} {y:?}");
            }
        }
    }
}
