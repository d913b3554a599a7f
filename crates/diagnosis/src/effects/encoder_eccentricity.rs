//! The encoder's reading varies once a turn: the angle is off by `cos q`, `sin q`; and a scale of the position.

use rivet_dynamics::EffectKind;

use crate::effects::about::About;
use crate::effects::carried::Carried;
use crate::effects::columns::{self, Full, scale};
use crate::effects::effect_form::EffectForm;
use crate::effects::physics::Physics;
use crate::effects::size::{PHASE, named, phase, wave};
use crate::effects::{Effect, Kind};

pub(super) const ABOUT: About = About::new("encoder_eccentricity", Kind::Structure);

/// Angle off by `cos q`, `sin q`
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Eccentricity {
    pub(crate) joint: usize,
}

impl EffectForm for Eccentricity {
    fn effect(&self) -> Effect {
        Effect::EncoderEccentricity
    }

    fn joints(&self) -> Vec<usize> {
        vec![self.joint]
    }

    fn coefficients(&self) -> usize {
        2
    }

    fn columns(&self, p: &Physics<'_>) -> Vec<Full> {
        columns::wave(p, self.joint, 1.0, true)
    }

    fn carried(&self, c: &[f64], _x: &[f64], _joints: usize, _: Option<&[f64]>) -> (Carried, Vec<(usize, f64)>) {
        Carried::section(EffectKind::EncoderEccentricity, self.joint, c)
    }

    fn magnitude(&self, c: &[f64], _joints: usize, _reference: &[f64]) -> Vec<(String, f64)> {
        named(&[("amplitude_rad", wave(c)), (PHASE, phase(c))])
    }

    fn plausible(&self, c: &[f64]) -> bool {
        c.iter().all(|c| c.abs() < 0.1)
    }
}

/// Angle off by `q`, 1: a gear ratio or the counts of an encoder. No effect of the list; over a part of a turn an eccentricity looks
/// like it
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct PositionScale {
    pub(crate) joint: usize,
}

impl EffectForm for PositionScale {
    fn effect(&self) -> Effect {
        // What a scale would be taken for.
        Effect::EncoderEccentricity
    }

    fn joints(&self) -> Vec<usize> {
        vec![self.joint]
    }

    fn coefficients(&self) -> usize {
        2
    }

    fn columns(&self, p: &Physics<'_>) -> Vec<Full> {
        scale(p, self.joint)
    }

    fn carried(&self, _c: &[f64], _x: &[f64], _joints: usize, _: Option<&[f64]>) -> (Carried, Vec<(usize, f64)>) {
        Carried::nothing("a scale of the position is not in the list of effects")
    }

    fn magnitude(&self, c: &[f64], _joints: usize, _reference: &[f64]) -> Vec<(String, f64)> {
        named(&[("position_gain", 1.0 + c[0])])
    }

    fn plausible(&self, c: &[f64]) -> bool {
        c.iter().all(|c| c.abs() < 0.3)
    }

    fn is_nameless(&self) -> bool {
        true
    }

    fn kind(&self) -> usize {
        2
    }
}
