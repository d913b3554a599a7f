//! A gear that is a spring between motor and link; with a gap it is `backlash`.

use rivet_dynamics::{EffectKind, KnownEffect};

use crate::effects::about::{About, CHIRP};
use crate::effects::backlash;
use crate::effects::carried::Carried;
use crate::effects::columns::Full;
use crate::effects::effect_form::EffectForm;
use crate::effects::physics::Physics;
use crate::effects::two_mass::{self, Gear};
use crate::effects::variable::Variable;
use crate::effects::{Effect, Kind};
use crate::policy::POLICY;

/// First resonance with the motor held: lowest, highest \[Hz\] and steps between them.
const RESONANCES: (f64, f64, usize) = (2.5, 45.0, 24);
/// Damping ratio of the gear.
const DAMPINGS: [f64; 3] = [0.02, 0.08, 0.25];

/// The effect.
#[cfg(test)]
pub(crate) const EFFECT: Effect = Effect::JointElasticity;

pub(super) const ABOUT: About = About {
    variable: [Variable::Acceleration; 2],
    motion: CHIRP,
    is_inexact: true,
    ..About::new("joint_elasticity", Kind::Structure)
};

/// Motor and link are joined by a spring, or loosely
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct TwoMass {
    pub(crate) joint: usize,
    pub(crate) gear: Gear,
}

impl TwoMass {
    /// The grid of a joint before a link side of that inertia \[kg·m²\]: elastic gears, then gears with play.
    pub(super) fn grid(joint: usize, link: f64) -> impl Iterator<Item = TwoMass> {
        let stiffness = move |hz: f64| link * (std::f64::consts::TAU * hz).powi(2);
        let (low, high, steps) = RESONANCES;
        let elastic = (0..=steps).flat_map(move |step| {
            let hz = low * (high / low).powf(step as f64 / steps as f64);
            DAMPINGS.map(|damping| Gear { stiffness: stiffness(hz), damping, gap: 0.0 })
        });
        elastic.chain(backlash::gears(link)).map(move |gear| TwoMass { joint, gear })
    }

    /// The form of an effect of a robot file, and the factor of its column.
    pub(super) fn from_file(effect: &KnownEffect) -> (TwoMass, f64) {
        let [a, b, c, d] = effect.values;
        let (gear, factor) = if effect.kind == EffectKind::Backlash {
            (Gear { gap: a, stiffness: b, damping: c }, d)
        } else {
            (Gear { gap: 0.0, stiffness: a, damping: b }, c)
        };
        (TwoMass { joint: effect.joint, gear }, factor)
    }

    fn is_loose(&self) -> bool {
        self.gear.gap > 0.0
    }
}

impl EffectForm for TwoMass {
    fn effect(&self) -> Effect {
        if self.is_loose() { Effect::Backlash } else { Effect::JointElasticity }
    }

    fn joints(&self) -> Vec<usize> {
        vec![self.joint]
    }

    fn inner_values(&self) -> usize {
        2 + usize::from(self.is_loose())
    }

    fn columns(&self, p: &Physics<'_>) -> Vec<Full> {
        vec![two_mass::column(p, self.joint, self.gear)]
    }

    fn carried(&self, c: &[f64], _x: &[f64], _joints: usize, _: Option<&[f64]>) -> (Carried, Vec<(usize, f64)>) {
        let Gear { stiffness, damping, gap } = self.gear;
        if self.is_loose() {
            Carried::section(EffectKind::Backlash, self.joint, &[gap, stiffness, damping, c[0]])
        } else {
            Carried::section(EffectKind::JointElasticity, self.joint, &[stiffness, damping, c[0]])
        }
    }

    /// Stiffness of a gear, and its backlash where it has one.
    fn magnitude(&self, _c: &[f64], _joints: usize, _reference: &[f64]) -> Vec<(String, f64)> {
        let gap = self.is_loose().then(|| ("gap_rad".to_owned(), self.gear.gap));
        gap.into_iter().chain([("stiffness_Nm_rad".to_owned(), self.gear.stiffness)]).collect()
    }

    fn scaled(&self, [a, b, c]: [f64; 3]) -> TwoMass {
        let Gear { stiffness, damping, gap } = self.gear;
        TwoMass { gear: Gear { stiffness: stiffness * a, damping: damping * b, gap: gap * c }, ..*self }
    }

    fn steps(&self) -> Vec<(usize, f64)> {
        if self.is_loose() { backlash::STEPS.to_vec() } else { vec![(0, 1.13), (1, 1.6)] }
    }

    fn has_fixed_gain(&self) -> bool {
        true
    }

    fn least_coefficient(&self) -> Option<f64> {
        Some(1.0 - POLICY.adoption.max_gain_error)
    }
}
