//! A wrong torque constant: the joint's whole torque; and its cube, a motor that saturates.

use rivet_dynamics::EffectKind;

use crate::effects::about::About;
use crate::effects::carried::Carried;
use crate::effects::columns::{Full, on};
use crate::effects::effect_form::EffectForm;
use crate::effects::physical_bounds::Impossible;
use crate::effects::physics::Physics;
use crate::effects::size::named;
use crate::effects::variable::Variable;
use crate::effects::{Effect, Kind};
use crate::model::nominal::Nominal;
use crate::policy::POLICY;

pub(super) const ABOUT: About = About {
    variable: [Variable::ModelTorque; 2],
    motion: "a known mass at the flange, held at several poses",
    is_gain: true,
    is_exact: true,
    ..About::new("torque_constant", Kind::Value)
};

/// The joint's whole torque
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Gain {
    pub(crate) joint: usize,
}

impl EffectForm for Gain {
    fn effect(&self) -> Effect {
        Effect::TorqueConstant
    }

    fn joints(&self) -> Vec<usize> {
        vec![self.joint]
    }

    fn columns(&self, p: &Physics<'_>) -> Vec<Full> {
        vec![on(p, self.joint, |k| p.torque[self.joint][k])]
    }

    fn carried(&self, c: &[f64], _x: &[f64], _joints: usize, _: Option<&[f64]>) -> (Carried, Vec<(usize, f64)>) {
        Carried::section(EffectKind::TorqueConstant, self.joint, c)
    }

    fn magnitude(&self, c: &[f64], _joints: usize, _reference: &[f64]) -> Vec<(String, f64)> {
        // Measured torque over the model's: the drive delivers less than it reports when this is above 1.
        named(&[("gain", 1.0 / (1.0 + c[0]))])
    }

    fn plausible(&self, c: &[f64]) -> bool {
        // Less is what any data sheet is off by.
        (POLICY.plausibility.min_gain_error..0.5).contains(&c[0].abs())
    }

    fn impossible(&self, c: &[f64], nominal: &Nominal, _standard: &[f64]) -> Option<Impossible> {
        (1.0 + c[0] <= 0.0).then(|| {
            let name = format!("gain of {}", nominal.model.arm.joints[self.joint].name);
            Impossible { name, value: 1.0 / (1.0 + c[0]), unit: "" }
        })
    }

    fn is_gain(&self) -> bool {
        true
    }
}

/// `τ³`, τ the joint's whole torque: a motor that saturates, or a current that tells it ever less. No effect of the list; what
/// explains torque that depends on torque has to be better than this
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct TorqueLaw {
    pub(crate) joint: usize,
}

impl EffectForm for TorqueLaw {
    fn effect(&self) -> Effect {
        // What a law of the torque would be taken for.
        Effect::TorqueConstant
    }

    fn joints(&self) -> Vec<usize> {
        vec![self.joint]
    }

    fn columns(&self, p: &Physics<'_>) -> Vec<Full> {
        vec![on(p, self.joint, |k| p.torque[self.joint][k].powi(3))]
    }

    fn carried(&self, _c: &[f64], _x: &[f64], _joints: usize, _: Option<&[f64]>) -> (Carried, Vec<(usize, f64)>) {
        Carried::nothing("torque that is not proportional to its signal is not in the list of effects")
    }

    fn magnitude(&self, c: &[f64], _joints: usize, _reference: &[f64]) -> Vec<(String, f64)> {
        named(&[("cubic_per_Nm2", c[0])])
    }

    fn is_nameless(&self) -> bool {
        true
    }

    fn kind(&self) -> usize {
        2
    }
}
