//! Mass, centre of mass and inertia of a link: the body of the file, scaled.

use crate::effects::about::{ARM_POSES, About};
use crate::effects::carried::Carried;
use crate::effects::columns::{Full, body};
use crate::effects::effect_form::EffectForm;
use crate::effects::physical_bounds::{Impossible, of_value};
use crate::effects::physics::Physics;
use crate::effects::size::named;
use crate::effects::{Effect, Kind};
use crate::model::nominal::Nominal;
use crate::policy::POLICY;
use rivet_dynamics::Places;

/// The effect.
pub(crate) const EFFECT: Effect = Effect::LinkInertia;

pub(super) const ABOUT: About =
    About { motion: ARM_POSES, is_link_body: true, is_inertia: true, ..About::new("link_inertia", Kind::Value) };

/// The link's body, scaled.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct LinkScale {
    pub(crate) link: usize,
}

impl EffectForm for LinkScale {
    fn effect(&self) -> Effect {
        EFFECT
    }

    fn joints(&self) -> Vec<usize> {
        vec![self.link]
    }

    fn columns(&self, p: &Physics<'_>) -> Vec<Full> {
        vec![body(p, self.link, &std::array::from_fn(|e| p.nominal.x[Places::link(self.link).start + e]))]
    }

    fn carried(&self, c: &[f64], x: &[f64], _joints: usize, _: Option<&[f64]>) -> (Carried, Vec<(usize, f64)>) {
        Carried::values(Places::link(self.link).map(|at| (at, c[0] * x[at])).collect())
    }

    fn magnitude(&self, c: &[f64], _joints: usize, _reference: &[f64]) -> Vec<(String, f64)> {
        named(&[("mass_gain", 1.0 + c[0])])
    }

    fn made_with<'a>(&self, physics: &'a Physics<'_>) -> &'a [f64] {
        // The link's body as the file has it, whatever was refitted since.
        &physics.nominal.x
    }

    fn plausible(&self, c: &[f64]) -> bool {
        c[0] > -0.9
    }

    fn impossible(&self, _c: &[f64], nominal: &Nominal, standard: &[f64]) -> Option<Impossible> {
        Places::link(self.link).find_map(|at| of_value(at, nominal, standard))
    }

    fn changes_values(&self) -> bool {
        true
    }

    fn prior_std(&self) -> Option<f64> {
        Some(POLICY.priors.link_scale)
    }
}
