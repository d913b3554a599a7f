//! A basis that follows the information of the instruments by Jacobi rotations (paper, 3.2.4).
//!
//! `E = V·S·Vᵀ` stays nearly diagonal while S is a moving window: each round turns disjoint pairs of neighbours so that the
//! entry between the two vanishes (Jacobi 1846) and exchanges their places. Pairs begin at even places in one round and at
//! odd ones in the next, so n rounds bring every pair together once (odd-even ordering; Stewart 1985, Luk & Park 1989), and
//! the basis goes on from one row to the next instead of beginning anew. Everything happens in place, along rows. Number
//! and order of operations do not depend on the numbers.

use crate::kernels::{Lanes, Part, add_products, full_times, times};
use crate::linear::axpy;
use crate::memory::Carry;
use crate::operations::multiply_adds;
use multiversion::{inherit_target, multiversion};
use rivet_dynamics::MAX_JOINTS;

/// An entry counts as zero below this share of the geometric mean of its diagonal.
const NEGLIGIBLE: f64 = 1e-15;
/// Columns that are turned at once.
const BLOCK: usize = 4;

/// Tracked basis and the sums in it. Rows are padded with zeros to `stride`.
#[derive(Clone, Debug)]
pub(crate) struct Rotations {
    n: usize,
    stride: usize,
    /// Row k is direction k, in working coordinates.
    v: Vec<f64>,
    /// V·S·Vᵀ. It is symmetric: the lower triangle is kept up to date, and what is above it stands as it was last
    /// [mirrored](Self::mirror).
    e: Vec<f64>,
    /// V·M·Vᵀ
    a: Vec<f64>,
    /// V·y
    b: Vec<f64>,
    /// Whether pairs of the next round begin at place 1.
    odd: bool,
    turn: Turn,
    lanes: [Vec<Lanes>; 2],
    rows: [Vec<f64>; 2],
    spare: Vec<f64>,
    shares: Vec<f64>,
    /// Which row is orthonormalised next.
    next: usize,
    /// Largest deviation from orthonormal that a row had before it was put right.
    deviation: f64,
}

/// One round: what every entry of a row is multiplied by, and its neighbour's for it.
#[derive(Clone, Debug)]
struct Turn {
    /// Place of the first pair, and number of pairs.
    first: usize,
    pairs: usize,
    own: Vec<f64>,
    other: Vec<f64>,
}

impl Rotations {
    pub(crate) fn new(n: usize, p: usize) -> Rotations {
        // Blocks begin at place 0 or 1; the last one must end inside the row.
        let stride = (n.saturating_sub(1).next_multiple_of(BLOCK) + 1).next_multiple_of(BLOCK);
        let square = || vec![0.0; n * stride];
        let row = || vec![0.0; stride];
        let mut rotations = Rotations {
            n,
            stride,
            v: square(),
            e: square(),
            a: square(),
            b: row(),
            odd: false,
            turn: Turn { first: 0, pairs: 0, own: row(), other: row() },
            lanes: [vec![Lanes::default(); stride], vec![Lanes::default(); n]],
            rows: [vec![0.0; p * stride], vec![0.0; p * stride]],
            spare: row(),
            shares: row(),
            next: 0,
            deviation: 0.0,
        };
        for k in 0..n {
            rotations.v[k * stride + k] = 1.0;
        }
        rotations
    }

    /// Length of all rows, n and zeros.
    pub(crate) fn stride(&self) -> usize {
        self.stride
    }

    /// Direction k: n entries.
    pub(crate) fn direction(&self, k: usize) -> &[f64] {
        &self.v[k * self.stride..k * self.stride + self.n]
    }

    /// All directions, one a padded row.
    pub(crate) fn directions(&self) -> &[f64] {
        &self.v
    }

    /// Fills in the upper triangle of V·S·Vᵀ. What asks for [rows](Self::information) of it needs that before.
    pub(crate) fn mirror(&mut self) {
        mirror(&mut self.e, self.stride);
    }

