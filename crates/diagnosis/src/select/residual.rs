//! The residual of each joint against its noise, and whether an effect upholds its name with it.

use crate::effects::Kind;
use crate::effects::base_flexibility::Base;
use crate::fit::search::Search;
use crate::policy::POLICY;
use crate::select::adopted::Adopted;

/// Root mean squares by joint, on the runs looked at \[N·m\].
pub(crate) struct Residue<'a> {
    /// Before any effect was adopted.
    pub(crate) first: &'a [f64],
    /// With all of them.
    pub(crate) left: &'a [f64],
    /// Noise of the torque signal.
    pub(crate) floor: &'a [f64],
}

impl<'a> Residue<'a> {
    pub(crate) fn from_search(search: &'a Search<'_>) -> Residue<'a> {
        Residue { first: &search.first_noise, left: &search.noise, floor: &search.floor }
    }

    /// Whether more than noise is left on joint `j`.
    pub(crate) fn is_noisy(&self, j: usize) -> bool {
        self.left[j] > POLICY.adoption.unexplained_floor_ratio * self.floor[j]
    }

    /// Whether joint `j` kept more than noise before any effect was adopted.
    pub(crate) fn was_noisy(&self, j: usize) -> bool {
        self.first[j] > POLICY.adoption.unexplained_floor_ratio * self.floor[j]
    }

    pub(crate) fn any_noisy(&self) -> bool {
        (0..self.left.len()).any(|j| self.is_noisy(j))
    }

    /// Whether joint `j` keeps more than noise while the arm's others come down to theirs: something without a name is there.
    /// Where hardly any joint reaches its floor, as on measured arms, the floor is no measure.
    pub(crate) fn is_nameless(&self, j: usize) -> bool {
        let noisy = (0..self.left.len()).filter(|j| self.is_noisy(*j)).count();
        self.is_noisy(j) && 2 * noisy <= self.left.len()
    }

    /// Whether there is nothing left to explain.
    pub(crate) fn at_floor(&self) -> bool {
        self.left
            .iter()
            .zip(self.floor)
            .all(|(left, floor)| *left <= POLICY.adoption.max_floor_ratio_of_nothing_left * floor)
    }

    /// Share of joint `j`'s excess over its floor that was taken.
    fn explained(&self, j: usize) -> f64 {
        let floor = self.floor[j].powi(2);
        let (first, left) = (self.first[j].powi(2) - floor, self.left[j].powi(2) - floor);
        if first <= floor { 1.0 } else { 1.0 - left.max(0.0) / first }
    }

    /// Whether the joints that the effect is reported on are explained.
    pub(crate) fn upholds(&self, adopted: &Adopted) -> bool {
        let form = &adopted.form;
        if form.is_nameless() {
            return false;
        }
        let value = form.effect().kind() == Kind::Value;
        let least = |j: usize| match (form.is_simulated(), self.is_nameless(j)) {
            // A wrong value explains what it explains, unless something is left that it may only imitate.
            (_, false) if value => f64::NEG_INFINITY,
            // Torque over the angle fits to the noise, or it is another law.
            (_, true) if form.of_angle_alone() => f64::INFINITY,
            (true, _) => POLICY.adoption.min_explained_share_simulated,
            (false, true) => POLICY.adoption.min_explained_share_above_noise,
            // What wrong values took over before is not seen in the residual.
            (false, false) if form.hides() => 0.0,
            (false, false) => POLICY.adoption.min_explained_share,
        };
        if form.get::<Base>().is_some() {
            // It belongs to no joint, and is believed where it took something.
            return (0..adopted.shares.len())
                .all(|j| adopted.shares[j] < POLICY.adoption.min_base_share || self.explained(j) >= least(j));
        }
        form.joints().iter().all(|j| self.explained(*j) >= least(*j))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::angle_law::Pull;
    use crate::effects::coulomb_friction::Coulomb;
    use crate::effects::counterbalance::Counterbalance;
    use crate::effects::load_dependent_friction::Load;

    /// Four joints; the third keeps ten times its noise of a hundred: 99 % of its excess is explained.
    #[test]
    fn what_leaves_more_than_noise_is_named_only_where_it_may_be_inexact() {
        let (first, floor) = ([1.0, 1.0, 100.0, 1.0], [1.0; 4]);
        let residue = Residue { first: &first, left: &[1.0, 1.0, 10.0, 1.0], floor: &floor };
        assert!((0..4).map(|j| residue.is_nameless(j)).eq([false, false, true, false]));
        assert!(residue.upholds(&Adopted::alone(Load { joint: 2 }.into())));
        assert!(residue.upholds(&Adopted::alone(Coulomb { joint: 2 }.into())));
        assert!(!residue.upholds(&Adopted::alone(Pull { joint: 1, from: 0.2, above: true }.into())));
        assert!(!residue.upholds(&Adopted::alone(Counterbalance { joint: 2, arm: 0.5, phase: 0.0 }.into())));
        assert!(residue.upholds(&Adopted::alone(Counterbalance { joint: 1, arm: 0.5, phase: 0.0 }.into())));
        // Three quarters are not enough here, and neither is a wrong value that took that much.
        let residue = Residue { left: &[1.0, 1.0, 50.0, 1.0], ..residue };
        assert!(!residue.upholds(&Adopted::alone(Load { joint: 2 }.into())));
        assert!(!residue.upholds(&Adopted::alone(Coulomb { joint: 2 }.into())));
        // On an arm that reaches its floor nowhere they are.
        let residue = Residue { first: &[9.0, 9.0, 100.0, 9.0], left: &[9.0, 9.0, 50.0, 9.0], ..residue };
        assert!(residue.any_noisy() && !(0..4).any(|j| residue.is_nameless(j)));
        assert!(residue.upholds(&Adopted::alone(Load { joint: 2 }.into())));
        assert!(residue.upholds(&Adopted::alone(Coulomb { joint: 2 }.into())));
    }
}
