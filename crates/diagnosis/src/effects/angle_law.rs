//! Laws of the angle that are no effect of the list: what explains torque over the angle has to be better than these.

use crate::effects::Effect;
use crate::effects::carried::Carried;
use crate::effects::columns::{Full, on};
use crate::effects::counterbalance;
use crate::effects::effect_form::EffectForm;
use crate::effects::physics::Physics;
use crate::effects::size::named;
use crate::policy::POLICY;

/// Parts of a joint's range at whose ends something may begin to pull.
const PULLS: usize = 5;
/// Angles over which a spring that softens gives way \[rad\].
const WIDTHS: [f64; 2] = [0.15, 0.4];

/// Angles within a joint's range at which something may begin \[rad\].
pub(super) fn beginnings((low, high): (f64, f64)) -> impl Iterator<Item = f64> {
    (1..PULLS).map(move |step| low + (high - low) * step as f64 / PULLS as f64)
}

/// Lowest and highest of some values.
pub(super) fn span<'a>(x: impl Iterator<Item = &'a f64>) -> (f64, f64) {
    x.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)))
}

/// A strap, hose or stop that pulls from one angle on: `x`, `x²`, x: how far `q` is above `from`, or below. No effect of
/// the list; what explains torque over the angle has to be better than this
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Pull {
    pub(crate) joint: usize,
    pub(crate) from: f64,
    pub(crate) above: bool,
}

impl Pull {
    /// The grid of a joint at one angle.
    pub(super) fn grid(joint: usize, from: f64) -> [Pull; 2] {
        [true, false].map(|above| Pull { joint, from, above })
    }
}

impl EffectForm for Pull {
    fn effect(&self) -> Effect {
        // What it would be taken for.
        counterbalance::EFFECT
    }

    fn joints(&self) -> Vec<usize> {
        vec![self.joint]
    }

    fn coefficients(&self) -> usize {
        2
    }

    fn inner_values(&self) -> usize {
        1
    }

    fn columns(&self, p: &Physics<'_>) -> Vec<Full> {
        let side = if self.above { 1.0 } else { -1.0 };
        let x = |k: usize| f64::max(side * (p.motion.q[self.joint][k] - self.from), 0.0);
        vec![on(p, self.joint, x), on(p, self.joint, |k| x(k).powi(2))]
    }

    fn carried(&self, _c: &[f64], _x: &[f64], _joints: usize, _: Option<&[f64]>) -> (Carried, Vec<(usize, f64)>) {
        Carried::nothing("a pull from one angle on is not in the list of effects")
    }

    fn magnitude(&self, c: &[f64], _joints: usize, _reference: &[f64]) -> Vec<(String, f64)> {
        named(&[("from_rad", self.from), ("rise_Nm_rad", c[0]), ("bend_Nm_rad2", c[1])])
    }

    fn scaled(&self, [a, _, _]: [f64; 3]) -> Pull {
        Pull { from: self.from + a.ln(), ..*self }
    }

    fn steps(&self) -> Vec<(usize, f64)> {
        vec![(0, 1.15)]
    }

    /// Whether the runs go far enough beyond the angle to show what pulls from there on.
    fn is_observed(&self, runs: &[Physics<'_>]) -> bool {
        let (low, high) = span(runs.iter().flat_map(|p| &p.motion.q[self.joint]));
        let beyond = if self.above { high - self.from } else { self.from - low };
        beyond >= POLICY.plausibility.min_pull_reach_share * (high - low)
    }

    fn bends_slowly(&self, _range: &dyn Fn(usize) -> f64) -> bool {
        true
    }

    fn is_nameless(&self) -> bool {
        true
    }

    fn kind(&self) -> usize {
        2
    }
}

/// `x`, `x²`, `x³`, 1, x: the angle less `about`, the middle of what was seen. Springs that harden and the like: no effect of
/// the list, as a pull
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct AngleLaw {
    pub(crate) joint: usize,
    pub(crate) about: f64,
}

impl EffectForm for AngleLaw {
    fn effect(&self) -> Effect {
        counterbalance::EFFECT
    }

    fn joints(&self) -> Vec<usize> {
        vec![self.joint]
    }

    fn coefficients(&self) -> usize {
        4
    }

    fn columns(&self, p: &Physics<'_>) -> Vec<Full> {
        let q = &p.motion.q[self.joint];
        (0..4).map(|power| on(p, self.joint, |k| (q[k] - self.about).powi([1, 2, 3, 0][power]))).collect()
    }

    fn carried(&self, _c: &[f64], _x: &[f64], _joints: usize, _: Option<&[f64]>) -> (Carried, Vec<(usize, f64)>) {
        Carried::nothing("another law of the angle is not in the list of effects")
    }

    fn magnitude(&self, c: &[f64], _joints: usize, _reference: &[f64]) -> Vec<(String, f64)> {
        named(&[("rise_Nm_rad", c[0]), ("bend_Nm_rad2", c[1]), ("hardening_Nm_rad3", c[2])])
    }

    fn bends_slowly(&self, _range: &dyn Fn(usize) -> f64) -> bool {
        true
    }

    fn is_nameless(&self) -> bool {
        true
    }

    fn kind(&self) -> usize {
        3
    }

    fn hides(&self) -> bool {
        true
    }
}

/// `tanh(x/w)`, 1, x: the angle less `about`, w: `width`. Springs that soften and what gives way at a force: no effect of the list
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Softening {
    pub(crate) joint: usize,
    pub(crate) about: f64,
    pub(crate) width: f64,
}

impl Softening {
    /// The grid of a joint at one angle.
    pub(super) fn grid(joint: usize, about: f64) -> [Softening; 2] {
        WIDTHS.map(|width| Softening { joint, about, width })
    }
}

impl EffectForm for Softening {
    fn effect(&self) -> Effect {
        counterbalance::EFFECT
    }

    fn joints(&self) -> Vec<usize> {
        vec![self.joint]
    }

    fn coefficients(&self) -> usize {
        2
    }

    fn inner_values(&self) -> usize {
        2
    }

    fn columns(&self, p: &Physics<'_>) -> Vec<Full> {
        let q = &p.motion.q[self.joint];
        vec![on(p, self.joint, |k| ((q[k] - self.about) / self.width).tanh()), on(p, self.joint, |_| 1.0)]
    }

    fn carried(&self, _c: &[f64], _x: &[f64], _joints: usize, _: Option<&[f64]>) -> (Carried, Vec<(usize, f64)>) {
        Carried::nothing("another law of the angle is not in the list of effects")
    }

    fn magnitude(&self, c: &[f64], _joints: usize, _reference: &[f64]) -> Vec<(String, f64)> {
        named(&[("most_Nm", c[0].abs()), ("rise_Nm_rad", c[0] / self.width)])
    }

    fn scaled(&self, [a, b, _]: [f64; 3]) -> Softening {
        Softening { about: self.about + a.ln(), width: self.width * b, ..*self }
    }

    fn steps(&self) -> Vec<(usize, f64)> {
        vec![(0, 1.15), (1, 1.3)]
    }

    fn bends_slowly(&self, _range: &dyn Fn(usize) -> f64) -> bool {
        true
    }

    fn is_nameless(&self) -> bool {
        true
    }

    fn kind(&self) -> usize {
        4
    }

    fn hides(&self) -> bool {
        true
    }
}
