//! Presliding friction or external hysteresis: bristles of the joint, or a hose that is dragged along.
//!
//! Bristles are the friction of the joint: before it slides all of its Coulomb level is a spring's. A hose or a cable that gives way is beside
//! that friction, which sticks and slips as before. With both levels free they are one form, over any length,
//!
//! ```text
//! τ = F·s + H·z            bristles: F = 0           beside: F is the joint's friction
//! ```
//!
//! so what tells them apart is the share of the spring in both. (Not from the bristles' own form: there the level is that of the file, or
//! what a fit without the effect made of it, and the factor is believed to be near 1.)

use crate::effects::physics::Physics;
use crate::effects::presliding_friction::{Hysteresis, Presliding};
use crate::fit::search::{Candidate, Search, Standing};
use crate::model::listener::Listener;
use crate::policy::POLICY;

/// What a form with such a state is by its share of the joint's friction.
pub(crate) enum Kind {
    /// Another form, or what it is called.
    AsNamed,
    /// Bristles that are only a part of the friction: this instead.
    Beside(Box<(Candidate, Standing)>),
    /// Bristles indeed, over the way that they have with both levels free.
    Of(Box<(Candidate, Standing)>),
    /// The joint's own friction, of which there are other forms: bristles, or its level.
    Own,
}

/// Looks at a form that was refined; none where there is no run.
pub(crate) fn kind(
    search: &Search<'_>,
    physics: &[Physics<'_>],
    (candidate, standing): (&Candidate, &Standing),
    listener: &mut dyn Listener,
) -> Option<Kind> {
    if let Some(&Hysteresis { joint, length }) = candidate.form.get() {
        let share = share(search, physics, joint, standing)?;
        return Some(if is_own(share, length) { Kind::Own } else { Kind::AsNamed });
    }
    let Some(&Presliding { joint, length }) = candidate.form.get() else { return Some(Kind::AsNamed) };
    // Where that with both levels does not hold, bristles' form is what there is.
    let solved = search.scales();
    let Some((free, its)) = search.refine_over(&Hysteresis { joint, length }.into(), physics, &solved) else {
        return Some(Kind::AsNamed);
    };
    let share = share(search, physics, joint, &its)?;
    listener.line(&format!("  {:?} is {share:.3} of the joint's friction", free.form));
    let Some(&Hysteresis { length, .. }) = free.form.get() else { return Some(Kind::AsNamed) };
    if share < POLICY.adoption.min_own_friction_share {
        return Some(if is_own(share, length) { Kind::Own } else { Kind::Beside(Box::new((free, its))) });
    }
    let presliding = search.candidate(Presliding { joint, length }.into(), physics);
    let made =
        presliding.and_then(|presliding| Some((search.standing(standing.at, &presliding, &solved)?, presliding)));
    Some(made.map_or(Kind::AsNamed, |(its, presliding)| Kind::Of(Box::new((presliding, its)))))
}

/// Whether that share of friction, which turns over within `length` \[rad\], is the joint's own.
fn is_own(share: f64, length: f64) -> bool {
    length < POLICY.adoption.max_own_travel_rad
        || share >= POLICY.adoption.min_own_friction_share && length < POLICY.plausibility.max_bristle_travel_rad
}

/// H/(F + H), as [`Hysteresis`] stands.
fn share(search: &Search<'_>, physics: &[Physics<'_>], joint: usize, standing: &Standing) -> Option<f64> {
    let at = physics.first()?.coulomb(joint);
    let c = &standing.added.c;
    let remaining_friction = (search.nominal.x[at] + standing.added.x[at] + c[1]).max(0.0);
    Some(c[0] / (c[0] + remaining_friction))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// On a reader's arms that stick, half of a joint's friction over 1 mrad was its level that the file has wrong.
    #[test]
    fn what_turns_over_at_once_is_the_joints_own_friction() {
        assert!(is_own(0.45, 1e-3) && is_own(0.74, 1.06e-3));
        assert!(!is_own(0.45, 0.004) && !is_own(0.7, 0.2), "a hose");
        assert!(
            is_own(0.8, 0.02) && !is_own(0.8, POLICY.plausibility.max_bristle_travel_rad),
            "bristles, over their way"
        );
    }
}
