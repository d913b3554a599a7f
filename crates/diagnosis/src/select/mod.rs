//! Forward selection of effects by evidence, their rivals, and which values of the model are wrong.

pub(crate) mod adopted;
pub(crate) mod angle_law;
pub(crate) mod angle_orders;
pub(crate) mod base_support;
pub(crate) mod confounded_values;
pub(crate) mod contact_bursts;
pub(crate) mod delay_or_lag;
pub(crate) mod detection_power;
pub(crate) mod equivalence_class;
pub(crate) mod flange_body;
pub(crate) mod forward;
pub(crate) mod hysteresis;
pub(crate) mod inner_ends;
pub(crate) mod reselection;
pub(crate) mod residual;
pub(crate) mod sign_flips;
pub(crate) mod value_group;
pub(crate) mod values;
