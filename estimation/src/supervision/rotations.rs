//! A basis that follows the information of the instruments by Jacobi rotations (paper, 3.2.4).
//!
//! `E = V·S·Vᵀ` stays nearly diagonal while S is a moving window: each round rotates disjoint pairs of directions so that
//! the entry between the two vanishes (Jacobi 1846), `n − 1` rounds meet every pair once (the circle method of round-robin
//! tournaments; Brent & Luk 1985), and the basis goes on from one period to the next instead of beginning anew. The
//! members of a pair lie half a matrix apart, and results are written where the next round wants them: loops run along
//! rows. Number and order of operations do not depend on the numbers.

use crate::kernels::{Lanes, Part, add_products, full_times};
use crate::linear::{axpy, dot};
use multiversion::multiversion;
use rivet_dynamics::MAX_JOINTS;

/// An entry counts as zero below this share of the geometric mean of its diagonal.
const NEGLIGIBLE: f64 = 1e-15;

/// Tracked basis and the sums in it. An odd n gets one coordinate beside, which stays zero.
#[derive(Clone, Debug)]
pub(crate) struct Rotations {
    n: usize,
    /// n, made even: length of all rows.
    width: usize,
    /// Row k is direction k, in working coordinates.
    v: Vec<f64>,
    /// V·S·Vᵀ
    e: Vec<f64>,
    /// V·M·Vᵀ
    a: Vec<f64>,
    /// V·y
    b: Vec<f64>,
    cosine: Vec<f64>,
    sine: Vec<f64>,
    pair: Vec<f64>,
    spare: Vec<f64>,
    lanes: [Vec<Lanes>; 2],
    rows: [Vec<f64>; 2],
    /// Which row is orthonormalised next.
    next: usize,
    /// Largest deviation from orthonormal that a row had before it was put right.
    deviation: f64,
}

/// Where the next round wants place k of `width`: place 0 stays, all others go around the circle.
pub(crate) fn destination(k: usize, width: usize) -> usize {
    let half = width / 2;
    if k == 0 || half == 1 {
        k
    } else if k < half {
        if k + 1 == half { width - 1 } else { k + 1 }
    } else if k == half {
        1
    } else {
        k - 1
    }
}

impl Rotations {
    pub(crate) fn new(n: usize, p: usize) -> Rotations {
        let width = n.next_multiple_of(2);
        let square = || vec![0.0; width * width];
        let mut rotations = Rotations {
            n,
            width,
            v: square(),
            e: square(),
            a: square(),
            b: vec![0.0; width],
            cosine: vec![0.0; width / 2],
            sine: vec![0.0; width / 2],
            pair: vec![0.0; 2 * width],
            spare: square(),
            lanes: [vec![Lanes::default(); width], vec![Lanes::default(); width]],
            rows: [vec![0.0; p * width], vec![0.0; p * width]],
            next: 0,
            deviation: 0.0,
        };
        for k in 0..width {
            rotations.v[k * width + k] = 1.0;
        }
        rotations
    }

    pub(crate) fn width(&self) -> usize {
        self.width
    }

    /// Direction k: n entries, then at most one zero.
    pub(crate) fn direction(&self, k: usize) -> &[f64] {
        &self.v[k * self.width..k * self.width + self.n]
    }

    /// Row k of V·S·Vᵀ.
    pub(crate) fn information(&self, k: usize) -> &[f64] {
        &self.e[k * self.width..(k + 1) * self.width]
    }

    /// `v_k·S·v_k`
    pub(crate) fn diagonal(&self, k: usize) -> f64 {
        self.e[k * self.width + k]
    }

