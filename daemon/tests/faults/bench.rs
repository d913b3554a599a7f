//! A moving arm, what can go wrong with its samples, and the estimate with and without.

use rivet_config::Robot;
use rivet_daemon::Core;
use rivet_dynamics::Workspace;
use rivet_ipc_schema::{Health, JointState, Parameters, Setpoint};
use std::path::Path;

/// Numbers of a seed (xorshift*), and normal ones.
pub(crate) struct Random(u64);

impl Random {
    pub(crate) fn new(seed: u64) -> Random {
        Random(seed | 1)
    }

    pub(crate) fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_f491_4f6c_dd1d)
    }

    /// 0..1
    pub(crate) fn share(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Whole, low..high.
    pub(crate) fn within(&mut self, low: u64, high: u64) -> u64 {
        low + self.next() % (high - low)
    }

    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.share()).sum::<f64>() - 6.0
    }
}

/// The two-link arm on sums of two sines a joint, with encoder steps, encoder noise and torque noise; its parameters are
/// not those of the robot file.
pub(crate) struct Arm {
    pub(crate) robot: Robot,
    workspace: Workspace,
    rows: Vec<f64>,
    truth: Vec<f64>,
    random: Random,
}

impl Arm {
    pub(crate) fn new(seed: u64) -> Arm {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../robots/dd2/robot.toml");
        let robot = rivet_config::load(file).expect("the robot file is sound");
        let truth = robot.nominal.iter().enumerate().map(|(i, x)| x * (1.0 + 0.1 * (i as f64).sin())).collect();
        let workspace = Workspace::new(&robot.model.arm);
        let rows = vec![0.0; 2 * robot.model.len()];
        Arm { robot, workspace, rows, truth, random: Random::new(seed) }
    }

    /// What is measured at period `k`, without a fault.
    pub(crate) fn at(&mut self, k: u64) -> (JointState, Setpoint) {
        let t = k as f64 * 0.001;
        let wave = |parts: [(f64, f64); 2]| {
            let mut sum = [0.0; 3];
            for (a, f) in parts {
                let w = std::f64::consts::TAU * f;
                sum[0] += a * (w * t).sin();
                sum[1] += a * w * (w * t).cos();
                sum[2] -= a * w * w * (w * t).sin();
            }
            sum
        };
        let (one, two) = (wave([(0.4, 0.31), (0.3, 0.83)]), wave([(0.5, 0.47), (0.4, 1.13)]));
        let motion = |d: usize| [one[d], two[d]];
        let n = self.robot.model.len();
        self.robot.model.regressor(&mut self.workspace, &motion(0), &motion(1), &motion(2), &mut self.rows);
        let mut state = JointState { seq: k, stamp_ns: 1 + k * 1_000_000, joints: 2, ..JointState::default() };
        let mut setpoint = Setpoint { seq: k, stamp_ns: state.stamp_ns, joints: 2, ..Setpoint::default() };
        for j in 0..2 {
            let step = self.robot.config.drive.encoder_resolution[j];
            state.q[j] = ((motion(0)[j] + 1e-6 * self.random.normal()) / step).round() * step;
            let tau: f64 = self.rows[j * n..(j + 1) * n].iter().zip(&self.truth).map(|(y, x)| y * x).sum();
            state.tau[j] = tau + [0.1, 0.02][j] * self.random.normal();
            (setpoint.q[j], setpoint.qd[j], setpoint.qdd[j]) = (motion(0)[j], motion(1)[j], motion(2)[j]);
        }
        (state, setpoint)
    }
}

/// What can be wrong with the samples for a while.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Fault {
    Dropped,
    Duplicated,
    Reordered,
    Frozen,
    FrozenJoint,
    NotFinite,
    Saturated,
    SignFlipped,
    TimeJump,
    EncoderJump,
    TorqueStuck,
    PublisherRestarted,
    Flagged,
}

pub(crate) const ALL: [Fault; 13] = [
    Fault::Dropped,
    Fault::Duplicated,
    Fault::Reordered,
    Fault::Frozen,
    Fault::FrozenJoint,
    Fault::NotFinite,
    Fault::Saturated,
    Fault::SignFlipped,
    Fault::TimeJump,
    Fault::EncoderJump,
    Fault::TorqueStuck,
    Fault::PublisherRestarted,
    Fault::Flagged,
];

