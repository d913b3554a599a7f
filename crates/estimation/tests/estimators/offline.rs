//! Off-line identification of a three-joint arm with known parameters.

use std::f64::consts::PI;

use rivet_dynamics::{Arm, BaseSet, Joints, Model, Parameter, Structure};
use rivet_estimation::consistency::project;
use rivet_estimation::offline::{
    Delay, DelayDoubt, Determined, Equations, InstrumentSource, Method, OfflineError, OfflineSettings, Record, Rows,
    Smoothing, Trajectory, ZeroPhase, bias, fit, predict, predict_smoothed, residual_percent, torque_delay,
};

const PERIOD: f64 = 0.002;

fn arm() -> Arm {
    let link = |name: &str, mass: f64, com: &str| {
        format!(
            "<link name='{name}'><inertial><origin xyz='{com}'/><mass value='{mass}'/>\
             <inertia ixx='0.05' iyy='0.06' izz='0.04' ixy='0.001' ixz='0.002' iyz='-0.003'/></inertial></link>"
        )
    };
    let joint = |name: &str, parent: &str, child: &str, xyz: &str, axis: &str| {
        format!(
            "<joint name='{name}' type='revolute'><parent link='{parent}'/><child link='{child}'/><origin xyz='{xyz}'/>\
             <axis xyz='{axis}'/><limit lower='-3' upper='3' velocity='3' effort='100'/></joint>"
        )
    };
    let text = format!(
        "<robot name='three'><link name='base'/>{}{}{}{}{}{}</robot>",
        link("a", 3.0, "0 0.02 0.1"),
        link("b", 2.0, "0.2 0 0.01"),
        link("c", 1.0, "0.1 0.02 0"),
        joint("j1", "base", "a", "0 0 0.3", "0 0 1"),
        joint("j2", "a", "b", "0 0 0.1", "0 1 0"),
        joint("j3", "b", "c", "0.4 0 0", "0 1 0"),
    );
    Arm::from_urdf(&text, [0.0, 0.0, -9.81]).expect("a sound arm")
}

/// Model, base, base parameters of the truth, and of a nominal arm whose drives are off by a third.
fn setup() -> (Model, BaseSet, Vec<f64>, Vec<f64>) {
    let model = Model::new(arm(), Structure { offset: true, sign_velocity: 0.05, ..Structure::default() });
    let base = BaseSet::new(&model).expect("clear rank");
    let joints = |factor: f64| Joints {
        rotor_inertia: [0.6, 0.5, 0.2].map(|v| v * factor).to_vec(),
        viscous: [4.0, 3.0, 1.0].map(|v| v * factor).to_vec(),
        coulomb: [3.0, 4.0, 1.5].map(|v| v * factor).to_vec(),
        offset: if factor == 1.0 { vec![0.3, -0.2, 0.1] } else { vec![0.0; 3] },
        coupling: [0.0; 3],
        ..Joints::default()
    };
    let truth = base.from_standard(&model.nominal(&joints(1.0)));
    let nominal = base.from_standard(&model.nominal(&joints(1.3)));
    (model, base, truth, nominal)
}

/// Fourier motion of `seconds`, still for `rest_s` at either end.
fn motion(seconds: f64, rest_s: f64, phase: f64) -> Trajectory {
    motion_late(seconds, rest_s, phase, 0.0)
}

/// The same, `late` seconds behind.
fn motion_late(seconds: f64, rest_s: f64, phase: f64, late: f64) -> Trajectory {
    let count = (seconds / PERIOD) as usize;
    let rest = (rest_s / PERIOD) as usize;
    let mut motion = Trajectory { q: Vec::new(), qd: Vec::new(), qdd: Vec::new() };
    for j in 0..3 {
        let (mut q, mut qd, mut qdd) = (Vec::new(), Vec::new(), Vec::new());
        for k in 0..count {
            let moving = (rest..count - rest).contains(&k);
            let t = k.clamp(rest, count - rest) as f64 * PERIOD - late;
            let (mut a, mut v, mut w) = (0.0, 0.0, 0.0);
            for (i, hz) in [0.31, 0.77, 1.3].iter().enumerate() {
                let (om, ph) = (2.0 * PI * hz * (1.0 + 0.1 * j as f64), phase + (3 * i + j) as f64);
                let amplitude = 0.4 / (i + 1) as f64;
                a += amplitude * (om * t + ph).sin();
                v += if moving { amplitude * om * (om * t + ph).cos() } else { 0.0 };
                w -= if moving { amplitude * om * om * (om * t + ph).sin() } else { 0.0 };
            }
            q.push(a);
            qd.push(v);
            qdd.push(w);
        }
        motion.q.push(q);
        motion.qd.push(qd);
        motion.qdd.push(qdd);
    }
    motion
}

