//! The delay between torque and position, before anything is compared with the nominal model.
//!
//! A drive's torque comes before the motion that it makes; what lies between is an effect like another. Torque that comes *after*
//! the motion is none that an arm makes: it went through a filter, or has a clock of its own. Each joint's torque is fitted by all
//! values of the model, whatever the file says of them, and moved in time until that leaves least; the joints must agree.
//!
//! What is late is moved or not believed ([`alignment`]). Torque that comes *before* the motion by more than a drive's hold is a delay of the drive or a
//! lag of it ([`lateness`]; `select/delay_or_lag.rs` makes a candidate of it).

pub(crate) mod alignment;
pub(crate) mod lateness;

pub(crate) use lateness::SLOW_HZ;

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use crate::numerics::autocorrelation::correlation;
use crate::policy::POLICY;
use crate::screen::prepared::Prepared;

/// Moves in time that are tried \[s\], either way, and the step between them.
const STEP_S: f64 = 1e-3;
/// Rows that a joint has to have for each of its columns, and that are enough of any.
const MOST_ROWS: usize = 12_000;
/// Columns of size 1 that are as alike as this are one.
const RIDGE: f64 = 1e-9;

/// What is left of one joint's torque.
struct JointTiming {
    joint: usize,
    /// Sum of squares for every move, and for every time constant of a filter that is undone \[N²·m²\].
    moved: Vec<f64>,
    unfiltered: Vec<f64>,
    /// In these rows.
    rows: Vec<usize>,
    /// One over the variance at the best move, as far as rows are independent.
    weight: f64,
    /// Root mean square at the best move \[N·m\].
    rms: f64,
    /// The best move \[s\] and its standard deviation.
    late: f64,
    sigma: f64,
}

/// What a run says of its clock.
struct Timing {
    /// By which the arm's torque is late \[s\], and the standard deviation of that.
    late: f64,
    sigma: f64,
    joints: Vec<JointTiming>,
}

/// What rows in which joints turn say of how much the arm follows its torque late.
pub(crate) struct Early {
    /// By how much, by all runs that say something; none where none does.
    pub(crate) pooled: Option<Pooled>,
    /// By how much \[s\], where all runs are sure that all of the arm is.
    pub(crate) sure: Option<f64>,
    /// What these rows are.
    pub(crate) parts: Vec<Part>,
}

/// Rows that are far from any reversal.
pub(crate) fn clear(runs: &[&Prepared]) -> Vec<Part> {
    parts(
        runs.iter()
            .enumerate()
            .filter_map(|(at, run)| Some((at, Timing::within(run, POLICY.timing.slow_turn_memory_s)?))),
    )
}

/// Whether runs, each with the least time that counts \[s\], are sure that all of the arm is behind its torque. One in which too few joints turn
/// says nothing of the arm, but neither may it be against what the others say.
fn are_sure<'t>(runs: impl Iterator<Item = (&'t Timing, f64)>) -> bool {
    let (arm, few): (Vec<_>, Vec<_>) = runs.partition(|(timing, least)| timing.late < 0.0 && timing.is_off(*least));
    let along = |timing: &Timing| arm.iter().all(|(other, _)| timing.is_along(other));
    !arm.is_empty() && few.iter().all(|(timing, _)| timing.is_of_few() && along(timing))
}

/// By how much the arm is behind its torque, by all runs together.
pub(crate) struct Pooled {
    /// \[s\]
    behind: f64,
    /// Standard deviation if runs say the same \[s\], ...
    sigma: f64,
    /// ... and with that by which they differ \[s\].
    apart: f64,
    /// What counts at least \[s\].
    least: f64,
    /// Whether in one run at least more than one joint tells: else it is that joint's time, and not the arm's.
    of_arm: bool,
}

