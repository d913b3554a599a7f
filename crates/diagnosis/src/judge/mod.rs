//! Which causes the held-out log upholds, how large they are, and the verdict.

pub(crate) mod cause_sizes;
pub(crate) mod causes;
pub(crate) mod counterbalance_or_link;
pub(crate) mod fitted_steps;
pub(crate) mod load_change;
pub(crate) mod may_be_nothing;
pub(crate) mod mounting;
pub(crate) mod named_model;
pub(crate) mod open_joints;
pub(crate) mod other_arm;
pub(crate) mod procedure;
pub(crate) mod report_details;
pub(crate) mod shrinkage;
pub(crate) mod tool_drag;
pub(crate) mod torque_offset;
pub(crate) mod unseen_values;
