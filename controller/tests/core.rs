//! The controller's decisions on samples and setpoints, on the manutec r3.

mod common;

use common::{core, robot, robot_with, setpoint, state};
use rivet_controller::Skipped;
use rivet_dynamics::{Workspace, inverse_dynamics};
use rivet_ipc_schema::{CommandMode, ControllerHealth, ControllerState, JointState, StopCause, faults};

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

/// From 0 to 1 with an end at rest on both sides.
fn smooth(x: f64) -> f64 {
    let x = x.min(1.0);
    x * x * (3.0 - 2.0 * x)
}

/// A constant torque that no model has: without integral action the arm stays away from its setpoint, with it it arrives.
#[test]
fn integral_action_removes_a_constant_error() {
    // An arm that does not answer its torque for so long would be stopped.
    let words = "[controller]\nintegral_hz = 0.3\nsaturation_ms = 10000\ntracking_error = 1.0\n";
    let robot = robot_with("manutec-r3", &[("[controller]\n", words)]);
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
}

/// An error that saturates the drives is not taken in: for how long it lasts makes no difference.
#[test]
fn integral_does_not_wind_up_while_a_drive_is_at_its_limit() {
    // An arm that does not answer its torque for so long would be stopped.
    let words =
        "[controller]\nintegral_hz = 0.3\nsaturation_ms = 10000\ntracking_error = 1.0\nunmodelled_torque = 1.0\n";
    let robot = robot_with("manutec-r3", &[("[controller]\n", words)]);
    let after = |standing: u64| {
        let mut core = core(&robot);
        let mut last = 0.0;
        // There and back in two seconds each: no faster than joints are.
        for seq in 1..=5000 + standing {
            let way = smooth(seq as f64 / 2000.0) - smooth(seq.saturating_sub(2000 + standing) as f64 / 2000.0);
            let away: Vec<f64> = Q.iter().map(|q| q + 0.45 * way).collect();
            core.offer_setpoint(&setpoint(seq, &Q, &[0.0; 6], &[0.0; 6]));
            last = core.tick(&state(seq, &away)).expect("a sound sample").tau[0];
        }
        assert_eq!(core.counts().stops, 0, "{:?}", core.stop_cause());
        (last, core.counts().saturated)
    };
    let (short, long) = (after(100), after(4000));
    assert!(long.1 >= short.1 + 3900, "{} and {}", short.1, long.1);
    assert!((long.0 - short.0).abs() < 1e-6 * short.0.abs(), "{} and {}", short.0, long.0);
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

/// A sample that is wrong stays wrong when the robot controller sends it again: at once, or a period later.
#[test]
fn a_wrong_sample_that_comes_twice_is_wrong_twice() {
    for observed in [false, true] {
        let mut core = core(&robot());
        let plan =
            |core: &mut rivet_controller::Core, seq| core.offer_setpoint(&setpoint(seq, &Q, &[0.0; 6], &[0.0; 6]));
        for seq in 1..=100 {
            plan(&mut core, seq);
            core.tick(&state(seq, &Q)).expect("a sound sample");
        }
        plan(&mut core, 101);
        let mut jumped = Q;
        jumped[2] += 0.2;
        if observed {
            core.observe(&state(101, &jumped));
        }
        for _ in 0..2 {
            assert_eq!(core.tick(&state(101, &jumped)), Err(Skipped::Invalid), "observed before: {observed}");
        }
    }
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
    // How a plan in motion is joined depends on the arm's speed, which a few samples show.
    for seq in 1..=8 {
        core.tick(&state(seq, &there)).expect("a sound sample");
    }
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

/// The plan of the run before lies near the arm and has a high number: it is not followed for as long as that run took.
#[test]
fn the_plan_of_an_earlier_run_is_not_followed() {
    let robot = robot();
    let mut core = core(&robot);
    let near: Vec<f64> = Q.iter().map(|q| q + 0.1).collect();
    core.offer_setpoint(&setpoint(10_000, &near, &[0.0; 6], &[0.0; 6]));
    for seq in 10_000..10_008 {
        core.tick(&state(seq, &Q)).expect("a sound sample");
    }
    assert_eq!(core.plan().expect("followed").q[0], near[0]);
    for seq in 1..=200 {
        core.offer_setpoint(&setpoint(seq, &Q, &[0.0; 6], &[0.0; 6]));
        let _ = core.tick(&state(seq, &Q));
    }
    assert_eq!(core.plan().expect("the new plan is followed").q[0], Q[0]);
}

/// A setpoint with a number of the far future is one of no period: it is not followed, and it locks out none.
#[test]
fn a_plan_of_the_future_is_not_followed() {
    let robot = robot();
    let mut core = core(&robot);
    core.offer_setpoint(&setpoint(u64::MAX, &Q, &[0.0; 6], &[0.0; 6]));
    core.tick(&state(1, &Q)).expect("a sound sample");
    assert!(core.plan().is_none());
    core.offer_setpoint(&setpoint(2, &Q, &[0.0; 6], &[0.0; 6]));
    core.tick(&state(2, &Q)).expect("a sound sample");
    assert!(core.plan().is_some());
}

/// The drives cannot hold the arm on its plan: it is braked, stands, and joins the plan again where that comes near.
#[test]
fn an_arm_that_strays_from_the_plan_is_braked_and_joins_again() {
    // What pushes it is stronger than loads and contacts are.
    let words = "[controller]\nsaturation_ms = 10000\nunmodelled_torque = 1.0\n";
    let robot = robot_with("manutec-r3", &[("[controller]\n", words)]);
    let mut core = core(&robot);
    let plan = |core: &mut rivet_controller::Core, seq| core.offer_setpoint(&setpoint(seq, &Q, &[0.0; 6], &[0.0; 6]));
    let (mut q, mut seq) = (Q, 0);
    // Joint 1 is pushed away at 0.1 rad/s.
    while q[0] < Q[0] + 0.3 {
        (q[0], seq) = (q[0] + 1e-4, seq + 1);
        plan(&mut core, seq);
        core.tick(&state(seq, &q)).expect("a sound sample");
    }
    assert_eq!(state_of(&core), ControllerState::Strayed);
    assert_eq!(core.counts().strayed, 1);
    // It stands there: it is held, with the torque that it needs there.
    let mut torque = [0.0; 8];
    // Positions that stop at once are called frozen for a second.
    for _ in 0..1500 {
        seq += 1;
        plan(&mut core, seq);
        torque = core.tick(&state(seq, &q)).expect("a sound sample").tau;
    }
    assert_eq!(state_of(&core), ControllerState::Strayed, "the plan is out of reach");
    let mut still = common::core(&robot);
    let mut held = [0.0; 8];
    for seq in 1..=500 {
        held = still.tick(&state(seq, &q)).expect("a sound sample").tau;
    }
    assert!(
        (torque[0] - held[0]).abs() < 0.01 * robot.config.drive.torque_limit[0],
        "{} against {}",
        torque[0],
        held[0]
    );
    // The plan comes to the arm.
    let first = seq;
    while state_of(&core) != ControllerState::Following {
        seq += 1;
        core.offer_setpoint(&setpoint(seq, &q, &[0.0; 6], &[0.0; 6]));
        core.tick(&state(seq, &q)).expect("a sound sample");
        assert!(seq <= first + 1, "it has been sound for longer than 0.2 s");
    }
    assert_eq!((core.counts().stops, core.counts().resumed), (1, 1));
}

/// At another rate velocity and rate limit are wrong: no command, and no stop reaction either as long as nothing was right.
#[test]
fn samples_at_another_rate_get_no_command() {
    let robot = robot();
    let stamped = |seq: u64, at_ns: u64| rivet_ipc_schema::JointState { stamp_ns: at_ns, ..state(seq, &Q) };
    let mut core = common::core(&robot);
    let skipped = |core: &mut rivet_controller::Core, seqs: std::ops::RangeInclusive<u64>, period: u64, offset: u64| {
        seqs.map(|seq| core.tick(&stamped(seq, offset + seq * period))).last().expect("some samples")
    };
    assert_eq!(skipped(&mut core, 1..=300, 2_000_000, 1), Err(Skipped::WrongPeriod));
    assert_eq!(state_of(&core), ControllerState::WrongPeriod);
    assert_eq!(core.missing(100), None);
    let set = common::published(&robot, 290);
    assert_eq!(core.offer_parameters(&set, &stamped(300, 600_000_001)), rivet_controller::gate::Refusal::OtherPeriod);
    // Once right, then wrong: the arm may be in motion, and is stopped.
    let mut core = common::core(&robot);
    skipped(&mut core, 1..=300, 1_000_000, 1).expect("the stated rate");
    skipped(&mut core, 301..=600, 2_000_000, 0).expect("the stop reaction");
    assert_eq!(core.stop_cause(), Some((StopCause::WrongPeriod, 0)));
}

/// While nothing was heard of the arm it sagged: what the law wants at once then comes at the permitted rate.
#[test]
fn after_a_gap_the_torque_ramps() {
    let robot = robot();
    let mut core = core(&robot);
    let plan = |core: &mut rivet_controller::Core, seq| core.offer_setpoint(&setpoint(seq, &Q, &[0.0; 6], &[0.0; 6]));
    let mut last = [0.0; 8];
    for seq in 1..=500 {
        plan(&mut core, seq);
        last = core.tick(&state(seq, &Q)).expect("a sound sample").tau;
    }
    let mut sagged = Q;
    sagged[1] += 0.15;
    let before = core.counts().rate_limited;
    let limits = &robot.config.drive.torque_limit;
    for seq in 700..720 {
        plan(&mut core, seq);
        let tau = core.tick(&state(seq, &sagged)).expect("a sound sample").tau;
        for j in 0..6 {
            let step = (tau[j] - last[j]).abs();
            assert!(step <= 0.01 * limits[j] * (1.0 + 1e-9), "sample {seq}, joint {}: {step} N m", j + 1);
        }
        last = tau;
    }
    assert!(core.counts().rate_limited > before, "the law wanted more than a step");
}
