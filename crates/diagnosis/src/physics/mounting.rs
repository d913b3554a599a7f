//! What the arm stands on gives way: a lightly damped mode about a horizontal axis through the base's origin.
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

use crate::form::Form;
use crate::parallel::{self, chunks, joined};
use crate::physics::{Physics, bodies};
use crate::rows::Chain;
use crate::run::derivative;
use crate::search::Search;

/// Lowest frequency \[Hz\], and what the next is by: soft tables have 5 Hz.
const LOWEST_HZ: f64 = 4.0;
const NEXT: f64 = 1.15;
/// Share of the model filter's cut-off up to which it passes a mode.
const PASSED: f64 = 0.9;
/// Damping ratio, that at which motion must show a mode, and what refinement may make of it.
const DAMPING: f64 = 0.05;
const DAMPED_SOON: f64 = 0.1;
const DAMPED: (f64, f64) = (0.003, 0.2);
/// Directions of the axis over half a turn.
const HEADINGS: usize = 4;
/// Axes this far apart are those of two modes \[rad\].
const OTHER_AXIS: f64 = 1.0;
/// Share of the base's acceleration that the mode itself must make where motion is to show its frequency: far below it the base
/// only follows the moment.
const SHOWN: f64 = 0.1;
/// Time constants after which an oscillation is over.
const OVER: f64 = 5.0;
/// Periods of the model filter's cut-off, beyond those that rows leave out, in which the end of a record is seen in the second
/// derivative of what a second derivative is in.
const END: f64 = 3.0;
/// The arm's share of the inertia that moves, where nothing is known, ...
const SHARE: f64 = 0.5;
/// ... and in what bounds: 1 is a base without inertia, beside an arm whose own is known within some tenths.
const SHARES: (f64, f64) = (0.02, 1.4);
/// A share that is further from the coefficient is made anew.
const SETTLED: f64 = 0.03;
/// Log evidence by which a frequency must be ahead of ones this many times higher and lower.
const AHEAD: f64 = 10.0;
const ELSEWHERE: f64 = 1.3;
/// A joint that gives this share of its variance to a base that gives way feels it.
pub(crate) const FELT: f64 = 0.3;
/// Joints that must: what one alone feels is its own gear, and a little on each is what another one's gear leaves there.
const LEAST_JOINTS: usize = 2;
/// Most that a joint may lose, in units of the variance it keeps.
const WORSE: f64 = 0.05;
/// Angle of the free oscillation that one step of the integration may cover \[rad\], and most steps in a sample.
const STEP_ANGLE: f64 = 0.2;
const MOST_STEPS: f64 = 16.0;
/// Samples of what moves a base are at most this far apart where the log has more \[s\]: joined by lines they make the acceleration
/// of a base that follows too small by (ω·0.002)²/12, 1 % at the highest frequency.
const COARSE_S: f64 = 0.002;
/// Steps of the numeric derivatives with respect to the base's angle \[rad\] and rate \[rad/s\].
const STEP: f64 = 1e-4;

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
    period_s: f64,
    /// M_b \[N·m\].
    moment: [Vec<f64>; 2],
    /// M_00: xx, xy, yy \[kg·m²\].
    inertia: [Vec<f64>; 3],
    /// What each joint feels per angular acceleration, rate and angle of the base, `[axis][joint]`.
    accel: [Vec<Vec<f64>>; 2],
    rate: [Vec<Vec<f64>>; 2],
    tilt: [Vec<Vec<f64>>; 2],
}

