//! Checks of each reading against the one before, without a model.

use crate::{Fault, Found, JointLimits, LONGEST_REPEAT_S, Reading};
use rivet_dynamics::MAX_JOINTS;
use std::f64::consts::TAU;

/// No drive accelerates a joint faster than this, even in a collision \[rad/s²\].
const LARGEST_ACCELERATION: f64 = 500.0;
/// Nor by more than this many times what second differences usually are: encoders of any noise.
const LARGEST_CHANGE: f64 = 12.0;
/// Memory of what is usual \[samples\].
const USUAL: f64 = 500.0;
/// Memory of a joint's speed \[samples\].
const SPEED: f64 = 8.0;
/// Fewest identical readings, while moving, that are a reading which is frozen. Logs of a slower source repeat each sample a few times.
const FROZEN_RUN: u32 = 4;
/// Speed above which one joint alone does not stop from one sample to the next \[rad/s\].
const FAST: f64 = 0.2;
/// Last step over the smoothed one, below which a joint brakes.
const STEADY_SHARE: f64 = 0.5;
/// Speed above which a joint moves \[rad/s\].
const SLOW: f64 = 0.04;
/// A position that has not changed for this long, with no setpoint that moves, is of an arm that stands \[s\].
const STANDING_S: f64 = 1.0;
/// A setpoint that has moved by this much since the readings froze is of an arm that does not stand, if the torque has changed by more than
/// friction holds \[rad\].
const SETPOINT_MOVED: f64 = 0.02;
/// A position that has jumped and stays so for this long is that of an encoder that was referenced anew \[s\].
const REFERENCED_S: f64 = 10.0;
/// Samples at the torque limit that are more than a peak.
const SATURATED_RUN: u32 = 3;
/// Share of the torque limit from which on a torque is at it.
pub(crate) const AT_LIMIT: f64 = 0.999;
/// Across more lost samples than this nothing is said about jumps.
const MOST_LOST: u64 = 10;
/// A stamp off by more than this many periods jumps.
const STAMP_PERIODS: f64 = 20.0;

/// What of one joint is remembered.
#[derive(Clone, Copy, Debug, Default)]
struct Joint {
    /// How many samples there are to reckon with: 0, 1 or 2.
    known: u8,
    q: f64,
    /// Change of the position in the last period.
    step: f64,
    /// The same, smoothed.
    speed: f64,
    /// Mean square of second differences.
    usual: f64,
    /// Identical positions in a row, the speed before them, and what setpoint and torque were.
    same: u32,
    speed_before: f64,
    setpoint_before: f64,
    torque_before: f64,
    frozen: bool,
    /// Where the position would be had it not jumped is `q - offset`.
    offset: f64,
    offset_age: u32,
    /// A jump of the sample before, not yet told from a change of speed: the step that led to it, and the one expected.
    pending: Option<(f64, f64)>,
    tau: f64,
    /// Identical torques in a row.
    tau_same: u32,
    /// Torques at the limit in a row.
    at_limit: u32,
}

/// Limits of one joint, with what follows from the sample period.
#[derive(Clone, Copy, Debug, Default)]
struct Limits {
    /// Largest second difference that is none of an encoder's \[rad\].
    jump: f64,
    joint: JointLimits,
}

/// Finds readings that cannot be true: frozen or jumping encoders, torque at the drive's limit. Nothing allocates.
#[derive(Clone, Debug)]
pub struct ReadingCheck {
    dof: usize,
    period_s: f64,
    /// Identical readings that are too many for a joint in motion.
    frozen_run: u32,
    /// Of the last sample checked.
    seq: u64,
    limits: [Limits; MAX_JOINTS],
    joints: [Joint; MAX_JOINTS],
}

impl ReadingCheck {
    /// Starts without a past. `joints` has one entry a joint, at most `MAX_JOINTS`; further ones are left out.
    pub fn new(joints: &[JointLimits], period_s: f64) -> ReadingCheck {
        let mut limits = [Limits::default(); MAX_JOINTS];
        for (limits, joint) in limits.iter_mut().zip(joints) {
            *limits = Limits { jump: LARGEST_ACCELERATION * period_s.powi(2), joint: *joint };
        }
        let dof = joints.len().min(MAX_JOINTS);
        let frozen_run = ((LONGEST_REPEAT_S / period_s).ceil() as u32).max(FROZEN_RUN);
        ReadingCheck { dof, period_s, frozen_run, seq: 0, limits, joints: [Joint::default(); MAX_JOINTS] }
    }

