//! A body at the flange: its ten parameters.

use rivet_dynamics::{Parameter, Places};

use crate::effects::about::{ARM_POSES, About};
use crate::effects::carried::Carried;
use crate::effects::columns::{Full, body};
use crate::effects::effect_form::EffectForm;
use crate::effects::physical_bounds::{Impossible, of_payload};
use crate::effects::physics::Physics;
use crate::effects::size::named;
use crate::effects::{Effect, Kind};
use crate::model::nominal::Nominal;

/// The effect.
pub(crate) const EFFECT: Effect = Effect::Payload;

pub(super) const ABOUT: About =
    About { motion: ARM_POSES, acts_in_every_pose: true, ..About::new("payload", Kind::Value) };

/// Ten parameters of a body at the flange.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Payload;

impl EffectForm for Payload {
    fn effect(&self) -> Effect {
        EFFECT
    }

    fn joints(&self) -> Vec<usize> {
        Vec::new()
    }

    fn coefficients(&self) -> usize {
        10
    }

    fn columns(&self, p: &Physics<'_>) -> Vec<Full> {
        let last = p.joints() - 1;
        (0..10).map(|e| body(p, last, &std::array::from_fn(|i| f64::from(u8::from(i == e))))).collect()
    }

    fn carried(&self, c: &[f64], _x: &[f64], joints: usize, _: Option<&[f64]>) -> (Carried, Vec<(usize, f64)>) {
        Carried::values(Places::link(joints - 1).zip(c.iter().copied()).collect())
    }

    fn magnitude(&self, c: &[f64], _joints: usize, _reference: &[f64]) -> Vec<(String, f64)> {
        named(&[("mass_kg", c[0]), ("com_x_m", c[1] / c[0]), ("com_y_m", c[2] / c[0]), ("com_z_m", c[3] / c[0])])
    }

    fn plausible(&self, c: &[f64]) -> bool {
        c[0] > 0.0 && c[1..4].iter().all(|h| h.abs() < 0.6 * c[0])
    }

    fn impossible(&self, c: &[f64], nominal: &Nominal, _standard: &[f64]) -> Option<Impossible> {
        of_payload(c, &nominal.model.arm)
    }

    fn shares(&self, parameter: Parameter, joints: usize) -> bool {
        matches!(parameter, Parameter::Link { link, .. } if link + 1 == joints)
    }

    fn changes_values(&self) -> bool {
        true
    }

    fn has_unfelt_columns(&self) -> bool {
        // A planar arm feels some of a body only.
        true
    }
}
