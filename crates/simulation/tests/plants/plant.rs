//! The plant against closed forms and against laws that hold for any arm.

use crate::common::{GRAVITY, SIX_LIMITS, ideal, pendulum, six_axes, six_drives, six_model, six_sensors, slide, truth};
use rivet_dynamics::{Joints, Model, Workspace};
use rivet_simulation::{FrictionLaw, Plant, PlantSettings, Random, Sensors, Truth};

fn plant(truth: &Truth, limits: &[f64], change: impl FnOnce(&mut PlantSettings)) -> Plant {
    let mut settings = PlantSettings::new(0.001, limits);
    change(&mut settings);
    Plant::new(truth, &Sensors::perfect(limits.len()), &settings, 1)
}

/// A slide with rotor inertia falls with m g / (m + Ia) (Newton, by hand).
#[test]
fn a_free_slide_falls_as_galileo_says() {
    let (model, mut joints) = ideal(slide());
    joints.rotor_inertia[0] = 1.5;
    let mut plant = plant(&truth(&model, &joints), &[100.0], |_| {});
    for _ in 0..2000 {
        plant.step(&[0.0]);
    }
    let a = 3.0 * GRAVITY / (3.0 + 1.5);
    assert!((plant.qd()[0] + 2.0 * a).abs() < 1e-11, "velocity {}", plant.qd()[0]);
    assert!((plant.q()[0] + 0.5 * a * 4.0).abs() < 1e-11, "position {}", plant.q()[0]);
}

/// Period of a swing of 60 degrees about hanging: 2 pi sqrt(I / (m g l)) / agm(1, cos 30 deg).
#[test]
fn the_pendulum_keeps_time() {
    let (model, joints) = ideal(pendulum());
    let mut plant = plant(&truth(&model, &joints), &[100.0], |_| {});
    let hanging = -core::f64::consts::FRAC_PI_2;
    let swing = core::f64::consts::FRAC_PI_3;
    plant.place(&[hanging + swing], &[0.0]);
    let (i, mgl) = (0.01 + 2.0 * 0.16, 2.0 * GRAVITY * 0.4);
    let (mut a, mut g) = (1.0, (swing / 2.0).cos());
    for _ in 0..6 {
        (a, g) = (0.5 * (a + g), f64::sqrt(a * g));
    }
    let period = core::f64::consts::TAU * (i / mgl).sqrt() / a;
    // Times at which it hangs, moving one way, by interpolation: linear is good to (1 ms)^3, far below the tolerance.
    let mut crossings = Vec::new();
    let (mut last, mut t_last) = (plant.q()[0] - hanging, 0.0);
    while crossings.len() < 6 {
        plant.step(&[0.0]);
        let (now, t) = (plant.q()[0] - hanging, plant.time_s());
        if last > 0.0 && now <= 0.0 {
            crossings.push(t_last + 0.001 * last / (last - now));
        }
        (last, t_last) = (now, t);
    }
    let measured = (crossings[5] - crossings[0]) / 5.0;
    assert!((measured / period - 1.0).abs() < 1e-8, "{measured} s for {period} s");
}

/// Gravity torque m g l cos q holds the pendulum where it is.
#[test]
fn the_closed_form_of_gravity_holds_the_arm() {
    let (model, joints) = ideal(pendulum());
    let mut plant = plant(&truth(&model, &joints), &[100.0], |s| s.latency = 0.0);
    for q in [-1.2, 0.0, 0.7, 2.0] {
        plant.place(&[q], &[0.0]);
        for _ in 0..500 {
            plant.step(&[2.0 * GRAVITY * 0.4 * f64::cos(q)]);
        }
        // 1e-15 N m of rounding in 0.33 kg m^2 moves less than this in half a second.
        assert!((plant.q()[0] - q).abs() < 1e-14, "{} from {q}", plant.q()[0]);
    }
}

