//! Is least squares biased, and can the instruments be trusted?
//!
//! Noise in the positions is noise in the regressor, which pulls least squares but not instrumental variables. If there
//! is none, both estimate the same and only torque noise sets them apart (Durbin 1954, Wu 1973, Hausman 1978):
//!
//! ```text
//! H = (x_IV − x_LS)ᵀ·[cov_IV − cov_LS]⁺·(x_IV − x_LS)  ~  χ²(rank)
//! ```
//!
//! Both with the same weights: then the difference of the covariances cannot be negative. In the directions tested, cov_LS is
//! made 1 and cov_IV diagonal: a bias of b deviations of LS along one of them adds b²/(λ − 1) to H, λ the ratio of variances there.
//! Instruments that are much worse than the regressor hide a bias that is many times what LS states of itself.

use nalgebra::{DMatrix, DVector};

use super::fit::{Fit, Method, Solution};
use super::record::OfflineError;
use super::sums::{Equations, JointSums, Normal};

/// Directions in which instruments cost less than this share of the variance say nothing: regressor and instruments
/// are the same there, and what is left is rounding.
const SAME: f64 = 1e-6;

/// What sets least squares and instruments apart.
#[derive(Clone, Debug, PartialEq)]
pub struct Bias {
    /// H.
    pub hausman: f64,
    /// Directions in which regressor and instruments differ.
    pub degrees: usize,
    /// Standard deviation by instruments over that by least squares, the prior left out of both, in the median of the directions that
    /// the data decide by least squares; infinite where there is none, NaN where it is not known.
    pub spread: f64,
    /// Probability of an H as large as this if the regressor has no noise and the model is complete.
    pub p_value: f64,
    /// Per joint: the largest element of E{(d−d*)(d−d*)ᵀ} over that of E{(d−d*)·d*ᵀ}, columns in units of torque (times
    /// the identified values). What noise in the regressor puts on least squares, over what is left of it with instruments; near 1 the
    /// instruments see the noise as well. Empty with delayed instruments, which differ from the regressor by motion.
    pub ratio: Vec<f64>,
}

/// Instruments so many times as uncertain as least squares, in half of the directions or more, are too weak: one over this is
/// their correlation with what they stand for. Of measured arms the ratio is 1.00 to 1.05, with a setpoint that was not recorded 4
/// (the prior then keeps both from going further apart).
const BLIND: f64 = 3.0;

impl Bias {
    /// Whether a large p-value says nothing: the instruments are too weak to show a bias, or are the regressor itself.
    #[must_use]
    pub fn blind(&self) -> bool {
        self.degrees == 0 || self.spread > BLIND
    }
}

/// Compares both methods on the same rows, weighed by the noise of `fit` and by its trust in rows beside a stop.
///
/// * `nominal`, `prior`: as for [`fit`](super::fit())
///
/// # Errors
/// When the equations of one method have no solution.
pub fn bias(equations: &Equations<'_>, nominal: &[f64], prior: f64, fit: &Fit) -> Result<Bias, OfflineError> {
    let k = nominal.len();
    let x0 = DVector::from_column_slice(nominal);
    let weights = fit.weights();
    let sums = equations.trusting(&fit.trust);
    let solve = |method| {
        let joints: Vec<Normal> = sums.iter().map(|joint| Normal::new(joint, k, method)).collect();
        Solution::new(&joints, &weights, &x0, (prior, equations.most()), method)
    };
    // The scale is that of the regressor, so it is the same for both, and so is the prior.
    let (least_squares, instrumental) = (solve(Method::LeastSquares)?, solve(Method::Instrumental)?);
    let shift = (instrumental.x.clone() - &least_squares.x).component_div(&least_squares.scale);
    let covariances = [least_squares.covariance(), instrumental.covariance()];
    let Statistic { hausman, degrees, spread } = statistic(&shift, &covariances, &least_squares.prior)?;
    let delayed = equations.rows.iter().any(|r| r.lags.is_empty());
    let ratio = if delayed { Vec::new() } else { sums.iter().map(|joint| ratio(joint, &fit.values)).collect() };
    Ok(Bias { hausman, degrees, spread, p_value: crate::chi_square::above(hausman, degrees), ratio })
}

struct Statistic {
    hausman: f64,
    degrees: usize,
    spread: f64,
}

