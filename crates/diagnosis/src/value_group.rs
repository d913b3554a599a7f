//! Groups of the model's values that stand or fall together.

use crate::effect::Effect;
use crate::form::Form;

/// Parameters that stand or fall together.
#[derive(Clone, Debug)]
pub(crate) struct Group {
    pub(crate) effect: Effect,
    pub(crate) joint: usize,
    pub(crate) columns: Vec<usize>,
}

impl Group {
    /// The form that has the same torque, as far as one has.
    pub(crate) fn form(&self) -> Option<Form> {
        let joint = self.joint;
        match self.effect {
            Effect::LinkInertia => Some(Form::LinkScale { link: joint }),
            Effect::RotorInertia => Some(Form::RotorInertia { joint }),
            Effect::CoulombFriction => Some(Form::Coulomb { joint }),
            Effect::ViscousFriction => Some(Form::Viscous { joint }),
            Effect::LoadDependentFriction => Some(Form::Load { joint }),
            Effect::ViscousNonlinearity => Some(Form::ViscousNonlinearity { joint }),
            _ => None,
        }
    }
}
