//! LU factors with partial pivoting, in steps of bounded work; nothing allocates after `new`.

use crate::kernels::{eliminate, solve_transposed};
use crate::linear::{Budget, axpy, dot};

/// LU factors with partial pivoting of a matrix of up to the size given to `new`.
#[derive(Clone, Debug)]
pub(crate) struct Lu {
    n: usize,
    a: Vec<f64>,
    /// Row that was swapped with row k.
    swaps: Vec<usize>,
    /// Columns that are eliminated.
    done: usize,
    smallest_allowed: f64,
    singular: bool,
}

impl Lu {
    pub(crate) fn new(capacity: usize) -> Lu {
        Lu {
            n: 0,
            a: vec![0.0; capacity * capacity],
            swaps: vec![0; capacity],
            done: 0,
            smallest_allowed: 0.0,
            singular: true,
        }
    }

    /// Without memory of its own, which [`lend`](Self::lend) brings for a time.
    pub(crate) fn borrowing(capacity: usize) -> Lu {
        Lu { a: Vec::new(), ..Lu::new(capacity) }
    }

    /// Memory for the factors, as large as the capacity asks for; what it holds is overwritten.
    pub(crate) fn lend(&mut self, memory: Vec<f64>) {
        self.a = memory;
    }

    /// The memory that was lent; there are no factors any more.
    pub(crate) fn reclaim(&mut self) -> Vec<f64> {
        (self.n, self.singular) = (0, true);
        std::mem::take(&mut self.a)
    }

    /// Begins a factorisation of size `n`; returns the place for its matrix.
    pub(crate) fn start(&mut self, n: usize) -> &mut [f64] {
        self.n = n;
        self.done = 0;
        self.singular = false;
        self.smallest_allowed = -1.0;
        &mut self.a[..n * n]
    }

    /// Row `i` of the matrix in place of its factors, complete as they are: from the last row to the first, and then
    /// [`unswap`](Self::unswap). Rounding is that of the factorisation. `room`: as many entries as a row has.
    pub(crate) fn multiply_back(&mut self, i: usize, room: &mut [f64]) {
        let n = self.n;
        let (above, row) = self.a[..(i + 1) * n].split_at_mut(i * n);
        room[..i].copy_from_slice(&row[..i]);
        row[..i].fill(0.0);
        for (k, (factor, above)) in room[..i].iter().zip(above.chunks_exact(n)).enumerate() {
            axpy(*factor, &above[k..], &mut row[k..]);
        }
    }

    /// Rows that were multiplied back go where they were before pivots were chosen.
    pub(crate) fn unswap(&mut self) -> &mut [f64] {
        let n = self.n;
        for k in (0..n).rev() {
            let p = self.swaps[k];
            if p != k {
                let (upper, lower) = self.a.split_at_mut(p * n);
                upper[k * n..(k + 1) * n].swap_with_slice(&mut lower[..n]);
            }
        }
        &mut self.a[..n * n]
    }

    /// The place of the matrix again, between `start` and the first `advance`.
    pub(crate) fn matrix(&mut self) -> &mut [f64] {
        &mut self.a[..self.n * self.n]
    }

    /// Does one step of work; true when the factors are complete (or the matrix turned out singular).
    pub(crate) fn advance(&mut self) -> bool {
        self.advance_within(&mut Budget::step())
    }

