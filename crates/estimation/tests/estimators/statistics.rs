//! What the estimates are worth: bias of least squares, none with instruments, honest standard deviations, and batch
//! solutions written out plainly beside the recursive ones.

use crate::common::{Bench, Random, Wave, known_noise};
use nalgebra::{DMatrix, DVector};
use rivet_estimation::{
    EigenSettings, Estimator, EstimatorKind, EstimatorSettings, Identifier, Instrument, ParameterState, Prior, Scales,
    Settings, Supervision, Window,
};

fn settings(kind: EstimatorKind, supervision: Supervision) -> EstimatorSettings {
    EstimatorSettings { forgetting: 1.0, prior: Prior { relative_std: 1e4 }, ..known_noise(kind, supervision) }
}

/// One regressor with noise/signal ratio r (paper, eq. 13): least squares ends at x/(1 + r²), a bias of −r²/(1 + r²);
/// instruments from the desired motion end at x.
#[test]
fn least_squares_is_biased_and_instruments_are_not() {
    let rows = 200_000;
    for r in [0.23_f64, 1.11, 3.0] {
        let mut random = Random(42);
        let mut riv = Estimator::new(&[0.5], &Scales::unit(1, 1), &settings(EstimatorKind::Riv, Supervision::Off));
        for _ in 0..rows {
            let clean = random.normal();
            let noisy = clean + r * random.normal();
            let tau = 2.0 * clean + 0.1 * random.normal();
            riv.update(&[noisy], Some((&[clean], Instrument::Setpoint)), &[tau], &[1.0]).expect("sound rows");
        }
        riv.settle();
        let e = riv.estimate();
        let (bias, expected) = (e.rls_values[0] / 2.0 - 1.0, -r * r / (1.0 + r * r));
        // Sampling error of both is (1 + r)/√rows, 1 % at most.
        assert!((bias - expected).abs() < 0.012, "LS at r = {r}: {bias:.3}, not {expected:.3}");
        assert!((e.values[0] / 2.0 - 1.0).abs() < 0.012, "IV at r = {r}: {}", e.values[0]);
    }
}

/// λ = 1: the recursive estimates are the batch ones of the same rows (weighted by 1/σ), IV to 1e-8 and LS to 1e-9.
#[test]
fn recursive_is_batch() {
    let (n, p, updates) = (20, 3, 500);
    let sigma = [0.5, 2.0, 8.0];
    let mut random = Random(6);
    let truth: Vec<f64> = (0..n).map(|_| random.normal()).collect();
    for supervision in [Supervision::Off, Supervision::Eigen(EigenSettings::default())] {
        let scales = Scales { torque_noise: sigma.to_vec(), ..Scales::unit(p, n) };
        let mut riv = Estimator::new(&vec![0.1; n], &scales, &settings(EstimatorKind::Riv, supervision));
        let (mut m, mut y) = (DMatrix::zeros(n, n), DVector::zeros(n));
        let (mut r, mut right) = (DMatrix::zeros(n, n), DVector::zeros(n));
        // The UD filter's prior: variance (1e4·max(0.1, 5 % of 1))² of each.
        for i in 0..n {
            r[(i, i)] = 1.0 / 1000.0_f64.powi(2);
            right[i] = 0.1 * r[(i, i)];
        }
        for _ in 0..updates {
            let z: Vec<f64> = (0..p * n).map(|_| random.normal()).collect();
            let d: Vec<f64> = z.iter().map(|z| z + 0.2 * random.normal()).collect();
            let share: Vec<f64> = (0..p).map(|_| (1.25 * random.unit() - 0.25).max(0.0)).collect();
            let tau: Vec<f64> = (0..p)
                .map(|j| (0..n).map(|i| z[j * n + i] * truth[i]).sum::<f64>() + sigma[j] * random.normal())
                .collect();
            let _ = riv.update(&d, Some((&z, Instrument::Setpoint)), &tau, &share);
            riv.work();
            if share.iter().all(|share| *share < 0.5) {
                // Nothing learnt, nothing forgotten.
                continue;
            }
            for j in 0..p {
                let w = share[j] / (sigma[j] * sigma[j]);
                let (zj, dj) = (&z[j * n..(j + 1) * n], &d[j * n..(j + 1) * n]);
                let (zj, dj) = (DVector::from_column_slice(zj), DVector::from_column_slice(dj));
                m += w * &zj * dj.transpose();
                y += w * tau[j] * &zj;
                r += w * &dj * dj.transpose();
                right += w * tau[j] * &dj;
            }
        }
        riv.settle();
        let batch = m.lu().solve(&y).expect("well conditioned");
        let least_squares = r.lu().solve(&right).expect("well conditioned");
        let e = riv.estimate();
        for i in 0..n {
            assert!((e.values[i] - batch[i]).abs() < 1e-8, "{supervision:?}: {} vs {}", e.values[i], batch[i]);
            assert!((e.rls_values[i] - least_squares[i]).abs() < 1e-9);
        }
    }
}

