//! Positions that come in steps or with noise: how coarse they are, and how fast a motion they tell.
//!
//! An encoder of step Δ is off by up to half of one, which has the variance σ² = Δ²/12 and is about white while the joint moves by
//! more than a step from sample to sample. Of a speed up to f that makes, as any white noise does, with samples T apart,
//!
//! ```text
//! σ_v² = ∫₀^f (2πν)²·2T·σ² dν = (2π)²·2T·σ²·f³/3
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
/// Orders of the differences that tell noise from motion.
const ORDERS: [usize; 3] = [4, 6, 8];
/// Median of the absolute value of a normal variable of standard deviation 1.
const NORMAL_MEDIAN: f64 = 0.6745;

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
    // An even speed has increments alike as well: steps are sometimes none, or two.
    let repeats = q.windows(2).any(|w| w[1] == w[0]);
    if !repeats && countable.iter().all(|d| (d / step).round() <= 1.0) {
        return None;
    }
    let whole = countable.iter().filter(|d| (*d / step - (*d / step).round()).abs() < OFF).count();
    (whole as f64 >= MOST * countable.len() as f64).then_some(step)
}

/// White noise of positions \[rad\], one standard deviation: the least that differences of several orders say, since motion adds to the
/// low ones. 0 where most readings are held, or there are too few.
pub fn position_noise(q: &[f64]) -> f64 {
    if q.len() < LEAST {
        return 0.0;
    }
    let least = ORDERS.map(|order| white_noise(q, order)).into_iter().fold(f64::INFINITY, f64::min);
    // What sums of numbers of this size leave is no noise.
    let size = q.iter().fold(0.0_f64, |m, q| m.max(q.abs()));
    if least > 16.0 * f64::EPSILON * size { least } else { 0.0 }
}

/// Differences whose median is a measure of noise, at least: it is then known to a tenth.
const MIN_DIFFERENCES: usize = 100;

/// Standard deviation of white noise on a signal so smooth that differences of order `order` leave nothing but it; their median is deaf to
/// jumps. 0 of fewer than `order` + 1 samples.
///
/// A difference of order k of white noise has the variance σ²·C(2k, k), the sum of the squares of its binomials.
pub fn white_noise(x: &[f64], order: usize) -> f64 {
    white_noise_without(x, order, &[])
}

/// The same by differences that meet none of some rows (ascending): rows that were interpolated are smoother than measured ones. Of all rows
/// where too few differences are left.
pub fn white_noise_without(x: &[f64], order: usize, rows: &[usize]) -> f64 {
    let next = |b: &mut f64, k: usize| Some(std::mem::replace(b, -*b * (order - k) as f64 / (k + 1) as f64));
    let binomials: Vec<f64> = (0..=order).scan(1.0, next).collect();
    let size = |w: &[f64]| w.iter().zip(&binomials).map(|(x, b)| x * b).sum::<f64>().abs();
    let meets_none = |from: usize| {
        let next = rows.partition_point(|row| *row < from);
        rows.get(next).is_none_or(|row| *row > from + order)
    };
    let mut sizes: Vec<f64> =
        x.windows(order + 1).enumerate().filter(|(from, _)| meets_none(*from)).map(|(_, w)| size(w)).collect();
    if sizes.len() < MIN_DIFFERENCES && !rows.is_empty() {
        return white_noise_without(x, order, &[]);
    }
    if sizes.is_empty() {
        return 0.0;
    }
    let middle = sizes.len() / 2;
    let (_, median, _) = sizes.select_nth_unstable_by(middle, f64::total_cmp);
    *median / (NORMAL_MEDIAN * binomials.iter().map(|b| b * b).sum::<f64>().sqrt())
}

/// Up to which frequency speeds by positions with white noise of one standard deviation `noise` \[rad\], `period_s` apart, are good to a
/// share of `velocity`, the speed over which friction turns \[rad/s\]. Steps of Δ are a noise of Δ/√12.
pub fn told_up_to_hz(noise: f64, period_s: f64, velocity: f64) -> f64 {
    let density = 2.0 * period_s * noise * noise;
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
        // A joint at a speed that hardly changes has increments alike, and no steps.
        let even: Vec<f64> = (0..500).map(f64::from).map(|k| (1.8e-3 + 2e-7 * k) * k).collect();
        assert_eq!(position_step(&even), None);
        assert_eq!(position_step(&[0.3; 1000]), None);
        assert_eq!(position_step(&[]), None);
    }

    /// Differences of quantised positions through a filter vary as much as the equation says.
    #[test]
    fn speeds_are_as_good_as_told() {
        let (step, period, velocity) = (3e-4, 1e-3, 0.02);
        let hz = told_up_to_hz(step / 12.0_f64.sqrt(), period, velocity);
        let mut noise: Vec<f64> = wave(step).iter().zip(wave(0.0)).map(|(q, exact)| q - exact).collect();
        super::super::ZeroPhase::new(hz, 6, period).apply(&mut noise);
        let speed: Vec<f64> = noise.windows(3).map(|w| (w[2] - w[0]) / (2.0 * period)).collect();
        let rms = (speed.iter().map(|v| v * v).sum::<f64>() / speed.len() as f64).sqrt();
        println!("below {hz:.0} Hz speeds are off by {rms:.2e} rad/s, {velocity} allows {:.2e}", SHARE * velocity);
        assert!(rms < 1.3 * SHARE * velocity && rms > 0.4 * SHARE * velocity, "{rms}");
    }

    /// Noise is told from motion, slow or with jerks, and there is none where there is none.
    #[test]
    fn noise_is_told_from_motion() {
        let mut state = 1_u64;
        let mut uniform = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f64 / f64::from(1_u32 << 24) - 0.5
        };
        for noise in [1e-6, 1e-4] {
            let noisy: Vec<f64> =
                wave(0.0).iter().map(|q| q + noise * (0..12).map(|_| uniform()).sum::<f64>()).collect();
            let found = position_noise(&noisy);
            assert!((found / noise - 1.0).abs() < 0.03, "{noise}: {found}");
            // A hundred jumps are no noise.
            let jumps = |(k, q): (usize, &f64)| q + if k % 400 < 200 { 0.01 } else { 0.0 };
            let found = position_noise(&noisy.iter().enumerate().map(jumps).collect::<Vec<_>>());
            assert!((found / noise - 1.0).abs() < 0.1, "{noise}: {found}");
        }
        // 6 Hz at 100 Hz, as fast as an arm may turn.
        let fast: Vec<f64> = (0..2000).map(|k| 0.1 * (0.377 * f64::from(k)).sin()).collect();
        assert!(position_noise(&fast) < 2e-6 && position_noise(&wave(0.0)) < 1e-12, "{}", position_noise(&fast));
        assert_eq!((position_noise(&[0.3; 1000]), position_noise(&[])), (0.0, 0.0));
    }
}