/// H, in coordinates in which the covariance of least squares is 1. `covariances`: of least squares, by instruments; `prior`: the
/// diagonal of the information that both have beside the data's.
fn statistic(
    shift: &DVector<f64>,
    [own, other]: &[DMatrix<f64>; 2],
    prior: &DVector<f64>,
) -> Result<Statistic, OfflineError> {
    let singular = OfflineError::Singular { method: "Durbin-Wu-Hausman" };
    let symmetric = |m: &DMatrix<f64>| (m + m.transpose()) * 0.5;
    let root = symmetric(own).cholesky().ok_or_else(|| singular.clone())?.l();
    let inverse = root.clone().try_inverse().ok_or(singular)?;
    let shift = &inverse * shift;
    let eigen = symmetric(&(&inverse * other * inverse.transpose())).symmetric_eigen();
    let along = eigen.eigenvectors.transpose() * &shift;
    let seen = || eigen.eigenvalues.iter().zip(along.iter()).filter(|(value, _)| **value - 1.0 > SAME);
    let hausman = seen().fold(0.0, |sum, (value, along)| sum + along * along / (value - 1.0));
    // What is believed before makes both equally certain where the instruments say nothing.
    let directions = root * &eigen.eigenvectors;
    let mut ratios: Vec<f64> = (0..shift.len())
        .filter_map(|k| {
            let believed = directions.column(k).component_mul(&directions.column(k)).dot(prior);
            let by_instruments = (1.0 / eigen.eigenvalues[k] - believed).max(f64::MIN_POSITIVE);
            (believed < 0.5).then(|| ((1.0 - believed) / by_instruments).sqrt())
        })
        .collect();
    ratios.sort_unstable_by(f64::total_cmp);
    let spread = ratios.get(ratios.len() / 2).map_or(f64::INFINITY, |median| *median);
    Ok(Statistic { hausman, degrees: seen().count(), spread })
}

/// Ratio of the dominant elements for one joint, columns times `values`; infinite when regressor and instruments are the
/// same.
fn ratio(joint: &JointSums, values: &[f64]) -> f64 {
    let n = joint.columns.len();
    let (dd, zd, zz) = (joint.total(|s| &s.dd), joint.total(|s| &s.zd), joint.total(|s| &s.zz));
    let entry = |i: usize, j: usize, sum: f64| (sum * values[joint.columns[i]] * values[joint.columns[j]]).abs();
    let (mut own, mut cross) = (0.0_f64, 0.0_f64);
    for i in 0..n {
        for j in 0..n {
            let (dz, at) = (zd[j * n + i], i * n + j);
            own = own.max(entry(i, j, dd[at] - dz - zd[at] + zz[at]));
            cross = cross.max(entry(i, j, dz - zz[at]));
        }
    }
    if cross > 0.0 { own / cross } else { f64::INFINITY }
}

#[cfg(test)]
pub(super) mod tests {
    use std::f64::consts::TAU;
    use std::path::PathBuf;
    use std::sync::Arc;

    use rivet_dynamics::{Arm, BaseSet, Joints, Model, Structure};

    use super::super::rows::{FilteredTorque, JointRows, Rows};
    use super::*;
    use crate::linear::tests::Random;
    use crate::offline::lag::Lag;
    use crate::offline::{InstrumentSource, OfflineSettings, Record, Trajectory, fit};

    /// Two joints and five columns; `noise` on the regressor, instruments off by as much as a tenth of the signal.
    pub(crate) fn rows(noise: f64, random: &mut Random) -> (Vec<Rows>, Vec<f64>) {
        let x = vec![3.0, -1.0, 0.5, 2.0, 1.0];
        let mut joints = Vec::new();
        for _ in 0..2 {
            let mut joint = JointRows { columns: (0..5).collect(), ..JointRows::default() };
            for at in 0..300 {
                joint.place.push(at);
                joint.beside.push(false);
                let exact: Vec<f64> = (0..5).map(|_| random.normal()).collect();
                joint.tau.push(exact.iter().zip(&x).map(|(d, x)| d * x).sum::<f64>() + 0.3 * random.normal());
                joint.d.extend(exact.iter().map(|d| d + noise * random.normal()));
                joint.z.extend(exact.iter().map(|d| d + 0.1 * random.normal()));
            }
            joints.push(joint);
        }
        let (left_out, lags) = (vec![0.0; 2], vec![Lag::NONE; 2]);
        let torque = Arc::new(FilteredTorque { joints: joints.iter().map(|j| j.tau.clone()).collect(), period_s: 0.1 });
        let rows = Rows {
            columns: 5,
            joints,
            kept: 300,
            row_period_s: 0.1,
            independent_hz: 10.0,
            torque,
            most: Arc::from([]),
            first: 0,
            left_out,
            moving: 0..300,
            lags,
        };
        (vec![rows], x)
    }

    fn judge(noise: f64, seed: u64) -> Bias {
        let (rows, x) = rows(noise, &mut Random(seed));
        let equations = Equations::new(&rows);
        let found = fit(&equations, &x, 10.0, Method::Instrumental).expect("solved");
        bias(&equations, &x, 10.0, &found).expect("judged")
    }

    #[test]
    fn without_regressor_noise_p_values_are_uniform() {
        let count = 500;
        let mut p: Vec<f64> = (0..count).map(|seed| judge(0.0, 1000 + seed).p_value).collect();
        p.sort_by(f64::total_cmp);
        // Kolmogorov-Smirnov distance; above 1.63/sqrt(count) in one of a hundred samples.
        let off = |(i, p): (usize, &f64)| {
            let (below, above) = (i as f64 / count as f64, (i + 1) as f64 / count as f64);
            (p - below).abs().max((p - above).abs())
        };
        let distance = p.iter().enumerate().map(off).fold(0.0_f64, f64::max);
        println!("Kolmogorov-Smirnov distance {distance:.4} of {:.4}", 1.63 / (count as f64).sqrt());
        assert!(distance < 1.63 / (count as f64).sqrt(), "{distance}");
    }