    /// Row k of V·S·Vᵀ as last mirrored, padded.
    pub(crate) fn information(&self, k: usize) -> &[f64] {
        &self.e[k * self.stride..(k + 1) * self.stride]
    }

    /// V·S·Vᵀ as last mirrored, in padded rows.
    pub(crate) fn all_information(&self) -> &[f64] {
        &self.e
    }

    /// `v_k·S·v_k`
    pub(crate) fn diagonal(&self, k: usize) -> f64 {
        self.e[k * self.stride + k]
    }

    /// Row k of V·M·Vᵀ, padded.
    pub(crate) fn cross(&self, k: usize) -> &[f64] {
        &self.a[k * self.stride..(k + 1) * self.stride]
    }

    /// V·M·Vᵀ in padded rows.
    pub(crate) fn all_cross(&self) -> &[f64] {
        &self.a
    }

    /// V·y
    pub(crate) fn right_hand_side(&self) -> &[f64] {
        &self.b
    }

    /// Largest deviation from orthonormal seen since the start.
    #[cfg(test)]
    pub(crate) fn deviation(&self) -> f64 {
        self.deviation
    }

    pub(crate) fn carry(&mut self, carry: &mut Carry<'_>) {
        for sums in [&mut self.v, &mut self.e, &mut self.a, &mut self.b] {
            carry.numbers(sums);
        }
        carry.flag(&mut self.odd);
        carry.place(&mut self.next, self.n);
    }

    /// An empty window; the basis stays.
    pub(crate) fn forget(&mut self) {
        for sums in [&mut self.e, &mut self.a, &mut self.b] {
            sums.fill(0.0);
        }
    }

    /// `E ← λE + Σ z·zᵀ`, `A ← λA + Σ z·dᵀ`, `b ← λb + Σ z·τ` over rows z, d (n entries each, working coordinates).
    pub(crate) fn add(&mut self, lambda: f64, z: &[f64], d: &[f64], tau: &[f64]) {
        let (n, stride) = (self.n, self.stride);
        for (rows, out) in [z, d].into_iter().zip(&mut self.rows) {
            let [before, after] = &mut self.lanes;
            for (lane, row) in rows.chunks_exact(n).enumerate().take(MAX_JOINTS) {
                before.iter_mut().zip(row).for_each(|(lanes, x)| lanes[lane] = *x);
            }
            full_times(&self.v, before, after);
            for (lane, row) in out.chunks_exact_mut(stride).enumerate() {
                row.iter_mut().zip(after.iter()).for_each(|(x, lanes)| *x = lanes[lane]);
            }
        }
        let [z, d] = &self.rows;
        add_products(&mut self.e, lambda, z, z, stride, Part::LowerInBlocks);
        add_products(&mut self.a, lambda, z, d, stride, Part::All);
        self.b.iter_mut().for_each(|b| *b *= lambda);
        for (z, tau) in z.chunks_exact(stride).zip(tau) {
            axpy(*tau, z, &mut self.b);
        }
    }

    /// One round: every pair is rotated, and its two change places. Returns the places of the pairs: the first of each.
    pub(crate) fn round(&mut self) -> impl Iterator<Item = usize> + use<> {
        let first = usize::from(self.odd);
        self.odd = !self.odd;
        let pairs = self.n.saturating_sub(first) / 2;
        let Rotations { turn, v, e, a, b, stride, .. } = self;
        (turn.first, turn.pairs) = (first, pairs);
        turn.own.fill(1.0);
        turn.other.fill(0.0);
        for k in (first..).step_by(2).take(pairs) {
            let (c, s) = rotation(e[k * *stride + k], e[(k + 1) * *stride + k + 1], e[(k + 1) * *stride + k]);
            // Exchanged: the first becomes s·first + c·second, the second c·first − s·second.
            (turn.own[k], turn.other[k]) = (s, c);
            (turn.own[k + 1], turn.other[k + 1]) = (-s, c);
        }
        turn_both(e, turn, true);
        turn_both(a, turn, false);
        turn_rows(v, turn);
        turn_columns(b, turn);
        (first..).step_by(2).take(pairs)
    }

