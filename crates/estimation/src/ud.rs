//! Recursive least squares in factored covariance form (Bierman 1977, Factorization Methods for Discrete Sequential
//! Estimation, ch. V): the paper's RLS, and the comparison beside every other estimator.

use crate::linear::{axpy, dot, dot_four};
use crate::memory::Carry;
use multiversion::{inherit_target, multiversion};
use std::ops::Range;

/// Columns of U that lie together, all as long as the last of them.
const BLOCK: usize = 4;

/// `P = U·D·Uᵀ` with U unit upper triangular: the covariance over the noise variance.
#[derive(Clone, Debug)]
pub struct UdFilter {
    n: usize,
    /// U transposed: row j holds column j of U up to its diagonal, so that the update runs along rows; see [`block`].
    columns: Vec<f64>,
    d: Vec<f64>,
    x: Vec<f64>,
    start: Vec<f64>,
    largest: Vec<f64>,
    /// v, then the gain k.
    gain: Vec<f64>,
    lambda: Vec<f64>,
    f: Vec<f64>,
    alpha: Vec<f64>,
}

/// Covariances stop growing at this multiple of their start: forgetting without excitation grows them exponentially
/// (wind-up), and an overflow would never heal.
const WIND_UP_LIMIT: f64 = 1e8;

impl UdFilter {
    /// Starts at `x` with the diagonal covariance `variance` (over the noise variance), both of n entries.
    #[must_use]
    pub fn new(x: &[f64], variance: &[f64]) -> UdFilter {
        let n = x.len();
        let mut filter = UdFilter {
            n,
            columns: vec![0.0; block(n.div_ceil(BLOCK)).start],
            d: variance.to_vec(),
            x: x.to_vec(),
            start: variance.to_vec(),
            largest: variance.iter().map(|v| v * WIND_UP_LIMIT).collect(),
            gain: vec![0.0; n],
            lambda: vec![0.0; n],
            f: vec![0.0; n],
            alpha: vec![0.0; n],
        };
        filter.reset(x);
        filter
    }

    /// Back to the covariance of the start, at `x`.
    pub fn reset(&mut self, x: &[f64]) {
        self.x.copy_from_slice(x);
        self.d.copy_from_slice(&self.start);
        self.columns.fill(0.0);
        for i in 0..self.n {
            self.columns[column(i).start + i] = 1.0;
        }
    }

    pub(crate) fn carry(&mut self, carry: &mut Carry<'_>) {
        carry.numbers(&mut self.columns);
        carry.sizes(&mut self.d);
        carry.numbers(&mut self.x);
    }

    /// Goes on with the covariance of the start, and the limit of wind-up, of `fresh`.
    pub(crate) fn reconfigure(&mut self, fresh: &mut UdFilter) {
        std::mem::swap(&mut self.start, &mut fresh.start);
        std::mem::swap(&mut self.largest, &mut fresh.largest);
    }

    /// Gives the past the weight `lambda` in (0, 1].
    pub fn forget(&mut self, lambda: f64) {
        for (d, &largest) in self.d.iter_mut().zip(&self.largest) {
            *d = (*d / lambda).min(largest);
        }
    }

    /// Takes in one equation `y = rowᵀ·x + e` with noise variance 1. Real-time safe; returns the innovation.
    ///
    /// Bierman's update: with `f = Uᵀ·row`, `v = D·f`, `α₀ = 1`, for j = 1..n
    ///
    /// ```text
    /// αⱼ = αⱼ₋₁ + fⱼ·vⱼ,  dⱼ ← dⱼ·αⱼ₋₁/αⱼ,  λⱼ = −fⱼ/αⱼ₋₁
    /// for i < j:  u = Uᵢⱼ,  Uᵢⱼ ← u + kᵢ·λⱼ,  kᵢ ← kᵢ + u·vⱼ;   kⱼ = vⱼ
    /// x ← x + k·(y − rowᵀx)/αₙ
    /// ```
    pub fn update(&mut self, row: &[f64], y: f64) -> f64 {
        let innovation = y - dot(row, &self.x);
        project(&self.columns, row, &mut self.f);
        let alpha = scan(&self.f, &mut self.alpha, &mut self.d, &mut self.gain, &mut self.lambda);
        turn(&mut self.columns, &mut self.gain, &self.lambda);
        axpy(innovation / alpha, &self.gain, &mut self.x);
        innovation
    }

    /// The estimate.
    #[must_use]
    pub fn values(&self) -> &[f64] {
        &self.x
    }

    /// Variance of parameter `i` over the noise variance: `Σⱼ Uᵢⱼ²·dⱼ`.
    #[must_use]
    pub fn variance(&self, i: usize) -> f64 {
        (i..self.n).map(|j| self.columns[column(j).start + i].powi(2) * self.d[j]).sum()
    }