impl Pooled {
    /// Of runs that say something; none where there are none. Runs are of one arm, so the surer of them say more. `least` counts \[s\].
    fn from_timings<'t>(runs: impl Iterator<Item = &'t Timing> + Clone, least: f64) -> Option<Pooled> {
        let others = runs.clone().count().checked_sub(1)?;
        let of_arm = runs.clone().any(|run| !run.is_of_few());
        let weight = |run: &Timing| run.sigma.powi(-2);
        let weights: f64 = runs.clone().map(weight).sum();
        let behind = -runs.clone().map(|run| weight(run) * run.late).sum::<f64>() / weights;
        let squares: f64 = runs.map(|run| weight(run) * (run.late + behind).powi(2)).sum();
        let sigma = weights.sqrt().recip();
        let apart = if others == 0 { sigma } else { sigma * (squares / others as f64).sqrt().max(1.0) };
        Some(Pooled { behind, sigma, apart, least, of_arm })
    }

    /// By how much at most \[s\]. Runs that differ are no reason to allow more: a name that is not there is worse than one that is missed.
    fn most(&self) -> f64 {
        self.behind + POLICY.timing.min_sigmas * self.sigma
    }

    /// Whether it surely is, by so much that it counts.
    fn is_sure(&self) -> bool {
        self.of_arm && self.behind - POLICY.timing.min_sigmas * self.apart > self.least
    }
}

fn parts(timings: impl Iterator<Item = (usize, Timing)>) -> Vec<Part> {
    let joint_parts = |(run, timing): (usize, Timing)| {
        timing.joints.into_iter().map(move |t| Part { run, joint: t.joint, rows: t.rows, weight: t.weight })
    };
    timings.flat_map(joint_parts).collect()
}

/// Rows of one joint in one run.
pub(crate) struct Part {
    pub(crate) run: usize,
    pub(crate) joint: usize,
    pub(crate) rows: Vec<usize>,
    /// One over the variance, as far as rows are independent.
    pub(crate) weight: f64,
}

impl Early {
    pub(crate) fn from_runs(runs: &[&Prepared]) -> Early {
        let timings: Vec<Option<Timing>> = runs.iter().map(|run| Timing::from_run(run)).collect();
        let least = |run: &Prepared| POLICY.timing.min_delay_s.max(POLICY.timing.free_samples * run.run.period_s);
        let pooled = Pooled::from_timings(
            timings.iter().flatten(),
            runs.iter().map(|run| least(run)).fold(POLICY.timing.min_delay_s, f64::max),
        );
        let timings: Option<Vec<Timing>> = timings.into_iter().collect();
        let Some(timings) = timings else {
            return Early { pooled, sure: None, parts: Vec::new() };
        };
        let sure = are_sure(runs.iter().zip(&timings).map(|(run, timing)| (timing, least(run))));
        let joints = || timings.iter().flat_map(|timing| &timing.joints);
        let now = nearest(0.0);
        let moved: Vec<f64> = (0..=now).map(|k| joints().map(|t| t.weight * t.moved[now - k]).sum()).collect();
        let places: Vec<f64> = (0..=now).map(|k| k as f64 * STEP_S).collect();
        let sure = lowest(&places, &moved).map(|(early, _)| early).filter(|_| sure);
        Early { pooled, sure, parts: parts(timings.into_iter().enumerate()) }
    }
}

impl Timing {
    /// Of all rows in which joints turn, unless those far from any reversal are against it, or have less than half of it: what they say is less, and
    /// true.
    fn from_run(run: &Prepared) -> Option<Timing> {
        let all = Self::within(run, 0.0);
        let Some(clear) = Self::within(run, POLICY.timing.turn_memory_s) else { return all };
        let half = |all: &Timing| all.late.abs() < POLICY.timing.min_delay_s || clear.late / all.late > 0.5;
        let agrees_apart = |all: &Timing| {
            // Joints that do not agree say nothing of the arm, whichever rows they have.
            let arm = all.late > POLICY.timing.min_delay_s && all.is_agreed(POLICY.timing.max_disagreement);
            !arm || clear.is_agreed(POLICY.timing.max_disagreement)
                || all.is_agreed(POLICY.timing.max_clock_disagreement)
        };
        let near = |all: &Timing| {
            (all.late - clear.late).abs() < POLICY.timing.min_sigmas * clear.sigma + 0.5 * POLICY.timing.min_delay_s
                && half(all)
                && agrees_apart(all)
        };
        // Behind a slow filter they are late as well, by another time.
        let filtered = |all: &Timing| {
            clear.late > 0.5 * all.late && all.late > POLICY.timing.min_sigmas * all.sigma && all.filter().is_some()
        };
        let agrees = |all: &Timing| near(all) || filtered(all);
        Some(all.filter(agrees).unwrap_or(clear))
    }

