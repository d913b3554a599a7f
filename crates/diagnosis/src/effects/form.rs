//! Forms of effects: their inner values, bounds and columns of torque along one run.

mod bodies;

use std::f64::consts::TAU;

use crate::effects::effect::Effect;
use crate::effects::physics::base_mode::Mode;
use crate::effects::physics::{Physics, SMEARED_S};
use crate::effects::two_mass::{self, Gear};
use crate::effects::warming::Warmth;
use crate::model::run::derivative;
use crate::policy::POLICY;
pub(crate) use bodies::AXES;
use bodies::{body, gravity, scale, wave};

/// An effect on a joint with its inner values; its coefficients are found by the fit.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Form {
    /// `|s|`, `|q̇|`
    Asymmetry { joint: usize },
    /// `s` while it is above 0, or below: friction of one direction
    OneSided { joint: usize, forwards: bool },
    /// `s·exp(−(q̇/v)²)`
    Stribeck { joint: usize, velocity: f64 },
    /// `q̇`, `q̇|q̇|`, `q̇³`
    ViscousNonlinearity { joint: usize },
    /// `s·|τ_rigid|`
    Load { joint: usize },
    /// `q̇·ΔT`, `s·ΔT`
    Temperature { joint: usize },
    /// The same without a temperature, from what friction's own power makes of it
    Warming { joint: usize, warmth: Warmth },
    /// `F_c (z − s)`, z the state of a Dahl spring of the given length \[rad\]
    Presliding { joint: usize, length: f64 },
    /// `z`, `s`: the same state beside friction that sticks and slips as before, whose level may be another: what is dragged along, a hose
    /// or a cable. No effect of the list
    Hysteresis { joint: usize, length: f64 },
    /// `s·cos(kq)`, `s·sin(kq)`, `s`: a part of a turn has a mean
    PositionFriction { joint: usize, order: f64 },
    /// The joint's whole torque
    Gain { joint: usize },
    /// `τ³`, τ the joint's whole torque: a motor that saturates, or a current that tells it ever less. No effect of the list; what
    /// explains torque that hangs on torque has to be better than this
    TorqueLaw { joint: usize },
    /// `cos(cq)`, `sin(cq)`
    Ripple { joint: usize, order: f64 },
    /// The link's angle is off by `cos(cq)`, `sin(cq)`
    TransmissionError { joint: usize, order: f64 },
    /// Motor and link are joined by a spring, or loosely
    TwoMass { joint: usize, gear: Gear },
    /// The base turns about a horizontal axis, per share that the arm has of what turns
    Base { mode: Mode },
    /// `q`, 1: a spring rests anywhere
    Spring { joint: usize },
    /// Spring of free length l0 between points at distances 1 and `arm` from the axis, `phase` between them at q = 0
    Counterbalance { joint: usize, arm: f64, phase: f64 },
    /// A counterbalance by a weight, or by a spring without free length: `sin q`, `cos q`
    Counterweight { joint: usize },
    /// A strap, hose or stop that pulls from one angle on: `x`, `x²`, x: how far `q` is above `from`, or below. No effect of
    /// the list; what explains torque over the angle has to be better than this
    Pull { joint: usize, from: f64, above: bool },
    /// `x`, `x²`, `x³`, 1, x: the angle less `about`, the middle of what was seen. Springs that harden and the like: no effect of
    /// the list, as a pull
    AngleLaw { joint: usize, about: f64 },
    /// `tanh(x/w)`, 1, x: the angle less `about`, w: `width`. Springs that soften and what gives way at a force: no effect of the list
    Softening { joint: usize, about: f64, width: f64 },
    /// A spring over two joints, or a hose along them: `x_a` on a, `x_b` on b, `x_b` on a with `x_a` on b, 1 on each. No effect of
    /// the list: each joint by itself bends as no spring does
    SpringBetween { joints: [usize; 2], about: [f64; 2] },
    /// A motor that turns with the sum of two joints: `s(q̇a+q̇b)` and `q̇a+q̇b` on both, `q̈` of the other; `whole`: of both,
    /// where the rotors of the file are without it
    Coupling { driving: usize, driven: usize, whole: bool },
    /// The model's torque so much later, less itself
    Delay { seconds: f64 },
    /// Rate of the model's torque; half a sample later where a command `stands` for a sample. With the timing that is free
    /// beside it this makes a second-order term, which is all that sets a lag apart from a delay
    Lag { stands: bool },
    /// Measured torque beyond the limit
    Saturation { joint: usize, limit: f64 },
    /// Rigid torque's change with the joint's angle
    EncoderOffset { joint: usize },
    /// Angle off by `cos q`, `sin q`
    Eccentricity { joint: usize },
    /// Angle off by `q`, 1: a gear ratio or the counts of an encoder. No effect of the list; over a part of a turn an eccentricity looks
    /// like it
    PositionScale { joint: usize },
    /// 1: a torque signal whose zero is off, at rest as in motion. No effect of the list; friction of one direction and laws of the angle
    /// have to be better than this
    Constant { joint: usize },
    /// A force at the flange in stretches of time, by run, and a moment about it where something may touch the last link elsewhere: base
    /// axes times hats over time
    Force { windows: Vec<Vec<(f64, f64)>>, moment: bool },
    /// Gravity along the base's x and y
    Gravity,
    /// Ten parameters of a body at the flange
    Payload,
    /// The link's body, scaled
    LinkScale { link: usize },
    /// `q̈`
    RotorInertia { joint: usize },
    /// `s`
    Coulomb { joint: usize },
    /// `q̇`
    Viscous { joint: usize },
}

