//! The pure cores in one loop, without processes: plant, `rivetd`'s core, the controller's core. Equal inputs, equal bits.

use rivet_config::Robot;
use rivet_controller::Core as Controller;
use rivet_daemon::Core as Daemon;
use rivet_dynamics::MAX_JOINTS;
use rivet_ipc_schema::{Command, JointState, Parameters, Setpoint, faults};
use rivet_simulation::motion::Trajectory;
use rivet_simulation::process::nominal_joints;
use rivet_simulation::{BUILD_UP_S, Disturbances, FrictionLaw, Plant, PlantSettings, Sensors, Truth};
use std::path::Path;

/// The robot of `robots/<arm>/robot.toml` with other words in some of its lines.
pub fn robot_with(arm: &str, changes: &[(&str, &str)]) -> Robot {
    let file = crate::robot(arm);
    let mut text = std::fs::read_to_string(&file).expect("the robot file is there");
    for (from, to) in changes {
        assert!(text.contains(from), "{from} is in {}", file.display());
        text = text.replacen(from, to, 1);
    }
    rivet_config::parse(Path::new(&file), &text).expect("the changed file is sound")
}

/// One period of the loop as it really was.
pub struct Period<'a> {
    /// Motion time \[s\].
    pub t_s: f64,
    /// The plan.
    pub setpoint: &'a Setpoint,
    /// What the controller got.
    pub sample: &'a JointState,
    /// Its answer.
    pub command: &'a Command,
    /// True positions \[rad\].
    pub q: &'a [f64],
    /// True velocities \[rad/s\].
    pub qd: &'a [f64],
}

/// Plant and trajectory under a controller, brakes and torque build-up as on `rivet-sim`.
pub struct ClosedLoop {
    plant: Plant,
    trajectory: Box<dyn Trajectory>,
    period_s: f64,
    seq: u64,
}

impl ClosedLoop {
    /// The true arm is `robot`'s with `disturbances`; its drives and sensors are those of the file.
    pub fn new(robot: &Robot, disturbances: &Disturbances, trajectory: Box<dyn Trajectory>, seed: u64) -> ClosedLoop {
        let config = &robot.config;
        let truth = Truth::new(&robot.model, &nominal_joints(robot), disturbances);
        let sensors = Sensors {
            resolution: config.drive.encoder_resolution.clone(),
            position_noise: config.simulation.position_noise.clone(),
            torque_noise: config.simulation.torque_noise.clone(),
        };
        let mut settings = PlantSettings::new(config.sample_period_s, &config.drive.torque_limit);
        if config.signal.friction_velocity > 0.0 {
            settings.friction = FrictionLaw::Smooth { velocity: config.signal.friction_velocity };
        }
        let mut plant = Plant::new(&truth, &sensors, &settings, seed);
        let n = robot.dof();
        let (mut q, mut rest) = (vec![0.0; n], [vec![0.0; n], vec![0.0; n]]);
        let [qd, qdd] = &mut rest;
        trajectory.sample(0.0, &mut q, qd, qdd);
        plant.place(&q, qd);
        plant.set_brake(true);
        ClosedLoop { plant, trajectory, period_s: config.sample_period_s, seq: 0 }
    }

    /// The arm goes on as that of another file: other bodies, drives and viscous friction; dry friction stays.
    pub fn become_that_of(&mut self, robot: &Robot, disturbances: &Disturbances) {
        self.plant.become_loaded(&Truth::new(&robot.model, &nominal_joints(robot), disturbances));
    }

    /// True base parameters of a loop made from the same `robot` and `disturbances`.
    pub fn truth(robot: &Robot, disturbances: &Disturbances) -> Vec<f64> {
        let truth = Truth::new(&robot.model, &nominal_joints(robot), disturbances);
        robot.base.from_standard(&truth.standard(&robot.model))
    }

    /// Runs `motion_s` seconds of motion. `before` may hand parameters to the controller; `after` sees every period.
    pub fn run(
        &mut self,
        controller: &mut Controller,
        motion_s: f64,
        mut before: impl FnMut(&mut Controller, &JointState, &Setpoint),
        mut after: impl FnMut(&Period<'_>),
    ) {
        let n = self.plant.dof();
        let build_up = (BUILD_UP_S / self.period_s).round() as u64;
        let end = build_up + (motion_s / self.period_s).round() as u64;
        let (mut q, mut qd, mut qdd) = ([0.0; MAX_JOINTS], [0.0; MAX_JOINTS], [0.0; MAX_JOINTS]);
        while self.seq < end {
            if self.seq == build_up {
                self.plant.set_brake(false);
            }
            let t_s = self.seq.saturating_sub(build_up) as f64 * self.period_s;
            self.seq += 1;
            self.trajectory.sample(t_s, &mut q[..n], &mut qd[..n], &mut qdd[..n]);
            let (seq, stamp_ns, joints) = (self.seq, (self.seq as f64 * self.period_s * 1e9) as u64, n as u32);
            let setpoint = Setpoint { seq, stamp_ns, q, qd, qdd, joints, ..Setpoint::default() };
            let measured = self.plant.measure();
            let braked = self.plant.braked();
            let mut sample = JointState {
                seq,
                stamp_ns,
                joints,
                faults: if braked { faults::STOPPED } else { 0 },
                ..JointState::default()
            };
            sample.q[..n].copy_from_slice(measured.q());
            sample.tau[..n].copy_from_slice(measured.tau());
            controller.offer_setpoint(&setpoint);
            before(controller, &sample, &setpoint);
            let command = controller.tick(&sample).expect("a sound sample");
            after(&Period {
                t_s,
                setpoint: &setpoint,
                sample: &sample,
                command: &command,
                q: self.plant.q(),
                qd: self.plant.qd(),
            });
            self.plant.step(&command.tau[..n]);
        }
    }
}

/// Lets `daemon` take in a sample and the controller whatever it then publishes.
pub fn live(
    daemon: &mut Daemon,
    set: &mut Parameters,
    controller: &mut Controller,
    sample: &JointState,
    plan: &Setpoint,
) {
    if daemon.tick(sample, Some(plan)).publish {
        daemon.write_parameters(set);
        controller.offer_parameters(set, sample);
    }
}