/// Energy of a falling, tumbling six-axis arm without friction, relative to the most it has moved.
#[test]
fn energy_is_conserved_without_friction() {
    let (model, mut joints) = ideal(six_axes());
    for rotors in [vec![0.0; 6], vec![4.0, 4.5, 1.2, 0.3, 0.25, 0.2]] {
        joints.rotor_inertia = rotors;
        let mut plant = plant(&truth(&model, &joints), &SIX_LIMITS, |_| {});
        plant.place(&[0.1, 0.4, -0.6, 0.3, 0.8, -0.2], &[0.5, -0.3, 0.4, 1.0, -0.6, 0.9]);
        let (k0, p0) = plant.energy();
        let (mut most, mut worst) = (k0, 0.0_f64);
        for _ in 0..10_000 {
            plant.step(&[0.0; 6]);
            let (k, p) = plant.energy();
            most = most.max(k);
            worst = worst.max((k + p - k0 - p0).abs());
        }
        println!("energy error {:.2e} of {most:.0} J moved", worst / most);
        assert!(worst / most < 1e-6, "{worst} J of {most} J");
    }
}

/// Held below its Coulomb level a joint does not move by one bit in ten seconds; above it, it moves as Newton says.
#[test]
fn dry_friction_sticks_and_slides() {
    let (model, mut joints) = ideal(pendulum());
    joints.coulomb[0] = 5.0;
    let mut plant = plant(&truth(&model, &joints), &[100.0], |s| s.latency = 0.0);
    let q = 0.3;
    plant.place(&[q], &[0.0]);
    let gravity = 2.0 * GRAVITY * 0.4 * f64::cos(q);
    for share in [0.0, 0.9, -0.9, 0.999_999] {
        for _ in 0..2500 {
            plant.step(&[gravity + share * 5.0]);
        }
        assert_eq!((plant.q()[0], plant.qd()[0]), (q, 0.0), "crept at {share} of the level");
    }
    plant.step(&[gravity + 6.0]);
    let expected = 1.0 / 0.33 * 0.001;
    assert!((plant.qd()[0] / expected - 1.0).abs() < 1e-4, "{} for {expected}", plant.qd()[0]);
}

/// Sliding on a level axis stops after I v / Fc seconds and I v^2 / (2 Fc) radians, within no more than rounding.
#[test]
fn a_sliding_joint_stops_at_the_right_instant() {
    let (mut model, mut joints) = ideal(pendulum());
    model.arm.gravity = [0.0; 3];
    joints.coulomb[0] = 2.0;
    let mut plant = plant(&truth(&model, &joints), &[100.0], |_| {});
    let v = 0.777;
    plant.place(&[0.0], &[v]);
    for _ in 0..200 {
        plant.step(&[0.0]);
    }
    let way = 0.33 * v * v / 4.0;
    assert_eq!(plant.qd()[0], 0.0);
    assert!((plant.q()[0] - way).abs() < 1e-12, "{} for {way}", plant.q()[0]);
}

/// The smooth law creeps as fast as it says: v0 * atanh(load / level).
#[test]
fn smooth_friction_creeps_by_its_law() {
    let (mut model, mut joints) = ideal(pendulum());
    model.arm.gravity = [0.0; 3];
    joints.coulomb[0] = 5.0;
    let velocity = 0.002;
    let mut plant = plant(&truth(&model, &joints), &[100.0], |s| s.friction = FrictionLaw::Smooth { velocity });
    for _ in 0..300 {
        plant.step(&[4.5]);
    }
    let law = velocity * f64::atanh(0.9);
    assert!((plant.qd()[0] / law - 1.0).abs() < 1e-9, "{} for {law}", plant.qd()[0]);
}

fn torque_of(model: &Model, x: &[f64], ws: &mut Workspace, q: &[f64], qd: &[f64], qdd: &[f64]) -> Vec<f64> {
    let (n, width) = (model.arm.dof(), model.len());
    let mut y = vec![0.0; n * width];
    model.regressor(ws, q, qd, qdd, &mut y);
    (0..n).map(|j| (0..width).map(|p| y[j * width + p] * x[p]).sum()).collect()
}

