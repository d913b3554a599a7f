//! Eigenvalues and eigenvectors of a symmetric matrix, in steps of bounded work.
//!
//! Householder tridiagonalisation and the implicit QL iteration (Golub & Van Loan, Matrix Computations, 8.3; the
//! ordering of QL follows EISPACK's tql2). Chosen over Jacobi rotations because it is two to four times cheaper from a
//! cold start, and because a scheme that tracks the basis by rotations is judged beside it and shares nothing with it.

use crate::kernels::{add_two_products, reflect, rotate_neighbours, times_from};
use crate::linear::{Budget, axpy, dot};

#[derive(Clone, Copy, Debug, PartialEq)]
enum Stage {
    Reduce { k: usize },
    Accumulate { k: usize },
    Iterate { l: usize, rounds: usize },
    Done,
}

/// QL needs 1.7 rounds an eigenvalue on average; EISPACK gives up after 30.
const MAX_QL_ROUNDS: usize = 50;

/// Decomposition `A = V·Λ·Vᵀ` of a matrix whose size is fixed at construction.
#[derive(Clone, Debug)]
pub struct SymmetricEigen {
    n: usize,
    /// The matrix, then its reflections and what they are multiplied to; at the end row i is eigenvector i.
    rows: Vec<f64>,
    /// Eigenvalues, in no order.
    values: Vec<f64>,
    /// Below the diagonal of the tridiagonal matrix; entry k couples k and k + 1.
    e: Vec<f64>,
    /// Of the reflections, then the cosines of a round of QL.
    beta: Vec<f64>,
    /// Products, then the sines of a round.
    scratch: Vec<f64>,
    stage: Stage,
    converged: bool,
}

impl SymmetricEigen {
    /// Room for n x n.
    #[must_use]
    pub fn new(n: usize) -> SymmetricEigen {
        SymmetricEigen {
            n,
            rows: vec![0.0; n * n],
            values: vec![0.0; n],
            e: vec![0.0; n],
            beta: vec![0.0; n],
            scratch: vec![0.0; n],
            stage: Stage::Done,
            converged: false,
        }
    }

    /// Begins the decomposition of the symmetric, row-major `a`.
    pub fn start(&mut self, a: &[f64]) {
        self.rows.copy_from_slice(a);
        self.stage = Stage::Reduce { k: 0 };
        self.converged = true;
    }

    /// The same from a lower triangle, [`packed`](crate::linear::packed).
    pub(crate) fn start_packed(&mut self, triangle: &[f64]) {
        for i in 0..self.n {
            for (j, &value) in triangle[crate::linear::packed(i)].iter().enumerate() {
                self.rows[i * self.n + j] = value;
                self.rows[j * self.n + i] = value;
            }
        }
        self.stage = Stage::Reduce { k: 0 };
        self.converged = true;
    }

    /// Does one step of work (about 10⁵ multiply-adds); true when the decomposition is complete.
    pub fn advance(&mut self) -> bool {
        self.advance_within(&mut Budget::step())
    }

    /// The same with what is left of a step.
    pub(crate) fn advance_within(&mut self, budget: &mut Budget) -> bool {
        while !budget.is_spent() {
            budget.charge(match self.stage {
                Stage::Reduce { k } => self.reduce(k),
                Stage::Accumulate { k } => self.accumulate(k),
                Stage::Iterate { l, rounds } => self.iterate(l, rounds),
                Stage::Done => return true,
            });
        }
        self.stage == Stage::Done
    }

    /// Eigenvalues, in the order of [`vectors`](Self::vectors).
    #[must_use]
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// Eigenvectors as the rows of an n x n row-major matrix.
    #[must_use]
    pub fn vectors(&self) -> &[f64] {
        &self.rows
    }

    /// False if an iteration did not end or the matrix was not finite; the results then mean nothing.
    #[must_use]
    pub fn converged(&self) -> bool {
        self.converged
    }

