//! A log, what of it is used, and why not the rest.

use crate::evidence::Distrust;
use rivet_logs::Log;
use std::borrow::Cow;

/// A log without what no arm gives.
pub struct Sound<'a> {
    /// The log, angles unwrapped.
    pub log: Cow<'a, Log>,
    /// Rows that are not to be used, ascending.
    pub left_out: Vec<usize>,
    /// Share of the rows in motion at which positions repeated, per joint, where they were drawn anew for it.
    pub repeated: Option<Vec<f64>>,
    /// What was found.
    pub found: Vec<Distrust>,
}

impl Sound<'_> {
    /// What was found, as the reason why nothing is left.
    pub fn reason(&self) -> Option<String> {
        (!self.left_out.is_empty()).then(|| reason(&self.found))
    }
}

/// What was found, in one line.
pub(crate) fn reason(found: &[Distrust]) -> String {
    let reason_of = |d: &Distrust| format!("{}: {}", d.joint.as_deref().unwrap_or_default(), d.text);
    found.iter().map(reason_of).collect::<Vec<_>>().join("; ")
}
