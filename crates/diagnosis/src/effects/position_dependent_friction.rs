//! Friction that varies with the joint's angle: `s·cos(kq)`, `s·sin(kq)`, `s`.

use rivet_dynamics::{EffectKind, Parameter, Places};

use crate::effects::about::{About, SLOW_SPEEDS};
use crate::effects::carried::Carried;
use crate::effects::columns::{Full, on};
use crate::effects::effect_form::EffectForm;
use crate::effects::physics::Physics;
use crate::effects::size::{PHASE, named, phase, wave};
use crate::effects::{Effect, Kind};

/// Orders of friction over the joint's turn.
const FRICTION_ORDERS: [f64; 3] = [1.0, 2.0, 3.0];

pub(super) const ABOUT: About =
    About { motion: SLOW_SPEEDS, ..About::new("position_dependent_friction", Kind::Structure) };

/// `s·cos(kq)`, `s·sin(kq)`, `s`: a part of a turn has a mean
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct PositionFriction {
    pub(crate) joint: usize,
    /// k, cycles per turn.
    pub(crate) order: f64,
}

impl PositionFriction {
    /// The grid of a joint.
    pub(super) fn grid(joint: usize) -> impl Iterator<Item = PositionFriction> {
        FRICTION_ORDERS.into_iter().map(move |order| PositionFriction { joint, order })
    }
}

impl EffectForm for PositionFriction {
    fn effect(&self) -> Effect {
        Effect::PositionDependentFriction
    }

    fn joints(&self) -> Vec<usize> {
        vec![self.joint]
    }

    fn coefficients(&self) -> usize {
        3
    }

    fn inner_values(&self) -> usize {
        1
    }

    fn columns(&self, p: &Physics<'_>) -> Vec<Full> {
        let (j, order) = (self.joint, self.order);
        let (q, s) = (&p.motion.q[j], &p.sign[j]);
        vec![on(p, j, |k| s[k] * (order * q[k]).cos()), on(p, j, |k| s[k] * (order * q[k]).sin()), on(p, j, |k| s[k])]
    }

    fn carried(&self, c: &[f64], _x: &[f64], joints: usize, _: Option<&[f64]>) -> (Carried, Vec<(usize, f64)>) {
        let level = vec![(Places::new(joints).coulomb(self.joint), c[2])];
        let values = [c[0], c[1], self.order];
        Carried::section_with_values(EffectKind::PositionDependentFriction, self.joint, &values, level)
    }

    fn magnitude(&self, c: &[f64], _joints: usize, _reference: &[f64]) -> Vec<(String, f64)> {
        named(&[("amplitude_Nm", wave(c)), (PHASE, phase(c)), ("cycles_per_turn", self.order)])
    }

    fn shares(&self, parameter: Parameter, _joints: usize) -> bool {
        matches!(parameter, Parameter::Coulomb(j) if j == self.joint)
    }

    fn order(&self) -> Option<f64> {
        Some(self.order)
    }

    fn wave_is_below(&self, c: &[f64], share: f64) -> bool {
        c[0].hypot(c[1]) < share * c[2].abs()
    }
}
