//! What is handed on: values for files, the corrected model, and what each file format carries.

pub(crate) mod file_values;
pub(crate) mod formats;
pub(crate) mod patch;
pub(crate) mod torque_parts;
