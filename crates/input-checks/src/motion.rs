//! Checks of the motion against its limits, its plan and the torque that was commanded for it.

use crate::window::{MeanMotion, Window};
use crate::{Fault, Found, JointLimits, LONGEST_REPEAT_S, breakaway};
use rivet_dynamics::MAX_JOINTS;

/// Share of a joint's speed limit above which its speed is a fault: plans end at the limit, and following one may overshoot.
const SPEED_SHARE: f64 = 1.1;
/// The same for the speed that a joint reaches before its drive has taken its acceleration back: the bound of a stop is 1.2, and the
/// rest is for the time until this shows.
const PEAK_SHARE: f64 = 1.15;
/// So many samples in a row: a single wrong reading shows once as the newest, once in the middle and once at the end of the window.
const LATE_SAMPLES: u32 = 2;
/// Noise of a difference of two readings, in encoder steps.
const NOISE_STEPS: f64 = 4.0;
/// Fewest identical readings that are a reading which is frozen.
const FROZEN_RUN: u32 = 3;
/// Encoder steps by which one that is frozen may flicker.
const FLICKER_STEPS: f64 = 1.5;
/// A joint that friction holds yields by more than this before it slides \[rad\]. Encoders of finer steps show it; of those of coarser
/// steps only readings that are equal are still. Noise of more than this hides whether it yields.
const LEAST_YIELD: f64 = 3e-5;
/// Readings within the way that a joint made before in so many seconds are identical: a sound joint does not stop on so short a way while
/// its plan goes on. Less than [`NOISE_STEPS`] say nothing.
const ABRUPT_S: f64 = LONGEST_REPEAT_S / 24.0;
/// That way is compared where samples are further apart than this \[s\], between 1 kHz and 500 Hz: in a shorter period a sound joint may
/// come to rest on it.
const SLOW_LOOP_S: f64 = 0.0015;
/// Deviations from their mean within which readings with noise are still, in standard deviations of the noise.
const STILL_SIGMAS: f64 = 5.0;
/// Largest part of that noise that the steps of an encoder make, in steps: 0.29 in fast motion, 0.32 where steps come now and then.
const STEP_SIGMAS: f64 = 0.5;
/// Memory of that noise \[samples\].
const NOISE_SAMPLES: f64 = 8.0;
/// Variance of the third difference of white noise, in parts of that of the noise: 1 + 9 + 9 + 1.
const THIRD_DIFFERENCE: f64 = 20.0;
/// The same of the second difference: 1 + 4 + 1.
const SECOND_DIFFERENCE: f64 = 6.0;
/// Way of the plan from which on a joint that is still is behind it, in parts of the deviations that count as still.
const BEHIND_TIMES: f64 = 2.0;
/// Steps that a joint would have moved by in one sample, in parts of [`NOISE_STEPS`], from which on readings within those are identical: a
/// sound joint does not stop so abruptly.
const ABRUPT_TIMES: f64 = 8.0;
/// Speed above which a joint does not stand from one sample to the next while its plan goes on, if friction does not stop it \[rad/s\].
const ABRUPT: f64 = 0.05;
/// Encoder steps that it moved by before, at least: a coarse encoder repeats readings in slow motion.
const MOVED_STEPS: f64 = 8.0;
/// Bound of what friction and earlier errors of the model add to [`MotionLimits::unmodelled`], in parts of the torque limit.
const MAX_ERROR_SHARE: f64 = 0.5;
/// Share of [`MotionLimits::unmodelled`] that a load or a contact may add within [`MODEL_ERROR_S`]. With 1 an encoder that counts
/// backwards is found after up to 28 ms, and 20 ms are permitted; with this share none of 100 drawn grasps of a rated load is stopped.
const SUDDEN_SHARE: f64 = 5.0 / 6.0;
/// What the model misses for longer than this is an error of the model \[s\]: impacts show at once, whatever the model misses.
const MODEL_ERROR_S: f64 = 0.1;
/// The same for what builds up slowly, as the torque of an encoder does that shows a part of the motion.
const SLOW_ERROR_S: f64 = 1.0;
/// Times by which that may exceed its usual magnitude, and the memory of the magnitude \[s\]: arms with loads, friction and rotors that
/// their files do not have (`docs/realtime.md` has figures of drawn ones).
const USUAL_TIMES: f64 = 3.0;
const USUAL_S: f64 = 5.0;
/// Samples in a row that do not answer the torque.
const RESPONSE_RUN: u32 = 2;
/// Across more lost samples than this nothing is said about motion: arms move on evenly across fewer.
const MOST_LOST: u64 = 10;

