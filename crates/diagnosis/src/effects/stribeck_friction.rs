//! Stribeck friction: an excess that falls with speed, `s·exp(−(q̇/v)²)`.

use rivet_dynamics::EffectKind;

use crate::effects::about::{About, CONSTANT_SPEEDS};
use crate::effects::carried::Carried;
use crate::effects::columns::{Full, on};
use crate::effects::effect_form::EffectForm;
use crate::effects::physical_bounds::{Impossible, wrong_sign};
use crate::effects::physics::Physics;
use crate::effects::size::named;
use crate::effects::{Effect, Kind};
use crate::model::nominal::Nominal;

/// Speeds of the Stribeck curve \[rad/s\].
const STRIBECK: [f64; 6] = [0.01, 0.02, 0.04, 0.08, 0.16, 0.32];

/// The effect.
#[cfg(test)]
pub(crate) const EFFECT: Effect = Effect::StribeckFriction;

pub(super) const ABOUT: About =
    About { motion: CONSTANT_SPEEDS, ..About::friction("stribeck_friction", Kind::Structure) };

/// `s·exp(−(q̇/v)²)`
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Stribeck {
    pub(crate) joint: usize,
    /// v \[rad/s\].
    pub(crate) velocity: f64,
}

impl Stribeck {
    /// The grid of a joint.
    pub(super) fn grid(joint: usize) -> impl Iterator<Item = Stribeck> {
        STRIBECK.into_iter().map(move |velocity| Stribeck { joint, velocity })
    }
}

impl EffectForm for Stribeck {
    fn effect(&self) -> Effect {
        Effect::StribeckFriction
    }

    fn joints(&self) -> Vec<usize> {
        vec![self.joint]
    }

    fn inner_values(&self) -> usize {
        1
    }

    fn columns(&self, p: &Physics<'_>) -> Vec<Full> {
        let (j, velocity) = (self.joint, self.velocity);
        vec![on(p, j, |k| p.sign[j][k] * (-(p.motion.qd[j][k] / velocity).powi(2)).exp())]
    }

    fn carried(&self, c: &[f64], _x: &[f64], _joints: usize, _: Option<&[f64]>) -> (Carried, Vec<(usize, f64)>) {
        Carried::section(EffectKind::StribeckFriction, self.joint, &[c[0], self.velocity])
    }

    fn magnitude(&self, c: &[f64], _joints: usize, _reference: &[f64]) -> Vec<(String, f64)> {
        named(&[("excess_Nm", c[0]), ("velocity_rad_s", self.velocity)])
    }

    fn plausible(&self, c: &[f64]) -> bool {
        c[0] > 0.0
    }

    fn impossible(&self, c: &[f64], nominal: &Nominal, _standard: &[f64]) -> Option<Impossible> {
        wrong_sign(self.plausible(c), self.joint, c, nominal)
    }

    fn scaled(&self, [a, _, _]: [f64; 3]) -> Stribeck {
        Stribeck { velocity: self.velocity * a, ..*self }
    }

    fn steps(&self) -> Vec<(usize, f64)> {
        vec![(0, 1.3)]
    }
}
