//! What coloured residuals leave of the certainty of a fit: a delete-block jackknife.
//!
//! The residuals of an arm are not white. Friction that the model has no term for repeats with the motion, joints err
//! together, and one parameter is touched by it where another is not: no single factor per joint says how much less the
//! rows are worth. Leaving out one stretch of time after the other says it for every direction of the parameter space.
//!
//! ```text
//! A = G Σ w ZᵀD + P⁻¹,  u_b = G Σ_b w Zᵀ(τ − D x)          scores of block b, all joints; G of the whole
//! x₍b₎ − x = −(A − A_b)⁻¹ u_b                               the fit without block b
//! J = (B − 1)/B Σ_b (x₍b₎ − x)(x₍b₎ − x)ᵀ + A⁻¹ P⁻¹ A⁻ᵀ     (Künsch 1989, Ann. Statist. 17(3); P is never left out)
//! ```
//!
//! Few blocks know the variance of many parameters badly and their covariance not at all (J has at most rank B), so J is
//! shrunk towards the covariance C of residuals that are coloured alike everywhere, inflated to fit:
//! `(1 − α)·J + α·c·C`.

use nalgebra::{DMatrix, DVector};

use super::fit::Method;
use super::sums::JointSums;
use super::undetermined::Undetermined;
use crate::linear::dot;

/// α: share of what counts all parameters alike. Between the two, agreement of runs of a measured arm hardly changes
/// (95 % either way); 0.5 keeps the matrix well conditioned.
const SHRINKAGE: f64 = 0.5;

/// The solved equations that the blocks are taken out of, in scaled columns.
pub(super) struct Whole<'a> {
    /// G·ΣwZᵀD + P⁻¹.
    pub(super) left: &'a DMatrix<f64>,
    /// Its inverse.
    pub(super) inverse: &'a DMatrix<f64>,
    /// What leads instruments to the regressor, G; none with least squares.
    pub(super) lead: Option<&'a DMatrix<f64>>,
    /// Diagonal of P⁻¹.
    pub(super) prior: &'a DVector<f64>,
    /// What a scaled value is multiplied by to be a value.
    pub(super) scale: &'a DVector<f64>,
    /// The fit, not scaled.
    pub(super) x: &'a DVector<f64>,
    /// Directions that keep the prior mean, with and without the block.
    pub(super) held: Option<&'a Undetermined>,
}

/// The covariance of a fit, scaled, given what it were (`plain`) if the residuals of a joint were coloured alike for all
/// parameters. `plain` again where leaving out a block leaves no solution.
pub(super) fn long_run(
    joints: &[JointSums],
    weights: &[f64],
    whole: &Whole<'_>,
    plain: DMatrix<f64>,
    method: Method,
) -> DMatrix<f64> {
    let Some(found) = jackknife(joints, weights, whole, method) else { return plain };
    let k = plain.nrows();
    let inflation = (0..k).map(|i| found[(i, i)] / plain[(i, i)]).sum::<f64>() / k as f64;
    if !(inflation.is_finite() && inflation > 0.0) {
        return plain;
    }
    let blend = found * (1.0 - SHRINKAGE) + &plain * (SHRINKAGE * inflation);
    // Blocks that happen to agree prove nothing better than rows that all count.
    let raise = DVector::from_fn(k, |i, _| (plain[(i, i)] / blend[(i, i)]).max(1.0).sqrt());
    DMatrix::from_fn(k, k, |i, j| blend[(i, j)] * raise[i] * raise[j])
}

/// J. `None` where leaving out a block leaves no solution.
fn jackknife(joints: &[JointSums], weights: &[f64], whole: &Whole<'_>, method: Method) -> Option<DMatrix<f64>> {
    let k = whole.x.len();
    let mut sum = DMatrix::zeros(k, k);
    let mut blocks = 0.0_f64;
    for b in 0..joints.first()?.stretches.len() {
        let Some((left, score)) = block_sums(joints, b, weights, whole, method) else { continue };
        let shift = (whole.left - left).lu().solve(&score)?;
        sum.ger(1.0, &shift, &shift, 1.0);
        blocks += 1.0;
    }
    let share = (blocks - 1.0).max(0.0) / blocks.max(1.0);
    let prior = whole.inverse * DMatrix::from_diagonal(whole.prior) * whole.inverse.transpose();
    Some(sum * share + prior)
}

/// `A_b` and `u_b` of block `b`, a stretch of time; `None` without rows.
fn block_sums(
    joints: &[JointSums],
    b: usize,
    weights: &[f64],
    whole: &Whole<'_>,
    method: Method,
) -> Option<(DMatrix<f64>, DVector<f64>)> {
    let k = whole.x.len();
    let (mut left, mut score) = (DMatrix::zeros(k, k), DVector::zeros(k));
    let mut any = false;
    for (joint, w) in joints.iter().zip(weights) {
        let stretch = &joint.stretches[b];
        if stretch.count == 0.0 {
            continue;
        }
        any = true;
        let (zd, _, zt) = stretch.projection(method);
        joint.spread(zd, *w, &mut left);
        let x: Vec<f64> = joint.columns.iter().map(|c| whole.x[*c]).collect();
        for ((row, zt), c) in zd.chunks_exact(x.len()).zip(zt).zip(&joint.columns) {
            score[*c] += w * (zt - dot(row, &x));
        }
    }
    let scale = whole.scale;
    let scaled = DMatrix::from_fn(k, k, |i, j| left[(i, j)] * scale[i] * scale[j]);
    let score = score.component_mul(scale);
    let led = |lead: &DMatrix<f64>| (lead * &scaled, lead * &score);
    any.then(|| {
        let (mut scaled, mut score) = whole.lead.map_or_else(|| (scaled.clone(), score.clone()), led);
        if let Some(held) = whole.held {
            held.take_out(&mut scaled, &mut score);
        }
        (scaled, score)
    })
}
