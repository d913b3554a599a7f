//! Dense linear algebra without allocation, in steps of bounded work.
//!
//! Matrices are row-major slices; inner loops run along rows.

use crate::operations::multiply_adds;
use wide::f64x4;

/// How much arithmetic one step may do \[multiply-adds, roughly\]. Everything that takes n³ operations is cut into steps
/// of this size, so that no period of the real-time loop has to pay for all of it.
pub(crate) const STEP_WORK: usize = 100_000;

/// How many items of `cost` operations each belong in a step; at least one.
pub(crate) fn items_per_step(cost: usize) -> usize {
    (STEP_WORK / cost.max(1)).max(1)
}

/// What is left of a step: stages share it, so that a step that ends one begins the next. The last thing that is begun may
/// cost more than is left.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Budget(usize);

impl Budget {
    /// A whole step.
    pub(crate) fn step() -> Budget {
        Budget(STEP_WORK)
    }

    /// Without end, off the real-time path.
    pub(crate) fn endless() -> Budget {
        Budget(usize::MAX)
    }

    pub(crate) fn is_spent(self) -> bool {
        self.0 == 0
    }

    /// How many things of `cost` multiply-adds each are begun until it is spent.
    pub(crate) fn begun(self, cost: usize) -> usize {
        self.0.div_ceil(cost.max(1))
    }

    /// `cost` multiply-adds are done.
    pub(crate) fn charge(&mut self, cost: usize) {
        self.0 = self.0.saturating_sub(cost);
    }

    /// The step is over.
    pub(crate) fn end(&mut self) {
        self.0 = 0;
    }
}

#[inline(always)]
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    multiply_adds(a.len());
    // Eight partial sums let the compiler use vector registers; the order of additions is fixed.
    let mut sums = [0.0; 8];
    let (x, y) = (a.chunks_exact(8), b.chunks_exact(8));
    let rest: f64 = x.remainder().iter().zip(y.remainder()).map(|(a, b)| a * b).sum();
    for (x, y) in x.zip(y) {
        for k in 0..8 {
            sums[k] += x[k] * y[k];
        }
    }
    ((sums[0] + sums[4]) + (sums[1] + sums[5])) + ((sums[2] + sums[6]) + (sums[3] + sums[7])) + rest
}

/// [`dot`] of four vectors with one, to the bit, whatever their length; [`dot_four`] is quicker where it is a multiple of four, as in the
/// blocks of U.
#[inline(always)]
pub(crate) fn dots(a: [&[f64]; 4], x: &[f64]) -> [f64; 4] {
    multiply_adds(4 * x.len());
    let (eights, rest) = x.as_chunks::<8>();
    let from = x.len() - rest.len();
    let mut sums = [[f64x4::ZERO; 2]; 4];
    let [p, q, r, s] = a.map(|a| a.as_chunks::<8>().0.iter());
    for ((((x, p), q), r), s) in eights.iter().zip(p).zip(q).zip(r).zip(s) {
        let halves = |e: &[f64; 8]| [f64x4::new([e[0], e[1], e[2], e[3]]), f64x4::new([e[4], e[5], e[6], e[7]])];
        let [low, high] = halves(x);
        for (sums, a) in sums.iter_mut().zip([p, q, r, s]) {
            let [a, b] = halves(a);
            sums[0] += a * low;
            sums[1] += b * high;
        }
    }
    let mut totals = [0.0; 4];
    for ((total, sums), a) in totals.iter_mut().zip(sums).zip(a) {
        let tail_sum: f64 = a[from..].iter().zip(rest).map(|(a, x)| a * x).sum();
        let [s0, s1, s2, s3] = (sums[0] + sums[1]).to_array();
        *total = (s0 + s1) + (s2 + s3) + tail_sum;
    }
    totals
}