impl Mounting {
    /// None where there is no room for one more joint.
    pub(crate) fn of(p: &Physics<'_>) -> Option<Mounting> {
        let n = p.joints();
        if n >= MAX_JOINTS {
            return None;
        }
        let arm = &p.nominal.model.arm;
        let [x, y] = horizontal(&arm.gravity);
        let between: [f64; 3] = std::array::from_fn(|i| FRAC_1_SQRT_2 * (x[i] + y[i]));
        let arms = [x, y, between].map(|axis| mounted(arm, axis));
        let stride = ((COARSE_S / p.period_s() + 1e-6) as usize).max(1);
        let links: Vec<[f64; 10]> = std::iter::once([0.0; 10]).chain(bodies(&p.x, n)).collect();
        let chunk = |(from, to): &(usize, usize)| {
            let mut spaces = [0, 1, 2].map(|i: usize| Workspace::new(&arms[i]));
            let [mut q, mut qd, mut qdd, mut tau, mut other] = [(); 5].map(|()| vec![0.0; n + 1]);
            let mut m = vec![0.0; (n + 1) * (n + 1)];
            let mut signals = vec![Vec::with_capacity(to - from); 5 + 6 * n];
            for k in *from..*to {
                p.motion.state(k * stride, &mut q[1..], &mut qd[1..], &mut qdd[1..]);
                let mut own = [0.0; 3];
                for (i, (arm, ws)) in arms.iter().zip(&mut spaces).enumerate() {
                    mass_matrix(arm, &links, ws, &q, &mut m);
                    own[i] = m[0];
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
                    qd[0] = STEP;
                    inverse_dynamics(arm, &links, ws, &q, &qd, &qdd, &mut other);
                    qd[0] = 0.0;
                    put(1, &mut other[1..].iter().zip(&tau[1..]).map(|(o, t)| (o - t) / STEP));
                    q[0] = STEP;
                    inverse_dynamics(arm, &links, ws, &q, &qd, &qdd, &mut other);
                    q[0] = 0.0;
                    put(2, &mut other[1..].iter().zip(&tau[1..]).map(|(o, t)| (o - t) / STEP));
                }
                let [xx, yy, between] = own;
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
    fn full(&self, signal: &[f64], samples: usize) -> Vec<f64> {
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
    fn sway(&self, mode: &Mode) -> [Vec<f64>; 3] {
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
        let steps = (period_s * fastest / STEP_ANGLE).ceil().clamp(1.0, MOST_STEPS) as usize;
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

    fn means(&self) -> [f64; 3] {
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
        (SHARES.0..SHARES.1).contains(&share)
    }

    /// The mode with the arm's share that was found, where it is another.
    pub(crate) fn settled(&self, share: f64) -> Option<Mode> {
        let share = share.clamp(0.0, 1.0);
        ((share - self.share).abs() > SETTLED).then_some(Mode { share, ..*self })
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
            hz: (self.hz * frequency).clamp(LOWEST_HZ, self.highest_hz),
            damping: (self.damping * damping).clamp(DAMPED.0, DAMPED.1),
            heading: (self.heading + turn).rem_euclid(PI),
            ..self
        }
    }

    /// Whether two modes turn about axes far enough apart to be two.
    pub(crate) fn is_other(&self, other: &Mode) -> bool {
        let apart = (self.heading - other.heading).rem_euclid(PI);
        apart.min(PI - apart) >= OTHER_AXIS
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

/// Headings that are looked for.
fn headings() -> impl Iterator<Item = f64> {
    (0..HEADINGS).map(|step| PI * step as f64 / HEADINGS as f64)
}

/// One run, and which modes its motion shows.
struct Shown<'a> {
    mounting: &'a Mounting,
    chain: Chain,
    samples: usize,
    /// Acceleration of a base that merely follows the moment about x and y, as rows.
    follows: [Vec<f64>; 2],
}

impl<'a> Shown<'a> {
    fn new(p: &'a Physics<'_>) -> Option<Shown<'a>> {
        let (mounting, chain, samples) = (p.mounting()?, Chain::new(p.period_s()), p.samples());
        let twice = |m: &Vec<f64>| derivative(&derivative(m, mounting.period_s), mounting.period_s);
        let follows = [0, 1].map(|i: usize| chain.apply(&mounting.full(&twice(&mounting.moment[i]), samples)));
        Some(Shown { mounting, chain, samples, follows })
    }

    /// Whether motion shows the frequency, heading by heading: the base does more than follow the moment.
    fn headings(&self, hz: f64) -> Vec<bool> {
        // What rings since the beginning is not of the motion, and the inertia's change does not matter here: both axes at once.
        let axis = |heading: f64| {
            let inertia = self.mounting.means();
            let mode = Mode { hz, damping: DAMPED_SOON, heading, share: 0.0, inertia, highest_hz: hz };
            let [_, _, accel] = self.mounting.sway(&mode);
            self.chain.apply(&self.mounting.full(&accel, self.samples))
        };
        let accel = [axis(0.0), axis(0.5 * PI)];
        let row_s = self.chain.row_period_s;
        let over = (OVER / (DAMPED_SOON * TAU * hz * row_s)) as usize;
        let end = (END / (self.chain.cutoff_hz() * row_s)).ceil() as usize;
        let rows = over..accel[0].len().saturating_sub(end).max(over);
        let of = |heading: f64| {
            let (sin, cos) = heading.sin_cos();
            let turned = |of: &[Vec<f64>; 2], k: usize| cos * of[0][k] + sin * of[1][k];
            let (own, all) = rows.clone().fold((0.0, 0.0), |(own, all), k| {
                let whole = turned(&accel, k);
                (own + (whole + turned(&self.follows, k)).powi(2), all + whole.powi(2))
            });
            own > SHOWN * SHOWN * all
        };
        headings().map(of).collect()
    }
}

/// Modes that one of the runs shows: the equations pass them, and the motion makes more of them than a base that only follows.
pub(crate) fn forms(physics: &[Physics<'_>]) -> Vec<Form> {
    let Some(runs) = physics.iter().map(Shown::new).collect::<Option<Vec<Shown<'_>>>>() else { return Vec::new() };
    let highest_hz = PASSED * runs.iter().map(|r| r.chain.cutoff_hz()).fold(f64::INFINITY, f64::min);
    let Some(first) = runs.first().filter(|_| highest_hz > LOWEST_HZ) else { return Vec::new() };
    let inertia = first.mounting.means();
    let next = |hz: &f64| Some(hz * NEXT).filter(|hz| *hz < highest_hz);
    let frequencies: Vec<f64> = std::iter::successors(Some(LOWEST_HZ * NEXT.sqrt()), next).collect();
    let shown = parallel::map(&frequencies, |hz| {
        let by_run: Vec<Vec<bool>> = runs.iter().map(|run| run.headings(*hz)).collect();
        (0..HEADINGS).map(|at| by_run.iter().any(|run| run[at])).collect::<Vec<bool>>()
    });
    let mode = |hz: f64, heading: f64| Mode { hz, damping: DAMPING, heading, share: SHARE, inertia, highest_hz };
    let of = |(hz, shown): (&f64, Vec<bool>)| {
        let hz = *hz;
        headings().zip(shown).filter(|(_, s)| *s).map(move |(heading, _)| Form::Base { mode: mode(hz, heading) })
    };
    frequencies.iter().zip(shown).flat_map(of).collect()
}

/// Whether several joints feel the base and none is worse, from the share of each joint's variance that it takes held out.
pub(crate) fn is_felt(shares: &[f64]) -> bool {
    shares.iter().filter(|s| **s >= FELT).count() >= LEAST_JOINTS && shares.iter().all(|s| *s > -WORSE)
}

impl Search<'_> {
    /// Whether the runs tell the frequency of a mode with this gain: it is not the highest or lowest that is looked for, others
    /// explain less, and it is not damped as much as may be.
    pub(crate) fn tells_frequency(&self, mode: &Mode, gain: f64, physics: &[Physics<'_>]) -> bool {
        let solved = self.scales();
        let behind = |hz: f64| {
            let elsewhere = self.candidate(Form::Base { mode: Mode { hz, ..*mode } }, physics);
            let standing = elsewhere.and_then(|candidate| self.standing(0, &candidate, &solved));
            standing.is_none_or(|standing| standing.gain < gain - AHEAD)
        };
        let inside = mode.hz > 1.01 * LOWEST_HZ && mode.hz < 0.99 * mode.highest_hz && mode.damping < 0.99 * DAMPED.1;
        inside && [ELSEWHERE, 1.0 / ELSEWHERE].iter().all(|factor| behind(mode.hz * factor))
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
mod tests {
    use super::*;
    use crate::background::{Nominal, Typical};
    use crate::run::{Motion, Run};
    use rivet_dynamics::{Model, Structure};

    /// One link of inertia 2 kg m² that turns about a horizontal axis y through its centre and the base's origin.
    const URDF: &str = r#"<robot name="one"><link name="base"/><link name="arm"><inertial><origin xyz="0 0 0"/>
        <mass value="1"/><inertia ixx="2" iyy="2" izz="2" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="j" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
        <limit lower="-3" upper="3" velocity="5" effort="100"/></joint></robot>"#;

    /// What `f` makes of a run in which the joint swings.
    fn swinging<T>(hz: f64, period_s: f64, f: impl FnOnce(&Physics<'_>) -> T) -> T {
        swinging_under([0.0, 0.0, -9.81], hz, period_s, f)
    }

    fn swinging_under<T>(gravity: [f64; 3], hz: f64, period_s: f64, f: impl FnOnce(&Physics<'_>) -> T) -> T {
        let arm = Arm::from_urdf(URDF, gravity).expect("a sound arm");
        let model = Model::new(arm, Structure { sign_velocity: 0.01, ..Structure::default() });
        let mut x = vec![0.0; model.len()];
        x[..10].copy_from_slice(&model.arm.links[0]);
        let samples = (8.0 / period_s) as u32;
        let q: Vec<f64> = (0..samples).map(|k| 0.3 * (TAU * hz * f64::from(k) * period_s).sin()).collect();
        let tau = vec![vec![0.0; q.len()]];
        let run = Run { name: String::new(), period_s, tau, q: vec![q], ..Run::default() };
        let nominal = Nominal::new(&model, &x, &Typical::of(std::slice::from_ref(&run), 1));
        let motion = Motion::of(&run);
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

    /// Ī of the arm is found, so that the arm's share is: with a compliance of half of 1/(Ī ω²) the base has as much itself.
    #[test]
    fn a_compliance_means_an_inertia_of_the_base() {
        swinging(5.0, 1e-3, |p| {
            let forms = forms(std::slice::from_ref(p));
            let Some(Form::Base { mode }) = forms.first() else { panic!("{forms:?}") };
            assert!(mode.inertia.iter().zip([2.0, 0.0, 2.0]).all(|(a, b)| (a - b).abs() < 1e-9), "{mode:?}");
            let compliance = 0.5 / (2.0 * (TAU * mode.hz).powi(2));
            assert!((mode.compliance(0.5) / compliance - 1.0).abs() < 1e-12);
            assert!((mode.handed_on(0.5)[1] - 2.0).abs() < 1e-12);
            assert!(Mode::plausible(0.5) && !Mode::plausible(2.0) && !Mode::plausible(-0.5));
        });
    }

    /// Where gravity does not pull nobody holds against it; a spring may be there all the same.
    #[test]
    fn a_counterbalance_is_looked_for_where_gravity_pulls() {
        let found = |gravity: [f64; 3]| {
            swinging_under(gravity, 1.0, 1e-3, |p| {
                let forms = crate::library::forms(std::slice::from_ref(p), &[Vec::new()]);
                let has = |wanted: fn(&Form) -> bool| forms.iter().any(wanted);
                [
                    has(|f| f.effect() == crate::effect::Effect::Counterbalance && !f.is_nameless()),
                    has(|f| matches!(f, Form::Spring { .. })),
                ]
            })
        };
        assert_eq!(found([0.0, 0.0, -9.81]), [true, true], "across");
        assert_eq!(found([0.0, -9.81, 0.0]), [false, true], "along");
        assert_eq!(found([0.0, -9.4, -2.8]), [true, true], "17 degrees off");
    }

    /// A swing of 5 Hz shows modes at that frequency and some way above, one of 0.3 Hz none; 20 samples a second pass none.
    #[test]
    fn only_what_filter_and_motion_show_is_looked_for() {
        let hz = |forms: Vec<Form>| -> Vec<f64> {
            forms.iter().map(|f| if let Form::Base { mode } = f { mode.hz } else { 0.0 }).collect()
        };
        let fast = swinging(5.0, 1e-3, |p| hz(forms(std::slice::from_ref(p))));
        assert!(fast.iter().any(|f| (4.0..6.0).contains(f)), "{fast:?}");
        assert!(fast.iter().all(|f| *f < 27.0), "{fast:?}");
        assert!(swinging(0.3, 1e-3, |p| forms(std::slice::from_ref(p)).is_empty()));
        assert!(swinging(5.0, 0.05, |p| forms(std::slice::from_ref(p)).is_empty()));
    }

    /// A little on three joints is what the gear of one leaves on its neighbours.
    #[test]
    fn two_joints_feel_a_base_and_none_is_worse_with_it() {
        assert!(is_felt(&[0.5, 0.4, 0.0, -0.01]));
        for shares in [[0.11, 0.09, 0.11, 0.04], [0.9, 0.2, 0.0, 0.0], [0.9, 0.9, 0.9, -0.1]] {
            assert!(!is_felt(&shares), "{shares:?}");
        }
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
