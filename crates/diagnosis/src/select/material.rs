//! How much of a joint an effect has to take to be worth a name.

use crate::form::Form;
use crate::search::{Candidate, Search};

use crate::adopted::{AT_FLOOR, Adopted};

/// Least share of a joint's residual variance, held out, that makes a structural effect material.
const MATERIAL: f64 = 0.1;
/// The same on a joint that is near its floor: a sound arm's friction near standstill takes up to a sixth there.
const MATERIAL_AT_FLOOR: f64 = 0.3;
/// The same where its evidence is overwhelming: what friction near standstill takes on a sound arm is not as plain.
const MATERIAL_IF_PLAIN: f64 = 0.15;
/// Gain of log evidence that is overwhelming.
const PLAIN: f64 = 100.0;
/// Least share of the variance a joint began with, for a further effect.
const MATERIAL_OF_FIRST: f64 = 0.02;
/// The same on joints where the torque of a simulated gear, delay or bristle is in use already: such forms are never
/// exact, and what they miss is not another effect.
const MATERIAL_BESIDE_SIMULATED: f64 = 0.12;

/// Share of each joint's residual variance that a candidate removes on blocks it was not fitted to.
pub(super) fn held_out_shares(search: &Search<'_>, candidate: &Candidate) -> Option<Vec<f64>> {
    let gains = search.held_out(candidate)?;
    let joints = search.noise.len();
    let share = |j: usize| {
        let rows: f64 = search.design.background.folds.iter().map(|f| f[j].rows).sum();
        gains.iter().map(|g| g[j]).sum::<f64>() / (rows * search.noise[j].powi(2))
    };
    Some((0..joints).map(share).collect())
}

/// Share of a joint near its floor that makes an effect material.
fn least_at_floor(form: &Form, gain: f64) -> f64 {
    // An order is taken where the residual has most of it, and evidence is no measure of that.
    let plain = gain >= PLAIN && form.order().is_none();
    if plain { MATERIAL_IF_PLAIN } else { MATERIAL_AT_FLOOR }
}

/// Whether a form of which a joint is relieved by these `shares`, held out, is worth a name beside what was adopted.
pub(super) fn is_material(
    search: &Search<'_>,
    (form, gain): (&Form, f64),
    shares: &[f64],
    adopted: &[Adopted],
) -> bool {
    let at_floor = least_at_floor(form, gain);
    (0..shares.len()).any(|j| {
        let residual_variance = search.noise[j].powi(2);
        let simulated = adopted.iter().any(|a| a.form.is_simulated() && a.acts_on[j]);
        let of_first = if simulated { MATERIAL_BESIDE_SIMULATED } else { MATERIAL_OF_FIRST };
        let enough = adopted.is_empty() || shares[j] * residual_variance >= of_first * search.first_noise[j].powi(2);
        // A command that is cut explains the noise of the torque by itself.
        let little = !form.has_fixed_gain() && shares[j] >= at_floor;
        let above = search.noise[j] > AT_FLOOR * search.floor[j] || little;
        shares[j] >= MATERIAL && above && enough
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Stribeck friction beside wrong levels: 0.17 and 0.23 of its joint, with an evidence of 128 to 194.
    #[test]
    fn near_the_floor_plain_evidence_makes_less_material() {
        let stribeck = Form::Stribeck { joint: 3, velocity: 0.06 };
        assert!(least_at_floor(&stribeck, 128.0) < 0.17 && least_at_floor(&stribeck, 90.0) > 0.23);
        assert!(least_at_floor(&Form::PositionFriction { joint: 0, order: 294.7 }, 134.0) > 0.26);
    }
}
