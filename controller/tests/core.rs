//! The controller's decisions on samples and setpoints, on the manutec r3.

mod common;

use common::{core, robot, robot_with, setpoint, state};
use rivet_controller::Skipped;
use rivet_dynamics::{Workspace, inverse_dynamics};
use rivet_ipc_schema::{CommandMode, ControllerHealth, ControllerState, JointState, faults};

const Q: [f64; 6] = [0.3, -0.4, 0.8, 0.2, -0.7, 0.1];

fn state_of(core: &rivet_controller::Core) -> ControllerState {
    let mut health = ControllerHealth::default();
    core.write_health(&mut health);
    ControllerState::try_from(health.state).expect("a known state")
}

/// Standing where it should stand, the arm gets exactly the torque of its rigid bodies at rest: both laws add nothing.
#[test]
fn at_the_setpoint_the_command_is_the_models_torque() {
    let law = ("[controller]\n", "[controller]\nlaw = \"feed-forward-pd\"\n");
    for robot in [robot(), robot_with("manutec-r3", &[law])] {
        let mut core = core(&robot);
        let arm = &robot.model.arm;
        let mut tau = [0.0; 6];
        inverse_dynamics(arm, &arm.links, &mut Workspace::new(arm), &Q, &[0.0; 6], &[0.0; 6], &mut tau);
        let mut command = None;
        // The rate limit lets the torque grow from zero: it takes a while to arrive.
        for seq in 1..=400 {
            core.offer_setpoint(&setpoint(seq, &Q, &[0.0; 6], &[0.0; 6]));
            command = Some(core.tick(&state(seq, &Q)).expect("a sound sample"));
        }
        let command = command.expect("commands were made");
        for j in 0..6 {
            assert!((command.tau[j] - tau[j]).abs() < 1e-9 * (1.0 + tau[j].abs()), "joint {}: {command:?}", j + 1);
        }
        assert_eq!(CommandMode::try_from(command.mode), Ok(CommandMode::Nominal));
        assert_eq!(command.seq, 400);
        assert_eq!(state_of(&core), ControllerState::Following);
    }
}

/// The feedback of computed torque goes through the inertia matrix, that of feed-forward and PD through constant gains.
#[test]
fn the_two_laws_differ_in_how_an_error_acts() {
    let law = ("[controller]\n", "[controller]\nlaw = \"feed-forward-pd\"\n");
    let error = 1e-3;
    let answer = |robot: &rivet_config::Robot| {
        let mut core = core(robot);
        let mut tau = [[0.0; 8]; 2];
        for (tau, offset) in tau.iter_mut().zip([0.0, error]) {
            for seq in 1..=400 {
                let mut q = Q;
                q[1] += offset;
                let seq = seq + if offset > 0.0 { 400 } else { 0 };
                core.offer_setpoint(&setpoint(seq, &q, &[0.0; 6], &[0.0; 6]));
                *tau = core.tick(&state(seq, &Q)).expect("a sound sample").tau;
            }
        }
        [tau[1][1] - tau[0][1], tau[1][2] - tau[0][2]]
    };
    let (torque, pd) = (answer(&robot()), answer(&robot_with("manutec-r3", &[law])));
    // w^2 of 3 Hz times an inertia of joint 2 between the rotor's 57 and the stretched arm's some 100 kg m^2.
    let gain = (std::f64::consts::TAU * 3.0_f64).powi(2) * error;
    assert!((57.0..130.0).contains(&(torque[0] / gain)), "{torque:?}");
    assert!((57.0..130.0).contains(&(pd[0] / gain)), "{pd:?}");
    assert!(torque[1].abs() > 0.02 * torque[0].abs(), "joint 3 is moved along: {torque:?}");
    assert!(pd[1].abs() < 0.02 * pd[0].abs(), "but for gravity joint 3 does not care: {pd:?}");
}

