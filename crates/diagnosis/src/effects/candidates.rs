//! Candidates: every effect on every joint that it can act on, with a grid of inner values.
//!
//! Effects that depend on more than one run are listed in their own files: `temperature_dependent_friction` and
//! `base_flexibility`.

use crate::effects::Form;
use crate::effects::angle_law::{AngleLaw, Pull, Softening, beginnings, span};
use crate::effects::base_flexibility::{self, Base};
use crate::effects::coulomb_friction::Coulomb;
use crate::effects::counterbalance::{Counterbalance, Counterweight};
use crate::effects::current_loop_lag::Lag;
use crate::effects::encoder_eccentricity::{Eccentricity, PositionScale};
use crate::effects::encoder_offset::EncoderOffset;
use crate::effects::friction_asymmetry::{Asymmetry, Constant, OneSided};
use crate::effects::gravity_direction::Gravity;
use crate::effects::joint_coupling::Coupling;
use crate::effects::joint_elasticity::TwoMass;
use crate::effects::joint_spring::{Spring, SpringBetween};
use crate::effects::link_inertia::LinkScale;
use crate::effects::load_dependent_friction::Load;
use crate::effects::payload::Payload;
use crate::effects::physics::Physics;
use crate::effects::position_dependent_friction::PositionFriction;
use crate::effects::presliding_friction::{Hysteresis, Presliding};
use crate::effects::rotor_inertia::RotorInertia;
use crate::effects::stribeck_friction::Stribeck;
use crate::effects::temperature_dependent_friction::Temperature;
use crate::effects::torque_constant::{Gain, TorqueLaw};
use crate::effects::torque_ripple::Ripple;
use crate::effects::torque_saturation::Saturation;
use crate::effects::transmission_error::TransmissionError;
use crate::effects::transport_delay::Delay;
use crate::effects::viscous_friction::Viscous;
use crate::effects::viscous_nonlinearity::ViscousNonlinearity;
use crate::model::standstill;
use crate::policy::POLICY;

/// All forms for runs, orders of ripple from `orders[joint]`; none for no run.
pub(crate) fn forms(runs: &[Physics<'_>], orders: &[Vec<f64>]) -> Vec<Form> {
    let Some(first) = runs.first() else { return Vec::new() };
    let n = first.joints();
    let mut forms: Vec<Form> =
        vec![Gravity.into(), Payload.into(), Lag { stands: false }.into(), Lag { stands: true }.into()];
    forms.extend(Delay::grid().map(Form::from));
    for joint in 0..n {
        forms.extend([
            Asymmetry { joint }.into(),
            OneSided { joint, forwards: true }.into(),
            OneSided { joint, forwards: false }.into(),
            ViscousNonlinearity { joint }.into(),
            Load { joint }.into(),
            Gain { joint }.into(),
            TorqueLaw { joint }.into(),
            EncoderOffset { joint }.into(),
            PositionScale { joint }.into(),
            Constant { joint }.into(),
            Eccentricity { joint }.into(),
            LinkScale { link: joint }.into(),
            RotorInertia { joint }.into(),
            Coulomb { joint }.into(),
            Form::from(Viscous { joint }),
        ]);
        if runs.iter().any(|p| p.run.temperature.is_some()) {
            forms.push(Temperature { joint }.into());
        }
        forms.extend(Stribeck::grid(joint).map(Form::from));
        forms.extend(Presliding::grid(joint).map(Form::from));
        forms.extend(Hysteresis::grid(joint).map(Form::from));
        forms.extend(PositionFriction::grid(joint).map(Form::from));
        forms.extend(Saturation::grid(runs, joint).into_iter().map(Form::from));
        forms.extend(orders[joint].iter().flat_map(|order| periodic(joint, *order)));
        forms.extend(TwoMass::grid(joint, inertia(runs, joint)).map(Form::from));
        // What one joint holds while its neighbour stands no motor brings it.
        let moves = |p: &Physics<'_>, j: usize| !standstill::is_still(p.motion, j);
        let together = joint > 0 && runs.iter().any(|p| moves(p, joint - 1) && moves(p, joint));
        if together && first.nominal.model.structure.coupling.is_none() {
            forms.extend(Coupling::grid(joint).map(Form::from));
        }
        let range = span(runs.iter().flat_map(|p| &p.motion.q[joint]));
        let (low, high) = range;
        // Within a small angle any torque is a straight line, and as large as one likes.
        if high - low < POLICY.plausibility.min_angle_law_range_rad {
            continue;
        }
        let about = 0.5 * (low + high);
        forms.extend([Spring { joint }.into(), Form::from(AngleLaw { joint, about })]);
        if let Some((before, middle)) = joint.checked_sub(1).and_then(|j| Some((j, middle(runs, j)?))) {
            forms.push(SpringBetween { joints: [before, joint], about: [middle, about] }.into());
        }
        // Where gravity does not pull nobody holds against it.
        if joint > 0 || !first.nominal.model.arm.is_upright() {
            forms.push(Counterweight { joint }.into());
            forms.extend(Counterbalance::grid(joint).map(Form::from));
        }
        for from in beginnings(range) {
            forms.extend(Softening::grid(joint, from).map(Form::from));
            forms.extend(Pull::grid(joint, from).map(Form::from));
        }
    }
    forms
}

/// The form itself, then all forms of the same effect on the same joints.
pub(crate) fn alike(form: &Form, physics: &Physics<'_>) -> Vec<Form> {
    let orders = vec![form.order().into_iter().collect(); physics.joints()];
    let same = |other: &Form| {
        other.effect() == form.effect() && other.joints() == form.joints() && other != form && !other.is_nameless()
    };
    let run = std::slice::from_ref(physics);
    let modes = if form.get::<Base>().is_some() { base_flexibility::candidates(run) } else { Vec::new() };
    let modes = modes.into_iter().map(Form::from);
    std::iter::once(form.clone()).chain(forms(run, &orders).into_iter().chain(modes).filter(same)).collect()
}

/// What repeats with an order of the joint's angle.
pub(crate) fn periodic(joint: usize, order: f64) -> [Form; 3] {
    [
        Ripple { joint, order }.into(),
        TransmissionError { joint, order }.into(),
        PositionFriction { joint, order }.into(),
    ]
}

/// Middle of a joint's angles; none where it hardly turns.
fn middle(runs: &[Physics<'_>], joint: usize) -> Option<f64> {
    let (low, high) = span(runs.iter().flat_map(|p| &p.motion.q[joint]));
    (high - low >= POLICY.plausibility.min_angle_law_range_rad).then_some(0.5 * (low + high))
}

/// Mean inertia of the link side at a joint.
fn inertia(runs: &[Physics<'_>], joint: usize) -> f64 {
    let samples: usize = runs.iter().map(Physics::samples).sum();
    let sum: f64 = runs.iter().flat_map(|p| &p.mass()[joint][joint]).sum();
    sum / samples.max(1) as f64
}
