//! The resolved configuration as text.

use crate::reader::Value;

/// A value as it would stand in the file.
pub(crate) fn value_text(value: &Value) -> String {
    match value {
        Value::Absent => "none".into(),
        Value::Number(x) => number_text(*x),
        Value::Integer(x) => format!("{x}"),
        Value::Bool(x) => format!("{x}"),
        Value::Text(x) => format!("{x:?}"),
        Value::Numbers(x) => format!("[{}]", x.iter().map(|x| number_text(*x)).collect::<Vec<_>>().join(", ")),
    }
}

/// Shortest text that reads back as the same number; exponents where zeros would hide it.
pub(crate) fn number_text(x: f64) -> String {
    if x != 0.0 && !(1e-3..1e7).contains(&x.abs()) { format!("{x:e}") } else { format!("{x:?}") }
}
