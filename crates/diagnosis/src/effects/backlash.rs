//! Play between motor and link: a gear of `joint_elasticity` that is loose over a gap.

use crate::effects::Kind;
use crate::effects::about::About;
use crate::effects::two_mass::Gear;
use crate::effects::variable::Variable;

/// Play \[rad\].
const GAPS: [f64; 6] = [3e-4, 1e-3, 2e-3, 4e-3, 8e-3, 1.6e-2];
/// Contact resonance of a gear with play \[Hz\].
const CONTACTS: [f64; 3] = [12.0, 30.0, 75.0];
/// Damping ratio of the contact.
const CONTACT_DAMPING: f64 = 0.25;

pub(super) const ABOUT: About = About {
    variable: [Variable::SignedLoad; 2],
    motion: "slow reversals of the load without reversal of the speed",
    is_inexact: true,
    ..About::new("backlash", Kind::Structure)
};

/// First step of each inner value as a factor, with its place.
pub(super) const STEPS: [(usize, f64); 3] = [(2, 1.4), (0, 1.6), (1, 1.6)];

/// Loose gears before a link side of that inertia \[kg·m²\].
pub(super) fn gears(link: f64) -> impl Iterator<Item = Gear> {
    let stiffness = move |hz: f64| link * (std::f64::consts::TAU * hz).powi(2);
    let of_contact =
        move |hz: f64| GAPS.map(move |gap| Gear { stiffness: stiffness(hz), damping: CONTACT_DAMPING, gap });
    CONTACTS.into_iter().flat_map(of_contact)
}