    /// Instruments that have nothing to do with the motion: beside the prior, which has the other half of every direction, ZᵀD has
    /// either sign and may cancel it. What they leave is the prior's, and is stated as such.
    #[test]
    fn instruments_of_something_else_leave_the_prior() {
        let (prior, mut farthest) = (0.3, 0.0_f64);
        for seed in 0..50 {
            let mut random = Random(4000 + seed);
            let (mut rows, x) = rows(0.0, &mut random);
            rows[0].joints.iter_mut().flat_map(|joint| &mut joint.z).for_each(|z| *z = random.normal());
            let nominal: Vec<f64> = x.iter().map(|x| 1.2 * x).collect();
            let equations = Equations::new(&rows);
            let found = fit(&equations, &nominal, prior, Method::Instrumental).expect("solved");
            for ((value, std), nominal) in found.values.iter().zip(&found.std).zip(&nominal) {
                let width = prior * nominal.abs();
                farthest = farthest.max((value - nominal).abs() / width);
                assert!(*std < 2.0 * width, "seed {seed}: {value} +- {std} of {nominal} +- {width}");
            }
            let bias = bias(&equations, &nominal, prior, &found).expect("judged");
            assert!(bias.blind(), "seed {seed}: {bias:?}");
        }
        println!("farthest from nominal: {farthest:.2} deviations of the prior");
        assert!(farthest < 3.0, "{farthest}");
    }

    #[test]
    fn regressor_noise_is_found() {
        let found: Vec<Bias> = (0..50).map(|seed| judge(0.2, seed)).collect();
        let rejected = found.iter().filter(|b| b.p_value < 0.01).count();
        assert!(rejected >= 48, "{rejected} of 50");
        assert!(found.iter().all(|b| b.degrees == 5));
    }

    /// The two-link direct-drive arm at 0.8 and 1.1 Hz and 1 ms, unfiltered, with encoders of the resolution that makes
    /// acceleration noise exceed its signal, behind critically damped position loops. The paper has 65 to 300; it
    /// depends on how far the arm is from the command.
    #[test]
    fn instruments_take_out_what_the_paper_says() {
        let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../robots/dd2/robot.urdf");
        let text = std::fs::read_to_string(path).expect("a URDF of the project");
        let arm = Arm::from_urdf(&text, [0.0, 0.0, -9.81]).expect("an arm");
        let model = Model::new(arm, Structure::default());
        let base = BaseSet::new(&model).expect("a base");
        let drives = Joints {
            rotor_inertia: vec![0.0; 2],
            viscous: vec![2.288, 0.175],
            coulomb: vec![7.17, 1.734],
            ..Joints::default()
        };
        let values = base.from_standard(&model.nominal(&drives));
        let (period, loop_hz) = (1e-3, [3.0, 8.0]);
        for quantum in [3e-5, 4e-5] {
            let mut desired = Trajectory { q: vec![vec![]; 2], qd: vec![vec![]; 2], qdd: vec![vec![]; 2] };
            let mut read = vec![Vec::new(); 2];
            for k in 0..10_000 {
                for (j, hz) in [0.8, 1.1].into_iter().enumerate() {
                    let w = TAU * hz;
                    let at = w * period * f64::from(k);
                    desired.q[j].push(0.6 * at.sin());
                    desired.qd[j].push(0.6 * w * at.cos());
                    desired.qdd[j].push(-0.6 * w * w * at.sin());
                    // 1/(1 + s/w0)^2
                    let slow: f64 = hz / loop_hz[j];
                    let q: f64 = 0.6 / (1.0 + slow * slow) * (at - 2.0 * slow.atan()).sin();
                    read[j].push((q / quantum).round() * quantum);
                }
            }
            let measured = Trajectory::from_positions(&read, period);
            let tau = vec![vec![1.0; 10_000]; 2];
            let record = Record { period_s: period, measured, tau, desired: Some(desired), second: None };
            let settings = OfflineSettings {
                filter_hz: 450.0,
                filter_order: 2,
                row_period_s: period,
                dead_zone: vec![0.0; 2],
                instrument: InstrumentSource::Desired,
            };
            let rows = [Rows::new(&model, &base, &settings, &record).expect("rows")];
            let found: Vec<f64> = Equations::new(&rows).joints.iter().map(|joint| ratio(joint, &values)).collect();
            println!("quantum {quantum:e} rad: ratios {found:.0?}");
            assert!(found.iter().all(|r| (30.0..1000.0).contains(r)), "{quantum}: {found:?}");
        }
    }
}