/// The regressor of states and accelerations the plant went through gives back the torque that was applied, with friction,
/// offsets, rotor inertia and the wrist coupling.
#[test]
fn the_model_explains_the_plant() {
    for law in [FrictionLaw::Stick, FrictionLaw::Smooth { velocity: 0.004 }] {
        let model = six_model(if let FrictionLaw::Smooth { velocity } = law { velocity } else { 0.0 });
        let truth = truth(&model, &six_drives());
        let x = truth.standard(&model);
        let mut plant = plant(&truth, &SIX_LIMITS, |s| s.friction = law);
        let mut ws = Workspace::new(&model.arm);
        let mut random = Random::new(3);
        let (mut worst, mut seen) = (0.0_f64, 0);
        let mut command = [0.0; 6];
        for k in 0..4000 {
            if k % 50 == 0 {
                for j in 0..6 {
                    command[j] = SIX_LIMITS[j] * random.uniform(-0.5, 0.5);
                }
            }
            plant.step(&command);
            // A stuck joint's friction is whatever holds it; the model can say nothing about it.
            if law == FrictionLaw::Stick && (plant.qd().contains(&0.0) || plant.qd()[4] + plant.qd()[5] == 0.0) {
                continue;
            }
            let qdd = plant.qdd();
            let tau = torque_of(&model, &x, &mut ws, plant.q(), plant.qd(), &qdd[..6]);
            for j in 0..6 {
                worst = worst.max((tau[j] - plant.applied()[j]).abs() / SIX_LIMITS[j]);
            }
            seen += 1;
        }
        assert!(seen > 3000, "only {seen} moving samples");
        assert!(worst < 1e-12, "{law:?}: torque off by {worst} of the limit");
    }
}

/// The accelerations are those of the simulated motion: velocity differences over a fine period agree with them.
#[test]
fn the_motion_follows_the_accelerations() {
    let model = six_model(0.0);
    let truth = truth(&model, &six_drives());
    let mut plant = Plant::new(&truth, &Sensors::perfect(6), &PlantSettings::new(1e-4, &SIX_LIMITS), 1);
    plant.place(&[0.2, -0.5, 0.4, 0.1, -0.7, 0.6], &[0.5, 0.6, -0.4, 0.8, 0.7, -0.9]);
    let command = [40.0, 120.0, 10.0, 3.0, -2.0, 1.0];
    for _ in 0..200 {
        plant.step(&command);
        let before = plant.qd().to_vec();
        let a = plant.qdd();
        plant.step(&command);
        let b = plant.qdd();
        for j in 0..6 {
            let mean = (plant.qd()[j] - before[j]) / 1e-4;
            // Trapezoid against the true mean: h^2/12 of the acceleration's curvature.
            assert!((mean - 0.5 * (a[j] + b[j])).abs() < 1e-5 * (1.0 + a[j].abs()), "joint {j}: {mean} for {}", a[j]);
        }
    }
}

/// What friction takes is the work of the drives minus the gain in energy: never negative, in any period.
#[test]
fn friction_only_takes_energy() {
    let model = six_model(0.0);
    let mut joints = six_drives();
    joints.offset.fill(0.0);
    let mut plant = plant(&truth(&model, &joints), &SIX_LIMITS, |_| {});
    plant.place(&[0.0, 0.5, -0.4, 0.3, 0.6, 0.2], &[1.0, -1.5, 2.0, 2.0, -2.5, 2.5]);
    let (k, p) = plant.energy();
    let (start, mut before) = (k + p, k + p);
    for _ in 0..3000 {
        plant.step(&[0.0; 6]);
        let (k, p) = plant.energy();
        assert!(k + p <= before + 1e-9 * start.abs(), "gained {} J", k + p - before);
        before = k + p;
    }
    assert!(plant.qd().iter().filter(|v| **v == 0.0).count() >= 4, "still moving: {:?}", plant.qd());
}