/// Deterministic noise of unit variance (sum of twelve uniforms of a linear congruential generator).
struct Noise(u64);
impl Noise {
    fn next(&mut self) -> f64 {
        let mut uniform = || {
            self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (self.0 >> 11) as f64 / (1_u64 << 53) as f64
        };
        (0..12).map(|_| uniform()).sum::<f64>() - 6.0
    }
}

fn record(model: &Model, base: &BaseSet, truth: &[f64], phase: f64, noise_q: f64, noise_tau: f64, seed: u64) -> Record {
    // A jump of speed has no acceleration in `desired` but one in differences: noisy records start moving.
    let desired = motion(12.0, if noise_q == 0.0 { 1.0 } else { 0.0 }, phase);
    let mut tau = torque(model, base, truth, &desired);
    let mut noise = Noise(seed);
    tau.iter_mut().flatten().for_each(|tau| *tau += noise_tau * noise.next());
    let measured = if noise_q == 0.0 {
        desired.clone()
    } else {
        let q: Vec<Vec<f64>> =
            desired.q.iter().map(|q| q.iter().map(|q| q + noise_q * noise.next()).collect()).collect();
        Trajectory::from_positions(&q, PERIOD)
    };
    Record { period_s: PERIOD, measured, tau, desired: Some(desired), second: None }
}

/// τ = D x without any filter.
fn torque(model: &Model, base: &BaseSet, x: &[f64], motion: &Trajectory) -> Vec<Vec<f64>> {
    let (n, full, k) = (3, model.len(), base.len());
    let (mut ws, mut slip) = (rivet_dynamics::Workspace::new(&model.arm), rivet_dynamics::Slip::new(model));
    let (mut y, mut d) = (vec![0.0; n * full], vec![0.0; n * k]);
    let mut tau = vec![Vec::new(); n];
    for row in 0..motion.len() {
        let at = |s: &[Vec<f64>]| -> Vec<f64> { s.iter().map(|s| s[row]).collect() };
        model.regressor_sliding(&mut ws, &mut slip, &at(&motion.q), &at(&motion.qd), &at(&motion.qdd), &mut y);
        base.select(&y, full, &mut d);
        for j in 0..n {
            tau[j].push(d[j * k..(j + 1) * k].iter().zip(x).map(|(d, x)| d * x).sum());
        }
    }
    tau
}

