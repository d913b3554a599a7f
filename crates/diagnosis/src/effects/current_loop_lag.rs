//! Torque follows its command as a first-order lag: the rate of the model's torque.

use rivet_dynamics::{EffectKind, KnownEffect};

use crate::effects::about::{About, CHIRP};
use crate::effects::carried::Carried;
use crate::effects::columns::{Full, between};
use crate::effects::effect_form::EffectForm;
use crate::effects::physics::Physics;
use crate::effects::size::named;
use crate::effects::variable::Variable;
use crate::effects::{Effect, Kind};
use crate::model::run::derivative;

/// Samples by which a command that stands for one is late on average.
pub(crate) const HOLD_DELAY_SAMPLES: f64 = 0.5;

pub(super) const ABOUT: About = About {
    variable: [Variable::TorqueRate; 2],
    motion: CHIRP,
    is_judged_in_motion: true,
    ..About::new("current_loop_lag", Kind::Structure)
};

/// Rate of the model's torque; half a sample later where a command `stands` for a sample. With the timing that is free
/// beside it this makes a second-order term, which is all that sets a lag apart from a delay
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Lag {
    pub(crate) stands: bool,
}

impl Lag {
    /// Time by which a command that stands for its sample is late beside a lag, in samples.
    pub(crate) fn hold_delay_samples(&self) -> f64 {
        if self.stands { HOLD_DELAY_SAMPLES } else { 0.0 }
    }

    /// The form of an effect of a robot file, and the factor of its column.
    pub(super) fn from_file(effect: &KnownEffect) -> (Lag, f64) {
        (Lag { stands: false }, effect.values[0])
    }
}

impl EffectForm for Lag {
    fn effect(&self) -> Effect {
        Effect::CurrentLoopLag
    }

    fn joints(&self) -> Vec<usize> {
        Vec::new()
    }

    fn columns(&self, p: &Physics<'_>) -> Vec<Full> {
        let late = self.hold_delay_samples();
        let rate = |tau: &Vec<f64>| {
            let rate = derivative(tau, p.period_s());
            Some((0..p.samples()).map(|k| between(&rate, k as f64 + late)).collect())
        };
        vec![p.torque.iter().map(rate).collect()]
    }

    fn carried(&self, c: &[f64], _x: &[f64], _joints: usize, _: Option<&[f64]>) -> (Carried, Vec<(usize, f64)>) {
        Carried::section(EffectKind::CurrentLoopLag, 0, c)
    }

    fn magnitude(&self, c: &[f64], _joints: usize, _reference: &[f64]) -> Vec<(String, f64)> {
        named(&[("time_constant_s", c[0]), ("bandwidth_hz", 1.0 / (std::f64::consts::TAU * c[0]))])
    }

    fn plausible(&self, c: &[f64]) -> bool {
        c[0] > 0.0
    }

    fn shifts_time(&self) -> bool {
        true
    }

    fn kind(&self) -> usize {
        usize::from(self.stands)
    }

    fn hides(&self) -> bool {
        true
    }
}
