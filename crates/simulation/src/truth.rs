//! The arm as it really is: the nominal arm plus named disturbances.

use crate::random::Random;
use rivet_dynamics::{Arm, EffectKind, Joints, KnownEffect, Model, Structure, WristCoupling, body_from_com};

/// A body fixed to the last link: a steel ball, so that mass and centre say all.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Payload {
    /// Mass \[kg\].
    pub mass: f64,
    /// Its centre in the last joint's frame \[m\].
    pub com: [f64; 3],
}

/// What makes the true arm differ from the nominal one. The default changes nothing.
#[derive(Clone, Debug, PartialEq)]
pub struct Disturbances {
    /// Factor on mass, first moment and inertia of every body.
    pub bodies: f64,
    /// Factor on every rotor inertia.
    pub rotor_inertia: f64,
    /// Factor on every Coulomb and viscous friction value.
    pub friction: f64,
    /// Standard deviation of the logarithm of a further factor that each body draws for itself.
    pub bodies_spread: f64,
    /// The same for each rotor inertia.
    pub rotor_inertia_spread: f64,
    /// The same for each friction value.
    pub friction_spread: f64,
    /// Carried by the last link.
    pub payload: Option<Payload>,
    /// Decides the drawn factors.
    pub seed: u64,
}

impl Default for Disturbances {
    fn default() -> Self {
        Self {
            bodies: 1.0,
            rotor_inertia: 1.0,
            friction: 1.0,
            bodies_spread: 0.0,
            rotor_inertia_spread: 0.0,
            friction_spread: 0.0,
            payload: None,
            seed: 1,
        }
    }
}

/// Density of the payload \[kg/m³\].
const STEEL: f64 = 7850.0;

impl Payload {
    /// Its inertial parameters in the last joint's frame, in the order of `LinkParameters`.
    pub fn body(&self) -> [f64; 10] {
        let radius = (0.75 * self.mass.max(0.0) / (core::f64::consts::PI * STEEL)).cbrt();
        let i = 0.4 * self.mass * radius * radius;
        body_from_com(self.mass, &self.com, &[[i, 0.0, 0.0], [0.0, i, 0.0], [0.0, 0.0, i]])
    }
}

/// True values of all that the plant is made of.
#[derive(Clone, Debug)]
pub struct Truth {
    /// Geometry as in the nominal arm, bodies as they are.
    pub arm: Arm,
    /// Drive effects of the model (the plant has the wrist coupling when the model has it).
    pub structure: Structure,
    /// True drive values. An offset acts on the plant whether or not the model has a parameter for it.
    pub joints: Joints,
    /// Effects beside these. The plant has those that [`left_out`](Self::left_out) does not name.
    pub effects: Vec<KnownEffect>,
}

impl Truth {
    /// The nominal arm with `disturbances`.
    pub fn new(model: &Model, nominal: &Joints, disturbances: &Disturbances) -> Self {
        let mut random = Random::stream(disturbances.seed, 0x7a);
        let mut factor = |mean: f64, spread: f64| mean * (spread * random.normal()).exp();
        let (mut arm, mut joints) = (model.arm.clone(), nominal.clone());
        for body in &mut arm.links {
            // One factor a body: scaling all ten entries keeps any physical body physical.
            let f = factor(disturbances.bodies, disturbances.bodies_spread);
            for entry in body {
                *entry *= f;
            }
        }
        for value in &mut joints.rotor_inertia {
            *value *= factor(disturbances.rotor_inertia, disturbances.rotor_inertia_spread);
        }
        for value in joints.viscous.iter_mut().chain(&mut joints.coulomb) {
            *value *= factor(disturbances.friction, disturbances.friction_spread);
        }
        // The coupled motor is one machine: its friction and inertia take the plain factors, or the drive's dissipation
        // matrix (own and coupled entries) could lose its sign.
        joints.coupling[0] *= disturbances.rotor_inertia;
        joints.coupling[1] *= disturbances.friction;
        joints.coupling[2] *= disturbances.friction;
        joints.offset.resize(arm.dof(), 0.0);
        // The plant has friction laws of its own: neither of these.
        joints.load_friction = vec![0.0; arm.dof()];
        joints.viscous_quadratic = vec![0.0; arm.dof()];
        if let (Some(payload), Some(last)) = (disturbances.payload, arm.links.last_mut()) {
            for (entry, extra) in last.iter_mut().zip(payload.body()) {
                *entry += extra;
            }
        }
        let (mut structure, mut effects) = (model.structure, model.effects().list().to_vec());
        // A coupled motor is the plant's own, where it has none yet.
        let coupled = effects.iter().position(|e| e.kind == EffectKind::JointCoupling);
        if let (None, Some(at)) = (structure.coupling, coupled) {
            let KnownEffect { joint, values: [coulomb, viscous, inertia, _], .. } = effects.remove(at);
            structure.coupling = Some(WristCoupling { driving: joint - 1, driven: joint });
            joints.coupling = [inertia, viscous, coulomb];
            joints.viscous[joint - 1] += viscous;
            joints.viscous[joint] += viscous;
        }
        Self { arm, structure, joints, effects }
    }

    /// Effects that this plant cannot have, for people: which, where, why.
    pub fn left_out(&self) -> Vec<String> {
        let of = |effect: &KnownEffect| {
            let why = match effect.kind {
                EffectKind::TemperatureDependentFriction => "no motor warms up here",
                EffectKind::PreslidingFriction => "dry friction sticks hard here",
                EffectKind::Backlash | EffectKind::JointElasticity => "gears are rigid here",
                EffectKind::JointCoupling => "there is one coupled motor at most",
                EffectKind::BaseFlexibility => "the base stands here",
                _ => return None,
            };
            let joint = if effect.kind.is_global() { "all joints" } else { &self.arm.joints[effect.joint].name };
            Some(format!("[effects.{}] of {joint} is not simulated: {why}", effect.kind.name()))
        };
        self.effects.iter().filter_map(of).collect()
    }

    /// True values in the standard order of the model that this truth was made from.
    pub fn standard(&self, model: &Model) -> Vec<f64> {
        let mut joints = self.joints.clone();
        if let (None, Some(WristCoupling { driving, driven })) = (model.structure.coupling, self.structure.coupling) {
            // The model has no parameter for it: its effect stands beside.
            joints.viscous[driving] -= joints.coupling[1];
            joints.viscous[driven] -= joints.coupling[1];
        }
        Model::new(self.arm.clone(), model.structure).nominal(&joints)
    }
}