/// A joint that stands says nothing of its drive, and takes nothing from what the others tell; without any motion there is nothing to
/// fit.
#[test]
fn a_joint_that_stands_keeps_its_drive_and_does_not_spoil_the_others() {
    let (model, base, truth, nominal) = setup();
    let name = |i: usize| base.name(&model, i);
    for still in [vec![0], vec![1], vec![0, 2]] {
        let mut motion = motion(12.0, 1.0, 0.0);
        for &j in &still {
            motion.q[j].fill(0.4);
            motion.qd[j].fill(0.0);
            motion.qdd[j].fill(0.0);
        }
        let mut tau = torque(&model, &base, &truth, &motion);
        let mut noise = Noise(3);
        tau.iter_mut().flatten().for_each(|tau| *tau += 0.05 * noise.next());
        // Stuck friction holds whatever it has to.
        for &j in &still {
            tau[j].fill_with(|| 2.0 + 0.01 * noise.next());
        }
        let record = Record { period_s: PERIOD, measured: motion, tau, desired: None, second: None };
        let rows = [Rows::new(&model, &base, &settings(InstrumentSource::Delayed(0.02)), &record).expect("rows")];
        let equations = Equations::new(&rows);
        for method in [Method::LeastSquares, Method::Instrumental] {
            let found = fit(&equations, &nominal, 10.0, method).expect("fit");
            for i in 0..base.len() {
                let own = |j: &usize| {
                    [Parameter::RotorInertia(*j), Parameter::Viscous(*j), Parameter::Coulomb(*j), Parameter::Offset(*j)]
                        .contains(&base.parameter(&model, i))
                };
                assert!(found.values[i].is_finite() && found.std[i] > 0.0, "{}", name(i));
                if still.iter().any(own) {
                    assert!((found.values[i] - nominal[i]).abs() <= 1e-9 * nominal[i].abs(), "{}", name(i));
                    assert_eq!(found.determined[i], Determined::ByPrior, "{}", name(i));
                } else if found.determined[i] == Determined::ByData {
                    let off = (found.values[i] - truth[i]).abs();
                    assert!(off < 6.0 * found.std[i], "{still:?} {}: {off} of {}", name(i), found.std[i]);
                }
            }
            assert!((0..3).all(|j| found.noise[j].is_nan() == still.contains(&j)), "{:?}", found.noise);
            let bias = bias(&equations, &nominal, 10.0, &found).expect("judged");
            assert!(bias.hausman.is_finite() && bias.degrees > 0, "{bias:?}");
            let delays = torque_delay(&equations, &nominal, 10.0, &found).expect("delays");
            for (j, delay) in delays.iter().enumerate() {
                assert!(!still.contains(&j) || delay.doubt.is_some(), "{still:?}: {delay:?}");
                assert!(still.contains(&j) || delay.doubt.is_some() || delay.seconds.abs() < 2e-3, "{delay:?}");
            }
            let near = project(
                &model,
                &base,
                &found.values,
                &found.covariance,
                &model_nominal(&model),
                &equations.reference(),
            );
            let near = near.expect("an arm that can be built");
            assert!(near.torque_percent < 1.0, "{still:?} {method:?}: {} % of torque away", near.torque_percent);
            for i in 0..base.len() {
                let drive = |j: &usize| {
                    [Parameter::RotorInertia(*j), Parameter::Viscous(*j), Parameter::Coulomb(*j)]
                        .contains(&base.parameter(&model, i))
                };
                let moved = (near.base[i] - found.values[i]).abs();
                assert!(
                    !still.iter().any(drive) || moved <= 0.1 * nominal[i].abs(),
                    "{still:?} {method:?} {}: {} for {}",
                    name(i),
                    near.base[i],
                    found.values[i]
                );
                // Deviations are the prior's at most.
                assert!(
                    found.std[i] <= 100.0 * nominal[i].abs().max(1.0),
                    "{still:?} {}: std {}",
                    name(i),
                    found.std[i]
                );
            }
        }
    }
}

fn model_nominal(model: &Model) -> Vec<f64> {
    model.nominal(&Joints {
        rotor_inertia: vec![0.7, 0.6, 0.2],
        viscous: vec![5.0, 4.0, 1.0],
        coulomb: vec![4.0, 5.0, 2.0],
        offset: vec![0.0; 3],
        ..Joints::default()
    })
}

fn settings(instrument: InstrumentSource) -> OfflineSettings {
    OfflineSettings { filter_hz: 15.0, filter_order: 4, row_period_s: 0.01, dead_zone: vec![0.02; 3], instrument }
}

#[test]
fn noise_free_records_give_the_truth() {
    let (model, base, truth, nominal) = setup();
    for instrument in [InstrumentSource::Desired, InstrumentSource::Delayed(0.02)] {
        let rows: Vec<Rows> = [0.0, 1.0]
            .iter()
            .map(|phase| {
                let record = record(&model, &base, &truth, *phase, 0.0, 0.0, 1);
                Rows::new(&model, &base, &settings(instrument), &record).expect("rows")
            })
            .collect();
        assert!(rows[0].moving.start > 440 && rows[0].moving.end < 5560, "{:?}", rows[0].moving);
        for method in [Method::LeastSquares, Method::Instrumental] {
            let fit = fit(&Equations::new(&rows), &nominal, 1e3, method).expect("fit");
            for (i, (value, true_value)) in fit.values.iter().zip(&truth).enumerate() {
                let error = (value - true_value).abs() / true_value.abs().max(0.1);
                assert!(error < 1e-8, "{method:?} {}: {value} vs {true_value}", base.name(&model, i));
            }
            assert_eq!(fit.rank, base.len());
            assert!(fit.determined.iter().all(|d| *d == Determined::ByData));
            assert!(residual_percent(&rows, &fit.values).iter().all(|e| *e < 1e-6));
        }
        assert!(residual_percent(&rows, &nominal).iter().all(|e| *e > 1.0));
    }
}