    /// Takes over the limits of `other`, made for the same arm, from the next sample on.
    pub fn adopt_limits(&mut self, other: &ReadingCheck) {
        self.limits = other.limits;
    }

    /// Sets [`JointLimits::breakaway`] of joint `j`, where more is known of its friction than the robot file has.
    ///
    /// Real-time safe.
    pub fn set_breakaway(&mut self, j: usize, torque: f64) {
        self.limits[j].joint.breakaway = torque;
    }

    /// Forgets the past of every joint but its noise.
    pub fn restart(&mut self) {
        for joint in &mut self.joints {
            *joint = Joint { usual: joint.usual, ..Joint::default() };
        }
    }

    /// Whether the stamps \[ns\] advance as the sequence numbers do, after `lost` missing samples.
    pub fn stamps_fit(&self, lost: u64, before_ns: u64, now_ns: u64) -> bool {
        if before_ns == 0 || now_ns == 0 {
            return true;
        }
        let due = (lost as f64 + 1.0) * self.period_s * 1e9;
        (now_ns as f64 - before_ns as f64 - due).abs() <= STAMP_PERIODS * self.period_s * 1e9
    }

    /// Identical torques in a row of joint `j`, and whether it moves.
    pub fn torque_run(&self, j: usize) -> (u32, bool) {
        let joint = &self.joints[j];
        (joint.tau_same, joint.speed.abs() > SLOW * self.period_s)
    }

    /// Largest torque of joint `j` \[N·m\].
    pub fn torque_limit(&self, j: usize) -> f64 {
        self.limits[j].joint.torque
    }

    /// Checks a sample of finite numbers that is newer than the last one. `setpoint` holds the planned positions of the same
    /// period, where there are some. `None` where nothing is wrong.
    ///
    /// Real-time safe.
    pub fn check(&mut self, sample: &Reading<'_>, setpoint: Option<&[f64]>) -> Option<Found> {
        let since = sample.seq.saturating_sub(self.seq);
        self.seq = sample.seq;
        if since > MOST_LOST + 1 {
            self.restart();
        }
        let periods = since.max(1) as f64;
        let (mut jumped, mut frozen, mut saturated, mut moved) = (0, 0, 0, false);
        let (mut identical, mut least_run) = (true, u32::MAX);
        for j in 0..self.dof {
            let (joint, limits, bit) = (&mut self.joints[j], &self.limits[j], 1 << j);
            let (q, tau) = (sample.q[j], sample.tau[j]);
            let tau_same = since == 1 && joint.known > 0 && tau == joint.tau;
            let torque_before = joint.tau;
            joint.tau_same = if tau_same { joint.tau_same + 1 } else { 0 };
            joint.tau = tau;
            joint.at_limit = if tau.abs() >= AT_LIMIT * limits.joint.torque { joint.at_limit + 1 } else { 0 };
            saturated |= if joint.at_limit >= SATURATED_RUN { bit } else { 0 };
            let still = since == 1 && joint.known > 0 && q == joint.q;
            identical &= still && tau_same;
            let desired = setpoint.map_or(f64::NAN, |q| q[j]);
            if still && joint.same == 0 {
                joint.torque_before = torque_before;
            }
            let thawed = joint.run(still, desired, q, self.frozen_run);
            least_run = least_run.min(joint.same);
            moved |=
                joint.same > 0 && joint.speed_before.abs() > (SLOW * self.period_s).max(4.0 * limits.joint.resolution);
            let stood = f64::from(joint.same) * self.period_s >= STANDING_S
                && (desired - joint.setpoint_before).abs().min(1.0) <= SETPOINT_MOVED;
            if joint.position(q, periods, limits, self.period_s) {
                // A position that stays where it is does not jump; one that has stayed may have been elsewhere.
                if still {
                    joint.frozen = true;
                } else if thawed {
                    joint.begin(q);
                    frozen |= bit;
                } else {
                    jumped |= bit;
                }
            }
            let fast = joint.speed_before.abs() > (FAST * self.period_s).max(8.0 * limits.joint.resolution);
            let is_pushed = (tau - joint.torque_before).abs() >= limits.joint.breakaway;
            let has_left = is_pushed && (desired - joint.setpoint_before).abs() > SETPOINT_MOVED;
            joint.frozen |= joint.same >= self.frozen_run && (fast || has_left);
            joint.frozen &= joint.same > 0 && !stood;
            frozen |= if joint.frozen { bit } else { 0 };
        }
        if identical && moved && least_run >= self.frozen_run && !self.stands(setpoint) {
            frozen = (1 << self.dof) - 1;
        }
        let found = |fault, joints| (joints != 0).then_some(Found { fault, joints });
        found(Fault::Frozen, frozen)
            .or_else(|| found(Fault::EncoderJump, jumped))
            .or_else(|| found(Fault::Saturated, saturated))
    }

