//! The figures of a diagnosis: the gap by joint, regime and stage, curves, residual tests.

pub(crate) mod curves;
pub(crate) mod details;
pub(crate) mod diagnosis;
pub(crate) mod regimes;
pub(crate) mod repeatability;
pub(crate) mod residual_tests;
pub(crate) mod shapley;
pub(crate) mod views;
