//! A base that is not level: gravity along the base's x and y.

use crate::effects::about::{ARM_POSES, About};
use crate::effects::carried::Carried;
use crate::effects::columns::{Full, gravity};
use crate::effects::effect_form::EffectForm;
use crate::effects::physics::Physics;
use crate::effects::size::{named, wave};
use crate::effects::{Effect, Kind};

/// The effect.
pub(crate) const EFFECT: Effect = Effect::GravityDirection;

pub(super) const ABOUT: About =
    About { motion: ARM_POSES, is_judged_in_motion: true, ..About::new("gravity_direction", Kind::Value) };

/// Gravity along the base's x and y \[m/s²\].
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Gravity;

impl EffectForm for Gravity {
    fn effect(&self) -> Effect {
        EFFECT
    }

    fn joints(&self) -> Vec<usize> {
        Vec::new()
    }

    fn coefficients(&self) -> usize {
        2
    }

    fn columns(&self, p: &Physics<'_>) -> Vec<Full> {
        gravity(p)
    }

    fn carried(&self, c: &[f64], _x: &[f64], _joints: usize, _: Option<&[f64]>) -> (Carried, Vec<(usize, f64)>) {
        (Carried::Gravity([c[0], c[1], 0.0]), Vec::new())
    }

    fn magnitude(&self, c: &[f64], _joints: usize, _reference: &[f64]) -> Vec<(String, f64)> {
        named(&[("tilt_rad", wave(c) / 9.81), ("gx_m_s2", c[0]), ("gy_m_s2", c[1])])
    }

    fn plausible(&self, c: &[f64]) -> bool {
        c.iter().all(|c| c.abs() < 3.0)
    }
}
