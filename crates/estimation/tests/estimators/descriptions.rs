//! Off-line identification where the robot's description is poor: axes that are nearly parallel, bodies that nobody knows.

use std::f64::consts::TAU;

use rivet_dynamics::{Arm, BaseSet, Joints, LINK_PARAMETERS, Model, Slip, Structure, Workspace, guess_bodies};
use rivet_estimation::offline::{Equations, InstrumentSource, Method, OfflineSettings, Record, Rows, Trajectory, fit};

const PERIOD: f64 = 0.004;
const SECONDS: f64 = 24.0;

/// Uniform numbers of a linear congruential generator.
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Unit variance.
    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.unit()).sum::<f64>() - 6.0
    }
}

fn arm(name: &str) -> Arm {
    let path = format!("{}/../../robots/{name}/robot.urdf", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(&path).expect("a URDF of this project");
    Arm::from_urdf(&text, [0.0, 0.0, -9.81]).expect("a chain")
}

/// The arm as its maker's calibration has it: every axis turned, every origin moved by up to `size` \[rad, m\].
fn calibrated(mut arm: Arm, size: f64, random: &mut Random) -> Arm {
    for joint in &mut arm.joints {
        let [x, y, z] = [0; 3].map(|_| random.between(-size, size));
        let (sx, cx, sy, cy, sz, cz) = (x.sin(), x.cos(), y.sin(), y.cos(), z.sin(), z.cos());
        let turn = [
            [cy * cz, sx * sy * cz - cx * sz, cx * sy * cz + sx * sz],
            [cy * sz, sx * sy * sz + cx * cz, cx * sy * sz - sx * cz],
            [-sy, sx * cy, cx * cy],
        ];
        let old = joint.rotation;
        joint.rotation = std::array::from_fn(|i| std::array::from_fn(|k| (0..3).map(|m| old[i][m] * turn[m][k]).sum()));
        joint.translation.iter_mut().for_each(|x| *x += random.between(-size, size));
    }
    arm
}

fn drives(n: usize) -> Joints {
    let by = |size: f64| (0..n).map(|j| size / (1.0 + j as f64)).collect::<Vec<f64>>();
    Joints { rotor_inertia: by(4.0), viscous: by(12.0), coulomb: by(9.0), ..Joints::zero(n) }
}

fn motion(n: usize, random: &mut Random) -> Trajectory {
    let count = (SECONDS / PERIOD) as usize;
    let mut motion = Trajectory { q: Vec::new(), qd: Vec::new(), qdd: Vec::new() };
    for _ in 0..n {
        let waves: Vec<[f64; 3]> = (1..=5)
            .map(|i| [random.between(0.2, 0.5) / f64::from(i), TAU * 0.09 * f64::from(i), random.between(0.0, TAU)])
            .collect();
        let sum = |f: &dyn Fn(&[f64; 3], f64) -> f64| -> Vec<f64> {
            (0..count).map(|k| waves.iter().map(|wave| f(wave, k as f64 * PERIOD)).sum()).collect()
        };
        motion.q.push(sum(&|[a, w, p], t| a * (w * t + p).sin()));
        motion.qd.push(sum(&|[a, w, p], t| a * w * (w * t + p).cos()));
        motion.qdd.push(sum(&|[a, w, p], t| -a * w * w * (w * t + p).sin()));
    }
    motion
}

/// Torque of standard parameters `x`.
fn torque(model: &Model, x: &[f64], motion: &Trajectory) -> Vec<Vec<f64>> {
    let n = model.arm.dof();
    let (mut ws, mut slip, mut y) = (Workspace::new(&model.arm), Slip::new(model), vec![0.0; n * model.len()]);
    let mut tau = vec![Vec::new(); n];
    for row in 0..motion.len() {
        let at = |s: &[Vec<f64>]| -> Vec<f64> { s.iter().map(|s| s[row]).collect() };
        model.regressor_sliding(&mut ws, &mut slip, &at(&motion.q), &at(&motion.qd), &at(&motion.qdd), &mut y);
        for (tau, row) in tau.iter_mut().zip(y.chunks_exact(model.len())) {
            tau.push(row.iter().zip(x).map(|(y, x)| y * x).sum());
        }
    }
    tau
}

fn settings(n: usize) -> OfflineSettings {
    OfflineSettings {
        filter_hz: 8.0,
        filter_order: 4,
        row_period_s: 0.02,
        dead_zone: vec![0.01; n],
        instrument: InstrumentSource::Desired,
    }
}

/// Base parameters from a noisy record of the truth, with the model's prior about `nominal`.
fn identified(model: &Model, base: &BaseSet, truth: (&Model, &[f64]), nominal: &[f64], seed: u64) -> Vec<f64> {
    let mut random = Random(seed);
    let n = model.arm.dof();
    let desired = motion(n, &mut random);
    let mut tau = torque(truth.0, truth.1, &desired);
    for tau in &mut tau {
        let size = (tau.iter().map(|x| x * x).sum::<f64>() / tau.len() as f64).sqrt();
        for x in tau.iter_mut() {
            *x += 0.02 * size * random.normal();
        }
    }
    let q: Vec<Vec<f64>> = desired.q.iter().map(|q| q.iter().map(|q| q + 1e-5 * random.normal()).collect()).collect();
    let measured = Trajectory::from_positions(&q, PERIOD);
    let record = Record { period_s: PERIOD, measured, tau, desired: Some(desired), second: None };
    let rows = [Rows::new(model, base, &settings(n), &record).expect("rows")];
    fit(&Equations::new(&rows), &base.from_standard(nominal), 10.0, Method::LeastSquares).expect("a fit").values
}

/// Torque that base parameters miss on another motion, the worst joint's share of its torque.
fn missed(model: &Model, base: &BaseSet, truth: (&Model, &[f64]), values: &[f64], seed: u64) -> f64 {
    let mut random = Random(seed);
    let other = motion(model.arm.dof(), &mut random);
    let wanted = torque(truth.0, truth.1, &other);
    let mut standard = vec![0.0; model.len()];
    base.independent.iter().zip(values).for_each(|(c, value)| standard[*c] = *value);
    let found = torque(model, &standard, &other);
    let square = |x: &[f64]| x.iter().map(|x| x * x).sum::<f64>();
    let share = |(a, b): (&Vec<f64>, &Vec<f64>)| {
        let error: Vec<f64> = a.iter().zip(b).map(|(a, b)| a - b).collect();
        (square(&error) / square(a)).sqrt()
    };
    wanted.iter().zip(&found).map(share).fold(0.0, f64::max)
}

/// A calibrated UR10e: base parameters that its geometry hardly separates stay under the prior, and torque is predicted on other motion as by
/// the arm whose axes are exactly parallel.
#[test]
fn a_calibrated_arm_predicts_as_its_ideal_does() {
    let structure = Structure { sign_velocity: 0.01, ..Structure::default() };
    let ideal = Model::new(arm("ur10e"), structure);
    let base = BaseSet::new(&ideal).expect("a base");
    let x = ideal.nominal(&drives(6));
    let wrong = |x: &[f64]| -> Vec<f64> { x.iter().map(|x| 1.3 * x).collect() };
    let of_ideal = missed(&ideal, &base, (&ideal, &x), &identified(&ideal, &base, (&ideal, &x), &wrong(&x), 5), 6);
    for (seed, size) in [(1, 1e-3), (2, 3e-4), (3, 1e-4), (4, 3e-5)] {
        let model = Model::new(calibrated(arm("ur10e"), size, &mut Random(seed)), structure);
        let base = BaseSet::new(&model).expect("a base");
        let x = model.nominal(&drives(6));
        let values = identified(&model, &base, (&model, &x), &wrong(&x), 5);
        let share = missed(&model, &base, (&model, &x), &values, 6);
        let faint = base.hardly_separated().count();
        println!(
            "{size:e}: {} base parameters, {faint} hardly separated, missed {share:.4}, ideal {of_ideal:.4}",
            base.len()
        );
        assert!(share < 1.2 * of_ideal, "{size:e}: {share} against {of_ideal}");
        let torque_of = |i: usize| values[i].is_finite();
        assert!((0..base.len()).all(torque_of));
    }
}

/// Without nominal bodies an arm is identified as well as with bodies that are off by a third.
#[test]
fn unknown_bodies_are_identified_as_well_as_with_a_nominal_model() {
    let structure = Structure { sign_velocity: 0.01, ..Structure::default() };
    for name in ["ur10e", "staubli-tx40", "manutec-r3", "kuka-kr300-r2500"] {
        let known = Model::new(arm(name), structure);
        let n = known.arm.dof();
        let mut truth = drives(n);
        let scale = known.arm.joints[0].effort / 330.0;
        for list in [&mut truth.rotor_inertia, &mut truth.viscous, &mut truth.coulomb] {
            for x in list.iter_mut() {
                *x *= scale;
            }
        }
        let x = known.nominal(&truth);
        let base = BaseSet::new(&known).expect("a base");
        let off: Vec<f64> = x.iter().map(|x| 1.3 * x).collect();
        let by_nominal = identified(&known, &base, (&known, &x), &off, 11);
        let with_nominal = missed(&known, &base, (&known, &x), &by_nominal, 12);

        let mut bare = arm(name);
        bare.links = vec![[0.0; LINK_PARAMETERS]; n];
        let limits: Vec<f64> = bare.joints.iter().map(|joint| joint.effort).collect();
        let std = guess_bodies(&mut bare, &vec![true; n], &limits, 0.0);
        let unknown = Model::new(bare, structure).with_unknown_bodies(std);
        // Nobody knows the drives either.
        let nominal = unknown.nominal(&Joints::zero(n));
        let values = identified(&unknown, &base, (&known, &x), &nominal, 11);
        let without = missed(&unknown, &base, (&known, &x), &values, 12);
        println!("{name}: missed {without:.4} without nominal bodies, {with_nominal:.4} with");
        assert!(without < 1.1 * with_nominal, "{name}: {without} against {with_nominal}");
    }
}
