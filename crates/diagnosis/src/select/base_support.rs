//! Whether the runs support a mode of the base.

use crate::effects::base_flexibility::Base;
use crate::effects::physics::Physics;
use crate::effects::physics::base_mode::{LOWEST_MODE_HZ, MODE_DAMPING_RANGE, Mode};
use crate::fit::search::Search;
use crate::policy::POLICY;

/// Whether several joints feel the base and none is worse, from the share of each joint's variance that it takes held out.
pub(crate) fn is_felt(shares: &[f64]) -> bool {
    shares.iter().filter(|s| **s >= POLICY.adoption.min_base_share).count() >= POLICY.adoption.min_joints_of_base
        && shares.iter().all(|s| *s > -POLICY.adoption.max_base_loss)
}

/// Whether the runs tell the frequency of a mode with this gain: it is not the highest or lowest that is looked for, others
/// explain less, and it is not damped as much as may be.
pub(crate) fn is_frequency_identified(search: &Search<'_>, mode: &Mode, gain: f64, physics: &[Physics<'_>]) -> bool {
    let solved = search.scales();
    let behind = |hz: f64| {
        let elsewhere = search.candidate(Base { mode: Mode { hz, ..*mode } }.into(), physics);
        let standing = elsewhere.and_then(|candidate| search.standing(0, &candidate, &solved));
        standing.is_none_or(|standing| standing.gain < gain - POLICY.adoption.min_base_frequency_gain)
    };
    let inside = mode.hz > 1.01 * LOWEST_MODE_HZ
        && mode.hz < 0.99 * mode.highest_hz
        && mode.damping < 0.99 * MODE_DAMPING_RANGE.1;
    inside
        && [POLICY.plausibility.min_frequency_ratio, 1.0 / POLICY.plausibility.min_frequency_ratio]
            .iter()
            .all(|factor| behind(mode.hz * factor))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A little on three joints is what the gear of one leaves on its neighbours.
    #[test]
    fn two_joints_feel_a_base_and_none_is_worse_with_it() {
        assert!(is_felt(&[0.5, 0.4, 0.0, -0.01]));
        for shares in [[0.11, 0.09, 0.11, 0.04], [0.9, 0.2, 0.0, 0.0], [0.9, 0.9, 0.9, -0.1]] {
            assert!(!is_felt(&shares), "{shares:?}");
        }
    }
}
