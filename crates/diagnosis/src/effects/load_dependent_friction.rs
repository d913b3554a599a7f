//! Friction that grows with the torque that the gear carries: `s·|τ_rigid|`.

use rivet_dynamics::EffectKind;

use crate::effects::about::About;
use crate::effects::carried::Carried;
use crate::effects::columns::{Full, on};
use crate::effects::effect_form::EffectForm;
use crate::effects::physical_bounds::{Impossible, wrong_sign};
use crate::effects::physics::Physics;
use crate::effects::size::named;
use crate::effects::variable::Variable;
use crate::effects::{Effect, Kind};
use crate::model::nominal::Nominal;

pub(super) const ABOUT: About = About {
    variable: [Variable::Load; 2],
    motion: "the same pose reached slowly from both sides, with two payloads",
    grows_with_load: true,
    ..About::new("load_dependent_friction", Kind::Structure)
};

/// `s·|τ_rigid|`
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Load {
    pub(crate) joint: usize,
}

impl EffectForm for Load {
    fn effect(&self) -> Effect {
        Effect::LoadDependentFriction
    }

    fn joints(&self) -> Vec<usize> {
        vec![self.joint]
    }

    fn columns(&self, p: &Physics<'_>) -> Vec<Full> {
        let j = self.joint;
        vec![on(p, j, |k| p.sign[j][k] * p.rigid[j][k].abs())]
    }

    fn carried(&self, c: &[f64], _x: &[f64], _joints: usize, _: Option<&[f64]>) -> (Carried, Vec<(usize, f64)>) {
        Carried::section(EffectKind::LoadDependentFriction, self.joint, c)
    }

    fn magnitude(&self, c: &[f64], _joints: usize, _reference: &[f64]) -> Vec<(String, f64)> {
        named(&[("ratio", c[0])])
    }

    fn plausible(&self, c: &[f64]) -> bool {
        c[0] > 0.0
    }

    fn impossible(&self, c: &[f64], nominal: &Nominal, _standard: &[f64]) -> Option<Impossible> {
        wrong_sign(self.plausible(c), self.joint, c, nominal)
    }
}
