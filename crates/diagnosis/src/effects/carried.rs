//! What becomes of an adopted form in a robot file.

use rivet_dynamics::{EffectKind, KnownEffect};

/// What becomes of an adopted form in a robot file.
pub(crate) enum Carried {
    /// A section of its own.
    Effect(KnownEffect),
    /// Changes of standard parameters, by place.
    Values(Vec<(usize, f64)>),
    /// Change of gravity in base axes \[m/s²\].
    Gravity([f64; 3]),
    /// Nothing: why.
    Nothing(&'static str),
}

impl Carried {
    /// A section without values beside it.
    pub(super) fn section(kind: EffectKind, joint: usize, values: &[f64]) -> (Carried, Vec<(usize, f64)>) {
        Carried::section_with_values(kind, joint, values, Vec::new())
    }

    /// A section with changes of values beside it.
    pub(super) fn section_with_values(
        kind: EffectKind,
        joint: usize,
        values: &[f64],
        changes: Vec<(usize, f64)>,
    ) -> (Carried, Vec<(usize, f64)>) {
        (Carried::Effect(KnownEffect::new(kind, joint, values)), changes)
    }

    /// Changes of standard parameters alone.
    pub(super) fn values(changes: Vec<(usize, f64)>) -> (Carried, Vec<(usize, f64)>) {
        (Carried::Values(changes), Vec::new())
    }

    /// Nothing: why.
    pub(super) fn nothing(why: &'static str) -> (Carried, Vec<(usize, f64)>) {
        (Carried::Nothing(why), Vec::new())
    }
}
