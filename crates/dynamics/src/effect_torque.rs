//! Torque of the known effects beside that of the regressor.

use crate::MAX_JOINTS;
use crate::effects::{EffectKind, KnownEffect, displacement, own_torque};
use crate::model::{Model, friction_sign};
use crate::rigid::{Workspace, inverse_dynamics};

impl Model {
    /// Effects that estimator and controller leave out, for people: which, where, why.
    pub fn effects_left_out(&self) -> Vec<String> {
        let left_out = |effect: &KnownEffect| {
            // What is not delivered is cut from reported torque and from what may be commanded.
            let why = effect.kind.not_instant().filter(|_| effect.kind != EffectKind::TorqueSaturation)?;
            let joint = if effect.kind.is_global() { "all joints" } else { &self.arm.joints[effect.joint].name };
            Some(format!("[effects.{}] of {joint} is left out: {why}", effect.kind.name()))
        };
        self.effects().list().iter().filter_map(left_out).collect()
    }

    /// Adds the torque of all known effects that follow from one instant to that of the regressor: `tau` \[N·m\] becomes
    /// what the drives report. Real-time safe.
    pub fn add_effects(&self, ws: &mut Workspace, q: &[f64], qd: &[f64], qdd: &[f64], tau: &mut [f64]) {
        if self.effects().is_empty() {
            return;
        }
        let [torques, _] = self.effect_torque(ws, q, qd, qdd);
        tau.iter_mut().zip(torques).for_each(|(tau, torque)| *tau += torque);
        self.scale_by_constants(tau);
    }

    /// The same in two parts \[N·m\]: what of it is friction is added to `friction`, what is left to `rest`. Real-time safe.
    pub fn add_effects_apart(
        &self,
        ws: &mut Workspace,
        [q, qd, qdd]: [&[f64]; 3],
        friction: &mut [f64],
        rest: &mut [f64],
    ) {
        if self.effects().is_empty() {
            return;
        }
        let [torques, of_friction] = self.effect_torque(ws, q, qd, qdd);
        for (j, (friction, rest)) in friction.iter_mut().zip(rest.iter_mut()).enumerate() {
            *friction += of_friction[j];
            *rest += torques[j] - of_friction[j];
        }
        self.scale_by_constants(friction);
        self.scale_by_constants(rest);
    }

    /// Torque of the joints as the drives report it, by their torque constants.
    fn scale_by_constants(&self, tau: &mut [f64]) {
        for effect in self.effects().list() {
            if effect.kind == EffectKind::TorqueConstant {
                tau[effect.joint] *= 1.0 + effect.values[0];
            }
        }
    }

    /// Takes them from reported torque: `tau` \[N·m\] becomes what the regressor explains. Reported torque beyond a limit
    /// of delivery is cut. Real-time safe.
    pub fn take_effects(&self, ws: &mut Workspace, q: &[f64], qd: &[f64], qdd: &[f64], tau: &mut [f64]) {
        if self.effects().is_empty() {
            return;
        }
        // The drive cuts what it reports, and gives that by its true constant: in this order, whatever the list's.
        for (kind, cut) in [(EffectKind::TorqueSaturation, true), (EffectKind::TorqueConstant, false)] {
            for effect in self.effects().list().iter().filter(|effect| effect.kind == kind) {
                let (size, tau) = (effect.values[0], &mut tau[effect.joint]);
                *tau = if cut { tau.max(-size).min(size) } else { *tau / (1.0 + size) };
            }
        }
        let [torques, _] = self.effect_torque(ws, q, qd, qdd);
        tau.iter_mut().zip(torques).for_each(|(tau, torque)| *tau -= torque);
    }

    /// Torque of the effects beside the regressor's, torque constants left out; and what of it is friction.
    fn effect_torque(&self, ws: &mut Workspace, q: &[f64], qd: &[f64], qdd: &[f64]) -> [[f64; MAX_JOINTS]; 2] {
        let (effects, n, v0) = (self.effects(), self.arm.dof(), self.structure.sign_velocity);
        let [mut out, mut friction] = [[0.0; MAX_JOINTS]; 2];
        let mut carried = [0.0; MAX_JOINTS];
        if effects.loads || effects.displaces {
            inverse_dynamics(&self.arm, &self.arm.links, ws, q, qd, qdd, &mut carried[..n]);
        }
        if effects.displaces {
            let [mut at, mut speed, mut accel] = [[0.0; MAX_JOINTS]; 3];
            let mut ratio = [1.0; MAX_JOINTS];
            at[..n].copy_from_slice(q);
            speed[..n].copy_from_slice(qd);
            accel[..n].copy_from_slice(qdd);
            for effect in &effects.list {
                let j = effect.joint;
                let [d, v, a] = displacement(effect, q[j], qd[j], qdd[j]);
                at[j] += d;
                speed[j] += v;
                accel[j] += a;
                ratio[j] += effect.ratio_error(q[j]);
                if effect.kind == EffectKind::EncoderEccentricity {
                    out[j] += effects.rotor_inertia[j] * a + effects.viscous[j] * v;
                }
            }
            let mut moved = [0.0; MAX_JOINTS];
            inverse_dynamics(&self.arm, &self.arm.links, ws, &at[..n], &speed[..n], &accel[..n], &mut moved[..n]);
            for j in 0..n {
                out[j] += ratio[j] * moved[j] - carried[j];
            }
        }
        for effect in &effects.list {
            let j = effect.joint;
            if effect.kind == EffectKind::JointCoupling && j > 0 {
                let ([coulomb, viscous, inertia, _], i) = (effect.values, j - 1);
                let v = qd[i] + qd[j];
                let both = coulomb * friction_sign(v, v0) + viscous * v;
                out[i] += both + inertia * qdd[j];
                out[j] += both + inertia * qdd[i];
                friction[i] += both;
                friction[j] += both;
            } else {
                let torque = own_torque(effect, friction_sign(qd[j], v0), carried[j], q[j], qd[j]);
                out[j] += torque;
                friction[j] += if effect.kind.is_friction() { torque } else { 0.0 };
            }
        }
        [out, friction]
    }
}
