//! Effects of known size: those of a robot file, and those that a diagnosis hands to one.

use rivet_dynamics::{EffectKind, Joints, KnownEffect, KnownEffects, Model, Workspace, friction_sign};

use crate::effects::Form;
use crate::effects::base_flexibility::Base;
use crate::effects::current_loop_lag::Lag;
use crate::effects::joint_elasticity::TwoMass;
use crate::effects::physics::Physics;
use crate::effects::presliding_friction::Presliding;
use crate::effects::transport_delay::Delay;
use crate::effects::warming;
use crate::model::nominal::Nominal;
use crate::model::run::{Motion, Run};

/// The form with the memory of an effect, and the factor of its one column; none for other effects.
fn form(effect: &KnownEffect, x: &[f64], joints: usize) -> Option<(Form, f64)> {
    match effect.kind {
        EffectKind::PreslidingFriction => {
            Presliding::from_file(effect, x, joints).map(|(form, factor)| (form.into(), factor))
        }
        EffectKind::Backlash | EffectKind::JointElasticity => {
            let (form, factor) = TwoMass::from_file(effect);
            Some((form.into(), factor))
        }
        EffectKind::BaseFlexibility => {
            let (form, factor) = Base::from_file(effect);
            Some((form.into(), factor))
        }
        EffectKind::TransportDelay => {
            let (form, factor) = Delay::from_file(effect);
            Some((form.into(), factor))
        }
        EffectKind::CurrentLoopLag => {
            let (form, factor) = Lag::from_file(effect);
            Some((form.into(), factor))
        }
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
    use crate::effects::carried::Carried;
    use crate::effects::counterbalance::{Counterbalance, Counterweight};
    use crate::effects::encoder_eccentricity::Eccentricity;
    use crate::effects::encoder_offset::EncoderOffset;
    use crate::effects::friction_asymmetry::{Asymmetry, OneSided};
    use crate::effects::joint_coupling::Coupling;
    use crate::effects::joint_spring::Spring;
    use crate::effects::link_inertia::LinkScale;
    use crate::effects::load_dependent_friction::Load;
    use crate::effects::payload::Payload;
    use crate::effects::physics::base_mode::Mode;
    use crate::effects::position_dependent_friction::PositionFriction;
    use crate::effects::stribeck_friction::Stribeck;
    use crate::effects::temperature_dependent_friction::{Temperature, Warming};
    use crate::effects::torque_constant::Gain;
    use crate::effects::torque_ripple::Ripple;
    use crate::effects::transmission_error::TransmissionError;
    use crate::effects::two_mass::Gear;
    use crate::effects::viscous_friction::Viscous;
    use crate::effects::viscous_nonlinearity::ViscousNonlinearity;
    use crate::effects::warming::Warmth;
    use rivet_dynamics::Places;
    use rivet_dynamics::{Arm, Structure};

    /// By watts that are none a robot file would get an infinite number, which nothing reads.
    #[test]
    fn warming_by_friction_that_takes_nothing_is_not_handed_on() {
        let warmth = Warmth { time_s: 1.5, start: 0.4, at_work: true, work: [0.2, 0.06], power: 1.0, span_s: 2.5 };
        let x = |friction: f64| [vec![1.0; 33], vec![friction; 9]].concat();
        for (friction, carries) in [(2.0, true), (0.0, false), (-1.0, false), (1e-9, false)] {
            let (carried, beside) =
                Form::from(Warming { joint: 1, warmth }).carried(&[-0.3, -0.9], &x(friction), 3, None);
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
            (Asymmetry { joint: 1 }.into(), vec![1.2, 0.4]),
            (OneSided { joint: 0, forwards: true }.into(), vec![1.4]),
            (OneSided { joint: 3, forwards: false }.into(), vec![-0.6]),
            (Stribeck { joint: 2, velocity: 0.05 }.into(), vec![2.0]),
            (ViscousNonlinearity { joint: 0 }.into(), vec![0.4, -0.7, 0.3]),
            (Load { joint: 1 }.into(), vec![0.12]),
            (Temperature { joint: 3 }.into(), vec![-0.05, -0.02]),
            (Warming { joint: 1, warmth }.into(), vec![-0.3, -0.9]),
            (Warming { joint: 4, warmth: Warmth { start: 2.0, ..warmth } }.into(), vec![-0.3, -0.9]),
            (Presliding { joint: 2, length: 0.01 }.into(), vec![0.9]),
            (PositionFriction { joint: 4, order: 2.0 }.into(), vec![0.5, -0.8, 0.0]),
            (Gain { joint: 1 }.into(), vec![0.08]),
            (Ripple { joint: 5, order: 60.0 }.into(), vec![0.3, 0.2]),
            (TransmissionError { joint: 1, order: 20.0 }.into(), vec![1e-6, 2e-6]),
            (Eccentricity { joint: 2 }.into(), vec![1e-5, -2e-5]),
            (TwoMass { joint: 1, gear: gear(0.0) }.into(), vec![1.05]),
            (TwoMass { joint: 1, gear: gear(2e-3) }.into(), vec![0.95]),
            (Spring { joint: 2 }.into(), vec![7.0, 0.0]),
            (Counterbalance { joint: 1, arm: 0.3, phase: 0.7 }.into(), vec![20.0, -8.0]),
            (Counterweight { joint: 1 }.into(), vec![-20.0, 8.0]),
            (Coupling { driving: 4, driven: 5, whole: false }.into(), vec![0.6, 0.4, 0.02]),
            (Coupling { driving: 4, driven: 5, whole: true }.into(), vec![0.6, 0.4, 0.02]),
            (Delay { seconds: 0.003 }.into(), vec![1.0]),
            (Lag { stands: false }.into(), vec![0.004]),
            (EncoderOffset { joint: 1 }.into(), vec![1e-5]),
            (Base { mode }.into(), vec![mode.share]),
        ];
        let mut seen = Vec::new();
        for (form, c) in cases {
            let (Carried::Effect(effect), beside) = form.carried(&c, &x, n, Some(&start)) else {
                panic!("{form:?} has a section of its own")
            };
            seen.push(effect.kind);
            let mut handed_on = torque(&nominal, &[effect], &run, &motion);
            // Friction of both directions and rotors go into the values; offsets are zero here.
            for (at, change) in beside.into_iter().filter(|(at, _)| *at < Places::new(n).offset(0)) {
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
        for form in [LinkScale { link: 2 }.into(), Payload.into(), Form::from(Viscous { joint: 1 })] {
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
