//! Whether the daemon notices that an arm has left the model that was accepted, and on which joint, and keeps quiet otherwise.

use rivet_config::Robot;
use rivet_controller::Core as Controller;
use rivet_daemon::Core as Daemon;
use rivet_ipc_schema::{DRIFT_REGIMES, Drift, DriftVerdict, MAX_JOINTS};
use rivet_simulation::Disturbances;
use rivet_simulation::motion::{Fourier, FourierSettings, MotionLimits, load_ratio};
use rivet_tests::closed::{ClosedLoop, robot_with};

const ARM: &str = "manutec-r3";
const SAMPLES_A_S: u64 = 1000;

/// An arm whose bodies and friction differ a little from those of the file, as an accepted model's do.
fn imperfect() -> Disturbances {
    Disturbances { bodies_spread: 0.03, friction_spread: 0.05, ..Disturbances::default() }
}

fn arm(robot: &Robot, seed: u64) -> ClosedLoop {
    let mut load = load_ratio(&robot.model, &robot.nominal, &robot.config.drive.torque_limit);
    let settings = FourierSettings { seed, ..FourierSettings::default() };
    let motion = Fourier::new(&MotionLimits::of(&robot.model.arm, 0.5), &settings, &mut load);
    ClosedLoop::new(robot, &imperfect(), Box::new(motion), seed)
}

/// Runs on until `seconds` of motion; `look` sees the verdicts every tenth of a second.
fn run(
    arm: &mut ClosedLoop,
    controller: &mut Controller,
    daemon: &mut Daemon,
    seconds: f64,
    mut look: impl FnMut(u64, &Drift),
) {
    let mut drift = Drift::default();
    arm.run(
        controller,
        seconds,
        |_, sample, plan| {
            daemon.tick(sample, Some(plan));
            if sample.seq % (SAMPLES_A_S / 10) == 0 {
                daemon.write_drift(&mut drift);
                look(sample.seq, &drift);
            }
        },
        |_| (),
    );
}

/// The viscous friction of joint 3 doubles after 80 s.
#[test]
fn an_arm_whose_friction_has_changed_has_left_its_model_on_that_joint_within_half_a_minute() {
    let robot = robot_with(ARM, &[]);
    let viscous = robot.config.friction.viscous.clone();
    let mut worn = robot_with(ARM, &[]);
    worn.config.friction.viscous[2] = 2.0 * viscous[2];
    let mut plant = arm(&robot, 3);
    let mut controller = Controller::new(&robot, 0).expect("sound settings");
    let mut daemon = Daemon::new(&robot).expect("sound settings");
    let (mut changed, mut settled) = (0, Drift::default());
    run(&mut plant, &mut controller, &mut daemon, 80.0, |seq, drift| (changed, settled) = (seq, *drift));
    assert_eq!(settled.verdict, u32::from(DriftVerdict::Within), "{settled:?}");
    for regime in 0..DRIFT_REGIMES {
        let of = |rms: &[f64]| rms[regime * MAX_JOINTS + 2];
        assert!(of(&settled.reference_rms) > 0.0, "regime {regime}: {settled:?}");
    }

    plant.become_that_of(&worn, &imperfect());
    let (mut left, mut last) = (None, Drift::default());
    run(&mut plant, &mut controller, &mut daemon, 120.0, |seq, drift| {
        last = *drift;
        for j in 0..robot.dof() {
            let gone = drift.joint_verdict[j] == u32::from(DriftVerdict::Left);
            assert!(!gone || j == 2, "joint {}: {drift:?}", j + 1);
            if gone && left.is_none() {
                left = Some(seq);
            }
        }
    });
    let after_s = (left.expect("the change is noticed") - changed) as f64 / SAMPLES_A_S as f64;
    println!("left after {after_s:.1} s, {:.1} times the residual", last.ratio[2]);
    assert!(after_s < 30.0, "{after_s} s");
    assert_eq!(last.verdict, u32::from(DriftVerdict::Left));
    // The verdict says since when.
    assert!(last.since_seq[2] > changed && last.since_seq[2] <= left.expect("noticed"));
}

/// Two motions of two minutes each, and none of the joints ever leaves a model that is as wrong as ever.
#[test]
fn an_arm_that_stays_as_it_is_never_leaves_its_model() {
    let robot = robot_with(ARM, &[]);
    for seed in [5, 6] {
        let mut plant = arm(&robot, seed);
        let mut controller = Controller::new(&robot, 0).expect("sound settings");
        let mut daemon = Daemon::new(&robot).expect("sound settings");
        let mut last = Drift::default();
        run(&mut plant, &mut controller, &mut daemon, 120.0, |seq, drift| {
            last = *drift;
            assert_ne!(drift.verdict, u32::from(DriftVerdict::Left), "seed {seed}, sample {seq}: {drift:?}");
        });
        assert_eq!(last.verdict, u32::from(DriftVerdict::Within), "{last:?}");
    }
}
