//! Numbers that the inner loops compute with: one, or two side by side in a vector register.
//!
//! Two lanes are what every x86-64 and aarch64 has. Each lane goes through the same operations in the same order as a
//! single number would, none of them contracted: results do not depend on the machine, nor on what the other lane holds.

use std::ops::{Add, Mul, Sub};

use wide::f64x2;

/// Both lanes of a pair.
pub(crate) type Pair = f64x2;

/// One or several numbers on which the same operations are done.
pub(crate) trait Lanes: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    /// The same number in every lane.
    fn splat(x: f64) -> Self;

    /// Sine and cosine, to about one unit in the last place.
    fn sin_cos(self) -> (Self, Self);

    /// Hyperbolic tangent, to a few units in the last place.
    fn tanh(self) -> Self;
}

impl Lanes for f64 {
    #[inline(always)]
    fn splat(x: f64) -> f64 {
        x
    }

    #[inline(always)]
    fn sin_cos(self) -> (f64, f64) {
        if self.abs() < REDUCED {
            let (turns, s, c) = reduced(self);
            quadrant(turns, s, c)
        } else {
            f64::sin_cos(self)
        }
    }

    #[inline(always)]
    fn tanh(self) -> f64 {
        let (n, p) = exp_m1_parts(doubled(self));
        tanh_of(self, n, p)
    }
}

impl Lanes for Pair {
    #[inline(always)]
    fn splat(x: f64) -> Pair {
        Pair::splat(x)
    }

    #[inline(always)]
    fn sin_cos(self) -> (Pair, Pair) {
        let x = self.to_array();
        let ((s0, c0), (s1, c1)) = if x[0].abs() < REDUCED && x[1].abs() < REDUCED {
            let (turns, s, c) = reduced(self);
            let (turns, s, c) = (turns.to_array(), s.to_array(), c.to_array());
            (quadrant(turns[0], s[0], c[0]), quadrant(turns[1], s[1], c[1]))
        } else {
            (Lanes::sin_cos(x[0]), Lanes::sin_cos(x[1]))
        };
        (Pair::new([s0, s1]), Pair::new([c0, c1]))
    }

    #[inline(always)]
    fn tanh(self) -> Pair {
        let x = self.to_array();
        let (n, p) = exp_m1_parts(Pair::new(x.map(doubled)));
        let (n, p) = (n.to_array(), p.to_array());
        Pair::new([tanh_of(x[0], n[0], p[0]), tanh_of(x[1], n[1], p[1])])
    }
}

/// Angles below this \[rad\] are reduced exactly: their number of quarter turns has at most 20 bits.
const REDUCED: f64 = 1.6e6;
/// Added to a number of less than 2⁵¹, leaves the nearest integer in the lowest bits.
const TO_INTEGER: f64 = 6_755_399_441_055_744.0;
/// π/2 in three parts; products of the first two with a 20-bit integer are exact (fdlibm, e_rem_pio2.c).
const QUARTER: [f64; 3] = [1.570_796_326_734_125_6, 6.077_100_506_303_966e-11, 2.022_266_248_795_950_6e-21];
/// Minimax polynomials on ±π/4 (fdlibm, k_sin.c and k_cos.c).
const SIN: [f64; 6] = [
    -1.666_666_666_666_663_2e-1,
    8.333_333_333_322_49e-3,
    -1.984_126_982_985_795e-4,
    2.755_731_370_707_006_8e-6,
    -2.505_076_025_340_686_3e-8,
    1.589_690_995_211_55e-10,
];
const COS: [f64; 6] = [
    4.166_666_666_666_66e-2,
    -1.388_888_888_887_411e-3,
    2.480_158_728_947_673e-5,
    -2.755_731_435_139_066_3e-7,
    2.087_572_321_298_175e-9,
    -1.135_964_755_778_82e-11,
];

/// Number of quarter turns (in the lowest bits, see [`TO_INTEGER`]), sine and cosine of what remains of `x`.
#[inline(always)]
fn reduced<T: Lanes>(x: T) -> (T, T, T) {
    let turns = x * T::splat(std::f64::consts::FRAC_2_PI) + T::splat(TO_INTEGER);
    let n = turns - T::splat(TO_INTEGER);
    let r = ((x - n * T::splat(QUARTER[0])) - n * T::splat(QUARTER[1])) - n * T::splat(QUARTER[2]);
    let z = r * r;
    let z2 = z * z;
    let polynomial = |c: &[f64; 6]| {
        let pair = |k: usize| T::splat(c[k]) + z * T::splat(c[k + 1]);
        pair(0) + z2 * (pair(2) + z2 * pair(4))
    };
    let s = r + r * z * polynomial(&SIN);
    let c = (T::splat(1.0) - T::splat(0.5) * z) + z * z * polynomial(&COS);
    (turns, s, c)
}

