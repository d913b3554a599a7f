//! `[supervision]`: which directions of the parameter space may move.

use crate::reader::Reader;

/// `[supervision]`
#[derive(Clone, Debug, PartialEq)]
pub enum Supervision {
    /// Everything moves always.
    Off,
    /// Column norms, angles, trace and condition.
    Columns,
    /// Eigenvalues of the information.
    Eigen,
}

pub(crate) fn supervision(reader: &mut Reader<'_>) -> Supervision {
    match reader.text("supervision", "kind").as_str() {
        "off" => Supervision::Off,
        "eigen" => Supervision::Eigen,
        _ => Supervision::Columns,
    }
}
