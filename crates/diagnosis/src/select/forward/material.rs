//! Material effects: the least share of a joint's held-out variance that a name requires.

use crate::effects::Form;
use crate::fit::search::{Candidate, Search};
use crate::policy::POLICY;

use crate::select::adopted::Adopted;

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
    let plain = gain >= POLICY.adoption.overwhelming_gain && form.order().is_none();
    if plain { POLICY.adoption.min_material_share_if_plain } else { POLICY.adoption.min_material_share_at_floor }
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
        let of_first =
            if simulated { POLICY.adoption.min_share_beside_simulated } else { POLICY.adoption.min_share_of_first };
        let enough = adopted.is_empty() || shares[j] * residual_variance >= of_first * search.first_noise[j].powi(2);
        // A command that is cut explains the noise of the torque by itself.
        let little = !form.has_fixed_gain() && shares[j] >= at_floor;
        let above = search.noise[j] > POLICY.adoption.max_floor_ratio_of_little_left * search.floor[j] || little;
        shares[j] >= POLICY.adoption.min_material_share && above && enough
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::position_dependent_friction::PositionFriction;
    use crate::effects::stribeck_friction::Stribeck;

    /// Stribeck friction beside wrong levels: 0.17 and 0.23 of its joint, with an evidence of 128 to 194.
    #[test]
    fn near_the_floor_plain_evidence_makes_less_material() {
        let stribeck = Stribeck { joint: 3, velocity: 0.06 }.into();
        assert!(least_at_floor(&stribeck, 128.0) < 0.17 && least_at_floor(&stribeck, 90.0) > 0.23);
        assert!(least_at_floor(&PositionFriction { joint: 0, order: 294.7 }.into(), 134.0) > 0.26);
    }
}
