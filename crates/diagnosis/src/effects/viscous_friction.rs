//! Viscous friction: in proportion to speed, `q̇`.

use crate::effects::about::About;
use crate::effects::carried::Carried;
use crate::effects::columns::{Full, on};
use crate::effects::effect_form::EffectForm;
use crate::effects::physics::Physics;
use crate::effects::size::named;
use crate::effects::{Effect, Kind};
use rivet_dynamics::Places;

/// The effect.
pub(crate) const EFFECT: Effect = Effect::ViscousFriction;

pub(super) const ABOUT: About = About { is_drive: true, ..About::friction("viscous_friction", Kind::Value) };

/// `q̇`
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Viscous {
    pub(crate) joint: usize,
}

impl EffectForm for Viscous {
    fn effect(&self) -> Effect {
        EFFECT
    }

    fn joints(&self) -> Vec<usize> {
        vec![self.joint]
    }

    fn columns(&self, p: &Physics<'_>) -> Vec<Full> {
        vec![on(p, self.joint, |k| p.motion.qd[self.joint][k])]
    }

    fn carried(&self, c: &[f64], _x: &[f64], joints: usize, _: Option<&[f64]>) -> (Carried, Vec<(usize, f64)>) {
        Carried::values(vec![(Places::new(joints).viscous(self.joint), c[0])])
    }

    fn magnitude(&self, c: &[f64], _joints: usize, _reference: &[f64]) -> Vec<(String, f64)> {
        named(&[("change_Nms_rad", c[0])])
    }

    fn place(&self, joints: usize) -> Option<usize> {
        Some(Places::new(joints).viscous(self.joint))
    }

    fn changes_values(&self) -> bool {
        true
    }
}
