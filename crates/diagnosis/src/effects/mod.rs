//! The effects that can be named: their columns, inner values, grids, bounds, reported sizes and separating motions.

pub(crate) mod base_candidates;
pub(crate) mod candidates;
pub(crate) mod effect;
pub(crate) mod form;
pub(crate) mod known;
pub(crate) mod motion_advice;
pub(crate) mod physical_bounds;
pub(crate) mod physics;
pub(crate) mod size;
pub(crate) mod two_mass;
pub(crate) mod warming;
pub(crate) mod warming_candidates;