/// Components of a force, and of a force with a moment.
pub(crate) fn force_components(moment: bool) -> usize {
    if moment { 6 } else { 3 }
}

/// A column at the rate of the log: signals by joint.
type Full = Vec<Option<Vec<f64>>>;

impl Form {
    /// The effect it belongs to.
    pub(crate) fn effect(&self) -> Effect {
        match self {
            // What a constant would be taken for.
            Form::Asymmetry { .. } | Form::OneSided { .. } | Form::Constant { .. } => Effect::FrictionAsymmetry,
            Form::Stribeck { .. } => Effect::StribeckFriction,
            Form::ViscousNonlinearity { .. } => Effect::ViscousNonlinearity,
            Form::Load { .. } => Effect::LoadDependentFriction,
            Form::Temperature { .. } | Form::Warming { .. } => Effect::TemperatureDependentFriction,
            // What a longer hysteresis would be taken for.
            Form::Presliding { .. } | Form::Hysteresis { .. } => Effect::PreslidingFriction,
            Form::PositionFriction { .. } => Effect::PositionDependentFriction,
            // What a law of the torque would be taken for.
            Form::Gain { .. } | Form::TorqueLaw { .. } => Effect::TorqueConstant,
            Form::Ripple { .. } => Effect::TorqueRipple,
            Form::TransmissionError { .. } => Effect::TransmissionError,
            Form::TwoMass { gear, .. } if gear.gap > 0.0 => Effect::Backlash,
            Form::TwoMass { .. } => Effect::JointElasticity,
            Form::Base { .. } => Effect::BaseFlexibility,
            Form::Spring { .. } | Form::SpringBetween { .. } => Effect::JointSpring,
            // What a pull or another law of the angle would be taken for.
            Form::Counterbalance { .. }
            | Form::Counterweight { .. }
            | Form::Pull { .. }
            | Form::AngleLaw { .. }
            | Form::Softening { .. } => Effect::Counterbalance,
            Form::Coupling { .. } => Effect::JointCoupling,
            Form::Delay { .. } => Effect::TransportDelay,
            Form::Lag { .. } => Effect::CurrentLoopLag,
            Form::Saturation { .. } => Effect::TorqueSaturation,
            Form::EncoderOffset { .. } => Effect::EncoderOffset,
            // What a scale would be taken for.
            Form::Eccentricity { .. } | Form::PositionScale { .. } => Effect::EncoderEccentricity,
            Form::Force { .. } => Effect::ExternalForce,
            Form::Gravity => Effect::GravityDirection,
            Form::Payload => Effect::Payload,
            Form::LinkScale { .. } => Effect::LinkInertia,
            Form::RotorInertia { .. } => Effect::RotorInertia,
            Form::Coulomb { .. } => Effect::CoulombFriction,
            Form::Viscous { .. } => Effect::ViscousFriction,
        }
    }

