//! Prediction of the gap on the held-out run from its motion, before its torque is used.
//!
//! ```text
//! rms_k² = v + E_k        v: what the full model will leave
//!                         E_k: mean of d²·(1 + 2ρ(|q̇|)); d: what sets model k and the full model apart, along the sealed
//!                         motion
//! v = mean of v(|q̇|)      v(|q̇|): mean square that it leaves at that speed on the runs looked at
//! ρ(|q̇|) = Σ r·d / Σ d²   at that speed on the runs looked at; r: what the full model leaves
//! ```
//!
//! A fit makes r and d orthogonal, but not near standstill, where rows have no weight: there neither model is right.
//!
//! A motion that creeps more leaves more; how fast it goes is known from the motion alone. What counts as a row's speed is the largest about
//! it: a joint that turns round is at rest for a moment, and what friction then does is mixed with what it does beside it.
//!
//! A joint that stands on the sealed motion and hardly ever does on the runs looked at holds a part of its Coulomb friction that nobody
//! knows: what others hold, or a usual part of it, and anything from none to all of it in the interval.
//!
//! Motion of another kind shows effects that the runs looked at hide (a joint that sticks in a dwell, one that bends when it is fast). How
//! much of the time joints go at speeds that those hardly have is known as well, and widens the interval.
//!
//! The interval is that of a block bootstrap of coefficients and v, widened for what bootstraps do not know: inner values
//! and the form itself. v varies twice: it was learnt from some blocks, and the sealed motion has but some of its own. Most
//! of it comes from rows near standstill, which have no weight in the fit, so its blocks are of plain residuals.

use crate::fit::search::Search;
use crate::fit::stages::{RunColumns, Stages, Steps, mean_square};
use crate::model::log_fault::LogFault;
use crate::numerics::random::Random;
use crate::policy::POLICY;
use nalgebra::DVector;
use rivet_dynamics::Places;

/// Speeds are told apart by half decades, this many, from ten to the minus `SLOWEST` rad/s on.
const SPEED_BINS: usize = 9;
const SLOWEST: f64 = 3.5;
/// What a joint that stands holds beside the model, as a share of its Coulomb friction, where the runs looked at have not shown it; and from
/// where to where. (Rms of a measured UR10e 0.3 to 0.6, of a KUKA 1 to 1.7; of simulators that stick 0.5 to 0.9, of one that creeps 0.03.)
const STICTION_SHARE_RANGE: [f64; 2] = [0.0, 1.2];

/// Predictions before the sealed torque is looked at.
pub(crate) struct Prediction {
    /// Shrink of each cause with the ends of its interval.
    pub(crate) shrink: Vec<(f64, f64, f64)>,
    /// By how much an interval of a shrink is wider on either side when it is told, because the sealed motion is of another kind.
    pub(crate) wider: f64,
    /// Share of the time for which joints go at speeds on the sealed motion at which they are less often on the runs looked at, where it is.
    pub(crate) of_another_kind: Option<f64>,
    /// Gap after each stage, the model as given first, with the ends of its interval.
    pub(crate) gaps: Vec<(f64, f64, f64)>,
    /// 90 % interval of each coefficient over the resamplings.
    pub(crate) coefficients: Vec<(f64, f64)>,
    /// Deviations of the coefficients from their estimate, by resampling.
    pub(crate) deviations: Vec<DVector<f64>>,
}

/// A model that was fitted to the training runs, step by step.
pub(crate) struct Fitted<'a> {
    /// Nominal standard vector.
    pub(crate) nominal: &'a [f64],
    /// Columns that each step adds.
    pub(crate) steps: &'a Steps,
    /// Coefficients of the columns.
    pub(crate) x: &'a DVector<f64>,
    /// Prior means that the design took out of the coefficients.
    pub(crate) means: &'a [f64],
}