/// Closed brakes stop a moving arm at once and then hold it to the bit, against gravity and without drives.
#[test]
fn brakes_stop_and_hold() {
    let model = six_model(0.0);
    let mut plant = plant(&truth(&model, &six_drives()), &SIX_LIMITS, |_| {});
    plant.place(&[0.0, 0.2, -0.4, 0.3, 0.6, 0.2], &[0.5, -0.5, 0.5, 0.5, -0.5, 0.5]);
    plant.set_brake(true);
    for _ in 0..150 {
        plant.step(&[100.0; 6]);
    }
    let held = plant.q().to_vec();
    assert!(plant.qd().iter().all(|v| *v == 0.0), "{:?}", plant.qd());
    for _ in 0..3000 {
        plant.step(&[100.0; 6]);
    }
    assert_eq!(plant.q(), held);
    assert!(plant.applied().iter().all(|tau| *tau == 0.0), "the drives of a braked arm are off");
    plant.set_brake(false);
    for _ in 0..20 {
        plant.step(&[0.0; 6]);
    }
    assert!(plant.qd()[1] != 0.0, "the arm falls when the brakes open");
}

/// A torque beyond the limit is cut, one that is no number is none.
#[test]
fn torque_saturates() {
    let (model, joints) = ideal(slide());
    let mut plant = plant(&truth(&model, &joints), &[20.0], |_| {});
    plant.step(&[1e3]);
    assert_eq!((plant.applied()[0], plant.saturated()[0]), (20.0, 1));
    plant.step(&[f64::NAN]);
    assert_eq!((plant.applied()[0], plant.saturated()[0]), (0.0, 1));
}

fn noisy_run(seed: u64) -> Vec<u64> {
    let model = six_model(0.0);
    let truth = truth(&model, &six_drives());
    let sensors = six_sensors(3e-6, 1.5e-6, 0.005);
    let mut plant = Plant::new(&truth, &sensors, &PlantSettings::new(0.001, &SIX_LIMITS), seed);
    let mut bits = Vec::new();
    for k in 0..500 {
        let m = plant.measure();
        bits.extend(m.q().iter().chain(m.tau()).map(|x| x.to_bits()));
        plant.step(&[30.0 * (0.01 * f64::from(k)).sin(); 6]);
    }
    bits
}

#[test]
fn the_same_seed_gives_the_same_bits() {
    assert_eq!(noisy_run(5), noisy_run(5));
    assert_ne!(noisy_run(5), noisy_run(6));
}

/// Encoders count whole steps of the motor, also of the motor that turns with two joints; noise has the stated strength.
#[test]
fn sensors_are_as_good_as_stated() {
    let model = six_model(0.0);
    let mut joints: Joints = six_drives();
    joints.coulomb[1] = 200.0; // stands still by itself
    let truth = truth(&model, &joints);
    let (step, n) = (1e-4, 4000);
    let sensors = six_sensors(step, 2.0 * step, 0.01);
    let mut plant = Plant::new(&truth, &sensors, &PlantSettings::new(0.001, &SIX_LIMITS), 9);
    plant.set_brake(true);
    plant.place(&[0.123_456_7; 6], &[0.0; 6]);
    let mut sums = [[0.0_f64; 2]; 2];
    for _ in 0..n {
        let m = plant.measure();
        for (j, motor) in [m.q()[0], m.q()[4], m.q()[5] + m.q()[4]].into_iter().enumerate() {
            let counts = motor / step;
            assert!((counts - counts.round()).abs() < 1e-9, "motor {j} at {counts} counts");
        }
        for (sum, error) in sums.iter_mut().zip([m.q()[0] - 0.123_456_7, m.tau()[2]]) {
            sum[0] += error / f64::from(n);
            sum[1] += error * error / f64::from(n);
        }
        plant.step(&[0.0; 6]);
    }
    // Noise of two steps and the quantisation's step / sqrt(12), added in squares; 4 sigma of a sample variance of 4000.
    let position = step * (4.0_f64 + 1.0 / 12.0).sqrt();
    for (sum, std) in sums.iter().zip([position, 0.01 * SIX_LIMITS[2]]) {
        assert!(sum[0].abs() < 4.0 * std / f64::from(n).sqrt(), "mean {}", sum[0]);
        assert!((sum[1] / (std * std) - 1.0).abs() < 4.0 * (2.0 / f64::from(n)).sqrt(), "variance {}", sum[1]);
    }
}
