//! By how much a joint comes after what was commanded, and how well its motion tells.

use crate::linear::dot;

/// A lag is told where its standard deviation is no more than this \[s\].
const TOLD_S: f64 = 0.002;
/// What a loop leaves beside its lag is alike for so long \[s\].
const BLOCK_S: f64 = 0.4;

/// A joint's tracking lag.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lag {
    /// What its instruments are delayed by, negative where the arm leads \[s\].
    pub seconds: f64,
    /// Standard deviation of what its own motion says \[s\].
    pub std_s: f64,
    /// Whether it is that: else it is what the other joints say, or 0.
    pub told: bool,
}

impl Lag {
    /// Of instruments that came with the motion.
    pub const NONE: Lag = Lag { seconds: 0.0, std_s: 0.0, told: true };
}

/// Step in which the best is looked for first \[s\].
const COARSE_S: f64 = 0.004;

/// Samples by which `actual` lags `commanded` (negative: leads it, which feed-forward can do), within 0.3 s: where the two differ
/// least, refined by a parabola. The same stretch of `actual` counts for every shift.
///
/// Not where their product is largest: that likes a stretch of `commanded` that is only faster.
pub(super) fn lag(actual: &[f64], commanded: &[f64], period_s: f64) -> Lag {
    let most = ((0.3 / period_s) as usize).min(actual.len() / 4);
    let inner = &actual[most..actual.len() - most];
    // Entry k belongs to a lag of most - k samples.
    let whole_of = Stretches::new(commanded, inner);
    // The motion of an arm does not turn within COARSE_S: the best of every so many entries has the best of all beside it, and so
    // many samples say as much as one of them.
    let stride = ((COARSE_S / period_s) as usize).max(1);
    let thin = |x: &[f64]| -> Vec<f64> { x.iter().step_by(stride).copied().collect() };
    let (thin_inner, thin_commanded) = (thin(inner), thin(commanded));
    let thin_of = Stretches::new(&thin_commanded, &thin_inner);
    let largest = |alike: &[f64]| (0..alike.len()).max_by(|a, b| alike[*a].total_cmp(&alike[*b])).unwrap_or(most);
    let coarse: Vec<f64> = (0..=2 * most / stride).map(|k| thin_of.alike(k)).collect();
    let near = largest(&coarse) * stride;
    let mut all = vec![f64::NEG_INFINITY; 2 * most + 1];
    for k in near.saturating_sub(stride)..=(near + stride).min(2 * most) {
        all[k] = whole_of.alike(k);
    }
    let best = largest(&all);
    let whole = most as f64 - best as f64;
    if whole_of.product(best) <= 0.0 || best == 0 || best + 1 == all.len() {
        return Lag { seconds: 0.0, std_s: f64::INFINITY, told: false }; // nothing in common, or nothing that fits within the reach
    }
    let [before, at, after] = [best - 1, best, best + 1].map(|k| whole_of.alike(k));
    let samples = whole - vertex(before, at, after);
    let block = ((BLOCK_S / period_s) as usize).max(1);
    let std_s = period_s * deviation(inner, &commanded[best.saturating_sub(1)..], block);
    Lag { seconds: samples * period_s, std_s, told: std_s <= TOLD_S }
}

/// Where the parabola through three samples is largest, from the one in the middle \[samples\]. Next to a straight line that is anywhere,
/// while the best of the three is no further from it than one.
fn vertex(before: f64, at: f64, after: f64) -> f64 {
    let bend = before - 2.0 * at + after;
    if bend < 0.0 { (0.5 * (before - after) / bend).clamp(-1.0, 1.0) } else { 0.0 }
}

/// Standard deviation of the shift in samples of `inner` against the stretch of a signal that begins at the second of `around`, by least
/// squares: what a shift by one changes is the signal's slope. What is left is coloured, so it counts by blocks.
fn deviation(inner: &[f64], around: &[f64], block: usize) -> f64 {
    let (mut sum, mut own, mut squares, mut blocks) = (0.0, 0.0, 0.0, 0.0);
    for (k, actual) in inner.iter().enumerate().take(around.len().saturating_sub(2)) {
        let slope = 0.5 * (around[k + 2] - around[k]);
        own += slope * (actual - around[k + 1]);
        squares += slope * slope;
        if (k + 1) % block == 0 {
            sum += own * own;
            own = 0.0;
            blocks += 1.0;
        }
    }
    // At the best shift all of it together is nothing, so of one block alone nothing is known.
    let freedom = if blocks > 1.0 { blocks / (blocks - 1.0) } else { f64::INFINITY };
    (freedom * sum).sqrt() / f64::max(squares, f64::MIN_POSITIVE)
}

/// The lags to delay instruments by: where a joint's motion does not tell its own, the median of those that do, 0 without any. One loop
/// drives all joints of most arms, and what is far off correlates less than what is off by a little.
pub(super) fn believed(found: &[Lag], period_s: f64) -> Vec<Lag> {
    let mut lags_s: Vec<f64> = found.iter().filter(|lag| lag.told).map(|lag| lag.seconds).collect();
    lags_s.sort_by(f64::total_cmp);
    let usual = lags_s.get(lags_s.len() / 2).copied().unwrap_or(0.0);
    let believed = |lag: &Lag| {
        let samples = if lag.told { lag.seconds } else { usual } / period_s;
        Lag { seconds: (samples * period_s * 1e9).round() / 1e9, ..*lag }
    };
    found.iter().map(believed).collect()
}

