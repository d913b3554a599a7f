//! Effects of a robot file act in the plant as the model says they do.

use crate::common::{SIX_LIMITS, six_drives, six_model};
use rivet_dynamics::{EffectKind, KnownEffect, KnownEffects, Model, Workspace};
use rivet_simulation::{Disturbances, Plant, PlantSettings, Random, Sensors, Truth};

fn arm(effects: &[KnownEffect]) -> (Model, Truth) {
    let drives = six_drives();
    let model = six_model(0.0).with_effects(KnownEffects::new(effects.to_vec(), &drives));
    let truth = Truth::new(&model, &drives, &Disturbances::default());
    (model, truth)
}

fn torque_of(model: &Model, x: &[f64], ws: &mut Workspace, q: &[f64], qd: &[f64], qdd: &[f64]) -> Vec<f64> {
    let width = model.len();
    let mut y = vec![0.0; 6 * width];
    model.regressor(ws, q, qd, qdd, &mut y);
    let mut tau: Vec<f64> = y.chunks_exact(width).map(|row| row.iter().zip(x).map(|(y, x)| y * x).sum()).collect();
    model.add_effects(ws, q, qd, qdd, &mut tau);
    tau
}

#[test]
fn the_model_with_effects_explains_the_plant() {
    use EffectKind as Kind;
    for (kind, values) in [
        (Kind::FrictionAsymmetry, &[1.5, 0.7][..]),
        (Kind::StribeckFriction, &[2.0, 0.1]),
        (Kind::ViscousNonlinearity, &[0.8, 0.3]),
        (Kind::PositionDependentFriction, &[0.7, -0.9, 2.0]),
        (Kind::TorqueConstant, &[0.08]),
        (Kind::TorqueRipple, &[0.8, 0.4, 30.0]),
        (Kind::JointSpring, &[6.0]),
        (Kind::Counterbalance, &[20.0, -8.0, 0.4, 0.3]),
    ] {
        let (model, truth) = arm(&[KnownEffect::new(kind, 2, values)]);
        assert!(truth.left_out().is_empty());
        let x = truth.standard(&model);
        let mut plant = Plant::new(&truth, &Sensors::perfect(6), &PlantSettings::new(0.001, &SIX_LIMITS), 1);
        let (mut ws, mut random, mut command) = (Workspace::new(&model.arm), Random::new(3), [0.0; 6]);
        let (mut worst, mut without, mut seen) = (0.0_f64, 0.0_f64, 0);
        let plain = model.clone().with_effects(KnownEffects::default());
        for k in 0..2500 {
            if k % 50 == 0 {
                for j in 0..6 {
                    command[j] = SIX_LIMITS[j] * random.uniform(-0.5, 0.5);
                }
            }
            plant.step(&command);
            if plant.qd().contains(&0.0) || plant.qd()[4] + plant.qd()[5] == 0.0 {
                continue;
            }
            let qdd = plant.qdd();
            let of = |model: &Model, ws: &mut Workspace| torque_of(model, &x, ws, plant.q(), plant.qd(), &qdd[..6])[2];
            worst = worst.max((of(&model, &mut ws) - command[2]).abs());
            without = without.max((of(&plain, &mut ws) - command[2]).abs());
            seen += 1;
        }
        assert!(seen > 1500, "only {seen} moving samples");
        assert!(worst < 1e-9 && without > 0.1, "{}: off by {worst}, without it {without}", kind.name());
    }
}

/// Friction and the rest are the whole; friction turns round with the velocity, and other effects have none.
#[test]
fn the_two_parts_of_effects_add_up() {
    use EffectKind as Kind;
    let friction = [
        (Kind::StribeckFriction, &[2.0, 0.5][..]),
        (Kind::ViscousNonlinearity, &[0.8, 0.3]),
        (Kind::LoadDependentFriction, &[0.1]),
        (Kind::PositionDependentFriction, &[0.7, -0.9, 2.0]),
    ];
    let others = [
        (Kind::TorqueRipple, &[0.8, 0.4, 30.0][..]),
        (Kind::JointSpring, &[6.0]),
        (Kind::Counterbalance, &[20.0, -8.0, 0.4, 0.3]),
        (Kind::EncoderEccentricity, &[0.01, -0.02]),
    ];
    let mut random = Random::new(11);
    for constant in [0.0, 0.08] {
        for (at, (kind, values)) in friction.iter().chain(&others).enumerate() {
            let constant = KnownEffect::new(Kind::TorqueConstant, 2, &[constant]);
            let (model, _) = arm(&[KnownEffect::new(*kind, 2, values), constant]);
            let mut ws = Workspace::new(&model.arm);
            for _ in 0..20 {
                let [q, qd, qdd] = [2.0, 1.0, 5.0].map(|reach| [(); 6].map(|()| random.uniform(-reach, reach)));
                let mut parts = |qd: &[f64; 6]| {
                    let [mut part, mut rest, mut whole] = [[0.0; 6]; 3];
                    model.add_effects_apart(&mut ws, [&q, qd, &qdd], &mut part, &mut rest);
                    model.add_effects(&mut ws, &q, qd, &qdd, &mut whole);
                    for j in 0..6 {
                        assert!((part[j] + rest[j] - whole[j]).abs() < 1e-12, "{}: {whole:?}", kind.name());
                    }
                    (part[2], rest[2])
                };
                let ((part, rest), (back, _)) = (parts(&qd), parts(&qd.map(|v| -v)));
                if at < friction.len() {
                    assert!(part != 0.0 && rest == 0.0, "{}: {part} and {rest}", kind.name());
                    assert!((part + back).abs() < 1e-12, "{}: {part}, reversed {back}", kind.name());
                } else {
                    assert!(part == 0.0 && rest != 0.0, "{}: {part} and {rest}", kind.name());
                }
            }
        }
    }
}

