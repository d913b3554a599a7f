//! Coulomb friction: a level with the direction of motion, `s`.

use crate::effects::about::{About, BOTH_DIRECTIONS};
use crate::effects::carried::Carried;
use crate::effects::columns::{Full, on};
use crate::effects::effect_form::EffectForm;
use crate::effects::physics::Physics;
use crate::effects::size::named;
use crate::effects::{Effect, Kind};
use rivet_dynamics::Places;

/// The effect.
pub(crate) const EFFECT: Effect = Effect::CoulombFriction;

pub(super) const ABOUT: About =
    About { motion: BOTH_DIRECTIONS, is_drive: true, ..About::friction("coulomb_friction", Kind::Value) };

/// `s`
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Coulomb {
    pub(crate) joint: usize,
}

impl EffectForm for Coulomb {
    fn effect(&self) -> Effect {
        EFFECT
    }

    fn joints(&self) -> Vec<usize> {
        vec![self.joint]
    }

    fn columns(&self, p: &Physics<'_>) -> Vec<Full> {
        vec![on(p, self.joint, |k| p.sign[self.joint][k])]
    }

    fn carried(&self, c: &[f64], _x: &[f64], joints: usize, _: Option<&[f64]>) -> (Carried, Vec<(usize, f64)>) {
        Carried::values(vec![(Places::new(joints).coulomb(self.joint), c[0])])
    }

    fn magnitude(&self, c: &[f64], _joints: usize, _reference: &[f64]) -> Vec<(String, f64)> {
        named(&[("change_Nm", c[0])])
    }

    fn place(&self, joints: usize) -> Option<usize> {
        Some(Places::new(joints).coulomb(self.joint))
    }

    fn changes_values(&self) -> bool {
        true
    }
}