    fn within(run: &Prepared, clear_s: f64) -> Option<Timing> {
        let moves = moves();
        let trusted = (0..run.silent.len()).filter(|j| run.silent[*j].is_none());
        let joints: Vec<JointTiming> = trusted.filter_map(|j| JointTiming::from_run(run, j, &moves, clear_s)).collect();
        let all: Vec<f64> = (0..moves.len()).map(|k| joints.iter().map(|t| t.weight * t.moved[k]).sum()).collect();
        let (late, bend) = lowest(&moves, &all)?;
        Some(Timing { late, sigma: (2.0 / bend).sqrt(), joints })
    }

    /// Whether the arm as a whole is later than `least` \[s\].
    fn is_sure(&self, least: f64) -> bool {
        self.late > 0.0 && self.is_off(least)
    }

    /// Whether the arm as a whole is later or earlier by more than `least` \[s\].
    fn is_off(&self, least: f64) -> bool {
        let weighed_square = |late: f64| self.joints.iter().map(|t| t.weight * t.moved[nearest(late)]).sum::<f64>();
        self.late.abs() - POLICY.timing.min_sigmas * self.sigma > least
            && self.is_agreed(POLICY.timing.max_disagreement)
            && weighed_square(self.late) < (1.0 - POLICY.timing.min_residual_share) * weighed_square(0.0)
    }

    /// Whether the joints that tell agree but for this share of the time, and are not too few.
    fn is_agreed(&self, share: f64) -> bool {
        let informative = || self.joints.iter().filter(|t| t.gain(self.late).abs() > POLICY.timing.min_joint_evidence);
        let agrees = |t: &&JointTiming| t.gain(self.late) > 0.0 && (t.late - self.late).abs() < share * self.late.abs();
        let agree = informative().filter(agrees).count();
        agree >= POLICY.timing.min_joints && 2 * agree > informative().count()
    }

    /// Whether too few joints turn in it to say anything of the arm.
    fn is_of_few(&self) -> bool {
        self.joints.iter().filter(|t| t.gain(self.late).abs() > POLICY.timing.min_joint_evidence).count()
            < POLICY.timing.min_joints
    }

    /// Whether it is late by about the same time as another run.
    fn is_along(&self, other: &Timing) -> bool {
        (self.late - other.late).abs() < POLICY.timing.max_disagreement * other.late.abs()
    }

    /// Time constant \[s\] of the low-pass that explains better why torque is late than a clock does.
    fn filter(&self) -> Option<f64> {
        let all = |of: &dyn Fn(&JointTiming) -> f64| self.joints.iter().map(|t| t.weight * of(t)).sum::<f64>();
        let times: Vec<f64> = moves().into_iter().filter(|s| *s > -0.5 * STEP_S).collect();
        let unfiltered: Vec<f64> = (0..times.len()).map(|k| all(&|t| t.unfiltered[k])).collect();
        let (seconds, _) = lowest(&times, &unfiltered)?;
        let undone = unfiltered[(seconds / STEP_S).round() as usize];
        let moved = all(&|t| t.moved[nearest(self.late)]);
        (seconds > POLICY.timing.min_filter_s && undone < POLICY.timing.max_filter_residual_share * moved)
            .then_some(seconds)
    }

    /// Whether less is left with torque moved by that much than as it is.
    fn prefers(&self, late: f64) -> bool {
        self.joints.iter().map(|t| t.gain(late)).sum::<f64>() > 0.0
    }
}

