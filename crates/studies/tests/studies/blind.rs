//! The drawn arms are what they are said to be, not what a step of the integrator makes of them.

use rivet_simulation::two_mass::{CoupledMotor, DryFriction, Joint, Physics, TwoMassArm};
use rivet_studies::blind::case;
use std::path::Path;

fn robot(arm: &str) -> rivet_config::Robot {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../robots").join(arm).join("robot.toml");
    rivet_config::load(file).expect("the robot file is sound")
}

/// The coupled wrist of a light arm has the steepest friction of all: its creep below the breakaway torque is the same with a
/// quarter of the step.
#[test]
fn friction_of_a_light_wrist_does_not_hang_on_the_step() {
    let robot = robot("staubli-tx40");
    let nominal = robot.config.nominal_joints();
    let [inertia, viscous, coulomb] = nominal.coupling;
    let joints = (0..6).map(|j| {
        let shared = if j >= 4 { viscous } else { 0.0 };
        let dry =
            DryFriction { coulomb: nominal.coulomb[j], stribeck: [nominal.coulomb[j], 0.05], ..DryFriction::default() };
        Joint { rotor_inertia: nominal.rotor_inertia[j], viscous: nominal.viscous[j] - shared, dry, ..Joint::default() }
    });
    let physics = Physics {
        arm: robot.model.arm.clone(),
        joints: joints.collect(),
        coupled: vec![CoupledMotor { joints: [4, 5], inertia, viscous, coulomb }],
        delay_s: 0.0,
        lag_s: 0.0,
        pushes: Vec::new(),
    };
    let end = |rate_hz: f64| {
        let mut arm = TwoMassArm::with_rate(&physics, &[0.0; 6], rate_hz);
        // Gravity pulls all joints; the wrist is pushed below and beyond its friction.
        arm.run(&[0.0, 0.0, 0.0, 0.0, 1.5, 0.3], 0.5);
        arm.run(&[0.0, 0.0, 0.0, 0.0, 6.0, 1.5], 0.2);
        arm.encoders()
    };
    let (ours, fine) = (end(20_000.0), end(80_000.0));
    println!("{ours:.5?}\n{fine:.5?}");
    for (a, b) in ours.iter().zip(&fine) {
        assert!((a - b).abs() < 1e-4 + 0.01 * b.abs(), "{ours:?} against {fine:?}");
    }
}

#[test]
fn a_case_is_followed_and_hides_nothing_that_was_not_drawn() {
    let robot = robot("manutec-r3");
    for seed in 0..2 {
        let case = case(&robot, seed).expect("an arm that follows");
        assert!(case.runs.iter().all(|run| run.followed && run.t.len() == 18_000));
        let changed = case.torque_change_over_noise.iter().any(|change| *change > 0.0);
        assert_eq!(changed, !case.effects.is_empty(), "{:?}", case.effects);
    }
}