/// Predicts gaps and shrinks on the sealed motion; `silent`: columns whose torque its motion does not determine. None where the
/// equations of a resampling have no solution.
pub(crate) fn predict(
    search: &Search<'_>,
    seen: &[RunColumns<'_>],
    sealed: &RunColumns<'_>,
    fitted: &Fitted<'_>,
    silent: &[usize],
) -> Option<Prediction> {
    let policy = &POLICY.prediction;
    let Fitted { nominal, steps, x, means } = *fitted;
    let blocks = search.design.background.blocks();
    let mut without_silent = x.clone();
    for c in silent {
        without_silent[*c] = -means[*c];
    }
    let joints = sealed.run.floor.len();
    let friction = (0..joints).map(|j| Places::new(joints).coulomb(j)).map(|c| nominal[c] + x[c] + means[c]).collect();
    let rest =
        Leaves::new(seen, sealed, |run| run.stages(nominal, steps, &without_silent, means), steps.len(), friction);
    let every: Vec<usize> = (0..rest.blocks.len()).collect();
    let v = rest.on_sealed(&every, policy.stiction_share);
    let full = sealed.stages(nominal, steps, x, means);
    let reference = &full.models[steps.len()];
    let square: Vec<f64> = mean_square(reference).iter().zip(&v).map(|(m, v)| m + v).collect();
    let gaps = |stages: &Stages, v: &[f64]| -> Vec<f64> {
        stages
            .models
            .iter()
            .enumerate()
            .map(|(k, model)| {
                let e: Vec<f64> = (0..v.len()).map(|j| rest.apart(k, j, &model[j], &reference[j])).collect();
                let mean: f64 = (0..v.len()).map(|j| (v[j] + e[j]) / square[j].max(f64::MIN_POSITIVE)).sum();
                // As in the gap itself, joints without torque do not count.
                (mean / square.iter().filter(|s| **s > 0.0).count() as f64).sqrt()
            })
            .collect()
    };
    let shrinks = |gaps: &[f64]| -> Vec<f64> { gaps.windows(2).map(|w| 1.0 - w[1] / w[0]).collect() };
    let first = gaps(&full, &v);
    let central = shrinks(&first);
    let mut random = Random::new();
    let mut samples: Vec<Vec<f64>> = Vec::new();
    let (mut gaps_again, mut x_again): (Vec<Vec<f64>>, Vec<Vec<f64>>) = (Vec::new(), Vec::new());
    for _ in 0..policy.resamplings {
        let chosen: Vec<usize> = (0..blocks).map(|_| random.below(blocks)).collect();
        let again = search.design.background.solve(&search.weights, search.scale, &chosen)?.x;
        let [from, to] = STICTION_SHARE_RANGE;
        let standing_share = from + (to - from) * random.below(1000) as f64 / 999.0;
        let mut drawn = |count: usize| -> Vec<f64> {
            let drawn_blocks: Vec<usize> = (0..count).map(|_| random.below(every.len())).collect();
            rest.on_sealed(&drawn_blocks, standing_share)
        };
        let (learnt, met) = (drawn(every.len()), drawn(rest.sealed_blocks));
        let so_held = rest.on_sealed(&every, standing_share);
        let varied = so_held.iter().zip(learnt.iter().zip(&met));
        let v_again: Vec<f64> =
            varied.map(|(v, (a, b))| (a + b - v).clamp(v / policy.max_variation, v * policy.max_variation)).collect();
        let drawn_gaps = gaps(&sealed.stages(nominal, steps, &again, means), &v_again);
        samples.push(shrinks(&drawn_gaps));
        gaps_again.push(drawn_gaps);
        x_again.push(again.iter().copied().collect());
    }
    let shrink = central
        .iter()
        .enumerate()
        .take(steps.len() - 1)
        .map(|(k, central)| {
            let (low, high) = ends_of(&samples, k);
            (*central, low.min(*central) - policy.widening, (high.max(*central) + policy.widening).min(1.0))
        })
        .collect();
    let of_another_kind = Some(rest.of_another_kind()).filter(|share| *share > policy.max_speed_difference);
    let wider =
        of_another_kind.map_or(0.0, |share| policy.widening_by_difference * (share - policy.max_speed_difference));
    let gaps = first
        .iter()
        .enumerate()
        .map(|(k, central)| {
            let (low, high) = ends_of(&gaps_again, k);
            // A shrink is a part of the gap before it.
            let wider = wider * first[k.saturating_sub(1)];
            (*central, (low.min(*central) - wider).max(0.0), high.max(*central) + wider)
        })
        .collect();
    let coefficients = (0..x.len()).map(|k| ends_of(&x_again, k)).collect();
    let deviations = x_again.into_iter().map(|again| DVector::from_vec(again) - x).collect();
    Some(Prediction { shrink, wider, of_another_kind, gaps, coefficients, deviations })
}

/// Ends of the interval of entry `k` over the resamplings.
fn ends_of(samples: &[Vec<f64>], k: usize) -> (f64, f64) {
    ends(samples.iter().map(|s| s[k]).collect()).unwrap_or((f64::NAN, f64::NAN))
}

/// Ends of the 90 % interval of draws; none without draws.
pub(crate) fn ends(mut draws: Vec<f64>) -> Option<(f64, f64)> {
    draws.sort_by(f64::total_cmp);
    let end = |share: f64| draws.get((draws.len().saturating_sub(1) as f64 * share).round() as usize).copied();
    end(POLICY.prediction.tail).zip(end(1.0 - POLICY.prediction.tail))
}

/// Squares and rows of a block's residual, `[joint][speed]`.
type Bins = Vec<[[f64; 2]; SPEED_BINS]>;

/// What the full model leaves on the runs looked at, block by block and speed by speed.
struct Leaves {
    blocks: Vec<Bins>,
    /// Blocks that the sealed run has.
    sealed_blocks: usize,
    /// Share of the sealed run's rows at each speed, by joint.
    speeds: Vec<[f64; SPEED_BINS]>,
    /// Speed of each row of the sealed run, `[joint][row]`.
    rows: Vec<Vec<usize>>,
    /// ρ by stage, joint and speed.
    cross: Vec<Vec<[f64; SPEED_BINS]>>,
    /// Coulomb friction by joint \[N m\].
    friction: Vec<f64>,
}

impl Leaves {
    fn new<'a>(
        seen: &'a [RunColumns<'a>],
        sealed: &RunColumns<'_>,
        stages: impl Fn(&'a RunColumns<'a>) -> Stages,
        last: usize,
        friction: Vec<f64>,
    ) -> Leaves {
        let joints = sealed.run.floor.len();
        let count = |run: &RunColumns<'_>| {
            let whole = run.run.rows() as f64 * run.run.chain.row_period_s / POLICY.prediction.block_s;
            (whole as usize).max(POLICY.prediction.min_run_blocks)
        };
        let mut blocks = Vec::new();
        // Products of what is left with what sets stages apart, and squares of the latter.
        let mut products = vec![vec![[[0.0; 2]; SPEED_BINS]; joints]; last + 1];
        for run in seen {
            let (own, count) = (stages(run), count(run));
            let first = blocks.len();
            blocks.resize(first + count, vec![[[0.0; 2]; SPEED_BINS]; joints]);
            for j in 0..joints {
                if run.run.silent[j].is_some() {
                    continue;
                }
                let at_rows = bins_of(run, j);
                let rows = own.tau[j].len();
                for (k, ((tau, model), at)) in own.tau[j].iter().zip(&own.models[last][j]).zip(at_rows).enumerate() {
                    let bin = &mut blocks[first + k * count / rows.max(1)][j][at];
                    bin[0] += (tau - model).powi(2);
                    bin[1] += 1.0;
                    for (products, stage) in products.iter_mut().zip(&own.models) {
                        let apart = model - stage[j][k];
                        products[j][at][0] += (tau - model) * apart;
                        products[j][at][1] += apart * apart;
                    }
                }
            }
        }
        let rows: Vec<Vec<usize>> = (0..joints).map(|j| bins_of(sealed, j)).collect();
        // A joint that does not count on the sealed run leaves nothing on it.
        let share = |(rows, silent): (&Vec<usize>, &Option<LogFault>)| {
            let mut speed_shares = [0.0; SPEED_BINS];
            for bin in rows.iter().filter(|_| silent.is_none()) {
                speed_shares[*bin] += 1.0 / rows.len() as f64;
            }
            speed_shares
        };
        let speeds = rows.iter().zip(&sealed.run.silent).map(share).collect();
        // Below -1/2 a stage would be better than the full model.
        let ratio = |[product, square]: [f64; 2]| (product / square.max(f64::MIN_POSITIVE)).clamp(-0.5, 0.5);
        let cross =
            products.into_iter().map(|joints| joints.into_iter().map(|bins| bins.map(ratio)).collect()).collect();
        Leaves { blocks, sealed_blocks: count(sealed), speeds, rows, cross, friction }
    }

    /// E of stage `k` on joint `j`, between its model and the full one along the sealed motion.
    fn apart(&self, k: usize, j: usize, model: &[f64], full: &[f64]) -> f64 {
        let rows = model.iter().zip(full).zip(&self.rows[j]);
        let sum: f64 = rows.map(|((a, b), bin)| (a - b).powi(2) * (1.0 + 2.0 * self.cross[k][j][*bin])).sum();
        sum / model.len().max(1) as f64
    }

    /// How much of the time joints go at speeds on the sealed motion at which they are less often on the runs looked at.
    fn of_another_kind(&self) -> f64 {
        let joint = |(j, speeds): (usize, &[f64; SPEED_BINS])| {
            let rows = |bin: usize| self.blocks.iter().map(|block| block[j][bin][1]).sum::<f64>();
            let all: f64 = (0..SPEED_BINS).map(rows).sum();
            let more = |(bin, share): (usize, &f64)| (share - rows(bin) / all).max(0.0);
            (all > 0.0 && speeds.iter().any(|share| *share > 0.0))
                .then(|| speeds.iter().enumerate().map(more).sum::<f64>())
        };
        let joints: Vec<f64> = self.speeds.iter().enumerate().filter_map(joint).collect();
        joints.iter().sum::<f64>() / joints.len().max(1) as f64
    }

    /// Mean square by joint on the sealed motion, if each speed leaves what it left in the blocks `of`, and a joint that stands `held` of its
    /// Coulomb friction where those hardly show it.
    fn on_sealed(&self, of: &[usize], held: f64) -> Vec<f64> {
        let sum = |j: usize, bin: usize| {
            of.iter().fold([0.0; 2], |s, b| [s[0] + self.blocks[*b][j][bin][0], s[1] + self.blocks[*b][j][bin][1]])
        };
        let all: Vec<[[f64; 2]; SPEED_BINS]> =
            (0..self.speeds.len()).map(|j| std::array::from_fn(|bin| sum(j, bin))).collect();
        // Mean square in units of friction's, over all joints that stand: what holds one holds another.
        let standing: [f64; POLICY.prediction.standing_speeds] = std::array::from_fn(|bin| {
            let with_friction = self.friction.iter().zip(&all).filter(|(friction, _)| **friction > 0.0);
            let [square, rows] = with_friction.fold(
                [POLICY.prediction.prior_rows * held * held, POLICY.prediction.prior_rows],
                |[square, rows], (friction, bins)| {
                    // More than friction bears is left by something else.
                    let most = STICTION_SHARE_RANGE[1].powi(2) * bins[bin][1];
                    [square + (bins[bin][0] / (friction * friction)).min(most), rows + bins[bin][1]]
                },
            );
            square / rows
        });
        let joint = |(j, speeds): (usize, &[f64; SPEED_BINS])| -> f64 {
            let bins = &all[j];
            // Few rows at a speed say little: what is left at the next faster one counts as so many more.
            let fastest =
                bins.iter().rposition(|[_, rows]| *rows >= POLICY.prediction.prior_rows).unwrap_or(SPEED_BINS - 1);
            let at_most = bins[fastest][0] / bins[fastest][1].max(1.0);
            let mut at = at_most;
            let slower = bins[..=fastest].iter().zip(speeds).enumerate().rev().map(|(bin, ([square, rows], share))| {
                if let Some(standing) = standing.get(bin).filter(|_| self.friction[j] > 0.0) {
                    at = standing * self.friction[j].powi(2);
                }
                at = (square + POLICY.prediction.prior_rows * at) / (rows + POLICY.prediction.prior_rows);
                share * at
            });
            slower.sum::<f64>() + at_most * speeds[fastest + 1..].iter().sum::<f64>()
        };
        self.speeds.iter().enumerate().map(joint).collect()
    }
}