    /// Puts one row right: rounding takes V away from orthonormal by about 1e-16 a rotation.
    pub(crate) fn orthonormalise_one(&mut self) {
        let (n, stride, k) = (self.n, self.stride, self.next);
        self.next = if k + 1 == n { 0 } else { k + 1 };
        let Rotations { v, spare, shares, .. } = self;
        spare.copy_from_slice(&v[k * stride..(k + 1) * stride]);
        times(v, spare, shares);
        let mut worst = (shares[k] - 1.0).abs();
        shares[k] = 0.0;
        for (share, other) in shares.iter().zip(v.chunks_exact(stride)) {
            worst = worst.max(share.abs());
            axpy(-share, other, spare);
        }
        let length = crate::linear::dot(spare, spare).sqrt();
        if length > 0.5 {
            let scale = 1.0 / length;
            for (x, spare) in v[k * stride..(k + 1) * stride].iter_mut().zip(spare.iter()) {
                *x = scale * spare;
            }
        }
        self.deviation = self.deviation.max(worst);
    }

    /// `V·x` for x in working coordinates, padded like the result.
    pub(crate) fn shares(&self, x: &[f64], out: &mut [f64]) {
        times(&self.v, x, out);
    }
}

/// Cosine and sine of the smaller angle that clears g between p and q.
fn rotation(p: f64, q: f64, g: f64) -> (f64, f64) {
    let clear = g.abs() > NEGLIGIBLE * (p * q).abs().sqrt() && g.is_finite() && p.is_finite() && q.is_finite();
    let ratio = (q - p) / (2.0 * if clear { g } else { 1.0 });
    let t = 1.0_f64.copysign(ratio) / (ratio.abs() + (1.0 + ratio * ratio).sqrt());
    let t = if clear && t.is_finite() { t } else { 0.0 };
    let c = 1.0 / (1.0 + t * t).sqrt();
    (c, c * t)
}

/// Two pairs of neighbours: own and other share of each.
#[inline(always)]
fn turn_block(x: [f64; BLOCK], own: &[f64; BLOCK], other: &[f64; BLOCK]) -> [f64; BLOCK] {
    let mut turned = [0.0; BLOCK];
    for i in 0..BLOCK {
        turned[i] = own[i] * x[i] + other[i] * x[i ^ 1];
    }
    turned
}

#[inline(always)]
fn turn_columns(row: &mut [f64], turn: &Turn) {
    let first = turn.first;
    multiply_adds(2 * row.len());
    let shares = turn.own[first..].as_chunks().0.iter().zip(turn.other[first..].as_chunks().0);
    for (x, (own, other)) in row[first..].as_chunks_mut::<BLOCK>().0.iter_mut().zip(shares) {
        *x = turn_block(*x, own, other);
    }
}

