//! The controller's decisions, on the manutec r3.

use rivet_config::Robot;
use rivet_controller::gate::Refusal;
use rivet_controller::{Core, Skipped};
use rivet_dynamics::{Model, Workspace, inverse_dynamics};
use rivet_ipc_schema::{CommandMode, JointState, Parameters, Setpoint, faults, parameter_flags};
use std::path::Path;

fn robot() -> Robot {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../robots/manutec-r3/robot.toml");
    rivet_config::load(file).expect("the robot file is sound")
}

fn state(seq: u64, q: &[f64]) -> JointState {
    let mut state = JointState { seq, joints: q.len() as u32, ..JointState::default() };
    state.q[..q.len()].copy_from_slice(q);
    state
}

fn setpoint(seq: u64, q: &[f64], qd: &[f64], qdd: &[f64]) -> Setpoint {
    let mut setpoint = Setpoint { seq, joints: q.len() as u32, ..Setpoint::default() };
    setpoint.q[..q.len()].copy_from_slice(q);
    setpoint.qd[..q.len()].copy_from_slice(qd);
    setpoint.qdd[..q.len()].copy_from_slice(qdd);
    setpoint
}

fn published(robot: &Robot, seq: u64) -> Parameters {
    let mut set = Parameters {
        epoch: seq / 100,
        seq,
        model_hash: robot.hash,
        count: robot.base.len() as u32,
        joints: robot.dof() as u32,
        ..Parameters::default()
    };
    set.values[..robot.base.len()].copy_from_slice(&robot.nominal_base);
    set
}

const Q: [f64; 6] = [0.3, -0.4, 0.8, 0.2, -0.7, 0.1];

/// Standing where it should stand, the arm gets exactly the torque of its rigid bodies at rest: the law adds nothing.
#[test]
fn at_the_setpoint_the_command_is_the_models_torque() {
    let robot = robot();
    let mut core = Core::new(&robot, 0);
    core.offer_setpoint(&setpoint(1, &Q, &[0.0; 6], &[0.0; 6]));
    let arm = &robot.model.arm;
    let mut tau = [0.0; 6];
    inverse_dynamics(arm, &arm.links, &mut Workspace::new(arm), &Q, &[0.0; 6], &[0.0; 6], &mut tau);
    let mut command = None;
    // The rate limit lets the torque grow from zero: it takes a while to arrive.
    for seq in 1..=400 {
        command = Some(core.tick(&state(seq, &Q)).expect("a sound sample"));
    }
    let command = command.expect("commands were made");
    for j in 0..6 {
        assert!((command.tau[j] - tau[j]).abs() < 1e-9 * (1.0 + tau[j].abs()), "joint {}: {command:?} {tau:?}", j + 1);
    }
    assert_eq!(CommandMode::try_from(command.mode), Ok(CommandMode::Nominal));
    assert_eq!(command.seq, 400);
}

#[test]
fn without_a_setpoint_the_arm_is_held_where_it_is() {
    let robot = robot();
    let mut core = Core::new(&robot, 0);
    let mut there = Core::new(&robot, 0);
    there.offer_setpoint(&setpoint(1, &Q, &[0.0; 6], &[0.0; 6]));
    for seq in 1..=50 {
        assert_eq!(core.tick(&state(seq, &Q)), there.tick(&state(seq, &Q)));
    }
}

/// A plan that ends without a word is not followed into the past: the arm stays where it is.
#[test]
fn when_nobody_plans_any_more_the_arm_is_held() {
    let robot = robot();
    let mut core = Core::new(&robot, 0);
    let away: Vec<f64> = Q.iter().map(|q| q + 0.05).collect();
    core.offer_setpoint(&setpoint(1, &away, &[0.0; 6], &[0.0; 6]));
    let mut held = Core::new(&robot, 0);
    let last = 2000;
    let commands: Vec<_> = (1..=last).map(|seq| core.tick(&state(seq, &Q)).expect("a sound sample").tau).collect();
    let still: Vec<_> = (1..=last).map(|seq| held.tick(&state(seq, &Q)).expect("a sound sample").tau).collect();
    assert_ne!(commands[10], still[10], "at first the plan is followed");
    assert_eq!(commands[last as usize - 1], still[last as usize - 1]);
}

#[test]
fn samples_that_say_nothing_about_the_arm_get_no_command() {
    let robot = robot();
    let mut core = Core::new(&robot, 0);
    core.tick(&state(5, &Q)).expect("a sound sample");
    assert_eq!(core.tick(&state(5, &Q)), Err(Skipped::Stale));
    assert_eq!(core.tick(&state(6, &Q[..5])), Err(Skipped::Invalid));
    assert_eq!(core.tick(&JointState { faults: faults::ENCODER, ..state(7, &Q) }), Err(Skipped::Invalid));
    let mut broken = state(8, &Q);
    broken.q[3] = f64::NAN;
    assert_eq!(core.tick(&broken), Err(Skipped::Invalid));
    core.tick(&state(9, &Q)).expect("the next sound sample is answered");
    core.tick(&JointState { faults: faults::STOPPED, ..state(10, &Q) }).expect("the brakes wait for a command");
    assert_eq!(core.counts().invalid, 3);
}

