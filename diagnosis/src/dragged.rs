//! Whether a joint's friction turns over with a state of its own, or something is dragged along beside it.
//!
//! Bristles are the friction of the joint: before it slides all of its Coulomb level is a spring's. A hose or a cable that gives way is beside
//! that friction, which sticks and slips as before. Both have one column, `z − s` with a free Coulomb level, over any length:
//!
//! ```text
//! bristles: F·z = F·s + F·(z − s)           beside: F·s + H·z = (F + H)·s + H·(z − s)
//! ```
//!
//! so what tells them apart is the share of the whole level that is the spring's.

use crate::form::Form;
use crate::physics::Physics;
use crate::search::{Candidate, Search, Standing};

/// From this share of the joint's whole Coulomb level on the state is its friction. Bristles of two other programs came out with 0.93
/// to 1.01, hoses beside friction with 0.26 to 0.72.
const WHOLE: f64 = 0.85;

/// What a presliding friction is if it is only a part of the joint's friction; none where it is all of it, or another effect.
pub(crate) fn instead(
    search: &Search<'_>,
    physics: &[Physics<'_>],
    candidate: &Candidate,
    standing: &Standing,
) -> Option<(Candidate, Standing)> {
    let Form::Presliding { joint, length } = candidate.form else { return None };
    let at = physics.first()?.coulomb(joint);
    let own = standing.added.c[0] * physics.first()?.x[at].abs();
    let whole = (search.nominal.x[at] + standing.added.x[at]).abs();
    if own >= WHOLE * whole {
        return None;
    }
    let dragged = search.candidate(Form::Hysteresis { joint, length }, physics)?;
    let standing = search.standing(standing.at, &dragged, &search.scales())?;
    Some((dragged, standing))
}
