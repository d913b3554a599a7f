//! Noise-free data give exact parameters: through the filter, the decimation, the weighting and the supervision.

use crate::common::{Bench, Wave};
use rivet_estimation::differentiate::Weights;
use rivet_estimation::{
    ColumnsSettings, Differentiator, EigenSettings, EstimatorKind, Filtering, Identifier, InputSignals, Instrument,
    Instruments, Motion, Settings, Step, Supervision, Window,
};

fn run(bench: &mut Bench, settings: &Settings, seconds: f64, setpoints: bool) -> Identifier {
    let mut identifier =
        Identifier::new(bench.model.clone(), bench.base.clone(), &bench.nominal, settings).expect("sound settings");
    let mut wave = Wave::new(bench.dof(), 1.0);
    let truth = bench.truth.clone();
    for k in 0..(seconds / settings.sample_period_s) as usize {
        let motion = wave.at(k as f64 * settings.sample_period_s);
        let tau = bench.torque(motion, &truth);
        let step = identifier.push_motion(motion, &tau, setpoints.then_some(motion));
        assert!(!matches!(step, Step::Refused(_)));
    }
    identifier
}

/// 1e-8 is a hundred times what rounding leaves here, and a thousandth of what any mistake in the chain would leave.
#[test]
fn known_motion_gives_exact_parameters() {
    // A pair of columns may enclose less than the default angle on this motion: one of them would be held.
    let columns = ColumnsSettings { min_angle: 1e-4, ..ColumnsSettings::default() };
    for arm in ["manutec-r3", "staubli-tx40", "dd2"] {
        let Some(mut bench) = Bench::new(arm) else { continue };
        for supervision in
            [Supervision::Off, Supervision::Eigen(EigenSettings::default()), Supervision::Columns(columns)]
        {
            for window in [Window::Exponential { seconds: 5.0 }, Window::None] {
                let settings = Settings { supervision, window, ..Settings::new(bench.dof(), 0.001) };
                let identifier = run(&mut bench, &settings, 20.0, true);
                let estimate = identifier.estimate();
                let error = bench.error(estimate.values);
                println!(
                    "{arm} {supervision:?} {window:?}: error {error:.1e}, condition {:.1e}",
                    estimate.verdict.condition
                );
                assert_eq!(
                    (estimate.instrument, estimate.verdict.active),
                    (Instrument::SetpointThroughLoop, bench.len())
                );
                assert!(error < 1e-8, "{error:e}");
            }
        }
    }
}

/// Without setpoints the instruments are delayed rows; least squares needs none. Both are exact without noise.
#[test]
fn delayed_instruments_and_least_squares_are_exact_too() {
    let Some(mut bench) = Bench::new("manutec-r3") else { return };
    for (estimator, supervision, limit) in [
        (EstimatorKind::Riv, Supervision::Eigen(EigenSettings::default()), 1e-8),
        (EstimatorKind::Rls, Supervision::Eigen(EigenSettings::default()), 1e-8),
        // The UD filter starts from its prior, which the window forgets as e^-t/5: 20 s leave 2 % of a weak one.
        (EstimatorKind::Rls, Supervision::Off, 1e-3),
    ] {
        let window = Window::Exponential { seconds: 5.0 };
        let settings = Settings { estimator, supervision, window, ..Settings::new(bench.dof(), 0.001) };
        let identifier = run(&mut bench, &settings, 20.0, false);
        let estimate = identifier.estimate();
        let error = bench.error(estimate.values);
        println!(
            "{estimator:?} {supervision:?}: error {error:.1e}, beside it {:.1e}",
            bench.error(estimate.rls_values)
        );
        let riv = estimator == EstimatorKind::Riv;
        assert_eq!(estimate.instrument, if riv { Instrument::Delayed } else { Instrument::Regressor });
        assert!(error < limit, "{error:e}");
        assert!(bench.error(estimate.rls_values) < 1e-3);
    }
}

/// The whole path from positions: torques are those of the motion that the differentiator sees, so that its own error
/// (a smoothed cubic is not the sinusoid) does not count. Also with half the samples without setpoints.
#[test]
fn positions_give_exact_parameters() {
    let Some(mut bench) = Bench::new("staubli-tx40") else { return };
    let period = 0.001;
    for differentiator in [Differentiator::Central, Differentiator::SavitzkyGolay { half_width: 8 }] {
        let settings = Settings {
            differentiator,
            instruments: Instruments::Auto { delay_s: 0.05, longest_cycle_s: 20.0 },
            window: Window::Exponential { seconds: 5.0 },
            ..Settings::new(bench.dof(), period)
        };
        let mut identifier = Identifier::new(bench.model.clone(), bench.base.clone(), &bench.nominal, &settings)
            .expect("sound settings");
        let weights = Weights::new(differentiator, period);
        let half = differentiator.delay() as f64;
        let mut wave = Wave::new(bench.dof(), 1.0);
        let truth = bench.truth.clone();
        let (mut seen, mut instruments) = (vec![vec![0.0; bench.dof()]; 3], Vec::new());
        for k in 0..20_000_i32 {
            for part in &mut seen {
                part.fill(0.0);
            }
            for i in 0..weights.position.len() {
                let q = wave.at((f64::from(k) - half + i as f64) * period).q.to_vec();
                for (j, q) in q.iter().enumerate() {
                    seen[0][j] += weights.position[i] * q;
                    seen[1][j] += weights.velocity[i] * q;
                    seen[2][j] += weights.acceleration[i] * q;
                }
            }
            let tau = bench.torque(Motion { q: &seen[0], qd: &seen[1], qdd: &seen[2] }, &truth);
            let motion = wave.at(f64::from(k) * period);
            let setpoint = ((k / 3000) % 2 == 0).then_some(motion);
            let step = identifier.push(motion.q, &tau, setpoint);
            assert!(!matches!(step, Step::Refused(_) | Step::Skipped(_)) || k < 300, "{k}: {step:?}");
            if !instruments.contains(&identifier.estimate().instrument) {
                instruments.push(identifier.estimate().instrument);
            }
        }
        let error = bench.error(identifier.estimate().values);
        println!("{differentiator:?}: error {error:.1e}");
        assert!(error < 1e-8, "{error:e}");
        // Setpoints that come and go switch the instruments; neither kind spoils the other.
        let expected = [Instrument::None, Instrument::Setpoint, Instrument::SetpointThroughLoop, Instrument::Delayed];
        assert_eq!(instruments, expected);
    }
}

