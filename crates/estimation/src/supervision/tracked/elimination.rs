//! Elimination of the cross matrix in a given order, where a pivot may be left out when its turn comes.

use crate::linear::axpy;
use crate::operations::{multiply_adds, writes};
use multiversion::multiversion;

/// U with pivots on the diagonal, L below, rows padded with zeros. What is left out is a row and a column of the identity.
#[derive(Clone, Debug)]
pub(super) struct Elimination {
    n: usize,
    stride: usize,
    lu: Vec<f64>,
    /// Right-hand side, then `L⁻¹` of it, then the solution, in the order of elimination.
    pub(super) step: Vec<f64>,
    /// Variance of each unknown, as [`back_substitute`](Self::back_substitute) found it.
    pub(super) variance: Vec<f64>,
    /// Scale of the first pivot of a pair, kept until the second is decided: both are taken off the rest at once.
    first: f64,
}

impl Elimination {
    pub(super) fn new(n: usize, stride: usize) -> Elimination {
        Elimination {
            n,
            stride,
            lu: vec![0.0; n * stride],
            step: vec![0.0; stride],
            variance: vec![0.0; stride],
            first: 0.0,
        }
    }

    pub(super) fn restart(&mut self) {
        self.lu.fill(0.0);
    }

    /// Begins with rows and columns `order` of `matrix`; those that are not active are left out.
    pub(super) fn load(&mut self, order: &[usize], active: &[bool], matrix: &[f64], right: &[f64]) {
        let stride = self.stride;
        for (place, (out, &k)) in self.lu.chunks_exact_mut(stride).zip(order).enumerate() {
            let row = &matrix[k * stride..(k + 1) * stride];
            let is_active = f64::from(u8::from(active[k]));
            for (out, &l) in out.iter_mut().zip(order) {
                *out = if active[l] { is_active * row[l] } else { 0.0 };
            }
            out[place] = if active[k] { out[place] } else { 1.0 };
            self.step[place] = is_active * right[k];
        }
    }

    /// What unknown `place` adds to those before it.
    pub(super) fn pivot(&self, place: usize) -> f64 {
        self.lu[place * self.stride + place]
    }

    /// Takes unknown `place` in, or leaves it out. To be called for every place in turn.
    pub(super) fn advance(&mut self, place: usize, kept: bool) {
        let stride = self.stride;
        if !kept {
            writes(stride + place);
            let row = &mut self.lu[place * stride..(place + 1) * stride];
            // Factors of places before it are no longer wanted either: it has no equation.
            row.fill(0.0);
            row[place] = 1.0;
            self.step[place] = 0.0;
            for above in self.lu.chunks_exact_mut(stride).take(place) {
                above[place] = 0.0;
            }
        }
        let scale = if kept { 1.0 / self.pivot(place) } else { 0.0 };
        let alone = place.is_multiple_of(2) && place + 1 == self.n;
        if place.is_multiple_of(2) && !alone {
            // The row after it must know at once; the rest waits for that row's own pivot.
            self.first = scale;
            let (above, below) = self.lu.split_at_mut((place + 1) * stride);
            let (row, next) = (&above[place * stride..], &mut below[..stride]);
            let factor = next[place] * scale;
            next[place] = factor;
            axpy(-factor, &row[place + 1..], &mut next[place + 1..]);
            self.step[place + 1] -= factor * self.step[place];
        } else if !alone {
            eliminate_pair(&mut self.lu, &mut self.step, stride, place - 1, [self.first, scale]);
        }
    }

    /// Solves for unknown `place`, all later ones being solved for; `own` is the variance of its equation. Returns the
    /// variance of the unknown, those of later ones counted as independent.
    pub(super) fn back_substitute(&mut self, place: usize, own: f64) -> f64 {
        let row = &self.lu[place * self.stride..(place + 1) * self.stride];
        let [known, later] = later_shares(&row[place + 1..], &self.step[place + 1..], &self.variance[place + 1..]);
        let inverse = 1.0 / row[place];
        self.step[place] = (self.step[place] - known) * inverse;
        // What is left out has neither an equation nor entries.
        self.variance[place] = (own + later) * inverse * inverse;
        self.variance[place]
    }

    /// `x ← (LU)⁻ᵀ·x` in the order of elimination.
    pub(super) fn solve_transposed(&self, x: &mut [f64]) {
        solve_transposed(&self.lu, self.stride, &mut x[..self.n]);
    }
}

