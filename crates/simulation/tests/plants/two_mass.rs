//! The two-mass arm against what is known by hand.

use rivet_dynamics::Arm;
use rivet_simulation::two_mass::{DryFriction, Gear, Joint, Physics, Push, TwoMassArm};

const URDF: &str = r#"<robot name="one"><link name="base"/><link name="arm"><inertial><origin xyz="0.3 0 0"/>
    <mass value="2"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <joint name="j" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" velocity="5" effort="100"/></joint></robot>"#;
/// About the joint: 0.1 + 2·0.3².
const LINK: f64 = 0.28;
const ROTOR: f64 = 0.5;

fn physics(joint: Joint, gravity: f64) -> Physics {
    Physics {
        arm: Arm::from_urdf(URDF, [0.0, 0.0, -gravity]).expect("a sound arm"),
        joints: vec![joint],
        coupled: Vec::new(),
        delay_s: 0.0,
        lag_s: 0.0,
        pushes: Vec::new(),
    }
}

fn joint() -> Joint {
    Joint { rotor_inertia: ROTOR, ..Joint::default() }
}

#[test]
fn constant_torque_turns_a_rigid_joint_along_a_parabola() {
    let mut arm = TwoMassArm::new(&physics(joint(), 0.0), &[0.2]);
    arm.run(&[3.0], 0.5);
    let expected = 0.2 + 0.5 * 3.0 / (LINK + ROTOR) * 0.25;
    assert!((arm.encoders()[0] - expected).abs() < 1e-9, "{} {expected}", arm.encoders()[0]);
}

/// Motor and link of a soft gear swing against each other at `sqrt(k (1/J + 1/L))`; together they turn as one.
#[test]
fn a_soft_gear_swings_at_its_own_frequency() {
    let stiffness = 2000.0;
    let gear = Gear { stiffness, ..Gear::default() };
    let mut arm = TwoMassArm::new(&physics(Joint { gear: Some(gear), ..joint() }, 0.0), &[0.0]);
    arm.run(&[50.0], 0.001);
    let mean_speed = 0.05 / (LINK + ROTOR);
    let (mut crossings, mut before) = (Vec::new(), 0.0);
    for k in 1..10_000 {
        arm.run(&[0.0], 1e-4);
        let t = f64::from(k) * 1e-4;
        // What is left of the motor's way is the swing, its first maximum at a quarter of a period.
        let swing = arm.encoders()[0] - mean_speed * (t + 0.0005);
        if before < 0.0 && swing >= 0.0 {
            crossings.push(t - 1e-4 * swing / (swing - before));
        }
        before = swing;
    }
    let period = (crossings[crossings.len() - 1] - crossings[0]) / (crossings.len() - 1) as f64;
    let expected = core::f64::consts::TAU / (stiffness * (1.0 / ROTOR + 1.0 / LINK)).sqrt();
    assert!((period / expected - 1.0).abs() < 1e-3, "{period} {expected}");
}

#[test]
fn play_lets_the_motor_turn_alone() {
    let play = 0.02;
    let gear = Gear { stiffness: 1e4, damping: 5.0, play, ..Gear::default() };
    let alone = Joint { gear: Some(gear), ..joint() };
    let mut arm = TwoMassArm::new(&physics(alone, 0.0), &[0.0]);
    arm.run(&[1.0], 0.05);
    let expected = 0.5 / ROTOR * 0.05_f64.powi(2);
    assert!(expected < play / 2.0);
    assert!((arm.encoders()[0] - expected).abs() < 1e-9);
}

/// Below its level dry friction holds: bristles bend and stay, without them the joint creeps by `atanh`.
#[test]
fn bristles_hold_and_friction_slows() {
    let dry = DryFriction { coulomb: 2.0, bristle: 1e-3, ..DryFriction::default() };
    let mut held = TwoMassArm::new(&physics(Joint { dry, ..joint() }, 0.0), &[0.0]);
    for k in 1..=1000 {
        held.run(&[1e-3 * f64::from(k)], 0.01);
    }
    let bent = held.encoders()[0];
    // dz/dx = (1 - z)/length up to z = 1/2.
    assert!((bent / (1e-3 * core::f64::consts::LN_2) - 1.0).abs() < 0.02, "{bent}");
    let dry = DryFriction { coulomb: 2.0, forwards: 0.5, stribeck: [1.0, 0.05], ..DryFriction::default() };
    let slides = Joint { dry, viscous: 1.5, ..joint() };
    let mut arm = TwoMassArm::new(&physics(slides, 0.0), &[0.0]);
    arm.run(&[5.5], 8.0);
    let before = arm.encoders()[0];
    arm.run(&[5.5], 0.1);
    // 5.5 = 2 + 0.5 + 1.5 v, far above the Stribeck velocity.
    assert!(((arm.encoders()[0] - before) / 0.1 - 2.0).abs() < 1e-4);
}

#[test]
fn a_push_at_the_flange_is_a_lever() {
    let mut pushed = physics(joint(), 0.0);
    // A force along x at 0.1 m along the joint's z axis, about y.
    pushed.pushes = vec![Push { from_s: 0.0, length_s: 1.0, force: [10.0, 0.0, 0.0] }];
    let mut arm = TwoMassArm::new(&pushed, &[0.0]);
    arm.run(&[0.0], 0.1);
    // Torque 10·0.1·sin(pi t), twice integrated; the arm hardly turns meanwhile.
    let w = core::f64::consts::PI;
    let expected = (0.1 / w - (w * 0.1).sin() / (w * w)) / (LINK + ROTOR);
    assert!((arm.encoders()[0] / expected - 1.0).abs() < 1e-3, "{} {expected}", arm.encoders()[0]);
}

#[test]
fn what_drives_and_encoders_hide_stays_hidden() {
    let drive = Joint { gain: 0.2, saturation: 2.0, encoder_offset: 0.05, eccentricity: [0.01, 0.0], ..joint() };
    let mut physics = physics(drive, 0.0);
    physics.delay_s = 0.01;
    let mut arm = TwoMassArm::new(&physics, &[0.0]);
    let angle = -0.05_f64;
    assert!((arm.encoders()[0] - 0.01 * angle.sin()).abs() < 1e-15);
    arm.run(&[10.0], 0.11);
    let turned = 0.5 * 1.2 * 2.0 / (LINK + ROTOR) * 0.01 + angle;
    assert!((arm.encoders()[0] - (turned + 0.05 + 0.01 * turned.sin())).abs() < 1e-9);
    let warm = Joint { viscous: 2.0, warming: [0.0, 1.0], ..joint() };
    let mut arm = TwoMassArm::new(&self::physics(warm, 0.0), &[0.0]);
    arm.run(&[4.0], 100.0);
    // 2 rad/s against 4 N·m: 8 W, 8 K.
    assert!((arm.temperatures()[0] - 33.0).abs() < 0.1, "{}", arm.temperatures()[0]);
}