/// Limits of one joint's motion.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MotionLimits {
    /// What the robot file says of the joint.
    pub joint: JointLimits,
    /// Speed limit \[rad/s\]; infinite where there is none.
    pub speed: f64,
    /// Torque that a load or a contact may put on the joint which the model does not have \[N·m\].
    pub unmodelled: f64,
    /// Fastest change of the acceleration that the drive gives the joint \[rad/s³\]; 0 where that is not known.
    pub jerk: f64,
    /// Inertia that a reading's noise is multiplied by where its second difference is taken for a torque \[kg·m²\].
    pub inertia: f64,
}

/// The plan of one period: positions \[rad\] and velocities \[rad/s\].
#[derive(Clone, Copy, Debug)]
pub struct Planned<'a> {
    /// One entry a joint.
    pub q: &'a [f64],
    /// One entry a joint.
    pub qd: &'a [f64],
}

#[derive(Clone, Copy, Debug, Default)]
struct Joint {
    q: f64,
    /// Change in the last period.
    step: f64,
    /// Identical readings in a row: all within `band` of the first of them, which is `anchor` \[rad\].
    same: u32,
    anchor: f64,
    band: f64,
    /// Readings in a row that differ by flicker and noise alone from their mean, which is `still_at` \[rad\].
    still: u32,
    still_at: f64,
    /// The last three readings, the newest first \[rad\], how many there are, and the variance of their noise \[rad²\].
    past: [f64; 3],
    known: u32,
    noise: f64,
    /// The run began at speed while the plan went on.
    abrupt: bool,
    /// Where the plan was when the run of still readings began.
    plan_before: f64,
    /// The way of the plan from the reading, once it has gone on since the run began \[rad\].
    ahead: f64,
    /// Samples in a row after which the drive lets go too late.
    late: u32,
    /// What the model misses while readings are still, smoothed over the window \[N·m\].
    still_missed: f64,
    /// What the model misses \[N·m\], slowly varying, and the same when the run began.
    model_error: f64,
    error_before: f64,
    /// The same over [`SLOW_ERROR_S`], and the mean magnitude of what goes beyond it \[N·m\].
    slow_error: f64,
    usual: f64,
    /// Torque beyond what it was in motion that friction may hold at rest \[N·m\]; 0 until it has been compared.
    breakaway: f64,
    /// Samples in a row that did not answer the torque, compared with what the model has missed in a moment, and for longer.
    unanswered: u32,
    slowly_unanswered: u32,
}

/// Finds motion that the plan, the limits or the commanded torque do not explain. Nothing allocates.
#[derive(Clone, Debug)]
pub struct MotionCheck {
    dof: usize,
    period_s: f64,
    /// Identical readings that are too many for a joint in motion.
    frozen_run: u32,
    limits: [MotionLimits; MAX_JOINTS],
    joints: [Joint; MAX_JOINTS],
    window: Window,
    seq: Option<u64>,
    /// Samples in a row that repeat the readings of all joints.
    repeats: u32,
    /// Whether [`Joint::model_error`] is known.
    compared: bool,
}

impl MotionCheck {
    /// Starts without a past. `limits` has one entry a joint, at most `MAX_JOINTS`; further ones are left out.
    pub fn new(limits: &[MotionLimits], period_s: f64) -> MotionCheck {
        let mut all = [MotionLimits::default(); MAX_JOINTS];
        for (all, limits) in all.iter_mut().zip(limits) {
            *all = *limits;
        }
        MotionCheck {
            dof: limits.len().min(MAX_JOINTS),
            period_s,
            frozen_run: ((LONGEST_REPEAT_S / period_s).ceil() as u32).max(FROZEN_RUN),
            limits: all,
            joints: [Joint::default(); MAX_JOINTS],
            window: Window::new(period_s),
            seq: None,
            repeats: 0,
            compared: false,
        }
    }

    /// Forgets the past, but not what the model misses.
    pub fn restart(&mut self) {
        self.window.restart();
        for joint in &mut self.joints {
            *joint = Joint {
                model_error: joint.model_error,
                slow_error: joint.slow_error,
                usual: joint.usual,
                ..Joint::default()
            };
        }
        (self.seq, self.repeats) = (None, 0);
    }

