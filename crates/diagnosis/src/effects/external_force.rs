//! Contact: a force at the flange in stretches of time, and a moment. Its columns are made by `fit/contact.rs`.

use crate::effects::about::About;
use crate::effects::carried::Carried;
use crate::effects::columns::Full;
use crate::effects::effect_form::EffectForm;
use crate::effects::physics::Physics;
use crate::effects::variable::Variable;
use crate::effects::{Effect, Kind};

/// The effect.
#[cfg(test)]
pub(crate) const EFFECT: Effect = Effect::ExternalForce;

pub(super) const ABOUT: About = About {
    variable: [Variable::Time; 2],
    is_intermittent: true,
    is_inexact: true,
    ..About::new("external_force", Kind::Structure)
};

/// A force at the flange in stretches of time, by run, and a moment about it where something may touch the last link elsewhere: base
/// axes times hats over time
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Force {
    /// From and to \[s\], by run.
    pub(crate) windows: Vec<Vec<(f64, f64)>>,
    pub(crate) moment: bool,
}

/// Components of a force, and of a force with a moment.
pub(crate) fn force_components(moment: bool) -> usize {
    if moment { 6 } else { 3 }
}

impl Force {
    /// Whether the joints of an arm show all components: with fewer joints than numbers, one of the six stands for another.
    pub(crate) fn has_size(&self, joints: usize) -> bool {
        !self.moment || joints >= force_components(true)
    }
}

impl EffectForm for Force {
    fn effect(&self) -> Effect {
        Effect::ExternalForce
    }

    fn joints(&self) -> Vec<usize> {
        Vec::new()
    }

    fn coefficients(&self) -> usize {
        0
    }

    fn columns(&self, _p: &Physics<'_>) -> Vec<Full> {
        // Columns of their own: see contact.
        Vec::new()
    }

    fn carried(&self, _c: &[f64], _x: &[f64], _joints: usize, _: Option<&[f64]>) -> (Carried, Vec<(usize, f64)>) {
        Carried::nothing("contact is not a property of the arm")
    }

    /// Largest force, and moment.
    fn magnitude(&self, c: &[f64], joints: usize, _reference: &[f64]) -> Vec<(String, f64)> {
        if !self.has_size(joints) {
            return Vec::new();
        }
        let length = |c: &[f64]| c.iter().map(|x| x * x).sum::<f64>().sqrt();
        let hats = || c.chunks(force_components(self.moment));
        let mut size = vec![("largest_N".to_owned(), hats().map(|c| length(&c[..3])).fold(0.0, f64::max))];
        if self.moment {
            size.push(("largest_Nm".to_owned(), hats().map(|c| length(&c[3..])).fold(0.0, f64::max)));
        }
        size
    }

    fn has_stretches(&self) -> bool {
        true
    }

    fn kind(&self) -> usize {
        usize::from(self.moment)
    }

    fn is_predictable(&self) -> bool {
        false
    }
}