/// Spoils a stream of samples.
pub(crate) struct Spoiler {
    limits: Vec<f64>,
    before: Option<(JointState, Setpoint)>,
    kept: Option<(JointState, Setpoint)>,
    /// What sequence numbers and stamps are behind by.
    pub(crate) seq_behind: u64,
    stamp_ahead: u64,
    active: bool,
    pub(crate) jump: f64,
    pub(crate) joint: usize,
}

impl Spoiler {
    pub(crate) fn new(robot: &Robot) -> Spoiler {
        Spoiler {
            limits: robot.config.drive.torque_limit.clone(),
            before: None,
            kept: None,
            seq_behind: 0,
            stamp_ahead: 0,
            active: false,
            jump: 0.02,
            joint: 1,
        }
    }

    /// Chooses what differs between two occurrences of the same fault.
    pub(crate) fn vary(&mut self, random: &mut Random) {
        self.joint = random.within(0, 2) as usize;
        self.jump = (0.005 + 0.5 * random.share()) * if random.share() < 0.5 { -1.0 } else { 1.0 };
    }

    /// What comes of a sample: none, itself, or more.
    pub(crate) fn pass(
        &mut self,
        fault: Option<Fault>,
        state: JointState,
        setpoint: Setpoint,
    ) -> Vec<(JointState, Setpoint)> {
        let (mut state, mut setpoint) = (state, setpoint);
        let begins = fault.is_some() && !self.active;
        self.active = fault.is_some();
        if begins && fault == Some(Fault::PublisherRestarted) {
            self.seq_behind = state.seq - 1;
        }
        if begins && fault == Some(Fault::TimeJump) {
            self.stamp_ahead += 500_000_000;
        }
        state.seq -= self.seq_behind;
        setpoint.seq = state.seq;
        state.stamp_ns += self.stamp_ahead;
        let before = self.before.unwrap_or((state, setpoint));
        if fault.is_none() {
            self.before = Some((state, setpoint));
            return self.kept.take().into_iter().chain([(state, setpoint)]).collect();
        }
        let (j, jump) = (self.joint, self.jump);
        match fault {
            Some(Fault::Dropped) => return Vec::new(),
            Some(Fault::Duplicated) => return vec![(state, setpoint); 2],
            Some(Fault::Reordered) => {
                // Pairs the wrong way round.
                if let Some(late) = self.kept.take() {
                    return vec![(state, setpoint), late];
                }
                self.kept = Some((state, setpoint));
                return Vec::new();
            }
            Some(Fault::Frozen) => (state.q, state.tau) = (before.0.q, before.0.tau),
            Some(Fault::FrozenJoint) => state.q[j] = before.0.q[j],
            Some(Fault::NotFinite) => state.q[j] = f64::NAN,
            Some(Fault::Saturated) => state.tau[j] = self.limits[j].copysign(state.tau[j]),
            Some(Fault::SignFlipped) => state.tau = state.tau.map(|tau| -tau),
            Some(Fault::EncoderJump) => state.q[j] += jump,
            Some(Fault::TorqueStuck) => state.tau[j] = before.0.tau[j],
            Some(Fault::Flagged) => state.faults = 1,
            Some(Fault::TimeJump | Fault::PublisherRestarted) | None => {}
        }
        vec![(state, setpoint)]
    }
}

pub(crate) fn parameters(core: &Core) -> Parameters {
    let mut parameters = Parameters::default();
    core.write_parameters(&mut parameters);
    parameters
}

pub(crate) fn health(core: &Core) -> Health {
    let mut health = Health::default();
    core.write_health(&mut health);
    health
}

/// Largest difference of a parameter in its own stated standard deviations, of the disturbed estimate.
pub(crate) fn sigmas(disturbed: &Parameters, undisturbed: &Parameters) -> f64 {
    (0..disturbed.len())
        .map(|i| (disturbed.values[i] - undisturbed.values[i]).abs() / disturbed.std[i].max(f64::MIN_POSITIVE))
        .fold(0.0, f64::max)
}
