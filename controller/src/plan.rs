//! Whether a plan is one that the arm can follow.

use crate::law::{ControlLaw, Desired};
use crate::limits::SetpointLimits;
use rivet_dynamics::MAX_JOINTS;
use rivet_ipc_schema::StopCause;

/// Positions and speeds beyond this are those of no arm \[rad, rad/s\].
const LARGEST_MOTION: f64 = 1e4;
/// Accelerations beyond this \[rad/s²\].
const LARGEST_ACCELERATION: f64 = 1e6;
/// Torque that a plan may need by the acting model, in parts of the drives' limit: all of it, and a tenth for the error of the model.
const MAX_TORQUE_SHARE: f64 = 1.1;
/// Torque with which feedback may answer a jump of the plan, in parts of the drives' limit.
const JUMP_SHARE: f64 = 0.5;
/// Bounds of the jump that follows from it \[rad\]: rounding of a coarse plan, and what no arm is to be jerked by.
const LEAST_JUMP: f64 = 0.005;
const MOST_JUMP: f64 = 0.05;
/// Jump of the planned velocity that is always permitted, in parts of the speed limit: plans of straight lines have corners.
const CORNER_SHARE: f64 = 0.25;
/// Time over which positions and velocities of a plan are compared \[s\]. Velocities that are late by 10 ms pass.
const AGREEMENT_S: f64 = 0.05;
/// Share of the speed limit above which steps of the planned position are a jump.
const STEP_SHARE: f64 = 1.2;

/// A refused plan: the rule that it breaks, and the joints, bit 0 the base's.
pub(crate) type RefusedPlan = (StopCause, u32);

/// Checks each setpoint against the arm and the setpoint before.
#[derive(Clone, Debug)]
pub(crate) struct PlanCheck {
    dof: usize,
    period_s: f64,
    /// Longest gap between two setpoints of one plan \[periods\].
    longest_gap: u64,
    torque: [f64; MAX_JOINTS],
    speed: [f64; MAX_JOINTS],
    jump: [f64; MAX_JOINTS],
    corner: [f64; MAX_JOINTS],
    /// That of the drives' torque on the nominal inertia \[rad/s²\].
    acceleration: [f64; MAX_JOINTS],
    /// The setpoint accepted last, the step that led to it, a period's, and the way beyond the speed limit that has added up.
    last: Option<(u64, Desired)>,
    step: [f64; MAX_JOINTS],
    excess: [f64; MAX_JOINTS],
    /// Way of the positions less that of the velocities, over the last moment \[rad\].
    apart: [f64; MAX_JOINTS],
    /// Joints whose plan has had velocities, bit 0 the base's, and those whose positions have parted from them: their plan stays refused.
    has_velocity: u32,
    parted: u32,
}

impl PlanCheck {
    /// `torque` are the drives' limits \[N·m\].
    pub(crate) fn new(
        law: &ControlLaw,
        limits: &SetpointLimits,
        torque: &[f64],
        period_s: f64,
        longest_gap: u64,
    ) -> PlanCheck {
        let (mut most, mut speed) = ([0.0; MAX_JOINTS], [f64::INFINITY; MAX_JOINTS]);
        let (mut jump, mut corner) = ([MOST_JUMP; MAX_JOINTS], [f64::INFINITY; MAX_JOINTS]);
        let mut accelerations = [f64::INFINITY; MAX_JOINTS];
        let dof = law.dof();
        for j in 0..dof {
            (most[j], speed[j]) = (torque[j], limits.speed(j));
            let (position, velocity) = law.gains(j);
            accelerations[j] = torque[j] / law.nominal_inertia(j).max(f64::MIN_POSITIVE);
            let acceleration = JUMP_SHARE * accelerations[j];
            jump[j] = (acceleration / position).clamp(LEAST_JUMP, MOST_JUMP);
            corner[j] = (acceleration / velocity).max(CORNER_SHARE * speed[j]);
        }
        PlanCheck {
            dof,
            period_s,
            longest_gap,
            torque: most,
            speed,
            jump,
            corner,
            acceleration: accelerations,
            last: None,
            step: [0.0; MAX_JOINTS],
            excess: [0.0; MAX_JOINTS],
            apart: [0.0; MAX_JOINTS],
            has_velocity: 0,
            parted: 0,
        }
    }

    /// Farthest distance from the plan that feedback alone brings joint `j` back from \[rad\].
    pub(crate) fn jump(&self, j: usize) -> f64 {
        self.jump[j]
    }

    /// Jump of the planned velocity that feedback alone answers \[rad/s\].
    pub(crate) fn corner(&self, j: usize) -> f64 {
        self.corner[j]
    }

    /// Forgets the setpoints before: the next one begins a plan.
    pub(crate) fn restart(&mut self) {
        (self.last, self.has_velocity, self.parted) = (None, 0, 0);
    }

    /// Whether a setpoint's number is too far from that of the one before to be compared with it.
    pub(crate) fn is_apart(&self, seq: u64) -> bool {
        self.last.is_some_and(|(last, _)| seq.saturating_sub(last) > self.longest_gap)
    }

