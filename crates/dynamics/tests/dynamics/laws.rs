//! Laws that hold for any arm: linearity in the parameters, conservation of energy, symmetry, change of frame.

use crate::common::{Random, distance, dot, largest, times};
use nalgebra::DMatrix;
use proptest::prelude::*;
use rivet_dynamics::{Arm, Workspace, body_in_frame, flange_pose, inverse_dynamics, mass_matrix, regressor};

struct State {
    q: Vec<f64>,
    qd: Vec<f64>,
    qdd: Vec<f64>,
}

fn arm_and_state(seed: u64, dof: usize) -> (Arm, State) {
    let mut random = Random::new(seed);
    let arm = random.arm(dof);
    let state = State { q: random.vector(dof, 3.0), qd: random.vector(dof, 4.0), qdd: random.vector(dof, 10.0) };
    (arm, state)
}

fn torque(arm: &Arm, q: &[f64], qd: &[f64], qdd: &[f64]) -> Vec<f64> {
    let mut tau = vec![0.0; arm.dof()];
    inverse_dynamics(arm, &arm.links, &mut Workspace::new(arm), q, qd, qdd, &mut tau);
    tau
}

fn masses(arm: &Arm, q: &[f64]) -> Vec<f64> {
    let mut m = vec![0.0; arm.dof() * arm.dof()];
    mass_matrix(arm, &arm.links, &mut Workspace::new(arm), q, &mut m);
    m
}

fn columns(arm: &Arm, q: &[f64], qd: &[f64], qdd: &[f64]) -> Vec<f64> {
    let mut y = vec![f64::NAN; 10 * arm.dof() * arm.dof()];
    regressor(arm, &mut Workspace::new(arm), q, qd, qdd, &mut y);
    y
}

/// V(q) = −Σ g·(m·c in the root frame) \[J\], from forward kinematics alone.
fn potential(arm: &Arm, q: &[f64]) -> f64 {
    let of_link = |i: usize| {
        let part = Arm { joints: arm.joints[..=i].to_vec(), ..arm.clone() };
        let (r, p) = flange_pose(&part, &q[..=i]);
        let in_root = body_in_frame(&arm.links[i], &r, &p);
        -dot(&arm.gravity, &in_root[1..4])
    };
    (0..arm.dof()).map(of_link).sum()
}

/// Two states side by side are the same bits as each of them alone, whatever the number of joints.
#[test]
fn a_pair_of_states_is_two_states() {
    use rivet_dynamics::{Model, Structure, WristCoupling};
    for dof in 1..=8 {
        let (arm, a) = arm_and_state(7 + dof as u64, dof);
        let (_, b) = arm_and_state(70 + dof as u64, dof);
        for (sign_velocity, more) in [(0.0, false), (0.4, false), (0.4, true)] {
            let coupling = (dof > 1).then_some(WristCoupling { driving: dof - 2, driven: dof - 1 });
            let structure = Structure {
                offset: true,
                coupling,
                sign_velocity,
                load_friction: more,
                viscous_quadratic: more,
                ..Structure::default()
            };
            let model = Model::new(arm.clone(), structure);
            let mut ws = Workspace::new(&model.arm);
            let mut pair = vec![[0.0; 2]; dof * model.len()];
            let states = [&a, &b].map(|s| rivet_dynamics::State { q: &s.q, qd: &s.qd, qdd: &s.qdd });
            model.regressor_pair(&mut ws, states, &mut pair);
            for (lane, s) in states.iter().enumerate() {
                let mut alone = vec![f64::NAN; pair.len()];
                model.regressor(&mut ws, s.q, s.qd, s.qdd, &mut alone);
                let found: Vec<f64> = pair.iter().map(|entry| entry[lane]).collect();
                assert_eq!(found, alone, "{dof} joints, lane {lane}");
            }
        }
    }
}