/// A constant torque that no model has: without integral action the arm stays away from its setpoint, with it it arrives.
#[test]
fn integral_action_removes_a_constant_error_and_does_not_wind_up() {
    let robot = robot_with("manutec-r3", &[("[controller]\n", "[controller]\nintegral_hz = 0.3\n")]);
    let mut core = core(&robot);
    let mut away = Q;
    away[0] -= 0.01;
    let mut taus = Vec::new();
    for seq in 1..=3000 {
        core.offer_setpoint(&setpoint(seq, &Q, &[0.0; 6], &[0.0; 6]));
        taus.push(core.tick(&state(seq, &away)).expect("a sound sample").tau[0]);
    }
    // d tau/dt = M·Ki·e for a constant error; M is the same at both ends.
    let slope = (taus[2999] - taus[1999]) / (taus[1999] - taus[999]);
    assert!((slope - 1.0).abs() < 1e-6, "{slope}");
    let proportional = taus[399] - 0.4 / 1.0 * (taus[1999] - taus[999]);
    let per_second = (taus[1999] - taus[999]) / proportional;
    assert!((per_second - std::f64::consts::TAU * 0.3).abs() < 0.1, "{per_second}");
    // An error that saturates the drive is not taken in.
    for joint in 0..6 {
        away[joint] = Q[joint] + 3.0;
    }
    for seq in 3001..=9000 {
        core.offer_setpoint(&setpoint(seq, &Q, &[0.0; 6], &[0.0; 6]));
        core.tick(&state(seq, &away)).expect("a sound sample");
    }
    let mut last = 0.0;
    for seq in 9001..=9400 {
        core.offer_setpoint(&setpoint(seq, &Q, &[0.0; 6], &[0.0; 6]));
        last = core.tick(&state(seq, &Q)).expect("a sound sample").tau[0];
    }
    assert!((last - (taus[2999] - proportional)).abs() < 0.05 * last.abs(), "{last} after {}", taus[2999]);
}

#[test]
fn without_a_setpoint_the_arm_is_held_where_it_is() {
    let robot = robot();
    let (mut alone, mut there) = (core(&robot), core(&robot));
    for seq in 1..=50 {
        there.offer_setpoint(&setpoint(seq, &Q, &[0.0; 6], &[0.0; 6]));
        assert_eq!(alone.tick(&state(seq, &Q)), there.tick(&state(seq, &Q)));
    }
    assert_eq!(state_of(&alone), ControllerState::Holding);
}

/// A plan that ends without a word is not followed into the past: the arm stays where it is.
#[test]
fn when_nobody_plans_any_more_the_arm_is_held() {
    let robot = robot();
    let (mut led, mut held) = (core(&robot), core(&robot));
    let away: Vec<f64> = Q.iter().map(|q| q + 0.05).collect();
    led.offer_setpoint(&setpoint(1, &away, &[0.0; 6], &[0.0; 6]));
    let run = |core: &mut rivet_controller::Core| -> Vec<_> {
        (1..=2000).map(|seq| core.tick(&state(seq, &Q)).expect("a sound sample").tau).collect()
    };
    let (commands, still) = (run(&mut led), run(&mut held));
    assert_ne!(commands[10], still[10], "at first the plan is followed");
    assert_eq!(commands[1999], still[1999]);
}

/// A plan that is far away is not jumped to, when the controller starts as after a stop.
#[test]
fn a_plan_is_joined_only_near_the_arm() {
    let robot = robot();
    let (mut led, mut held) = (core(&robot), core(&robot));
    let far: Vec<f64> = Q.iter().map(|q| q + 0.5).collect();
    for seq in 1..=100 {
        led.offer_setpoint(&setpoint(seq, &far, &[0.0; 6], &[0.0; 6]));
        assert_eq!(led.tick(&state(seq, &Q)), held.tick(&state(seq, &Q)));
    }
    led.offer_setpoint(&setpoint(101, &Q, &[0.0; 6], &[0.0; 6]));
    led.tick(&state(101, &Q)).expect("a sound sample");
    assert_eq!(state_of(&led), ControllerState::Following);
}

#[test]
fn a_plan_beyond_the_joint_limits_is_brought_back() {
    let robot = robot();
    let mut core = core(&robot);
    let upper = robot.model.arm.joints[0].upper;
    let (mut q, mut fast) = (Q, [0.0; 6]);
    q[0] = upper + 0.5;
    fast[1] = 2.0 * robot.model.arm.joints[1].velocity;
    core.offer_setpoint(&setpoint(1, &q, &fast, &[0.0; 6]));
    let mut there = Q;
    there[0] = upper;
    core.tick(&state(1, &there)).expect("a sound sample");
    let plan = core.plan().expect("it is followed");
    assert_eq!((plan.q[0], plan.qd[1]), (upper, robot.model.arm.joints[1].velocity));
    assert_eq!(core.counts().setpoints_limited, 1);
}

#[test]
fn samples_that_say_nothing_about_the_arm_get_no_command() {
    let robot = robot();
    let mut core = core(&robot);
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
fn a_robot_controller_that_starts_anew_is_followed() {
    let robot = robot();
    let mut core = core(&robot);
    core.tick(&state(10_000, &Q)).expect("a sound sample");
    let answered = (1..=200).filter(|&seq| core.tick(&state(seq, &Q)).is_ok()).count();
    assert_eq!(answered, 101, "from the hundredth old sample on");
}
