//! Checks of measured torques against the model: signs and stuck sensors.

use crate::readings::{AT_LIMIT, ReadingCheck};
use crate::{Fault, Found};
use rivet_dynamics::MAX_JOINTS;
use rivet_estimation::{Estimate, Row};

/// A torque is flipped when measured and predicted sum to less than this share of their difference.
const FLIPPED: f64 = 0.4;
/// And right when the difference is less than this share of the sum.
const RIGHT: f64 = 0.5;
/// Differences below this many sigmas, or this share of the torque limit, say nothing.
const SIGMAS: f64 = 20.0;
const LIMIT_SHARE: f64 = 0.02;
/// Rows in a row that name a fault, and that end it.
const ROWS: u32 = 3;
/// Share of a joint's torque that the model may leave unexplained for its word to count.
const EXPLAINED: f64 = 0.4;
/// Identical torques, while the joint moves, from which on nothing is learnt until they change: unless torque of the joint usually
/// stands, and the motion needs no other one.
const SUSPECT_RUN: u32 = 10;
/// Torque in steps stands from one sample to the next more often than this: with less, ten in a row come once in a thousand samples.
const STANDS: f64 = 0.5;
/// Memory of how often it does \[samples in motion\].
const STANDS_MEMORY: f64 = 4000.0;
/// A change of less than this share of the smallest torque that matters is rounding of numbers.
const ROUNDING: f64 = 1e-9;
/// Samples in motion from which on it is known whether torque of a joint usually stands: more than one stand has. What was frozen when the
/// arm started changes with every sample after that.
const KNOWN: f64 = 1.5 * SUSPECT_RUN as f64;
/// Where motion is slow, stands are long and few, and torque in steps is known by its changes: from so many on, after the first, most are by
/// about the least. Those of a fine torque are of any size.
const KNOWN_CHANGES: f64 = 2.0;
const ABOUT: f64 = 1.5;
/// Changes that are remembered.
const CHANGES_MEMORY: f64 = 500.0;
/// Torque that has been in doubt for so many times `SUSPICION_S` longer than not is told as stuck, or nobody would know why next to nothing
/// is learnt: a channel that stands for a moment again and again.
const DOUBTED: u32 = 25;
/// Parts of `SUSPICION_S` for which a torque may stand before the model can tell whether it is missed.
const EARLY: u32 = 4;
/// A torque that usually stands is in doubt where the model misses it by more than a step and so many sigmas.
const SUSPECT_SIGMAS: f64 = 4.0;
/// Identical torques that are a stuck sensor if the motion needs another torque.
const STUCK_RUN: u32 = 20;
/// How far the torque that the motion needs must have gone meanwhile, and be away from the measured one, in sigmas.
const STUCK_SIGMAS: f64 = 8.0;
/// Time for which nothing is learnt after a torque has changed its sign from one sample to the next, or has jumped to the
/// drive's limit, or stood still \[s\]: until rows tell, or the filters have forgotten it.
const SUSPICION_S: f64 = 0.2;
/// A step of the torque is large beyond this many times the usual one.
const LARGE_STEP: f64 = 12.0;
/// Memory of what is usual \[samples\].
const USUAL: f64 = 500.0;

#[derive(Clone, Copy, Debug, Default)]
struct Joint {
    tau: f64,
    /// Mean square of steps of the torque.
    usual: f64,
    /// Smallest change of the torque but none, 0 before the first: its step, where it has one \[N·m\].
    step: f64,
    /// Share of samples in motion whose torque is that of the sample before, of so many at the most.
    stands: f64,
    looked_at: f64,
    /// Share of its changes that are by about the step, of so many at the most.
    by_steps: f64,
    changes: f64,
    /// The torque has stood for so long, in motion, that this is looked at.
    run: bool,
    /// What the motion needs by the last row, and the measured torque over it, filtered alike \[N·m\].
    predicted: f64,
    missed: f64,
    /// What the motion needed when the torque last changed.
    predicted_before: f64,
    flipped_rows: u32,
    right_rows: u32,
    flipped: bool,
    stuck: bool,
    /// Standard deviation of the torque's residual \[N·m\].
    sigma: f64,
    /// The model explains this joint's torque.
    trusted: bool,
}

