//! Positions that come in steps: how coarse they are, and how fast a motion they tell.
//!
//! An encoder of step Δ is off by up to half of one, which has the variance Δ²/12 and is about white while the joint moves by more
//! than a step from sample to sample. Of a speed up to f that makes, with samples T apart,
//!
//! ```text
//! σ_v² = ∫₀^f (2πν)²·2T·Δ²/12 dν = (2π)²·2T·Δ²/12·f³/3
//! ```
//!
//! Where a column is linear in speed and acceleration, the model filter takes most of it out and instruments the rest. The direction
//! of friction, tanh(q̇/v), is not: a speed that is a step in one sample and none in the next has no direction half of the time,
//! whatever is done to the column later. So speeds have to be good to a share of v before the column is made of them.

use std::f64::consts::PI;

/// Speeds are off by no more than this share of the speed over which friction turns (one standard deviation).
const SHARE: f64 = 0.5;
/// Increments of so many steps or fewer say what a step is: of larger ones rounding of the log makes too much.
const COUNTABLE: f64 = 6.0;
/// An increment is so many steps if it is off by no more than this share of one ...
const OFF: f64 = 0.1;
/// ... as so many of those are that can be counted ...
const MOST: f64 = 0.98;
/// ... and so many there have to be.
const LEAST: usize = 50;

/// The step that positions come in \[rad\]: the one that all small increments are multiples of. None where there is none.
pub fn position_step(q: &[f64]) -> Option<f64> {
    let increments: Vec<f64> = q.windows(2).map(|w| (w[1] - w[0]).abs()).filter(|d| *d > 0.0).collect();
    let size = q.iter().fold(0.0_f64, |m, q| m.max(q.abs()));
    // What sums of numbers of this size leave is no increment.
    let real = |d: &&f64| **d > 16.0 * f64::EPSILON * size;
    let smallest = increments.iter().filter(real).copied().fold(f64::INFINITY, f64::min);
    let countable: Vec<f64> =
        increments.iter().filter(real).copied().filter(|d| *d < (COUNTABLE + 0.5) * smallest).collect();
    if countable.len() < LEAST {
        return None;
    }
    let (length, steps) =
        countable.iter().fold((0.0, 0.0), |(length, steps), d| (length + d, steps + (d / smallest).round()));
    let step = length / steps;
    let whole = countable.iter().filter(|d| (*d / step - (*d / step).round()).abs() < OFF).count();
    (whole as f64 >= MOST * countable.len() as f64).then_some(step)
}

/// Up to which frequency speeds by positions of step `step` \[rad\], `period_s` apart, are good to a share of `velocity`, the speed over
/// which friction turns \[rad/s\].
pub fn told_up_to_hz(step: f64, period_s: f64, velocity: f64) -> f64 {
    let density = 2.0 * period_s * step * step / 12.0;
    (3.0 * (SHARE * velocity / (2.0 * PI)).powi(2) / density).cbrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(step: f64) -> Vec<f64> {
        let at = |k: i32| 0.7 * (1e-3 * f64::from(k)).sin() + 0.1 * (3.1e-3 * f64::from(k)).sin();
        (0..20_000).map(|k| if step > 0.0 { (at(k) / step).round() * step } else { at(k) }).collect()
    }

    #[test]
    fn a_step_is_found_and_none_where_there_is_none() {
        for step in [1e-6, 1e-4, 3e-4] {
            let found = position_step(&wave(step)).expect("a step");
            assert!((found / step - 1.0).abs() < 1e-3, "{step}: {found}");
            // Written with four digits less than it has, and around another zero.
            let rounded: Vec<f64> =
                wave(step).iter().map(|q| ((q + 2.0) / (0.01 * step)).round() * 0.01 * step).collect();
            let found = position_step(&rounded).expect("a step");
            assert!((found / step - 1.0).abs() < 1e-2, "{step}: {found}");
        }
        assert_eq!(position_step(&wave(0.0)), None);
        assert_eq!(position_step(&[0.3; 1000]), None);
        assert_eq!(position_step(&[]), None);
    }

    /// Differences of quantised positions through a filter vary as much as the equation says.
    #[test]
    fn speeds_are_as_good_as_told() {
        let (step, period, velocity) = (3e-4, 1e-3, 0.02);
        let hz = told_up_to_hz(step, period, velocity);
        let mut noise: Vec<f64> = wave(step).iter().zip(wave(0.0)).map(|(q, exact)| q - exact).collect();
        super::super::ZeroPhase::new(hz, 6, period).apply(&mut noise);
        let speed: Vec<f64> = noise.windows(3).map(|w| (w[2] - w[0]) / (2.0 * period)).collect();
        let rms = (speed.iter().map(|v| v * v).sum::<f64>() / speed.len() as f64).sqrt();
        println!("below {hz:.0} Hz speeds are off by {rms:.2e} rad/s, {velocity} allows {:.2e}", SHARE * velocity);
        assert!(rms < 1.3 * SHARE * velocity && rms > 0.4 * SHARE * velocity, "{rms}");
    }
}
