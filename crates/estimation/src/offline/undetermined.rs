//! Directions of the parameter space that the rows do not determine: they keep the prior mean.
//!
//! In units of the prior's deviations, u = P^(−1/2)·(x − x₀), the rows have the information Λ with eigenvalues λ and eigenvectors v. The
//! solution has the components v·g/(1 + λ). Where λ is small g is hardly more than what the model lacks, which no noise explains
//! and no row averages. Components with λ below `MIN_INFORMATION` are 0 instead, and their variance is the prior's.

use nalgebra::{DMatrix, DVector, SymmetricEigen};

/// Information over that of the prior from which on the rows determine a direction: with less they lower the prior's deviation by less than a
/// twentieth. The prior is wide, so a larger bound takes directions that measured logs do determine.
const MIN_INFORMATION: f64 = 0.1;
/// Steps of the eigenvalue iteration per parameter. It converges in two or three; without convergence nothing is held.
const MAX_SWEEPS: usize = 30;

/// Deviations of the prior that are rounding.
const PRIOR_UNIT_ROUNDING: f64 = 1e-12;

/// Directions that the rows do not determine, in scaled columns.
pub(super) struct Undetermined {
    /// Roots of the diagonal of P⁻¹, scaled.
    root: DVector<f64>,
    /// Unit vectors of u, a column each.
    directions: DMatrix<f64>,
    /// 1/(1 + λ) of each.
    share: DVector<f64>,
}

impl Undetermined {
    /// * `inverse`: (Λ + P⁻¹)⁻¹, scaled
    /// * `prior`: diagonal of P⁻¹, scaled
    pub(super) fn new(inverse: &DMatrix<f64>, prior: &DVector<f64>) -> Undetermined {
        let k = prior.len();
        let root = prior.map(f64::sqrt);
        let share = DMatrix::from_fn(k, k, |i, j| 0.5 * root[i] * root[j] * (inverse[(i, j)] + inverse[(j, i)]));
        let none = || Undetermined { root: root.clone(), directions: DMatrix::zeros(k, 0), share: DVector::zeros(0) };
        if share.iter().any(|x| !x.is_finite()) {
            return none();
        }
        let Some(eigen) = SymmetricEigen::try_new(share, f64::EPSILON, MAX_SWEEPS * k) else { return none() };
        let most = 1.0 / (1.0 + MIN_INFORMATION);
        let found: Vec<usize> = (0..k).filter(|i| eigen.eigenvalues[*i] > most).collect();
        let directions = DMatrix::from_fn(k, found.len(), |i, c| eigen.eigenvectors[(i, found[c])]);
        let share = DVector::from_fn(found.len(), |c, _| eigen.eigenvalues[found[c]]);
        Undetermined { root, directions, share }
    }

    /// The directions as unit vectors of u.
    pub(super) fn directions(&self) -> Vec<Vec<f64>> {
        self.directions.column_iter().map(|v| v.iter().copied().collect()).collect()
    }

    /// Takes the rows' information of these directions out of Λ + P⁻¹ and of its inverse, scaled.
    pub(super) fn hold(&self, left: &mut DMatrix<f64>, inverse: &mut DMatrix<f64>) {
        for (v, share) in self.directions.column_iter().zip(self.share.iter()) {
            let (up, down) = (v.component_mul(&self.root), v.component_div(&self.root));
            left.ger(1.0 - 1.0 / share, &up, &up, 1.0);
            inverse.ger(1.0 - share, &down, &down, 1.0);
        }
    }

    /// Puts these directions of the scaled values `x` at the prior mean.
    pub(super) fn keep_mean(&self, x: &mut DVector<f64>, mean: &DVector<f64>) {
        if self.directions.ncols() == 0 {
            return;
        }
        let mut u = (&*x - mean).component_mul(&self.root);
        for v in self.directions.column_iter() {
            u.axpy(-v.dot(&u), &v, 1.0);
        }
        // What only these directions have is the mean to the last bit.
        let rounding = |u: f64| if u.abs() < PRIOR_UNIT_ROUNDING { 0.0 } else { u };
        *x = mean + u.map(rounding).component_div(&self.root);
    }

    /// Takes these directions out of the information `left` and the gradient `score` of some rows, scaled.
    pub(super) fn take_out(&self, left: &mut DMatrix<f64>, score: &mut DVector<f64>) {
        for v in self.directions.column_iter() {
            let (up, down) = (v.component_mul(&self.root), v.component_div(&self.root));
            score.axpy(-down.dot(score), &up, 1.0);
            let row = left.tr_mul(&down);
            left.ger(-1.0, &up, &row, 1.0);
            let column = &*left * &down;
            left.ger(-1.0, &column, &up, 1.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::linear::tests::Random;
    use crate::offline::bias::tests::rows;
    use crate::offline::{Determined, Equations, Method, fit};

    const PRIOR: f64 = 10.0;

    /// Columns 3 and 4 differ by a ten-thousandth of their size, and a torque that the model lacks follows the difference: it alone would ask for
    /// a difference of 500.
    #[test]
    fn directions_that_the_rows_do_not_determine_keep_the_prior_mean() {
        for (seed, method) in [(1, Method::LeastSquares), (2, Method::Instrumental), (3, Method::LeastSquares)] {
            let mut random = Random(seed);
            let (mut rows, x) = rows(0.0, &mut random);
            for joint in &mut rows[0].joints {
                for row in 0..joint.tau.len() {
                    let difference = random.normal();
                    for side in [&mut joint.d, &mut joint.z] {
                        side[5 * row + 4] = side[5 * row + 3] + 1e-4 * difference;
                    }
                    let d = &joint.d[5 * row..5 * row + 5];
                    joint.tau[row] =
                        d.iter().zip(&x).map(|(d, x)| d * x).sum::<f64>() + 0.05 * difference + 0.3 * random.normal();
                }
            }
            let nominal: Vec<f64> = x.iter().map(|x| 1.1 * x).collect();
            let found = fit(&Equations::new(&rows), &nominal, PRIOR, method).expect("solved");
            assert_eq!(found.undetermined.len(), 1, "{:?}", found.undetermined);
            let moved = |i: usize| (found.values[i] - nominal[i]) / (PRIOR * nominal[i].abs());
            let along: f64 = found.undetermined[0].iter().enumerate().map(|(i, v)| v * moved(i)).sum();
            assert!(along.abs() < 1e-9, "seed {seed}: {along} deviations of the prior");
            // Their sum is determined, and so are the others.
            assert!((found.values[3] + found.values[4] - 3.0).abs() < 0.1, "{:?}", found.values);
            assert_eq!(found.determined[..3], [Determined::ByData; 3]);
            assert_eq!(found.determined[4], Determined::ByPrior);
            assert!(found.std[3] > 0.4 * PRIOR && (found.values[3] - nominal[3]).abs() < 1.0, "{:?}", found.values);
        }
    }
}
