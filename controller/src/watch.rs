//! Whether a sample, and what the arm did since the last one, can be trusted.

use crate::gate::Friction;
use crate::law::{ControlLaw, Desired};
use crate::limits::SetpointLimits;
use rivet_config::Robot;
use rivet_dynamics::{JointKind, MAX_JOINTS};
use rivet_estimation::{LARGEST_EFFORT, LARGEST_MOTION};
use rivet_input_checks::{
    DriveCheck, Fault, Found, JointLimits, MotionCheck, MotionLimits, Planned, Reading, ReadingCheck, breakaway,
};
use rivet_ipc_schema::{JointState, StopCause, faults};

/// A joint whose reading was frozen or jumped is suspect for so long \[s\].
const SUSPECT_S: f64 = 0.02;

/// Something that is wrong with a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Wrong {
    pub(crate) cause: StopCause,
    /// Joints, bit 0 the base's; 0 where it concerns none or all.
    pub(crate) joints: u32,
    /// It has lasted already. Else a single sample may be wrong, and only a row of them stops the arm.
    pub(crate) lasting: bool,
}

impl Wrong {
    /// Whether samples that look sound later do not say that it is over: an encoder that froze, jumped or turned round looks sound as long as
    /// its joint stands. `all` joints that freeze at once are the robot controller's, and it has gone on.
    pub(crate) fn stays(&self, all: u32) -> bool {
        match self.cause {
            StopCause::Frozen => self.joints != all,
            StopCause::EncoderJump | StopCause::NoResponse => true,
            _ => false,
        }
    }
}

/// All checks of the samples.
pub(crate) struct Watch {
    dof: usize,
    readings: ReadingCheck,
    motion: MotionCheck,
    drives: DriveCheck,
    friction: Friction,
    tracking_error: [f64; MAX_JOINTS],
    /// Samples for which joints stay suspect, and for how many more each one is.
    suspect_for: u32,
    suspect: [u32; MAX_JOINTS],
}

impl Watch {
    /// `torque` are the limits of the commands \[N·m\], `rates` those of their change \[N·m/s\].
    pub(crate) fn new(
        robot: &Robot,
        law: &ControlLaw,
        limits: &SetpointLimits,
        torque: &[f64],
        rates: &[f64],
    ) -> Watch {
        let (config, arm) = (&robot.config, &robot.model.arm);
        let period_s = config.sample_period_s;
        let joints: Vec<JointLimits> = (0..arm.dof())
            .map(|j| JointLimits {
                resolution: config.drive.encoder_resolution[j],
                torque: torque[j],
                revolute: arm.joints[j].kind == JointKind::Revolute,
                breakaway: breakaway(config.friction.coulomb[j], torque[j]),
            })
            .collect();
        let motion: Vec<MotionLimits> = joints
            .iter()
            .enumerate()
            .map(|(j, joint)| MotionLimits {
                joint: *joint,
                speed: limits.speed(j),
                unmodelled: config.controller.unmodelled_torque[j] * joint.torque,
                jerk: rates[j] / law.nominal_inertia(j),
                inertia: law.nominal_inertia(j),
            })
            .collect();
        let mut tracking_error = [f64::INFINITY; MAX_JOINTS];
        for (most, configured) in tracking_error.iter_mut().zip(&config.controller.tracking_error) {
            *most = *configured;
        }
        Watch {
            dof: arm.dof(),
            readings: ReadingCheck::new(&joints, period_s),
            motion: MotionCheck::new(&motion, period_s),
            drives: DriveCheck::new(&joints, period_s, 1e-3 * config.controller.saturation_ms),
            friction: Friction::of(robot),
            tracking_error,
            suspect_for: (SUSPECT_S / period_s).ceil() as u32,
            suspect: [0; MAX_JOINTS],
        }
    }

    /// Forgets the samples before.
    pub(crate) fn restart(&mut self) {
        self.readings.restart();
        self.restart_motion();
    }

    /// Forgets how the arm answered its torque: it has been braked, or its torque was not that of a plan.
    pub(crate) fn restart_motion(&mut self) {
        self.motion.restart();
        self.drives.restart();
    }

    /// What is wrong with the numbers of a sample themselves.
    pub(crate) fn numbers(&self, sample: &JointState) -> Option<Wrong> {
        let n = self.dof;
        let wrong = |cause, joints| Some(Wrong { cause, joints, lasting: false });
        // An arm that stands in its brakes is answered: the brakes open when there is a command.
        if sample.faults & !faults::STOPPED != 0 {
            return wrong(StopCause::RobotFault, 0);
        }
        if sample.count() != n || sample.joints as usize != n {
            return wrong(StopCause::WrongShape, 0);
        }
        let joints = |bad: &dyn Fn(f64, f64) -> bool| {
            let is_bad = |j: &usize| bad(sample.q[*j], LARGEST_MOTION) || bad(sample.tau[*j], LARGEST_EFFORT);
            (0..n).filter(is_bad).fold(0, |bits, j| bits | 1 << j)
        };
        match (joints(&|x, _| !x.is_finite()), joints(&|x, most| x.abs() > most)) {
            (0, 0) => None,
            (0, wild) => wrong(StopCause::Implausible, wild),
            (bad, _) => wrong(StopCause::NotFinite, bad),
        }
    }