/// A record that is cut into spans (40 s here, seven of them) has the rows of one that is not: what the true parameters leave
/// of its torque, filtered whole, is rounding. Friction with memory has slid before a span as it has along the whole motion.
#[test]
fn long_records_are_filtered_span_by_span_as_they_would_be_whole() {
    let (sound, ..) = setup();
    for presliding_travel in [0.0, 0.02] {
        let model = Model::new(sound.arm.clone(), Structure { presliding_travel, ..sound.structure });
        let base = BaseSet::new(&model).expect("clear rank");
        let truth: Vec<f64> = (0..base.len()).map(|i| 1.0 + 0.1 * i as f64).collect();
        let desired = motion(40.0, 0.0, 0.3);
        let tau = torque(&model, &base, &truth, &desired);
        let record = Record { period_s: PERIOD, measured: desired.clone(), tau, desired: Some(desired), second: None };
        for instrument in [InstrumentSource::Desired, InstrumentSource::Delayed(0.02)] {
            let settings = OfflineSettings { filter_hz: 60.0, ..settings(instrument) };
            let rows = [Rows::new(&model, &base, &settings, &record).expect("rows")];
            let left = residual_percent(&rows, &truth);
            assert!(left.iter().all(|percent| *percent < 1e-9), "{presliding_travel}: {left:?}");
            let fit = fit(&Equations::new(&rows), &vec![0.0; base.len()], 1e6, Method::Instrumental).expect("fit");
            let far = fit.values.iter().zip(&truth).fold(0.0_f64, |far, (x, t)| far.max((x / t - 1.0).abs()));
            assert!(far < 1e-6, "{presliding_travel} {instrument:?}: {far}");
        }
    }
}

/// Position noise of 0.2 mrad at 500 Hz (120 rad/s² of acceleration) makes accelerations useless one by one: least squares shrinks inertias towards
/// zero, instruments do not, and the stated standard deviations cover what is left.
#[test]
fn instruments_remove_the_bias_of_least_squares_and_std_is_honest() {
    let (model, base, truth, nominal) = setup();
    let settings = OfflineSettings { filter_hz: 60.0, row_period_s: 0.004, ..settings(InstrumentSource::Desired) };
    let rotor: Vec<usize> = (0..base.len()).filter(|i| base.name(&model, *i).contains("rotor_inertia")).collect();
    let (mut covered, mut total) = (0_usize, 0_usize);
    let (mut bias_ls, mut bias_iv) = (0.0_f64, 0.0_f64);
    for seed in 1..=4 {
        let record = record(&model, &base, &truth, seed as f64, 2e-4, 0.5, seed);
        let rows = [Rows::new(&model, &base, &settings, &record).expect("rows")];
        let ls = fit(&Equations::new(&rows), &nominal, 1e3, Method::LeastSquares).expect("fit");
        let iv = fit(&Equations::new(&rows), &nominal, 1e3, Method::Instrumental).expect("fit");
        for i in &rotor {
            bias_ls += (ls.values[*i] - truth[*i]) / truth[*i];
            bias_iv += (iv.values[*i] - truth[*i]) / truth[*i];
        }
        for i in 0..base.len() {
            covered += usize::from((iv.values[i] - truth[i]).abs() < 2.0 * iv.std[i]);
            total += 1;
        }
    }
    let count = 4.0 * rotor.len() as f64;
    println!("mean relative error of drive inertias: LS {}, IV {}", bias_ls / count, bias_iv / count);
    assert!(bias_ls / count < -0.1, "{}", bias_ls / count);
    assert!((bias_iv / count).abs() < 0.03, "{}", bias_iv / count);
    let share = covered as f64 / total as f64;
    println!("within two standard deviations: {share}");
    assert!(share > 0.8, "{share}");
}