    /// The joints it is reported on; empty when it belongs to all or to none.
    pub(crate) fn joints(&self) -> Vec<usize> {
        match *self {
            Form::Coupling { driving, driven, .. } => vec![driving, driven],
            Form::SpringBetween { joints, .. } => joints.to_vec(),
            Form::Delay { .. }
            | Form::Lag { .. }
            | Form::Base { .. }
            | Form::Gravity
            | Form::Force { .. }
            | Form::Payload => Vec::new(),
            Form::LinkScale { link } => vec![link],
            Form::Asymmetry { joint }
            | Form::OneSided { joint, .. }
            | Form::Stribeck { joint, .. }
            | Form::ViscousNonlinearity { joint }
            | Form::Load { joint }
            | Form::Temperature { joint }
            | Form::Warming { joint, .. }
            | Form::Presliding { joint, .. }
            | Form::Hysteresis { joint, .. }
            | Form::PositionFriction { joint, .. }
            | Form::Gain { joint }
            | Form::TorqueLaw { joint }
            | Form::Ripple { joint, .. }
            | Form::TransmissionError { joint, .. }
            | Form::TwoMass { joint, .. }
            | Form::Spring { joint }
            | Form::Counterbalance { joint, .. }
            | Form::Counterweight { joint }
            | Form::Pull { joint, .. }
            | Form::AngleLaw { joint, .. }
            | Form::Softening { joint, .. }
            | Form::Saturation { joint, .. }
            | Form::EncoderOffset { joint }
            | Form::Eccentricity { joint }
            | Form::PositionScale { joint }
            | Form::Constant { joint }
            | Form::RotorInertia { joint }
            | Form::Coulomb { joint }
            | Form::Viscous { joint } => vec![joint],
        }
    }

    /// Cycles per turn of the joint, of forms that have such.
    pub(crate) fn order(&self) -> Option<f64> {
        match *self {
            Form::PositionFriction { order, .. }
            | Form::Ripple { order, .. }
            | Form::TransmissionError { order, .. } => Some(order),
            _ => None,
        }
    }

    /// Whether the size of the effect is in its inner values, so that the coefficient is 1.
    pub(crate) fn has_fixed_gain(&self) -> bool {
        matches!(self, Form::Presliding { .. } | Form::TwoMass { .. } | Form::Delay { .. } | Form::Saturation { .. })
    }

    /// Whether it is simulated: such forms are never exact, and what they miss is not another effect.
    pub(crate) fn is_simulated(&self) -> bool {
        self.has_fixed_gain() || matches!(self, Form::Base { .. })
    }

    /// How many columns it has; contact has as many as its time needs, here 0.
    pub(crate) fn coefficients(&self) -> usize {
        match self {
            Form::Force { .. } => 0,
            Form::Payload => 10,
            Form::SpringBetween { .. } => 5,
            Form::AngleLaw { .. } => 4,
            Form::PositionFriction { .. } | Form::ViscousNonlinearity { .. } | Form::Coupling { .. } => 3,
            Form::Asymmetry { .. }
            | Form::Temperature { .. }
            | Form::Warming { .. }
            | Form::Ripple { .. }
            | Form::TransmissionError { .. }
            | Form::Eccentricity { .. }
            | Form::PositionScale { .. }
            | Form::Spring { .. }
            | Form::Counterbalance { .. }
            | Form::Counterweight { .. }
            | Form::Pull { .. }
            | Form::Softening { .. }
            | Form::Hysteresis { .. }
            | Form::Gravity => 2,
            _ => 1,
        }
    }

    /// How many inner values were searched for.
    pub(crate) fn inner_values(&self) -> usize {
        match self {
            Form::Stribeck { .. }
            | Form::Presliding { .. }
            | Form::Hysteresis { .. }
            | Form::Delay { .. }
            | Form::Saturation { .. }
            | Form::PositionFriction { .. }
            | Form::Ripple { .. }
            | Form::TransmissionError { .. }
            | Form::Pull { .. } => 1,
            Form::Counterbalance { .. } | Form::Softening { .. } => 2,
            Form::Warming { warmth, .. } => 2 + usize::from(warmth.at_work),
            Form::TwoMass { gear, .. } => 2 + usize::from(gear.gap > 0.0),
            Form::Base { .. } => 3,
            _ => 0,
        }
    }

    /// Whether its torque hangs on the angle alone: nothing of how friction turns over spoils it.
    pub(crate) fn of_angle_alone(&self) -> bool {
        matches!(self, Form::Spring { .. } | Form::Counterbalance { .. } | Form::Counterweight { .. })
    }

    /// Whether it is the same torque, later.
    pub(crate) fn shifts_time(&self) -> bool {
        matches!(self, Form::Lag { .. } | Form::Delay { .. })
    }

