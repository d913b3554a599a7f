//! What the entries between the directions say about each of them.

use crate::operations::multiply_adds;
use multiversion::multiversion;

/// Partial sums that a vector register holds; their order is fixed.
const LANES: usize = 4;

/// The diagonal of the information, and what goes with it, padded with zeros.
#[derive(Clone, Debug)]
pub(super) struct Diagonal {
    value: Vec<f64>,
    inverse: Vec<f64>,
    /// Variance of the value of each direction that is held; 0 of those that move.
    held: Vec<f64>,
}

impl Diagonal {
    pub(super) fn new(stride: usize) -> Diagonal {
        let zeros = || vec![0.0; stride];
        Diagonal { value: zeros(), inverse: zeros(), held: zeros() }
    }

    /// Sets the first n entries; returns the largest value.
    pub(super) fn set(&mut self, n: usize, value: impl Fn(usize) -> f64, held: impl Fn(usize) -> f64) -> f64 {
        let mut largest = 0.0_f64;
        for k in 0..n {
            let information = value(k);
            (self.value[k], self.inverse[k], self.held[k]) =
                (information, 1.0 / information.max(f64::MIN_POSITIVE), held(k));
            largest = largest.max(information);
        }
        largest
    }

    pub(super) fn value(&self, k: usize) -> f64 {
        self.value[k]
    }
}

/// Of one direction.
#[derive(Clone, Copy, Debug)]
pub(super) struct Share {
    /// How many directions have more information (of equal ones, those before it).
    pub(super) place: usize,
    /// Information it may owe to those, `Σ E_kj²/E_jj`.
    pub(super) stronger: f64,
    /// `Σ E_kj²·var(x_j)` over held ones.
    pub(super) held: f64,
}

/// Share of direction k, whose row of the information is `row`.
#[multiversion(targets("x86_64+avx+avx2"))]
pub(super) fn share(row: &[f64], diagonal: &Diagonal, k: usize, n: usize) -> Share {
    let information = diagonal.value[k];
    multiply_adds(3 * row.len());
    let [mut stronger, mut held, mut above, mut same] = [[0.0; LANES]; 4];
    let blocks = row.as_chunks::<LANES>().0.iter().zip(diagonal.value.as_chunks::<LANES>().0);
    let others = diagonal.inverse.as_chunks::<LANES>().0.iter().zip(diagonal.held.as_chunks::<LANES>().0);
    for ((e, value), (inverse, width)) in blocks.zip(others) {
        for i in 0..LANES {
            let square = e[i] * e[i];
            let more = value[i] > information;
            above[i] += if more { 1.0 } else { 0.0 };
            same[i] += if value[i] == information { 1.0 } else { 0.0 };
            stronger[i] += if more { square * inverse[i] } else { 0.0 };
            held[i] += square * width[i];
        }
    }
    let total = |x: [f64; LANES]| (x[0] + x[2]) + (x[1] + x[3]);
    // Equal ones are rare but for zeros, of which there is nothing to share.
    let before = if total(same) > 1.0 { k } else { 0 };
    let equal = diagonal.value[..before].iter().filter(|value| **value == information).count();
    Share {
        place: (total(above) as usize + equal).min(n - 1),
        stronger: total(stronger),
        held: (total(held) - row[k] * row[k] * diagonal.held[k]).max(0.0),
    }
}

/// `Σ ln x` with one logarithm: exponents are added and mantissas multiplied, at most a thousand of them.
pub(super) fn log_product(values: impl Iterator<Item = f64>) -> f64 {
    const MANTISSA: u64 = (1 << 52) - 1;
    let (mut exponents, mut product) = (0_i64, 1.0);
    for value in values {
        let bits = value.max(f64::MIN_POSITIVE).to_bits();
        exponents += (bits >> 52).cast_signed() - 1023;
        product *= f64::from_bits(bits & MANTISSA | 1.0_f64.to_bits());
    }
    exponents as f64 * std::f64::consts::LN_2 + product.ln()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linear::tests::Random;

    #[test]
    fn logarithms_add_up() {
        let values = [3.5e-200, 1.0, 0.1, 7e150, 1e-3, 42.0, 0.0];
        let expected: f64 = values.iter().map(|v: &f64| v.max(f64::MIN_POSITIVE).ln()).sum();
        assert!((log_product(values.into_iter()) / expected - 1.0).abs() < 1e-14);
    }

    #[test]
    fn shares_are_what_their_definition_says() {
        let mut random = Random(11);
        for n in [1_usize, 3, 8, 13] {
            let stride = n.next_multiple_of(LANES);
            let mut diagonal = Diagonal::new(stride);
            // Equal values among them.
            let values: Vec<f64> = (0..n).map(|_| (3.0 * random.unit()).floor()).collect();
            let widths: Vec<f64> = (0..n).map(|k| if k % 3 == 0 { 0.0 } else { random.unit() }).collect();
            diagonal.set(n, |k| values[k], |k| widths[k]);
            let mut seen = vec![false; n];
            for k in 0..n {
                let mut row: Vec<f64> = (0..n).map(|_| random.normal()).collect();
                row.resize(stride, 0.0);
                let share = share(&row, &diagonal, k, n);
                let others = || (0..n).filter(|j| *j != k);
                let stronger: f64 =
                    others().filter(|j| values[*j] > values[k]).map(|j| row[j].powi(2) / values[j]).sum();
                let resting_variance: f64 = others().map(|j| row[j].powi(2) * widths[j]).sum();
                assert!((share.stronger - stronger).abs() < 1e-12 && (share.held - resting_variance).abs() < 1e-12);
                assert!(!std::mem::replace(&mut seen[share.place], true), "two at one place");
            }
        }
    }
}