    /// Whether all joints have been still for long, with no setpoint that moves.
    fn stands(&self, setpoint: Option<&[f64]>) -> bool {
        self.joints[..self.dof].iter().enumerate().all(|(j, joint)| {
            let moved = setpoint.map_or(0.0, |q| (q[j] - joint.setpoint_before).abs().min(1.0));
            f64::from(joint.same) * self.period_s >= STANDING_S && moved <= SETPOINT_MOVED
        })
    }
}

impl Joint {
    /// Knows nothing of the arm but this position.
    fn begin(&mut self, q: f64) {
        *self = Joint { known: 1, q, usual: self.usual, tau: self.tau, tau_same: self.tau_same, ..Joint::default() };
    }

    /// Counts identical positions. Whether a run of them has ended in which the arm may have moved: the setpoint, if there is
    /// one, has gone about as far.
    fn run(&mut self, still: bool, desired: f64, q: f64, frozen_run: u32) -> bool {
        if still {
            if self.same == 0 {
                self.speed_before = self.steady_speed();
                self.setpoint_before = desired;
            }
            self.same = self.same.saturating_add(1);
            false
        } else {
            let (gone, planned) = (q - self.q, desired - self.setpoint_before);
            let elsewhere = planned.is_finite() && (gone - planned).abs() > 0.5 * gone.abs();
            let thawed = self.same >= frozen_run && !elsewhere;

            if self.frozen {
                // Where it has been meanwhile is not known: the first sample after it says nothing about jumps.
                *self = Joint { usual: self.usual, tau: self.tau, tau_same: self.tau_same, ..Joint::default() };
            }
            self.same = 0;
            thawed
        }
    }

    /// Speed with which the joint would have gone on \[rad a period\]: smoothed, or the last step where that is much slower. A joint that
    /// brakes and sticks at its turning point is slower in its last step than over the samples before it.
    fn steady_speed(&self) -> f64 {
        if self.step.abs() < STEADY_SHARE * self.speed.abs() { self.step } else { self.speed }
    }

    /// Takes in a position; whether it has jumped, now or before.
    fn position(&mut self, q: f64, periods: f64, limits: &Limits, period_s: f64) -> bool {
        let taken = |joint: &mut Joint, step: f64| {
            joint.q = q;
            joint.step = step;
            joint.speed += (step - joint.speed) / SPEED;
        };
        if self.known < 2 {
            let step = if self.known == 0 { 0.0 } else { (q - self.q) / periods };
            self.known += 1;
            if self.known == 2 {
                self.speed = step;
            }
            taken(self, step);
            return self.latched(limits, period_s, 0.0);
        }
        let off = q - self.q - self.step * periods;
        let limit =
            limits.jump.max(LARGEST_CHANGE * self.usual.sqrt()).max(4.0 * limits.joint.resolution) * periods * periods;
        self.usual += ((off * off).min(limit * limit) - self.usual) / USUAL;
        if let Some((led, expected)) = self.pending.take() {
            // Had the position jumped, the arm goes on as before; had its speed changed, it goes on with the new one.
            let (as_jump, as_speed) = ((q - self.q) / periods - expected, (q - self.q) / periods - led);
            if as_speed.abs() < as_jump.abs() {
                self.offset = 0.0;
            }
        }
        if off.abs() <= limit {
            taken(self, (q - self.q) / periods);
            return self.latched(limits, period_s, limit);
        }
        self.pending = Some(((q - self.q) / periods, self.step));
        self.offset += off;
        self.q = q;
        if limits.joint.revolute {
            // A whole turn is the same place.
            let rest = self.offset - TAU * (self.offset / TAU).round();
            if rest.abs() <= limit {
                self.offset = rest;
            }
        }
        if self.offset.abs() <= 2.0 * limit {
            self.offset = 0.0;
            self.offset_age = 0;
            self.pending = None;
        }
        true
    }

