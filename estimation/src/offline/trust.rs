//! How far nominal values are trusted, chosen by the evidence of the rows.
//!
//! ```text
//! −2 ln p(τ|P) = Σ w‖τ − D·x₀‖² − bᵀA⁻¹b + ln det A + const
//! A = LᵀΣw DᵀD·L + 1,   b = LᵀΣw Dᵀ(τ − D·x₀),   P = L·Lᵀ
//! ```
//!
//! A narrow prior around wrong values leaves torque unexplained, a wide one spends its probability on arms that are not this
//! one; the most probable lies between (empirical Bayes). Rows are weighed by the noise and the colour of a fit that the data
//! alone decide, as in [`fit`](super::fit()). Nothing is left out and nothing is drawn, so the choice costs a few solutions
//! of the equations and hangs on no cut of the record.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use rivet_dynamics::{BaseSet, Model};

use super::fit::{Method, Noise, normals};
use super::prior::{Prior, Trust};
use super::record::OfflineError;
use super::sums::{Equations, Normal};

/// How much further than usual nominal values are tried to be off.
const WIDER: [f64; 5] = [1.0, 3.0, 10.0, 30.0, 100.0];
/// By how much ln p must rise for another trust than usual: rows are coloured and the model is not the arm, so that small differences
/// say nothing.
const DECISIVE: f64 = 10.0;
/// Turns of bodies and friction.
const TURNS: usize = 3;

impl Trust {
    /// The usual trust; where nominal values leave more torque of these rows than no model at all, the most probable one that is no
    /// narrower, bodies and friction chosen in turns. (On a short record almost any values fit, and evidence makes the prior of
    /// a sound file ever wider; those nearest to zero then say nothing of another motion.)
    ///
    /// * `nominal`: standard parameters
    /// * `wide`: by how much less than usual nominal values are trusted
    ///
    /// # Errors
    /// When shapes differ, a joint stands still, or the equations have no solution.
    pub fn evident(
        equations: &Equations<'_>,
        model: &Model,
        base: &BaseSet,
        nominal: &[f64],
        wide: f64,
    ) -> Result<Trust, OfflineError> {
        let prior = |trust: Trust| Prior::new(model, base, nominal, trust);
        let mut best = Trust::usual(wide);
        let weights = Noise::new(equations, &prior(best))?.weights();
        let joints = normals(equations, base.len(), Method::LeastSquares);
        let sums = Sums::new(&joints, &weights);
        let usual = sums.evidence(&prior(best), &joints);
        let mut most = usual;
        let left = equations.residual_percent(&base.from_standard(nominal));
        let worse = left.iter().map(|e| e * e).sum::<f64>() > 1e4 * left.len() as f64;
        if !worse {
            return Ok(best);
        }
        for _ in 0..TURNS {
            let before = best;
            for choose in [with_bodies as Choose, with_friction] {
                let found: Vec<(Trust, f64)> = WIDER
                    .par_iter()
                    .map(|wider| choose(best, wide * wider))
                    .map(|trust| (trust, sums.evidence(&prior(trust), &joints)))
                    .collect();
                for (trust, evidence) in found {
                    if evidence > most {
                        (best, most) = (trust, evidence);
                    }
                }
            }
            if best == before {
                break;
            }
        }
        Ok(if most > usual + DECISIVE { best } else { Trust::usual(wide) })
    }
}

type Choose = fn(Trust, f64) -> Trust;

fn with_bodies(trust: Trust, wide: f64) -> Trust {
    Trust { bodies: Trust::usual(wide).bodies, ..trust }
}

fn with_friction(trust: Trust, wide: f64) -> Trust {
    Trust { friction: Trust::usual(wide).friction, ..trust }
}

/// Weighed sums over all joints: Σw DᵀD, Σw Dᵀτ, Σw τ².
struct Sums {
    dd: DMatrix<f64>,
    dt: DVector<f64>,
    tt: f64,
}

impl Sums {
    fn new(joints: &[Normal], weights: &[f64]) -> Sums {
        let k = joints.first().map_or(0, |joint| joint.zt.len());
        let mut sums = Sums { dd: DMatrix::zeros(k, k), dt: DVector::zeros(k), tt: 0.0 };
        for (joint, w) in joints.iter().zip(weights) {
            sums.dd += &joint.dd * *w;
            sums.dt += &joint.zt * *w;
            sums.tt += joint.torque_square * w;
        }
        sums
    }

    /// ln p of the rows, but for what all priors share; −∞ where it cannot be told.
    fn evidence(&self, prior: &Prior, joints: &[Normal]) -> f64 {
        let x0 = DVector::from_column_slice(&prior.centre);
        let Some(root) = prior.root(joints) else { return f64::NEG_INFINITY };
        let mut left = root.tr_mul(&(&self.dd * &root));
        for i in 0..x0.len() {
            left[(i, i)] += 1.0;
        }
        let bent = &self.dd * &x0;
        let right = root.tr_mul(&(&self.dt - &bent));
        let Some(factor) = left.cholesky() else { return f64::NEG_INFINITY };
        let Some(half) = factor.l().solve_lower_triangular(&right) else { return f64::NEG_INFINITY };
        let unexplained = self.tt - 2.0 * self.dt.dot(&x0) + bent.dot(&x0) - half.norm_squared();
        let determinant: f64 = factor.l().diagonal().iter().map(|d| 2.0 * d.ln()).sum();
        let evidence = -0.5 * (unexplained.max(0.0) + determinant);
        if evidence.is_finite() { evidence } else { f64::NEG_INFINITY }
    }
}
