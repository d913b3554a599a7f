//! Which effects are missing: forward selection by evidence, guarded by a score test and by held-out blocks.

use nalgebra::DVector;

use crate::background::Nominal;
use crate::design::{Design, Prepared, correlation, unknown};
use crate::evidence::{Added, Belief, CandidateCell, PRIOR_SCALES, Solved, candidate_sums, joint_errors_with};
use crate::form::Form;
use crate::library;
use crate::mounting;
use crate::parallel;
use crate::physics::Physics;
use crate::rows::Column;
use crate::warming;

/// Prior standard deviation of a free coefficient: it may contribute this share of its joint's torque.
const FREE: f64 = 0.3;
/// Of a coefficient that is 1 by the physics.
const FIXED: f64 = 0.15;
/// Of a link's scale: a link several times as heavy as drawn is a payload.
const LINK: f64 = 0.3;

/// Log evidence that an inner value costs: it was chosen among some twenty.
const INNER_VALUE: f64 = 3.0;
/// Times that rows in doubt are weighed anew.
const REWEIGHINGS: usize = 4;
/// Noise that changes by less than this share stays.
const SETTLED: f64 = 0.05;

/// A candidate with its products.
#[derive(Clone)]
pub(crate) struct Candidate {
    pub(crate) form: Form,
    pub(crate) columns: Vec<Vec<Column>>,
    pub(crate) cells: Vec<CandidateCell>,
    pub(crate) belief: Belief,
}