    /// Whether it is no effect of the list, only what is held against one.
    pub(crate) fn is_nameless(&self) -> bool {
        matches!(
            self,
            Form::Pull { .. }
                | Form::AngleLaw { .. }
                | Form::Softening { .. }
                | Form::SpringBetween { .. }
                | Form::TorqueLaw { .. }
                | Form::PositionScale { .. }
                | Form::Constant { .. }
                | Form::Hysteresis { .. }
        )
    }

    /// Forms of one effect on the same joints that are refined apart from each other.
    pub(crate) fn kind(&self) -> usize {
        match self {
            Form::Counterweight { .. }
            | Form::Coupling { whole: true, .. }
            | Form::Lag { stands: true }
            | Form::Force { moment: true, .. } => 1,
            Form::Pull { .. }
            | Form::TorqueLaw { .. }
            | Form::PositionScale { .. }
            | Form::Constant { .. }
            | Form::Hysteresis { .. } => 2,
            Form::AngleLaw { .. } => 3,
            Form::Softening { .. } => 4,
            Form::Warming { warmth, .. } => usize::from(warmth.at_work),
            _ => 0,
        }
    }

    /// Whether coefficients make sense for the effect.
    pub(crate) fn plausible(&self, c: &[f64]) -> bool {
        match self {
            Form::Stribeck { .. } | Form::Load { .. } | Form::Lag { .. } => c[0] > 0.0,
            // At rest within a turn: further off it is a constant torque.
            Form::Spring { .. } => c[0] > 0.0 && c[1].abs() < TAU * c[0],
            // Two springs on two joints have names.
            Form::SpringBetween { .. } => {
                c[2].powi(2) > POLICY.plausibility.min_cross_stiffness_share * (c[0] * c[1]).abs()
            }
            Form::Coupling { whole, .. } => c[0] > 0.0 && c[1] >= 0.0 && (!whole || c[2] > 0.0),
            Form::Temperature { .. } => c[0] < 0.0 || c[1] < 0.0,
            Form::Warming { warmth, .. } => warmth.plausible(c),
            Form::Saturation { .. } => (c[0] - 1.0).abs() < 0.1,
            Form::Base { .. } => Mode::plausible(c[0]),
            // Less is what any data sheet is off by.
            Form::Gain { .. } => (POLICY.plausibility.min_gain_error..0.5).contains(&c[0].abs()),
            Form::EncoderOffset { .. } => c[0].abs() < 0.3,
            Form::PositionScale { .. } => c.iter().all(|c| c.abs() < 0.3),
            Form::Eccentricity { .. } | Form::TransmissionError { .. } => c.iter().all(|c| c.abs() < 0.1),
            Form::Gravity => c.iter().all(|c| c.abs() < 3.0),
            // Both are made with their own size, so that 1 is meant; what is wanted at a fraction of it imitates something else.
            // Less than stops are smeared by is no delay where friction sticks; true ones were 3.2 ms and more.
            Form::Delay { seconds } => (0.5..2.0).contains(&c[0]) && c[0] * seconds > SMEARED_S,
            Form::Presliding { length, .. } => {
                c[0] > 0.2
                    && (POLICY.plausibility.min_bristle_travel_rad..POLICY.plausibility.max_bristle_travel_rad)
                        .contains(length)
            }
            Form::Hysteresis { length, .. } => c[0] > 0.0 && *length >= POLICY.plausibility.min_bristle_travel_rad,
            Form::Payload => c[0] > 0.0 && c[1..4].iter().all(|h| h.abs() < 0.6 * c[0]),
            Form::LinkScale { .. } => c[0] > -0.9,
            _ => c.iter().all(|c| c.is_finite()),
        }
    }

