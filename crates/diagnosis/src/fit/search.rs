//! The state of the search: background, weights and noise, and the log evidence of a candidate beside it.

use nalgebra::{DMatrix, DVector};

use crate::effects::Form;
use crate::effects::base_flexibility;
use crate::effects::candidates;
use crate::effects::external_force::Force;
use crate::effects::physics::Physics;
use crate::effects::temperature_dependent_friction;
use crate::fit::design::Design;
use crate::fit::evidence::{Added, Background, Belief, CandidateCell, FOLDS, PRIOR_SCALES, Solved};
use crate::model::listener::Listener;
use crate::model::nominal::Nominal;
use crate::model::rows::Column;
use crate::model::standstill;
use crate::numerics::autocorrelation::correlation;
use crate::numerics::elimination::Stretch;
use crate::numerics::parallel;
use crate::policy::POLICY;
use crate::screen::prepared::{Prepared, unknown};

/// No torque is told better than this \[N·m\].
const LEAST_NOISE: f64 = 1e-9;
/// Nor than this share of its root mean square: weights that are further apart leave no digits to solve the equations with.
const LEAST_NOISE_SHARE: f64 = 1e-5;
/// Times that rows in doubt are weighed anew.
const REWEIGHINGS: usize = 4;
/// Noise that changes by less than this share stays.
const MAX_SETTLED_NOISE_CHANGE: f64 = 0.05;

/// Scores of a candidate, whitened: coefficients x blocks.
pub(crate) type Scores = DMatrix<f64>;
/// Makes the scores of a candidate that has its columns; none of one whose scores say nothing.
pub(crate) type Scoring<'a> = dyn Fn(&Candidate) -> Option<Scores> + Sync + 'a;

/// A candidate with its products.
#[derive(Clone)]
pub(crate) struct Candidate {
    pub(crate) form: Form,
    /// By run; none where many candidates are only held against each other.
    pub(crate) columns: Vec<Vec<Column>>,
    pub(crate) cells: Vec<CandidateCell>,
    pub(crate) belief: Belief,
    /// Of contact, which has no other columns.
    pub(crate) local: Vec<Stretch>,
    /// Block by block, where they were asked for.
    pub(crate) scores: Option<Scores>,
}

impl Candidate {
    /// Log evidence that its inner values cost.
    pub(crate) fn price(&self) -> f64 {
        POLICY.priors.inner_value_evidence * self.form.inner_values() as f64
    }

    /// How many numbers it has, inner values among them.
    pub(crate) fn numbers(&self) -> usize {
        let coefficients = if self.local.is_empty() { self.belief.mean.len() } else { 0 };
        coefficients + self.local.iter().map(|s| s.std.len()).sum::<usize>() + self.form.inner_values()
    }
}

/// Bursts of each run: from and to \[s\].
pub(crate) type Bursts = Vec<Vec<(f64, f64)>>;

/// State of the search.
pub(crate) struct Search<'a> {
    pub(crate) runs: Vec<&'a Prepared>,
    pub(crate) nominal: &'a Nominal,
    pub(crate) design: Design,
    pub(crate) weights: Vec<f64>,
    /// Root mean square of the weighted residual \[N·m\], each joint.
    pub(crate) noise: Vec<f64>,
    pub(crate) correlations: Vec<f64>,
    /// The same before anything was adopted.
    pub(crate) first_noise: Vec<f64>,
    /// Noise that the torque signal itself has after the model filter \[N·m\].
    pub(crate) floor: Vec<f64>,
    pub(crate) scale: f64,
    /// Whether a joint moves in any run: one that stands holds what its friction lets it, which tells nothing of the joint.
    moves: Vec<bool>,
    /// Noise below which no joint's torque is believed to be known \[N·m\].
    least_noise: Vec<f64>,
    /// Whether candidates keep their columns: rows of all of them are many times the log.
    pub(crate) keeps_columns: bool,
}

/// A candidate's standing.
#[derive(Clone)]
pub(crate) struct Standing {
    pub(crate) at: usize,
    pub(crate) gain: f64,
    pub(crate) added: Added,
}

