//! What the numbers of a parameter vector mean: the one place where their order is stated.
//!
//! ```text
//! standard vector of a Model with N joints
//!   links 1..N        10 each, in the order of LinkParameters
//!   rotor_inertia     N
//!   viscous           N
//!   coulomb           N
//!   offset            N    only with Structure::offset
//!   load_friction     N    only with Structure::load_friction
//!   viscous_quadratic N    only with Structure::viscous_quadratic
//!   coupling          3    rotor_inertia, viscous, coulomb; only with Structure::coupling
//! ```

use std::ops::Range;

use crate::arm::{Arm, JointKind};
use crate::link::LINK_PARAMETERS;

/// Names of the entries of [`LinkParameters`].
const ENTRY_NAMES: [&str; LINK_PARAMETERS] = ["m", "mcx", "mcy", "mcz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz"];

/// One entry of a model's standard parameter vector. Indices count from 0; names count from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Parameter {
    /// Entry `entry` (0..10) of [`LinkParameters`] of the body moved by joint `link`.
    Link {
        /// Joint that moves the body.
        link: usize,
        /// Place in [`LinkParameters`].
        entry: usize,
    },
    /// Inertia of the joint's drive, seen at the joint (rotor inertia times ratio squared): `τ = Ia·q̈`.
    RotorInertia(usize),
    /// Viscous friction: `τ = Fv·q̇`.
    Viscous(usize),
    /// Coulomb friction: `τ = Fc·s(q̇)`.
    Coulomb(usize),
    /// Constant torque, e.g. of the amplifier's zero.
    Offset(usize),
    /// Coulomb friction per torque that the gear carries: `τ = kl·|τ_load|·s(q̇)`.
    LoadFriction(usize),
    /// Friction that bends away from the viscous line: `τ = Fq·q̇·|q̇|`, negative where it flattens with speed.
    ViscousQuadratic(usize),
    /// Drive inertia of the motor that turns with both coupled joints.
    CouplingInertia,
    /// Its viscous friction.
    CouplingViscous,
    /// Its Coulomb friction.
    CouplingCoulomb,
}

/// Places of the entries of a standard vector that every model has, whatever its structure.
///
/// ```
/// use rivet_dynamics::Places;
/// let of_two_joints = Places::new(2);
/// assert_eq!(Places::link(1), 10..20);
/// assert_eq!(of_two_joints.coulomb(0), 24);
/// assert_eq!(of_two_joints.offset(0), 26);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Places {
    joints: usize,
}

impl Places {
    /// Of models with so many joints.
    pub const fn new(joints: usize) -> Places {
        Places { joints }
    }

    /// Entries of the body that joint `link` moves, in the order of [`LinkParameters`](crate::LinkParameters).
    pub const fn link(link: usize) -> Range<usize> {
        link * LINK_PARAMETERS..(link + 1) * LINK_PARAMETERS
    }

    /// Entries of all bodies, from the base on.
    pub const fn bodies(self) -> Range<usize> {
        0..self.joints * LINK_PARAMETERS
    }

    /// [`Parameter::RotorInertia`] of a joint.
    pub const fn rotor_inertia(self, joint: usize) -> usize {
        self.of_drive(0, joint)
    }

    /// [`Parameter::Viscous`] of a joint.
    pub const fn viscous(self, joint: usize) -> usize {
        self.of_drive(1, joint)
    }

    /// [`Parameter::Coulomb`] of a joint.
    pub const fn coulomb(self, joint: usize) -> usize {
        self.of_drive(2, joint)
    }

    /// [`Parameter::Offset`] of a joint, in models with [`Structure::offset`](crate::Structure::offset): the first that not every model has.
    pub const fn offset(self, joint: usize) -> usize {
        self.of_drive(3, joint)
    }

    /// A group of one entry a joint behind the bodies.
    const fn of_drive(self, group: usize, joint: usize) -> usize {
        (LINK_PARAMETERS + group) * self.joints + joint
    }
}

