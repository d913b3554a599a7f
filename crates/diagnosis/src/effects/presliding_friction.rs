//! Presliding friction: a Dahl spring before sliding; and the hysteresis of a hose or cable in parallel to friction.

use rivet_dynamics::{EffectKind, KnownEffect, Places};

use crate::effects::about::About;
use crate::effects::carried::Carried;
use crate::effects::columns::{Full, on};
use crate::effects::effect_form::{EffectForm, SizeReference};
use crate::effects::physics::Physics;
use crate::effects::size::named;
use crate::effects::variable::Variable;
use crate::effects::{Effect, Kind};
use crate::policy::POLICY;

/// Lengths of presliding springs \[rad\].
const PRESLIDING: [f64; 6] = [3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 0.08];
/// Lengths of a hysteresis beside friction \[rad\].
const HYSTERESIS: [f64; 4] = [0.06, 0.15, 0.4, 1.0];

pub(super) const ABOUT: About = About {
    variable: [Variable::TravelSinceReversal; 2],
    motion: "tiny reversals, well below the length of the presliding spring",
    is_inexact: true,
    ..About::new("presliding_friction", Kind::Structure)
};

/// `F_c (z − s)`, z the state of a Dahl spring of the given length \[rad\]
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Presliding {
    pub(crate) joint: usize,
    pub(crate) length: f64,
}

impl Presliding {
    /// The grid of a joint.
    pub(super) fn grid(joint: usize) -> impl Iterator<Item = Presliding> {
        PRESLIDING.into_iter().map(move |length| Presliding { joint, length })
    }

    /// The form of an effect of a robot file, and the factor of its column; none where the joint has no Coulomb friction.
    pub(super) fn from_file(effect: &KnownEffect, x: &[f64], joints: usize) -> Option<(Presliding, f64)> {
        let [stiction, length, ..] = effect.values;
        let level = x[Places::new(joints).coulomb(effect.joint)].abs();
        (level > 0.0).then(|| (Presliding { joint: effect.joint, length }, stiction / level))
    }
}

impl EffectForm for Presliding {
    fn effect(&self) -> Effect {
        Effect::PreslidingFriction
    }

    fn joints(&self) -> Vec<usize> {
        vec![self.joint]
    }

    fn inner_values(&self) -> usize {
        1
    }

    fn columns(&self, p: &Physics<'_>) -> Vec<Full> {
        let j = self.joint;
        let level = p.x[p.coulomb(j)].abs();
        let z = dahl(&p.motion.q[j], self.length);
        vec![on(p, j, |k| level * (z[k] - p.sign[j][k]))]
    }

    fn carried(&self, c: &[f64], x: &[f64], joints: usize, _: Option<&[f64]>) -> (Carried, Vec<(usize, f64)>) {
        let level = x[Places::new(joints).coulomb(self.joint)].abs();
        Carried::section(EffectKind::PreslidingFriction, self.joint, &[c[0] * level, self.length])
    }

    fn magnitude(&self, c: &[f64], joints: usize, reference: &[f64]) -> Vec<(String, f64)> {
        let level = c[0] * reference[Places::new(joints).coulomb(self.joint)].abs();
        named(&[("length_rad", self.length), ("stiffness_Nm_rad", level / self.length)])
    }

    fn size_reference(&self) -> SizeReference {
        // Its level is that of its column.
        SizeReference::Column
    }

    // Made with its own size, so that 1 is meant; what is wanted at a fraction of it imitates something else.
    fn plausible(&self, c: &[f64]) -> bool {
        c[0] > 0.2
            && (POLICY.plausibility.min_bristle_travel_rad..POLICY.plausibility.max_bristle_travel_rad)
                .contains(&self.length)
    }

    fn scaled(&self, [a, _, _]: [f64; 3]) -> Presliding {
        Presliding { length: self.length * a, ..*self }
    }

    fn steps(&self) -> Vec<(usize, f64)> {
        vec![(0, 1.6)]
    }

    fn has_fixed_gain(&self) -> bool {
        true
    }

    fn is_like_smoothing(&self) -> bool {
        true
    }
}

/// `z`, `s`: the same state beside friction that sticks and slips as before, whose level may be another: what is dragged along, a hose
/// or a cable. No effect of the list
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Hysteresis {
    pub(crate) joint: usize,
    pub(crate) length: f64,
}

impl Hysteresis {
    /// The grid of a joint.
    pub(super) fn grid(joint: usize) -> impl Iterator<Item = Hysteresis> {
        HYSTERESIS.into_iter().map(move |length| Hysteresis { joint, length })
    }
}

impl EffectForm for Hysteresis {
    fn effect(&self) -> Effect {
        // What a longer hysteresis would be taken for.
        Effect::PreslidingFriction
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
        let j = self.joint;
        let z = dahl(&p.motion.q[j], self.length);
        vec![on(p, j, |k| z[k]), on(p, j, |k| p.sign[j][k])]
    }

    fn carried(&self, _c: &[f64], _x: &[f64], _joints: usize, _: Option<&[f64]>) -> (Carried, Vec<(usize, f64)>) {
        Carried::nothing("hysteresis in parallel to friction is not in the list of effects")
    }

    fn magnitude(&self, c: &[f64], _joints: usize, _reference: &[f64]) -> Vec<(String, f64)> {
        named(&[("hysteresis_Nm", c[0]), ("length_rad", self.length)])
    }

    fn plausible(&self, c: &[f64]) -> bool {
        c[0] > 0.0 && self.length >= POLICY.plausibility.min_bristle_travel_rad
    }

    fn scaled(&self, [a, _, _]: [f64; 3]) -> Hysteresis {
        Hysteresis { length: self.length * a, ..*self }
    }

    fn steps(&self) -> Vec<(usize, f64)> {
        vec![(0, 1.6)]
    }

    fn is_nameless(&self) -> bool {
        true
    }

    fn kind(&self) -> usize {
        2
    }
}

/// State of Dahl's spring in units of the sliding friction: `dz = (dq − |dq| z)/length`, exact for each step.
fn dahl(q: &[f64], length: f64) -> Vec<f64> {
    let mut z = 0.0;
    let mut before = q.first().copied().unwrap_or(0.0);
    q.iter()
        .map(|now| {
            let dq = now - before;
            before = *now;
            let to = dq.signum();
            if dq != 0.0 {
                z = to + (z - to) * (-dq.abs() / length).exp();
            }
            z
        })
        .collect()
}
