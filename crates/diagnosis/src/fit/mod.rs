//! Bayesian linear regression of prepared runs, and the prediction of the held-out gap.

pub(crate) mod contact;
pub(crate) mod design;
pub(crate) mod evidence;
pub(crate) mod friction_ladder;
pub(crate) mod initial_friction;
pub(crate) mod motion_gap;
pub(crate) mod prediction;
pub(crate) mod products;
pub(crate) mod refinement;
pub(crate) mod search;
pub(crate) mod stages;
