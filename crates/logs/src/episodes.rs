//! Episodes that are read as one log: the time of each follows that of the one before, with a hole between them.

/// Steps of time between two episodes whose unit of time is unknown: a hole, across which nothing is interpolated.
pub(crate) const STEPS_BETWEEN: f64 = 500.0;

/// Lets the time of each episode begin `between` after the end of the one before, in the unit of `t`. `starts`: first rows of the
/// episodes.
pub(crate) fn one_after_the_other(t: &mut [f64], starts: &[usize], between: f64) {
    let mut ends = starts.iter().skip(1).copied().chain([t.len()]);
    let mut last = None;
    for &start in starts {
        let end = ends.next().unwrap_or(t.len());
        let Some(first) = t[start..end].first() else { continue };
        let shift = last.map_or(0.0, |last: f64| last + between - first);
        for time in &mut t[start..end] {
            *time += shift;
        }
        last = t[start..end].last().copied().or(last);
    }
}

/// The median step of time within episodes; zero without a step.
pub(crate) fn median_step(t: &[f64], starts: &[usize]) -> f64 {
    let is_start = |row: &usize| starts.binary_search(row).is_ok();
    let mut steps: Vec<f64> = (1..t.len()).filter(|row| !is_start(row)).map(|row| t[row] - t[row - 1]).collect();
    let middle = steps.len() / 2;
    if steps.is_empty() { 0.0 } else { *steps.select_nth_unstable_by(middle, f64::total_cmp).1 }
}

/// What a reader reports of them: how many, and what is between them.
pub(crate) fn note(count: usize, between: &str) -> String {
    format!("{count} episodes are read as one log, {between} apart; nothing is interpolated between them")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn episodes_follow_one_another() {
        let mut t = [0.0, 0.1, 0.2, 0.0, 0.1, 0.0];
        let starts = [0, 3, 5];
        assert!((median_step(&t, &starts) - 0.1).abs() < 1e-12);
        one_after_the_other(&mut t, &starts, 10.0);
        let expected = [0.0, 0.1, 0.2, 10.2, 10.3, 20.3];
        assert!(t.iter().zip(expected).all(|(t, e)| (t - e).abs() < 1e-12), "{t:?}");
        one_after_the_other(&mut [], &[], 1.0);
        one_after_the_other(&mut [1.0], &[0, 1], 1.0);
        assert_eq!(median_step(&[3.0], &[0]), 0.0);
    }
}