/// Turns the rows and columns of a matrix; of a symmetric one the lower triangle, in whole blocks, so that a few entries above the
/// diagonal are turned with it, whatever they are.
#[multiversion(targets("x86_64+avx+avx2"))]
fn turn_both(matrix: &mut [f64], turn: &Turn, symmetric: bool) {
    /// Both rows of a pair, from the place of the first pair on. A call for each: within the loop over pairs the compiler asks each time
    /// which of the slices overlap.
    #[inherit_target]
    #[inline(never)]
    fn pair(upper: &mut [f64], lower: &mut [f64], [s, c]: [f64; 2], own: &[f64], other: &[f64]) {
        let shares = own.as_chunks().0.iter().zip(other.as_chunks().0);
        let blocks = upper.as_chunks_mut::<BLOCK>().0.iter_mut().zip(lower.as_chunks_mut::<BLOCK>().0);
        for ((x, y), (own, other)) in blocks.zip(shares) {
            let (mut u, mut w) = ([0.0; BLOCK], [0.0; BLOCK]);
            for i in 0..BLOCK {
                u[i] = s * x[i] + c * y[i];
                w[i] = c * x[i] - s * y[i];
            }
            *x = turn_block(u, own, other);
            *y = turn_block(w, own, other);
        }
    }

    let (stride, first) = (turn.own.len(), turn.first);
    let (alone, pairs) = matrix.split_at_mut(first * stride);
    for row in alone.chunks_exact_mut(stride) {
        turn_columns(row, turn);
    }
    let mut pairs = pairs.chunks_exact_mut(2 * stride);
    for (m, rows) in pairs.by_ref().enumerate() {
        let place = first + 2 * m;
        let end = if symmetric { first + (2 * m + 2).next_multiple_of(BLOCK) } else { stride };
        let (s, c) = (turn.own[place], turn.other[place]);
        let (upper, lower) = rows.split_at_mut(stride);
        multiply_adds(8 * end);
        if first == 1 {
            (upper[0], lower[0]) = (s * upper[0] + c * lower[0], c * upper[0] - s * lower[0]);
        }
        if symmetric {
            upper[place + 1] = lower[place];
        }
        pair(&mut upper[first..end], &mut lower[first..end], [s, c], &turn.own[first..], &turn.other[first..]);
    }
    for row in pairs.into_remainder().chunks_exact_mut(stride) {
        turn_columns(row, turn);
    }
}

/// What is below the diagonal of a symmetric matrix, above it as well.
#[multiversion(targets("x86_64+avx+avx2"))]
fn mirror(matrix: &mut [f64], stride: usize) {
    let n = matrix.len() / stride;
    for from in (0..n).step_by(BLOCK) {
        let (above, rows) = matrix.split_at_mut(from * stride);
        let height = BLOCK.min(n - from);
        let below: [&[f64]; BLOCK] =
            std::array::from_fn(|i| if i < height { &rows[i * stride..i * stride + from] } else { &[] });
        for (j, above) in above.chunks_exact_mut(stride).enumerate() {
            for (x, row) in above[from..].iter_mut().zip(&below[..height]) {
                *x = row[j];
            }
        }
        for i in 0..height {
            for j in 0..i {
                rows[j * stride + from + i] = rows[i * stride + from + j];
            }
        }
    }
}