    /// Whether a jump is in force.
    fn latched(&mut self, limits: &Limits, period_s: f64, limit: f64) -> bool {
        if self.offset.abs() <= limit.max(limits.jump) {
            self.offset = 0.0;
            self.offset_age = 0;
            return false;
        }
        self.offset_age = self.offset_age.saturating_add(1);
        if f64::from(self.offset_age) * period_s >= REFERENCED_S {
            self.offset = 0.0;
            self.offset_age = 0;
        }
        self.offset != 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ONE: JointLimits = JointLimits { resolution: 1e-5, torque: 10.0, revolute: true, breakaway: 1.0 };

    /// A joint that brakes into its turning point and sticks there for 30 ms, while its plan turns round: no encoder that is frozen.
    #[test]
    fn a_joint_that_brakes_and_sticks_is_sound() {
        for period_s in [0.004, 0.002, 0.001] {
            for deceleration in [2.0, 9.0, 20.0] {
                let mut check = ReadingCheck::new(&[ONE], period_s);
                for seq in 1..=2000 {
                    // At rest at 0.5 s.
                    let t = seq as f64 * period_s - 0.5;
                    let along = |t: f64| -0.5 * deceleration * t * t;
                    let q = if t < 0.0 { along(t) } else { along((t - 0.03).max(0.0)) };
                    let tau = [0.1 * (7.0 * t).sin()];
                    let found = check.check(&Reading { seq, q: &[q], tau: &tau }, Some(&[along(t)]));
                    assert_eq!(found, None, "{period_s} s, {deceleration} rad/s²: {t} s");
                    if t > 0.3 {
                        break;
                    }
                }
            }
        }
    }

    /// A joint that is held by friction while its plan goes on by 0.1 rad: frozen only if the torque has changed by more than friction holds.
    #[test]
    fn a_joint_that_sticks_is_sound_and_one_that_is_pushed_is_frozen() {
        for period_s in [0.004, 0.001] {
            for (push, expected) in [(0.9, None), (3.0, Some(Found { fault: Fault::Frozen, joints: 1 }))] {
                let mut check = ReadingCheck::new(&[ONE], period_s);
                let found = (1..=(0.5 / period_s) as u64).find_map(|seq| {
                    let t = seq as f64 * period_s - 0.3;
                    let along = |t: f64| -t * t;
                    let plan = along(t) + 0.5 * t.max(0.0);
                    let tau = push * (5.0 * t).clamp(0.0, 1.0) + 1e-3 * (700.0 * t).sin();
                    check.check(&Reading { seq, q: &[along(t.min(0.0))], tau: &[tau] }, Some(&[plan]))
                });
                assert_eq!(found, expected, "{period_s} s, {push} N m");
            }
        }
    }

    /// One that freezes in motion, while it brakes as well.
    #[test]
    fn a_reading_that_freezes_in_motion_is_found() {
        for period_s in [0.004, 0.001] {
            for deceleration in [0.0, 2.0] {
                let mut check = ReadingCheck::new(&[ONE], period_s);
                let found = (1..=500).find_map(|seq| {
                    let t = (seq as f64 * period_s).min(0.3);
                    let q = t - 0.5 * deceleration * t * t;
                    check.check(&Reading { seq, q: &[q], tau: &[(0.1 * seq as f64).sin()] }, None).map(|f| (seq, f))
                });
                let (seq, found) = found.expect("it is found");
                assert_eq!(found, Found { fault: Fault::Frozen, joints: 1 });
                assert!(seq as f64 * period_s <= 0.3 + 0.0201, "{seq}");
            }
        }
    }
}
