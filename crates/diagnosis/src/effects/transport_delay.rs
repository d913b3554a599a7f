//! Torque acts a fixed time after it was commanded: the model's torque so much later, less itself.

use rivet_dynamics::{EffectKind, KnownEffect};

use crate::effects::about::{About, CHIRP};
use crate::effects::carried::Carried;
use crate::effects::columns::{Full, between};
use crate::effects::effect_form::EffectForm;
use crate::effects::physics::{Physics, SMEARED_S};
use crate::effects::size::named;
use crate::effects::variable::Variable;
use crate::effects::{Effect, Kind};
use crate::policy::POLICY;

/// Delays \[s\].
const DELAYS: [f64; 8] = [0.001, 0.0015, 0.002, 0.003, 0.004, 0.006, 0.009, 0.014];

pub(super) const ABOUT: About = About {
    variable: [Variable::TorqueRate; 2],
    motion: CHIRP,
    is_judged_in_motion: true,
    is_inexact: true,
    ..About::new("transport_delay", Kind::Structure)
};

/// The model's torque so much later, less itself
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Delay {
    pub(crate) seconds: f64,
}

impl Delay {
    /// The grid.
    pub(super) fn grid() -> impl Iterator<Item = Delay> {
        DELAYS.into_iter().map(|seconds| Delay { seconds })
    }

    /// The form of an effect of a robot file, and the factor of its column.
    pub(super) fn from_file(effect: &KnownEffect) -> (Delay, f64) {
        (Delay { seconds: effect.values[0] }, 1.0)
    }
}

impl EffectForm for Delay {
    fn effect(&self) -> Effect {
        Effect::TransportDelay
    }

    fn joints(&self) -> Vec<usize> {
        Vec::new()
    }

    fn inner_values(&self) -> usize {
        1
    }

    fn columns(&self, p: &Physics<'_>) -> Vec<Full> {
        let shift = self.seconds / p.period_s();
        let later = |tau: &Vec<f64>| -> Option<Vec<f64>> {
            Some((0..p.samples()).map(|k| between(tau, k as f64 + shift) - tau[k]).collect())
        };
        vec![p.torque.iter().map(later).collect()]
    }

    fn carried(&self, c: &[f64], _x: &[f64], _joints: usize, _: Option<&[f64]>) -> (Carried, Vec<(usize, f64)>) {
        Carried::section(EffectKind::TransportDelay, 0, &[self.seconds * c[0]])
    }

    fn magnitude(&self, c: &[f64], _joints: usize, _reference: &[f64]) -> Vec<(String, f64)> {
        named(&[("seconds", self.seconds * c[0])])
    }

    // Made with its own size, so that 1 is meant; what is wanted at a fraction of it imitates something else.
    // Less than stops are smeared by is no delay where friction sticks; true ones were 3.2 ms and more.
    fn plausible(&self, c: &[f64]) -> bool {
        (0.5..2.0).contains(&c[0]) && c[0] * self.seconds > SMEARED_S
    }

    fn scaled(&self, [a, _, _]: [f64; 3]) -> Delay {
        Delay { seconds: self.seconds * a }
    }

    fn steps(&self) -> Vec<(usize, f64)> {
        vec![(0, 1.3)]
    }

    fn has_fixed_gain(&self) -> bool {
        true
    }

    fn least_coefficient(&self) -> Option<f64> {
        Some(POLICY.adoption.min_delay_coefficient)
    }

    fn shifts_time(&self) -> bool {
        true
    }

    fn is_like_smoothing(&self) -> bool {
        true
    }

    fn hides(&self) -> bool {
        true
    }
}