/// ±2σ cover the truth in 90 to 98 % of cases with white torque noise, through filter, decimation and weighting: the
/// correlation that the filter gives to the rows must be in the standard deviations.
#[test]
fn standard_deviations_cover() {
    let Some(mut bench) = Bench::new("dd2") else { return };
    let n = bench.dof();
    let (runs, mut inside, mut total, mut squares) = (40, 0, 0, 0.0);
    let mut scaled = [0; 2];
    let truth = bench.truth.clone();
    for run in 0..runs {
        let settings = Settings {
            window: if run % 2 == 0 { Window::None } else { Window::Exponential { seconds: 4.0 } },
            supervision: Supervision::Eigen(EigenSettings::default()),
            ..Settings::new(n, 0.002)
        };
        let mut identifier = Identifier::new(bench.model.clone(), bench.base.clone(), &bench.nominal, &settings)
            .expect("sound settings");
        let mut random = Random(1000 + run);
        let mut wave = Wave::new(n, 1.0);
        let start = 30.0 * random.unit();
        for k in 0..10_000 {
            let motion = wave.at(start + f64::from(k) * 0.002);
            let mut tau = bench.torque(motion, &truth);
            tau[0] += 0.5 * random.normal();
            tau[1] += 0.1 * random.normal();
            identifier.push_motion(motion, &tau, Some(motion));
        }
        let e = identifier.estimate();
        for i in 0..truth.len() {
            if e.state[i] == ParameterState::Active {
                let off = (e.values[i] - truth[i]) / e.std[i];
                inside += u32::from(off.abs() <= 2.0);
                scaled[0] += u32::from(off.abs() <= 3.0);
                scaled[1] += u32::from(off.abs() <= 2.0 / 1.5);
                squares += off * off;
                total += 1;
            }
        }
    }
    let share = f64::from(inside) / f64::from(total);
    println!(
        "{total} parameters, {:.1} % within 2 sigma, rms {:.2}",
        100.0 * share,
        (squares / f64::from(total)).sqrt()
    );
    assert!(total as usize > runs as usize * truth.len() * 9 / 10);
    assert!((0.90..=0.98).contains(&share), "{share}");
    // Standard deviations 1.5 times too large or too small would not pass: the sample tells.
    let [larger, smaller] = scaled.map(|count| f64::from(count) / f64::from(total));
    println!("{:.1} % and {:.1} % were they 1.5 times larger or smaller", 100.0 * larger, 100.0 * smaller);
    assert!(larger > 0.98 && smaller < 0.90, "{larger} {smaller}");
}

/// The paper's own comparison: a direct-drive arm at 0.8 and 1.1 Hz, positions to the encoder's quantum, central
/// differences at 1 ms. Unfiltered least squares loses the inertia; instruments keep it; the model filter helps both.
#[test]
fn quantised_positions() {
    let Some(mut bench) = Bench::new("dd2") else { return };
    let truth = bench.truth.clone();
    let inertia = (0..bench.len())
        .filter(|&i| bench.base.parameter(&bench.model, i).name(&bench.model.arm).ends_with("rotor_inertia"))
        .collect::<Vec<_>>();
    let mut worst = Vec::new();
    for filter_hz in [200.0, 10.0] {
        let settings = Settings {
            differentiator: rivet_estimation::Differentiator::Central,
            filter_hz,
            filter_order: 2,
            decimation: if filter_hz > 100.0 { 2 } else { 20 },
            window: Window::None,
            dead_zone: vec![0.3; 2],
            ..Settings::new(2, 0.001)
        };
        let mut identifier = Identifier::new(bench.model.clone(), bench.base.clone(), &bench.nominal, &settings)
            .expect("sound settings");
        let mut random = Random(3);
        let mut wave = Wave::new(2, 1.3);
        for k in 0..40_000 {
            let motion = wave.at(f64::from(k) * 0.001);
            let mut tau = bench.torque(motion, &truth);
            tau.iter_mut().zip([0.5, 0.1]).for_each(|(t, s)| *t += s * random.normal());
            let quantum = 5e-5;
            let q: Vec<f64> = motion.q.iter().map(|q| (q / quantum).round() * quantum).collect();
            identifier.push(&q, &tau, Some(motion));
        }
        let e = identifier.estimate();
        let off = |x: &[f64]| inertia.iter().map(|&i| (x[i] / truth[i] - 1.0).abs()).fold(0.0, f64::max);
        println!("{filter_hz} Hz: inertia off by {:.3} (IV), {:.3} (LS)", off(e.values), off(e.rls_values));
        worst.push((off(e.values), off(e.rls_values)));
    }
    let [(iv_raw, ls_raw), (iv_filtered, ls_filtered)] = worst[..] else { panic!("two runs") };
    assert!(ls_raw > 0.4 && iv_raw < 0.1, "{worst:?}");
    assert!(iv_filtered < 0.02 && ls_filtered < 0.1, "{worst:?}");
}

/// Where nobody knows the friction the drive says how noisy its joint may be; where somebody does, the drive says nothing.
#[test]
fn a_joint_of_unknown_friction_is_not_expected_to_be_quiet() {
    let Some(bench) = Bench::new("manutec-r3") else { return };
    let noise = |x: &[f64]| Scales::of_model(&bench.model, &bench.base, x, None).torque_noise;
    let known = noise(&bench.nominal);
    let mut without = bench.nominal.clone();
    for (i, x) in without.iter_mut().enumerate() {
        let name = bench.base.name(&bench.model, i);
        if name.contains("viscous") || name.contains("coulomb") {
            *x = 0.0;
        }
    }
    let unknown = noise(&without);
    for j in 3..6 {
        let of_drive = 0.02 * 0.08 * bench.model.arm.joints[j].effort;
        assert!(known[j] < of_drive, "{j}: friction is small in this arm: {known:?}");
        assert!((unknown[j] / of_drive - 1.0).abs() < 1e-12, "{j}: {unknown:?}, {of_drive} by its drive");
    }
}
