//! Terms of the contract in a sentence.

/// Names of persons in the names of effects.
const PERSONS: [&str; 2] = ["coulomb", "stribeck"];

/// The name of an effect in a sentence: "joint spring", "Coulomb friction".
pub fn effect(name: &str) -> String {
    let words = name.replace('_', " ");
    match PERSONS.iter().find(|person| words.starts_with(**person)) {
        Some(_) => words[..1].to_uppercase() + &words[1..],
        None => words,
    }
}