    /// Step k of `A ← HₖAHₖ`, `Hₖ = 1 − β·v·vᵀ`, that clears column k below the subdiagonal. v stays in row k of `a`
    /// right of the diagonal: what lies below is not needed any more.
    fn reduce(&mut self, k: usize) -> usize {
        let n = self.n;
        if k + 1 >= n {
            for i in 0..n {
                self.values[i] = self.rows[i * n + i];
            }
            self.e[n.saturating_sub(1)] = 0.0;
            let first = n.saturating_sub(2);
            for i in first..n {
                self.rows[i * n + first..(i + 1) * n].fill(0.0);
                self.rows[i * n + i] = 1.0;
            }
            self.stage = if n > 2 { Stage::Accumulate { k: n - 3 } } else { Stage::Iterate { l: 0, rounds: 0 } };
            return n;
        }
        let (above, below) = self.rows.split_at_mut((k + 1) * n);
        let v = &mut above[k * n + k + 1..];
        let size = v.len();
        let tail = dot(&v[1..], &v[1..]);
        if tail == 0.0 {
            self.e[k] = v[0];
            self.beta[k] = 0.0;
        } else {
            let alpha = v[0];
            let length = (alpha * alpha + tail).sqrt();
            // The sign that adds, not cancels.
            let target = if alpha > 0.0 { -length } else { length };
            v[0] = alpha - target;
            let beta = 2.0 / (v[0] * v[0] + tail);
            self.e[k] = target;
            self.beta[k] = beta;
            let p = &mut self.scratch[..size];
            times_from(below, k + 1, v, p);
            for p in &mut *p {
                *p *= beta;
            }
            let share = 0.5 * beta * dot(p, v);
            axpy(-share, v, p);
            add_two_products(below, k + 1, v, p);
        }
        self.stage = Stage::Reduce { k: k + 1 };
        3 * size * size
    }

    /// Builds `Q = H₀·H₁·…` from the last reflection to the first; `rows` holds Qᵀ from row and column k + 1 on, the identity
    /// before them left out: reflections lie there.
    fn accumulate(&mut self, k: usize) -> usize {
        let n = self.n;
        let (above, below) = self.rows.split_at_mut((k + 1) * n);
        let row = &mut above[k * n + k..];
        let v = &mut self.scratch[..n - k - 1];
        v.copy_from_slice(&row[1..]);
        row.fill(0.0);
        row[0] = 1.0;
        for row in below.chunks_exact_mut(n) {
            row[k] = 0.0;
        }
        let beta = self.beta[k];
        if beta != 0.0 {
            reflect(below, k + 1, beta, v);
        }
        self.stage = if k == 0 { Stage::Iterate { l: 0, rounds: 0 } } else { Stage::Accumulate { k: k - 1 } };
        2 * (n - k) * (n - k)
    }

