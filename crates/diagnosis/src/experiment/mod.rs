//! Motions that separate effects which these logs confound.

pub(crate) mod separating_motion;