/// Which half decade the largest speed about each row is in.
fn bins_of(run: &RunColumns<'_>, j: usize) -> Vec<usize> {
    let speed = run.run.chain.sample(&run.run.motion.qd[j]);
    let about = (POLICY.prediction.speed_window_s / run.run.chain.row_period_s).round() as usize;
    let largest = |k: usize| {
        let rows = &speed[k.saturating_sub(about)..(k + about + 1).min(speed.len())];
        rows.iter().fold(0.0_f64, |most, v| most.max(v.abs()))
    };
    (0..speed.len()).map(|k| bin_of(largest(k))).collect()
}

/// Which half decade a speed \[rad/s\] is in.
fn bin_of(speed: f64) -> usize {
    ((speed.abs().max(1e-9).log10() + SLOWEST) * 2.0).clamp(0.0, (SPEED_BINS - 1) as f64) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One joint of 10 N m that moves with 0.5 N m left, and stands for `stood` rows with 1 N m left; half of the sealed motion it stands.
    fn leaves(stood: f64, friction: f64) -> Leaves {
        let mut bins = [[0.0; 2]; SPEED_BINS];
        bins[0] = [stood, stood];
        bins[6] = [0.25 * 1000.0, 1000.0];
        let mut speeds = [0.0; SPEED_BINS];
        (speeds[0], speeds[6]) = (0.5, 0.5);
        Leaves {
            blocks: vec![vec![bins]],
            sealed_blocks: 1,
            speeds: vec![speeds],
            rows: Vec::new(),
            cross: Vec::new(),
            friction: vec![friction],
        }
    }

    fn left(stood: f64, friction: f64, held: f64) -> f64 {
        leaves(stood, friction).on_sealed(&[0], held)[0]
    }

    #[test]
    fn what_a_joint_holds_unseen_goes_by_its_friction() {
        assert!((left(0.0, 10.0, 0.6) - (0.5 * 36.0 + 0.5 * 0.25)).abs() < 1e-9);
        assert!((left(0.0, 0.0, 0.6) - 0.25).abs() < 1e-9, "without friction what it leaves in motion");
        let seen = left(5000.0, 10.0, 0.6);
        assert!((seen - (0.5 * 1.0 + 0.5 * 0.25)).abs() < 0.01, "{seen}: what was seen decides");
    }

    /// A joint that never stood holds the part of its friction that another one holds.
    #[test]
    fn what_holds_one_joint_holds_another() {
        let (mut both, other) = (leaves(0.0, 10.0), leaves(5000.0, 5.0));
        both.blocks[0].extend(other.blocks[0].clone());
        both.speeds.extend(other.speeds);
        both.friction.extend(other.friction);
        let first = both.on_sealed(&[0], 0.6)[0];
        // 1 N m of 5: 2 of 10.
        assert!((first - (0.5 * 4.0 + 0.5 * 0.25)).abs() < 0.1, "{first}");
        // A torque that is no torque leaves hundreds of times its friction.
        both.friction[1] = 0.01;
        let first = both.on_sealed(&[0], 0.6)[0];
        assert!((first - (0.5 * 144.0 + 0.5 * 0.25)).abs() < 0.5, "{first}: no more than friction bears");
    }
}
