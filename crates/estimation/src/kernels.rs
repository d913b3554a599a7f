//! The inner loops of a period: the same operations in the same order on every machine, in wider registers where the
//! machine has them.
//!
//! Nothing here multiplies and adds in one rounding and nothing is summed in an order that depends on the width of a
//! register: results are the same bits on all machines of a target, so a recorded run replays anywhere.

use crate::linear::{axpy, dot, dot_short, dots, packed};
use crate::operations::multiply_adds;
use multiversion::multiversion;
use rivet_dynamics::MAX_JOINTS;

/// One entry a row, of at most [`MAX_JOINTS`] rows.
pub(crate) type Lanes = [f64; MAX_JOINTS];

/// `x ← T·x` for a lower triangle T ([`packed`]) and as many vectors as there are lanes.
#[multiversion(targets("x86_64+avx+avx2+avx512f+avx512vl+avx512dq", "x86_64+avx+avx2"))]
pub(crate) fn lower_times(t: &[f32], x: &mut [Lanes]) {
    let n = x.len();
    multiply_adds(MAX_JOINTS * n * (n + 1) / 2);
    // From the last row to the first: no row wants what lies behind it.
    for i in (n - n % 4..n).rev() {
        let mut sum = [0.0; MAX_JOINTS];
        for (x, a) in x.iter().zip(&t[packed(i)]) {
            for lane in 0..MAX_JOINTS {
                sum[lane] += f64::from(*a) * x[lane];
            }
        }
        x[i] = sum;
    }
    // Four rows at a time: one addition need not wait for the others'.
    for i in (0..n - n % 4).step_by(4).rev() {
        let [a, b, c, d] = [0, 1, 2, 3].map(|k| &t[packed(i + k)]);
        let mut sums = [[0.0; MAX_JOINTS]; 4];
        for ((((x, a), b), c), d) in x.iter().zip(a).zip(b).zip(c).zip(d) {
            let (a, b, c, d) = (f64::from(*a), f64::from(*b), f64::from(*c), f64::from(*d));
            for lane in 0..MAX_JOINTS {
                sums[0][lane] += a * x[lane];
                sums[1][lane] += b * x[lane];
                sums[2][lane] += c * x[lane];
                sums[3][lane] += d * x[lane];
            }
        }
        for (k, (sum, row)) in sums.iter_mut().zip([a, b, c, d]).enumerate() {
            for (x, t) in x[i + 1..=i + k].iter().zip(&row[i + 1..]) {
                for lane in 0..MAX_JOINTS {
                    sum[lane] += f64::from(*t) * x[lane];
                }
            }
        }
        x[i..i + 4].copy_from_slice(&sums);
    }
}

/// `out = T·x` for the whole row-major T, rows as long as x.
#[multiversion(targets("x86_64+avx+avx2+avx512f+avx512vl+avx512dq", "x86_64+avx+avx2"))]
pub(crate) fn full_times(t: &[f64], x: &[Lanes], out: &mut [Lanes]) {
    let n = x.len();
    multiply_adds(MAX_JOINTS * t.len());
    for (rows, out) in t.chunks(4 * n).zip(out.chunks_mut(4)) {
        // What is missing of a last four is multiplied again.
        let row = |k: usize| &rows[k.min(out.len() - 1) * n..][..n];
        let mut sums = [[0.0; MAX_JOINTS]; 4];
        for ((((x, a), b), c), d) in x.iter().zip(row(0)).zip(row(1)).zip(row(2)).zip(row(3)) {
            for lane in 0..MAX_JOINTS {
                sums[0][lane] += a * x[lane];
                sums[1][lane] += b * x[lane];
                sums[2][lane] += c * x[lane];
                sums[3][lane] += d * x[lane];
            }
        }
        out.copy_from_slice(&sums[..out.len()]);
    }
}

/// `out = T·x`, T row-major with rows as long as x.
#[multiversion(targets("x86_64+avx+avx2+avx512f+avx512vl+avx512dq", "x86_64+avx+avx2"))]
pub(crate) fn times(t: &[f64], x: &[f64], out: &mut [f64]) {
    let n = x.len();
    for (out, rows) in out.chunks_mut(4).zip(t.chunks(4 * n)) {
        // What is missing of a last four is multiplied again; `out` may be padded beyond the rows there are.
        let (count, row) = (rows.len() / n, |k: usize| &rows[k * n..(k + 1) * n]);
        let products = dots([0, 1, 2, 3].map(|k| row(k.min(count - 1))), x);
        out.iter_mut().zip(products).take(count).for_each(|(out, product)| *out = product);
    }
}