impl<'a> Search<'a> {
    pub(crate) fn new(runs: Vec<&'a Prepared>, nominal: &'a Nominal) -> Option<Search<'a>> {
        let n = nominal.model.arm.dof();
        let rms = |signals: &dyn Fn(&Prepared) -> Vec<f64>| {
            let all: Vec<f64> = runs.iter().flat_map(|r| signals(r)).collect();
            (all.iter().map(|t| t * t).sum::<f64>() / all.len().max(1) as f64).sqrt().max(1e-9)
        };
        let torque: Vec<f64> = (0..n).map(|j| rms(&|r: &Prepared| r.tau[j].clone())).collect();
        let extra: Vec<Vec<Column>> = runs
            .iter()
            .map(|r| {
                let physics = Physics::new(&r.run, &r.motion, nominal, &nominal.x).with_known_torque(&r.known);
                r.unnamed(nominal, &physics)
            })
            .collect();
        let sizes = unknown(nominal, runs.first()?.run.period_s);
        let design = Design::new(&runs, nominal, &torque, &extra, &sizes);
        let weights: Vec<f64> = torque.iter().map(|t| 1.0 / (0.01 * t * t)).collect();
        // Computed torque has no noise.
        let least = torque.iter().map(|t| LEAST_NOISE_SHARE * t).collect::<Vec<_>>();
        let trusted_runs = |j: usize| runs.iter().filter(move |r| r.silent[j].is_none());
        let floor = |j: usize| trusted_runs(j).map(|r| r.floor[j]).reduce(f64::min).unwrap_or(0.0);
        let floor = (0..n).map(|j| floor(j).max(least[j]).max(LEAST_NOISE)).collect();
        let moves = (0..n).map(|j| runs.iter().any(|r| standstill::is_moved(&r.motion, &r.chain, j))).collect();
        let mut search = Search {
            runs,
            nominal,
            design,
            weights,
            noise: torque,
            correlations: vec![1.0; n],
            first_noise: vec![0.0; n],
            floor,
            scale: 1.0,
            moves,
            least_noise: least,
            keeps_columns: false,
        };
        search.weigh()?;
        search.reweigh()?;
        search.first_noise.copy_from_slice(&search.noise);
        Some(search)
    }

    /// Runs in which the torque of joint `j` says something.
    pub(crate) fn trusted_runs(&self, j: usize) -> impl Iterator<Item = &'a Prepared> + '_ {
        self.runs.iter().copied().filter(move |r| r.silent[j].is_none())
    }

    /// The background solved at a scale of the nominal's errors.
    pub(crate) fn solved(&self, scale: f64) -> Option<Solved> {
        self.design.background.solve_folds(&self.weights, scale, &[], |_| true)
    }

    /// The background at its best scale.
    pub(crate) fn best(&self) -> Option<(f64, Solved)> {
        self.scales().into_iter().max_by(|a, b| a.1.log_evidence.total_cmp(&b.1.log_evidence))
    }

    /// The background solved at every scale.
    pub(crate) fn scales(&self) -> Vec<(f64, Solved)> {
        self.design.background.solve_scales(&self.weights, &PRIOR_SCALES, &[])
    }

    /// Weights from the residual that the background leaves: one over its long-run variance.
    pub(crate) fn weigh(&mut self) -> Option<()> {
        for _ in 0..4 {
            let (scale, solved) = self.best()?;
            self.scale = scale;
            let residuals = self.design.residuals(&solved.x, &solved.stretches);
            for j in 0..self.noise.len() {
                let records: Vec<&DVector<f64>> = residuals.iter().map(|r| &r[j]).collect();
                let rows: usize = self.trusted_runs(j).map(Prepared::rows).sum();
                if rows == 0 {
                    // Nothing is known of it, so nothing is left on it.
                    self.noise[j] = self.floor[j];
                    continue;
                }
                let square: f64 = records.iter().map(|r| r.norm_squared()).sum();
                self.noise[j] = (square / rows as f64).sqrt().max(self.least_noise[j]).max(LEAST_NOISE);
                self.correlations[j] = correlation(&records);
                self.weights[j] = 1.0 / (self.noise[j].powi(2) * self.correlations[j]);
            }
        }
        Some(())
    }

    /// Weights from the residual, those of rows in doubt included: they leave a weighted residual of about the noise that
    /// they were weighed with, so the noise comes down to what holds in steps.
    pub(crate) fn reweigh(&mut self) -> Option<()> {
        for _ in 0..REWEIGHINGS {
            let before = self.noise.clone();
            self.design.weigh_doubt(&self.runs, &before);
            self.weigh()?;
            if before.iter().zip(&self.noise).all(|(b, n)| (b - n).abs() <= MAX_SETTLED_NOISE_CHANGE * b) {
                break;
            }
        }
        Some(())
    }

    /// Makes a candidate part of the background and weighs anew; the signals of the runs with it. None where the equations have
    /// no solution with it: then the search is as before.
    pub(crate) fn extend(&mut self, candidate: &Candidate, mean: &[f64]) -> Option<Vec<Physics<'a>>> {
        let std: Vec<f64> = candidate.belief.std.iter().copied().collect();
        let before = (self.noise.clone(), self.correlations.clone(), self.weights.clone(), self.scale);
        self.design.background.local.extend(candidate.local.iter().cloned());
        self.design.adopt(&candidate.columns, mean, &std);
        let made = self.weigh().and_then(|()| self.reweigh()).and_then(|()| self.physics());
        if made.is_none() {
            let stretches = self.design.background.local.len() - candidate.local.len();
            self.design.background.local.truncate(stretches);
            (self.noise, self.correlations, self.weights, self.scale) = before;
            self.design.weigh_doubt(&self.runs, &self.noise);
            self.design.give_up(mean);
        }
        made
    }

    /// Standard vector of the background at its best.
    pub(crate) fn values(&self, x: &DVector<f64>) -> Vec<f64> {
        self.nominal.x.iter().zip(x.iter()).map(|(nominal, change)| nominal + change).collect()
    }

    /// Makes a candidate of a form.
    pub(crate) fn candidate(&self, form: Form, physics: &[Physics<'_>]) -> Option<Candidate> {
        if let Some(Force { windows, moment }) = form.get() {
            return self.contact(windows, *moment, physics);
        }
        if !form.is_observed(physics) {
            return None;
        }
        let columns: Vec<Vec<Column>> = self.runs.iter().zip(physics).map(|(r, p)| r.columns(&form, p)).collect();
        let count = columns.first()?.len();
        if count == 0 || columns.iter().all(|own| own.iter().all(|c| c.iter().all(Option::is_none))) {
            return None;
        }
        let acts = |j: usize| columns.iter().flatten().filter_map(|c| c[j].as_ref()).flatten().any(|v| *v != 0.0);
        if !(0..self.moves.len()).any(|j| self.moves[j] && acts(j)) {
            return None;
        }
        let finite = columns.iter().flatten().flatten().flatten().flatten().all(|v| v.abs() < 1e6);
        if !finite {
            return None;
        }
        let belief = self.belief(&form, &columns, count)?;
        let cells = self.design.candidate(&columns);
        Some(Candidate { form, columns, cells, belief, local: Vec::new(), scores: None })
    }

    fn belief(&self, form: &Form, columns: &[Vec<Column>], count: usize) -> Option<Belief> {
        if form.has_fixed_gain() {
            return Some(Belief {
                mean: DVector::repeat(count, 1.0),
                std: DVector::repeat(count, POLICY.priors.unit_coefficient),
            });
        }
        let mut std = DVector::zeros(count);
        if let Some(prior_std) = form.prior_std() {
            return Some(Belief { mean: DVector::zeros(count), std: DVector::repeat(count, prior_std) });
        }
        for c in 0..count {
            // Whatever is believed of what nobody feels.
            let unfelt = form.has_unfelt_columns().then_some(1.0);
            std[c] = self.free(columns, c).or(unfelt)?;
        }
        Some(Belief { mean: DVector::zeros(count), std })
    }

    /// Size at which a column is a share of the torque of the joint that feels it most.
    pub(crate) fn free(&self, columns: &[Vec<Column>], c: usize) -> Option<f64> {
        let mut least = f64::INFINITY;
        for j in 0..self.noise.len() {
            let trusted_columns = self.runs.iter().zip(columns).filter(|(r, _)| r.silent[j].is_none());
            let values = trusted_columns.filter_map(|(_, trusted_columns)| trusted_columns[c][j].as_ref()).flatten();
            let (square, rows) = values.fold((0.0, 0usize), |(s, n), v| (s + v * v, n + 1));
            if rows == 0 || square == 0.0 {
                continue;
            }
            let torque: f64 = self.trusted_runs(j).flat_map(|r| &r.tau[j]).map(|t| t * t).sum();
            let ratio = (torque / square).sqrt();
            least = least.min(ratio);
        }
        least.is_finite().then_some(POLICY.priors.coefficient_torque_share * least)
    }

    /// Cosine of the angle between the torques of two candidates with their coefficients, after what the background makes of
    /// each within what is believed of it.
    pub(crate) fn cosine(
        &self,
        solved: &Solved,
        one: (&Candidate, &DVector<f64>),
        other: (&Candidate, &DVector<f64>),
    ) -> Option<f64> {
        let signal = |(candidate, c): (&Candidate, &DVector<f64>)| -> DVector<f64> {
            let mut torque: Vec<f64> = Vec::new();
            for (r, columns) in candidate.columns.iter().enumerate() {
                for (j, weight) in self.weights.iter().enumerate() {
                    let root = self.design.root(r, j);
                    let start = torque.len();
                    torque.resize(start + root.len(), 0.0);
                    for (column, c) in columns.iter().zip(c.iter()) {
                        let Some(values) = &column[j] else { continue };
                        let to = torque[start..].iter_mut().zip(values.iter().zip(root));
                        to.for_each(|(to, (v, w))| *to += c * v * w * weight.sqrt());
                    }
                }
            }
            let mut from = 0;
            for stretch in &candidate.local {
                let coefficients = c.rows(from, stretch.std.len()).into_owned();
                from += coefficients.len();
                let mut start = self.runs[..stretch.run].iter().map(|r| r.rows()).sum::<usize>() * self.weights.len();
                for (j, weight) in self.weights.iter().enumerate() {
                    let root = self.design.root(stretch.run, j);
                    for (k, value) in stretch.rows.clone().zip(stretch.torque(j, &coefficients)) {
                        torque[start + k] += value * root[k] * weight.sqrt();
                    }
                    start += root.len();
                }
            }
            DVector::from_vec(torque)
        };
        let explained = |(candidate, c): (&Candidate, &DVector<f64>)| {
            if candidate.local.is_empty() {
                return solved.explained(&solved.sums(&candidate.cells, &self.weights, |_| true)?, c);
            }
            solved.explained(&self.contact_sums(candidate, c), &DVector::repeat(1, 1.0))
        };
        let (a, b) = (signal(one), signal(other));
        let (fa, fb) = (explained(one)?, explained(other)?);
        let product = |a: &DVector<f64>, b: &DVector<f64>, fa: &DVector<f64>, fb: &DVector<f64>| a.dot(b) - fa.dot(fb);
        let sizes = product(&a, &a, &fa, &fa) * product(&b, &b, &fb, &fb);
        Some((product(&a, &b, &fa, &fb).abs() / sizes.max(f64::MIN_POSITIVE).sqrt()).min(1.0))
    }

    /// Evidence of all candidates, best first.
    pub(crate) fn rank(&self, candidates: &[Candidate]) -> Option<Vec<Standing>> {
        let solved = self.scales();
        let numbered: Vec<(usize, &Candidate)> = candidates.iter().enumerate().collect();
        let mut standings: Vec<Standing> =
            parallel::map(&numbered, |(at, c)| self.standing(*at, c, &solved)).into_iter().flatten().collect();
        standings.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        (!solved.is_empty()).then_some(standings)
    }

    /// A candidate's standing over the background as it is [solved](Self::scales); none where it makes no sense.
    pub(crate) fn standing(&self, at: usize, candidate: &Candidate, solved: &[(f64, Solved)]) -> Option<Standing> {
        let standing = Self::standing_at(&self.design.background, at, candidate, &self.weights, solved)?;
        candidate.form.plausible(standing.added.c.as_slice()).then_some(standing)
    }

    /// The same at other weights, whether it makes sense or not.
    pub(crate) fn standing_at(
        background: &Background,
        at: usize,
        candidate: &Candidate,
        weights: &[f64],
        solved: &[(f64, Solved)],
    ) -> Option<Standing> {
        let base = solved.iter().map(|(_, s)| s.log_evidence).max_by(f64::total_cmp)?;
        let added: Vec<Added> = if candidate.local.is_empty() {
            let sums = solved.first()?.1.sums(&candidate.cells, weights, |_| true)?;
            solved.iter().filter_map(|(_, s)| s.add_sums(&sums, &candidate.belief)).collect()
        } else {
            let scales: Vec<f64> = solved.iter().map(|(scale, _)| *scale).collect();
            let solved_with = background.solve_scales(weights, &scales, &candidate.local);
            solved_with.iter().map(|(_, s)| s.with_stretches(background.local.len())).collect()
        };
        let added = added.into_iter().max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence))?;
        Some(Standing { at, gain: added.log_evidence - base - candidate.price(), added })
    }

    /// Held-out gain of a candidate by fold, in units of independent rows: the weighted sum of squares that the
    /// background leaves less what it leaves with the candidate, both fitted without the fold.
    pub(crate) fn held_out(&self, candidate: &Candidate) -> Option<Vec<Vec<f64>>> {
        let (background, local) = (&self.design.background, &candidate.local);
        // Contact is told by what holds beside it, also in the fold: no other blocks felt it, and what is left of it would be
        // to the credit of whatever bends there.
        let whole = self.solved(self.scale)?;
        let sums = whole.sums(&candidate.cells, &self.weights, |_| true);
        let mut gains = Vec::with_capacity(FOLDS);
        for fold in 0..FOLDS {
            let keep = |other: usize| other != fold;
            let mut solved = background.solve_folds(&self.weights, self.scale, &[], keep)?;
            let mut added = if local.is_empty() {
                solved.add(&candidate.cells, &candidate.belief, &self.weights, keep)?
            } else {
                let solved_with = background.solve_folds(&self.weights, self.scale, local, keep)?;
                solved_with.with_stretches(background.local.len())
            };
            if let Some(sums) = &sums {
                solved.stretches = whole.stretches_beside(&solved.x, None);
                added.stretches = whole.stretches_beside(&added.x, Some((sums, &added.c)));
            }
            let without = background.fold_errors(fold, &solved);
            let errors_with = background.fold_errors_with(&candidate.cells, local, fold, &added);
            gains.push(without.iter().zip(errors_with).map(|(without, errors_with)| without - errors_with).collect());
        }
        Some(gains)
    }

    /// Physics of every run with the values of the background.
    pub(crate) fn physics(&self) -> Option<Vec<Physics<'a>>> {
        let (_, solved) = self.best()?;
        let x = self.values(&solved.x);
        let made = |r: &&'a Prepared| Physics::new(&r.run, &r.motion, self.nominal, &x).with_known_torque(&r.known);
        Some(self.runs.iter().map(made).collect())
    }

    /// Every candidate there is, with scores where there is a `scoring`. The listener gets how many are done.
    pub(crate) fn candidates(
        &self,
        physics: &[Physics<'_>],
        orders: &[Vec<f64>],
        bursts: &Bursts,
        scoring: Option<&Scoring<'_>>,
        listener: &mut dyn Listener,
    ) -> Vec<Candidate> {
        let new = self.design.background.local.is_empty() && !bursts.iter().all(Vec::is_empty);
        let force = |moment| Form::from(Force { windows: bursts.clone(), moment });
        let force = [false, true].into_iter().filter(|_| new).map(force);
        let warming = temperature_dependent_friction::candidates(physics).into_iter().map(Form::from);
        let bases = base_flexibility::candidates(physics).into_iter().map(Form::from);
        let further_forms = warming.chain(bases).chain(force);
        let forms: Vec<Form> = candidates::forms(physics, orders).into_iter().chain(further_forms).collect();
        let made = |form: &Form| {
            let mut candidate = self.candidate(form.clone(), physics)?;
            candidate.scores = scoring.and_then(|scoring| scoring(&candidate));
            if !self.keeps_columns {
                candidate.columns = Vec::new();
            }
            Some(candidate)
        };
        parallel::map_counted(&forms, made, |done| listener.count(done, forms.len())).into_iter().flatten().collect()
    }
}
