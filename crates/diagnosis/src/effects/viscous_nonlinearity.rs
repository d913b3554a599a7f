//! Friction that grows not in proportion to speed: `q̇`, `q̇|q̇|`, `q̇³`.

use rivet_dynamics::{EffectKind, Parameter, Places};

use crate::effects::about::{About, CONSTANT_SPEEDS};
use crate::effects::carried::Carried;
use crate::effects::columns::{Full, on};
use crate::effects::effect_form::EffectForm;
use crate::effects::physics::Physics;
use crate::effects::size::named;
use crate::effects::{Effect, Kind};

pub(super) const ABOUT: About =
    About { motion: CONSTANT_SPEEDS, ..About::friction("viscous_nonlinearity", Kind::Structure) };

/// `q̇`, `q̇|q̇|`, `q̇³`
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ViscousNonlinearity {
    pub(crate) joint: usize,
}

impl EffectForm for ViscousNonlinearity {
    fn effect(&self) -> Effect {
        Effect::ViscousNonlinearity
    }

    fn joints(&self) -> Vec<usize> {
        vec![self.joint]
    }

    fn coefficients(&self) -> usize {
        3
    }

    fn columns(&self, p: &Physics<'_>) -> Vec<Full> {
        let (j, v) = (self.joint, &p.motion.qd[self.joint]);
        // With the slope at rest: the value in the file is that of another curve.
        vec![on(p, j, |k| v[k]), on(p, j, |k| v[k] * v[k].abs()), on(p, j, |k| v[k].powi(3))]
    }

    fn carried(&self, c: &[f64], _x: &[f64], joints: usize, _: Option<&[f64]>) -> (Carried, Vec<(usize, f64)>) {
        let slope = vec![(Places::new(joints).viscous(self.joint), c[0])];
        Carried::section_with_values(EffectKind::ViscousNonlinearity, self.joint, &c[1..], slope)
    }

    fn magnitude(&self, c: &[f64], joints: usize, reference: &[f64]) -> Vec<(String, f64)> {
        named(&[
            ("linear_Nms_rad", reference[Places::new(joints).viscous(self.joint)] + c[0]),
            ("quadratic_Nms2_rad2", c[1]),
            ("cubic_Nms3_rad3", c[2]),
        ])
    }

    fn shares(&self, parameter: Parameter, _joints: usize) -> bool {
        matches!(parameter, Parameter::Viscous(j) if j == self.joint)
    }
}