/// `out ← out + Tᵀ·x`, T row-major with rows as long as `out`.
#[multiversion(targets("x86_64+avx+avx2+avx512f+avx512vl+avx512dq", "x86_64+avx+avx2"))]
pub(crate) fn add_transposed_times(t: &[f64], x: &[f64], out: &mut [f64]) {
    let n = out.len();
    // x may be padded with zeros beyond the rows there are.
    let x = &x[..x.len().min(t.len() / n)];
    multiply_adds(x.len() * n);
    // Four rows at a time, one after the other for each entry: `out` is read and written once for all of them.
    let (fours, rest) = x.as_chunks::<4>();
    for (rows, [a, b, c, d]) in t.chunks_exact(4 * n).zip(fours) {
        let (first, rows) = rows.split_at(n);
        let (second, rows) = rows.split_at(n);
        let (third, fourth) = rows.split_at(n);
        for ((((out, p), q), r), s) in out.iter_mut().zip(first).zip(second).zip(third).zip(fourth) {
            *out = (((*out + a * p) + b * q) + c * r) + d * s;
        }
    }
    for (row, x) in t[4 * fours.len() * n..].chunks_exact(n).zip(rest) {
        for (out, t) in out.iter_mut().zip(row) {
            *out += x * t;
        }
    }
}

/// Products of `x` with the rows of T (row-major, as long as x) that `index` names.
#[multiversion(targets("x86_64+avx+avx2+avx512f+avx512vl+avx512dq", "x86_64+avx+avx2"))]
pub(crate) fn times_chosen(t: &[f64], index: &[usize], x: &[f64], out: &mut [f64]) {
    let n = x.len();
    let row = |k: usize| &t[k * n..(k + 1) * n];
    for (out, index) in out.chunks_mut(4).zip(index.chunks(4)) {
        let fours: [usize; 4] = std::array::from_fn(|i| index[i.min(index.len() - 1)]);
        let products = dots(fours.map(row), x);
        out.copy_from_slice(&products[..out.len()]);
    }
}

/// `out = T⁻¹·x` for a lower triangle T ([`packed`]).
#[multiversion(targets("x86_64+avx+avx2+avx512f+avx512vl+avx512dq", "x86_64+avx+avx2"))]
pub(crate) fn lower_solve(t: &[f32], x: &[f64], out: &mut [f64]) {
    for (i, x) in x.iter().enumerate() {
        let row = &t[packed(i)];
        out[i] = (x - dot_short(&row[..i], &out[..i])) / f64::from(row[i]);
    }
}

/// `x ← T⁻¹·x` for a lower triangle T ([`packed`]) and four vectors: each to the bit what [`lower_solve`] gives, without sums across lanes.
#[multiversion(targets("x86_64+avx+avx2+avx512f+avx512vl+avx512dq", "x86_64+avx+avx2"))]
pub(crate) fn lower_solve_four(t: &[f32], x: &mut [[f64; 4]]) {
    for i in 0..x.len() {
        multiply_adds(4 * i);
        let (known, rest) = x.split_at_mut(i);
        let (row, pivot) = (&t[packed(i)][..i], f64::from(t[packed(i)][i]));
        let (mut sums, mut left) = ([[0.0; 4]; 8], [0.0; 4]);
        let (eights, last) = known.as_chunks::<8>();
        let (t_eights, t_last) = row.as_chunks::<8>();
        for (x, t) in eights.iter().zip(t_eights) {
            for k in 0..8 {
                let t = f64::from(t[k]);
                for lane in 0..4 {
                    sums[k][lane] += t * x[k][lane];
                }
            }
        }
        for (x, t) in last.iter().zip(t_last) {
            for lane in 0..4 {
                left[lane] += f64::from(*t) * x[lane];
            }
        }
        for lane in 0..4 {
            let sum = |k: usize| sums[k][lane] + sums[k + 4][lane];
            let dot = (sum(0) + sum(1)) + (sum(2) + sum(3)) + left[lane];
            rest[0][lane] = (rest[0][lane] - dot) / pivot;
        }
    }
}