    /// Takes in, instead of a sample whose `jumped` joints (bit 0 the base's) were where no joint can be, where they would have come to. What
    /// they do next shows whether a single reading was wrong.
    ///
    /// Real-time safe.
    pub fn bridge(&mut self, seq: u64, q: &[f64], jumped: u32, command: &[f64]) {
        if self.seq.is_none_or(|last| last.checked_add(1) != Some(seq)) {
            self.restart();
            return;
        }
        self.seq = Some(seq);
        let mut expected = [0.0; MAX_JOINTS];
        for (j, joint) in self.joints.iter_mut().enumerate().take(self.dof) {
            expected[j] = if jumped >> j & 1 == 1 { joint.q + joint.step } else { q[j] };
            joint.step = expected[j] - joint.q;
            (joint.q, joint.same, joint.still_at, joint.still) = (expected[j], 0, expected[j], 0);
        }
        self.window.push(&expected[..self.dof], command);
    }

    /// Takes in the `lost` samples between the last one and `q`: what a robot controller loses now and then must not end the checks.
    fn bridge_gap(&mut self, lost: u64, q: &[f64], command: &[f64]) {
        for k in 1..=lost {
            let part = k as f64 / (lost + 1) as f64;
            let mut between = [0.0; MAX_JOINTS];
            for ((between, joint), q) in between.iter_mut().zip(&self.joints).zip(q) {
                *between = joint.q + part * (q - joint.q);
            }
            self.window.push(&between[..q.len()], command);
        }
    }

    /// Takes in a sample of finite positions, the `command` before it and the plan of its period, if one is followed.
    /// `None` where nothing is wrong with speed and readings. Across a short gap in the numbers the arm moved evenly; a long one begins anew.
    ///
    /// Real-time safe.
    pub fn check(&mut self, seq: u64, q: &[f64], command: &[f64], planned: Option<Planned<'_>>) -> Option<Found> {
        let lost = self.seq.map_or(0, |last| seq.saturating_sub(last).saturating_sub(1));
        if lost > MOST_LOST || self.seq.is_some_and(|last| seq <= last) {
            self.restart();
        } else {
            self.bridge_gap(lost, q, command);
        }
        let first = self.seq.replace(seq).is_none();
        let repeats = !first && self.joints[..self.dof].iter().zip(q).all(|(joint, q)| joint.q == *q);
        // Speed before this sample: a run of identical readings ends it.
        let speeds: [f64; MAX_JOINTS] = core::array::from_fn(|j| self.window.speed(j).unwrap_or(0.0));
        self.window.push(q, command);
        self.repeats = if repeats {
            self.repeats.saturating_add(1 + lost as u32)
        } else {
            if self.repeats < self.frozen_run {
                self.window.interpolate(self.repeats as usize);
            }
            0
        };
        let (mut frozen, mut fast, fresh) = (0, 0, self.is_fresh());
        for j in 0..self.dof {
            let (limits, joint, bit) = (&self.limits[j], &mut self.joints[j], 1 << j);
            let resolution = limits.joint.resolution;
            let noise = NOISE_STEPS * resolution / self.window.half_s();
            let most = SPEED_SHARE * limits.speed + noise;
            let speed = self.window.speed(j).unwrap_or(0.0);
            let a = self.window.acceleration(j).unwrap_or(0.0);
            let peak = peak(speed, a, limits, self.window.half_s());
            let is_late = fresh && peak > PEAK_SHARE * limits.speed + noise;
            joint.late = if is_late { joint.late.saturating_add(1) } else { 0 };
            let is_fast = speed.abs() > most || joint.late >= LATE_SAMPLES;
            fast |= if fresh && is_fast { bit } else { 0 };
            let plan = planned.map(|planned| (planned.q[j], planned.qd[j]));
            let before = Before {
                speed: speeds[j],
                stopping: joint.breakaway.max(limits.joint.breakaway) / limits.inertia * self.period_s,
                period_s: self.period_s,
                half_s: self.window.half_s(),
                resolution,
                repeats,
            };
            joint.read(q[j], lost, first, plan, &before);
            joint.ahead = plan.map_or(0.0, |(planned, _)| {
                let way = (NOISE_STEPS * resolution).max(BEHIND_TIMES * joint.still_band(resolution));
                let gone = (planned - joint.plan_before).abs() > way;
                if gone { planned - q[j] } else { 0.0 }
            });
            frozen |= if joint.same >= self.frozen_run && joint.abrupt { bit } else { 0 };
        }
        let found = |fault, joints| (joints != 0).then_some(Found { fault, joints });
        found(Fault::Frozen, frozen).or_else(|| found(Fault::TooFast, fast))
    }