    /// The same with what is left of a step.
    pub(crate) fn advance_within(&mut self, budget: &mut Budget) -> bool {
        let n = self.n;
        let a = &mut self.a[..n * n];
        if self.smallest_allowed < 0.0 {
            let largest = a.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
            // A pivot that is rounding of the largest entry says nothing.
            self.smallest_allowed = largest * n as f64 * f64::EPSILON;
            self.singular = !largest.is_finite() || (n > 0 && largest == 0.0);
        }
        while self.done < n && !budget.is_spent() && !self.singular {
            let k = self.done;
            let mut p = k;
            for i in k + 1..n {
                if a[i * n + k].abs() > a[p * n + k].abs() {
                    p = i;
                }
            }
            let pivot = a[p * n + k];
            let usable = pivot.abs() > self.smallest_allowed;
            if !usable {
                self.singular = true;
                break;
            }
            self.swaps[k] = p;
            if p != k {
                let (upper, lower) = a.split_at_mut(p * n);
                upper[k * n..(k + 1) * n].swap_with_slice(&mut lower[..n]);
            }
            let (above, below) = a.split_at_mut((k + 1) * n);
            let row_k = &above[k * n..];
            eliminate(&row_k[..n], k, below, n);
            self.done += 1;
            budget.charge((n - k) * (n - k));
        }
        self.singular || self.done == n
    }

    pub(crate) fn is_singular(&self) -> bool {
        self.singular
    }

    /// Diagonal of U; their product is the determinant but for its sign.
    pub(crate) fn pivots(&self) -> impl Iterator<Item = f64> + '_ {
        (0..self.n).map(|k| self.a[k * self.n + k])
    }

    /// `b ← A⁻¹·b`
    pub(crate) fn solve(&self, b: &mut [f64]) {
        let n = self.n;
        for k in 0..n {
            b.swap(k, self.swaps[k]);
        }
        for i in 1..n {
            b[i] -= dot(&self.a[i * n..i * n + i], &b[..i]);
        }
        for i in (0..n).rev() {
            let row = &self.a[i * n..(i + 1) * n];
            b[i] = (b[i] - dot(&row[i + 1..], &b[i + 1..n])) / row[i];
        }
    }

    /// `b ← A⁻ᵀ·b`
    pub(crate) fn solve_transposed(&self, b: &mut [f64]) {
        self.solve_transposed_from(b, 0);
    }

    /// The same where the first `from` entries of b are zeros.
    pub(crate) fn solve_transposed_from(&self, b: &mut [f64], from: usize) {
        let n = self.n;
        solve_transposed(&self.a[..n * n], &mut b[..n], from);
        for k in (0..n).rev() {
            b.swap(k, self.swaps[k]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linear::tests::Random;

    #[test]
    fn lu_solves_both_ways() {
        let mut random = Random(3);
        for n in [1, 2, 7, 60] {
            let a: Vec<f64> = (0..n * n).map(|_| random.normal()).collect();
            let x: Vec<f64> = (0..n).map(|_| random.normal()).collect();
            let mut lu = Lu::new(64);
            lu.start(n).copy_from_slice(&a);
            while !lu.advance() {}
            assert!(!lu.is_singular());
            let mut b: Vec<f64> = a.chunks_exact(n).map(|row| dot(row, &x)).collect();
            lu.solve(&mut b);
            let mut c: Vec<f64> = (0..n).map(|j| (0..n).map(|i| a[i * n + j] * x[i]).sum()).collect();
            lu.solve_transposed(&mut c);
            let mut room = vec![0.0; n];
            (0..n).rev().for_each(|i| lu.multiply_back(i, &mut room));
            assert!(lu.unswap().iter().zip(&a).all(|(found, a)| (found - a).abs() < 1e-12), "{n}: multiplied back");
            for i in 0..n {
                // condition numbers of these seeded matrices stay below 1e4
                assert!((b[i] - x[i]).abs() < 1e-10 && (c[i] - x[i]).abs() < 1e-10, "{n}: {} {} {}", b[i], c[i], x[i]);
            }
        }
    }

    #[test]
    fn singular_and_bad_matrices_are_reported() {
        for a in [[1.0, 2.0, 2.0, 4.0], [0.0; 4], [f64::NAN, 1.0, 1.0, 1.0], [f64::INFINITY, 1.0, 1.0, 1.0]] {
            let mut lu = Lu::new(2);
            lu.start(2).copy_from_slice(&a);
            while !lu.advance() {}
            assert!(lu.is_singular(), "{a:?}");
        }
    }
}