/// Products of rows as long as x (one after the other) with each of three vectors.
#[multiversion(targets("x86_64+avx+avx2+avx512f+avx512vl+avx512dq", "x86_64+avx+avx2"))]
pub(crate) fn times_three<T: Copy + Into<f64>>(rows: &[T], x: [&[f64]; 3], out: &mut [[f64; 3]]) {
    for (out, row) in out.iter_mut().zip(rows.chunks_exact(x[0].len())) {
        for (out, x) in out.iter_mut().zip(x) {
            *out = dot_short(row, x);
        }
    }
}

/// Step k of a factorisation `A = L·U` of rows of n: row k, and those below it, which are reduced.
#[multiversion(targets("x86_64+avx+avx2+avx512f+avx512vl+avx512dq", "x86_64+avx+avx2"))]
pub(crate) fn eliminate(row_k: &[f64], k: usize, below: &mut [f64], n: usize) {
    for row in below.chunks_exact_mut(n) {
        let factor = row[k] / row_k[k];
        row[k] = factor;
        axpy(-factor, &row_k[k + 1..], &mut row[k + 1..]);
    }
}

/// `b ← L⁻ᵀ·U⁻ᵀ·b` for factors in one row-major matrix, L with unit diagonal; the first `from` entries of b are zeros.
#[multiversion(targets("x86_64+avx+avx2+avx512f+avx512vl+avx512dq", "x86_64+avx+avx2"))]
pub(crate) fn solve_transposed(a: &[f64], b: &mut [f64], from: usize) {
    let n = b.len();
    let row = |k: usize| &a[k * n..(k + 1) * n];
    // Four unknowns at a time, the rest of b taking them one after the other: it is read and written once for all of them.
    let mut k = from;
    while k + 4 <= n {
        let rows = [row(k), row(k + 1), row(k + 2), row(k + 3)];
        let (own, rest) = b[k..].split_at_mut(4);
        for i in 0..4 {
            own[i] /= rows[i][k + i];
            for j in i + 1..4 {
                own[j] -= own[i] * rows[i][k + j];
            }
        }
        take_four(rest, own, rows.map(|row| &row[k + 4..]));
        k += 4;
    }
    for k in k..n {
        b[k] /= row(k)[k];
        let x = b[k];
        axpy(-x, &row(k)[k + 1..], &mut b[k + 1..n]);
    }
    let mut k = n;
    while k >= 4 {
        k -= 4;
        let rows = [row(k + 3), row(k + 2), row(k + 1), row(k)];
        let (rest, own) = b[..k + 4].split_at_mut(k);
        for i in (1..4).rev() {
            for j in 0..i {
                own[j] -= own[i] * row(k + i)[k + j];
            }
        }
        take_four(rest, &[own[3], own[2], own[1], own[0]], rows);
    }
    for k in (1..k).rev() {
        let x = b[k];
        axpy(-x, &row(k)[..k], &mut b[..k]);
    }
}

/// `b ← b − x₀·t₀ − x₁·t₁ − x₂·t₂ − x₃·t₃`, in this order.
#[inline(always)]
fn take_four(b: &mut [f64], x: &[f64], [p, q, r, s]: [&[f64]; 4]) {
    multiply_adds(4 * b.len());
    let &[x0, x1, x2, x3] = x else { return };
    for ((((b, p), q), r), s) in b.iter_mut().zip(p).zip(q).zip(r).zip(s) {
        *b = (((*b - x0 * p) - x1 * q) - x2 * r) - x3 * s;
    }
}

/// `out = T·x` for the columns of T from `from` on, T row-major with `from` columns more than x has entries.
#[multiversion(targets("x86_64+avx+avx2+avx512f+avx512vl+avx512dq", "x86_64+avx+avx2"))]
pub(crate) fn times_from(t: &[f64], from: usize, x: &[f64], out: &mut [f64]) {
    let n = from + x.len();
    let row = |i: usize| &t[i * n + from..(i + 1) * n];
    let last = out.len().saturating_sub(1);
    for (i, out) in out.chunks_mut(4).enumerate() {
        let products = dots(std::array::from_fn(|k| row((4 * i + k).min(last))), x);
        out.copy_from_slice(&products[..out.len()]);
    }
}

