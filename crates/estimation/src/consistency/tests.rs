//! The Manutec r3 and the TX40 with its coupled wrist, drives of their published size.

use std::f64::consts::TAU;
use std::path::PathBuf;

use nalgebra::{DMatrix, DVector};
use rivet_dynamics::{
    Arm, BaseSet, Joints, LINK_PARAMETERS, LinkParameters, Model, Structure, Workspace, WristCoupling,
    body_from_pseudo_inertia, mass_matrix, pseudo_inertia, smallest_eigenvalue,
};

use super::*;
use crate::linear::tests::Random;

struct Robot {
    model: Model,
    base: BaseSet,
    nominal: Vec<f64>,
}

impl Robot {
    fn new(name: &str) -> Robot {
        let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(format!("../../robots/{name}/robot.urdf"));
        let text = std::fs::read_to_string(path).expect("a URDF of the project");
        let arm = Arm::from_urdf(&text, [0.0, 0.0, -9.81]).expect("an arm");
        let (coupling, joints) = if name == "staubli-tx40" {
            let joints = Joints {
                rotor_inertia: vec![0.362, 0.507, 0.0829, 0.0341, 0.0361, 0.0114],
                viscous: vec![7.9379, 5.6948, 1.9804, 1.1141, 1.6, 0.6894],
                coulomb: vec![6.9822, 7.8301, 6.1939, 2.4063, 3.4092, 0.282],
                offset: vec![0.0; 6],
                coupling: [9.64e-3, 0.616, 1.95],
                ..Joints::default()
            };
            (Some(WristCoupling { driving: 4, driven: 5 }), joints)
        } else {
            let joints = Joints {
                rotor_inertia: vec![14.3325, 57.33, 4.68, 1.56816, 1.12907, 0.421443],
                viscous: vec![8.958, 33.92, 5.538, 9.8, 0.03, 3.92],
                coulomb: vec![42.0, 105.0, 42.0, 21.8, 30.1, 10.9],
                offset: vec![0.0; 6],
                coupling: [0.0; 3],
                ..Joints::default()
            };
            (None, joints)
        };
        let model = Model::new(arm, Structure { offset: true, coupling, sign_velocity: 0.02, ..Structure::default() });
        let base = BaseSet::new(&model).expect("a base");
        let nominal = model.nominal(&joints);
        Robot { model, base, nominal }
    }

    /// Rows of both kinds over `seconds`, 50 a second, torque of `x`; noise is so many times the torque's 1 %.
    fn rows(&self, x: &[f64], seconds: f64, phase: f64, noise: f64, seed: u64) -> Vec<(Vec<f64>, Vec<f64>)> {
        let (n, full, k) = (6, self.model.len(), self.base.len());
        let mut ws = Workspace::new(&self.model.arm);
        let (mut y, mut d) = (vec![0.0; n * full], vec![0.0; n * k]);
        let mut rows = vec![(Vec::new(), Vec::new()); n];
        for step in 0..(50.0 * seconds) as usize {
            let t = step as f64 / 50.0;
            let (mut q, mut qd, mut qdd) = ([0.0; 6], [0.0; 6], [0.0; 6]);
            for j in 0..n {
                for (i, hz) in [0.11, 0.27, 0.43].iter().enumerate() {
                    let w = TAU * hz * (1.0 + 0.09 * j as f64);
                    let at = w * t + phase + (3 * i + 2 * j) as f64;
                    let a = [0.8, 0.5, 0.3][i];
                    q[j] += a * at.sin();
                    qd[j] += a * w * at.cos();
                    qdd[j] -= a * w * w * at.sin();
                }
            }
            self.model.regressor(&mut ws, &q, &qd, &qdd, &mut y);
            self.base.select(&y, full, &mut d);
            for (row, (all, tau)) in d.chunks_exact(k).zip(&mut rows) {
                all.extend_from_slice(row);
                tau.push(row.iter().zip(x).map(|(d, x)| d * x).sum());
            }
        }
        let mut random = Random(seed);
        for (_, tau) in &mut rows {
            let rms = (tau.iter().map(|t: &f64| t * t).sum::<f64>() / tau.len() as f64).sqrt();
            for t in tau.iter_mut() {
                *t += 0.01 * noise * rms * random.normal();
            }
        }
        rows
    }

