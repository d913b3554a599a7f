//! Numerical tools that know nothing of arms: parallel maps, random signs, elimination of local columns, autocorrelation.

pub(crate) mod autocorrelation;
pub(crate) mod elimination;
pub(crate) mod parallel;
pub(crate) mod random;
