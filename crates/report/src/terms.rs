//! Terms of the contract in a sentence.

/// The name of an effect in a sentence.
pub fn effect(name: &str) -> String {
    name.replace('_', " ")
}
