//! Shapley values: the share of the squared gap of each cause, independent of the order (Lindeman, Merenda & Gold 1980).
//!
//! ```text
//! v(S) = 1 − min over a of Σ_j ‖y_j − Σ_{k∈S} a_k t_kj‖² / ‖τ_j‖²  ÷  Σ_j ‖y_j‖²/‖τ_j‖²      y: torque less the model as given's
//! φ_k  = Σ_{S∌k} |S|!·(m−|S|−1)!/m!·(v(S∪k) − v(S))                   t_k: torque of cause k as found
//! ```
//!
//! Each subset of causes is fitted anew by the size of each; what is within a cause (friction of six joints, mass and centre of a load)
//! stays as found. Of two causes that explain the same each gets half, where the order of adding them gives all to the first. No φ_k is
//! negative, and their sum is v of all.

use nalgebra::{DMatrix, DVector};

use crate::fit::stages::Stages;

/// With more causes than this, 2^16 fits, no shares are told.
const MAX_PLAYERS: usize = 16;
/// What a cause has beyond those before it is rounding below this share of its squared torque.
const INDEPENDENT: f64 = 1e-9;

/// Products of the causes' torques over all runs, joints by the torque that they have.
struct Products {
    tt: DMatrix<f64>,
    ty: DVector<f64>,
    yy: f64,
}

/// Shares of the steps `players` (places in the order of `runs`' models, each against the one before), on the runs that were looked at;
/// none where there are too many.
pub(crate) fn shares(runs: &[Stages], players: &[usize]) -> Option<Vec<f64>> {
    let m = players.len();
    if m > MAX_PLAYERS {
        return None;
    }
    let products = Products::from_stages(runs, players);
    let values: Vec<f64> = (0..1_usize << m).map(|set| products.explained(set)).collect();
    Some((0..m).map(|k| shapley(&values, m, k)).collect())
}

impl Products {
    fn from_stages(runs: &[Stages], players: &[usize]) -> Products {
        let m = players.len();
        let mut sums = Products { tt: DMatrix::zeros(m, m), ty: DVector::zeros(m), yy: 0.0 };
        let joints = runs.first().map_or(0, |run| run.tau.len());
        for j in 0..joints {
            let size: f64 = runs.iter().flat_map(|run| &run.tau[j]).map(|t| t * t).sum();
            if size <= 0.0 {
                continue;
            }
            for run in runs {
                let mut t = DVector::zeros(m);
                for (row, tau) in run.tau[j].iter().enumerate() {
                    for (t, k) in t.iter_mut().zip(players) {
                        *t = run.models[k + 1][j][row] - run.models[*k][j][row];
                    }
                    let y = tau - run.models[0][j][row];
                    sums.tt.ger(1.0 / size, &t, &t, 1.0);
                    sums.ty.axpy(y / size, &t, 1.0);
                    sums.yy += y * y / size;
                }
            }
        }
        sums
    }

    /// Share of the squared gap that a set of causes (a bit each) explains: elimination, one cause after the other.
    fn explained(&self, set: usize) -> f64 {
        let members: Vec<usize> = (0..self.ty.len()).filter(|k| set >> k & 1 == 1).collect();
        let mut tt = self.tt.select_rows(&members).select_columns(&members);
        let mut ty = self.ty.select_rows(&members);
        let mut explained = 0.0;
        for k in 0..members.len() {
            if tt[(k, k)] <= INDEPENDENT * self.tt[(members[k], members[k])] {
                continue;
            }
            explained += ty[k] * ty[k] / tt[(k, k)];
            for i in k + 1..members.len() {
                let factor = tt[(i, k)] / tt[(k, k)];
                ty[i] -= factor * ty[k];
                for l in k + 1..members.len() {
                    tt[(i, l)] -= factor * tt[(k, l)];
                }
            }
        }
        explained / self.yy.max(f64::MIN_POSITIVE)
    }
}

