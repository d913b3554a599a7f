//! Which verdict it is.

use crate::effect::Kind;
use crate::procedure::Step;
use crate::report::{Cause, JointGap, Verdict};

use super::{Judge, MOST_LEFT};

/// The verdict where what was fitted holds; `causes`: those upheld, those withdrawn.
pub(super) fn verdict(
    judge: &Judge<'_>,
    causes: [&[Cause]; 2],
    steps: &[Step],
    upheld: &[bool],
    per_joint: &[JointGap],
    unexplained_share: f64,
) -> Verdict {
    let [structure, withdrawn_structure] =
        causes.map(|of| of.iter().filter(|c| c.effect.kind() == Kind::Structure).count());
    let left_over = judge.residue.any_noisy();
    let nameless = steps.iter().flat_map(|s| &s.adopted).any(|a| a.form.is_nameless());
    let withdrawn_structure = withdrawn_structure > 0;
    // Where the floor is reached with what was withdrawn after all, that is no answer.
    let refused = steps.iter().zip(upheld).filter(|(s, upheld)| !**upheld && s.effect.kind() == Kind::Structure);
    let lacking = refused.flat_map(|(s, _)| &s.joints).any(|j| judge.residue.was_noisy(*j));
    match (structure, causes[0].is_empty()) {
        // Wrong values are the answer unless most of the gap, or a thing without a name, is left beside them.
        (0, true) if left_over => Verdict::Unexplained,
        // Taken up, but by nothing that has a name.
        (0, _) if nameless => Verdict::Unexplained,
        (0, _) if left_over && (withdrawn_structure || unexplained_share > MOST_LEFT) => Verdict::Unexplained,
        // One joint that keeps a gap while the others come down to their noise has something that nobody named.
        (0, _) if per_joint.iter().enumerate().any(|(j, gap)| gap.is_left() && judge.residue.is_nameless(j)) => {
            Verdict::Unexplained
        }
        (0, _) if lacking || withdrawn_structure && !judge.residue.at_floor() => Verdict::Unexplained,
        // Values that fit, or motion of its own kind that was looked at by nobody, are no answer either.
        (0, true) if per_joint.iter().any(JointGap::is_open) => Verdict::Unexplained,
        // Of an arm with a joint that cannot be judged nobody says that nothing is wrong.
        (0, true) if judge.names.iter().any(|name| judge.is_unbelieved(name)) => Verdict::NotEvaluated,
        (0, true) => Verdict::NoGap,
        // Nor are values that fit what was looked at and leave most of the gap where it counts.
        (0, false)
            if judge.residue.at_floor() && unexplained_share > MOST_LEFT && per_joint.iter().any(JointGap::is_left) =>
        {
            Verdict::Unexplained
        }
        (0, false) => Verdict::Parameter,
        (1, _) => Verdict::Effect,
        _ => Verdict::Several,
    }
}