#[multiversion(targets("x86_64+avx+avx2"))]
fn turn_rows(matrix: &mut [f64], turn: &Turn) {
    let stride = turn.own.len();
    for (k, rows) in matrix[turn.first * stride..].chunks_exact_mut(2 * stride).enumerate() {
        let place = turn.first + 2 * k;
        let (s, c) = (turn.own[place], turn.other[place]);
        let (upper, lower) = rows.split_at_mut(stride);
        multiply_adds(4 * stride);
        for (x, y) in upper.iter_mut().zip(lower) {
            (*x, *y) = (s * *x + c * *y, c * *x - s * *y);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linear::dot;
    use crate::linear::tests::Random;

    fn rows(random: &mut Random, n: usize, rank: usize) -> Vec<f64> {
        (0..rank * n).map(|_| random.normal()).collect()
    }

    fn off_diagonal(r: &Rotations) -> f64 {
        let square: f64 = (0..r.n).map(|i| dot(r.information(i), r.information(i)) - r.diagonal(i).powi(2)).sum();
        square.max(0.0).sqrt()
    }

    /// n rounds bring every pair of directions together once, for even and odd n.
    #[test]
    fn a_sweep_meets_every_pair_once() {
        for n in [1, 2, 3, 4, 7, 58, 61] {
            let mut r = Rotations::new(n, 1);
            let mut at: Vec<usize> = (0..n).collect();
            let mut met = std::collections::BTreeSet::new();
            for _ in 0..n {
                for k in r.round() {
                    let (p, q) = (at[k], at[k + 1]);
                    assert!(met.insert((p.min(q), p.max(q))), "{n}: {p} and {q} meet twice");
                    at.swap(k, k + 1);
                }
            }
            assert_eq!(met.len(), n * (n - 1) / 2);
        }
    }

    /// Law: V stays orthonormal, `E = V·S·Vᵀ` and `A = V·M·Vᵀ`, and E becomes diagonal.
    #[test]
    fn rotations_diagonalise_and_change_nothing_else() {
        let mut random = Random(3);
        for n in [1, 2, 3, 8, 9, 40, 57] {
            let p = 3;
            let mut r = Rotations::new(n, p);
            let (mut s, mut m, mut y) = (vec![0.0; n * n], vec![0.0; n * n], vec![0.0; n]);
            for _ in 0..4 * n {
                let (z, d, tau) = (rows(&mut random, n, p), rows(&mut random, n, p), rows(&mut random, 1, p));
                r.add(0.98, &z, &d, &tau);
                for sums in [&mut s, &mut m] {
                    for x in sums.iter_mut() {
                        *x *= 0.98;
                    }
                }
                for y in &mut y {
                    *y *= 0.98;
                }
                for k in 0..p {
                    let (z, d) = (&z[k * n..(k + 1) * n], &d[k * n..(k + 1) * n]);
                    for i in 0..n {
                        axpy(z[i], z, &mut s[i * n..(i + 1) * n]);
                        axpy(z[i], d, &mut m[i * n..(i + 1) * n]);
                        y[i] += z[i] * tau[k];
                    }
                }
                r.round().for_each(drop);
                r.orthonormalise_one();
            }
            for _ in 0..10 * n {
                r.round().for_each(drop);
            }
            r.mirror();
            let scale: f64 = (0..n).map(|i| s[i * n + i]).sum();
            assert!(off_diagonal(&r) < 1e-12 * scale, "{n}: {}", off_diagonal(&r) / scale);
            let mut image = vec![0.0; n];
            for i in 0..n {
                for (matrix, row) in [(&s, r.information(i)), (&m, r.cross(i))] {
                    for (k, image) in image.iter_mut().enumerate() {
                        *image = (0..n).map(|l| r.direction(i)[l] * matrix[l * n + k]).sum();
                    }
                    for j in 0..n {
                        let expected = dot(&image, r.direction(j));
                        assert!((row[j] - expected).abs() < 1e-11 * scale, "{n} {i} {j}: {} {expected}", row[j]);
                    }
                }
                assert!((r.right_hand_side()[i] - dot(&y, r.direction(i))).abs() < 1e-11 * scale);
                assert!((dot(r.direction(i), r.direction(i)) - 1.0).abs() < 1e-12);
            }
        }
    }

    /// F7: rounding takes the basis away from orthonormal, without end; one row put right each round keeps it there.
    #[test]
    fn the_basis_stays_orthonormal() {
        let n = 16;
        let worst = |keep: bool| {
            let mut random = Random(7);
            let mut r = Rotations::new(n, 2);
            for k in 0..300_000 {
                if k % 5 == 0 {
                    let z = rows(&mut random, n, 2);
                    r.add(0.9, &z, &z, &[0.0; 2]);
                }
                r.round().for_each(drop);
                if keep {
                    r.orthonormalise_one();
                }
            }
            r.deviation = 0.0;
            for _ in 0..n {
                r.orthonormalise_one();
            }
            r.deviation()
        };
        let (kept, lost) = (worst(true), worst(false));
        println!("deviation from orthonormal after 300000 rounds: {kept:.1e} kept, {lost:.1e} left alone");
        assert!(kept < 1e-14 && lost > 10.0 * kept, "{kept:e} {lost:e}");
    }
}