/// The same of numbers of fewer bits, which are widened before anything is done with them.
#[inline(always)]
pub(crate) fn dot_short<T: Copy + Into<f64>>(a: &[T], x: &[f64]) -> f64 {
    multiply_adds(x.len());
    let mut sums = [0.0; 8];
    let (a, x) = (a.chunks_exact(8), x.chunks_exact(8));
    let rest: f64 = a.remainder().iter().zip(x.remainder()).map(|(a, x)| (*a).into() * x).sum();
    for (a, x) in a.zip(x) {
        for k in 0..8 {
            sums[k] += a[k].into() * x[k];
        }
    }
    ((sums[0] + sums[4]) + (sums[1] + sums[5])) + ((sums[2] + sums[6]) + (sums[3] + sums[7])) + rest
}

/// Products of four vectors with the same one.
#[inline(always)]
pub(crate) fn dot_four(a: [&[f64]; 4], x: &[f64]) -> [f64; 4] {
    let (fours, rest) = x.as_chunks::<4>();
    let from = x.len() - rest.len();
    let mut sums = [[0.0; 4]; 4];
    let [p, q, r, s] = a.map(|a| a.as_chunks::<4>().0);
    for ((((a, b), c), d), x) in p.iter().zip(q).zip(r).zip(s).zip(fours) {
        for (sums, a) in sums.iter_mut().zip([a, b, c, d]) {
            for i in 0..4 {
                sums[i] += a[i] * x[i];
            }
        }
    }
    // Not `from_fn`, which is left a call and then has no wide registers.
    let mut totals = [0.0; 4];
    for ((total, [s0, s1, s2, s3]), a) in totals.iter_mut().zip(sums).zip(a) {
        *total = a[from..].iter().zip(rest).fold((s0 + s2) + (s1 + s3), |total, (a, x)| total + a * x);
    }
    totals
}

/// Where row i of a lower triangle lies that is stored row after row, i + 1 entries in row i.
#[inline(always)]
pub(crate) fn packed(i: usize) -> std::ops::Range<usize> {
    i * (i + 1) / 2..(i + 1) * (i + 2) / 2
}

/// `y += a·x`
#[inline(always)]
pub(crate) fn axpy(a: f64, x: &[f64], y: &mut [f64]) {
    multiply_adds(x.len());
    for (y, x) in y.iter_mut().zip(x) {
        *y += a * x;
    }
}

/// `y += a·x`, x in single precision.
#[inline(always)]
pub(crate) fn axpy_short(a: f64, x: &[f32], y: &mut [f64]) {
    multiply_adds(x.len());
    for (y, x) in y.iter_mut().zip(x) {
        *y += a * f64::from(*x);
    }
}

/// Moves rows and columns `kept` (rising) of a matrix whose rows are `stride` apart to its beginning, without gaps.
pub(crate) fn compress(matrix: &mut [f64], stride: usize, kept: &(impl Iterator<Item = usize> + Clone)) {
    let mut to = 0;
    for i in kept.clone() {
        for j in kept.clone() {
            // Never behind what is read next.
            matrix[to] = matrix[i * stride + j];
            to += 1;
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// SplitMix64, for tests of this crate.
    pub(crate) struct Random(pub(crate) u64);

    impl Random {
        pub(crate) fn unit(&mut self) -> f64 {
            self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let mut z = self.0;
            z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
        }

        /// Standard normal (Box & Muller).
        pub(crate) fn normal(&mut self) -> f64 {
            let radius = (-2.0 * (1.0 - self.unit()).ln()).sqrt();
            radius * (std::f64::consts::TAU * self.unit()).cos()
        }
    }

    #[test]
    fn rows_and_columns_move_together() {
        let mut matrix: Vec<f64> = (0..16).map(f64::from).collect();
        compress(&mut matrix, 4, &[1, 3].into_iter());
        assert_eq!(matrix[..4], [5.0, 7.0, 13.0, 15.0]);
        compress(&mut matrix, 2, &(0..2));
        assert_eq!(matrix[..4], [5.0, 7.0, 13.0, 15.0]);
    }
}