    /// Row k of V·M·Vᵀ.
    pub(crate) fn cross(&self, k: usize) -> &[f64] {
        &self.a[k * self.width..(k + 1) * self.width]
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

    /// An empty window; the basis stays.
    pub(crate) fn forget(&mut self) {
        for sums in [&mut self.e, &mut self.a, &mut self.b] {
            sums.fill(0.0);
        }
    }

    /// `E ← λE + Σ z·zᵀ`, `A ← λA + Σ z·dᵀ`, `b ← λb + Σ z·τ` over rows z, d (n entries each, working coordinates).
    pub(crate) fn add(&mut self, lambda: f64, z: &[f64], d: &[f64], tau: &[f64]) {
        let (n, width) = (self.n, self.width);
        for (rows, out) in [z, d].into_iter().zip(&mut self.rows) {
            let [before, after] = &mut self.lanes;
            for (lane, row) in rows.chunks_exact(n).enumerate().take(MAX_JOINTS) {
                before.iter_mut().zip(row).for_each(|(lanes, x)| lanes[lane] = *x);
            }
            full_times(&self.v, before, after);
            for (lane, row) in out.chunks_exact_mut(width).enumerate() {
                row.iter_mut().zip(after.iter()).for_each(|(x, lanes)| *x = lanes[lane]);
            }
        }
        let [z, d] = &self.rows;
        add_products(&mut self.e, lambda, z, z, width, Part::All);
        add_products(&mut self.a, lambda, z, d, width, Part::All);
        self.b.iter_mut().for_each(|b| *b *= lambda);
        for (z, tau) in z.chunks_exact(width).zip(tau) {
            axpy(*tau, z, &mut self.b);
        }
    }

    /// One round: every pair is rotated, then all places move on to where [`destination`] says.
    pub(crate) fn round(&mut self) {
        let (width, half) = (self.width, self.width / 2);
        if width < 2 {
            return;
        }
        for k in 0..half {
            let (p, q, g) = (self.diagonal(k), self.diagonal(k + half), self.e[k * width + k + half]);
            let (c, s) = rotation(p, q, g);
            (self.cosine[k], self.sine[k]) = (c, s);
        }
        let Rotations { cosine, sine, pair, spare, v, e, a, b, .. } = self;
        for matrix in [e, a] {
            rotate_both(matrix, spare, cosine, sine, pair);
            std::mem::swap(matrix, spare);
        }
        rotate_rows(v, spare, cosine, sine);
        std::mem::swap(v, spare);
        rotate_columns(b, &mut pair[..width], cosine, sine);
        b.copy_from_slice(&pair[..width]);
    }

    /// Puts one row right: rounding takes V away from orthonormal by about 1e-16 a rotation.
    pub(crate) fn orthonormalise_one(&mut self) {
        let (width, k) = (self.width, self.next);
        self.next = if k + 1 == width { 0 } else { k + 1 };
        let Rotations { v, pair, .. } = self;
        let row = &mut pair[..width];
        row.copy_from_slice(&v[k * width..(k + 1) * width]);
        let mut worst = 0.0_f64;
        for (j, other) in v.chunks_exact(width).enumerate() {
            let share = dot(other, &v[k * width..(k + 1) * width]);
            if j == k {
                worst = worst.max((share - 1.0).abs());
            } else {
                worst = worst.max(share.abs());
                axpy(-share, other, row);
            }
        }
        let length = dot(row, row).sqrt();
        if length > 0.5 {
            let scale = 1.0 / length;
            for x in row.iter_mut() {
                *x *= scale;
            }
            v[k * width..(k + 1) * width].copy_from_slice(row);
        }
        self.deviation = self.deviation.max(worst);
    }

    /// `V·x` for x in working coordinates (n entries).
    pub(crate) fn shares(&self, x: &[f64], out: &mut [f64]) {
        for (out, v) in out.iter_mut().zip(self.v.chunks_exact(self.width)) {
            *out = dot(&v[..self.n], x);
        }
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

/// Columns of one row: pairs lie half a row apart; written to their destinations.
#[inline(always)]
fn rotate_columns(row: &[f64], out: &mut [f64], cosine: &[f64], sine: &[f64]) {
    let width = row.len();
    let half = width / 2;
    let (low, high) = row.split_at(half);
    let (out_low, out_high) = out.split_at_mut(half);
    let (cosine, sine, low, high) = (&cosine[..half], &sine[..half], &low[..half], &high[..half]);
    let first = cosine[0] * low[0] - sine[0] * high[0];
    let (last_low, first_high) =
        (cosine[half - 1] * low[half - 1] - sine[half - 1] * high[half - 1], sine[0] * low[0] + cosine[0] * high[0]);
    if half == 1 {
        (out[0], out[1]) = (first, first_high);
        return;
    }
    // Low places move up by one, high ones down by one; the ends change sides.
    out_low[0] = first;
    out_low[1] = first_high;
    for (k, out) in out_low[2..].iter_mut().enumerate() {
        *out = cosine[k + 1] * low[k + 1] - sine[k + 1] * high[k + 1];
    }
    for (k, out) in out_high[..half - 1].iter_mut().enumerate() {
        *out = sine[k + 1] * low[k + 1] + cosine[k + 1] * high[k + 1];
    }
    out_high[half - 1] = last_low;
}

#[multiversion(targets("x86_64+avx+avx2"))]
fn rotate_both(matrix: &[f64], out: &mut [f64], cosine: &[f64], sine: &[f64], pair: &mut [f64]) {
    let half = cosine.len();
    let width = 2 * half;
    let (first, second) = pair.split_at_mut(width);
    let second = &mut second[..width];
    for k in 0..half {
        let (c, s) = (cosine[k], sine[k]);
        let (low, high) = (&matrix[k * width..(k + 1) * width], &matrix[(k + half) * width..(k + half + 1) * width]);
        for (((x, y), low), high) in first.iter_mut().zip(second.iter_mut()).zip(low).zip(high) {
            (*x, *y) = (c * low - s * high, s * low + c * high);
        }
        for (row, place) in [(&*first, k), (&*second, k + half)] {
            let to = destination(place, width);
            rotate_columns(row, &mut out[to * width..(to + 1) * width], cosine, sine);
        }
    }
}

#[multiversion(targets("x86_64+avx+avx2"))]
fn rotate_rows(matrix: &[f64], out: &mut [f64], cosine: &[f64], sine: &[f64]) {
    let half = cosine.len();
    let width = 2 * half;
    for k in 0..half {
        let (c, s) = (cosine[k], sine[k]);
        let (low, high) = (&matrix[k * width..(k + 1) * width], &matrix[(k + half) * width..(k + half + 1) * width]);
        let to = destination(k, width);
        for ((out, low), high) in out[to * width..(to + 1) * width].iter_mut().zip(low).zip(high) {
            *out = c * low - s * high;
        }
        let to = destination(k + half, width);
        for ((out, low), high) in out[to * width..(to + 1) * width].iter_mut().zip(low).zip(high) {
            *out = s * low + c * high;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linear::tests::Random;

    fn rows(random: &mut Random, n: usize, rank: usize) -> Vec<f64> {
        (0..rank * n).map(|_| random.normal()).collect()
    }

    fn off_diagonal(r: &Rotations) -> f64 {
        let square: f64 = (0..r.width).map(|i| dot(r.information(i), r.information(i)) - r.diagonal(i).powi(2)).sum();
        square.max(0.0).sqrt()
    }

    /// Every pair of places meets once in a sweep, and after it everybody is back.
    #[test]
    fn a_sweep_meets_every_pair_once() {
        for width in [2, 4, 6, 58, 60] {
            let mut at: Vec<usize> = (0..width).collect();
            let mut met = std::collections::BTreeSet::new();
            for _ in 0..width - 1 {
                for k in 0..width / 2 {
                    let (p, q) = (at[k], at[k + width / 2]);
                    assert!(met.insert((p.min(q), p.max(q))), "{width}: {p} and {q} meet twice");
                }
                let mut next = vec![0; width];
                for k in 0..width {
                    next[destination(k, width)] = at[k];
                }
                at = next;
            }
            assert_eq!(met.len(), width * (width - 1) / 2);
            assert_eq!(at, (0..width).collect::<Vec<_>>());
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
                r.round();
                r.orthonormalise_one();
            }
            for _ in 0..10 * n {
                r.round();
            }
            let scale: f64 = (0..n).map(|i| s[i * n + i]).sum();
            assert!(off_diagonal(&r) < 1e-12 * scale, "{n}: {}", off_diagonal(&r) / scale);
            let mut image = vec![0.0; n];
            for i in (0..r.width).filter(|&i| r.direction(i).iter().any(|x| *x != 0.0)) {
                for (matrix, row) in [(&s, r.information(i)), (&m, r.cross(i))] {
                    for (k, image) in image.iter_mut().enumerate() {
                        *image = (0..n).map(|l| r.direction(i)[l] * matrix[l * n + k]).sum();
                    }
                    for j in 0..r.width {
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
                r.round();
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