    /// One implicit QL round on the block that starts at l, or the move to the next eigenvalue.
    fn iterate(&mut self, l: usize, rounds: usize) -> usize {
        let n = self.n;
        if l >= n {
            self.converged &= self.values.iter().all(|v| v.is_finite());
            self.stage = Stage::Done;
            return n;
        }
        let (d, e) = (&mut self.values, &mut self.e);
        let mut m = l;
        while m + 1 < n {
            let near = d[m].abs() + d[m + 1].abs();
            if e[m].abs() <= f64::EPSILON * near {
                break;
            }
            m += 1;
        }
        if m == l {
            self.stage = Stage::Iterate { l: l + 1, rounds: 0 };
            return n;
        }
        if rounds >= MAX_QL_ROUNDS || !e[l].is_finite() || !d[l].is_finite() {
            self.converged = false;
            self.stage = Stage::Done;
            return n;
        }
        let mut g = (d[l + 1] - d[l]) / (2.0 * e[l]);
        let mut r = length(g, 1.0);
        g = d[m] - d[l] + e[l] / (g + r.copysign(g));
        let (mut s, mut c, mut p) = (1.0, 1.0, 0.0);
        let mut i = m;
        let mut split = false;
        while i > l {
            i -= 1;
            let f = s * e[i];
            let b = c * e[i];
            r = length(f, g);
            e[i + 1] = r;
            if r == 0.0 {
                // The block falls apart here: finish it in the next rounds.
                d[i + 1] -= p;
                e[m] = 0.0;
                split = true;
                break;
            }
            s = f / r;
            c = g / r;
            g = d[i + 1] - p;
            r = (d[i] - g) * s + 2.0 * c * b;
            p = s * r;
            d[i + 1] = g + p;
            g = c * r - b;
            // The rows follow when the round is done.
            (self.beta[i], self.scratch[i]) = (c, s);
        }
        let first = if split { i + 1 } else { i };
        rotate_neighbours(&mut self.rows[first * n..(m + 1) * n], n, &self.beta[first..m], &self.scratch[first..m]);
        if !split {
            d[l] -= p;
            e[l] = g;
            e[m] = 0.0;
        }
        self.stage = Stage::Iterate { l, rounds: rounds + 1 };
        3 * (m - l) * n
    }
}

/// `√(a² + b²)`. A C library's `hypot` takes twice as long, and its last bit depends on which one it is; it is left to what
/// the squares have no room for.
fn length(a: f64, b: f64) -> f64 {
    let square = a * a + b * b;
    if (1e-280..1e280).contains(&square) { square.sqrt() } else { a.hypot(b) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linear::tests::Random;

    fn decompose(a: &[f64], n: usize) -> SymmetricEigen {
        let mut eigen = SymmetricEigen::new(n);
        eigen.start(a);
        while !eigen.advance() {}
        eigen
    }

    /// Laws: VᵀV = 1, A·v = λ·v, trace = Σλ; on random Gram matrices of full and of low rank.
    #[test]
    fn vectors_are_orthonormal_and_eigen() {
        let mut random = Random(5);
        for (n, rank) in [(1, 1), (2, 2), (3, 1), (10, 4), (60, 60), (60, 20)] {
            let rows: Vec<f64> = (0..rank * n).map(|_| random.normal()).collect();
            let mut a = vec![0.0; n * n];
            for row in rows.chunks_exact(n) {
                for i in 0..n {
                    axpy(row[i], row, &mut a[i * n..(i + 1) * n]);
                }
            }
            let eigen = decompose(&a, n);
            assert!(eigen.converged());
            let largest = eigen.values().iter().fold(0.0_f64, |m, v| m.max(*v));
            let trace: f64 = (0..n).map(|i| a[i * n + i]).sum();
            assert!((eigen.values().iter().sum::<f64>() - trace).abs() < 1e-12 * trace * n as f64);
            for (i, v) in eigen.vectors().chunks_exact(n).enumerate() {
                for (j, w) in eigen.vectors().chunks_exact(n).enumerate() {
                    assert!((dot(v, w) - f64::from(u8::from(i == j))).abs() < 1e-13 * n as f64);
                }
                for k in 0..n {
                    let residual = dot(&a[k * n..(k + 1) * n], v) - eigen.values()[i] * v[k];
                    assert!(residual.abs() < 1e-13 * largest * n as f64, "{n} {rank} {i}: {residual}");
                }
            }
            assert_eq!(eigen.values().iter().filter(|&&v| v > 1e-10 * largest).count(), rank);
        }
    }

    #[test]
    fn diagonal_zero_and_bad_matrices() {
        let eigen = decompose(&[3.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 2.0], 3);
        assert_eq!(eigen.values(), [3.0, 1.0, 2.0]);
        assert!(decompose(&[0.0; 16], 4).converged());
        assert!(!decompose(&[f64::NAN; 16], 4).converged());
        assert!(!decompose(&[1.0, f64::INFINITY, f64::INFINITY, 1.0], 2).converged());
    }
}