impl Joint {
    /// Learns how the torque changes where nothing is wrong with it: `run` identical ones so far, after a `change`.
    fn stood(&mut self, run: u32, moves: bool, change: f64) {
        if change > 0.0 {
            self.changed(change);
        }
        // Beyond that it may be stuck, of which nothing is learnt.
        if moves && run < SUSPECT_RUN {
            let stands = if run > 0 { 1.0 } else { 0.0 };
            self.looked_at = (self.looked_at + 1.0).min(STANDS_MEMORY);
            self.stands += (stands - self.stands) / self.looked_at;
        }
    }

    fn changed(&mut self, by: f64) {
        if self.step == 0.0 || ABOUT * by < self.step {
            // All before were by several of these.
            (self.step, self.by_steps, self.changes) = (by, 0.0, 0.0);
            return;
        }
        self.changes = (self.changes + 1.0).min(CHANGES_MEMORY);
        let one = if by < ABOUT * self.step { 1.0 } else { 0.0 };
        self.by_steps += (one - self.by_steps) / self.changes;
        self.step = self.step.min(by);
    }

    /// Whether a torque that has stood for long may be stuck. One of fine steps changes with every sample: it need not be missed first,
    /// and before the model can tell what is missed anything may be that is not known to come in steps.
    fn suspicious(&self) -> bool {
        let in_steps = self.changes >= KNOWN_CHANGES && self.by_steps >= STANDS;
        let usual = in_steps || self.looked_at > KNOWN && self.stands >= STANDS;
        !usual || self.trusted && self.missed.abs() > self.step + SUSPECT_SIGMAS * self.sigma
    }
}

/// Finds torques that cannot be those of the motion, by the model as identified so far. Nothing allocates.
#[derive(Clone, Debug)]
pub struct TorqueCheck {
    dof: usize,
    suspicion: u32,
    /// Samples for which a torque may stand before the model can tell.
    early: u32,
    suspect: u32,
    /// Samples for which torque has been in doubt, less those for which it has not, and joints that stood in them, a bit each.
    doubted_for: u32,
    doubted: u32,
    seen: bool,
    joints: [Joint; MAX_JOINTS],
}

impl TorqueCheck {
    /// Starts without a past, for `dof` joints and samples every `period_s`.
    pub fn new(dof: usize, period_s: f64) -> TorqueCheck {
        let suspicion = (SUSPICION_S / period_s).ceil() as u32;
        let joints = [Joint::default(); MAX_JOINTS];
        TorqueCheck {
            dof,
            suspicion,
            early: (suspicion / EARLY).max(SUSPECT_RUN),
            suspect: 0,
            doubted_for: 0,
            doubted: 0,
            seen: false,
            joints,
        }
    }

    /// The signals begin anew: what was found about them is over.
    pub fn restart(&mut self) {
        self.seen = false;
        for joint in &mut self.joints {
            (joint.flipped_rows, joint.right_rows) = (0, 0);
        }
    }

    /// Nothing is held against any torque any more: another robot controller, or a request to forget.
    pub fn forget(&mut self) {
        (self.suspect, self.doubted_for, self.doubted) = (0, 0, 0);
        self.restart();
        for joint in &mut self.joints {
            (joint.flipped, joint.stuck) = (false, false);
        }
    }

    /// Reads how well the model explains the torques now.
    pub fn read(&mut self, estimate: &Estimate<'_>, established: bool) {
        for (j, joint) in self.joints.iter_mut().enumerate().take(self.dof) {
            joint.sigma = estimate.torque_noise[j];
            joint.trusted = established && estimate.residual_rms[j] < EXPLAINED * estimate.torque_rms[j];
        }
    }

