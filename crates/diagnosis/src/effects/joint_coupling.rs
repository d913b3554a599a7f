//! A motor that turns with the sum of two joints: its friction on both, and its rotor.

use rivet_dynamics::{EffectKind, Parameter, Places, friction_sign};

use crate::effects::about::About;
use crate::effects::carried::Carried;
use crate::effects::columns::Full;
use crate::effects::effect_form::EffectForm;
use crate::effects::physics::Physics;
use crate::effects::size::named;
use crate::effects::variable::Variable;
use crate::effects::{Effect, Kind};

pub(super) const ABOUT: About = About {
    variable: [Variable::SumOfSpeeds; 2],
    motion: "each of the two joints alone at constant speed",
    ..About::new("joint_coupling", Kind::Structure)
};

/// A motor that turns with the sum of two joints: `s(q̇a+q̇b)` and `q̇a+q̇b` on both, `q̈` of the other; `whole`: of both,
/// where the rotors of the file are without it
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Coupling {
    pub(crate) driving: usize,
    pub(crate) driven: usize,
    pub(crate) whole: bool,
}

impl Coupling {
    /// The grid of a joint and the one before it.
    pub(super) fn grid(joint: usize) -> [Coupling; 2] {
        [false, true].map(|whole| Coupling { driving: joint - 1, driven: joint, whole })
    }
}

impl EffectForm for Coupling {
    fn effect(&self) -> Effect {
        Effect::JointCoupling
    }

    fn joints(&self) -> Vec<usize> {
        vec![self.driving, self.driven]
    }

    fn coefficients(&self) -> usize {
        3
    }

    fn columns(&self, p: &Physics<'_>) -> Vec<Full> {
        let Coupling { driving: a, driven: b, whole } = *self;
        let both = |f: &dyn Fn(usize) -> f64| -> Full {
            let mut full: Full = vec![None; p.joints()];
            let signal: Vec<f64> = (0..p.samples()).map(f).collect();
            full[a] = Some(signal.clone());
            full[b] = Some(signal);
            full
        };
        let v0 = p.nominal.model.structure.sign_velocity;
        let mut inertia: Full = vec![None; p.joints()];
        if whole {
            inertia = both(&|k| p.motion.qdd[a][k] + p.motion.qdd[b][k]);
        } else {
            inertia[a] = Some(p.motion.qdd[b].clone());
            inertia[b] = Some(p.motion.qdd[a].clone());
        }
        let sum = |k: usize| p.motion.qd[a][k] + p.motion.qd[b][k];
        vec![both(&|k| friction_sign(sum(k), v0)), both(&sum), inertia]
    }

    fn carried(&self, c: &[f64], _x: &[f64], joints: usize, _: Option<&[f64]>) -> (Carried, Vec<(usize, f64)>) {
        let rotors = if self.whole {
            [self.driving, self.driven].map(|j| (Places::new(joints).rotor_inertia(j), c[2])).to_vec()
        } else {
            Vec::new()
        };
        Carried::section_with_values(EffectKind::JointCoupling, self.driven, c, rotors)
    }

    fn magnitude(&self, c: &[f64], _joints: usize, _reference: &[f64]) -> Vec<(String, f64)> {
        named(&[("coulomb_Nm", c[0]), ("viscous_Nms_rad", c[1]), ("rotor_inertia_kgm2", c[2])])
    }

    fn plausible(&self, c: &[f64]) -> bool {
        c[0] > 0.0 && c[1] >= 0.0 && (!self.whole || c[2] > 0.0)
    }

    fn shares(&self, parameter: Parameter, _joints: usize) -> bool {
        matches!(parameter, Parameter::RotorInertia(j) if [self.driving, self.driven].contains(&j))
    }

    fn kind(&self) -> usize {
        usize::from(self.whole)
    }
}
