//! Identification while this controller moves the arm, with encoders so coarse that acceleration is mostly noise: least
//! squares misses the inertia by more than its size, instruments from the plan do not, though noise is fed back.

use rivet_controller::Core as Controller;
use rivet_daemon::Core as Daemon;
use rivet_ipc_schema::Parameters;
use rivet_simulation::Disturbances;
use rivet_simulation::motion::{MotionLimits, PaperMotion, load_ratio};
use rivet_tests::closed::{ClosedLoop, live, robot_with};

#[test]
fn riv_is_unbiased_where_least_squares_is_not() {
    // The paper's set-up: 1 ms, central differences, no model filter worth the name (450 Hz is the most there is at 1 kHz),
    // 0.8 and 1.1 Hz; encoders so coarse that the noise of joint 1's acceleration is about as large as its signal.
    let robot = robot_with(
        "dd2",
        &[
            ("encoder_resolution = [6.1359e-6, 9.5874e-6]", "encoder_resolution = [2e-5, 2e-5]"),
            (
                "model_filter_hz = 10.0          # Hz\ndecimation = 20",
                "friction_velocity = 0.1\ndifferentiator = \"central\"\nmodel_filter_order = 2\nmodel_filter_hz = 450.0\ndecimation = 1",
            ),
            ("window_s = 5.0", "window = \"none\"\nwindow_s = 5.0"),
        ],
    );
    let limits = MotionLimits::of(&robot.model.arm, 0.8);
    let mut load = load_ratio(&robot.model, &robot.nominal, &robot.config.drive.torque_limit);
    let disturbances = Disturbances { bodies: 1.2, friction: 1.3, ..Disturbances::default() };
    let truth = ClosedLoop::truth(&robot, &disturbances);
    // What has to be accelerated about joint 1 (the rotor's, into which link 1's inertia folds) and about joint 2.
    let inertias: Vec<usize> = (0..robot.base.len())
        .filter(|&i| ["j1.rotor_inertia+", "l2.Izz"].contains(&robot.base.name(&robot.model, i).as_str()))
        .collect();
    // Over 24 seeds joint 1 was off by −0.51 % on average and 0.95 % at most: the aim is kept, a bias is there (docs/controller.md).
    for seed in 1..=12 {
        let trajectory = Box::new(PaperMotion::new(&limits, &mut load));
        let mut plant = ClosedLoop::new(&robot, &disturbances, trajectory, seed);
        let mut controller = Controller::new(&robot, 0).expect("sound settings");
        let mut daemon = Daemon::new(&robot).expect("sound settings");
        let mut set = Parameters::default();
        plant.run(
            &mut controller,
            60.0,
            |controller, sample, plan| live(&mut daemon, &mut set, controller, sample, plan),
            |_| (),
        );
        assert!(
            controller.counts().accepted > 50,
            "the loop was closed with live parameters: {:?}",
            controller.counts()
        );
        for &i in &inertias {
            let riv = set.values[i] / truth[i] - 1.0;
            let rls = set.reference[i] / truth[i] - 1.0;
            let name = robot.base.name(&robot.model, i);
            println!("seed {seed}: {name}: RIV {:+.2} %, RLS {:+.1} %", 100.0 * riv, 100.0 * rls);
            assert!(riv.abs() <= 0.01, "{name}: RIV {riv}");
            assert!(rls.abs() >= 0.2, "{name}: RLS {rls}");
        }
    }
}