    fn reference(&self, rows: &[(Vec<f64>, Vec<f64>)]) -> Reference {
        let mut reference = Reference::new(6, self.base.len());
        rows.iter().enumerate().for_each(|(j, (d, tau))| reference.add(j, d, tau));
        reference
    }

    /// Weighted least squares: values and covariance.
    fn identify(&self, rows: &[(Vec<f64>, Vec<f64>)]) -> (Vec<f64>, Vec<f64>) {
        let k = self.base.len();
        let (mut left, mut right) = (DMatrix::zeros(k, k), DVector::zeros(k));
        let mut weights = [1.0; 6];
        let mut x = DVector::zeros(k);
        let mut covariance = DMatrix::zeros(k, k);
        for _ in 0..2 {
            left.fill(0.0);
            right.fill(0.0);
            for ((d, tau), w) in rows.iter().zip(weights) {
                let d = DMatrix::from_column_slice(k, tau.len(), d);
                left += &d * d.transpose() * w;
                right += &d * DVector::from_column_slice(tau) * w;
            }
            let scale = left.diagonal().map(|v: f64| 1.0 / v.sqrt());
            let scaled = DMatrix::from_fn(k, k, |i, j| left[(i, j)] * scale[i] * scale[j]);
            let inverse = scaled.try_inverse().expect("motion that excites everything");
            covariance = DMatrix::from_fn(k, k, |i, j| inverse[(i, j)] * scale[i] * scale[j]);
            x = &covariance * &right;
            for ((d, tau), w) in rows.iter().zip(&mut weights) {
                let residual =
                    DVector::from_column_slice(tau) - DMatrix::from_column_slice(k, tau.len(), d).transpose() * &x;
                *w = tau.len() as f64 / residual.norm_squared();
            }
        }
        (x.as_slice().to_vec(), covariance.as_slice().to_vec())
    }

    /// Bodies stretched and turned, drives changed by up to a third: as physical as the nominal ones.
    fn changed(&self, random: &mut Random) -> Vec<f64> {
        let mut x = self.nominal.clone();
        for body in x[..6 * LINK_PARAMETERS].chunks_exact_mut(LINK_PARAMETERS) {
            let link: LinkParameters = (&*body).try_into().expect("ten entries");
            let p = pseudo_inertia(&link);
            let p = DMatrix::from_fn(4, 4, |i, k| p[i][k]);
            let a = DMatrix::from_fn(4, 4, |i, k| {
                f64::from(u8::from(i == k)) + if i == 3 && k < 3 { 0.0 } else { 0.1 * random.normal() }
            });
            let p = &a * p * a.transpose();
            let p = [0, 1, 2, 3].map(|i| [0, 1, 2, 3].map(|k| p[(i, k)]));
            body.copy_from_slice(&body_from_pseudo_inertia(&p));
        }
        x[6 * LINK_PARAMETERS..].iter_mut().for_each(|v| *v *= 0.8 + 0.4 * random.unit());
        x
    }