    /// Takes in the torques of a sample that `guard` has looked at; what is wrong with them, and whether that has just ended.
    pub fn sample(&mut self, tau: &[f64], guard: &ReadingCheck) -> (Option<Found>, bool) {
        self.suspect = self.suspect.saturating_sub(1);
        let (mut stuck, mut flipped, mut ended) = (0, 0, false);
        for (j, joint) in self.joints.iter_mut().enumerate().take(self.dof) {
            let (tau, least) = (tau[j], LIMIT_SHARE * guard.torque_limit(j));
            let step = tau - joint.tau;
            if self.seen {
                let large = step * step > (LARGE_STEP * LARGE_STEP * joint.usual).max(least * least);
                let sign = (tau + joint.tau).abs() < FLIPPED * step.abs();
                let at_limit = tau.abs() >= AT_LIMIT * guard.torque_limit(j);
                if joint.trusted && large && (sign || at_limit) {
                    self.suspect = self.suspicion;
                }
                let most = LARGE_STEP * LARGE_STEP * joint.usual + f64::MIN_POSITIVE;
                let counted = if joint.usual > 0.0 { (step * step).min(most) } else { step * step };
                joint.usual += (counted - joint.usual) / USUAL;
            }
            joint.tau = tau;
            let (run, moves) = guard.torque_run(j);
            // What sums of numbers leave of an equal torque is no step.
            joint.stood(run, moves, if self.seen && step.abs() > ROUNDING * least { step.abs() } else { 0.0 });
            joint.run = moves && run >= if joint.trusted { SUSPECT_RUN } else { self.early };
            if run == 0 {
                joint.predicted_before = joint.predicted;
                ended |= joint.stuck;
                joint.stuck = false;
            } else if joint.run {
                let suspicious = joint.suspicious();
                // Until the filters hold nothing of it any more.
                if suspicious {
                    self.suspect = self.suspicion;
                    self.doubted |= 1 << j;
                }
                let needed = (joint.predicted - joint.predicted_before).abs().min(joint.missed.abs());
                joint.stuck |= if joint.trusted {
                    run >= STUCK_RUN && needed > joint.step + (STUCK_SIGMAS * joint.sigma).max(least)
                } else {
                    suspicious
                };
            }
            stuck |= u32::from(joint.stuck) << j;
            if joint.flipped && joint.right_rows >= ROWS {
                joint.flipped = false;
                ended = true;
            }
            flipped |= u32::from(joint.flipped) << j;
        }
        self.seen = true;
        let told = DOUBTED * self.suspicion;
        if self.suspect > 0 {
            self.doubted_for = (self.doubted_for + 1).min(told + self.suspicion);
            if self.doubted_for > told {
                stuck |= self.doubted;
            }
        } else {
            self.doubted_for = self.doubted_for.saturating_sub(1);
            self.doubted = if self.doubted_for > 0 { self.doubted } else { 0 };
        }
        let found = |fault, joints| (joints != 0).then_some(Found { fault, joints });
        (found(Fault::TorqueStuck, stuck).or_else(|| found(Fault::SignFlipped, flipped)), ended)
    }

    /// Whether a row may be learnt from.
    pub fn admits(&mut self, row: &Row, limits: &ReadingCheck) -> bool {
        for (j, joint) in self.joints.iter_mut().enumerate().take(self.dof) {
            joint.predicted = row.predicted[j];
            joint.missed = row.tau[j] - row.predicted[j];
            if joint.run && joint.suspicious() {
                self.suspect = self.suspicion;
            }
        }
        let mut doubtful = self.suspect > 0;
        for (j, joint) in self.joints.iter_mut().enumerate().take(self.dof) {
            if row.moving[j] && joint.trusted {
                let (difference, sum) = ((row.tau[j] - row.predicted[j]).abs(), (row.tau[j] + row.predicted[j]).abs());
                let least = (SIGMAS * joint.sigma).max(LIMIT_SHARE * limits.torque_limit(j));
                if difference > least && sum < FLIPPED * difference {
                    joint.flipped_rows += 1;
                    joint.right_rows = 0;
                    doubtful = true;
                } else if sum > least && difference < RIGHT * sum {
                    joint.right_rows += 1;
                    joint.flipped_rows = 0;
                }
                joint.flipped |= joint.flipped_rows >= ROWS;
            }
            doubtful |= joint.flipped || joint.stuck;
        }
        !doubtful
    }
}
