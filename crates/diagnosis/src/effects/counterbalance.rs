//! A balancing spring or cylinder on a lever, or a weight: `sin q`, `cos q`.

use rivet_dynamics::EffectKind;

use crate::effects::about::{About, JOINT_POSES};
use crate::effects::carried::Carried;
use crate::effects::columns::{Full, on};
use crate::effects::effect_form::EffectForm;
use crate::effects::physics::Physics;
use crate::effects::size::{named, wave};
use crate::effects::{Effect, Kind};

/// Distance ratios of a counterbalance's two hinges.
const LEVERS: [f64; 2] = [0.3, 0.7];
/// Angles between them at zero.
const PHASES: usize = 6;

/// The effect.
pub(crate) const EFFECT: Effect = Effect::Counterbalance;

pub(super) const ABOUT: About =
    About { motion: JOINT_POSES, balances_gravity: true, ..About::new("counterbalance", Kind::Structure) };

/// Spring of free length l0 between points at distances 1 and `arm` from the axis, `phase` between them at q = 0
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Counterbalance {
    pub(crate) joint: usize,
    pub(crate) arm: f64,
    pub(crate) phase: f64,
}

impl Counterbalance {
    /// The grid of a joint.
    pub(super) fn grid(joint: usize) -> impl Iterator<Item = Counterbalance> {
        let phases = (0..PHASES).map(|step| std::f64::consts::TAU * step as f64 / PHASES as f64);
        LEVERS.into_iter().flat_map(move |arm| phases.clone().map(move |phase| Counterbalance { joint, arm, phase }))
    }
}

impl EffectForm for Counterbalance {
    fn effect(&self) -> Effect {
        EFFECT
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
        let Counterbalance { joint: j, arm, phase } = *self;
        let q = &p.motion.q[j];
        // Length l² = 1 + a² − 2a cos(q + φ); its derivative with respect to q times stretch: k (l − l0) a sin/l.
        let length = |k: usize| (1.0 + arm * arm - 2.0 * arm * (q[k] + phase).cos()).max(1e-9).sqrt();
        let lever = |k: usize| arm * (q[k] + phase).sin();
        vec![on(p, j, lever), on(p, j, |k| lever(k) / length(k))]
    }

    fn carried(&self, c: &[f64], _x: &[f64], _joints: usize, _: Option<&[f64]>) -> (Carried, Vec<(usize, f64)>) {
        Carried::section(EffectKind::Counterbalance, self.joint, &[c[0], c[1], self.arm, self.phase])
    }

    fn magnitude(&self, c: &[f64], _joints: usize, _reference: &[f64]) -> Vec<(String, f64)> {
        named(&[("lever_torque_Nm", c[0]), ("free_length_torque_Nm", c[1])])
    }

    // Lengths by factors, angles by steps: e to the first makes one radian.
    fn scaled(&self, [a, b, _]: [f64; 3]) -> Counterbalance {
        Counterbalance { arm: self.arm * a, phase: self.phase + b.ln(), ..*self }
    }

    fn steps(&self) -> Vec<(usize, f64)> {
        vec![(1, 1.3), (0, 1.3)]
    }

    fn of_angle_alone(&self) -> bool {
        true
    }

    fn hides(&self) -> bool {
        true
    }
}

/// A counterbalance by a weight, or by a spring without free length: `sin q`, `cos q`
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Counterweight {
    pub(crate) joint: usize,
}

impl EffectForm for Counterweight {
    fn effect(&self) -> Effect {
        EFFECT
    }

    fn joints(&self) -> Vec<usize> {
        vec![self.joint]
    }

    fn coefficients(&self) -> usize {
        2
    }

    fn columns(&self, p: &Physics<'_>) -> Vec<Full> {
        let (j, q) = (self.joint, &p.motion.q[self.joint]);
        vec![on(p, j, |k| q[k].sin()), on(p, j, |k| q[k].cos())]
    }

    fn carried(&self, c: &[f64], _x: &[f64], _joints: usize, _: Option<&[f64]>) -> (Carried, Vec<(usize, f64)>) {
        // Without free length the lever law is a sine, whatever the arm.
        let values = [2.0 * c[0].hypot(c[1]), 0.0, 0.5, c[1].atan2(c[0])];
        Carried::section(EffectKind::Counterbalance, self.joint, &values)
    }

    fn magnitude(&self, c: &[f64], _joints: usize, _reference: &[f64]) -> Vec<(String, f64)> {
        named(&[("torque_Nm", wave(c)), ("zero_at_rad", -c[1].atan2(c[0]))])
    }

    fn of_angle_alone(&self) -> bool {
        true
    }

    fn kind(&self) -> usize {
        1
    }

    fn hides(&self) -> bool {
        true
    }
}
