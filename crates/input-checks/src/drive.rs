//! Checks of measured torque against commanded torque, and of the time at the torque limit.

use crate::readings::AT_LIMIT;
use crate::{Fault, Found, JointLimits};
use rivet_dynamics::MAX_JOINTS;

/// Time for which commands may be on their way to a drive and back \[s\].
const ROUND_TRIP_S: f64 = 0.02;
/// Most samples in that time.
const LENGTH: usize = 40;
/// Share of the torque limit below which measured and commanded torque are not compared.
const LEAST_SHARE: f64 = 0.1;
/// A measured torque is opposite to the command, or repeats, for this long before that counts \[s\].
const FAULT_S: f64 = 0.012;
/// Fewest samples in that time.
const FAULT_RUN: u32 = 3;
/// A run of identical torques this many times as long as the longest before is that of a torque which is stuck: one of fine steps changes
/// with every sample.
const LONGEST_TIMES: u32 = 4;
/// Changes after which a measured torque is known to be measured: a robot without torque sensors reports zeros.
const KNOWN_CHANGES: u32 = 50;

#[derive(Clone, Copy, Debug, Default)]
struct Joint {
    tau: f64,
    changes: u32,
    same: u32,
    /// Most identical torques in a row so far that were taken for sound.
    longest: u32,
    /// Smallest change so far \[N·m\]: the step of a quantised signal. 0 before the first.
    step: f64,
    /// Measured torques at the limit in a row, without a command that was near it.
    measured_at_limit: u32,
    /// The command when the measured torque last changed.
    command_before: f64,
    opposite: u32,
    /// Commands at the limit in a row.
    at_limit: u32,
}

/// Finds drives that do not give what is commanded, and commands that stay at the limit. Nothing allocates.
#[derive(Clone, Debug)]
pub struct DriveCheck {
    dof: usize,
    limits: [JointLimits; MAX_JOINTS],
    joints: [Joint; MAX_JOINTS],
    commands: [[f64; MAX_JOINTS]; LENGTH],
    length: usize,
    filled: usize,
    next: usize,
    run: u32,
    /// Commands in a row at the limit that are too many.
    most_at_limit: u32,
}

impl DriveCheck {
    /// Starts without a past. `saturation_s` is the longest time for which a command may be at its limit.
    pub fn new(limits: &[JointLimits], period_s: f64, saturation_s: f64) -> DriveCheck {
        let mut all = [JointLimits::default(); MAX_JOINTS];
        for (all, limits) in all.iter_mut().zip(limits) {
            *all = *limits;
        }
        DriveCheck {
            dof: limits.len().min(MAX_JOINTS),
            limits: all,
            joints: [Joint::default(); MAX_JOINTS],
            commands: [[0.0; MAX_JOINTS]; LENGTH],
            length: ((ROUND_TRIP_S / period_s).ceil() as usize).clamp(2, LENGTH),
            filled: 0,
            next: 0,
            run: ((FAULT_S / period_s).ceil() as u32).max(FAULT_RUN),
            most_at_limit: (saturation_s / period_s).floor() as u32,
        }
    }

    /// Forgets the past, but not whether torque is measured.
    pub fn restart(&mut self) {
        (self.filled, self.next) = (0, 0);
        for joint in &mut self.joints {
            *joint = Joint {
                tau: joint.tau,
                changes: joint.changes,
                longest: joint.longest,
                step: joint.step,
                ..Joint::default()
            };
        }
    }

