//! Effects of known size: those that a robot file has, and those that a diagnosis hands to one.

use rivet_dynamics::{EffectKind, KnownEffect, KnownEffects, Model, Workspace, friction_sign};

use crate::background::Nominal;
use crate::form::Form;
use crate::physics::Physics;
use crate::run::{Motion, Run};
use crate::two_mass::Gear;

/// What becomes of an adopted form in a robot file.
pub(crate) enum Carried {
    /// A section of its own.
    Effect(KnownEffect),
    /// Changes of standard parameters, by place.
    Values(Vec<(usize, f64)>),
    /// Change of gravity in base axes \[m/s²\].
    Gravity([f64; 3]),
    /// Nothing: why.
    Nothing(&'static str),
}

impl Form {
    /// The form with coefficients `c` as part of a robot file. `x` is the standard vector that its columns were made with;
    /// `reference_c` the motors' temperature at the start \[°C\]. Values beside the effect come second.
    pub(crate) fn carried(
        &self,
        c: &[f64],
        x: &[f64],
        joints: usize,
        reference_c: Option<&[f64]>,
    ) -> (Carried, Vec<(usize, f64)>) {
        use EffectKind as Kind;
        let coulomb = |j: usize| 12 * joints + j;
        let mut beside = Vec::new();
        let effect = |kind: Kind, joint: usize, values: &[f64]| Carried::Effect(KnownEffect::new(kind, joint, values));
        let carried = match *self {
            Form::Asymmetry { joint } => effect(Kind::FrictionAsymmetry, joint, c),
            Form::Stribeck { joint, velocity } => effect(Kind::StribeckFriction, joint, &[c[0], velocity]),
            Form::ViscousNonlinearity { joint } => effect(Kind::ViscousNonlinearity, joint, c),
            Form::Load { joint } => effect(Kind::LoadDependentFriction, joint, c),
            Form::Temperature { joint } => {
                let reference = reference_c.map_or(0.0, |t| t[joint]);
                effect(Kind::TemperatureDependentFriction, joint, &[c[0], c[1], reference])
            }
            Form::Presliding { joint, length } => {
                effect(Kind::PreslidingFriction, joint, &[c[0] * x[coulomb(joint)].abs(), length])
            }
            Form::PositionFriction { joint, order } => {
                beside.push((coulomb(joint), c[2]));
                effect(Kind::PositionDependentFriction, joint, &[c[0], c[1], order])
            }
            Form::Gain { joint } => effect(Kind::TorqueConstant, joint, c),
            Form::Ripple { joint, order } => effect(Kind::TorqueRipple, joint, &[c[0], c[1], order]),
            Form::TransmissionError { joint, order } => effect(Kind::TransmissionError, joint, &[c[0], c[1], order]),
            Form::TwoMass { joint, gear } if gear.gap > 0.0 => {
                effect(Kind::Backlash, joint, &[gear.gap, gear.stiffness, gear.damping, c[0]])
            }
            Form::TwoMass { joint, gear } => {
                effect(Kind::JointElasticity, joint, &[gear.stiffness, gear.damping, c[0]])
            }
            Form::Spring { joint } => effect(Kind::JointSpring, joint, c),
            Form::Counterbalance { joint, arm, phase } => {
                effect(Kind::Counterbalance, joint, &[c[0], c[1], arm, phase])
            }
            Form::Coupling { driven, .. } => effect(Kind::JointCoupling, driven, c),
            Form::Delay { seconds } => effect(Kind::TransportDelay, 0, &[seconds * c[0]]),
            Form::Lag => effect(Kind::CurrentLoopLag, 0, c),
            Form::Saturation { joint, limit } => effect(Kind::TorqueSaturation, joint, &[limit]),
            Form::EncoderOffset { joint } => effect(Kind::EncoderOffset, joint, c),
            Form::Eccentricity { joint } => effect(Kind::EncoderEccentricity, joint, c),
            Form::Force { .. } => Carried::Nothing("contact is no property of the arm"),
            Form::Gravity => Carried::Gravity([c[0], c[1], 0.0]),
            Form::Payload => Carried::Values((0..10).map(|e| (10 * (joints - 1) + e, c[e])).collect()),
            Form::LinkScale { link } => {
                Carried::Values((0..10).map(|e| (10 * link + e, c[0] * x[10 * link + e])).collect())
            }
            Form::RotorInertia { joint } => Carried::Values(vec![(10 * joints + joint, c[0])]),
            Form::Viscous { joint } => Carried::Values(vec![(11 * joints + joint, c[0])]),
            Form::Coulomb { joint } => Carried::Values(vec![(coulomb(joint), c[0])]),
        };
        (carried, beside)
    }
}

/// The form with the memory of an effect, and the factor of its one column; none for other effects.
fn form(effect: &KnownEffect, x: &[f64], joints: usize) -> Option<(Form, f64)> {
    let (joint, [a, b, c, d]) = (effect.joint, effect.values);
    match effect.kind {
        EffectKind::PreslidingFriction => {
            let level = x[12 * joints + joint].abs();
            (level > 0.0).then(|| (Form::Presliding { joint, length: b }, a / level))
        }
        EffectKind::Backlash => {
            Some((Form::TwoMass { joint, gear: Gear { gap: a, stiffness: b, damping: c } }, d))
        }
        EffectKind::JointElasticity => {
            Some((Form::TwoMass { joint, gear: Gear { gap: 0.0, stiffness: a, damping: b } }, c))
        }
        EffectKind::TransportDelay => Some((Form::Delay { seconds: a }, 1.0)),
        EffectKind::CurrentLoopLag => Some((Form::Lag, a)),
        _ => None,
    }
}

/// Torque of effects of `model` along a run that need more than one instant \[N·m\], `[joint][sample]`; none when it has no
/// such effect. `x` is its standard vector.
///
/// Friction that follows the temperature is nothing without a temperature in the run, and what is not delivered of a
/// commanded torque is not known from the motion: see [`unseen`].
pub fn memory_torque(model: &Model, x: &[f64], run: &Run) -> Option<Vec<Vec<f64>>> {
    let effects = model.effects().list();
    effects.iter().any(|e| e.kind.not_instant().is_some()).then(|| {
        let nominal = Nominal::exact(model, x);
        memory(&nominal, effects, run, &Motion::of(run))
    })
}

fn memory(nominal: &Nominal, effects: &[KnownEffect], run: &Run, motion: &Motion) -> Vec<Vec<f64>> {
    let n = motion.joints();
    let mut sum = vec![vec![0.0; motion.len()]; n];
    for effect in effects.iter().filter(|e| e.kind == EffectKind::TemperatureDependentFriction) {
        let (j, [viscous, coulomb, reference, _]) = (effect.joint, effect.values);
        let Some(temperature) = &run.temperature else { continue };
        let v0 = nominal.model.structure.sign_velocity;
        for (k, to) in sum[j].iter_mut().enumerate() {
            let v = motion.qd[j][k];
            *to += (viscous * v + coulomb * friction_sign(v, v0)) * (temperature[j][k] - reference);
        }
    }
    let forms: Vec<(Form, f64)> = effects.iter().filter_map(|e| form(e, &nominal.x, n)).collect();
    if forms.is_empty() {
        return sum;
    }
    let physics = Physics::new(run, motion, nominal, &nominal.x, None);
    for (form, factor) in forms {
        for (to, signal) in sum.iter_mut().zip(form.columns(&physics).into_iter().flatten()) {
            if let Some(signal) = signal {
                to.iter_mut().zip(signal).for_each(|(to, v)| *to += factor * v);
            }
        }
    }
    sum
}

/// Effects of the model that a prediction along a run leaves out, each with the reason.
pub fn unseen(model: &Model, has_temperature: bool) -> Vec<String> {
    let of = |e: &KnownEffect| {
        let name = format!("[effects.{}]", e.kind.name());
        let joint = || model.arm.joints[e.joint].name.clone();
        match e.kind {
            EffectKind::TemperatureDependentFriction if !has_temperature => {
                Some(format!("{name} of {}: the log has no temperature", joint()))
            }
            EffectKind::TorqueSaturation => {
                Some(format!("{name} of {}: what a command asks beyond the limit is not in the motion", joint()))
            }
            _ => None,
        }
    };
    model.effects().list().iter().filter_map(of).collect()
}

/// Torque of all effects along a run \[N·m\], `[joint][sample]`, beside the model with the standard vector of `nominal`.
pub(crate) fn torque(nominal: &Nominal, effects: &[KnownEffect], run: &Run, motion: &Motion) -> Vec<Vec<f64>> {
    let (n, width) = (motion.joints(), nominal.model.len());
    let mut sum = memory(nominal, effects, run, motion);
    if effects.iter().all(|e| e.kind.not_instant().is_some()) {
        return sum;
    }
    let drives = rivet_dynamics::Joints {
        rotor_inertia: nominal.x[10 * n..11 * n].to_vec(),
        viscous: nominal.x[11 * n..12 * n].to_vec(),
        ..Default::default()
    };
    let mut arm = nominal.model.arm.clone();
    arm.links = crate::physics::bodies(&nominal.x, n);
    let model = Model::new(arm, nominal.model.structure)
        .with_load(nominal.model.load().to_vec())
        .with_effects(KnownEffects::new(effects.to_vec(), &drives));
    let mut ws = Workspace::new(&model.arm);
    let (mut q, mut qd, mut qdd, mut tau) = (vec![0.0; n], vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    let mut y = vec![0.0; n * width];
    for k in 0..motion.len() {
        motion.state(k, &mut q, &mut qd, &mut qdd);
        model.regressor(&mut ws, &q, &qd, &qdd, &mut y);
        let plain: Vec<f64> =
            y.chunks_exact(width).map(|row| row.iter().zip(&nominal.x).map(|(y, x)| y * x).sum()).collect();
        tau.copy_from_slice(&plain);
        model.add_effects(&mut ws, &q, &qd, &qdd, &mut tau);
        sum.iter_mut().zip(tau.iter().zip(&plain)).for_each(|(sum, (with, plain))| sum[k] += with - plain);
    }
    sum
}
