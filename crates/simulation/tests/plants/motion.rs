//! Motions: analytic derivatives, limits, rest at both ends; and the closed loop that follows them.

use crate::common::{SIX_LIMITS, six_axes, six_drives, six_model, six_sensors, truth};
use rivet_dynamics::{Arm, Workspace, inverse_dynamics, mass_matrix};
use rivet_simulation::motion::{
    Fourier, FourierSettings, Governor, MotionLimits, PaperMotion, PointToPoint, PointToPointSettings, Recorded,
    Trajectory,
};
use rivet_simulation::{Plant, PlantSettings, Sensors, closed_loop};

/// Torque ratio of the rigid links and rotors of `six_axes`; friction is left to the reserve.
fn load(arm: &Arm) -> impl FnMut(&[f64], &[f64], &[f64]) -> f64 {
    let (arm, mut ws, drives) = (arm.clone(), Workspace::new(arm), six_drives());
    move |q, qd, qdd| {
        let mut tau = [0.0; 6];
        inverse_dynamics(&arm, &arm.links, &mut ws, q, qd, qdd, &mut tau);
        (0..6).map(|j| (tau[j] + drives.rotor_inertia[j] * qdd[j]).abs() / SIX_LIMITS[j]).fold(0.0, f64::max)
    }
}

fn sample(motion: &dyn Trajectory, t: f64) -> [[f64; 6]; 3] {
    let mut s = [[0.0; 6]; 3];
    let [q, qd, qdd] = &mut s;
    motion.sample(t, q, qd, qdd);
    s
}

fn motions() -> Vec<(&'static str, Box<dyn Trajectory>, f64)> {
    let arm = six_axes();
    let limits = MotionLimits::of(&arm, 0.8);
    let fourier = FourierSettings { length_s: 20.0, seed: 4, ..FourierSettings::default() };
    let point = PointToPoint::new(&limits, &PointToPointSettings { moves: 6, ..Default::default() }, &mut load(&arm));
    let cycle = point.cycle_s();
    vec![
        ("fourier", Box::new(Fourier::new(&limits, &fourier, &mut load(&arm))), 20.0),
        ("point-to-point", Box::new(point), cycle),
        ("paper", Box::new(PaperMotion::new(&limits, &mut load(&arm))), f64::INFINITY),
    ]
}

/// Fourth-order differences of the position reproduce velocity and acceleration.
#[test]
fn derivatives_are_those_of_the_position() {
    let h = 1e-3;
    for (name, motion, end) in motions() {
        for k in 0..1500 {
            let t = 0.01 + 0.0137 * f64::from(k);
            if t > end - 0.01 {
                break;
            }
            let at: [_; 5] = core::array::from_fn(|i| sample(motion.as_ref(), t + h * (i as f64 - 2.0)));
            for j in 0..6 {
                for order in 0..2 {
                    let x = |i: usize| at[i][order][j];
                    let difference = (x(0) - 8.0 * x(1) + 8.0 * x(3) - x(4)) / (12.0 * h);
                    let stated = at[2][order + 1][j];
                    // Good to h^4, but where a quintic joins a dwell its third derivative, up to 500 rad/s^3 here, jumps:
                    // there the difference of the velocity is off by up to that times h.
                    let good = if name == "point-to-point" { 5e-2 } else { 1e-6 };
                    assert!(
                        (difference - stated).abs() < good * (1.0 + stated.abs()),
                        "{name} joint {j} at {t}: {difference} for {stated}"
                    );
                }
            }
        }
    }
}

/// Rest at home at the start (and the end), speed, position and torque within their limits all the way, every joint moves.
#[test]
fn motions_keep_the_limits() {
    let arm = six_axes();
    let limits = MotionLimits::of(&arm, 0.8);
    let mut load = load(&arm);
    for (name, motion, end) in motions() {
        let rest = |t: f64| {
            let [q, qd, qdd] = sample(motion.as_ref(), t);
            for j in 0..6 {
                let off = (q[j] - limits.home[j]).abs() + qd[j].abs() + qdd[j].abs();
                assert!(off < 1e-9, "{name} joint {j} is not at rest at home at {t} s: {off}");
            }
        };
        rest(0.0);
        if end.is_finite() {
            rest(end);
        }
        let mut range = [[f64::INFINITY, f64::NEG_INFINITY]; 6];
        for k in 0..end.min(40.0) as usize * 1000 {
            let [q, qd, qdd] = sample(motion.as_ref(), k as f64 * 1e-3);
            assert!(load(&q, &qd, &qdd) < 0.77, "{name} needs too much torque at {k} ms");
            for j in 0..6 {
                assert!(qd[j].abs() <= 0.8 * arm.joints[j].velocity, "{name} joint {j} too fast at {k} ms: {}", qd[j]);
                assert!((q[j] - limits.home[j]).abs() <= limits.reach[j], "{name} joint {j} too far at {k} ms");
                range[j] = [range[j][0].min(q[j]), range[j][1].max(q[j])];
            }
        }
        let moving = if name == "paper" { 2 } else { 6 };
        for (j, [low, high]) in range.iter().enumerate() {
            assert_eq!(high - low > 0.1, j < moving, "{name} joint {j} moves over {}", high - low);
        }
    }
}