    /// Columns of U down to the diagonal, each with its entry of D: `P = Σ d·u·uᵀ`.
    pub(crate) fn factors(&self) -> impl Iterator<Item = (&[f64], f64)> {
        self.d.iter().enumerate().map(|(j, d)| (&self.columns[column(j)], *d))
    }

    /// Sum of all variances over the noise variance: the trace of P.
    #[must_use]
    pub fn trace(&self) -> f64 {
        self.factors().map(|(column, d)| d * dot(column, column)).sum()
    }

    /// Largest over smallest entry of D. P is at least as ill-conditioned: its eigenvalues enclose D.
    #[must_use]
    pub fn least_condition(&self) -> f64 {
        let (low, high) = self.d.iter().fold((f64::INFINITY, 0.0_f64), |(low, high), d| (low.min(*d), high.max(*d)));
        high / low
    }

    /// Whether every number is finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.x.iter().chain(&self.d).all(|v| v.is_finite())
    }
}

/// Where block b of four columns lies: each column takes as much room as the longest of them, so that they are equally far apart
/// and nearly no room is wasted.
#[inline(always)]
fn block(b: usize) -> Range<usize> {
    let before = |b: usize| BLOCK * BLOCK * b * (b + 1) / 2;
    before(b)..before(b + 1)
}

/// Where column j lies, down to the diagonal.
#[inline(always)]
fn column(j: usize) -> Range<usize> {
    let start = block(j / BLOCK).start + j % BLOCK * width(j);
    start..start + j + 1
}

/// Room that a column of the block of column j takes.
#[inline(always)]
fn width(j: usize) -> usize {
    (j / BLOCK + 1) * BLOCK
}

/// `f = Uᵀ·row`
#[multiversion(targets("x86_64+avx+avx2"))]
fn project(columns: &[f64], row: &[f64], f: &mut [f64]) {
    let n = f.len();
    let whole = n - n % BLOCK;
    for start in (0..whole).step_by(BLOCK) {
        let (block, w) = (&columns[block(start / BLOCK)], width(start));
        let above = [&block[..start], &block[w..w + start], &block[2 * w..2 * w + start], &block[3 * w..3 * w + start]];
        let mut sums = dot_four(above, &row[..start]);
        let corner =
            [&block[start..w], &block[w + start..2 * w], &block[2 * w + start..3 * w], &block[3 * w + start..]];
        if let Some(own) = row[start..].first_chunk::<BLOCK>() {
            for (k, (sum, column)) in sums.iter_mut().zip(corner).enumerate() {
                for (u, x) in column[..k].iter().zip(own) {
                    *sum += u * x;
                }
                *sum += own[k];
            }
        }
        f[start..start + BLOCK].copy_from_slice(&sums);
    }
    for j in whole..n {
        f[j] = dot(&columns[column(j)][..j], &row[..j]) + row[j];
    }
}

/// α (each the one before its entry), v, λ and the new D of Bierman's update; returns αₙ.
#[multiversion(targets("x86_64+avx+avx2"))]
fn scan(f: &[f64], alpha: &mut [f64], d: &mut [f64], gain: &mut [f64], lambda: &mut [f64]) -> f64 {
    let mut last = 1.0;
    for ((alpha, f), d) in alpha.iter_mut().zip(f).zip(&*d) {
        *alpha = last;
        last += f * (d * f);
    }
    // Quotients that do not wait for each other go side by side.
    let mut after = last;
    for j in (0..f.len()).rev() {
        (lambda[j], after) = (after, alpha[j]);
    }
    for ((((k, l), d), f), before) in gain.iter_mut().zip(lambda).zip(d).zip(f).zip(&*alpha) {
        *k = *d * *f;
        *d *= before / *l;
        *l = -*f / before;
    }
    last
}