/// Takes the two pivots at `place` off all rows below them.
#[multiversion(targets("x86_64+avx+avx2"))]
fn eliminate_pair(lu: &mut [f64], step: &mut [f64], stride: usize, place: usize, scale: [f64; 2]) {
    let (above, below) = lu.split_at_mut((place + 2) * stride);
    let (first, second) = above[place * stride..].split_at(stride);
    let (at_first, at_second) = (step[place], step[place + 1]);
    let between = first[place + 1];
    let from = place + 2;
    let (first, second) = (&first[from..], &second[from..stride]);
    for (row, step) in below.chunks_exact_mut(stride).zip(&mut step[from..]) {
        let f = row[place] * scale[0];
        let g = (row[place + 1] - f * between) * scale[1];
        (row[place], row[place + 1]) = (f, g);
        multiply_adds(2 * (row.len() - from) + 4);
        for ((x, a), b) in row[from..].iter_mut().zip(first).zip(second) {
            *x -= f * a + g * b;
        }
        *step -= f * at_first + g * at_second;
    }
}

/// `Σ u·x` and `Σ u²·v`.
#[multiversion(targets("x86_64+avx+avx2"))]
fn later_shares(u: &[f64], x: &[f64], v: &[f64]) -> [f64; 2] {
    let (mut known, mut later) = ([0.0; 4], [0.0; 4]);
    let (us, rest) = u.as_chunks::<4>();
    let from = u.len() - rest.len();
    multiply_adds(2 * u.len());
    for ((u, x), v) in us.iter().zip(x.as_chunks::<4>().0).zip(v.as_chunks::<4>().0) {
        for i in 0..4 {
            known[i] += u[i] * x[i];
            later[i] += u[i] * u[i] * v[i];
        }
    }
    for (i, u) in rest.iter().enumerate() {
        known[i] += u * x[from + i];
        later[i] += u * u * v[from + i];
    }
    [known, later].map(|s| (s[0] + s[2]) + (s[1] + s[3]))
}

#[multiversion(targets("x86_64+avx+avx2"))]
fn solve_transposed(lu: &[f64], stride: usize, x: &mut [f64]) {
    let n = x.len();
    // First Uᵀ, then Lᵀ.
    for place in 0..n {
        let row = &lu[place * stride..place * stride + n];
        let value = x[place] / row[place];
        x[place] = value;
        axpy(-value, &row[place + 1..], &mut x[place + 1..]);
    }
    for place in (1..n).rev() {
        let value = x[place];
        axpy(-value, &lu[place * stride..place * stride + place], &mut x[..place]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linear::dot;
    use crate::linear::tests::Random;

    /// Solutions, forwards and transposed, are those of the system without what was left out: from the start or on the way.
    #[test]
    fn what_is_left_out_is_not_there() {
        let mut random = Random(21);
        for n in [1, 2, 5, 8, 17] {
            let stride = usize::next_multiple_of(n, 4);
            let mut matrix = vec![0.0; n * stride];
            for i in 0..n {
                for j in 0..n {
                    matrix[i * stride + j] = 0.3 * random.normal() + if i == j { 4.0 } else { 0.0 };
                }
            }
            let right: Vec<f64> = (0..stride).map(|_| random.normal()).collect();
            let order: Vec<usize> = (0..n).rev().collect();
            let active: Vec<bool> = (0..n).map(|k| k % 4 != 1).collect();
            let on_the_way = |k: usize| k % 5 == 3;
            let mut e = Elimination::new(n, stride);
            e.load(&order, &active, &matrix, &right);
            for (place, &k) in order.iter().enumerate() {
                e.advance(place, active[k] && !on_the_way(k));
            }
            for place in (0..n).rev() {
                e.back_substitute(place, 0.0);
            }
            let moves = |k: usize| active[k] && !on_the_way(k);
            let mut x = vec![0.0; stride];
            for (place, &k) in order.iter().enumerate() {
                x[k] = e.step[place];
                assert!(moves(k) || x[k] == 0.0);
            }
            let mut u: Vec<f64> = order.iter().map(|&k| if moves(k) { right[k] } else { 0.0 }).collect();
            e.solve_transposed(&mut u);
            let mut t = vec![0.0; stride];
            order.iter().zip(&u).for_each(|(&k, u)| t[k] = *u);
            for k in (0..n).filter(|k| moves(*k)) {
                assert!((dot(&matrix[k * stride..(k + 1) * stride], &x) - right[k]).abs() < 1e-12, "{n} {k}");
                let transposed: f64 = (0..n).map(|i| matrix[i * stride + k] * t[i]).sum();
                assert!((transposed - right[k]).abs() < 1e-12, "{n} {k} transposed");
            }
        }
    }
}