    /// Motion and commanded torque of the last samples, once there are enough of them: what
    /// [`answers`](Self::answers) wants to know the torque of.
    pub fn motion(&self) -> Option<MeanMotion> {
        if self.is_fresh() { self.window.motion() } else { None }
    }

    /// Whether the last sample was read from the encoders: those that are read less often than samples are sent repeat all their readings in
    /// between. An arm that repeats them for longer stands, or is frozen.
    fn is_fresh(&self) -> bool {
        self.repeats == 0 || self.repeats >= self.frozen_run
    }

    /// Compares the torque that the model needs for [`motion`](Self::motion) with the commanded one. `None` where the joints
    /// answer their torque.
    ///
    /// A joint that is pushed towards its plan by more than can hold it, and repeats its reading all the same, is frozen. What can hold it
    /// goes by the Coulomb friction `coulomb` \[N·m\] that `needed` has, and by what `needed` missed while the joint moved.
    ///
    /// Real-time safe.
    pub fn answers(&mut self, motion: &MeanMotion, needed: &[f64], coulomb: &[f64]) -> Option<Found> {
        let (mut joints, mut frozen) = (0, 0);
        let whole = self.window.samples();
        let share = (self.period_s / MODEL_ERROR_S).min(1.0);
        for (j, joint) in self.joints.iter_mut().enumerate().take(self.dof) {
            let limits = &self.limits[j];
            let noise = NOISE_STEPS * limits.joint.resolution / self.window.half_s().powi(2) * limits.inertia;
            let torque = limits.joint.torque;
            // At most what is permitted for errors of the model, at least what loads and contacts may be.
            let bound = |error: f64, unmodelled: f64| error.min(MAX_ERROR_SHARE * torque).max(unmodelled) + noise;
            let most = bound(limits.joint.breakaway, SUDDEN_SHARE * limits.unmodelled);
            let missed = needed[j] - motion.tau[j];
            // Friction in motion was at most this.
            let friction = coulomb[j].abs() + joint.error_before.abs();
            joint.breakaway = limits.joint.breakaway.max(breakaway(friction, limits.joint.torque));
            // A load that the model does not know was missed in motion as well.
            let span = f64::from(joint.still.clamp(1, whole));
            joint.still_missed += (missed - joint.still_missed) / span;
            // Noise of three readings in the acceleration. A mean over the window has less of it, and shows later what grows.
            let of_noise = SECOND_DIFFERENCE.sqrt() * STILL_SIGMAS * joint.noise.sqrt();
            let of_noise = of_noise / self.window.half_s().powi(2) * limits.inertia;
            let is_pushed = |missed: f64, of_noise: f64| {
                let pushed = (joint.error_before - missed) * joint.ahead.signum();
                pushed > joint.breakaway + noise.max(of_noise)
            };
            let is_pushed =
                is_pushed(missed, of_noise) || is_pushed(joint.still_missed, of_noise / f64::from(whole).sqrt());
            let is_held = joint.ahead == 0.0 || joint.still < whole || !is_pushed;
            frozen |= if is_held { 0 } else { 1 << j };
            if !self.compared {
                (joint.model_error, joint.slow_error) = (missed, missed);
                // Not known yet: nothing is unusual.
                joint.usual = MAX_ERROR_SHARE * torque / USUAL_TIMES;
            }
            let sudden = missed - joint.model_error;
            // What is no number is no answer either, and is not remembered.
            let answered = sudden.abs() <= most;
            if sudden.is_finite() {
                joint.model_error += share * sudden.clamp(-most, most);
            }
            joint.unanswered = if answered { 0 } else { joint.unanswered.saturating_add(1) };
            // Friction may hold a joint that stands with all that it has, in one direction and then in the other.
            let holding = if motion.qd[j].abs() < ABRUPT { joint.breakaway } else { 0.0 };
            let most = bound(joint.breakaway.max(USUAL_TIMES * joint.usual), limits.unmodelled).max(holding + noise);
            let sudden = missed - joint.slow_error;
            let answered = sudden.abs() <= most;
            if sudden.is_finite() {
                joint.slow_error += (self.period_s / SLOW_ERROR_S).min(1.0) * sudden.clamp(-most, most);
                joint.usual += (self.period_s / USUAL_S).min(1.0) * (sudden.abs().min(most) - joint.usual);
            }
            joint.slowly_unanswered = if answered { 0 } else { joint.slowly_unanswered.saturating_add(1) };
            let longest = joint.unanswered.max(joint.slowly_unanswered);
            joints |= if longest >= RESPONSE_RUN { 1 << j } else { 0 };
        }
        self.compared = true;
        let found = |fault, joints| (joints != 0).then_some(Found { fault, joints });
        found(Fault::Frozen, frozen).or_else(|| found(Fault::NoResponse, joints))
    }