/// Bierman's update of U and k, from k = v on. Four columns at a time: k is read and written once for all of them.
#[multiversion(targets("x86_64+avx+avx2"))]
fn turn(columns: &mut [f64], gain: &mut [f64], lambda: &[f64]) {
    #[inline(always)]
    fn step(u: &mut f64, k: &mut f64, lambda: f64, v: f64) {
        let old = *u;
        *u = old + *k * lambda;
        *k += old * v;
    }

    /// One block, of which `above` are the gains before its own. A call for each: within a loop over blocks of growing columns the
    /// compiler keeps some forty addresses up to date, which takes as long as the update.
    #[inherit_target]
    #[inline(never)]
    fn one(block: &mut [f64], above: &mut [f64], own: &mut [f64; BLOCK], lambdas: &[f64; BLOCK]) {
        let start = above.len();
        let (v, [a, b, c, d]) = (*own, four(block, start + BLOCK));
        let fours = above.as_chunks_mut::<BLOCK>().0.iter_mut();
        let fours = fours.zip(a.as_chunks_mut().0).zip(b.as_chunks_mut().0);
        for ((((k, a), b), c), d) in fours.zip(c.as_chunks_mut().0).zip(d.as_chunks_mut().0) {
            let mut gain = *k;
            for (column, (l, v)) in [a, b, c, d].into_iter().zip(lambdas.iter().zip(&v)) {
                let mut u: [f64; BLOCK] = *column;
                for i in 0..BLOCK {
                    step(&mut u[i], &mut gain[i], *l, *v);
                }
                *column = u;
            }
            *k = gain;
        }
        // Within the block.
        let mut gain = *own;
        for (k, column) in [a, b, c, d].into_iter().enumerate() {
            if let Some(corner) = column[start..].first_chunk_mut::<BLOCK>() {
                for i in 0..k {
                    step(&mut corner[i], &mut gain[i], lambdas[k], v[k]);
                }
            }
        }
        *own = gain;
    }

    let n = gain.len();
    let whole = n - n % BLOCK;
    // Whole fours of entries: `start` is a multiple of them.
    for start in (0..whole).step_by(BLOCK) {
        let (above, own) = gain.split_at_mut(start);
        if let (Some(own), Some(lambdas)) = (own.first_chunk_mut(), lambda[start..].first_chunk()) {
            one(&mut columns[block(start / BLOCK)], above, own, lambdas);
        }
    }
    for j in whole..n {
        let (above, v) = gain.split_at_mut(j);
        above.iter_mut().zip(&mut columns[column(j)]).for_each(|(k, u)| step(u, k, lambda[j], v[0]));
    }
}

/// The columns of a whole block.
#[inline(always)]
fn four(block: &mut [f64], w: usize) -> [&mut [f64]; BLOCK] {
    let (a, rest) = block.split_at_mut(w);
    let (b, rest) = rest.split_at_mut(w);
    let (c, d) = rest.split_at_mut(w);
    [a, b, c, d]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linear::tests::Random;
    use crate::lu::Lu;

    /// UD against the weighted normal equations with the prior: P⁻¹ = λᴺP₀⁻¹ + Σ λ^(N−i) d·dᵀ.
    #[test]
    fn ud_equals_batch() {
        let (n, rows) = (12, 300);
        for lambda in [1.0, 0.99] {
            let mut random = Random(11);
            let truth: Vec<f64> = (0..n).map(|_| 3.0 * random.normal()).collect();
            let start: Vec<f64> = truth.iter().map(|t| 0.7 * t).collect();
            let variance: Vec<f64> = (0..n).map(|i| 1.0 + i as f64).collect();
            let mut ud = UdFilter::new(&start, &variance);
            let (mut info, mut right) = (vec![0.0; n * n], vec![0.0; n]);
            for i in 0..n {
                info[i * n + i] = 1.0 / variance[i];
                right[i] = start[i] / variance[i];
            }
            for _ in 0..rows {
                let row: Vec<f64> = (0..n).map(|i| (1.0 + i as f64) * random.normal()).collect();
                let y = crate::linear::dot(&row, &truth) + random.normal();
                ud.forget(lambda);
                ud.update(&row, y);
                for v in info.iter_mut().chain(&mut right) {
                    *v *= lambda;
                }
                for i in 0..n {
                    axpy(row[i], &row, &mut info[i * n..(i + 1) * n]);
                }
                axpy(y, &row, &mut right);
            }
            let mut lu = Lu::new(n);
            lu.start(n).copy_from_slice(&info);
            while !lu.advance() {}
            let mut batch = right.clone();
            lu.solve(&mut batch);
            for i in 0..n {
                assert!((ud.values()[i] - batch[i]).abs() < 1e-9 * (1.0 + batch[i].abs()));
                let mut unit = vec![0.0; n];
                unit[i] = 1.0;
                lu.solve(&mut unit);
                assert!((ud.variance(i) - unit[i]).abs() < 1e-9 * unit[i]);
            }
        }
    }

    /// Forgetting without excitation winds the covariance up; here it stops while numbers are still usable.
    #[test]
    fn wind_up_is_bounded() {
        let mut ud = UdFilter::new(&[1.0, 2.0], &[1.0, 1.0]);
        for _ in 0..1_000_000 {
            ud.forget(0.9);
            ud.update(&[1.0, 0.0], 1.0);
        }
        assert!(ud.is_finite() && ud.variance(1) <= WIND_UP_LIMIT && ud.values() == [1.0, 2.0]);
    }
}
