//! SIFt-RLS: least squares that forgets only in the subspace of each sample (Lai & Bernstein 2024, arXiv 2404.10844).
//!
//! `R ← R − (1−λ)·R·v·(vᵀRv)⁻¹·vᵀR + ΦᵀΦ`, v an orthonormal basis of the rows of Φ, singular values below √ε dropped;
//! `x ← x + R⁻¹·Φᵀ(τ − Φx)`. A baseline of the study; the daemon has none of it.

use rivet_estimation::eigen::SymmetricEigen;

/// State in scaled parameters.
pub struct Sift {
    n: usize,
    lambda: f64,
    r: Vec<f64>,
    /// Scaled parameters.
    pub x: Vec<f64>,
}

/// Squares of singular values below this do not forget.
const EPSILON: f64 = 1.0;

impl Sift {
    /// Starts at `x` with information `1/std²`.
    #[must_use]
    pub fn new(x: Vec<f64>, std: &[f64], lambda: f64) -> Sift {
        let n = x.len();
        let mut r = vec![0.0; n * n];
        for i in 0..n {
            r[i * n + i] = std[i].powi(-2);
        }
        Sift { n, lambda, r, x }
    }

    /// Takes in scaled rows `phi` (p x n) and torques.
    pub fn update(&mut self, phi: &[f64], tau: &[f64]) {
        let (n, p) = (self.n, tau.len());
        let row = |k: usize| &phi[k * n..(k + 1) * n];
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let mut gram = vec![0.0; p * p];
        for i in 0..p {
            for j in 0..p {
                gram[i * p + j] = dot(row(i), row(j));
            }
        }
        let mut eigen = SymmetricEigen::new(p);
        eigen.start(&gram);
        while !eigen.advance() {}
        let mut basis: Vec<Vec<f64>> = Vec::new();
        for k in 0..p {
            let value = eigen.values()[k];
            if value > EPSILON {
                let mut v = vec![0.0; n];
                for i in 0..p {
                    let share = eigen.vectors()[k * p + i] / value.sqrt();
                    v.iter_mut().zip(row(i)).for_each(|(v, x)| *v += share * x);
                }
                basis.push(v);
            }
        }
        let rank = basis.len();
        let images: Vec<Vec<f64>> =
            basis.iter().map(|v| (0..n).map(|i| dot(&self.r[i * n..(i + 1) * n], v)).collect()).collect();
        let mut small = vec![0.0; rank * rank];
        for i in 0..rank {
            for j in 0..rank {
                small[i * rank + j] = dot(&basis[i], &images[j]);
            }
        }
        if let Some(factor) = cholesky(&small, rank) {
            // L⁻¹·(R·v)ᵀ: the part that is forgotten is its square.
            let mut part = images;
            for i in 0..rank {
                let (done, rest) = part.split_at_mut(i);
                for (j, done) in done.iter().enumerate() {
                    let share = factor[i * rank + j];
                    rest[0].iter_mut().zip(done).for_each(|(x, y)| *x -= share * y);
                }
                rest[0].iter_mut().for_each(|x| *x /= factor[i * rank + i]);
            }
            for w in &part {
                for i in 0..n {
                    let share = (1.0 - self.lambda) * w[i];
                    self.r[i * n..(i + 1) * n].iter_mut().zip(w).for_each(|(r, w)| *r -= share * w);
                }
            }
        }
        let mut gradient = vec![0.0; n];
        for k in 0..p {
            let error = tau[k] - dot(row(k), &self.x);
            for i in 0..n {
                gradient[i] += row(k)[i] * error;
                let share = row(k)[i];
                self.r[i * n..(i + 1) * n].iter_mut().zip(row(k)).for_each(|(r, x)| *r += share * x);
            }
        }
        if let Some(factor) = cholesky(&self.r, n) {
            for i in 0..n {
                gradient[i] = (gradient[i] - dot(&factor[i * n..i * n + i], &gradient[..i])) / factor[i * n + i];
            }
            for i in (0..n).rev() {
                gradient[i] /= factor[i * n + i];
                let value = gradient[i];
                for j in 0..i {
                    gradient[j] -= factor[i * n + j] * value;
                }
            }
            self.x.iter_mut().zip(&gradient).for_each(|(x, step)| *x += step);
        }
    }
}

/// Lower factor, or `None` if the matrix is not positive definite.
fn cholesky(a: &[f64], n: usize) -> Option<Vec<f64>> {
    let mut l = vec![0.0; n * n];
    for i in 0..n {
        for j in 0..=i {
            let rest = a[i * n + j] - (0..j).map(|k| l[i * n + k] * l[j * n + k]).sum::<f64>();
            if i == j {
                if rest <= 0.0 {
                    return None;
                }
                l[i * n + i] = rest.sqrt();
            } else {
                l[i * n + j] = rest / l[j * n + j];
            }
        }
    }
    Some(l)
}