/// Parameters that belong together in a report.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ParameterGroup {
    /// Mass, first moments and inertia of the links.
    Inertial,
    /// Drive inertia.
    RotorInertia,
    /// Viscous and Coulomb friction, with what load and speed add to them.
    Friction,
    /// Torque offsets.
    Offset,
    /// The wrist coupling.
    Coupling,
}

impl Parameter {
    /// Short stable name with 1-based numbers: `l2.mcx`, `j3.viscous`, `coupling.coulomb`.
    ///
    /// `arm` is the arm that the parameter belongs to; debug builds check that it has such a joint.
    pub fn name(&self, arm: &Arm) -> String {
        if let Some(joint) = self.joint() {
            debug_assert!(joint < arm.dof(), "{self:?} of an arm with {} joints", arm.dof());
        }
        match *self {
            Parameter::Link { link, entry } => format!("l{}.{}", link + 1, ENTRY_NAMES[entry]),
            Parameter::RotorInertia(j) => format!("j{}.rotor_inertia", j + 1),
            Parameter::Viscous(j) => format!("j{}.viscous", j + 1),
            Parameter::Coulomb(j) => format!("j{}.coulomb", j + 1),
            Parameter::Offset(j) => format!("j{}.offset", j + 1),
            Parameter::LoadFriction(j) => format!("j{}.load_friction", j + 1),
            Parameter::ViscousQuadratic(j) => format!("j{}.viscous_quadratic", j + 1),
            Parameter::CouplingInertia => "coupling.rotor_inertia".to_owned(),
            Parameter::CouplingViscous => "coupling.viscous".to_owned(),
            Parameter::CouplingCoulomb => "coupling.coulomb".to_owned(),
        }
    }

    /// Unit; a drive's unit depends on whether `arm`'s joint turns or slides. Coupled joints turn.
    pub fn unit(&self, arm: &Arm) -> &'static str {
        let slides = |j: usize| arm.joints.get(j).is_some_and(|joint| joint.kind == JointKind::Prismatic);
        match *self {
            Parameter::ViscousQuadratic(j) if slides(j) => "N s^2/m^2",
            Parameter::ViscousQuadratic(_) => "N m s^2/rad^2",
            Parameter::LoadFriction(_) => "-",
            Parameter::Link { entry: 0, .. } => "kg",
            Parameter::Link { entry: 1..=3, .. } => "kg m",
            Parameter::RotorInertia(j) if slides(j) => "kg",
            Parameter::Viscous(j) if slides(j) => "N s/m",
            Parameter::Coulomb(j) | Parameter::Offset(j) if slides(j) => "N",
            Parameter::Link { .. } | Parameter::RotorInertia(_) | Parameter::CouplingInertia => "kg m^2",
            Parameter::Viscous(_) | Parameter::CouplingViscous => "N m s/rad",
            Parameter::Coulomb(_) | Parameter::Offset(_) | Parameter::CouplingCoulomb => "N m",
        }
    }

    /// The group it is reported in.
    pub fn group(&self) -> ParameterGroup {
        match self {
            Parameter::Link { .. } => ParameterGroup::Inertial,
            Parameter::RotorInertia(_) => ParameterGroup::RotorInertia,
            Parameter::Viscous(_)
            | Parameter::Coulomb(_)
            | Parameter::LoadFriction(_)
            | Parameter::ViscousQuadratic(_) => ParameterGroup::Friction,
            Parameter::Offset(_) => ParameterGroup::Offset,
            Parameter::CouplingInertia | Parameter::CouplingViscous | Parameter::CouplingCoulomb => {
                ParameterGroup::Coupling
            }
        }
    }

    /// The joint (0-based) whose drive or whose link it describes; none for the coupling, which has two.
    pub fn joint(&self) -> Option<usize> {
        match *self {
            Parameter::Link { link: j, .. }
            | Parameter::RotorInertia(j)
            | Parameter::Viscous(j)
            | Parameter::Coulomb(j)
            | Parameter::Offset(j)
            | Parameter::LoadFriction(j)
            | Parameter::ViscousQuadratic(j) => Some(j),
            Parameter::CouplingInertia | Parameter::CouplingViscous | Parameter::CouplingCoulomb => None,
        }
    }
}