    fn assert_physical(&self, found: &Projection, random: &mut Random, poses: usize) {
        assert!(found.smallest_eigenvalue > 0.0, "{}", found.smallest_eigenvalue);
        let links: Vec<LinkParameters> = found.standard[..6 * LINK_PARAMETERS]
            .chunks_exact(LINK_PARAMETERS)
            .map(|c| c.try_into().expect("ten entries"))
            .collect();
        assert!(links.iter().all(|l| smallest_eigenvalue(l) >= found.smallest_eigenvalue));
        let drives = &found.standard[6 * LINK_PARAMETERS..];
        assert!(drives[..18].iter().all(|v| *v > 0.0), "{drives:?}");
        let mut ws = Workspace::new(&self.model.arm);
        let mut m = vec![0.0; 36];
        for _ in 0..poses {
            let q: Vec<f64> = (0..6).map(|_| TAU * (random.unit() - 0.5)).collect();
            mass_matrix(&self.model.arm, &links, &mut ws, &q, &mut m);
            let mut whole = DMatrix::from_row_slice(6, 6, &m);
            assert!(whole.clone().cholesky().is_some(), "rigid mass matrix at {q:?}");
            (0..6).for_each(|j| whole[(j, j)] += drives[j]);
            if let Some(pair) = self.model.structure.coupling {
                let coupled = drives[drives.len() - 3];
                whole[(pair.driving, pair.driven)] += coupled;
                whole[(pair.driven, pair.driving)] += coupled;
            }
            assert!(whole.cholesky().is_some(), "mass matrix with drives at {q:?}");
        }
        let back = self.base.from_standard(&found.standard);
        assert_eq!(back, found.base);
    }
}

const ARMS: [&str; 2] = ["manutec-r3", "staubli-tx40"];

#[test]
fn derivatives_match_differences() {
    for name in ARMS {
        let robot = Robot::new(name);
        let mut random = Random(11);
        let x = robot.base.from_standard(&robot.changed(&mut random));
        let variance: Vec<f64> = x.iter().map(|x| (0.1 * x).powi(2) + 1e-6).collect();
        let information = square(&variance, x.len()).and_then(|c| information(&c)).expect("positive");
        let problem = Problem::new(&robot.model, &robot.base, &x, &information, &robot.nominal).expect("a problem");
        let chi = problem.blocks.start.map(|v| v * (1.0 + 0.01 * random.unit()));
        let gamma = 0.3;
        let (gradient, hessian) = problem.derivatives(&chi, gamma).expect("physical");
        for i in 0..chi.len() {
            // A step of 1e-4 of what curves the objective by one: errors of second order stay below 1e-6.
            let h = 1e-4 / hessian[(i, i)].sqrt();
            let at = |sign: f64| {
                let mut moved = chi.clone();
                moved[i] += sign * h;
                let value = problem.value(&moved, gamma).expect("physical");
                (value, problem.derivatives(&moved, gamma).expect("physical").0)
            };
            let ((above, up), (below, down)) = (at(1.0), at(-1.0));
            let size = hessian[(i, i)].sqrt() * (1.0 + gradient.amax() * h);
            let slope = (above - below) / (2.0 * h);
            assert!(
                (slope - gradient[i]).abs() < 1e-5 * (size + gradient[i].abs()),
                "{name} {i}: {slope} {}",
                gradient[i]
            );
            for k in 0..chi.len() {
                let bend = (up[k] - down[k]) / (2.0 * h);
                let size = (hessian[(i, i)] * hessian[(k, k)]).sqrt();
                assert!((bend - hessian[(i, k)]).abs() < 1e-5 * size, "{name} {i} {k}: {bend} {}", hessian[(i, k)]);
            }
        }
    }
}

#[test]
fn consistent_parameters_come_back() {
    for name in ARMS {
        let robot = Robot::new(name);
        for seed in 0..3 {
            let x = robot.base.from_standard(&robot.changed(&mut Random(seed)));
            let rows = robot.rows(&x, 20.0, 0.3, 0.1, seed);
            let (_, covariance) = robot.identify(&rows);
            let reference = robot.reference(&rows);
            let found = project(&robot.model, &robot.base, &x, &covariance, &robot.nominal, &reference).expect("found");
            println!(
                "{name} {seed}: {:.3} %, {} steps, gamma {:e}",
                found.torque_percent, found.iterations, found.gamma
            );
            assert!(found.torque_percent < 0.1, "{name}: {} %", found.torque_percent);
            assert!(found.distance < 1.0 || found.torque_percent <= NEGLIGIBLE_PERCENT);
        }
    }
}