impl JointTiming {
    fn from_run(run: &Prepared, j: usize, moves: &[f64], clear_s: f64) -> Option<JointTiming> {
        let equations = Equations::new(run, j, clear_s)?;
        let tau = run.chain.apply_later(&run.run.tau[j], moves);
        let now = nearest(0.0);
        let torque = |c: usize, k: usize| tau[c][k] - run.known_rows.get(j).map_or(0.0, |known| known[k]);
        let rows = &equations.rows;
        let y = DMatrix::from_fn(rows.len(), moves.len(), |r, c| torque(c, rows[r]));
        // A first-order low-pass is undone by its time constant times the rate.
        let rate = |k: usize| (tau[now + 1][k] - tau[now - 1][k]) / (2.0 * STEP_S);
        let z = DMatrix::from_fn(rows.len(), moves.len() - now, |r, c| {
            torque(now, rows[r]) + moves[now + c] * rate(rows[r])
        });
        let (moved, unfiltered) = (equations.residual_squares(&y)?, equations.residual_squares(&z)?);
        let (late, bend) = lowest(moves, &moved)?;
        let after = equations.residual(y.column(nearest(late)).into_owned());
        let variance = after.norm_squared() / rows.len() as f64;
        let weight = 1.0 / (variance * correlation(&[&after])).max(f64::MIN_POSITIVE);
        let sigma = (2.0 / (weight * bend)).sqrt();
        Some(JointTiming {
            joint: j,
            moved,
            unfiltered,
            rows: equations.rows,
            weight,
            rms: variance.sqrt(),
            late,
            sigma,
        })
    }

    /// By how much less is left with torque moved by `late` \[s\] than as it is, in units of the noise squared.
    fn gain(&self, late: f64) -> f64 {
        self.weight * (self.moved[nearest(0.0)] - self.moved[nearest(late)])
    }

    /// The same as a share of what is left.
    fn share(&self, late: f64) -> f64 {
        1.0 - self.moved[nearest(late)] / self.moved[nearest(0.0)].max(f64::MIN_POSITIVE)
    }
}

/// All values that one joint's torque depends on, in the rows in which it moves.
struct Equations {
    /// Columns of size 1.
    d: DMatrix<f64>,
    factor: Cholesky<f64, Dyn>,
    rows: Vec<usize>,
}

impl Equations {
    /// In rows that are so far from any in which it does not \[s\].
    fn new(run: &Prepared, j: usize, clear_s: f64) -> Option<Equations> {
        let speed = run.chain.sample(&run.motion.qd[j]);
        let usual = (speed.iter().map(|v| v * v).sum::<f64>() / speed.len().max(1) as f64).sqrt();
        let least = POLICY.timing.min_speed_rad_s.min(POLICY.timing.min_speed_share * usual).max(run.blur[j]);
        let moving: Vec<bool> = speed.iter().map(|v| v.abs() > least).collect();
        let reach = (clear_s / run.chain.row_period_s).round() as usize;
        let clear = |k: &usize| moving[k.saturating_sub(reach)..(k + reach + 1).min(moving.len())].iter().all(|m| *m);
        let rows: Vec<usize> = (0..run.rows()).filter(clear).take(MOST_ROWS).collect();
        let size = |column: &Vec<f64>| rows.iter().map(|k| column[*k].powi(2)).sum::<f64>().sqrt();
        let joint_columns = run.standard.iter().filter_map(|column| column[j].as_ref());
        let joint_columns: Vec<(&Vec<f64>, f64)> =
            joint_columns.map(|c| (c, size(c))).filter(|(_, size)| *size > 0.0).collect();
        if joint_columns.is_empty() || rows.len() < POLICY.timing.min_rows_per_column * joint_columns.len() {
            return None;
        }
        let d =
            DMatrix::from_fn(rows.len(), joint_columns.len(), |r, c| joint_columns[c].0[rows[r]] / joint_columns[c].1);
        let mut gram = d.tr_mul(&d);
        (0..gram.nrows()).for_each(|k| gram[(k, k)] += RIDGE);
        Some(Equations { factor: Cholesky::new(gram)?, d, rows })
    }

    /// Sums of squares that are left of each of several right-hand sides.
    fn residual_squares(&self, y: &DMatrix<f64>) -> Option<Vec<f64>> {
        let forward = self.factor.l_dirty().solve_lower_triangular(&self.d.tr_mul(y))?;
        let residual_squares =
            y.column_iter().zip(forward.column_iter()).map(|(y, f)| y.norm_squared() - f.norm_squared());
        // Of torque that the model tells exactly only rounding is left.
        Some(residual_squares.map(|residual_squares| residual_squares.max(0.0)).collect())
    }