/// `T ← T − v·wᵀ − w·vᵀ` in the columns from `from` on.
#[multiversion(targets("x86_64+avx+avx2+avx512f+avx512vl+avx512dq", "x86_64+avx+avx2"))]
pub(crate) fn add_two_products(t: &mut [f64], from: usize, v: &[f64], w: &[f64]) {
    multiply_adds(2 * v.len() * v.len());
    for ((row, vi), wi) in t.chunks_exact_mut(from + v.len()).zip(v).zip(w) {
        for ((x, v), w) in row[from..].iter_mut().zip(v).zip(w) {
            *x -= vi * w + wi * v;
        }
    }
}

/// `T ← T·(1 − β·v·vᵀ)` in the columns from `from` on.
#[multiversion(targets("x86_64+avx+avx2+avx512f+avx512vl+avx512dq", "x86_64+avx+avx2"))]
pub(crate) fn reflect(t: &mut [f64], from: usize, beta: f64, v: &[f64]) {
    for row in t.chunks_exact_mut(from + v.len()) {
        let row = &mut row[from..];
        let s = beta * dot(row, v);
        axpy(-s, v, row);
    }
}

/// Turns rows i and i + 1 of `t` (`n` long) by the angle with cosine `c[i]` and sine `s[i]`, from the last pair to the first.
#[multiversion(targets("x86_64+avx+avx2+avx512f+avx512vl+avx512dq", "x86_64+avx+avx2"))]
pub(crate) fn rotate_neighbours(t: &mut [f64], n: usize, c: &[f64], s: &[f64]) {
    // Four products and two sums an entry pair are as much as three multiply-adds.
    multiply_adds(3 * n * c.len());
    for (i, (c, s)) in c.iter().zip(s).enumerate().rev() {
        let (low, high) = t[i * n..(i + 2) * n].split_at_mut(n);
        for (x, y) in low.iter_mut().zip(high) {
            let (a, b) = (*x, *y);
            *y = s * a + c * b;
            *x = c * a - s * b;
        }
    }
}

/// Which entries of a square matrix an update touches.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Part {
    All,
    /// The diagonal and what is left of it.
    Lower,
    /// Rows of the lower triangle up to whole eights: some entries above the diagonal as well.
    LowerInBlocks,
    /// The lower triangle, stored without gaps ([`packed`]).
    Packed,
}

/// `M ← λM + Σᵣ zᵣ·dᵣᵀ`, M rows of n (or its lower triangle, packed), over the rows r of `z` and `d` (n entries each, one after the other).
pub(crate) fn add_products(m: &mut [f64], lambda: f64, z: &[f64], d: &[f64], n: usize, part: Part) {
    let mut lambda = lambda;
    let (mut z, mut d) = (z, d);
    // Six rows are the usual case; M is read and written once for all of them.
    while !z.is_empty() {
        let rows = match z.len() / n {
            6.. => 6,
            2..=5 => 2,
            _ => 1,
        };
        let ((z_now, z_rest), (d_now, d_rest)) = (z.split_at(rows * n), d.split_at(rows * n));
        match rows {
            6 => add_rows::<6>(m, lambda, z_now, d_now, n, part),
            2 => add_rows::<2>(m, lambda, z_now, d_now, n, part),
            _ => add_rows::<1>(m, lambda, z_now, d_now, n, part),
        }
        (z, d, lambda) = (z_rest, d_rest, 1.0);
    }
}

