//! Signal arithmetic of resampling: cubic spline and linear-phase low-pass.

/// A twice continuously differentiable cubic spline through `(t, x)`, evaluated at `at` (rising, inside `t`).
///
/// Solves the classic tridiagonal system for the second derivatives m_k at the knots,
/// `h_k m_k + 2 (h_k + h_{k+1}) m_{k+1} + h_{k+1} m_{k+2} = 6 (s_{k+1} - s_k)`, s the chord slopes; the end pieces are
/// parabolas (m_0 = m_1), which does not bend the first samples the way a natural spline's m_0 = 0 does.
pub(crate) fn spline(t: &[f64], x: &[f64], at: &[f64]) -> Vec<f64> {
    let n = t.len();
    if n < 3 {
        return linear(t, x, at);
    }
    let h: Vec<f64> = t.windows(2).map(|w| w[1] - w[0]).collect();
    let slope: Vec<f64> = x.windows(2).zip(&h).map(|(w, h)| (w[1] - w[0]) / h).collect();
    // Thomas' algorithm over the inner knots 1..n-1; the matrix is diagonally dominant, no pivot can vanish.
    let mut m = vec![0.0; n];
    let mut upper = vec![0.0; n];
    for k in 1..n - 1 {
        let mut diagonal = 2.0 * (h[k - 1] + h[k]);
        if k == 1 {
            diagonal += h[0];
        }
        if k == n - 2 {
            diagonal += h[n - 2];
        }
        let below = if k == 1 { 0.0 } else { h[k - 1] };
        let pivot = diagonal - below * upper[k - 1];
        upper[k] = if k == n - 2 { 0.0 } else { h[k] / pivot };
        m[k] = (6.0 * (slope[k] - slope[k - 1]) - below * m[k - 1]) / pivot;
    }
    for k in (1..n - 2).rev() {
        m[k] -= upper[k] * m[k + 1];
    }
    m[0] = m[1];
    m[n - 1] = m[n - 2];
    each_interval(t, at, |k, from_left| {
        let (a, b) = (from_left, h[k] - from_left);
        let chord = x[k] + slope[k] * a;
        chord - a * b / 6.0 * (m[k] * (1.0 + b / h[k]) + m[k + 1] * (1.0 + a / h[k]))
    })
}

/// A smooth curve (cubic spline) through `(t, x)`, `t` rising, at rising points; beyond the ends the end value holds.
///
/// # Panics
/// If `t` and `x` differ in length or have fewer than two entries.
pub fn interpolate(t: &[f64], x: &[f64], at: &[f64]) -> Vec<f64> {
    assert!(t.len() == x.len() && t.len() > 1, "{} times, {} values", t.len(), x.len());
    let inside: Vec<f64> = at.iter().map(|at| at.clamp(t[0], t[t.len() - 1])).collect();
    spline(t, x, &inside)
}

/// Straight lines through `(t, x)`, evaluated at `at` (rising, inside `t`).
pub(crate) fn linear(t: &[f64], x: &[f64], at: &[f64]) -> Vec<f64> {
    each_interval(t, at, |k, from_left| x[k] + (x[k + 1] - x[k]) * from_left / (t[k + 1] - t[k]))
}

/// Calls `value(k, at - t_k)` for the interval k that holds each point.
fn each_interval(t: &[f64], at: &[f64], value: impl Fn(usize, f64) -> f64) -> Vec<f64> {
    let mut k = 0;
    let last = t.len() - 2;
    let points = at.iter().map(|point| {
        while k < last && t[k + 1] <= *point {
            k += 1;
        }
        value(k, point - t[k])
    });
    points.collect()
}

/// A symmetric (zero phase once centred) low-pass for taking every `factor`-th sample.
///
/// Windowed sinc, Kaiser window for 80 dB: flat up to a quarter of the new rate, -6 dB at 0.4 of it, silent from 0.55 on,
/// so that what folds back stays above 0.45 of the new rate. Gain at rest is exactly one.
pub(crate) struct Decimator {
    factor: usize,
    taps: Vec<f64>,
}