    fn residual(&self, y: DVector<f64>) -> DVector<f64> {
        let x = self.factor.solve(&self.d.tr_mul(&y));
        y - &self.d * x
    }
}

/// Moves that are tried \[s\]: torque is taken so much later.
fn moves() -> Vec<f64> {
    let count = (POLICY.timing.max_shift_s / STEP_S).round() as i32;
    (-count..=count).map(|k| f64::from(k) * STEP_S).collect()
}

/// Place among the moves.
fn nearest(late: f64) -> usize {
    ((late.clamp(-POLICY.timing.max_shift_s, POLICY.timing.max_shift_s) + POLICY.timing.max_shift_s) / STEP_S).round()
        as usize
}

/// Where a curve is lowest, by a parabola through the three points there, and its second derivative; none at an end.
fn lowest(places: &[f64], y: &[f64]) -> Option<(f64, f64)> {
    let at = (0..y.len()).min_by(|a, b| y[*a].total_cmp(&y[*b]))?;
    let (before, after) = (*y.get(at.checked_sub(1)?)?, *y.get(at + 1)?);
    let bend = before - 2.0 * y[at] + after;
    (bend > 0.0).then(|| (places[at] + 0.5 * STEP_S * (before - after) / bend, bend / (STEP_S * STEP_S)))
}

impl Pooled {
    /// Whether these rows are against `seconds`; `noisy`: a joint keeps several times its noise.
    pub(crate) fn is_against(&self, seconds: f64, noisy: bool) -> bool {
        self.most()
            < seconds * if noisy { POLICY.timing.min_allowed_share_open } else { POLICY.timing.min_allowed_share }
    }

    /// What rows in motion have, where they are sure that there is something.
    pub(crate) fn size(&self) -> Option<Size> {
        self.is_sure().then_some(Size { seconds: self.behind, std: self.apart })
    }
}

/// By how much the arm is behind its torque \[s\].
#[derive(Clone, Copy)]
pub(crate) struct Size {
    pub(crate) seconds: f64,
    pub(crate) std: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_lowest_place_of_a_parabola_is_between_its_points() {
        let places = moves();
        let y: Vec<f64> = places.iter().map(|x| 3.0 + 5.0 * (x - 0.0043).powi(2)).collect();
        let (at, bend) = lowest(&places, &y).expect("it is inside");
        assert!((at - 0.0043).abs() < 1e-9 && (bend / 10.0 - 1.0).abs() < 1e-6, "{at} {bend}");
        assert_eq!(lowest(&places, &places), None, "one that falls to its end has none");
        assert_eq!((nearest(0.0), nearest(1.0)), (50, 100));
    }

    /// A run whose first `joints` joints are all best with torque moved by `late` \[s\].
    fn timing(joints: usize, late: f64) -> Timing {
        let moved: Vec<f64> = moves().iter().map(|x| 1.0 + 1e5 * (x - late).powi(2)).collect();
        let of = |joint| JointTiming {
            joint,
            moved: moved.clone(),
            unfiltered: Vec::new(),
            rows: Vec::new(),
            weight: 100.0,
            rms: 1.0,
            late,
            sigma: 1e-4,
        };
        Timing { late, sigma: 1e-4, joints: (0..joints).map(of).collect() }
    }