#[multiversion(targets("x86_64+avx+avx2+avx512f+avx512vl+avx512dq", "x86_64+avx+avx2"))]
fn add_rows<const ROWS: usize>(m: &mut [f64], lambda: f64, z: &[f64], d: &[f64], n: usize, part: Part) {
    let mut rows: [&[f64]; ROWS] = [&[]; ROWS];
    for (row, d) in rows.iter_mut().zip(d.chunks_exact(n)) {
        *row = d;
    }
    // Columns may be padded with zeros beyond the rows there are.
    let height = if part == Part::Packed { n } else { m.len() / n };
    for i in 0..height {
        let m = match part {
            Part::All => &mut m[i * n..(i + 1) * n],
            Part::Lower => &mut m[i * n..=i * n + i],
            Part::LowerInBlocks => &mut m[i * n..i * n + (i + 1).next_multiple_of(8).min(n)],
            Part::Packed => &mut m[packed(i)],
        };
        let mut zs = [0.0; ROWS];
        for (r, zs) in zs.iter_mut().enumerate() {
            *zs = z[r * n + i];
            rows[r] = &rows[r][..n];
        }
        multiply_adds(ROWS * m.len());
        // What is left of eights goes in fours, twos and one: entry by entry it would take as long as all before.
        let done = add_wide::<8, ROWS>(m, 0, lambda, &zs, &rows);
        let done = add_wide::<4, ROWS>(m, done, lambda, &zs, &rows);
        let done = add_wide::<2, ROWS>(m, done, lambda, &zs, &rows);
        add_wide::<1, ROWS>(m, done, lambda, &zs, &rows);
    }
}