    /// Columns at the rate of the log; none when the run lacks a signal the form needs.
    pub(crate) fn columns(&self, p: &Physics<'_>) -> Vec<Full> {
        let samples = p.samples();
        let v = |j: usize, k: usize| p.motion.qd[j][k];
        let q = |j: usize, k: usize| p.motion.q[j][k];
        let s = |j: usize, k: usize| p.sign[j][k];
        let on = |joint: usize, f: &dyn Fn(usize) -> f64| -> Full {
            let mut full: Full = vec![None; p.joints()];
            full[joint] = Some((0..samples).map(f).collect());
            full
        };
        match self.clone() {
            Form::Asymmetry { joint: j } => vec![on(j, &|k| s(j, k).abs()), on(j, &|k| v(j, k).abs())],
            Form::OneSided { joint: j, forwards: true } => vec![on(j, &|k| s(j, k).max(0.0))],
            Form::OneSided { joint: j, forwards: false } => vec![on(j, &|k| s(j, k).min(0.0))],
            Form::Stribeck { joint: j, velocity } => {
                vec![on(j, &|k| s(j, k) * (-(v(j, k) / velocity).powi(2)).exp())]
            }
            Form::ViscousNonlinearity { joint: j } => {
                // With the slope at rest: the value in the file is that of another curve.
                vec![on(j, &|k| v(j, k)), on(j, &|k| v(j, k) * v(j, k).abs()), on(j, &|k| v(j, k).powi(3))]
            }
            Form::Load { joint: j } => vec![on(j, &|k| s(j, k) * p.rigid[j][k].abs())],
            Form::Temperature { joint: j } => match &p.run.temperature {
                Some(temperature) => {
                    let t = &temperature[j];
                    let warm = |k: usize| t[k] - t[0];
                    vec![on(j, &|k| v(j, k) * warm(k)), on(j, &|k| s(j, k) * warm(k))]
                }
                None => Vec::new(),
            },
            Form::Warming { joint: j, warmth } => {
                let warm = warmth.state(p, j);
                vec![on(j, &|k| v(j, k) * warm[k]), on(j, &|k| s(j, k) * warm[k])]
            }
            Form::Presliding { joint: j, length } => {
                let level = p.x[p.coulomb(j)].abs();
                let z = dahl(&p.motion.q[j], length);
                vec![on(j, &|k| level * (z[k] - s(j, k)))]
            }
            Form::Hysteresis { joint: j, length } => {
                let z = dahl(&p.motion.q[j], length);
                vec![on(j, &|k| z[k]), on(j, &|k| s(j, k))]
            }
            Form::PositionFriction { joint: j, order } => {
                vec![
                    on(j, &|k| s(j, k) * (order * q(j, k)).cos()),
                    on(j, &|k| s(j, k) * (order * q(j, k)).sin()),
                    on(j, &|k| s(j, k)),
                ]
            }
            Form::Gain { joint: j } => vec![on(j, &|k| p.torque[j][k])],
            Form::TorqueLaw { joint: j } => vec![on(j, &|k| p.torque[j][k].powi(3))],
            Form::Ripple { joint: j, order } => {
                vec![on(j, &|k| (order * q(j, k)).cos()), on(j, &|k| (order * q(j, k)).sin())]
            }
            Form::TransmissionError { joint: j, order } => wave(p, j, order, false),
            Form::Eccentricity { joint: j } => wave(p, j, 1.0, true),
            Form::PositionScale { joint: j } => scale(p, j),
            Form::Constant { joint: j } => vec![on(j, &|_| 1.0)],
            Form::TwoMass { joint, gear } => vec![two_mass::column(p, joint, gear)],
            Form::Base { mode } => vec![mode.column(p)],
            Form::Spring { joint: j } => vec![on(j, &|k| q(j, k)), on(j, &|_| 1.0)],
            Form::Counterbalance { joint: j, arm, phase } => {
                // Length l² = 1 + a² − 2a cos(q + φ); its derivative with respect to q times stretch: k (l − l0) a sin/l.
                let length = |k: usize| (1.0 + arm * arm - 2.0 * arm * (q(j, k) + phase).cos()).max(1e-9).sqrt();
                let lever = |k: usize| arm * (q(j, k) + phase).sin();
                vec![on(j, &lever), on(j, &|k| lever(k) / length(k))]
            }
            Form::Counterweight { joint: j } => vec![on(j, &|k| q(j, k).sin()), on(j, &|k| q(j, k).cos())],
            Form::Pull { joint: j, from, above } => {
                let side = if above { 1.0 } else { -1.0 };
                let x = |k: usize| f64::max(side * (q(j, k) - from), 0.0);
                vec![on(j, &x), on(j, &|k| x(k).powi(2))]
            }
            Form::AngleLaw { joint: j, about } => {
                (0..4).map(|power| on(j, &|k| (q(j, k) - about).powi([1, 2, 3, 0][power]))).collect()
            }
            Form::Softening { joint: j, about, width } => {
                vec![on(j, &|k| ((q(j, k) - about) / width).tanh()), on(j, &|_| 1.0)]
            }
            Form::SpringBetween { joints: [a, b], about } => {
                let x = |i: usize, k: usize| q([a, b][i], k) - about[i];
                let mut across = on(a, &|k| x(1, k));
                across[b] = Some((0..samples).map(|k| x(0, k)).collect());
                vec![on(a, &|k| x(0, k)), on(b, &|k| x(1, k)), across, on(a, &|_| 1.0), on(b, &|_| 1.0)]
            }
            Form::Coupling { driving: a, driven: b, whole } => {
                let both = |f: &dyn Fn(usize) -> f64| -> Full {
                    let mut full: Full = vec![None; p.joints()];
                    let signal: Vec<f64> = (0..samples).map(f).collect();
                    full[a] = Some(signal.clone());
                    full[b] = Some(signal);
                    full
                };
                let v0 = p.nominal.model.structure.sign_velocity;
                let mut inertia: Full = vec![None; p.joints()];
                if whole {
                    inertia = both(&|k| p.motion.qdd[a][k] + p.motion.qdd[b][k]);
                } else {
                    inertia[a] = Some(p.motion.qdd[b].clone());
                    inertia[b] = Some(p.motion.qdd[a].clone());
                }
                let sum = |k: usize| v(a, k) + v(b, k);
                vec![both(&|k| rivet_dynamics::friction_sign(sum(k), v0)), both(&sum), inertia]
            }
            Form::Delay { seconds } => {
                let shift = seconds / p.period_s();
                let later = |tau: &Vec<f64>| -> Option<Vec<f64>> {
                    Some((0..samples).map(|k| at(tau, k as f64 + shift) - tau[k]).collect())
                };
                vec![p.torque.iter().map(later).collect()]
            }
            Form::Lag { stands } => {
                let late = if stands { HOLD_DELAY_SAMPLES } else { 0.0 };
                let rate = |tau: &Vec<f64>| {
                    let rate = derivative(tau, p.period_s());
                    Some((0..samples).map(|k| at(&rate, k as f64 + late)).collect())
                };
                vec![p.torque.iter().map(rate).collect()]
            }
            Form::Saturation { joint: j, limit } => {
                let tau = &p.run.tau[j];
                vec![on(j, &|k| tau[k] - tau[k].clamp(-limit, limit))]
            }
            Form::EncoderOffset { joint: j } => vec![p.gradient()[j].iter().map(|g| Some(g.clone())).collect()],
            // Columns of their own: see contact.
            Form::Force { .. } => Vec::new(),
            Form::Gravity => gravity(p),
            Form::Payload => {
                let last = p.joints() - 1;
                (0..10).map(|e| body(p, last, &std::array::from_fn(|i| f64::from(u8::from(i == e))))).collect()
            }
            Form::LinkScale { link } => vec![body(p, link, &std::array::from_fn(|e| p.nominal.x[10 * link + e]))],
            Form::RotorInertia { joint: j } => vec![on(j, &|k| p.motion.qdd[j][k])],
            Form::Coulomb { joint: j } => vec![on(j, &|k| s(j, k))],
            Form::Viscous { joint: j } => vec![on(j, &|k| v(j, k))],
        }
    }
}

impl Physics<'_> {
    /// Place of a joint's Coulomb friction in the standard vector.
    pub(crate) fn coulomb(&self, joint: usize) -> usize {
        10 * self.joints() + 2 * self.joints() + joint
    }
}

/// Samples by which a command that stands for one is late on average.
pub(crate) const HOLD_DELAY_SAMPLES: f64 = 0.5;

/// Value between samples, linear; the ends hold.
fn at(x: &[f64], place: f64) -> f64 {
    let place = place.clamp(0.0, (x.len() - 1) as f64);
    let k = (place as usize).min(x.len().saturating_sub(2));
    let share = place - k as f64;
    x[k] * (1.0 - share) + x[(k + 1).min(x.len() - 1)] * share
}

/// State of Dahl's spring in units of the sliding friction: `dz = (dq − |dq| z)/length`, exact for each step.
fn dahl(q: &[f64], length: f64) -> Vec<f64> {
    let mut z = 0.0;
    let mut before = q.first().copied().unwrap_or(0.0);
    q.iter()
        .map(|now| {
            let dq = now - before;
            before = *now;
            let to = dq.signum();
            if dq != 0.0 {
                z = to + (z - to) * (-dq.abs() / length).exp();
            }
            z
        })
        .collect()
}
