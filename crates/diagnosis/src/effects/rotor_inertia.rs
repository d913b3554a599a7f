//! Drive inertia at the joint: `q̈`.

use crate::effects::about::About;
use crate::effects::carried::Carried;
use crate::effects::columns::{Full, on};
use crate::effects::effect_form::EffectForm;
use crate::effects::physics::Physics;
use crate::effects::size::named;
use crate::effects::variable::Variable;
use crate::effects::{Effect, Kind};
use rivet_dynamics::Places;

/// The effect.
pub(crate) const EFFECT: Effect = Effect::RotorInertia;

pub(super) const ABOUT: About = About {
    variable: [Variable::Acceleration; 2],
    is_drive: true,
    is_inertia: true,
    ..About::new("rotor_inertia", Kind::Value)
};

/// `q̈`
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct RotorInertia {
    pub(crate) joint: usize,
}

impl EffectForm for RotorInertia {
    fn effect(&self) -> Effect {
        EFFECT
    }

    fn joints(&self) -> Vec<usize> {
        vec![self.joint]
    }

    fn columns(&self, p: &Physics<'_>) -> Vec<Full> {
        vec![on(p, self.joint, |k| p.motion.qdd[self.joint][k])]
    }

    fn carried(&self, c: &[f64], _x: &[f64], joints: usize, _: Option<&[f64]>) -> (Carried, Vec<(usize, f64)>) {
        Carried::values(vec![(Places::new(joints).rotor_inertia(self.joint), c[0])])
    }

    fn magnitude(&self, c: &[f64], joints: usize, reference: &[f64]) -> Vec<(String, f64)> {
        named(&[("inertia_gain", 1.0 + c[0] / reference[Places::new(joints).rotor_inertia(self.joint)].max(1e-12))])
    }

    fn place(&self, joints: usize) -> Option<usize> {
        Some(Places::new(joints).rotor_inertia(self.joint))
    }

    fn changes_values(&self) -> bool {
        true
    }
}