#[test]
fn every_published_set_has_to_pass_the_gate() {
    let robot = robot();
    let sample = state(1000, &Q);
    let viscous = (0..robot.base.len())
        .find(|&i| robot.base.name(&robot.model, i).contains("viscous"))
        .expect("viscous friction is a base parameter");
    let good = published(&robot, 900);
    let mut cases = vec![(good, Refusal::None)];
    let mut spoil = |why, change: &dyn Fn(&mut Parameters)| {
        let mut set = good;
        change(&mut set);
        cases.push((set, why));
    };
    spoil(Refusal::OtherModel, &|set| set.model_hash ^= 1);
    spoil(Refusal::WrongCount, &|set| set.count -= 1);
    spoil(Refusal::Provisional, &|set| set.flags |= parameter_flags::PROVISIONAL);
    spoil(Refusal::NotFinite, &|set| set.values[3] = f64::NAN);
    spoil(Refusal::DrivingFriction, &|set| set.values[viscous] = -1.0);
    spoil(Refusal::InertiaNotPositive, &|set| set.values[..].iter_mut().for_each(|x| *x = -*x * 0.0 - 0.0));
    for (set, why) in cases {
        let mut core = Core::new(&robot, 0);
        assert_eq!(core.offer_parameters(&set, &sample), why);
        assert_eq!(core.epoch(), if why == Refusal::None { set.epoch } else { 0 });
    }
    let mut core = Core::new(&robot, 0);
    assert_eq!(core.offer_parameters(&good, &sample), Refusal::None);
    assert_eq!(core.offer_parameters(&good, &sample), Refusal::Old);
}

#[test]
fn published_sets_wait_for_the_sample_from_which_they_may_act() {
    let robot = robot();
    let mut core = Core::new(&robot, 500);
    core.offer_parameters(&published(&robot, 400), &state(499, &Q));
    assert_eq!(core.counts().adopted, 0);
    core.offer_parameters(&published(&robot, 400), &state(500, &Q));
    assert_eq!(core.counts().adopted, 1);
}

/// Adopting a set with doubled friction and bodies: the largest step of the command stays below the rate limit, and the
/// new torque arrives.
#[test]
fn adopting_another_set_is_no_torque_step() {
    let robot = robot();
    let mut core = Core::new(&robot, 0);
    core.offer_setpoint(&setpoint(1, &Q, &[0.0; 6], &[0.0; 6]));
    let mut last = [0.0; 8];
    for seq in 1..=400 {
        last = core.tick(&state(seq, &Q)).expect("a sound sample").tau;
    }
    let before = last;
    let mut set = published(&robot, 300);
    set.values.iter_mut().for_each(|x| *x *= 2.0);
    assert_eq!(core.offer_parameters(&set, &state(400, &Q)), Refusal::None);
    let mut largest = 0.0_f64;
    for seq in 401..=1400 {
        let command = core.tick(&state(seq, &Q)).expect("a sound sample");
        assert_eq!(CommandMode::try_from(command.mode), Ok(CommandMode::Identified));
        for j in 0..6 {
            let share = (command.tau[j] - last[j]).abs() / robot.config.drive.torque_limit[j];
            largest = largest.max(share);
        }
        last = command.tau;
    }
    assert!((last[1] - 2.0 * before[1]).abs() < 1e-6 * before[1].abs(), "{} after {}", last[1], before[1]);
    assert!(largest < 0.011, "a step of {largest} of the torque limit in one period");
}

#[test]
fn a_robot_controller_that_starts_anew_is_followed() {
    let robot = robot();
    let mut core = Core::new(&robot, 0);
    core.tick(&state(10_000, &Q)).expect("a sound sample");
    let answered = (1..=200).filter(|&seq| core.tick(&state(seq, &Q)).is_ok()).count();
    assert_eq!(answered, 101, "from the hundredth old sample on");
}

/// The model that the gate reads must be the one of the law.
#[test]
fn friction_columns_are_found_by_their_meaning() {
    let robot = robot();
    let model: &Model = &robot.model;
    let names: Vec<String> = (0..robot.base.len()).map(|i| robot.base.name(model, i)).collect();
    assert_eq!(names.iter().filter(|name| name.contains("viscous") || name.contains("coulomb")).count(), 12);
}