/// One joint alone: the others do not move at all.
#[test]
fn a_single_joint_moves_alone() {
    let arm = six_axes();
    let limits = MotionLimits::of(&arm, 0.8);
    let settings = FourierSettings { only: Some(2), ..FourierSettings::default() };
    let motion = Fourier::new(&limits, &settings, &mut load(&arm));
    let mut widest = [0.0_f64; 6];
    for k in 0..8000 {
        let [q, ..] = sample(&motion, f64::from(k) * 1e-3);
        for j in 0..6 {
            widest[j] = widest[j].max((q[j] - limits.home[j]).abs());
        }
    }
    assert!(widest[2] > 0.2);
    widest[2] = 0.0;
    assert_eq!(widest, [0.0; 6]);
}

/// Around a brake stop in full motion the setpoint neither jumps nor kinks, and ends up on the trajectory again.
#[test]
fn the_governor_starts_and_restarts_smoothly() {
    let arm = six_axes();
    let limits = MotionLimits::of(&arm, 0.8);
    let motion = Fourier::new(&limits, &FourierSettings::default(), &mut load(&arm));
    let mut governor = Governor::new(Box::new(motion));
    let mut last: Option<[Vec<f64>; 3]> = None;
    let period = 1e-3;
    for k in 0..12_000 {
        if k == 100 || k == 6000 {
            governor.release();
        }
        if k == 5000 {
            // The brakes hold the arm a little off its setpoint.
            let pose: Vec<f64> = governor.q().iter().map(|q| q + 0.05).collect();
            governor.halt(&pose);
            last = None;
        }
        governor.advance(period);
        let now = [governor.q().to_vec(), governor.qd().to_vec(), governor.qdd().to_vec()];
        if let Some(last) = &last {
            for j in 0..6 {
                for order in 0..2 {
                    let mean = (now[order][j] - last[order][j]) / period;
                    let stated = 0.5 * (now[order + 1][j] + last[order + 1][j]);
                    // Trapezoid rule: period^2/12 of the third derivative of the next order, a few 100/s^2 here.
                    assert!((mean - stated).abs() < 2e-3, "order {order} joint {j} at {k}: {mean} for {stated}");
                }
            }
        }
        last = Some(now);
    }
    assert!(governor.qd().iter().any(|v| v.abs() > 0.1), "it moves again");
}

/// Computed torque with the true model and a little feedback on quantised, noisy measurements follows to within a fraction
/// of a milliradian; the records' torque is what acted.
#[test]
fn a_closed_loop_follows_the_motion() {
    let model = six_model(0.0);
    let drives = six_drives();
    let truth = truth(&model, &drives);
    let sensors = six_sensors(3e-6, 1.5e-6, 0.005);
    let mut plant = Plant::new(&truth, &sensors, &PlantSettings::new(0.001, &SIX_LIMITS), 2);
    let limits = MotionLimits::of(&model.arm, 0.8);
    let motion = Fourier::new(&limits, &FourierSettings::default(), &mut load(&model.arm));
    plant.place(&limits.home, &[0.0; 6]);
    let (x, width) = (truth.standard(&model), model.len());
    let (mut ws, mut y) = (Workspace::new(&model.arm), vec![0.0; 6 * width]);
    let mut mass = [0.0; 36];
    let mut last = limits.home.clone();
    let (mut worst, mut count) = (0.0_f64, 0);
    closed_loop(
        &mut plant,
        &motion,
        |m, s, command| {
            model.regressor(&mut ws, s.q, s.qd, s.qdd, &mut y);
            mass_matrix(&model.arm, &truth.arm.links, &mut ws, s.q, &mut mass);
            for j in 0..6 {
                let velocity = (m.q()[j] - last[j]) / 0.001;
                let inertia = mass[7 * j] + drives.rotor_inertia[j];
                let feedback = 900.0 * (s.q[j] - m.q()[j]) + 60.0 * (s.qd[j] - velocity);
                command[j] = (0..width).map(|p| y[j * width + p] * x[p]).sum::<f64>() + inertia * feedback;
            }
            last.copy_from_slice(m.q());
        },
        10_000,
        |r| {
            count += 1;
            for j in 0..6 {
                worst = worst.max((r.setpoint.q[j] - r.q[j]).abs());
            }
        },
    );
    println!("largest tracking error {worst:.2e} rad");
    assert_eq!(count, 10_000);
    assert!(worst < 5e-3, "tracking error {worst} rad");
}

