//! Effects of known size: those of a robot file, and those that a diagnosis hands to one.

use rivet_dynamics::{EffectKind, Joints, KnownEffect, KnownEffects, Model, Workspace, friction_sign};

use crate::effects::form::Form;
use crate::effects::physics::Physics;
use crate::effects::physics::base_mode::Mode;
use crate::effects::two_mass::Gear;
use crate::effects::warming;
use crate::model::nominal::Nominal;
use crate::model::run::{Motion, Run};
use crate::policy::POLICY;

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
    /// Standard vector that the columns of the form are made with.
    pub(crate) fn made_with<'a>(&self, physics: &'a Physics<'_>) -> &'a [f64] {
        match self {
            // The link's body as the file has it, whatever was refitted since.
            Form::LinkScale { .. } => &physics.nominal.x,
            _ => &physics.x,
        }
    }

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
        let mut value_changes = Vec::new();
        let effect = |kind: Kind, joint: usize, values: &[f64]| Carried::Effect(KnownEffect::new(kind, joint, values));
        let carried = match *self {
            Form::Asymmetry { joint } => effect(Kind::FrictionAsymmetry, joint, c),
            Form::OneSided { joint, forwards } => {
                // Half of it is friction of both directions, half pushes one way.
                value_changes.push((coulomb(joint), 0.5 * c[0]));
                let push = if forwards { 0.5 } else { -0.5 } * c[0];
                effect(Kind::FrictionAsymmetry, joint, &[push, 0.0])
            }
            Form::Stribeck { joint, velocity } => effect(Kind::StribeckFriction, joint, &[c[0], velocity]),
            Form::ViscousNonlinearity { joint } => {
                value_changes.push((11 * joints + joint, c[0]));
                effect(Kind::ViscousNonlinearity, joint, &c[1..])
            }
            Form::Load { joint } => effect(Kind::LoadDependentFriction, joint, c),
            Form::Temperature { joint } => {
                let reference = reference_c.map_or(0.0, |t| t[joint]);
                effect(Kind::TemperatureDependentFriction, joint, &[c[0], c[1], reference])
            }
            Form::Warming { joint, warmth } => {
                // A file's friction holds at the beginning, and its state is in watts.
                let (power, early) = (warmth.mean_power(x, joints, joint), warmth.start - warmth.reference());
                let values = [c[0] / power, c[1] / power, warmth.start * power, warmth.time_s];
                // By values that take nothing, or next to nothing, it is infinitely much for each watt.
                if !values.iter().all(|v| v.abs() <= POLICY.plausibility.max_friction_per_watt) {
                    return (
                        Carried::Nothing(
                            "friction dissipates no power with the parameters found, so it cannot warm \
                                          the joint",
                        ),
                        value_changes,
                    );
                }
                value_changes.extend([(11 * joints + joint, c[0] * early), (coulomb(joint), c[1] * early)]);
                effect(Kind::TemperatureDependentFriction, joint, &values)
            }
            Form::Presliding { joint, length } => {
                effect(Kind::PreslidingFriction, joint, &[c[0] * x[coulomb(joint)].abs(), length])
            }
            Form::Hysteresis { .. } => Carried::Nothing(
                "hysteresis in parallel to friction is not in the list of \
                                                         effects",
            ),
            Form::PositionFriction { joint, order } => {
                value_changes.push((coulomb(joint), c[2]));
                effect(Kind::PositionDependentFriction, joint, &[c[0], c[1], order])
            }
            Form::Gain { joint } => effect(Kind::TorqueConstant, joint, c),
            Form::TorqueLaw { .. } => {
                Carried::Nothing("torque that is not proportional to its signal is not in the list of effects")
            }
            Form::Ripple { joint, order } => effect(Kind::TorqueRipple, joint, &[c[0], c[1], order]),
            Form::TransmissionError { joint, order } => effect(Kind::TransmissionError, joint, &[c[0], c[1], order]),
            Form::TwoMass { joint, gear } if gear.gap > 0.0 => {
                effect(Kind::Backlash, joint, &[gear.gap, gear.stiffness, gear.damping, c[0]])
            }
            Form::TwoMass { joint, gear } => {
                effect(Kind::JointElasticity, joint, &[gear.stiffness, gear.damping, c[0]])
            }
            Form::Base { mode } => effect(Kind::BaseFlexibility, 0, &mode.handed_on(c[0])),
            Form::Spring { joint } => {
                value_changes.push((13 * joints + joint, c[1]));
                effect(Kind::JointSpring, joint, &c[..1])
            }
            Form::Counterbalance { joint, arm, phase } => {
                effect(Kind::Counterbalance, joint, &[c[0], c[1], arm, phase])
            }
            Form::Counterweight { joint } => {
                // Without free length the lever law is a sine, whatever the arm.
                effect(Kind::Counterbalance, joint, &[2.0 * c[0].hypot(c[1]), 0.0, 0.5, c[1].atan2(c[0])])
            }
            Form::Pull { .. } => Carried::Nothing("a pull from one angle on is not in the list of effects"),
            Form::AngleLaw { .. } | Form::Softening { .. } => {
                Carried::Nothing("another law of the angle is not in the list of effects")
            }
            Form::Constant { .. } => Carried::Nothing("a constant torque is not in the list of effects"),
            Form::PositionScale { .. } => Carried::Nothing("a scale of the position is not in the list of effects"),
            Form::SpringBetween { .. } => Carried::Nothing("a spring over two joints is not in the list of effects"),
            Form::Coupling { driving, driven, whole } => {
                if whole {
                    value_changes.extend([driving, driven].map(|j| (10 * joints + j, c[2])));
                }
                effect(Kind::JointCoupling, driven, c)
            }
            Form::Delay { seconds } => effect(Kind::TransportDelay, 0, &[seconds * c[0]]),
            Form::Lag { .. } => effect(Kind::CurrentLoopLag, 0, c),
            Form::Saturation { joint, limit } => effect(Kind::TorqueSaturation, joint, &[limit]),
            Form::EncoderOffset { joint } => effect(Kind::EncoderOffset, joint, c),
            Form::Eccentricity { joint } => effect(Kind::EncoderEccentricity, joint, c),
            Form::Force { .. } => Carried::Nothing("contact is not a property of the arm"),
            Form::Gravity => Carried::Gravity([c[0], c[1], 0.0]),
            Form::Payload => Carried::Values((0..10).map(|e| (10 * (joints - 1) + e, c[e])).collect()),
            Form::LinkScale { link } => {
                Carried::Values((0..10).map(|e| (10 * link + e, c[0] * x[10 * link + e])).collect())
            }
            Form::RotorInertia { joint } => Carried::Values(vec![(10 * joints + joint, c[0])]),
            Form::Viscous { joint } => Carried::Values(vec![(11 * joints + joint, c[0])]),
            Form::Coulomb { joint } => Carried::Values(vec![(coulomb(joint), c[0])]),
        };
        (carried, value_changes)
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
        EffectKind::Backlash => Some((Form::TwoMass { joint, gear: Gear { gap: a, stiffness: b, damping: c } }, d)),
        EffectKind::JointElasticity => {
            Some((Form::TwoMass { joint, gear: Gear { gap: 0.0, stiffness: a, damping: b } }, c))
        }
        EffectKind::BaseFlexibility => {
            let mode = Mode::given([a, b, c, d]);
            Some((Form::Base { mode }, mode.share))
        }
        EffectKind::TransportDelay => Some((Form::Delay { seconds: a }, 1.0)),
        EffectKind::CurrentLoopLag => Some((Form::Lag { stands: false }, a)),
        _ => None,
    }
}