/// Whole groups of a row from entry `from` on; how many entries are done then.
#[inline(always)]
fn add_wide<const WIDTH: usize, const ROWS: usize>(
    m: &mut [f64],
    from: usize,
    lambda: f64,
    zs: &[f64; ROWS],
    rows: &[&[f64]; ROWS],
) -> usize {
    let groups = m[from..].as_chunks_mut::<WIDTH>().0;
    let end = from + groups.len() * WIDTH;
    let mut row_blocks: [&[[f64; WIDTH]]; ROWS] = [&[]; ROWS];
    for r in 0..ROWS {
        row_blocks[r] = &rows[r][from..end].as_chunks::<WIDTH>().0[..groups.len()];
    }
    for (g, m) in groups.iter_mut().enumerate() {
        let mut sum = [0.0; WIDTH];
        for i in 0..WIDTH {
            sum[i] = lambda * m[i];
        }
        for r in 0..ROWS {
            let (z, d) = (zs[r], &row_blocks[r][g]);
            for i in 0..WIDTH {
                sum[i] += z * d[i];
            }
        }
        *m = sum;
    }
    end
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linear::tests::Random;

    fn random(random: &mut Random, count: usize) -> Vec<f64> {
        (0..count).map(|_| random.normal()).collect()
    }

    #[test]
    fn products_are_added_to_the_part_that_was_asked_for() {
        let mut seed = Random(2);
        for (n, rows) in [(1, 1), (5, 3), (12, 6), (61, 6), (70, 7), (9, 8)] {
            let (z, d, before) = (random(&mut seed, rows * n), random(&mut seed, rows * n), random(&mut seed, n * n));
            for part in [Part::All, Part::Lower] {
                let mut m = before.clone();
                add_products(&mut m, 0.9, &z, &d, n, part);
                for (at, (m, before)) in m.iter().zip(&before).enumerate() {
                    let (i, j) = (at / n, at % n);
                    let sum: f64 = (0..rows).map(|r| z[r * n + i] * d[r * n + j]).sum();
                    let expected = if part == Part::Lower && j > i { *before } else { 0.9 * before + sum };
                    assert!((m - expected).abs() < 1e-13 * (1.0 + expected.abs()), "{n} {rows} {i} {j}");
                }
            }
            let triangle = |m: &[f64]| -> Vec<f64> { (0..n).flat_map(|i| m[i * n..=i * n + i].to_vec()).collect() };
            let (mut lower, mut small) = (before.clone(), triangle(&before));
            add_products(&mut lower, 0.9, &z, &d, n, Part::Lower);
            add_products(&mut small, 0.9, &z, &d, n, Part::Packed);
            assert_eq!(small, triangle(&lower));
        }
    }

    /// Four at once are the same bits as one by one, also where rows are left over.
    #[test]
    fn products_of_four_are_those_of_one() {
        let mut seed = Random(6);
        for (n, from) in [(1, 0), (7, 2), (12, 0), (61, 5), (64, 1)] {
            let (t, x) = (random(&mut seed, n * n), random(&mut seed, n));
            let index: Vec<usize> = (0..n).filter(|k| k % 3 != 1).collect();
            let mut out = vec![0.0; index.len()];
            times_chosen(&t, &index, &x, &mut out);
            let one = |k: usize| dot(&x, &t[k * n..(k + 1) * n]);
            assert_eq!(out, index.iter().map(|k| one(*k)).collect::<Vec<_>>());
            let mut out = vec![0.0; n];
            times_from(&t, from, &x[from..], &mut out);
            assert_eq!(out, (0..n).map(|k| dot(&t[k * n + from..(k + 1) * n], &x[from..])).collect::<Vec<_>>());
        }
    }

    /// Four at once are the same bits as one by one.
    #[test]
    fn four_are_solved_for_like_one() {
        let mut seed = Random(8);
        for n in [1, 2, 9, 61] {
            let t: Vec<f32> = (0..packed(n).start).map(|_| 2.0 + seed.normal() as f32).collect();
            let mut x: Vec<[f64; 4]> = (0..n).map(|_| std::array::from_fn(|_| seed.normal())).collect();
            let alone = [0, 1, 2, 3].map(|lane| {
                let (x, mut out): (Vec<f64>, _) = (x.iter().map(|x| x[lane]).collect(), vec![0.0; n]);
                lower_solve(&t, &x, &mut out);
                out
            });
            lower_solve_four(&t, &mut x);
            for (lane, alone) in alone.iter().enumerate() {
                assert!(x.iter().map(|x| x[lane].to_bits()).eq(alone.iter().map(|x| x.to_bits())), "{n} {lane}");
            }
        }
    }

    /// Rows taken four at a time give the same bits as one after the other, whatever is left over; x or the result may be padded.
    #[test]
    fn fours_of_rows_are_those_one_after_the_other() {
        let mut seed = Random(9);
        for (n, padding, from) in [(1, 0, 0), (2, 3, 1), (4, 0, 0), (9, 7, 2), (60, 4, 0), (61, 3, 59)] {
            let (t, x) = (random(&mut seed, n * n), random(&mut seed, n));
            let (mut out, mut expected) = (random(&mut seed, n), Vec::new());
            expected.clone_from(&out);
            for (row, x) in t.chunks_exact(n).zip(&x) {
                axpy(*x, row, &mut expected);
            }
            let padded: Vec<f64> = x.iter().copied().chain(vec![0.0; padding]).collect();
            add_transposed_times(&t, &padded, &mut out);
            assert_eq!(out, expected, "{n}: transposed");
            let mut out = vec![0.0; n + padding];
            times(&t, &x, &mut out);
            let expected: Vec<f64> = t.chunks_exact(n).map(|row| dot(&x, row)).collect();
            assert_eq!(out[..n], expected, "{n}: product");
            let mut b = x.clone();
            b[..from].fill(0.0);
            let mut expected = b.clone();
            for k in from..n {
                expected[k] /= t[k * n + k];
                let x = expected[k];
                axpy(-x, &t[k * n + k + 1..(k + 1) * n], &mut expected[k + 1..]);
            }
            for k in (1..n).rev() {
                let x = expected[k];
                axpy(-x, &t[k * n..k * n + k], &mut expected[..k]);
            }
            solve_transposed(&t, &mut b, from);
            assert_eq!(b, expected, "{n}: solution");
        }
    }

    #[test]
    fn lower_triangle_times_lanes() {
        let mut seed = Random(4);
        for n in [1, 2, 7, 61] {
            let t = random(&mut seed, n * n);
            let x: Vec<Lanes> = (0..n).map(|_| std::array::from_fn(|_| seed.normal())).collect();
            let mut out = x.clone();
            let t: Vec<f32> = t.iter().map(|t| *t as f32).collect();
            let triangle: Vec<f32> = (0..n).flat_map(|i| t[i * n..=i * n + i].to_vec()).collect();
            lower_times(&triangle, &mut out);
            for i in 0..n {
                for lane in 0..MAX_JOINTS {
                    let expected: f64 = (0..=i).map(|k| f64::from(t[i * n + k]) * x[k][lane]).sum();
                    assert!((out[i][lane] - expected).abs() < 1e-12, "{n} {i} {lane}");
                }
            }
        }
    }
}