/// A joint that cannot move shows what its drive gives: late, lagging, cut.
#[test]
fn torque_arrives_late_lagging_and_cut() {
    let effect = |kind, values: &[f64]| KnownEffect::new(kind, 0, values);
    let given = |effects: &[KnownEffect]| -> Vec<f64> {
        let (_, truth) = arm(effects);
        let mut plant = Plant::new(&truth, &Sensors::perfect(6), &PlantSettings::new(0.001, &SIX_LIMITS), 1);
        (0..40)
            .map(|_| {
                plant.step(&[10.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
                plant.applied()[0]
            })
            .collect()
    };
    assert!(given(&[]).iter().all(|t| *t == 10.0));
    let late = given(&[effect(EffectKind::TransportDelay, &[0.003])]);
    assert_eq!((late[2], late[3]), (0.0, 10.0), "three periods later");
    let lagging = given(&[effect(EffectKind::CurrentLoopLag, &[0.01])]);
    assert!((lagging[9] / (10.0 * (1.0 - (-1.0_f64).exp())) - 1.0).abs() < 1e-9, "63 % after 10 ms: {}", lagging[9]);
    assert!(given(&[effect(EffectKind::TorqueSaturation, &[6.0])]).iter().all(|t| *t == 6.0));
}

/// The encoder says where the link would be without the error.
#[test]
fn encoders_misread_as_the_effect_says() {
    let effect = KnownEffect::new(EffectKind::EncoderEccentricity, 1, &[0.01, -0.02]);
    let (_, truth) = arm(&[effect]);
    let mut plant = Plant::new(&truth, &Sensors::perfect(6), &PlantSettings::new(0.001, &SIX_LIMITS), 1);
    plant.place(&[0.1, 0.7, 0.2, 0.0, 0.4, 0.3], &[0.0; 6]);
    let read = plant.measure();
    let link = read.q()[1] + effect.angle_error(read.q()[1]).expect("an angle");
    assert!((link - 0.7).abs() < 1e-8, "{link}");
    assert_eq!(read.q()[0], 0.1);
}

/// At rest and let go, the drive of a gear whose ratio is off carries that part of the links' torque more.
#[test]
fn a_gear_whose_ratio_varies_changes_the_load_on_its_drive() {
    let effect = KnownEffect::new(EffectKind::TransmissionError, 1, &[0.0, 1e-3, 80.0]);
    let q = [0.1, 0.4, 0.2, 0.0, 0.4, 0.3];
    // Far above what friction holds, so that the joint moves off at once.
    let command = [0.0, 0.9 * SIX_LIMITS[1], 0.0, 0.0, 0.0, 0.0];
    let accelerations = [vec![], vec![effect]].map(|effects| {
        let (_, truth) = arm(&effects);
        let mut plant = Plant::new(&truth, &Sensors::perfect(6), &PlantSettings::new(0.001, &SIX_LIMITS), 1);
        plant.place(&q, &[0.0; 6]);
        plant.step(&command);
        plant.qdd()
    });
    let (model, _) = arm(&[]);
    let mut ws = Workspace::new(&model.arm);
    let mut carried = [[0.0; 6]; 2];
    for (tau, qdd) in carried.iter_mut().zip(&accelerations) {
        rivet_dynamics::inverse_dynamics(&model.arm, &model.arm.links, &mut ws, &q, &[0.0; 6], &qdd[..6], tau);
    }
    let rotor = six_drives().rotor_inertia[1];
    let given = |at: usize| carried[at][1] + rotor * accelerations[at][1];
    let missing = given(0) - given(1);
    let expected = effect.ratio_error(q[1]) * carried[1][1];
    assert!(expected.abs() > 1.0 && (missing / expected - 1.0).abs() < 0.05, "{missing} for {expected} N m");
}

#[test]
fn what_is_not_simulated_is_said() {
    let (_, truth) = arm(&[KnownEffect::new(EffectKind::Backlash, 2, &[1e-3, 1e4, 0.3, 1.0])]);
    let said = truth.left_out();
    assert_eq!(said.len(), 1);
    assert!(said[0].starts_with("[effects.backlash] of ") && said[0].contains("rigid"), "{said:?}");
}
