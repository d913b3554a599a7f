//! The joint's zero is elsewhere: the change of rigid torque with the joint's angle.

use rivet_dynamics::EffectKind;

use crate::effects::about::{ARM_POSES, About};
use crate::effects::carried::Carried;
use crate::effects::columns::Full;
use crate::effects::effect_form::EffectForm;
use crate::effects::physics::Physics;
use crate::effects::size::named;
use crate::effects::{Effect, Kind};

/// The effect.
pub(crate) const EFFECT: Effect = Effect::EncoderOffset;

pub(super) const ABOUT: About = About { motion: ARM_POSES, ..About::new("encoder_offset", Kind::Value) };

/// Rigid torque's change with the joint's angle
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct EncoderOffset {
    pub(crate) joint: usize,
}

impl EffectForm for EncoderOffset {
    fn effect(&self) -> Effect {
        EFFECT
    }

    fn joints(&self) -> Vec<usize> {
        vec![self.joint]
    }

    fn columns(&self, p: &Physics<'_>) -> Vec<Full> {
        vec![p.gradient()[self.joint].iter().map(|g| Some(g.clone())).collect()]
    }

    fn carried(&self, c: &[f64], _x: &[f64], _joints: usize, _: Option<&[f64]>) -> (Carried, Vec<(usize, f64)>) {
        Carried::section(EffectKind::EncoderOffset, self.joint, c)
    }

    fn magnitude(&self, c: &[f64], _joints: usize, _reference: &[f64]) -> Vec<(String, f64)> {
        named(&[("offset_rad", c[0])])
    }

    fn plausible(&self, c: &[f64]) -> bool {
        c[0].abs() < 0.3
    }
}