#[test]
fn what_the_motion_leaves_open_stays_nominal_and_says_so() {
    let (model, base, truth, nominal) = setup();
    let mut still = motion(12.0, 1.0, 0.0);
    // Joints 2 and 3 barely move: a slow sine above the dead zone, no acceleration to speak of.
    for j in 1..3 {
        for k in 0..still.len() {
            let t = k as f64 * PERIOD;
            (still.q[j][k], still.qd[j][k], still.qdd[j][k]) =
                (0.3 * (0.3 * t).sin(), 0.09 * (0.3 * t).cos(), -0.027 * (0.3 * t).sin());
        }
    }
    let mut tau = torque(&model, &base, &truth, &still);
    let mut noise = Noise(7);
    tau.iter_mut().flatten().for_each(|tau| *tau += 0.3 * noise.next());
    let record = Record { period_s: PERIOD, measured: still, tau, desired: None, second: None };
    let rows = [Rows::new(&model, &base, &settings(InstrumentSource::Delayed(0.02)), &record).expect("rows")];
    let fit = fit(&Equations::new(&rows), &nominal, 0.2, Method::Instrumental).expect("fit");
    let open = fit.determined.iter().filter(|d| **d == Determined::ByPrior).count();
    assert!(open > 3, "{open} of {}", base.len());
    for i in 0..base.len() {
        if fit.determined[i] == Determined::ByPrior {
            let off = (fit.values[i] - nominal[i]).abs();
            assert!(off < 3.0 * 0.2 * nominal[i].abs().max(1.0), "{}: {off}", base.name(&model, i));
        }
    }
}

#[test]
fn prediction_is_the_model_and_wrong_shapes_are_refused() {
    let (model, base, truth, _) = setup();
    let record = record(&model, &base, &truth, 0.5, 0.0, 0.0, 1);
    let smooth = ZeroPhase::new(40.0, 4, PERIOD);
    let predicted = predict(&model, &base, &truth, &record.measured, &smooth).expect("prediction");
    let inner = 1000..5000;
    for j in 0..3 {
        let off: f64 = inner.clone().map(|k| (predicted[j][k] - record.tau[j][k]).powi(2)).sum();
        let all: f64 = inner.clone().map(|k| record.tau[j][k].powi(2)).sum();
        assert!((off / all).sqrt() < 0.02, "joint {j}: {}", (off / all).sqrt());
    }
    assert!(predict(&model, &base, &truth[1..], &record.measured, &smooth).is_err());
    let mut short = record.clone();
    short.tau[1].pop();
    let refused = Rows::new(&model, &base, &settings(InstrumentSource::Desired), &short);
    assert!(matches!(refused, Err(OfflineError::Shape { what: "torque", .. })), "{refused:?}");
    let mut blind = record.clone();
    blind.desired = None;
    assert!(Rows::new(&model, &base, &settings(InstrumentSource::Desired), &blind).is_err());
    blind.measured = Trajectory::from_positions(&vec![vec![0.3; blind.measured.len()]; 3], PERIOD);
    let refused = Rows::new(&model, &base, &settings(InstrumentSource::Delayed(0.02)), &blind);
    assert!(matches!(refused, Err(OfflineError::NoMotion { .. })), "{refused:?}");
}

/// Root mean square of the difference of two signals without their ends.
fn rms_apart(a: &[f64], b: &[f64]) -> f64 {
    let inner = 500..a.len() - 500;
    let squares: f64 = inner.clone().map(|k| (a[k] - b[k]).powi(2)).sum();
    (squares / inner.len() as f64).sqrt()
}

/// A low-pass at 4 Hz takes the steps of dry friction out of a prediction. Precise positions do without it.
#[test]
fn predicts_sign_changes_of_friction_as_sharply_as_positions_permit() {
    let (model, base, truth, _) = setup();
    let exact = motion(12.0, 0.0, 0.5);
    let tau = torque(&model, &base, &truth, &exact);
    let measured = Trajectory::from_positions(&exact.q, PERIOD);
    let at_lowest = predict(&model, &base, &truth, &measured, &ZeroPhase::new(4.0, 4, PERIOD)).expect("a motion");
    let smoothing =
        |noise: f64| Smoothing { lowest_hz: 4.0, order: 4, period_s: PERIOD, position_noise: vec![noise; 3] };
    let predicted =
        |noise: f64| predict_smoothed(&model, &base, &truth, &measured, &smoothing(noise)).expect("a motion");
    let (precise, coarse) = (predicted(1e-7), predicted(1.0));
    for j in 0..3 {
        let [lowest, precise] = [&at_lowest, &precise].map(|of| rms_apart(&of[j], &tau[j]));
        assert!(precise < 0.3 * lowest, "joint {j}: {precise} of {lowest} N m");
    }
    assert_eq!(coarse, at_lowest);
    let unknown = Smoothing { position_noise: vec![0.0; 2], ..smoothing(0.0) };
    assert!(predict_smoothed(&model, &base, &truth, &measured, &unknown).is_err());
}

