//! An arm in motion as the controller sees it, and messages about it.
#![allow(dead_code, reason = "each test binary uses its part")]

pub(crate) mod rig;

use rivet_config::Robot;
use rivet_controller::Core;
use rivet_dynamics::Workspace;
use rivet_ipc_schema::{Command, JointState, Parameters, Setpoint};
use std::path::Path;

pub(crate) fn robot_of(arm: &str) -> Robot {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../robots").join(arm).join("robot.toml");
    rivet_config::load(file).expect("the robot file is sound")
}

pub(crate) fn robot() -> Robot {
    robot_of("manutec-r3")
}

/// The robot of that file with other words in some of its lines.
pub(crate) fn robot_with(arm: &str, changes: &[(&str, &str)]) -> Robot {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../robots").join(arm).join("robot.toml");
    let mut text = std::fs::read_to_string(&file).expect("the robot file is there");
    for (from, to) in changes {
        assert!(text.contains(from), "{from} is in the file");
        text = text.replacen(from, to, 1);
    }
    rivet_config::parse(&file, &text).expect("the changed file is sound")
}

pub(crate) fn core(robot: &Robot) -> Core {
    Core::new(robot, 0).expect("sound settings")
}

pub(crate) fn state(seq: u64, q: &[f64]) -> JointState {
    let mut state = JointState { seq, joints: q.len() as u32, ..JointState::default() };
    state.q[..q.len()].copy_from_slice(q);
    state
}

pub(crate) fn setpoint(seq: u64, q: &[f64], qd: &[f64], qdd: &[f64]) -> Setpoint {
    let mut setpoint = Setpoint { seq, joints: q.len() as u32, ..Setpoint::default() };
    setpoint.q[..q.len()].copy_from_slice(q);
    setpoint.qd[..q.len()].copy_from_slice(qd);
    setpoint.qdd[..q.len()].copy_from_slice(qdd);
    setpoint
}

/// What a daemon that knows the robot file's values would publish after sample `seq`.
pub(crate) fn published(robot: &Robot, seq: u64) -> Parameters {
    let mut set = Parameters {
        epoch: seq / 100,
        seq,
        model_hash: robot.hash,
        count: robot.base.len() as u32,
        joints: robot.dof() as u32,
        sample_period_s: robot.config.sample_period_s,
        ..Parameters::default()
    };
    set.values[..robot.base.len()].copy_from_slice(&robot.nominal_base);
    set
}

/// Place of the first base parameter with `word` in its name.
pub(crate) fn place(robot: &Robot, word: &str) -> usize {
    let found = (0..robot.base.len()).find(|&i| robot.base.name(&robot.model, i).contains(word));
    found.expect("a base parameter of that name")
}

/// Samples of the moving arm for which it stands in its brakes: the controller's torque builds up.
const BRAKED: u64 = 200;

/// An arm that does exactly what it is told, with the torques that base parameters `x` need for it.
pub(crate) struct Moving<'a> {
    pub(crate) robot: &'a Robot,
    pub(crate) workspace: Workspace,
    pub(crate) x: Vec<f64>,
    pub(crate) seq: u64,
}

impl<'a> Moving<'a> {
    pub(crate) fn new(robot: &'a Robot, x: &[f64]) -> Moving<'a> {
        Moving { robot, workspace: Workspace::new(&robot.model.arm), x: x.to_vec(), seq: 0 }
    }

    /// The next period: sample and setpoint.
    pub(crate) fn next(&mut self) -> (JointState, Setpoint) {
        self.seq += 1;
        let n = self.robot.dof();
        let t = self.seq as f64 * self.robot.config.sample_period_s;
        let (mut q, mut qd, mut qdd) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
        for j in 0..n {
            let (a, w) = (0.4, 3.0 + 0.7 * j as f64);
            (q[j], qd[j], qdd[j]) = (a * (w * t).sin(), a * w * (w * t).cos(), -a * w * w * (w * t).sin());
        }
        let mut sample = state(self.seq, &q);
        sample.faults = if self.seq <= BRAKED { rivet_ipc_schema::faults::STOPPED } else { 0 };
        let (model, base) = (&self.robot.model, &self.robot.base);
        let (mut full, mut rows) = (vec![0.0; n * model.len()], vec![0.0; n * base.len()]);
        model.regressor(&mut self.workspace, &q, &qd, &qdd, &mut full);
        base.select(&full, model.len(), &mut rows);
        for (tau, row) in sample.tau.iter_mut().zip(rows.chunks_exact(base.len())) {
            *tau = row.iter().zip(&self.x).map(|(y, x)| y * x).sum();
        }
        (sample, setpoint(self.seq, &q, &qd, &qdd))
    }

    /// Lets `core` control the arm for some periods; `each` sees every sample before it is answered, and the command.
    pub(crate) fn run(
        &mut self,
        core: &mut Core,
        periods: u64,
        mut each: impl FnMut(&mut Core, &JointState),
    ) -> Vec<Command> {
        let step = |_| {
            let (sample, setpoint) = self.next();
            core.offer_setpoint(&setpoint);
            each(core, &sample);
            let before = core.stop_cause();
            let command = core.tick(&sample).expect("a sound sample");
            let stopped = core.stop_cause().filter(|_| before.is_none());
            assert!(stopped.is_none(), "a sound run is stopped at sample {}: {stopped:?}", sample.seq);
            command
        };
        (0..periods).map(step).collect()
    }
}

/// Largest step between commands, in parts of the largest that the robot file permits.
pub(crate) fn largest_step(robot: &Robot, commands: &[Command]) -> f64 {
    let limits = &robot.config.drive.torque_limit;
    let steps = commands
        .windows(2)
        .flat_map(|two| (0..robot.dof()).map(|j| (two[1].tau[j] - two[0].tau[j]).abs() / (0.01 * limits[j])));
    steps.fold(0.0, f64::max)
}
