//! Units of time by the step between two rows.

use crate::error::LogFault;

/// Steps of time between rows of a log \[s\]: of the units of time one alone makes a step such.
const STEPS_S: [f64; 2] = [1.5e-4, 0.12];

/// The unit in which a step of time is that of a log, from 8 Hz to 7 kHz: `s`, `ms`, `us` or `ns`. Without one where no unit fits.
///
/// ```
/// // Rows of a log at 1 kHz are a million nanoseconds apart.
/// assert_eq!(rivet_logs::unit_of_step(1e6), Some("ns"));
/// assert_eq!(rivet_logs::unit_of_step(1e-3), Some("s"));
/// // A step of 1e9 is a second or more in each of the units.
/// assert_eq!(rivet_logs::unit_of_step(1e9), None);
/// ```
pub fn unit_of_step(step: f64) -> Option<&'static str> {
    let fits = |(_, factor): &(&str, f64)| (STEPS_S[0]..=STEPS_S[1]).contains(&(factor * step));
    [("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)].into_iter().find(fits).map(|(unit, _)| unit)
}

/// The middle one of the steps that go forwards.
pub(crate) fn usual_step(t: &[f64]) -> Option<f64> {
    let mut steps: Vec<f64> = t.windows(2).map(|w| w[1] - w[0]).filter(|step| *step > 0.0).collect();
    let middle = steps.len() / 2;
    (!steps.is_empty()).then(|| *steps.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// That times \[s\] are those of a log in another unit, where their usual step says so.
///
/// ```
/// let milliseconds: Vec<f64> = (0..100).map(f64::from).collect();
/// let fault = rivet_logs::time_unit_fault(&milliseconds).expect("a second between rows");
/// assert!(fault.to_string().contains("--map time_unit=ms"));
/// ```
pub fn time_unit_fault(t: &[f64]) -> Option<LogFault> {
    let step = usual_step(t)?;
    unit_of_step(step).filter(|unit| *unit != "s").map(|unit| LogFault::TimeUnit { unit, step })
}