/// Position differences around a sample and the torque of that sample belong to the same instant: explained by the true
/// parameters, what is left has no part along the torque's derivative, that is, no delay.
#[test]
fn torque_and_differences_are_of_one_instant() {
    let model = six_model(0.0);
    let mut drives = six_drives();
    drives.coulomb.fill(0.0);
    drives.coupling[2] = 0.0;
    let truth = truth(&model, &drives);
    let limits = MotionLimits::of(&model.arm, 0.8);
    let motion = Fourier::new(&limits, &FourierSettings::default(), &mut load(&model.arm));
    let (x, width) = (truth.standard(&model), model.len());
    let delay = |latency: f64| {
        let mut settings = PlantSettings::new(0.001, &SIX_LIMITS);
        settings.latency = latency;
        let mut plant = Plant::new(&truth, &Sensors::perfect(6), &settings, 2);
        plant.place(&limits.home, &[0.0; 6]);
        let (mut ws, mut y) = (Workspace::new(&model.arm), vec![0.0; 6 * width]);
        let explain = |ws: &mut Workspace, y: &mut [f64], q: &[f64], qd: &[f64], qdd: &[f64]| -> [f64; 6] {
            model.regressor(ws, q, qd, qdd, y);
            core::array::from_fn(|j| (0..width).map(|p| y[j * width + p] * x[p]).sum())
        };
        let mut log: Vec<([f64; 6], [f64; 6])> = Vec::new();
        closed_loop(
            &mut plant,
            &motion,
            |m, s, command| {
                let tau = explain(&mut ws, &mut y, s.q, s.qd, s.qdd);
                for j in 0..6 {
                    command[j] = tau[j] + 300.0 * drives.rotor_inertia[j] * (s.q[j] - m.q()[j]);
                }
            },
            8000,
            |r| log.push((core::array::from_fn(|j| r.measured.q()[j]), core::array::from_fn(|j| r.measured.tau()[j]))),
        );
        let (mut along, mut power) = (0.0, 0.0);
        let (mut ws, mut y) = (Workspace::new(&model.arm), vec![0.0; 6 * width]);
        for k in 1000..7999 {
            let [a, b, c] = [log[k - 1].0, log[k].0, log[k + 1].0];
            let qd: [f64; 6] = core::array::from_fn(|j| (c[j] - a[j]) / 0.002);
            let qdd: [f64; 6] = core::array::from_fn(|j| (c[j] - 2.0 * b[j] + a[j]) / 1e-6);
            let tau = explain(&mut ws, &mut y, &b, &qd, &qdd);
            for j in 0..6 {
                let slope = (log[k + 1].1[j] - log[k - 1].1[j]) / 0.002;
                along += (tau[j] - log[k].1[j]) * slope;
                power += slope * slope;
            }
        }
        along / power // seconds by which the torque lags the motion
    };
    let (half, none) = (delay(0.5), delay(0.0));
    println!("delay {half:.2e} s at half a period, {none:.2e} s without latency");
    assert!(half.abs() < 2e-6, "delay {half} s");
    assert!((none - 5e-4).abs() < 5e-5, "delay {none} s without latency");
}

#[test]
fn recorded_setpoints_come_to_an_end_and_a_series_does_not() {
    let rest = || vec![vec![0.0; 501]; 6];
    let recorded = Recorded { period_s: 1e-3, q: rest(), qd: rest(), qdd: rest() };
    assert_eq!(recorded.ends_s(), Some(0.5));
    let over_after = |trajectory: Box<dyn Trajectory>| {
        let mut governor = Governor::new(trajectory);
        governor.release();
        (0..5000).position(|_| {
            governor.advance(1e-3);
            governor.is_over()
        })
    };
    // Its clock runs in for a second.
    assert!(over_after(Box::new(recorded)).is_some_and(|periods| (500..1500).contains(&periods)));
    let arm = six_axes();
    let series = Fourier::new(&MotionLimits::of(&arm, 0.5), &FourierSettings::default(), &mut load(&arm));
    assert_eq!(over_after(Box::new(series)), None);
}
