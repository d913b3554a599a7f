//! Numbers as text.

/// Up to five digits.
pub(crate) fn short(x: f64) -> String {
    if !x.is_finite() {
        return if x > 0.0 { "none".into() } else { "-none".into() };
    }
    let text = format!("{x:.4}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" || text.is_empty() { "0".into() } else { text.to_owned() }
}

/// Shortest text that reads back as the same number; exponents where zeros would hide it.
pub(crate) fn number_text(x: f64) -> String {
    if x != 0.0 && !(1e-3..1e7).contains(&x.abs()) { format!("{x:e}") } else { format!("{x:?}") }
}