/// Torque of effects of `model` along a run that need more than one instant \[N·m\], `[joint][sample]`; none when it has no
/// such effect. `x` is its standard vector.
///
/// Friction that follows a measured temperature is nothing without one in the run, and what is not delivered of a
/// commanded torque is not known from the motion: see [`unseen`].
pub fn memory_torque(model: &Model, x: &[f64], run: &Run) -> Option<Vec<Vec<f64>>> {
    let effects = model.effects().list();
    effects.iter().any(|e| e.kind.not_instant().is_some()).then(|| {
        let nominal = Nominal::exact(model, x);
        memory(&nominal, effects, run, &Motion::from_run(run))
    })
}

fn memory(nominal: &Nominal, effects: &[KnownEffect], run: &Run, motion: &Motion) -> Vec<Vec<f64>> {
    let n = motion.joints();
    let mut sum = vec![vec![0.0; motion.len()]; n];
    for effect in effects.iter().filter(|e| e.kind == EffectKind::TemperatureDependentFriction) {
        let (j, [viscous, coulomb, reference, time_s]) = (effect.joint, effect.values);
        let warm = if time_s > 0.0 {
            warming::lagged(run, motion, &nominal.x, j, [time_s, reference])
        } else {
            let Some(temperature) = &run.temperature else { continue };
            temperature[j].clone()
        };
        let v0 = nominal.model.structure.sign_velocity;
        for (k, to) in sum[j].iter_mut().enumerate() {
            let v = motion.qd[j][k];
            *to += (viscous * v + coulomb * friction_sign(v, v0)) * (warm[k] - reference);
        }
    }
    let forms: Vec<(Form, f64)> = effects.iter().filter_map(|e| form(e, &nominal.x, n)).collect();
    if forms.is_empty() {
        return sum;
    }
    let physics = Physics::new(run, motion, nominal, &nominal.x);
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
    let reason = |e: &KnownEffect| {
        let name = format!("[effects.{}]", e.kind.name());
        let joint = || model.arm.joints[e.joint].name.clone();
        match e.kind {
            EffectKind::TemperatureDependentFriction if !has_temperature && e.values[3] == 0.0 => {
                Some(format!("{name} of {}: the log has no temperature", joint()))
            }
            EffectKind::TorqueSaturation => {
                Some(format!("{name} of {}: the part of a command beyond the limit is not in the motion", joint()))
            }
            _ => None,
        }
    };
    model.effects().list().iter().filter_map(reason).collect()
}