impl Candidate {
    /// Log evidence that its inner values cost.
    pub(crate) fn price(&self) -> f64 {
        INNER_VALUE * self.form.inner_values() as f64
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
                let physics = Physics::new(&r.run, &r.motion, nominal, &nominal.x, None).beside(&r.known);
                r.unnamed(nominal, &physics)
            })
            .collect();
        let sizes = unknown(nominal, runs.first()?.run.period_s);
        let design = Design::new(&runs, nominal, &torque, &extra, &sizes);
        let weights: Vec<f64> = torque.iter().map(|t| 1.0 / (0.01 * t * t)).collect();
        let floor = (0..n).map(|j| runs.iter().map(|r| r.floor[j]).fold(f64::INFINITY, f64::min)).collect();
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
        };
        search.weigh()?;
        search.reweigh()?;
        search.first_noise.copy_from_slice(&search.noise);
        Some(search)
    }

    /// The background solved at a scale of the nominal's errors.
    pub(crate) fn solved(&self, scale: f64) -> Option<Solved> {
        self.design.background.solve(&self.weights, scale, 0..self.design.background.blocks())
    }

    /// The background at its best scale.
    pub(crate) fn best(&self) -> Option<(f64, Solved)> {
        self.scales().into_iter().max_by(|a, b| a.1.log_evidence.total_cmp(&b.1.log_evidence))
    }

    /// The background solved at every scale.
    pub(crate) fn scales(&self) -> Vec<(f64, Solved)> {
        self.design.background.solve_scales(&self.weights, &PRIOR_SCALES)
    }

    /// Weights from the residual that the background leaves: one over its long-run variance.
    pub(crate) fn weigh(&mut self) -> Option<()> {
        for _ in 0..4 {
            let (scale, solved) = self.best()?;
            self.scale = scale;
            let residuals = self.design.residuals(&solved.x);
            for j in 0..self.noise.len() {
                let records: Vec<&DVector<f64>> = residuals.iter().map(|r| &r[j]).collect();
                let rows: usize = records.iter().map(|r| r.len()).sum();
                let square: f64 = records.iter().map(|r| r.norm_squared()).sum();
                self.noise[j] = (square / rows.max(1) as f64).sqrt().max(1e-9);
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
            if before.iter().zip(&self.noise).all(|(b, n)| (b - n).abs() <= SETTLED * b) {
                break;
            }
        }
        Some(())
    }

    /// Standard vector of the background at its best.
    pub(crate) fn values(&self, x: &DVector<f64>) -> Vec<f64> {
        self.nominal.x.iter().zip(x.iter()).map(|(nominal, change)| nominal + change).collect()
    }

    /// Makes a candidate of a form.
    pub(crate) fn candidate(&self, form: Form, physics: &[Physics<'_>]) -> Option<Candidate> {
        let columns: Vec<Vec<Column>> = self.runs.iter().zip(physics).map(|(r, p)| r.columns(&form, p)).collect();
        let count = columns.first()?.len();
        if count == 0 || columns.iter().all(|own| own.iter().all(|c| c.iter().all(Option::is_none))) {
            return None;
        }
        let finite = columns.iter().flatten().flatten().flatten().flatten().all(|v| v.abs() < 1e6);
        if !finite {
            return None;
        }
        let belief = self.belief(&form, &columns, count)?;
        let cells = self.design.candidate(&columns);
        Some(Candidate { form, columns, cells, belief })
    }

    fn belief(&self, form: &Form, columns: &[Vec<Column>], count: usize) -> Option<Belief> {
        if form.has_fixed_gain() {
            return Some(Belief { mean: DVector::repeat(count, 1.0), std: DVector::repeat(count, FIXED) });
        }
        let mut std = DVector::zeros(count);
        if matches!(form, Form::LinkScale { .. }) {
            return Some(Belief { mean: DVector::zeros(count), std: DVector::repeat(count, LINK) });
        }
        for c in 0..count {
            std[c] = self.free(columns, c)?;
        }
        Some(Belief { mean: DVector::zeros(count), std })
    }

    /// Size at which a column is a share of the torque of the joint that feels it most.
    pub(crate) fn free(&self, columns: &[Vec<Column>], c: usize) -> Option<f64> {
        let mut least = f64::INFINITY;
        for j in 0..self.noise.len() {
            let values = columns.iter().filter_map(|own| own[c][j].as_ref()).flatten();
            let (square, rows) = values.fold((0.0, 0usize), |(s, n), v| (s + v * v, n + 1));
            if rows == 0 || square == 0.0 {
                continue;
            }
            let torque: f64 = self.runs.iter().flat_map(|r| &r.tau[j]).map(|t| t * t).sum();
            let ratio = (torque / square).sqrt();
            least = least.min(ratio);
        }
        least.is_finite().then_some(FREE * least)
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
            DVector::from_vec(torque)
        };
        let explained = |(candidate, c): (&Candidate, &DVector<f64>)| {
            solved.explained(&candidate_sums(&candidate.cells, &self.weights, |_| true)?, c)
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
        let standing = Self::standing_at(at, candidate, &self.weights, solved)?;
        candidate.form.plausible(standing.added.c.as_slice()).then_some(standing)
    }

    /// The same at other weights, whether it makes sense or not.
    pub(crate) fn standing_at(
        at: usize,
        candidate: &Candidate,
        weights: &[f64],
        solved: &[(f64, Solved)],
    ) -> Option<Standing> {
        let base = solved.iter().map(|(_, s)| s.log_evidence).max_by(f64::total_cmp)?;
        let sums = candidate_sums(&candidate.cells, weights, |_| true)?;
        let added = solved
            .iter()
            .filter_map(|(_, s)| s.add_sums(&sums, &candidate.belief))
            .max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence))?;
        Some(Standing { at, gain: added.log_evidence - base - candidate.price(), added })
    }

    /// Held-out gain of a candidate by block, in units of independent rows: the weighted sum of squares that the
    /// background leaves less what it leaves with the candidate, both fitted without the block's fold.
    pub(crate) fn held_out(&self, candidate: &Candidate, folds: usize) -> Option<Vec<Vec<f64>>> {
        let blocks = self.design.background.blocks();
        let mut gains = vec![vec![0.0; self.noise.len()]; blocks];
        for fold in 0..folds {
            let keep = |b: usize| b * folds / blocks != fold;
            let solved = self.design.background.solve(&self.weights, self.scale, (0..blocks).filter(|b| keep(*b)))?;
            let added = solved.add(&candidate.cells, &candidate.belief, &self.weights, keep)?;
            for block in (0..blocks).filter(|b| !keep(*b)) {
                let without = self.design.background.joint_errors(block, &solved.x);
                let with = joint_errors_with(&self.design.background, &candidate.cells, block, &added);
                for j in 0..self.noise.len() {
                    gains[block][j] = without[j] - with[j];
                }
            }
        }
        Some(gains)
    }

    /// Physics of every run with the values of the background.
    pub(crate) fn physics(&self) -> Option<Vec<Physics<'a>>> {
        let (_, solved) = self.best()?;
        let x = self.values(&solved.x);
        let made = |(i, r): (usize, &&'a Prepared)| {
            Physics::new(&r.run, &r.motion, self.nominal, &x, Some(i)).beside(&r.known)
        };
        Some(self.runs.iter().enumerate().map(made).collect())
    }

    pub(crate) fn candidates(&self, physics: &[Physics<'_>], orders: &[Vec<f64>], bursts: &Bursts) -> Vec<Candidate> {
        let Some(first) = physics.first() else { return Vec::new() };
        let force = (!bursts.iter().all(Vec::is_empty)).then(|| Form::Force { windows: bursts.clone() });
        let beside = warming::forms(physics).into_iter().chain(mounting::forms(physics)).chain(force);
        let forms: Vec<Form> = library::forms(first, orders).into_iter().chain(beside).collect();
        parallel::map(&forms, |form| self.candidate(form.clone(), physics)).into_iter().flatten().collect()
    }
}