    /// What is wrong with a sample whose numbers are sound: with its readings against those before, the `plan` that is
    /// followed, and the `command` before it.
    ///
    /// Real-time safe.
    pub(crate) fn readings(
        &mut self,
        sample: &JointState,
        command: &[f64; MAX_JOINTS],
        plan: Option<&Desired>,
    ) -> Option<Wrong> {
        let n = self.dof;
        let (q, tau, command) = (&sample.q[..n], &sample.tau[..n], &command[..n]);
        let reading = Reading { seq: sample.seq, q, tau };
        let found = self.readings.check(&reading, plan.map(|plan| &plan.q[..n]));
        // A drive at its limit is no wrong reading: for how long it may be there is configured.
        let found = found.filter(|found| found.fault != Fault::Saturated);
        let planned = plan.map(|plan| Planned { q: &plan.q[..n], qd: &plan.qd[..n] });
        let jumped = found.filter(|found| found.fault == Fault::EncoderJump);
        let moved = if let Some(found) = jumped {
            self.motion.bridge(sample.seq, q, found.joints, command);
            None
        } else {
            self.motion.check(sample.seq, q, command, planned)
        };
        if sample.faults & faults::STOPPED != 0 {
            // Brakes hold it: neither motion nor drives answer a torque.
            self.restart_motion();
            return found.map(wrong_of);
        }
        let given = self.drives.check(tau, command);
        let found = found.or(moved);
        self.suspect(found);
        found.or(given).map(wrong_of)
    }

    /// Whether the joints move as the commanded torque moves an arm with base parameters `x`. Real-time safe.
    pub(crate) fn response(&mut self, law: &mut ControlLaw, x: &[f64]) -> Option<Wrong> {
        let n = self.dof;
        let motion = self.motion.motion()?;
        let mut needed = [0.0; MAX_JOINTS];
        law.model_torque(&motion.q[..n], &motion.qd[..n], &motion.qdd[..n], x, &mut needed[..n]);
        let found = self.motion.answers(&motion, &needed[..n], &self.friction.coulomb(x)[..n]);
        for j in 0..n {
            self.readings.set_breakaway(j, self.motion.breakaway(j));
        }
        found.map(wrong_of)
    }

    /// Remembers on which joints an encoder was wrong.
    fn suspect(&mut self, found: Option<Found>) {
        let is_encoder = |found: &Found| matches!(found.fault, Fault::Frozen | Fault::EncoderJump);
        let joints = found.filter(is_encoder).map_or(0, |found| found.joints);
        for (j, left) in self.suspect.iter_mut().enumerate().take(self.dof) {
            *left = if joints >> j & 1 == 1 { self.suspect_for } else { left.saturating_sub(1) };
        }
    }

    /// Joints, bit 0 the base's, of which it is not known that they are where their encoders say: they do not move as the commanded torque
    /// moves them, or their readings were wrong a moment ago.
    pub(crate) fn suspects(&self) -> u32 {
        let is_suspect = |j: &usize| self.suspect[*j] > 0;
        (0..self.dof).filter(is_suspect).fold(self.motion.unanswered(), |bits, j| bits | 1 << j)
    }

    /// Whether the arm at `q` is further from the positions of its plan than it may be.
    pub(crate) fn tracking(&self, q: &[f64; MAX_JOINTS], planned: &[f64; MAX_JOINTS]) -> Option<Wrong> {
        let away = |j: &usize| (planned[*j] - q[*j]).abs() > self.tracking_error[*j];
        let joints = (0..self.dof).filter(away).fold(0, |bits, j| bits | 1 << j);
        (joints != 0).then_some(Wrong { cause: StopCause::TrackingError, joints, lasting: true })
    }
}

fn wrong_of(found: Found) -> Wrong {
    let cause = match found.fault {
        Fault::Frozen => StopCause::Frozen,
        Fault::EncoderJump => StopCause::EncoderJump,
        Fault::TooFast => StopCause::TooFast,
        Fault::NoResponse => StopCause::NoResponse,
        Fault::SignFlipped => StopCause::SignFlipped,
        Fault::TorqueStuck => StopCause::TorqueStuck,
        Fault::Saturated | Fault::CommandSaturated => StopCause::Saturated,
    };
    Wrong { cause, joints: found.joints, lasting: found.fault != Fault::EncoderJump }
}
