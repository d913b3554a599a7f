//! Whether a joint's friction turns over with a state of its own, or something is dragged along beside it.
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

use crate::form::{Form, MOST_TRAVEL};
use crate::physics::Physics;
use crate::search::{Candidate, Search, Standing};

/// From this share on the state is the joint's friction. Bristles of three other programs have 0.77 to 1.00, hoses with 0.3 to three times
/// the joint's own friction 0.26 to 0.74.
const WHOLE: f64 = 0.75;

/// What a form with such a state is by its share of the joint's friction.
pub(crate) enum Kind {
    /// Another form, or what it is called.
    AsNamed,
    /// Bristles that are only a part of the friction: this instead.
    Beside(Box<(Candidate, Standing)>),
    /// Bristles indeed, over the way that they have with both levels free.
    Of(Box<(Candidate, Standing)>),
    /// Something beside friction that is all of it: bristles, which stand for themselves.
    Bristles,
}

/// Looks at a form that was refined; none where the equations have no solution.
pub(crate) fn kind(
    search: &Search<'_>,
    physics: &[Physics<'_>],
    (candidate, standing): (&Candidate, &Standing),
    say: &mut dyn FnMut(&str),
) -> Option<Kind> {
    let (joint, free) = match candidate.form {
        Form::Presliding { joint, length } => (joint, search.refine(&Form::Hysteresis { joint, length }, physics)),
        Form::Hysteresis { joint, .. } => (joint, Some((candidate.clone(), standing.clone()))),
        _ => return Some(Kind::AsNamed),
    };
    // Bristles' form holds, that with both levels does not: they are bristles.
    let Some((candidate_free, standing_free)) = free else { return Some(Kind::AsNamed) };
    let at = physics.first()?.coulomb(joint);
    let c = &standing_free.added.c;
    let beside = (search.nominal.x[at] + standing_free.added.x[at] + c[1]).max(0.0);
    let share = c[0] / (c[0] + beside);
    say(&format!("  {:?}: {share:.3} of the friction of joint {}", candidate_free.form, joint + 1));
    Some(match candidate.form {
        Form::Presliding { .. } if share < WHOLE => {
            Kind::Beside(Box::new((candidate_free, Standing { at: standing.at, ..standing_free })))
        }
        Form::Presliding { .. } => {
            let Form::Hysteresis { length, .. } = candidate_free.form else { return Some(Kind::AsNamed) };
            let Some(own) = search.candidate(Form::Presliding { joint, length }, physics) else {
                return Some(Kind::AsNamed);
            };
            let own_standing = search.standing(standing.at, &own, &search.scales());
            own_standing.map_or(Kind::AsNamed, |its| Kind::Of(Box::new((own, its))))
        }
        Form::Hysteresis { length, .. } if share >= WHOLE && length < MOST_TRAVEL => Kind::Bristles,
        _ => Kind::AsNamed,
    })
}