/// Noise of accelerations is a hundredth of each joint's torque. Without dry friction, whose sign has noise of its own.
#[test]
fn noise_of_accelerations_makes_a_hundredth_of_predicted_torque() {
    let (model, base, mut truth, _) = setup();
    for (i, value) in truth.iter_mut().enumerate() {
        if matches!(base.parameter(&model, i), Parameter::Coulomb(_)) {
            *value = 0.0;
        }
    }
    let exact = motion(12.0, 0.0, 0.5);
    let still = vec![0.0; exact.len()];
    for (seed, noise) in [(1, 2e-5), (2, 1e-4)] {
        let mut random = Noise(seed);
        let q: Vec<Vec<f64>> = exact.q.iter().map(|q| q.iter().map(|q| q + noise * random.next()).collect()).collect();
        let smoothing = Smoothing { lowest_hz: 4.0, order: 4, period_s: PERIOD, position_noise: vec![noise; 3] };
        let predicted = |q: &[Vec<f64>]| {
            let measured = Trajectory::from_positions(q, PERIOD);
            predict_smoothed(&model, &base, &truth, &measured, &smoothing).expect("a motion")
        };
        let (noisy, exact) = (predicted(&q), predicted(&exact.q));
        for j in 0..3 {
            let share = rms_apart(&noisy[j], &exact[j]) / rms_apart(&exact[j], &still);
            println!("noise {noise} rad, joint {j}: {share:.4}");
            // The filter passes 0.89 of the noise that a sharp cut-off would.
            assert!((0.006..0.012).contains(&share), "noise {noise} rad, joint {j}: {share}");
        }
    }
}

/// ±2σ of a fit cover the truth in 90 to 98 % of cases with white torque noise; with noise that is slow (0.2 s) and
/// belongs to one joint, in at least 85 %. Scaled by 1.5 either way they would leave these bounds.
#[test]
fn standard_deviations_cover() {
    let (model, base, truth, nominal) = setup();
    for (slow, least, most) in [(0.0, 0.90, 0.98), (0.99, 0.85, 0.98)] {
        let (mut inside, mut total, mut scaled) = (0_usize, 0_usize, [0_usize; 2]);
        for run in 0..40 {
            let mut sample = record(&model, &base, &truth, 0.37 * run as f64, 0.0, 0.0, 1);
            let mut noise = Noise(900 + run);
            for (j, tau) in sample.tau.iter_mut().enumerate() {
                let mut state = 0.0;
                for tau in tau {
                    let rho: f64 = if j == 1 { slow } else { 0.0 };
                    state = rho * state + (1.0 - rho * rho).sqrt() * noise.next();
                    *tau += [0.4, 0.6, 0.2][j] * state;
                }
            }
            let rows = Rows::new(&model, &base, &settings(InstrumentSource::Desired), &sample).expect("rows");
            let found = fit(&Equations::new(&[rows]), &nominal, 1e3, Method::Instrumental).expect("a solution");
            for i in (0..truth.len()).filter(|i| found.determined[*i] == Determined::ByData) {
                let off = (found.values[i] - truth[i]).abs() / found.std[i];
                inside += usize::from(off <= 2.0);
                scaled[0] += usize::from(off <= 3.0);
                scaled[1] += usize::from(off <= 2.0 / 1.5);
                total += 1;
            }
        }
        let share = |count: usize| count as f64 / total as f64;
        println!(
            "colour {slow}: {total} values, {:.1} % within 2 std; {:.1} % and {:.1} % were std 1.5 times more or less",
            100.0 * share(inside),
            100.0 * share(scaled[0]),
            100.0 * share(scaled[1])
        );
        assert!((least..=most).contains(&share(inside)), "{}", share(inside));
        assert!(slow > 0.0 || (share(scaled[0]) > 0.98 && share(scaled[1]) < 0.90), "the test has the power to tell");
    }
}

