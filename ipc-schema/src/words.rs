//! States in words.

use std::fmt::Debug;

/// The name of a variant in words: `WrongPeriod` is "wrong period".
pub fn words(variant: impl Debug) -> String {
    let mut out = String::new();
    for letter in format!("{variant:?}").chars() {
        if letter.is_ascii_uppercase() && !out.is_empty() {
            out.push(' ');
        }
        out.push(letter.to_ascii_lowercase());
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_capital_begins_a_word() {
        assert_eq!(words(crate::InputFault::WrongPeriod), "wrong period");
    }
}