/// Equal inputs, equal bits.
#[test]
fn a_run_repeats_bit_for_bit() {
    let Some(mut bench) = Bench::new("manutec-r3") else { return };
    let settings = Settings { supervision: Supervision::Eigen(EigenSettings::default()), ..Settings::new(6, 0.001) };
    let bits = |bench: &mut Bench| -> Vec<u64> {
        let identifier = run(bench, &settings, 3.0, true);
        let e = identifier.estimate();
        e.values.iter().chain(e.std).chain(e.rls_values).chain(e.residual_rms).map(|v| v.to_bits()).collect()
    };
    assert_eq!(bits(&mut bench), bits(&mut bench));
}

/// The energy model, through the same filter and supervision: positions and velocities alone give the same parameters,
/// whether an equation covers a span or all since the start, with instruments of the plan and without.
///
/// Work is integrated to third order in the period: what is left falls to an eighth at half of it (to a fourth or less
/// where rounding and higher orders take part). Six joints in one equation condition it badly: a relative error of the
/// work of 1e-7 is 1e-3 of the smallest parameters, and far less of any torque.
#[test]
fn energies_give_the_same_parameters() {
    for arm in ["manutec-r3", "dd2"] {
        let Some(mut bench) = Bench::new(arm) else { continue };
        for (estimator, supervision, energy_span_s, setpoints) in [
            (EstimatorKind::Energy, Supervision::Off, 1.0, true),
            (EstimatorKind::Energy, Supervision::Eigen(EigenSettings::default()), 1.0, true),
            (EstimatorKind::Energy, Supervision::Off, 1.0, false),
            (EstimatorKind::RlsEnergy, Supervision::Eigen(EigenSettings::default()), 0.0, false),
        ] {
            let mut error = |period: f64, decimation: usize| {
                let settings = Settings {
                    estimator,
                    supervision,
                    energy_span_s,
                    window: Window::None,
                    decimation,
                    ..Settings::new(bench.dof(), period)
                };
                let identifier = run(&mut bench, &settings, 30.0, setpoints);
                let estimate = identifier.estimate();
                // What is said of joints is in torque units, one entry a joint.
                assert_eq!(estimate.residual_rms.len(), bench.dof());
                (bench.error(estimate.values), bench.torque_error(estimate.values))
            };
            let (coarse, fine) = (error(0.002, 5), error(0.001, 10));
            println!("{arm} {estimator:?} {supervision:?} span {energy_span_s} s: {coarse:?} -> {fine:?}");
            assert!(fine.0 < 2e-3 && fine.1 < 1e-5, "{fine:?}");
            assert!(fine.1 < 0.25 * coarse.1, "{coarse:?} -> {fine:?}");
        }
    }
}

/// Without a filter, and with one over all signals of a motion that the low-pass hardly changes.
#[test]
fn filtering_none_is_exact_and_filtered_input_is_not() {
    let Some(mut bench) = Bench::new("dd2") else { return };
    let mut error = |filtering: Filtering| {
        let settings = Settings { filtering, window: Window::None, ..Settings::new(bench.dof(), 0.001) };
        let identifier = run(&mut bench, &settings, 20.0, true);
        bench.error(identifier.estimate().values)
    };
    assert!(error(Filtering::None) < 1e-8);
    assert!(error(Filtering::Model) < 1e-8);
    for signals in [InputSignals::All, InputSignals::Motion, InputSignals::Acceleration] {
        let error = error(Filtering::Input(signals));
        println!("{signals:?}: {error:.1e}");
        assert!(error > 1e-2 && error.is_finite(), "{signals:?}: {error:e}");
    }
}

/// Torques of the true motion, positions of the true motion: with the state filter, as with the other differentiators,
/// what is left is the curvature of the motion within their reach.
#[test]
fn differentiators_give_the_parameters_of_the_true_motion() {
    let Some(mut bench) = Bench::new("manutec-r3") else { return };
    let truth = bench.truth.clone();
    let differentiators = [
        (Differentiator::Central, 1e-3),
        (Differentiator::SavitzkyGolay { half_width: 8 }, 5e-3),
        (Differentiator::StateFilter { hz: 60.0 }, 5e-3),
    ];
    for (differentiator, most) in differentiators {
        let settings = Settings {
            differentiator,
            window: Window::None,
            dead_zone: vec![0.3; bench.dof()],
            ..Settings::new(bench.dof(), 0.001)
        };
        let mut identifier = Identifier::new(bench.model.clone(), bench.base.clone(), &bench.nominal, &settings)
            .expect("sound settings");
        let mut wave = Wave::new(bench.dof(), 1.0);
        for k in 0..20_000 {
            let motion = wave.at(f64::from(k) * 0.001);
            let tau = bench.torque(motion, &truth);
            identifier.push(motion.q, &tau, Some(motion));
        }
        let error = bench.torque_error(identifier.estimate().values);
        println!("{differentiator:?}: torque error {error:.1e}");
        assert!(error < most, "{differentiator:?}: {error:e}");
    }
}
