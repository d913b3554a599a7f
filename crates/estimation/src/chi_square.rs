//! The χ² distribution, without allocation and with bounded loops.

/// Probability that a χ² variable with `degrees` degrees of freedom exceeds `x`: the upper incomplete gamma function
/// Q(degrees/2, x/2), by its series or its continued fraction (Abramowitz & Stegun 6.5.29, 6.5.31).
pub(crate) fn above(x: f64, degrees: usize) -> f64 {
    if degrees == 0 || x <= 0.0 {
        return 1.0;
    }
    let (a, x) = (0.5 * degrees as f64, 0.5 * x);
    let front = (a * x.ln() - x - ln_gamma(degrees)).exp();
    let value = if x < a + 1.0 {
        let (mut term, mut sum, mut n) = (1.0 / a, 1.0 / a, a);
        while term > sum * 1e-16 {
            n += 1.0;
            term *= x / n;
            sum += term;
        }
        1.0 - front * sum
    } else {
        // Lentz' method; x > a + 1, so no denominator vanishes.
        let mut b = x + 1.0 - a;
        let (mut c, mut d) = (f64::INFINITY, 1.0 / b);
        let mut fraction = d;
        for i in 1..1000 {
            let an = -f64::from(i) * (f64::from(i) - a);
            b += 2.0;
            d = 1.0 / (an * d + b);
            c = b + an / c;
            fraction *= c * d;
            if (c * d - 1.0).abs() < 1e-15 {
                break;
            }
        }
        front * fraction
    };
    value.clamp(0.0, 1.0)
}

/// ln Γ(degrees/2), from Γ(1) = 1 or Γ(1/2) = √π up.
fn ln_gamma(degrees: usize) -> f64 {
    let start = if degrees.is_multiple_of(2) { 0.0 } else { 0.5 * std::f64::consts::PI.ln() };
    let first = if degrees.is_multiple_of(2) { 2 } else { 1 };
    (first..degrees).step_by(2).fold(start, |sum, twice| sum + (0.5 * twice as f64).ln())
}

#[cfg(test)]
mod tests {
    use super::above;

    /// Table 26.8 of Abramowitz & Stegun.
    #[test]
    fn chi_square_tail_matches_tables() {
        for (x, degrees, p) in [
            (3.841459, 1, 0.05),
            (5.991465, 2, 0.05),
            (18.307038, 10, 0.05),
            (29.588298, 10, 0.001),
            (55.758479, 40, 0.05),
            (4.865182, 10, 0.9),
        ] {
            let found = above(x, degrees);
            assert!((found - p).abs() < 1e-6, "{x} {degrees}: {found}");
        }
        assert!(above(1e5, 50) < 1e-300 && above(1.0, 0) == 1.0);
    }
}
