//! Normalised errors: is the covariance the errors' own, and would the test notice if it were not?

use super::*;
use crate::linear::{dot, tests::Random};
use nalgebra::{DMatrix, DVector};

/// Settings without supervision; noise is estimated.
fn settings(forgetting: f64) -> EstimatorSettings {
    EstimatorSettings {
        kind: EstimatorKind::Riv,
        forgetting,
        deviation: None,
        supervision: Supervision::Off,
        prior: Prior { relative_std: 1e3 },
        noise_known: false,
        noise_memory: 1000.0,
        outlier: f64::INFINITY,
        residual_memory: 300.0,
        change_row_s: None,
        correlation: Correlation { factor: 1.0, neighbour: 0.0 },
        block: 50,
    }
}

/// `κσₑ²·share·M⁻¹·S·M⁻ᵀ`, whose diagonal is what `std` is made of.
fn covariance(estimator: &Estimator) -> DMatrix<f64> {
    let n = estimator.n;
    let inverse = DMatrix::from_row_slice(n, n, &estimator.m).try_inverse().expect("identifiable");
    let s = DMatrix::from_fn(n, n, |i, j| estimator.s[packed(i.max(j))][i.min(j)]);
    estimator.row_variance() * &inverse * s * inverse.transpose()
}

/// Mean of a χ² variable over its degrees of freedom: within `bounds`, and outside them were the covariance half or twice
/// as large.
fn judge(name: &str, sum: f64, degrees: f64) {
    let mean = sum / degrees;
    // 2.58 standard deviations: once in a hundred.
    let bound = 2.58 * (2.0 / degrees).sqrt();
    println!("{name}: {mean:.3}, 1 within {bound:.3}");
    let holds = |mean: f64| (mean - 1.0).abs() < bound;
    assert!(holds(mean), "{name}: {mean}");
    assert!(!holds(2.0 * mean) && !holds(0.5 * mean), "{name}: the test has no power");
}

/// Rows of two joints with six parameters, of which the regressor is noisy; errors of the estimate over its covariance
/// (NEES), and of the predicted torque over its variance, before the row is learnt from (NIS).
#[test]
fn errors_are_as_large_as_stated() {
    let truth = [3.0, -1.0, 0.5, 2.0, 1.0, -0.2];
    let sigma = [0.4, 2.0];
    let (n, p, runs) = (truth.len(), sigma.len(), 300);
    for (name, forgetting, rows) in [("nothing forgotten", 1.0, 3000), ("window of 300 rows", 1.0 - 1.0 / 300.0, 3000)]
    {
        let (mut nees, mut nis, mut predicted, mut published) = (0.0, 0.0, 0.0, 0.0);
        for run in 0..runs {
            let mut random = Random(7000 + run);
            let scales = Scales { torque_noise: vec![1.0; p], ..Scales::unit(p, n) };
            let mut estimator = Estimator::new(&truth.map(|x| 0.8 * x), &scales, &settings(forgetting));
            for row in 0..rows {
                let z: Vec<f64> = (0..p * n).map(|_| random.normal()).collect();
                let d: Vec<f64> = z.iter().map(|z| z + 0.1 * random.normal()).collect();
                let tau: Vec<f64> = (0..p)
                    .map(|j| (0..n).map(|i| z[j * n + i] * truth[i]).sum::<f64>() + sigma[j] * random.normal())
                    .collect();
                if row > rows - 20 {
                    let estimate = estimator.estimate();
                    for j in 0..p {
                        let error = tau[j] - dot(&d[j * n..(j + 1) * n], estimate.values);
                        nis += (error / estimate.torque_noise[j]).powi(2);
                        predicted += 1.0;
                    }
                }
                estimator.update(&d, Some((&z, Instrument::Setpoint)), &tau, &[1.0; 2]).expect("sound rows");
                estimator.work();
            }
            estimator.settle();
            let error = DVector::from_fn(n, |i, _| estimator.values[i] - truth[i]);
            let covariance = covariance(&estimator);
            nees += error.dot(&covariance.clone().lu().solve(&error).expect("positive definite"));
            published += (0..n).map(|i| estimator.std[i].powi(2) / covariance[(i, i)]).sum::<f64>();
        }
        // Block means of the scores are averaged in: the published variances are these in the mean.
        let published = published / (runs as usize * n) as f64;
        println!("{name}: published variances are {published:.3} of the covariance's diagonal");
        assert!((0.9..1.1).contains(&published), "{name}: {published}");
        judge(&format!("{name}, NEES"), nees, (runs as usize * n) as f64);
        judge(&format!("{name}, NIS"), nis, predicted);
    }
}
