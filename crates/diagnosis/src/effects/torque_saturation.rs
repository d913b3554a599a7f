//! Torque beyond a limit is not delivered: the measured torque beyond it.

use rivet_dynamics::EffectKind;

use crate::effects::about::About;
use crate::effects::carried::Carried;
use crate::effects::columns::{Full, on};
use crate::effects::effect_form::EffectForm;
use crate::effects::physics::Physics;
use crate::effects::size::named;
use crate::effects::variable::Variable;
use crate::effects::{Effect, Kind};
use crate::policy::POLICY;

/// Limits of torque, as a share of the largest that the model needs.
const LIMITS: [f64; 5] = [0.7, 0.8, 0.9, 0.95, 1.0];

/// The effect.
#[cfg(test)]
pub(crate) const EFFECT: Effect = Effect::TorqueSaturation;

pub(super) const ABOUT: About = About {
    variable: [Variable::MeasuredTorque; 2],
    cuts_command: true,
    ..About::new("torque_saturation", Kind::Structure)
};

/// Measured torque beyond the limit
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Saturation {
    pub(crate) joint: usize,
    /// \[N·m\]
    pub(crate) limit: f64,
}

impl Saturation {
    /// Limits at which a joint's torque may be cut, given what the model needs at most. A command that is beyond a limit nearly all the
    /// time moves no arm: torque that the model does not know is no cut.
    pub(super) fn grid(runs: &[Physics<'_>], joint: usize) -> Vec<Saturation> {
        let top = |signals: &dyn Fn(&Physics<'_>) -> Vec<f64>| {
            runs.iter().flat_map(signals).fold(0.0_f64, |m, t| m.max(t.abs()))
        };
        let (asked, needed) = (top(&|p| p.run.tau[joint].clone()), top(&|p| p.torque[joint].clone()));
        LIMITS
            .map(|share| Saturation { joint, limit: share * needed })
            .into_iter()
            .filter(|form| asked > POLICY.plausibility.min_command_over_limit * form.limit && form.is_observed(runs))
            .collect()
    }
}

impl EffectForm for Saturation {
    fn effect(&self) -> Effect {
        Effect::TorqueSaturation
    }

    fn joints(&self) -> Vec<usize> {
        vec![self.joint]
    }

    fn inner_values(&self) -> usize {
        1
    }

    fn columns(&self, p: &Physics<'_>) -> Vec<Full> {
        let (tau, limit) = (&p.run.tau[self.joint], self.limit);
        vec![on(p, self.joint, |k| tau[k] - tau[k].clamp(-limit, limit))]
    }

    fn carried(&self, _c: &[f64], _x: &[f64], _joints: usize, _: Option<&[f64]>) -> (Carried, Vec<(usize, f64)>) {
        Carried::section(EffectKind::TorqueSaturation, self.joint, &[self.limit])
    }

    fn magnitude(&self, _c: &[f64], _joints: usize, _reference: &[f64]) -> Vec<(String, f64)> {
        named(&[("limit_Nm", self.limit)])
    }

    fn plausible(&self, c: &[f64]) -> bool {
        (c[0] - 1.0).abs() < 0.1
    }

    fn scaled(&self, [a, _, _]: [f64; 3]) -> Saturation {
        Saturation { limit: self.limit * a, ..*self }
    }

    fn steps(&self) -> Vec<(usize, f64)> {
        vec![(0, 1.04)]
    }

    fn has_fixed_gain(&self) -> bool {
        true
    }

    fn is_smooth(&self) -> bool {
        true
    }

    /// Whether the limit cuts the command of the joint now and then while it moves, not for most of the time nor in single samples.
    fn is_observed(&self, runs: &[Physics<'_>]) -> bool {
        let signals = runs.iter().flat_map(|p| p.run.tau[self.joint].iter().zip(&p.motion.qd[self.joint]));
        let moving: Vec<f64> = signals
            .filter(|(_, qd)| qd.abs() > POLICY.signal_faults.max_still_speed_rad_s)
            .map(|(tau, _)| tau.abs())
            .collect();
        let beyond = |limit: f64| moving.iter().filter(|tau| **tau > limit).count() as f64 / moving.len().max(1) as f64;
        beyond(self.limit) < POLICY.plausibility.max_cut_time_share
            && beyond(POLICY.plausibility.min_command_over_limit * self.limit) > POLICY.plausibility.min_cut_time_share
    }

    fn is_predictable(&self) -> bool {
        false
    }
}
