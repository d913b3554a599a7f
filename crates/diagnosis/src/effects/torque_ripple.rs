//! Torque that varies with the angle of motor or gear: `cos(cq)`, `sin(cq)`.

use std::f64::consts::TAU;

use rivet_dynamics::EffectKind;

use crate::effects::about::{About, SLOW_SPEEDS};
use crate::effects::carried::Carried;
use crate::effects::columns::{Full, on};
use crate::effects::effect_form::EffectForm;
use crate::effects::physics::Physics;
use crate::effects::size::{PHASE, named, phase, wave};
use crate::effects::variable::Variable;
use crate::effects::{Effect, Kind};
use crate::policy::POLICY;

pub(super) const ABOUT: About =
    About { variable: [Variable::Phase; 2], motion: SLOW_SPEEDS, ..About::new("torque_ripple", Kind::Structure) };

/// `cos(cq)`, `sin(cq)`
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Ripple {
    pub(crate) joint: usize,
    /// c, cycles per turn.
    pub(crate) order: f64,
}

impl EffectForm for Ripple {
    fn effect(&self) -> Effect {
        Effect::TorqueRipple
    }

    fn joints(&self) -> Vec<usize> {
        vec![self.joint]
    }

    fn coefficients(&self) -> usize {
        2
    }

    fn inner_values(&self) -> usize {
        1
    }

    fn columns(&self, p: &Physics<'_>) -> Vec<Full> {
        let (j, order, q) = (self.joint, self.order, &p.motion.q[self.joint]);
        vec![on(p, j, |k| (order * q[k]).cos()), on(p, j, |k| (order * q[k]).sin())]
    }

    fn carried(&self, c: &[f64], _x: &[f64], _joints: usize, _: Option<&[f64]>) -> (Carried, Vec<(usize, f64)>) {
        Carried::section(EffectKind::TorqueRipple, self.joint, &[c[0], c[1], self.order])
    }

    fn magnitude(&self, c: &[f64], _joints: usize, _reference: &[f64]) -> Vec<(String, f64)> {
        named(&[("amplitude_Nm", wave(c)), (PHASE, phase(c)), ("cycles_per_turn", self.order)])
    }

    fn scaled(&self, [a, _, _]: [f64; 3]) -> Ripple {
        Ripple { order: self.order * a, ..*self }
    }

    fn steps(&self) -> Vec<(usize, f64)> {
        vec![(0, 1.0 + 0.2 / self.order)]
    }

    fn order(&self) -> Option<f64> {
        Some(self.order)
    }

    fn bends_slowly(&self, range: &dyn Fn(usize) -> f64) -> bool {
        self.order * range(self.joint) <= POLICY.plausibility.max_law_cycles * TAU
    }
}
