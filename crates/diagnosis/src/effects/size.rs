//! Helpers of reported sizes: names with units, and waves.

/// Name of the phase of a wave.
pub(super) const PHASE: &str = "phase_rad";

/// Sizes by name with unit.
pub(super) fn named(pairs: &[(&str, f64)]) -> Vec<(String, f64)> {
    pairs.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect()
}

/// Amplitude of a wave from its cosine and sine.
pub(super) fn wave(c: &[f64]) -> f64 {
    c[0].hypot(c[1])
}

/// Of `amplitude·cos(order·q − phase)`.
pub(super) fn phase(c: &[f64]) -> f64 {
    c[1].atan2(c[0])
}