/// df/dt at t = 0, by differences of fourth order: error of order step⁴.
fn rate(f: impl Fn(f64) -> f64, step: f64) -> f64 {
    (8.0 * (f(step) - f(-step)) - (f(2.0 * step) - f(-2.0 * step))) / (12.0 * step)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..ProptestConfig::default() })]

    /// τ = Y·π; both sides are sums of the same few hundred products, so they agree to rounding.
    #[test]
    fn torque_is_the_regressor_times_the_parameters(seed: u64, dof in 1..=8usize) {
        let (arm, State { q, qd, qdd }) = arm_and_state(seed, dof);
        let tau = torque(&arm, &q, &qd, &qdd);
        let linear = times(&columns(&arm, &q, &qd, &qdd), &arm.links.concat());
        prop_assert!(distance(&tau, &linear) <= 1e-12 * largest(&tau), "{tau:?} vs {linear:?}");
    }

    /// Column j of M is the torque of unit acceleration of joint j, less that of standstill, by either way to torques.
    #[test]
    fn mass_matrix_agrees_with_torques_and_regressor(seed: u64, dof in 1..=8usize) {
        let (arm, State { q, .. }) = arm_and_state(seed, dof);
        let (m, zero) = (masses(&arm, &q), vec![0.0; dof]);
        let pi = arm.links.concat();
        let rest = torque(&arm, &q, &zero, &zero);
        for j in 0..dof {
            let mut unit = zero.clone();
            unit[j] = 1.0;
            let column: Vec<f64> = (0..dof).map(|i| m[i * dof + j]).collect();
            let mut from_torque = torque(&arm, &q, &zero, &unit);
            let mut from_regressor = times(&columns(&arm, &q, &zero, &unit), &pi);
            for i in 0..dof {
                from_torque[i] -= rest[i];
                from_regressor[i] -= rest[i];
            }
            let tolerance = 1e-12 * (largest(&m) + largest(&rest));
            prop_assert!(distance(&column, &from_torque) <= tolerance);
            prop_assert!(distance(&column, &from_regressor) <= tolerance);
        }
    }

    /// Kinetic energy is positive in every direction: M is symmetric and has a Cholesky factor.
    #[test]
    fn mass_matrix_is_symmetric_positive_definite(seed: u64, dof in 1..=8usize) {
        let (arm, State { q, .. }) = arm_and_state(seed, dof);
        let m = DMatrix::from_row_slice(dof, dof, &masses(&arm, &q));
        prop_assert_eq!(&m, &m.transpose());
        prop_assert!(m.cholesky().is_some());
    }

    /// What the joints put in is what the arm gains: q̇ᵀ·τ = d/dt (½·q̇ᵀ·M·q̇ + V). The right side takes nothing from the
    /// recursion of velocities, so this checks centrifugal and Coriolis torques. Differences are good to about 1e-10.
    #[test]
    fn power_is_the_rate_of_energy(seed: u64, dof in 1..=8usize) {
        let (arm, State { q, qd, qdd }) = arm_and_state(seed, dof);
        let power = dot(&qd, &torque(&arm, &q, &qd, &qdd));
        let energy = |t: f64| {
            let at = |i: usize| q[i] + t * qd[i] + 0.5 * t * t * qdd[i];
            let q: Vec<f64> = (0..dof).map(at).collect();
            let qd: Vec<f64> = (0..dof).map(|i| qd[i] + t * qdd[i]).collect();
            0.5 * dot(&qd, &times(&masses(&arm, &q), &qd)) + potential(&arm, &q)
        };
        let scale = largest(&torque(&arm, &q, &qd, &qdd)) * largest(&qd);
        let gained = rate(energy, 3e-4);
        prop_assert!((power - gained).abs() <= 1e-7 * (1.0 + scale), "{power} W in, {gained} W gained");
    }

    /// Gravity's torque is the slope of the potential energy.
    #[test]
    fn gravity_torque_is_the_slope_of_the_potential(seed: u64, dof in 1..=8usize) {
        let (arm, State { q, .. }) = arm_and_state(seed, dof);
        let zero = vec![0.0; dof];
        let tau = torque(&arm, &q, &zero, &zero);
        for j in 0..dof {
            let along = |t: f64| {
                let mut q = q.clone();
                q[j] += t;
                potential(&arm, &q)
            };
            prop_assert!((tau[j] - rate(along, 1e-3)).abs() <= 1e-8 * (1.0 + largest(&tau)));
        }
    }

    /// Turning the whole world, gravity with it, changes no torque.
    #[test]
    fn torque_does_not_depend_on_the_root_frame(seed: u64, dof in 1..=8usize) {
        let (arm, State { q, qd, qdd }) = arm_and_state(seed, dof);
        let r = Random::new(!seed).rotation();
        let turn = |v: &[f64; 3]| r.map(|row| dot(&row, v));
        let mut turned = arm.clone();
        turned.gravity = turn(&arm.gravity);
        turned.joints[0].translation = turn(&arm.joints[0].translation);
        let r0 = arm.joints[0].rotation;
        turned.joints[0].rotation = r.map(|row| [0, 1, 2].map(|k| (0..3).map(|i| row[i] * r0[i][k]).sum()));
        let tau = torque(&arm, &q, &qd, &qdd);
        prop_assert!(distance(&tau, &torque(&turned, &q, &qd, &qdd)) <= 1e-12 * (1.0 + largest(&tau)));
    }
}

/// A gear whose ratio varies does no work: slow motion of the encoder by dq lifts the links by dV, so that the drive carries
/// dV/dq, with the link at q + error(q). So do the drives of the other joints.
#[test]
fn a_transmission_error_does_no_work() {
    use rivet_dynamics::{EffectKind, Joints, KnownEffect, KnownEffects, Model, Structure};
    for seed in 0..20 {
        let (arm, State { q, .. }) = arm_and_state(seed, 4);
        let (at, still) = (2, [0.0; 4]);
        let effect = KnownEffect::new(EffectKind::TransmissionError, at, &[2e-3, -1e-3, 80.0]);
        let model =
            Model::new(arm, Structure::default()).with_effects(KnownEffects::new(vec![effect], &Joints::zero(4)));
        let mut tau = torque(&model.arm, &q, &still, &still);
        model.add_effects(&mut Workspace::new(&model.arm), &q, &still, &still, &mut tau);
        let lifted = |j: usize, by: f64| {
            let mut link = q.clone();
            link[j] += by;
            link[at] += effect.angle_error(link[at]).expect("an angle");
            potential(&model.arm, &link)
        };
        let by = 1e-5;
        for j in 0..4 {
            let slope = (lifted(j, by) - lifted(j, -by)) / (2.0 * by);
            assert!((tau[j] - slope).abs() < 1e-6 * (1.0 + slope.abs()), "seed {seed}, joint {j}: {} {slope}", tau[j]);
        }
    }
}
