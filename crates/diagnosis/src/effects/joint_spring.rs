//! A torque proportional to the joint's angle, as of a hose: `q`, 1; and a spring over two joints.

use std::f64::consts::TAU;

use rivet_dynamics::{EffectKind, Places};

use crate::effects::about::{About, JOINT_POSES};
use crate::effects::carried::Carried;
use crate::effects::columns::{Full, on};
use crate::effects::effect_form::EffectForm;
use crate::effects::physical_bounds::{Impossible, wrong_sign};
use crate::effects::physics::Physics;
use crate::effects::size::named;
use crate::effects::{Effect, Kind};
use crate::model::nominal::Nominal;
use crate::policy::POLICY;

pub(super) const ABOUT: About = About { motion: JOINT_POSES, ..About::new("joint_spring", Kind::Structure) };

/// `q`, 1: a spring rests anywhere
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Spring {
    pub(crate) joint: usize,
}

impl EffectForm for Spring {
    fn effect(&self) -> Effect {
        Effect::JointSpring
    }

    fn joints(&self) -> Vec<usize> {
        vec![self.joint]
    }

    fn coefficients(&self) -> usize {
        2
    }

    fn columns(&self, p: &Physics<'_>) -> Vec<Full> {
        let j = self.joint;
        vec![on(p, j, |k| p.motion.q[j][k]), on(p, j, |_| 1.0)]
    }

    fn carried(&self, c: &[f64], _x: &[f64], joints: usize, _: Option<&[f64]>) -> (Carried, Vec<(usize, f64)>) {
        let rest = vec![(Places::new(joints).offset(self.joint), c[1])];
        Carried::section_with_values(EffectKind::JointSpring, self.joint, &c[..1], rest)
    }

    fn magnitude(&self, c: &[f64], _joints: usize, _reference: &[f64]) -> Vec<(String, f64)> {
        named(&[("stiffness_Nm_rad", c[0]), ("rest_angle_rad", -c[1] / c[0])])
    }

    fn plausible(&self, c: &[f64]) -> bool {
        // At rest within a turn: further off it is a constant torque.
        c[0] > 0.0 && c[1].abs() < TAU * c[0]
    }

    fn impossible(&self, c: &[f64], nominal: &Nominal, _standard: &[f64]) -> Option<Impossible> {
        wrong_sign(self.plausible(c), self.joint, c, nominal)
    }

    fn of_angle_alone(&self) -> bool {
        true
    }

    fn hides(&self) -> bool {
        true
    }
}

/// A spring over two joints, or a hose along them: `x_a` on a, `x_b` on b, `x_b` on a with `x_a` on b, 1 on each. No effect of
/// the list: each joint by itself bends as no spring does
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct SpringBetween {
    pub(crate) joints: [usize; 2],
    pub(crate) about: [f64; 2],
}

impl EffectForm for SpringBetween {
    fn effect(&self) -> Effect {
        Effect::JointSpring
    }

    fn joints(&self) -> Vec<usize> {
        self.joints.to_vec()
    }

    fn coefficients(&self) -> usize {
        5
    }

    fn columns(&self, p: &Physics<'_>) -> Vec<Full> {
        let [a, b] = self.joints;
        let x = |i: usize, k: usize| p.motion.q[self.joints[i]][k] - self.about[i];
        let mut across = on(p, a, |k| x(1, k));
        across[b] = Some((0..p.samples()).map(|k| x(0, k)).collect());
        vec![on(p, a, |k| x(0, k)), on(p, b, |k| x(1, k)), across, on(p, a, |_| 1.0), on(p, b, |_| 1.0)]
    }

    fn carried(&self, _c: &[f64], _x: &[f64], _joints: usize, _: Option<&[f64]>) -> (Carried, Vec<(usize, f64)>) {
        Carried::nothing("a spring over two joints is not in the list of effects")
    }

    fn magnitude(&self, c: &[f64], _joints: usize, _reference: &[f64]) -> Vec<(String, f64)> {
        named(&[("first_Nm_rad", c[0]), ("second_Nm_rad", c[1]), ("between_Nm_rad", c[2])])
    }

    fn plausible(&self, c: &[f64]) -> bool {
        // Two springs on two joints have names.
        c[2].powi(2) > POLICY.plausibility.min_cross_stiffness_share * (c[0] * c[1]).abs()
    }

    fn is_nameless(&self) -> bool {
        true
    }

    fn hides(&self) -> bool {
        true
    }
}