/// Turns sine and cosine of the remainder by the quarter turns.
#[inline(always)]
fn quadrant(turns: f64, s: f64, c: f64) -> (f64, f64) {
    let (n, s, c) = (turns.to_bits(), s.to_bits(), c.to_bits());
    let swap = (s ^ c) & 0_u64.wrapping_sub(n & 1);
    let sign = |n: u64| (n & 2) << 62;
    (f64::from_bits(s ^ swap ^ sign(n)), f64::from_bits(c ^ swap ^ sign(n + 1)))
}

/// tanh is 1 to the last digit beyond half of this.
const SATURATED: f64 = 44.0;
/// ln 2 in two parts; the product of the first with a 7-bit integer is exact (fdlibm, s_expm1.c).
const LN_2: [f64; 2] = [6.931_471_803_691_238e-1, 1.908_214_929_270_587_7e-10];
/// 1/k! for k = 3 to 14: the series of eʳ − 1 − r − r²/2, below 2⁻⁵³ of eʳ − 1 beyond that for |r| ≤ ln 2/2.
const FACTORIALS: [f64; 12] = [
    1.0 / 6.0,
    1.0 / 24.0,
    1.0 / 120.0,
    1.0 / 720.0,
    1.0 / 5040.0,
    1.0 / 40_320.0,
    1.0 / 362_880.0,
    1.0 / 3_628_800.0,
    1.0 / 39_916_800.0,
    1.0 / 479_001_600.0,
    1.0 / 6_227_020_800.0,
    1.0 / 87_178_291_200.0,
];

/// 2|x|, no more than where the hyperbolic tangent is one. NaN stays.
#[inline(always)]
fn doubled(x: f64) -> f64 {
    let y = 2.0 * x.abs();
    if y > SATURATED { SATURATED } else { y }
}

/// n (in the lowest bits, see [`TO_INTEGER`]) and `eʳ − 1` with `x = n·ln 2 + r`.
#[inline(always)]
fn exp_m1_parts<T: Lanes>(x: T) -> (T, T) {
    let shifted = x * T::splat(std::f64::consts::LOG2_E) + T::splat(TO_INTEGER);
    let n = shifted - T::splat(TO_INTEGER);
    let r = (x - n * T::splat(LN_2[0])) - n * T::splat(LN_2[1]);
    let (r2, pair) = (r * r, |k: usize| T::splat(FACTORIALS[k]) + r * T::splat(FACTORIALS[k + 1]));
    let (low, high) = (pair(0) + r2 * pair(2), pair(4) + r2 * pair(6));
    let (r4, top) = (r2 * r2, pair(8) + r2 * pair(10));
    let tail = low + r4 * (high + r4 * top);
    (shifted, r + r2 * (T::splat(0.5) + r * tail))
}

/// `tanh x = t/(t + 2)` with `t = e^2x − 1 = 2ⁿ·p + (2ⁿ − 1)`, odd in x.
#[inline(always)]
fn tanh_of(x: f64, n: f64, p: f64) -> f64 {
    let scale = f64::from_bits((n.to_bits() << 52).wrapping_add(1023 << 52));
    let t = scale * p + (scale - 1.0);
    (t / (t + 2.0)).copysign(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sine_and_cosine_are_those_of_the_standard_library() {
        let mut angles: Vec<f64> = (-40_000..40_000).map(|k| f64::from(k) * 0.25 + 1e-3).collect();
        angles.extend((-64..64).map(|k| f64::from(k) * std::f64::consts::FRAC_PI_4));
        angles.extend([0.0, 1e-300, 1.5e6, 1.7e6, 1e15]);
        for x in angles {
            let (s, c) = Lanes::sin_cos(x);
            let (es, ec) = f64::sin_cos(x);
            assert!((s - es).abs() <= 2.3e-16 && (c - ec).abs() <= 2.3e-16, "{x}: {s} {c}, expected {es} {ec}");
            // What the other lane holds does not matter.
            for other in [0.3, 1e9, f64::NAN] {
                let (ps, pc) = Lanes::sin_cos(Pair::new([other, x]));
                assert_eq!((ps.to_array()[1], pc.to_array()[1]), (s, c), "{x} beside {other}");
            }
        }
        assert!(Lanes::sin_cos(f64::NAN).0.is_nan() && Lanes::sin_cos(f64::INFINITY).1.is_nan());
    }

    #[test]
    fn hyperbolic_tangent_is_that_of_the_standard_library() {
        for k in -60_000..60_000 {
            for x in [f64::from(k) * 4e-4, f64::from(k) * 1e-8] {
                let (found, expected) = (Lanes::tanh(x), x.tanh());
                assert!((found - expected).abs() <= 4.0 * f64::EPSILON * expected.abs(), "{x}: {found} vs {expected}");
                assert_eq!(Lanes::tanh(Pair::new([x, 0.5])).to_array()[0], found);
                assert_eq!(Lanes::tanh(-x), -found);
            }
        }
        assert_eq!([1e3, -f64::INFINITY, 0.0].map(Lanes::tanh), [1.0, -1.0, 0.0]);
        assert!(Lanes::tanh(f64::NAN).is_nan());
    }
}
