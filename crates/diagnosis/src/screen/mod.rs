//! From logged runs to prepared ones: faults of signals, channels and files, and rows with their noise floors.

pub(crate) mod arm_signals;
pub(crate) mod computed_torque;
pub(crate) mod input;
pub(crate) mod joint_zero;
pub(crate) mod log_check;
pub(crate) mod position_sign;
pub(crate) mod prepared;
pub(crate) mod rigid_torque;
pub(crate) mod signal_faults;
pub(crate) mod silent_channel;
pub(crate) mod swapped_torque;
pub(crate) mod torque_timing;
pub(crate) mod torque_unit;