impl Decimator {
    /// New samples lost at either end: half the filter's length.
    pub(crate) const EDGE: usize = 9;

    pub(crate) fn new(factor: usize) -> Self {
        const CUTOFF: f64 = 0.4; // of the new rate
        const KAISER_BETA: f64 = 7.857; // 0.1102 (80 dB - 8.7), Kaiser 1974
        let half = Self::EDGE * factor;
        let tap = |k: usize| {
            let x = (k as f64 - half as f64) / factor as f64; // in new samples
            let phase = 2.0 * std::f64::consts::PI * CUTOFF * x;
            let sinc = if k == half { 1.0 } else { phase.sin() / phase };
            let r = x / Self::EDGE as f64;
            sinc * bessel_i0(KAISER_BETA * (1.0 - r * r).max(0.0).sqrt())
        };
        let mut taps: Vec<f64> = (0..=2 * half).map(tap).collect();
        let sum: f64 = taps.iter().sum();
        for tap in &mut taps {
            *tap /= sum;
        }
        Decimator { factor, taps }
    }

    /// Filters and takes every `factor`-th sample; the first result belongs to input sample `EDGE * factor`.
    pub(crate) fn apply(&self, x: &[f64]) -> Vec<f64> {
        let count = if x.len() < self.taps.len() { 0 } else { (x.len() - self.taps.len()) / self.factor + 1 };
        (0..count)
            .map(|k| {
                let from = k * self.factor;
                self.taps.iter().zip(&x[from..]).map(|(tap, x)| tap * x).sum()
            })
            .collect()
    }
}

/// Modified Bessel function of order zero, by its series (it ends below 1e-17 of the sum).
fn bessel_i0(x: f64) -> f64 {
    let (mut sum, mut term) = (1.0, 1.0);
    for k in 1..64 {
        term *= (x / (2.0 * f64::from(k))).powi(2);
        sum += term;
        if term < 1e-17 * sum {
            break;
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A parabola has a constant second derivative: the spline with parabolic ends is exact for it.
    #[test]
    fn spline_is_exact_for_a_parabola_on_uneven_knots() {
        let t: Vec<f64> = (0..40).map(|k| f64::from(k) + 0.3 * f64::from(k * k % 7) / 7.0).collect();
        let f = |t: f64| 1.0 - 0.5 * t + 0.25 * t * t;
        let x: Vec<f64> = t.iter().map(|t| f(*t)).collect();
        let at: Vec<f64> = (0..390).map(|k| 0.1 * f64::from(k)).collect();
        for (at, got) in at.iter().zip(spline(&t, &x, &at)) {
            assert!((got - f(*at)).abs() < 1e-9, "{at}: {got} vs {}", f(*at));
        }
    }

    /// Response of the low-pass against what its documentation promises.
    #[test]
    fn decimator_passes_the_low_quarter_and_stops_what_would_fold() {
        for factor in [2, 5, 8] {
            let low_pass = Decimator::new(factor);
            let gain = |f: f64| {
                // f in cycles per new sample
                let centre = (low_pass.taps.len() / 2) as f64;
                let terms =
                    low_pass.taps.iter().enumerate().map(|(k, tap)| {
                        tap * (2.0 * std::f64::consts::PI * f * (k as f64 - centre) / factor as f64).cos()
                    });
                terms.sum::<f64>()
            };
            assert!((gain(0.0) - 1.0).abs() < 1e-12);
            for f in [0.05, 0.1, 0.2, 0.25] {
                assert!((gain(f) - 1.0).abs() < 1e-3, "factor {factor}, {f}: {}", gain(f));
            }
            for f in [0.55, 0.6, 0.8, 1.0] {
                assert!(gain(f).abs() < 2e-4, "factor {factor}, {f}: {}", gain(f));
            }
        }
    }
}