/// Noise of 5 % of the torque; what physics costs in torque is small on motion not seen before.
#[test]
fn noisy_sets_become_physical_at_little_torque() {
    for name in ARMS {
        let robot = Robot::new(name);
        for seed in 0..5 {
            let truth = robot.base.from_standard(&robot.changed(&mut Random(seed)));
            let rows = robot.rows(&truth, 20.0, 0.3, 5.0, seed);
            let (x, covariance) = robot.identify(&rows);
            let reference = robot.reference(&rows);
            let found = project(&robot.model, &robot.base, &x, &covariance, &robot.nominal, &reference).expect("found");
            let validation = robot.reference(&robot.rows(&truth, 20.0, 2.1, 5.0, 100 + seed));
            let error = |x: &[f64]| -> f64 {
                let off: Vec<f64> = x.iter().zip(&truth).map(|(a, b)| a - b).collect();
                validation.percent(&off)
            };
            // Rms of torque error with 5 % noise: what counts is by how much it grows.
            let rms = |x: &[f64]| (error(x).powi(2) + 25.0).sqrt();
            let difference: Vec<f64> = x.iter().zip(&found.base).map(|(a, b)| a - b).collect();
            println!(
                "{name} {seed}: fit {:.2} %, validation {:.2} %, error to truth {:.2} -> {:.2} %, rms {:.3} -> {:.3}, \
                 distance {:.2}, {} steps, min eig {:e}",
                found.torque_percent,
                validation.percent(&difference),
                error(&x),
                error(&found.base),
                rms(&x),
                rms(&found.base),
                found.distance,
                found.iterations,
                found.smallest_eigenvalue
            );
            assert!(validation.percent(&difference) <= 2.0, "{name}: {} %", validation.percent(&difference));
            assert!(rms(&found.base) <= 1.02 * rms(&x));
            robot.assert_physical(&found, &mut Random(7 + seed), 10_000);
        }
    }
}

/// Sets that are wrong by far more than noise still end physical.
#[test]
fn any_set_becomes_physical() {
    for name in ARMS {
        let robot = Robot::new(name);
        let rows = robot.rows(&robot.base.from_standard(&robot.nominal), 10.0, 0.3, 1.0, 5);
        let (_, covariance) = robot.identify(&rows);
        let reference = robot.reference(&rows);
        for seed in 0..5 {
            let mut random = Random(40 + seed);
            let x: Vec<f64> = robot
                .base
                .from_standard(&robot.nominal)
                .iter()
                .map(|x| x * (1.0 + 0.6 * random.normal()) + 0.02 * random.normal())
                .collect();
            let found = project(&robot.model, &robot.base, &x, &covariance, &robot.nominal, &reference).expect("found");
            println!("{name} {seed}: {:.2} %, {} steps, {:e}", found.torque_percent, found.iterations, found.gamma);
            robot.assert_physical(&found, &mut random, 10_000);
        }
    }
}

#[test]
fn a_link_without_mass_is_named_and_a_rod_made_thick() {
    let mut robot = Robot::new("manutec-r3");
    let x = robot.base.from_standard(&robot.nominal);
    let variance: Vec<f64> = x.iter().map(|x| (0.01 * x).powi(2) + 1e-9).collect();
    let reference = robot.reference(&robot.rows(&x, 5.0, 0.0, 0.0, 1));
    let rod = rivet_dynamics::body_from_com(3.0, &[0.0, 0.0, 0.1], &[[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0; 3]]);
    robot.nominal[30..40].copy_from_slice(&rod);
    let found = project(&robot.model, &robot.base, &x, &variance, &robot.nominal, &reference).expect("found");
    assert_eq!(found.thickened, [robot.model.arm.joints[3].link.clone()]);
    assert!(found.smallest_eigenvalue > 0.0);
    robot.nominal[30..40].fill(0.0);
    let error = project(&robot.model, &robot.base, &x, &variance, &robot.nominal, &reference).expect_err("no mass");
    assert!(error.to_string().contains(&robot.model.arm.joints[3].link), "{error}");
    let short = project(&robot.model, &robot.base, &x[1..], &variance, &robot.nominal, &reference);
    assert!(matches!(short, Err(ConsistencyError::Shape { .. })));
}