    /// Simulated arms (late and sigma of their runs): sound ones that stick, logged at 500 Hz and less, whose reversals look like delays of
    /// 4.7 to 5.9 ms, and two whose torque is behind by 6 ms.
    #[test]
    fn what_reversals_alone_show_is_no_delay() {
        let run = |[late, sigma]: &[f64; 2]| Timing { sigma: 1e-3 * sigma, ..timing(6, 1e-3 * late) };
        let pooled = |runs: &[[f64; 2]]| {
            let runs: Vec<Timing> = runs.iter().map(run).collect();
            Pooled::from_timings(runs.iter(), POLICY.timing.min_delay_s).expect("runs")
        };
        for (runs, ms) in [
            ([[-0.66, 0.38], [1.64, 0.64]], 4.7),
            ([[-0.97, 0.32], [-0.96, 0.50]], 4.8),
            ([[-1.25, 0.35], [-2.45, 0.65]], 5.8),
            ([[-1.87, 0.47], [-1.98, 0.63]], 5.9),
        ] {
            let pooled = pooled(&runs);
            assert!(pooled.is_against(1e-3 * ms, false) && pooled.size().is_none(), "{runs:?}");
        }
        for runs in [[[-6.98, 0.21], [-3.96, 0.63]], [[-5.94, 0.47], [-7.33, 0.56]]] {
            let pooled = pooled(&runs);
            // What is left at reversals may say a half more than there is.
            assert!([6e-3, 9e-3].iter().all(|s| !pooled.is_against(*s, false)), "{runs:?}");
        }
        // A measured UR10e without its friction, whose joints keep 3 to 11 times their noise: 18.8 ms are left at reversals.
        let measured = pooled(&[[-5.9, 0.36]]);
        let size = measured.size().expect("there is something");
        assert!(!measured.is_against(18.8e-3, true) && measured.is_against(18.8e-3, false));
        assert!((size.seconds - 5.9e-3).abs() < 1e-12);
        // Who says nothing has no say.
        assert!(Pooled::from_timings([].iter(), POLICY.timing.min_delay_s).is_none());
    }

    /// A practice log moved by 5 ms, and a simulated arm whose bristles bend 20 to 60 µrad.
    #[test]
    fn a_clock_has_one_time_and_friction_each_joints_own() {
        let arm = |ms: f64, joints: [f64; 6]| {
            let joints = joints.iter().map(|own| timing(1, 1e-3 * own).joints.remove(0)).collect();
            Timing { late: 1e-3 * ms, sigma: 1e-4, joints }
        };
        let clock = arm(4.7, [4.8, 4.7, 4.7, 4.7, 4.6, 5.6]);
        assert!(clock.is_agreed(POLICY.timing.max_clock_disagreement));
        let bristles = arm(1.86, [2.3, 2.6, 2.0, 1.7, 1.6, 2.0]);
        assert!(
            bristles.is_agreed(POLICY.timing.max_disagreement)
                && !bristles.is_agreed(POLICY.timing.max_clock_disagreement)
        );
    }

    #[test]
    fn runs_that_differ_are_not_sure_together() {
        let pooled = |runs: [(f64, f64); 2]| {
            let runs = runs.map(|(late, sigma)| Timing { sigma, ..timing(6, late) });
            Pooled::from_timings(runs.iter(), POLICY.timing.min_delay_s).expect("runs")
        };
        let agree = pooled([(-4e-3, 1e-4), (-4.1e-3, 1e-4)]);
        assert!((agree.apart - 1e-4 / 2f64.sqrt()).abs() < 1e-9 && agree.size().is_some());
        let of_one = [timing(1, -4e-3), timing(1, -4.1e-3)];
        assert!(
            Pooled::from_timings(of_one.iter(), POLICY.timing.min_delay_s).expect("runs").size().is_none(),
            "one joint's time is not the arm's"
        );
        // 11.8 deviations apart, with one degree of freedom.
        let differ = pooled([(-2e-3, 1e-4), (-8e-3, 5e-4)]);
        assert!((differ.apart / differ.sigma - 6e-3 / 26e-8f64.sqrt()).abs() < 1e-6 && differ.size().is_none());
    }

    #[test]
    fn a_run_of_one_joint_may_not_be_against_the_others() {
        let sure = |runs: &[(usize, f64)]| {
            let runs: Vec<Timing> = runs.iter().map(|(joints, late)| timing(*joints, *late)).collect();
            are_sure(runs.iter().map(|run| (run, POLICY.timing.min_delay_s)))
        };
        assert!(sure(&[(6, -0.012), (6, -0.0121)]) && sure(&[(1, -0.0131), (6, -0.012)]));
        assert!(!sure(&[(1, -0.012)]), "of the arm it says nothing");
        assert!(!sure(&[(1, 0.0), (6, -0.012)]) && !sure(&[(6, 0.0), (6, -0.012)]), "the other is against it");
    }
}