    /// [`JointLimits::breakaway`] of joint `j` by the friction that it had when it moved, never below that of the robot file.
    pub fn breakaway(&self, j: usize) -> f64 {
        self.joints[j].breakaway.max(self.limits[j].joint.breakaway)
    }

    /// Joints, bit 0 the base's, that did not answer their torque when [`answers`](Self::answers) last compared it, or of which that is not known.
    pub fn unanswered(&self) -> u32 {
        let is_unanswered = |j: &usize| {
            let joint = &self.joints[*j];
            !self.compared || joint.unanswered.max(joint.slowly_unanswered) > 0
        };
        (0..self.dof).filter(is_unanswered).fold(0, |bits, j| bits | 1 << j)
    }

    /// Longest time from the first wrong sample until a fault of this check is found \[samples\].
    pub fn window_samples(&self) -> u64 {
        (2.0 * self.window.half_s() / self.period_s).round() as u64 + u64::from(RESPONSE_RUN)
    }
}

/// Speed \[rad/s\] that a joint reaches which accelerates by `a` \[rad/s²\], before its drive has taken that back. `speed` is the mean over
/// the last `half_s` seconds.
fn peak(speed: f64, a: f64, limits: &MotionLimits, half_s: f64) -> f64 {
    let noise = NOISE_STEPS * limits.joint.resolution / half_s.powi(2);
    // More than the drive gives is that of a reading, which other checks look at.
    let most = limits.joint.torque / limits.inertia.max(f64::MIN_POSITIVE);
    let a = if a.abs() <= most { (a * speed.signum() - noise).max(0.0) } else { 0.0 };
    let back_s = if limits.jerk > 0.0 { a / limits.jerk } else { 0.0 };
    speed.abs() + 0.5 * a * (half_s + back_s)
}

/// What a joint did before a reading.
struct Before {
    /// Speed over the last `half_s` seconds \[rad/s\].
    speed: f64,
    /// Speed from which friction alone brings it to rest within a sample \[rad/s\].
    stopping: f64,
    half_s: f64,
    period_s: f64,
    /// Step of the encoder \[rad\].
    resolution: f64,
    /// All joints repeat their last readings: the steps of encoders that are read seldom are no noise.
    repeats: bool,
}

impl Before {
    /// How far apart readings may be that count as identical \[rad\], since a frozen encoder may have noise: a part of the joint's way in one
    /// sample where samples are far apart, else a few steps if it moves by far more. 0 for a slow joint, which would count as frozen.
    fn band(&self) -> f64 {
        let (flicker, abrupt) = (NOISE_STEPS * self.resolution, self.speed.abs() * ABRUPT_S);
        if self.period_s > SLOW_LOOP_S && abrupt > flicker && self.resolution < LEAST_YIELD {
            abrupt
        } else if self.speed.abs() * self.period_s > ABRUPT_TIMES * flicker {
            flicker
        } else {
            0.0
        }
    }

    /// Whether the joint moved at a steady speed: `last` is its way in the last period. One that comes to rest is slower there.
    fn steady(&self, last: f64) -> bool {
        let speed = self.speed.abs();
        let moved = speed * self.half_s >= MOVED_STEPS * self.resolution;
        let last = last * self.speed.signum();
        speed > ABRUPT.max(self.stopping) && moved && last + self.resolution >= 0.5 * speed * self.period_s
    }
}