    /// Takes in measured torques and the `command` before them, all finite. `None` where they belong together.
    ///
    /// Real-time safe.
    pub fn check(&mut self, tau: &[f64], command: &[f64]) -> Option<Found> {
        self.commands[self.next][..command.len()].copy_from_slice(command);
        self.next = if self.next + 1 >= self.length { 0 } else { self.next + 1 };
        self.filled = (self.filled + 1).min(self.length);
        let (mut opposite, mut stuck, mut saturated) = (0, 0, 0);
        for j in 0..self.dof {
            let commands = self.commands[..self.filled].iter().map(|command| command[j]);
            let (low, high) = commands.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)));
            let (joint, limit, bit) = (&mut self.joints[j], self.limits[j].torque, 1 << j);
            let least = LEAST_SHARE * limit;
            joint.at_limit = if command[j].abs() >= AT_LIMIT * limit { joint.at_limit.saturating_add(1) } else { 0 };
            saturated |= if joint.at_limit > self.most_at_limit { bit } else { 0 };
            let against = low > least && tau[j] < -least || high < -least && tau[j] > least;
            joint.opposite = if against { joint.opposite + 1 } else { 0 };
            opposite |= if joint.opposite >= self.run { bit } else { 0 };
            let alone = tau[j].abs() >= AT_LIMIT * limit && low.abs().max(high.abs()) < limit - least;
            joint.measured_at_limit = if alone { joint.measured_at_limit.saturating_add(1) } else { 0 };
            if tau[j] == joint.tau {
                joint.same = joint.same.saturating_add(1);
            } else {
                joint.longest = joint.longest.max(joint.same);
                let step = (tau[j] - joint.tau).abs();
                joint.step = if joint.step > 0.0 { joint.step.min(step) } else { step };
                (joint.tau, joint.same, joint.command_before) = (tau[j], 0, command[j]);
                joint.changes = joint.changes.saturating_add(1);
            }
            let moved = (command[j] - joint.command_before).abs() > least;
            let away = tau[j] < low - least || tau[j] > high + least;
            let known = joint.changes > KNOWN_CHANGES;
            // At its limit a torque repeats, and a command that repeats is answered by one.
            // A command that changes by less than a step of the signal may be answered by one torque for long.
            let fine = high - low > joint.step
                && tau[j].abs() < AT_LIMIT * limit
                && joint.same > LONGEST_TIMES * joint.longest;
            stuck |= if known && joint.same >= self.run && (fine || moved && away) { bit } else { 0 };
            stuck |= if joint.measured_at_limit >= self.run { bit } else { 0 };
        }
        let found = |fault, joints| (joints != 0).then_some(Found { fault, joints });
        found(Fault::SignFlipped, opposite)
            .or_else(|| found(Fault::TorqueStuck, stuck))
            .or_else(|| found(Fault::CommandSaturated, saturated))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: [JointLimits; 1] = [JointLimits { resolution: 1e-5, torque: 100.0, revolute: true, breakaway: 10.0 }];

    /// Runs a second of a drive that answers 5 ms late; from 0.5 s on `wrong` makes the measured torque from the right one and
    /// that of 0.5 s. What is found, and how long after.
    fn run(period_s: f64, amplitude: f64, wrong: impl Fn(f64, f64) -> f64) -> Option<(Found, f64)> {
        let mut check = DriveCheck::new(&LIMITS, period_s, 0.1);
        let torque = |t: f64| amplitude * (9.0 * t + 1.0).sin();
        (1..=(1.0 / period_s) as u32).find_map(|k| {
            let t = f64::from(k) * period_s;
            let right = torque(t - 0.005);
            let tau = if t > 0.5 { wrong(right, torque(0.5)) } else { right };
            check.check(&[tau], &[torque(t - period_s).clamp(-100.0, 100.0)]).map(|found| (found, t - 0.5))
        })
    }

    #[test]
    fn a_drive_that_answers_is_sound_and_one_against_its_command_is_named() {
        for period_s in [0.004, 0.001] {
            assert_eq!(run(period_s, 60.0, |right, _| right), None);
            let (found, after) = run(period_s, 60.0, |right, _| -right).expect("found");
            assert_eq!(found, Found { fault: Fault::SignFlipped, joints: 1 });
            assert!(after <= 0.02, "{after} s");
            let (found, after) = run(period_s, 60.0, |_, before| before).expect("found");
            assert_eq!(found, Found { fault: Fault::TorqueStuck, joints: 1 });
            assert!(after <= 0.02, "{after} s");
            let (found, after) = run(period_s, 60.0, |_, _| -100.0).expect("found");
            assert_eq!(found, Found { fault: Fault::TorqueStuck, joints: 1 });
            assert!(after <= 0.02, "{after} s");
        }
    }

    /// Torques that come in steps repeat: only one that the command has left is stuck.
    #[test]
    fn a_torque_that_comes_in_steps_is_sound() {
        for period_s in [0.004, 0.001] {
            assert_eq!(run(period_s, 60.0, |right, _| (right / 4.0).round() * 4.0), None);
            let mut check = DriveCheck::new(&LIMITS, period_s, 0.1);
            let torque = |t: f64| (60.0 * (9.0 * t + 1.0).sin() / 4.0).round() * 4.0;
            let found = (1..=(2.0 / period_s) as u32).find_map(|k| {
                let t = f64::from(k) * period_s;
                let tau = torque((t - 0.005).min(1.0));
                check.check(&[tau], &[60.0 * (9.0 * (t - period_s) + 1.0).sin()]).map(|found| (found, t - 1.0))
            });
            let (found, after) = found.expect("found");
            assert_eq!(found, Found { fault: Fault::TorqueStuck, joints: 1 });
            assert!(after > 0.0, "{after} s");
        }
    }

    /// An arm that moves and then rests, with feedback that changes its command by less than the measured torque's steps.
    #[test]
    fn a_torque_that_repeats_at_rest_is_sound() {
        for period_s in [0.004, 0.001] {
            let mut check = DriveCheck::new(&LIMITS, period_s, 0.1);
            for k in 1..=(4.0 / period_s) as u32 {
                let t = f64::from(k) * period_s;
                let torque = |t: f64| 40.0 + if t < 2.0 { 20.0 * (20.0 * t).sin() } else { 20.0 * (40.0_f64).sin() };
                let tau = (torque(t - 0.005) / 0.05).round() * 0.05;
                let command = torque(t - period_s) + if t > 2.0 { 0.004 * (300.0 * t).sin() } else { 0.0 };
                assert_eq!(check.check(&[tau], &[command]), None, "{t} s at {period_s} s");
            }
        }
    }

    #[test]
    fn a_robot_that_does_not_measure_torque_is_sound() {
        let mut check = DriveCheck::new(&LIMITS, 0.001, 0.1);
        assert!((0..1000).all(|k| check.check(&[0.0], &[60.0 * (0.01 * f64::from(k)).sin()]).is_none()));
    }

    #[test]
    fn a_command_at_its_limit_is_named_after_the_configured_time() {
        for period_s in [0.004, 0.001] {
            let mut check = DriveCheck::new(&LIMITS, period_s, 0.1);
            let found = (1..1000).find_map(|k| check.check(&[0.0], &[-100.0]).map(|found| (found, k)));
            let (found, samples) = found.expect("found");
            assert_eq!(found, Found { fault: Fault::CommandSaturated, joints: 1 });
            let after = f64::from(samples) * period_s;
            assert!((0.1..=0.1 + 2.0 * period_s).contains(&after), "{after} s");
        }
    }
}