    /// Whether all numbers are those of an arm.
    ///
    /// # Errors
    /// [`StopCause::PlanNotFinite`] or [`StopCause::PlanImplausible`].
    pub(crate) fn check_numbers(&self, desired: &Desired) -> Result<(), RefusedPlan> {
        let parts = [(&desired.q, LARGEST_MOTION), (&desired.qd, LARGEST_MOTION), (&desired.qdd, LARGEST_ACCELERATION)];
        let joints = |bad: &dyn Fn(f64, f64) -> bool| {
            let is_bad = |j: &usize| parts.iter().any(|(values, most)| bad(values[*j], *most));
            (0..self.dof).filter(is_bad).fold(0, |bits, j| bits | 1 << j)
        };
        match (joints(&|x, _| !x.is_finite()), joints(&|x, most| x.abs() > most)) {
            (0, 0) => Ok(()),
            (0, wild) => Err((StopCause::PlanImplausible, wild)),
            (bad, _) => Err((StopCause::PlanNotFinite, bad)),
        }
    }

    /// Whether the arm with base parameters `x` can follow a plan from the setpoint before to this one, which
    /// [`check_numbers`](Self::check_numbers) has passed. Real-time safe.
    ///
    /// # Errors
    /// [`StopCause::PlanJump`] or [`StopCause::PlanAcceleration`].
    pub(crate) fn check(
        &mut self,
        seq: u64,
        desired: &Desired,
        law: &mut ControlLaw,
        x: &[f64],
    ) -> Result<(), RefusedPlan> {
        let n = self.dof;
        let mut tau = [0.0; MAX_JOINTS];
        law.model_torque(&desired.q[..n], &desired.qd[..n], &desired.qdd[..n], x, &mut tau[..n]);
        // Not a number is too much, too.
        let within = |j: &usize| tau[*j].abs() <= MAX_TORQUE_SHARE * self.torque[*j];
        let joints = (0..n).filter(|j| !within(j)).fold(0, |bits, j| bits | 1 << j);
        if joints != 0 {
            return Err((StopCause::PlanAcceleration, joints));
        }
        self.has_velocity = (0..n).filter(|j| desired.qd[*j] != 0.0).fold(self.has_velocity, |bits, j| bits | 1 << j);
        let before = self.last.filter(|(last, _)| seq > *last && seq - *last <= self.longest_gap);
        let (mut step, mut excess, mut apart) = ([0.0; MAX_JOINTS], [0.0; MAX_JOINTS], [0.0; MAX_JOINTS]);
        let mut parted = self.parted;
        if let Some((last, before)) = before {
            let periods = (seq - last) as f64;
            let joints = (0..n)
                .filter(|&j| {
                    let (now, then) = (desired, &before);
                    step[j] = (now.q[j] - then.q[j]) / periods;
                    excess[j] = self.excess_way(j, step[j], periods);
                    apart[j] = self.way_apart(j, now, then, periods);
                    if self.jumps(j, now, then, periods) || excess[j] > self.jump[j] {
                        return true;
                    }
                    let parts = apart[j].abs() > self.jump[j];
                    parted |= if parts { 1 << j } else { 0 };
                    parts
                })
                .fold(self.parted, |bits, j| bits | 1 << j);
            self.parted = parted;
            if joints != 0 {
                return Err((StopCause::PlanJump, joints));
            }
        }
        (self.last, self.step, self.excess) = (Some((seq, *desired)), step, excess);
        self.apart = apart;
        Ok(())
    }

    /// Whether joint `j` jumps from `then` to `now`. Planned velocities lead on, or, where a plan has none, steps do.
    fn jumps(&self, j: usize, now: &Desired, then: &Desired, periods: f64) -> bool {
        let span_s = periods * self.period_s;
        let by_velocity = (now.q[j] - then.q[j] - 0.5 * (now.qd[j] + then.qd[j]) * span_s).abs();
        let by_steps = (now.q[j] - then.q[j] - self.step[j] * periods).abs();
        // Beyond a corner the drives may accelerate with all their torque.
        let corner = self.corner[j] + self.acceleration[j] * span_s;
        by_velocity.min(by_steps) > self.jump[j] || (now.qd[j] - then.qd[j]).abs() > corner
    }

    /// Way of joint `j` by positions less that by velocities \[rad\], forgotten with [`AGREEMENT_S`]; 0 for a plan that has
    /// had no velocities.
    fn way_apart(&self, j: usize, now: &Desired, then: &Desired, periods: f64) -> f64 {
        if self.has_velocity >> j & 1 == 0 {
            return 0.0;
        }
        let span_s = periods * self.period_s;
        let way = now.q[j] - then.q[j] - 0.5 * (now.qd[j] + then.qd[j]) * span_s;
        (self.apart[j] + way) * (-span_s / AGREEMENT_S).exp()
    }

    /// Way beyond the speed limit that small jumps of joint `j` have added up to \[rad\].
    fn excess_way(&self, j: usize, step: f64, periods: f64) -> f64 {
        let most = STEP_SHARE * self.speed[j] * self.period_s;
        if most.is_finite() { (self.excess[j] + (step.abs() - most) * periods).max(0.0) } else { 0.0 }
    }
}