/// A torque that is late by a fraction of a sample to fifty samples, with the torque noise of the test above and position noise:
/// every joint's delay is found within 0.2 samples, and within 3.5 of its standard deviations.
#[test]
fn torque_delay_is_found() {
    let (model, base, truth, nominal) = setup();
    for late in [0.0, 0.3, 1.0, 2.5, 6.0, -1.5, 20.0, -50.0] {
        let mut sample = record(&model, &base, &truth, 0.7, 1e-5, 0.5, 3);
        sample.tau = torque(&model, &base, &truth, &motion_late(12.0, 0.0, 0.7, late * PERIOD));
        let mut noise = Noise(77);
        for (tau, sigma) in sample.tau.iter_mut().zip([0.4, 0.6, 0.2]) {
            for tau in tau {
                *tau += sigma * noise.next();
            }
        }
        let rows = [Rows::new(&model, &base, &settings(InstrumentSource::Desired), &sample).expect("rows")];
        let found = fit(&Equations::new(&rows), &nominal, 1e3, Method::Instrumental).expect("a solution");
        let delays = torque_delay(&Equations::new(&rows), &nominal, 1e3, &found).expect("delays");
        for (joint, delay) in delays.iter().enumerate() {
            let (samples, std) = (delay.seconds / PERIOD, delay.std / PERIOD);
            println!("late by {late}: joint {} {samples:.2} +- {std:.2} samples", joint + 1);
            let off = (samples - late).abs();
            assert_eq!(delay.doubt, None);
            assert!(off < 0.3, "{samples} {late}");
            assert!(off < 3.5 * std, "{samples} +- {std} {late}");
        }
    }
}

/// Torque later than what is looked at, torque of a motion that any delay fits in much noise, and torque that has nothing to do
/// with the motion have no delay to tell.
#[test]
fn a_torque_delay_that_cannot_be_told_is_not_told() {
    let (model, base, truth, nominal) = setup();
    let delays = |sample: &Record| {
        let rows = [Rows::new(&model, &base, &settings(InstrumentSource::Desired), sample).expect("rows")];
        let found = fit(&Equations::new(&rows), &nominal, 1e3, Method::Instrumental).expect("a solution");
        torque_delay(&Equations::new(&rows), &nominal, 1e3, &found).expect("delays")
    };
    let doubts = |delays: Vec<Delay>| -> Vec<Option<DelayDoubt>> { delays.iter().map(|d| d.doubt).collect() };
    let noisy = |mut sample: Record, sigma: [f64; 3]| {
        let mut noise = Noise(78);
        for (tau, sigma) in sample.tau.iter_mut().zip(sigma) {
            for tau in tau.iter_mut() {
                *tau += sigma * noise.next();
            }
        }
        sample
    };

    let mut late = record(&model, &base, &truth, 0.7, 1e-5, 0.0, 3);
    late.tau = torque(&model, &base, &truth, &motion_late(12.0, 0.0, 0.7, 0.16));
    let found = doubts(delays(&noisy(late, [0.4, 0.6, 0.2])));
    assert_eq!(found, [Some(DelayDoubt::OutOfReach); 3]);

    // One slow tone a joint: inertia, friction and offset make up for any delay.
    let mut slow = record(&model, &base, &truth, 0.7, 0.0, 0.0, 3);
    let tone = |lead: f64| {
        let w = 2.0 * PI / 4.0;
        let of = |f: &dyn Fn(f64) -> f64| -> Vec<Vec<f64>> {
            (0..3).map(|j| (0..6000).map(|k| f(w * (f64::from(k) * PERIOD - lead) + f64::from(j))).collect()).collect()
        };
        Trajectory { q: of(&|x| 0.2 * x.sin()), qd: of(&|x| 0.2 * w * x.cos()), qdd: of(&|x| -0.2 * w * w * x.sin()) }
    };
    slow.measured = tone(0.0);
    slow.desired = Some(tone(0.0));
    slow.tau = torque(&model, &base, &truth, &tone(0.02));
    let found = delays(&noisy(slow, [8.0, 12.0, 4.0]));
    assert!(found.iter().filter(|d| d.doubt.is_some()).count() >= 2, "{found:?}");
    let wrong = |d: &&Delay| d.doubt.is_none() && (d.seconds - 0.02).abs() > 4.0 * d.std;
    assert_eq!(found.iter().find(wrong), None);

    let mut nothing = record(&model, &base, &truth, 0.7, 1e-5, 0.0, 3);
    nothing.tau.iter_mut().flatten().for_each(|tau| *tau = 0.0);
    let found = doubts(delays(&noisy(nothing, [5.0; 3])));
    assert_eq!(found, [Some(DelayDoubt::NotTold); 3]);
}
