//! Autocorrelation of residuals, as the number of rows per independent row.

use nalgebra::DVector;

/// Most rows per independent row: a longer memory is an effect, not noise, and must not hide itself.
const LONGEST_MEMORY: f64 = 6.0;
/// Most lags that are looked at: of a longer log more of them would be a cost of its square.
const LAGS: usize = 500;

/// `1 + 2 Σ ρ_k` while the autocorrelation is positive: rows per independent row, at most [`LONGEST_MEMORY`].
pub(crate) fn correlation(records: &[&DVector<f64>]) -> f64 {
    let product = |lag: usize| -> f64 {
        records.iter().map(|e| e.iter().zip(e.iter().skip(lag)).map(|(a, b)| a * b).sum::<f64>()).sum()
    };
    let power = product(0);
    if power <= 0.0 {
        return 1.0;
    }
    let longest = (records.iter().map(|e| e.len()).min().unwrap_or(0) / 8).min(LAGS);
    let mut sum = 1.0;
    for lag in 1..longest {
        let share = product(lag) / power;
        // From the longest memory on nothing changes any more, and the work would grow with the square of the log.
        if share <= 0.0 || sum >= LONGEST_MEMORY {
            break;
        }
        sum += 2.0 * share;
    }
    sum.min(LONGEST_MEMORY)
}
