//! Friction that differs between the two directions, and the constant torque that looks the same in motion.

use rivet_dynamics::{EffectKind, Places};

use crate::effects::about::{About, BOTH_DIRECTIONS};
use crate::effects::carried::Carried;
use crate::effects::columns::{Full, on};
use crate::effects::effect_form::EffectForm;
use crate::effects::physics::Physics;
use crate::effects::size::named;
use crate::effects::{Effect, Kind};
use crate::policy::POLICY;

/// The effect.
pub(crate) const EFFECT: Effect = Effect::FrictionAsymmetry;

pub(super) const ABOUT: About = About {
    motion: BOTH_DIRECTIONS,
    is_like_torque_zero: true,
    is_exact: true,
    ..About::friction("friction_asymmetry", Kind::Structure)
};

/// `|s|`, `|q̇|`
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Asymmetry {
    pub(crate) joint: usize,
}

impl EffectForm for Asymmetry {
    fn effect(&self) -> Effect {
        EFFECT
    }

    fn joints(&self) -> Vec<usize> {
        vec![self.joint]
    }

    fn coefficients(&self) -> usize {
        2
    }

    fn columns(&self, p: &Physics<'_>) -> Vec<Full> {
        let j = self.joint;
        vec![on(p, j, |k| p.sign[j][k].abs()), on(p, j, |k| p.motion.qd[j][k].abs())]
    }

    fn carried(&self, c: &[f64], _x: &[f64], _joints: usize, _: Option<&[f64]>) -> (Carried, Vec<(usize, f64)>) {
        Carried::section(EffectKind::FrictionAsymmetry, self.joint, c)
    }

    fn magnitude(&self, c: &[f64], _joints: usize, _reference: &[f64]) -> Vec<(String, f64)> {
        named(&[("coulomb_Nm", c[0]), ("viscous_Nms_rad", c[1])])
    }

    fn hides(&self) -> bool {
        true
    }
}

/// `s` while it is above 0, or below: friction of one direction
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct OneSided {
    pub(crate) joint: usize,
    pub(crate) forwards: bool,
}

impl EffectForm for OneSided {
    fn effect(&self) -> Effect {
        EFFECT
    }

    fn joints(&self) -> Vec<usize> {
        vec![self.joint]
    }

    fn columns(&self, p: &Physics<'_>) -> Vec<Full> {
        let s = &p.sign[self.joint];
        vec![if self.forwards { on(p, self.joint, |k| s[k].max(0.0)) } else { on(p, self.joint, |k| s[k].min(0.0)) }]
    }

    fn carried(&self, c: &[f64], _x: &[f64], joints: usize, _: Option<&[f64]>) -> (Carried, Vec<(usize, f64)>) {
        // Half of it is friction of both directions, half pushes one way.
        let push = if self.forwards { 0.5 } else { -0.5 } * c[0];
        let both = vec![(Places::new(joints).coulomb(self.joint), 0.5 * c[0])];
        Carried::section_with_values(EffectKind::FrictionAsymmetry, self.joint, &[push, 0.0], both)
    }

    fn magnitude(&self, c: &[f64], _joints: usize, _reference: &[f64]) -> Vec<(String, f64)> {
        named(&[(if self.forwards { "forwards_Nm" } else { "backwards_Nm" }, c[0])])
    }

    fn is_half_constant(&self) -> bool {
        true
    }

    fn least_replacement_gain(&self) -> f64 {
        POLICY.adoption.min_one_sided_gain
    }

    fn hides(&self) -> bool {
        true
    }
}

/// 1: a torque signal whose zero is off, at rest as in motion. No effect of the list; friction of one direction and laws of the angle
/// have to be better than this
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Constant {
    pub(crate) joint: usize,
}

impl EffectForm for Constant {
    fn effect(&self) -> Effect {
        // What a constant would be taken for.
        EFFECT
    }

    fn joints(&self) -> Vec<usize> {
        vec![self.joint]
    }

    fn columns(&self, p: &Physics<'_>) -> Vec<Full> {
        vec![on(p, self.joint, |_| 1.0)]
    }

    fn carried(&self, _c: &[f64], _x: &[f64], _joints: usize, _: Option<&[f64]>) -> (Carried, Vec<(usize, f64)>) {
        Carried::nothing("a constant torque is not in the list of effects")
    }

    fn magnitude(&self, c: &[f64], _joints: usize, _reference: &[f64]) -> Vec<(String, f64)> {
        named(&[("constant_Nm", c[0])])
    }

    fn is_nameless(&self) -> bool {
        true
    }

    fn is_torque_zero(&self) -> bool {
        true
    }

    fn kind(&self) -> usize {
        2
    }

    fn hides(&self) -> bool {
        true
    }
}
