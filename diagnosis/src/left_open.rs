//! Joints that keep a gap in motion although causes were named: what that says against the names.
//!
//! Something is missing there that nobody knows, and a name may be what the list has of it. In 191 runs with disturbances that are
//! mostly not in the list, structure was named on such joints 22 times and was the effect itself 4 times; where all joints were
//! closed, nearly always.

use crate::effect::{Effect, Kind};
use crate::report::{Cause, Diagnosis, Verdict};
use crate::sealed::IN_MOTION;

/// A gap is closed where it became so many times smaller, whatever is left.
const CLOSED: f64 = 7.0;
/// Confidence in structure on a joint that is left open, and in what is named beside such a joint.
const LEFT_OPEN: f64 = 0.45;
const OPEN_BESIDE: f64 = 0.6;
/// An effect that makes the gap of a joint of its own no more times smaller than this, and leaves it open, is no name.
const HARDLY: f64 = 1.5;

impl Diagnosis {
    /// Joints that are left open, and how many times smaller their gap became.
    fn left_open(&self) -> impl Iterator<Item = (&String, f64)> {
        self.per_joint.iter().filter_map(|gap| {
            let [before, after] = gap.in_motion?;
            (after > IN_MOTION && before < CLOSED * after).then(|| (&gap.joint, before / after))
        })
    }

    /// Withdraws effects that hardly close the gap of a joint of their own; says which, by their places.
    pub(crate) fn withdraw_what_hardly_helps(&mut self) -> Vec<usize> {
        let helps = |cause: &Cause| {
            cause.effect.kind() != Kind::Structure
                || self.left_open().all(|(j, times)| times >= HARDLY || !cause.joints.contains(j))
        };
        let out: Vec<usize> = (0..self.causes.len()).filter(|k| !helps(&self.causes[*k])).collect();
        for k in out.iter().rev() {
            let cause = self.causes.remove(*k);
            self.withdrawn.push(cause);
        }
        if !out.is_empty() {
            let structure = self.causes.iter().filter(|c| c.effect.kind() == Kind::Structure).count();
            self.verdict = match structure {
                0 => Verdict::Unexplained,
                1 => Verdict::Effect,
                _ => Verdict::Several,
            };
        }
        out
    }

    /// Lowers the confidence in what is named on joints that are left open, and beside them. Contact comes again as it likes, and what a
    /// simulated gear, bristle or delay misses is of its own form: that says nothing against the cause itself, or of other joints.
    pub(crate) fn doubt_what_is_left_open(&mut self) {
        let own = |cause: &Cause, joint: &String| cause.joints.is_empty() || cause.joints.contains(joint);
        let open: Vec<String> = self.left_open().map(|(joint, _)| joint.clone()).collect();
        let roughly: Vec<Cause> = self.causes.iter().filter(|c| is_inexact(c.effect)).cloned().collect();
        let strange = open.iter().any(|joint| !roughly.iter().any(|c| own(c, joint)));
        for cause in &mut self.causes {
            let structure = cause.effect.kind() == Kind::Structure;
            if structure && !is_inexact(cause.effect) && open.iter().any(|joint| own(cause, joint)) {
                cause.confidence *= LEFT_OPEN;
            } else if strange {
                cause.confidence *= OPEN_BESIDE;
            }
        }
    }
}

/// Whether an effect goes on otherwise than its model.
fn is_inexact(effect: Effect) -> bool {
    matches!(
        effect,
        Effect::JointElasticity
            | Effect::Backlash
            | Effect::PreslidingFriction
            | Effect::TransportDelay
            | Effect::BaseFlexibility
            | Effect::ExternalForce
    )
}