/// A stretch of a signal against all stretches of another.
struct Stretches<'a> {
    commanded: &'a [f64],
    inner: &'a [f64],
    /// Sum of the squares of `commanded` before each entry.
    squares: Vec<f64>,
}

impl<'a> Stretches<'a> {
    fn new(commanded: &'a [f64], inner: &'a [f64]) -> Stretches<'a> {
        let mut squares = vec![0.0; commanded.len() + 1];
        commanded.iter().enumerate().for_each(|(k, x)| squares[k + 1] = squares[k] + x * x);
        Stretches { commanded, inner, squares }
    }

    fn product(&self, k: usize) -> f64 {
        dot(self.inner, &self.commanded[k..k + self.inner.len()])
    }

    /// What of the square of their difference depends on k, over -2.
    fn alike(&self, k: usize) -> f64 {
        self.product(k) - 0.5 * (self.squares[k + self.inner.len()] - self.squares[k])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parabola_that_hardly_bends_says_no_more_than_a_sample() {
        assert_eq!(vertex(1.0, 1.5, 1.999), 1.0);
        assert_eq!(vertex(0.0, 2.0, 2.0), 0.5);
        assert_eq!(vertex(1.0, 1.0, 1.0), 0.0);
    }

    #[test]
    fn tracking_lag_is_found_to_a_fraction_of_a_sample() {
        let wave = |k: f64| (0.02 * k).sin() + 0.5 * (0.037 * k).cos();
        let commanded: Vec<f64> = (0..2000).map(|k| wave(f64::from(k))).collect();
        for late in [0.0, 3.0, 17.4, -12.6] {
            let actual: Vec<f64> = (0..2000).map(|k| wave(f64::from(k) - late)).collect();
            let found = lag(&actual, &commanded, 0.004);
            assert!((found.seconds / 0.004 - late).abs() < 0.7 && found.told, "{late}: {found:?}");
        }
    }

    /// Point-to-point motion of which a short record has one slow move beside a fast one: no lag makes them alike.
    #[test]
    fn a_faster_stretch_beside_is_no_lag() {
        let move_of = |k: f64, from: f64, to: f64| ((k - from) / (to - from)).clamp(0.0, 1.0);
        let bump = |s: f64| (std::f64::consts::PI * s).sin().powi(2);
        let speed = |k: f64| 0.2 * bump(move_of(k, 0.0, 2000.0)) + 1.5 * bump(move_of(k, 2000.0, 2900.0));
        let commanded: Vec<f64> = (0..2500).map(|k| speed(f64::from(k))).collect();
        for late in [0.0, 12.0] {
            let actual: Vec<f64> = (0..2500).map(|k| speed(f64::from(k) - late)).collect();
            let found = lag(&actual, &commanded, 0.001);
            assert!((found.seconds / 0.001 - late).abs() < 0.7 && found.told, "{late}: {found:?}");
        }
        assert!(!lag(&commanded, &vec![0.0; 2500], 0.001).told);
    }

    /// What is left beside a lag of 10 ms, coloured: it is off by its standard deviation.
    #[test]
    fn its_deviation_holds_beside_a_coloured_rest() {
        let mut random = crate::linear::tests::Random(5);
        let wave = |k: f64| (0.004 * k).sin() + 0.5 * (0.0097 * k).cos();
        let commanded: Vec<f64> = (0..4000).map(|k| wave(f64::from(k))).collect();
        let (mut errors, mut variances) = (0.0, 0.0);
        for _ in 0..200 {
            let mut rest = 0.0;
            let delayed_sample = |k: i32| {
                rest = 0.99 * rest + 0.003 * random.normal();
                wave(f64::from(k) - 10.0) + rest
            };
            let actual: Vec<f64> = (0..4000).map(delayed_sample).collect();
            let found = lag(&actual, &commanded, 0.001);
            errors += (found.seconds - 0.01).powi(2);
            variances += found.std_s.powi(2);
        }
        let ratio = f64::sqrt(errors / variances);
        assert!((0.8..1.3).contains(&ratio), "{ratio}");
    }

    #[test]
    fn a_joint_whose_motion_does_not_tell_has_the_lag_of_the_others() {
        let lag = |seconds: f64, told: bool| Lag { seconds, std_s: if told { 1e-3 } else { 0.1 }, told };
        let found = [lag(0.011, true), lag(0.2, false), lag(0.012, true), lag(0.013, true)];
        let seconds: Vec<f64> = believed(&found, 0.001).iter().map(|lag| lag.seconds).collect();
        assert_eq!(seconds, [0.011, 0.012, 0.012, 0.013]);
        assert_eq!(believed(&found[1..2], 0.001)[0].seconds, 0.0);
    }
}