impl Joint {
    /// How far readings of a joint that stands may be from their mean \[rad\], by flicker and by noise beyond that of the steps.
    fn still_band(&self, resolution: f64) -> f64 {
        let (flicker, sigma) = (FLICKER_STEPS * resolution, self.noise.sqrt());
        let flicker = if flicker <= LEAST_YIELD { flicker } else { 0.0 };
        let noise = STILL_SIGMAS * sigma.min(LEAST_YIELD);
        if noise <= LEAST_YIELD || sigma > STEP_SIGMAS * resolution { flicker.max(noise) } else { flicker }
    }

    /// Takes a reading into the noise: third differences of what a joint does are small.
    fn take_noise(&mut self, q: f64, lost: u64) {
        let [last, before, first] = self.past;
        if lost > 0 {
            self.known = 0;
        } else if self.known >= 3 {
            let third = q - 3.0 * (last - before) - first;
            self.noise += (third * third / THIRD_DIFFERENCE - self.noise) / NOISE_SAMPLES;
        }
        (self.past, self.known) = ([q, last, before], self.known.saturating_add(1));
    }

    /// Counts identical readings, `lost` samples after the last. `plan` is position and velocity of the plan.
    fn read(&mut self, q: f64, lost: u64, first: bool, plan: Option<(f64, f64)>, before: &Before) {
        self.take_noise(q, if first || before.repeats { 1 } else { lost });
        if !first && (q - self.still_at).abs() <= self.still_band(before.resolution) {
            if self.still == 0 {
                self.error_before = self.model_error;
            }
            self.still = self.still.saturating_add(1).saturating_add(lost as u32);
            self.still_at += (q - self.still_at) / f64::from(self.still + 1);
        } else {
            (self.still, self.still_at) = (0, q);
            self.plan_before = plan.map_or(f64::NAN, |(q, _)| q);
        }
        if self.same == 0 {
            (self.anchor, self.band) = (self.q, before.band());
        }
        if !first && (q - self.anchor).abs() <= self.band {
            if self.same == 0 {
                let goes_on = plan.is_some_and(|(_, qd)| qd * before.speed.signum() > 0.5 * before.speed.abs());
                self.abrupt = goes_on && before.steady(self.step);
            }
            self.same = self.same.saturating_add(1).saturating_add(lost as u32);
            self.q = q;
            return;
        }
        self.step = if first { 0.0 } else { (q - self.q) / (lost + 1) as f64 };
        (self.q, self.same, self.abrupt) = (q, 0, false);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIODS: [f64; 2] = [0.004, 0.001];

    fn check(period_s: f64) -> MotionCheck {
        let joint = JointLimits { resolution: 1e-5, torque: 10.0, revolute: true, breakaway: 1.0 };
        MotionCheck::new(&[MotionLimits { joint, speed: 3.0, unmodelled: 5.0, jerk: 0.0, inertia: 0.1 }], period_s)
    }

    /// Position and velocity of a motion of 1 rad/s at the most.
    fn swing(t: f64) -> (f64, f64) {
        (0.5 * (2.0 * t).sin(), (2.0 * t).cos())
    }

    fn rounded(q: f64) -> f64 {
        (q / 1e-5).round() * 1e-5
    }

    #[test]
    fn freezes_are_found_within_20_ms_and_sound_motion_is_not_called_frozen() {
        for period_s in PERIODS {
            // Seconds of motion before the reading freezes; speeds are 0.96, 0.41 and -0.42 rad/s there.
            for frozen_s in [0.14, 0.57, 1.0] {
                let (mut check, mut seq) = (check(period_s), 0);
                let mut wrong = None;
                loop {
                    seq += 1;
                    let t = seq as f64 * period_s;
                    let (q, qd) = swing(t);
                    let seen = rounded(swing(t.min(frozen_s)).0);
                    wrong = wrong.or((t > frozen_s).then_some(t));
                    let planned = Planned { q: &[q], qd: &[qd] };
                    match check.check(seq, &[seen], &[0.0], Some(planned)) {
                        None => assert!(t < 3.0, "never found"),
                        Some(found) => {
                            assert_eq!(found, Found { fault: Fault::Frozen, joints: 1 });
                            let late = t - wrong.expect("not before it is wrong");
                            assert!(late < 0.0201, "{late} s at {period_s} s");
                            break;
                        }
                    }
                }
            }
            let mut check = check(period_s);
            for seq in 1..=20_000 {
                let (q, qd) = swing(seq as f64 * period_s);
                let planned = Planned { q: &[q], qd: &[qd] };
                assert_eq!(check.check(seq, &[rounded(q)], &[0.0], Some(planned)), None, "sample {seq}");
            }
        }
    }

    /// A joint at rest repeats its reading, with a plan that stands, and one that brakes before it stands.
    #[test]
    fn an_arm_at_rest_and_one_that_comes_to_rest_are_sound() {
        for period_s in PERIODS {
            let mut check = check(period_s);
            for seq in 1..=5000 {
                // From 0.4 rad/s to rest with 2 rad/s².
                let t = (seq as f64 * period_s).min(0.2);
                let (q, qd) = (0.4 * t - t * t, 0.4 - 2.0 * t);
                let planned = Planned { q: &[q], qd: &[qd] };
                assert_eq!(check.check(seq, &[rounded(q)], &[0.0], Some(planned)), None, "sample {seq}");
            }
        }
    }

    /// At 0.06 rad/s friction of 2 N m stops 0.1 kg m² within 3 ms: no freeze at 250 Hz. One of 0.2 N m does not.
    #[test]
    fn a_slow_joint_that_friction_stops_is_sound() {
        for (breakaway, expected) in [(2.0, None), (0.2, Some(Found { fault: Fault::Frozen, joints: 1 }))] {
            let joint = JointLimits { resolution: 1e-5, torque: 10.0, revolute: true, breakaway };
            let mut check = MotionCheck::new(
                &[MotionLimits { joint, speed: 3.0, unmodelled: 5.0, jerk: 0.0, inertia: 0.1 }],
                0.004,
            );
            let found = (1..=200).find_map(|seq| {
                let t = seq as f64 * 0.004;
                let planned = Planned { q: &[0.06 * t], qd: &[0.06] };
                check.check(seq, &[rounded(0.06 * t.min(0.4))], &[0.0], Some(planned))
            });
            assert_eq!(found, expected, "{breakaway} N m");
        }
    }

    #[test]
    fn a_joint_beyond_its_speed_limit_is_named() {
        for period_s in PERIODS {
            let mut check = check(period_s);
            let found = (1..=2000).find_map(|seq| {
                let t = seq as f64 * period_s;
                check.check(seq, &[rounded(5.0 * t * t)], &[0.0], None).map(|found| (found, 10.0 * t))
            });
            let (found, speed) = found.expect("it is found");
            assert_eq!(found, Found { fault: Fault::TooFast, joints: 1 });
            assert!((3.3..3.5).contains(&speed), "{speed} rad/s");
        }
    }

    /// A joint of 0.1 kg m² whose torque and motion come apart at once; a load that comes slowly is an error of the model.
    #[test]
    fn motion_without_its_torque_is_no_answer_and_a_slow_error_of_the_model_is_one() {
        for period_s in PERIODS {
            for (sudden, expected) in [(true, true), (false, false)] {
                let (mut check, mut found) = (check(period_s), false);
                let (mut q, mut qd) = (0.0, 0.0);
                for seq in 1..=2000 {
                    let t = seq as f64 * period_s;
                    let begun = t - 0.5;
                    let load = if sudden { 8.0 * f64::from(begun > 0.0) } else { (8.0 * begun).clamp(0.0, 8.0) };
                    // Feedback answers what comes slowly.
                    let command = 0.5 * (5.0 * t).sin() + if sudden { 0.0 } else { load };
                    if check.check(seq, &[q], &[command], None).is_some() {
                        break;
                    }
                    if let Some(motion) = check.motion() {
                        found |= check.answers(&motion, &[0.1 * motion.qdd[0]], &[0.0]).is_some();
                    }
                    let qdd = (command - load) / 0.1;
                    q += qd * period_s + 0.5 * qdd * period_s * period_s;
                    qd += qdd * period_s;
                }
                assert_eq!(found, expected, "sudden: {sudden}, {period_s} s");
            }
        }
    }

    /// The first time at which a joint does not answer, whose torque is missed as `missed` \[N·m\] of the time.
    fn unanswered_at(missed: impl Fn(f64) -> f64) -> Option<f64> {
        let mut check = check(0.001);
        (1..3000).find_map(|seq| {
            let t = seq as f64 * 0.001;
            let found = check.check(seq, &[swing(t).0], &[0.0], None);
            assert_eq!(found, None, "{t} s");
            let motion = check.motion()?;
            check.answers(&motion, &[missed(t)], &[0.0]).map(|found| {
                assert_eq!(found, Found { fault: Fault::NoResponse, joints: 1 });
                t
            })
        })
    }

    /// Torque that comes apart by more than loads and contacts may add: at once by more than five sixths of these 5 N·m, or within half a
    /// second. What has been missed all along is an error of the model.
    #[test]
    fn torques_that_come_apart_slowly_are_found_and_constant_errors_are_not() {
        assert_eq!(unanswered_at(|_| 8.0), None);
        assert_eq!(unanswered_at(|t| if t < 1.0 { 0.0 } else { 4.1 }), None);
        let sudden = unanswered_at(|t| if t < 1.0 { 0.0 } else { 4.3 }).expect("found");
        assert!((1.0..1.004).contains(&sudden), "{sudden} s");
        let slow = unanswered_at(|t| 18.0 * (t - 1.0).clamp(0.0, 0.5)).expect("found");
        assert!((1.3..1.5).contains(&slow), "{slow} s");
    }

    /// A joint of 0.1 kg m² with friction that its model does not have: `true_q` is where it is, `command` what it gets, `sigma` the noise of
    /// its encoder \[rad\]. What is found first, and when \[s\].
    fn noisy(
        period_s: f64,
        sigma: f64,
        true_q: impl Fn(f64) -> f64,
        command: impl Fn(f64) -> f64,
    ) -> Option<(f64, Found)> {
        let mut check = check(period_s);
        let mut state = 1_u64;
        let mut uniform = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as f64 / 2f64.powi(31)
        };
        (1..=(1.0 / period_s) as u64).find_map(|seq| {
            let t = seq as f64 * period_s;
            // Twelve make one of unit variance.
            let noise = (0..12).map(|_| uniform()).sum::<f64>() - 6.0;
            let seen = rounded(true_q(t) + sigma * noise);
            let planned = Planned { q: &[0.5 * t], qd: &[0.5] };
            let found = check.check(seq, &[seen], &[command(t)], Some(planned)).or_else(|| {
                let motion = check.motion()?;
                check.answers(&motion, &[0.1 * motion.qdd[0]], &[0.0])
            });
            found.map(|found| (t, found))
        })
    }

