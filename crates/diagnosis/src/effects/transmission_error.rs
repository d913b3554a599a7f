//! The gear's output angle varies about its input's: the link's angle is off by `cos(cq)`, `sin(cq)`.

use rivet_dynamics::EffectKind;

use crate::effects::about::{About, SLOW_SPEEDS};
use crate::effects::carried::Carried;
use crate::effects::columns::{self, Full};
use crate::effects::effect_form::EffectForm;
use crate::effects::physics::Physics;
use crate::effects::size::{PHASE, named, phase, wave};
use crate::effects::variable::Variable;
use crate::effects::{Effect, Kind};

pub(super) const ABOUT: About =
    About { variable: [Variable::Phase; 2], motion: SLOW_SPEEDS, ..About::new("transmission_error", Kind::Structure) };

/// The link's angle is off by `cos(cq)`, `sin(cq)`
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct TransmissionError {
    pub(crate) joint: usize,
    /// c, cycles per turn.
    pub(crate) order: f64,
}

impl EffectForm for TransmissionError {
    fn effect(&self) -> Effect {
        Effect::TransmissionError
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
        columns::wave(p, self.joint, self.order, false)
    }

    fn carried(&self, c: &[f64], _x: &[f64], _joints: usize, _: Option<&[f64]>) -> (Carried, Vec<(usize, f64)>) {
        Carried::section(EffectKind::TransmissionError, self.joint, &[c[0], c[1], self.order])
    }

    fn magnitude(&self, c: &[f64], _joints: usize, _reference: &[f64]) -> Vec<(String, f64)> {
        named(&[("amplitude_rad", wave(c)), (PHASE, phase(c)), ("cycles_per_turn", self.order)])
    }

    fn plausible(&self, c: &[f64]) -> bool {
        c.iter().all(|c| c.abs() < 0.1)
    }

    fn scaled(&self, [a, _, _]: [f64; 3]) -> TransmissionError {
        TransmissionError { order: self.order * a, ..*self }
    }

    fn steps(&self) -> Vec<(usize, f64)> {
        vec![(0, 1.0 + 0.2 / self.order)]
    }

    fn order(&self) -> Option<f64> {
        Some(self.order)
    }
}
