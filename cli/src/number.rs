//! Numbers on the command line: NaN, infinities and what makes no sense are refused where they are read.

use std::ops::RangeInclusive;

/// A number within `range`.
pub(crate) fn within(text: &str, range: RangeInclusive<f64>) -> Result<f64, String> {
    let number: f64 = text.parse().map_err(|_| "it must be a number".to_owned())?;
    if range.contains(&number) { Ok(number) } else { Err(format!("it must be {} to {}", range.start(), range.end())) }
}

/// A duration of at most a day \[s\].
pub(crate) fn seconds(text: &str) -> Result<f64, String> {
    within(text, 0.0..=86_400.0)
}

#[cfg(test)]
mod tests {
    use super::{seconds, within};

    #[test]
    fn what_is_no_number_of_the_range_is_refused_with_the_rule() {
        assert_eq!(within("0.5", 0.0..=1.0), Ok(0.5));
        for text in ["nan", "inf", "-inf", "-0.1", "1.1", "1e999"] {
            assert_eq!(within(text, 0.0..=1.0), Err("it must be 0 to 1".to_owned()), "{text}");
        }
        assert_eq!(seconds("2 s"), Err("it must be a number".to_owned()));
    }
}