    /// Noise of up to two and a half steps on a joint that stands: frozen where the command pushes beyond what friction holds, not before.
    #[test]
    fn a_frozen_reading_with_noise_is_found_and_a_joint_that_friction_holds_is_sound() {
        for period_s in PERIODS {
            for sigma in [1.5e-5, 2e-5, 2.5e-5] {
                // Friction may hold 1 N m by the file; the push reaches that 0.5 s after the joint stands.
                let push = |most: f64| move |t: f64| most * (t - 0.2).clamp(0.0, 0.5) / 0.5;
                let stands = |t: f64| 0.5 * t.min(0.05) * 0.1;
                assert_eq!(noisy(period_s, sigma, stands, push(0.9)), None, "{period_s} s, {sigma} rad");
                let (t, found) = noisy(period_s, sigma, stands, push(4.9)).expect("found");
                assert_eq!(found, Found { fault: Fault::Frozen, joints: 1 }, "{period_s} s, {sigma} rad");
                assert!((0.25..0.7).contains(&t), "{t} s, {period_s} s, {sigma} rad");
            }
        }
    }

    /// The drive takes 3 N m back in 0.2 s: a joint of 0.1 kg m² with 30 rad/s² gets faster by 3 rad/s meanwhile.
    #[test]
    fn a_joint_whose_drive_cannot_let_go_in_time_is_too_fast_early() {
        for period_s in PERIODS {
            let at = |jerk: f64| {
                let joint = JointLimits { resolution: 1e-6, torque: 10.0, revolute: true, breakaway: 1.0 };
                let limits = MotionLimits { joint, speed: 6.0, unmodelled: 5.0, jerk, inertia: 0.1 };
                let mut check = MotionCheck::new(&[limits], period_s);
                let found = (1..=1000).find_map(|seq| {
                    let t = seq as f64 * period_s;
                    check.check(seq, &[15.0 * t * t], &[3.0], None).map(|found| (found, 30.0 * t))
                });
                let (found, speed) = found.expect("found");
                assert_eq!(found, Found { fault: Fault::TooFast, joints: 1 });
                speed
            };
            assert!((6.5..7.0).contains(&at(0.0)), "{}", at(0.0));
            let early = at(150.0);
            assert!((3.8..4.2).contains(&early), "{early} rad/s, {period_s} s");
        }
    }
}
