//! Every robot of the workspace under every motion: the nominal arm follows without reaching a torque limit.

use std::path::Path;
use std::time::Instant;

use rivet_dynamics::{Workspace, mass_matrix};
use rivet_simulation::motion::{
    Fourier, FourierSettings, MotionLimits, PaperMotion, PointToPoint, PointToPointSettings, Trajectory, load_ratio,
};
use rivet_simulation::process::nominal_joints;
use rivet_simulation::{Disturbances, Plant, PlantSettings, Sensors, Truth, closed_loop};

#[test]
fn every_robot_follows_every_motion() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../robots");
    let mut robots = 0;
    for entry in std::fs::read_dir(folder).expect("robots") {
        let file = entry.expect("entry").path().join("robot.toml");
        if !file.is_file() {
            continue;
        }
        robots += 1;
        let robot = rivet_config::load(&file).expect("robot file");
        let (model, x, config) = (&robot.model, &robot.nominal, &robot.config);
        let (n, width) = (robot.dof(), robot.model.len());
        let limits = MotionLimits::of(&model.arm, 0.8);
        let mut load = load_ratio(model, x, &config.drive.torque_limit);
        let motions: [(&str, Box<dyn Trajectory>); 3] = [
            ("fourier", Box::new(Fourier::new(&limits, &FourierSettings::default(), &mut load))),
            ("point-to-point", Box::new(PointToPoint::new(&limits, &PointToPointSettings::default(), &mut load))),
            ("paper", Box::new(PaperMotion::new(&limits, &mut load))),
        ];
        for (name, motion) in motions {
            let truth = Truth::new(model, &nominal_joints(&robot), &Disturbances::default());
            let settings = PlantSettings::new(config.sample_period_s, &config.drive.torque_limit);
            let mut plant = Plant::new(&truth, &Sensors::perfect(n), &settings, 1);
            plant.place(&limits.home, &vec![0.0; n]);
            let (mut ws, mut y, mut mass) = (Workspace::new(&model.arm), vec![0.0; n * width], vec![0.0; n * n]);
            let (mut worst, mut moved, mut last) = (0.0_f64, vec![0.0_f64; n], limits.home.clone());
            let samples = (10.0 / config.sample_period_s) as usize;
            let begin = Instant::now();
            closed_loop(
                &mut plant,
                motion.as_ref(),
                |m, s, command| {
                    model.regressor(&mut ws, s.q, s.qd, s.qdd, &mut y);
                    mass_matrix(&model.arm, &model.arm.links, &mut ws, s.q, &mut mass);
                    for j in 0..n {
                        let velocity = (m.q()[j] - last[j]) / config.sample_period_s;
                        let inertia = mass[(n + 1) * j] + config.drive.rotor_inertia[j];
                        let w = 0.03 / config.sample_period_s;
                        let feedback = w * w * (s.q[j] - m.q()[j]) + 2.0 * w * (s.qd[j] - velocity);
                        command[j] = y[j * width..(j + 1) * width].iter().zip(x).map(|(y, x)| y * x).sum::<f64>()
                            + inertia * feedback;
                    }
                    last.copy_from_slice(m.q());
                },
                samples,
                |r| {
                    for j in 0..n {
                        worst = worst.max((r.setpoint.q[j] - r.q[j]).abs());
                        moved[j] = moved[j].max((r.setpoint.q[j] - limits.home[j]).abs());
                    }
                },
            );
            let cost = begin.elapsed().as_secs_f64() / samples as f64 * 1e6;
            println!("{:18} {name:15} error {worst:.1e} rad, {cost:.0} us a period, moves {moved:.2?}", config.name);
            assert_eq!(plant.saturated().iter().sum::<u64>(), 0, "{} {name}: torque limit reached", config.name);
            assert!(worst < 0.02, "{} {name}: off by {worst} rad", config.name);
        }
    }
    assert!(robots >= 7, "{robots} robots");
}