/// Shapley value of player `k` of `m`, of the value of every set.
fn shapley(values: &[f64], m: usize, k: usize) -> f64 {
    // Of orders, those in which just this set comes before k: |S|!·(m−|S|−1)!/m!.
    let chance = |before: usize| (1..=before).map(|i| i as f64 / (m - i) as f64).product::<f64>() / m as f64;
    let chances: Vec<f64> = (0..m).map(chance).collect();
    let without = (0..values.len()).filter(|set| set >> k & 1 == 0);
    without.map(|set| chances[set.count_ones() as usize] * (values[set | 1 << k] - values[set])).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A run of one joint, `torques` of each step, and `torque` that is measured; the model as given has none.
    fn run(torque: &[f64], torques: &[Vec<f64>]) -> Stages {
        let mut models = vec![vec![vec![0.0; torque.len()]]];
        for step in torques {
            let last: Vec<f64> = models[models.len() - 1][0].iter().zip(step).map(|(a, b)| a + b).collect();
            models.push(vec![last]);
        }
        Stages { tau: vec![torque.to_vec()], models, turned: Vec::new() }
    }

    /// Of y = a·t1 + b·t2 + e, sizes 1, correlation r: v({1}) = (a + rb)²/‖y‖², v({2}) = (b + ra)²/‖y‖², v(both) = (a² + b² + 2abr)/‖y‖²,
    /// and the first gets half of v({1}) + v(both) − v({2}).
    #[test]
    fn two_that_overlap_share_in_closed_form() {
        let (a, b, r) = (1.0, 0.5, 0.6_f64);
        let [t1, t2] = [vec![1.0, 0.0, 0.0], vec![r, (1.0 - r * r).sqrt(), 0.0]];
        let y: Vec<f64> = (0..3).map(|k| a * t1[k] + b * t2[k] + if k == 2 { 0.7 } else { 0.0 }).collect();
        let all = a * a + b * b + 2.0 * a * b * r + 0.49;
        let both = (all - 0.49) / all;
        let [one, two] = [(a + r * b).powi(2) / all, (b + r * a).powi(2) / all];
        let found = shares(&[run(&y, &[t1.clone(), t2.clone()])], &[0, 1]).expect("two causes");
        assert!((found[0] - 0.5 * (one + both - two)).abs() < 1e-12, "{found:?}");
        assert!((found.iter().sum::<f64>() - both).abs() < 1e-12);
        // Whatever the order and the size that they were found with.
        let half: Vec<f64> = t1.iter().map(|t| 0.5 * t).collect();
        let turned = shares(&[run(&y, &[t2, half])], &[0, 1]).expect("two causes");
        assert!((turned[0] - found[1]).abs() < 1e-12 && (turned[1] - found[0]).abs() < 1e-12);
    }

    /// Efficiency, symmetry and the player that adds nothing, of three causes on two runs; a step that is no player does not count.
    #[test]
    fn shares_add_up_and_equals_get_equal_shares() {
        let wave = |hz: f64, at: f64| -> Vec<f64> { (0..200).map(|k| (0.1 * hz * f64::from(k) + at).sin()).collect() };
        let torque = |t: &[Vec<f64>]| -> Vec<f64> { (0..200).map(|k| t[0][k] + t[1][k] + 0.3 * t[2][k]).collect() };
        let steps = |at: f64| [wave(1.0, at), wave(1.0, at), wave(2.3, at), wave(7.0, at)];
        let runs = [0.0, 0.4].map(|at| run(&torque(&steps(at)), &steps(at)));
        let found = shares(&runs, &[0, 1, 2]).expect("three causes");
        let all = Products::from_stages(&runs, &[0, 1, 2]).explained(0b111);
        assert!((all - 1.0).abs() < 1e-9 && (found.iter().sum::<f64>() - all).abs() < 1e-9, "{found:?}");
        assert!((found[0] - found[1]).abs() < 1e-9 && found[2] < found[0], "{found:?}");
        let silent = shares(&[run(&wave(1.0, 0.0), &[wave(1.0, 0.0), vec![0.0; 200]])], &[0, 1]).expect("two");
        assert!(silent[1].abs() < 1e-12 && (silent[0] - 1.0).abs() < 1e-9, "{silent:?}");
        assert_eq!(shares(&runs, &[]), Some(Vec::new()));
    }
}
