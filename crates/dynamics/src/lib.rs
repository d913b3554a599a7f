//! Dynamics of a serial arm, linear in its parameters: URDF, inverse dynamics, regressor, base parameters.
//!
//! Pure: no file, clock or bus. Everything is made once, from a URDF text; after that [`inverse_dynamics`],
//! [`mass_matrix`], [`regressor`], [`Model::regressor`], [`Model::energy`] and [`BaseSet::select`] only compute, without allocating.
//!
//! The order of parameters is stated in [`parameters`]; frames, signs and units beside each item.

mod arm;
mod base;
mod effect_torque;
mod effects;
mod energy;
mod hash;
mod lanes;
mod link;
mod mjcf;
mod model;
pub mod parameters;
mod pseudo_inertia;
mod rigid;
mod slip;
mod spatial;
mod urdf;
mod xml_limits;

pub use arm::{Arm, Joint, JointKind, MAX_JOINTS, flange_pose};
pub use base::{BaseError, BaseSet, RankGap};
pub use effects::{EffectKind, KnownEffect, KnownEffects, own_torque};
pub use hash::{Fnv, model_hash};
pub use link::{LINK_PARAMETERS, LinkParameters, body_from_com, body_in_frame};
pub use mjcf::{Mjcf, MjcfDrive, MjcfError, MjcfTendon};
pub use model::{Joints, Model, Structure, friction_sign};
pub use parameters::{Parameter, ParameterGroup, Places};
pub use pseudo_inertia::{body_from_pseudo_inertia, com_from_body, pseudo_inertia, smallest_eigenvalue};
pub use rigid::{State, Workspace, inverse_dynamics, mass_matrix, regressor};
pub use slip::{Slip, WristCoupling};
pub use urdf::{
    Proposal, UrdfArm, UrdfError, UrdfKey, UrdfMistake, UrdfMistakes, UrdfNote, UrdfOptions, WrittenUrdf, guess_bodies,
    toml_key, write_efforts, write_urdf,
};
pub use xml_limits::XmlExcess;
