//! A number that two processes compare before one believes the other's parameters.

use crate::arm::JointKind;
use crate::base::BaseSet;
use crate::model::Model;
use crate::parameters::Parameter;

/// FNV-1a, 64 bits (Fowler, Noll & Vo): small, and fixed for good, unlike the standard library's hasher. Says whether two
/// things are alike; no protection against who wants them to seem so.
#[derive(Clone, Copy, Debug)]
pub struct Fnv(u64);

impl Default for Fnv {
    fn default() -> Fnv {
        Fnv(0xcbf2_9ce4_8422_2325)
    }
}

impl Fnv {
    /// Takes in a word, its lowest byte first.
    pub fn word(&mut self, word: u64) {
        for byte in word.to_le_bytes() {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }

    /// What all words so far come to.
    #[must_use]
    pub fn value(self) -> u64 {
        self.0
    }

    /// Numbers count in steps of 1e-9, so that the last bits of a sine do not make two equal arms differ.
    fn numbers(&mut self, values: &[f64]) {
        for v in values {
            self.word((v * 1e9).round() as i64 as u64);
        }
    }
}

/// Hash of what the entries of a base vector MEAN: kinematics, gravity, structure and base columns. Parameter values,
/// names and limits have no part in it. Equal in any two processes, whatever the machine or build.
#[must_use]
pub fn model_hash(model: &Model, base: &BaseSet) -> u64 {
    let mut hash = Fnv::default();
    hash.word(model.arm.dof() as u64);
    hash.numbers(&model.arm.gravity);
    for joint in &model.arm.joints {
        hash.word(u64::from(joint.kind == JointKind::Prismatic));
        hash.numbers(&joint.axis);
        hash.numbers(joint.rotation.as_flattened());
        hash.numbers(&joint.translation);
    }
    let structure = &model.structure;
    hash.word(u64::from(structure.offset));
    hash.word(u64::from(structure.coupling.is_some()));
    if let Some(coupling) = structure.coupling {
        hash.word(coupling.driving as u64);
        hash.word(coupling.driven as u64);
    }
    hash.numbers(&[structure.sign_velocity]);
    // Only where they are used: models without them keep the hash they always had.
    if structure.presliding_travel > 0.0 {
        hash.word(1);
        hash.numbers(&[structure.presliding_travel]);
    }
    if structure.load_friction {
        hash.word(2);
        // What a URDF's digits may lose must not make two equal loads differ: steps of a millionth.
        hash.numbers(&model.load().as_flattened().iter().map(|x| x * 1e-3).collect::<Vec<f64>>());
    }
    for effect in model.effects().list() {
        hash.word(3);
        effect.kind.name().bytes().for_each(|byte| hash.word(u64::from(byte)));
        hash.word(effect.joint as u64);
        hash.numbers(&effect.values);
    }
    hash.word(base.len() as u64);
    for i in 0..base.len() {
        let (kind, at) = match base.parameter(model, i) {
            Parameter::Link { link, entry } => (0, link * crate::LINK_PARAMETERS + entry),
            Parameter::RotorInertia(j) => (1, j),
            Parameter::Viscous(j) => (2, j),
            Parameter::Coulomb(j) => (3, j),
            Parameter::Offset(j) => (4, j),
            Parameter::CouplingInertia => (5, 0),
            Parameter::CouplingViscous => (6, 0),
            Parameter::CouplingCoulomb => (7, 0),
            Parameter::LoadFriction(j) => (8, j),
            Parameter::ViscousQuadratic(j) => (9, j),
        };
        hash.word(kind);
        hash.word(at as u64);
    }
    hash.0
}