/// Torque of all effects along a run \[N·m\], `[joint][sample]`, beside the model with the standard vector of `nominal`.
pub(crate) fn torque(nominal: &Nominal, effects: &[KnownEffect], run: &Run, motion: &Motion) -> Vec<Vec<f64>> {
    let (n, width) = (motion.joints(), nominal.model.len());
    let mut sum = memory(nominal, effects, run, motion);
    if effects.iter().all(|e| e.kind.not_instant().is_some()) {
        return sum;
    }
    let drives = nominal.model.drives(&nominal.x, Joints::zero(n));
    let mut arm = nominal.model.arm.clone();
    arm.links = crate::effects::physics::bodies(&nominal.x, n);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::warming::Warmth;
    use rivet_dynamics::{Arm, Structure};

    /// By watts that are none a robot file would get an infinite number, which nothing reads.
    #[test]
    fn warming_by_friction_that_takes_nothing_is_not_handed_on() {
        let warmth = Warmth { time_s: 1.5, start: 0.4, at_work: true, work: [0.2, 0.06], power: 1.0, span_s: 2.5 };
        let x = |friction: f64| [vec![1.0; 33], vec![friction; 9]].concat();
        for (friction, carries) in [(2.0, true), (0.0, false), (-1.0, false), (1e-9, false)] {
            let (carried, beside) = Form::Warming { joint: 1, warmth }.carried(&[-0.3, -0.9], &x(friction), 3, None);
            assert_eq!(matches!(carried, Carried::Effect(_)), carries, "{friction} N m");
            assert_eq!(beside.is_empty(), !carries);
        }
    }

    /// The forms of this crate and the effects of a robot file are two implementations: whatever a diagnosis hands on must
    /// be the torque that it was adopted for.
    #[test]
    fn what_is_handed_on_is_what_was_adopted() {
        let text = include_str!("../../../../robots/manutec-r3/robot.urdf");
        let arm = Arm::from_urdf(text, [0.0, 0.0, -9.81]).expect("a sound arm");
        let n = arm.dof();
        let model = Model::new(arm, Structure { offset: true, sign_velocity: 0.01, ..Structure::default() });
        let mut x = model.arm.links.concat();
        for (size, slope) in [(1.5, 0.2), (4.0, 0.5), (6.0, 0.3), (0.0, 0.0)] {
            x.extend((0..n).map(|j| size + slope * j as f64));
        }
        // Slow: the forms of angles that are off leave out velocity products with the error's speed.
        let wave = |j: usize, k: usize| {
            let t = 3e-4 * k as f64;
            0.8 * (1.3 * t + j as f64).sin() + 0.2 * ((3.0 + 0.4 * j as f64) * t).cos()
        };
        let signal = |f: &dyn Fn(usize, usize) -> f64| -> Vec<Vec<f64>> {
            (0..n).map(|j| (0..2500).map(|k| f(j, k)).collect()).collect()
        };
        let run = Run {
            name: String::new(),
            period_s: 1e-3,
            q: signal(&wave),
            tau: signal(&|_, _| 0.0),
            temperature: Some(signal(&|j, k| 30.0 + j as f64 + 2e-3 * k as f64)),
            ..Run::default()
        };
        let (nominal, motion) = (Nominal::exact(&model, &x), Motion::from_run(&run));
        let physics = Physics::new(&run, &motion, &nominal, &x);
        let start: Vec<f64> = run.temperature.iter().flatten().map(|t| t[0]).collect();
        let warmth = Warmth { time_s: 1.5, start: 0.4, at_work: true, work: [2e-4, 6e-8], power: 1.0, span_s: 2.5 };
        let mode =
            Mode { hz: 9.0, damping: 0.04, heading: 0.6, share: 0.7, inertia: [40.0, 3.0, 30.0], highest_hz: 27.0 };
        let gear = |gap: f64| Gear { stiffness: 2e4, damping: 0.2, gap };
        let cases: Vec<(Form, Vec<f64>)> = vec![
            (Form::Asymmetry { joint: 1 }, vec![1.2, 0.4]),
            (Form::OneSided { joint: 0, forwards: true }, vec![1.4]),
            (Form::OneSided { joint: 3, forwards: false }, vec![-0.6]),
            (Form::Stribeck { joint: 2, velocity: 0.05 }, vec![2.0]),
            (Form::ViscousNonlinearity { joint: 0 }, vec![0.4, -0.7, 0.3]),
            (Form::Load { joint: 1 }, vec![0.12]),
            (Form::Temperature { joint: 3 }, vec![-0.05, -0.02]),
            (Form::Warming { joint: 1, warmth }, vec![-0.3, -0.9]),
            (Form::Warming { joint: 4, warmth: Warmth { start: 2.0, ..warmth } }, vec![-0.3, -0.9]),
            (Form::Presliding { joint: 2, length: 0.01 }, vec![0.9]),
            (Form::PositionFriction { joint: 4, order: 2.0 }, vec![0.5, -0.8, 0.0]),
            (Form::Gain { joint: 1 }, vec![0.08]),
            (Form::Ripple { joint: 5, order: 60.0 }, vec![0.3, 0.2]),
            (Form::TransmissionError { joint: 1, order: 20.0 }, vec![1e-6, 2e-6]),
            (Form::Eccentricity { joint: 2 }, vec![1e-5, -2e-5]),
            (Form::TwoMass { joint: 1, gear: gear(0.0) }, vec![1.05]),
            (Form::TwoMass { joint: 1, gear: gear(2e-3) }, vec![0.95]),
            (Form::Spring { joint: 2 }, vec![7.0, 0.0]),
            (Form::Counterbalance { joint: 1, arm: 0.3, phase: 0.7 }, vec![20.0, -8.0]),
            (Form::Counterweight { joint: 1 }, vec![-20.0, 8.0]),
            (Form::Coupling { driving: 4, driven: 5, whole: false }, vec![0.6, 0.4, 0.02]),
            (Form::Coupling { driving: 4, driven: 5, whole: true }, vec![0.6, 0.4, 0.02]),
            (Form::Delay { seconds: 0.003 }, vec![1.0]),
            (Form::Lag { stands: false }, vec![0.004]),
            (Form::EncoderOffset { joint: 1 }, vec![1e-5]),
            (Form::Base { mode }, vec![mode.share]),
        ];
        let mut seen = Vec::new();
        for (form, c) in cases {
            let (Carried::Effect(effect), beside) = form.carried(&c, &x, n, Some(&start)) else {
                panic!("{form:?} has a section of its own")
            };
            seen.push(effect.kind);
            let mut handed_on = torque(&nominal, &[effect], &run, &motion);
            // Friction of both directions and rotors go into the values; offsets are zero here.
            for (at, change) in beside.into_iter().filter(|(at, _)| *at < 13 * n) {
                let signal = [&motion.qdd, &motion.qd, &physics.sign][at / n - 10];
                handed_on[at % n].iter_mut().zip(&signal[at % n]).for_each(|(to, s)| *to += change * s);
            }
            let mut adopted = vec![vec![0.0; run.len()]; n];
            for (column, factor) in form.columns(&physics).into_iter().zip(&c) {
                for (to, signal) in adopted.iter_mut().zip(column) {
                    to.iter_mut().zip(signal.iter().flatten()).for_each(|(to, v)| *to += factor * v);
                }
            }
            // The ends of a record are the differentiator's.
            let inner =
                |signal: &[Vec<f64>]| -> Vec<f64> { signal.iter().flat_map(|s| s[50..2450].to_vec()).collect() };
            let (a, b) = (inner(&handed_on), inner(&adopted));
            let size = b.iter().map(|v| v * v).sum::<f64>().sqrt();
            let apart = a.iter().zip(&b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
            let tolerance = match effect.kind {
                // Beside those products one turn's wave is little else.
                EffectKind::EncoderEccentricity => 0.06,
                EffectKind::TransmissionError | EffectKind::EncoderOffset => 0.02,
                _ => 1e-9,
            };
            assert!(size > 0.0 && apart <= tolerance * size, "{form:?}: {apart} of {size}");
        }
        let missing: Vec<_> =
            EffectKind::ALL.iter().filter(|k| !seen.contains(k) && **k != EffectKind::TorqueSaturation).collect();
        assert!(missing.is_empty(), "{missing:?} were not compared");
        // Values, also where others were refitted meanwhile.
        let refitted: Vec<f64> = x.iter().map(|v| 1.3 * v).collect();
        let physics = Physics::new(&run, &motion, &nominal, &refitted);
        let (mut ws, mut y) = (Workspace::new(&model.arm), vec![0.0; n * model.len()]);
        for form in [Form::LinkScale { link: 2 }, Form::Payload, Form::Viscous { joint: 1 }] {
            let columns = form.columns(&physics);
            let c: Vec<f64> = (0..columns.len()).map(|i| 0.3 + 0.1 * i as f64).collect();
            let (Carried::Values(changes), _) = form.carried(&c, form.made_with(&physics), n, None) else {
                panic!("{form:?} has no values")
            };
            for k in (100..2400).step_by(460) {
                let [q, qd, qdd] =
                    [&motion.q, &motion.qd, &motion.qdd].map(|s| s.iter().map(|s| s[k]).collect::<Vec<_>>());
                model.regressor(&mut ws, &q, &qd, &qdd, &mut y);
                for (j, row) in y.chunks_exact(model.len()).enumerate() {
                    let handed_on: f64 = changes.iter().map(|(at, change)| row[*at] * change).sum();
                    let adopted: f64 =
                        columns.iter().zip(&c).map(|(f, c)| c * f[j].as_ref().map_or(0.0, |f| f[k])).sum();
                    assert!(
                        (handed_on - adopted).abs() < 1e-9 * (1.0 + adopted.abs()),
                        "{form:?}: {handed_on} {adopted}"
                    );
                }
            }
        }
    }
}
